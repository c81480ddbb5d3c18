//! From commands to what pushes the marbles of a register: knobs, board, gravity.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use std::f64::consts::FRAC_PI_2;

use pulp::Simd;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::agenda::{Agenda, Moment, Timeline};
use super::{Clock, Job, Setup};
use crate::board::{BOARD_FRICTION, GRAVITY};
use crate::effects::{Acts, Any, acting};
use crate::lanes::Lanes;
use crate::motion::{Pair, Push};

/// The knobs, the board and its tilt, for the rollouts of a register.
pub(super) struct Actuation<S: Simd> {
    gear: Pair<S>,
    rolling_friction: Lanes<S>,
    damping_per_s: f64,
    clock: Vec<Any<S>>,
    knobs: Vec<Any<S>>,
    tilts: Vec<Any<S>>,
    arrivals: Option<Arrivals<S>>,
    /// Whether knobs move while their commands hold still.
    moves: bool,
    /// The commands as they have arrived (rad).
    command: Pair<S>,
    /// Where the knobs were in the last substep (rad).
    turned: Pair<S>,
    length: Lanes<S>,
    /// Factor that damping leaves of velocities in a substep of this row.
    damping: Lanes<S>,
    /// The board's angles (rad).
    pub(super) tilt: Pair<S>,
    /// What gravity, friction and damping do in a substep.
    pub(super) push: Push<S>,
}

impl<S: Simd> Actuation<S> {
    /// Knobs that have long been at the angles before row 0; `job` is asked for a lane's rollout.
    pub(super) fn new<'a, 'b: 'a>(
        simd: S,
        setup: &Setup<'_>,
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Self {
        let lanes = |value: &dyn Fn(&Job<'_>) -> f64| Lanes::from_fn(simd, |lane| value(job(lane)));
        let effects = |places: fn(Acts) -> bool| {
            acting(simd, setup.rig, setup.effects, places, |lane| {
                job(lane).rollout
            })
        };
        let zero = Lanes::splat(simd, 0.0);
        let before = [
            lanes(&|job| job.knobs_before[0]),
            lanes(&|job| job.knobs_before[1]),
        ];
        let mut actuation = Self {
            gear: [
                lanes(&|job| job.parameters.gear_x),
                lanes(&|job| job.parameters.gear_y),
            ],
            rolling_friction: lanes(&|job| job.parameters.rolling_friction),
            damping_per_s: setup.rig.marble.damping_per_s,
            clock: effects(|acts| acts == Acts::OnClock),
            knobs: effects(|acts| matches!(acts, Acts::OnKnob { .. })),
            tilts: effects(|acts| acts == Acts::OnTilt),
            arrivals: None,
            moves: setup.any(|acts| acts == Acts::OnKnob { moves: true }),
            command: before,
            turned: before,
            length: zero,
            damping: zero,
            tilt: [zero; 2],
            push: still(zero),
        };
        let late = effects(|acts| acts == Acts::OnArrival);
        // Where rows have a clock of their own, commands keep to theirs.
        if !late.is_empty() || !actuation.clock.is_empty() {
            let timeline = actuation.timeline(&job);
            let lateness = |lane: usize| lateness(simd, &late, lane, job(lane));
            let moments = (0..S::F64_LANES)
                .map(|lane| arrivals(&timeline, &job(lane).clock, lane, &lateness(lane)))
                .collect();
            actuation.arrivals = Some(Arrivals::new(simd, moments, before, &job));
        }
        let knob = actuation.answer(before);
        actuation.tilt(knob);
        actuation
    }

    /// Whether the board moves within a row.
    pub(super) fn moves(&self) -> bool {
        self.moves || self.arrivals.is_some()
    }

    /// Seconds that each of a row's substeps lasts.
    #[inline(always)]
    pub(super) fn length<'a, 'b: 'a>(
        &self,
        row: usize,
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Lanes<S> {
        let simd = self.length.simd();
        let mut length = Lanes::from_fn(simd, |lane| job(lane).clock.step(row).length_s);
        if !self.clock.is_empty() {
            let part = Lanes::from_fn(simd, |lane| {
                let rows = job(lane).commands.len().max(2) - 1;
                (row as f64 + 0.5) / rows as f64 - 0.5
            });
            for effect in &self.clock {
                length = length * effect.pace(part);
            }
        }
        length
    }

    /// When the rows of the register's rollouts begin.
    pub(super) fn timeline<'a, 'b: 'a>(&self, job: impl Fn(usize) -> &'a Job<'b>) -> Timeline {
        Timeline::new((0..job(0).commands.len()).map(|row| {
            let length = self.length(row, &job);
            (job(0).clock.step(row).substeps, length.to_array())
        }))
    }

    /// Issues the command of a row.
    #[inline(always)]
    pub(super) fn begin_row<'a, 'b: 'a>(&mut self, row: usize, job: impl Fn(usize) -> &'a Job<'b>) {
        let simd = self.length.simd();
        self.length = self.length(row, &job);
        let one = self.length.like(1.0);
        self.damping = one.over(one + self.damping_per_s * self.length);
        if let Some(arrivals) = &mut self.arrivals {
            arrivals.agenda.begin_row(row);
        } else {
            let command = |axis: usize| Lanes::from_fn(simd, |lane| job(lane).commands[row][axis]);
            self.command = [command(0), command(1)];
        }
        if !self.moves() {
            let knob = self.answer(self.command);
            self.tilt(knob);
        }
    }

    /// Moves the board, if it moves within rows, to where it is in this substep.
    #[inline(always)]
    pub(super) fn substep(&mut self, row: usize, substep: u32) {
        let arrived = match &mut self.arrivals {
            Some(arrivals) => arrivals.substep(self.length.simd(), row, substep),
            None => None,
        };
        if let Some(command) = arrived {
            self.command = command;
        }
        if self.moves || arrived.is_some() || substep == 0 {
            let turned = self.turned;
            let knob = self.answer(self.command);
            let moved = knob[0].ne(turned[0]) | knob[1].ne(turned[1]);
            if moved.any() || substep == 0 {
                self.tilt(knob);
            }
        }
    }

    /// Where the knobs are under a command, on average over a substep.
    #[inline(always)]
    fn answer(&mut self, mut knob: Pair<S>) -> Pair<S> {
        for effect in &mut self.knobs {
            effect.turn(&mut knob, self.length);
        }
        self.turned = knob;
        knob
    }

    /// Tilts the board by its knobs.
    #[inline(always)]
    fn tilt(&mut self, knob: Pair<S>) {
        let mut tilt = [self.gear[0] * knob[0], self.gear[1] * knob[1]];
        for effect in &self.tilts {
            effect.tilt(&mut tilt);
        }
        // A board that effects would turn over stands on edge.
        let most = tilt[0].like(FRAC_PI_2);
        self.tilt = [tilt[0].clamp(most), tilt[1].clamp(most)];
        self.push = self.gravity(self.tilt);
    }

    /// Gravity in the frame of a board that turned about x first, then about y.
    #[inline(always)]
    fn gravity(&self, [tilt_x, tilt_y]: Pair<S>) -> Push<S> {
        let length = self.length;
        let ((sin_x, cos_x), (sin_y, cos_y)) = (tilt_x.sin_cos(), tilt_y.sin_cos());
        let normal = GRAVITY * (cos_x * cos_y);
        Push {
            x: GRAVITY * sin_y * length,
            y: -(GRAVITY * (sin_x * cos_y) * length),
            normal,
            resistance: 5.0 / 7.0 * (self.rolling_friction * normal * length),
            grip: BOARD_FRICTION * (normal * length),
            damping: self.damping,
            length,
        }
    }
}

/// Nothing acts.
fn still<S: Simd>(zero: Lanes<S>) -> Push<S> {
    Push {
        x: zero,
        y: zero,
        normal: zero,
        resistance: zero,
        grip: zero,
        damping: zero,
        length: zero,
    }
}

/// Commands that come late.
struct Arrivals<S: Simd> {
    agenda: Agenda<S>,
    /// The commands of each lane's rollout, in the order in which they come.
    commands: Vec<Vec<[f64; 2]>>,
    /// The last ones that came (rad): about x in each lane, about y in each lane.
    command: [[f64; 8]; 2],
    /// Whether the last substep saw more than one command.
    was_mixed: bool,
}

impl<S: Simd> Arrivals<S> {
    fn new<'a, 'b: 'a>(
        simd: S,
        moments: Vec<Vec<Moment>>,
        before: Pair<S>,
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Self {
        Self {
            agenda: Agenda::new(simd, moments),
            commands: (0..S::F64_LANES)
                .map(|lane| job(lane).commands.to_vec())
                .collect(),
            command: before.map(Lanes::to_array),
            was_mixed: false,
        }
    }

    /// The command on average over a substep, where it is another than in the substep before.
    #[inline(always)]
    fn substep(&mut self, simd: S, row: usize, substep: u32) -> Option<Pair<S>> {
        if self.agenda.is_due(f64::from(substep) + 1.0) {
            return Some(simd.vectorize(|| lanes(simd, &self.arrive(row, substep))));
        }
        std::mem::take(&mut self.was_mixed).then(|| lanes(simd, &self.command))
    }

    /// Lets the commands of a substep come; returns the average over the substep.
    #[inline(always)]
    fn arrive(&mut self, row: usize, substep: u32) -> [[f64; 8]; 2] {
        let begin = f64::from(substep);
        let mut average = self.command;
        let (commands, command, was_mixed) =
            (&self.commands, &mut self.command, &mut self.was_mixed);
        *was_mixed = false;
        self.agenda.take(row, begin + 1.0, |lane, moment| {
            // The command that came replaces the last one for the rest of the substep.
            let rest = (begin + 1.0 - moment.at).min(1.0);
            *was_mixed |= rest < 1.0;
            for axis in 0..2 {
                let came = commands[lane][moment.what][axis];
                average[axis][lane] = if rest < 1.0 {
                    average[axis][lane] + rest * (came - command[axis][lane])
                } else {
                    came
                };
                command[axis][lane] = came;
            }
        });
        average
    }
}

/// Numbers about x and about y in each lane.
#[inline(always)]
fn lanes<S: Simd>(simd: S, values: &[[f64; 8]; 2]) -> Pair<S> {
    values
        .each_ref()
        .map(|values| Lanes::from_fn(simd, |lane| values[lane]))
}

/// Seconds by which each command of a lane's rollout comes late.
fn lateness<S: Simd>(simd: S, late: &[Any<S>], lane: usize, job: &Job<'_>) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(job.seed);
    let mut draw = || StandardNormal.sample(&mut random);
    (0..job.commands.len())
        .map(|_| {
            let draw = Lanes::splat(simd, draw());
            let late = late.iter().map(|effect| effect.late(draw).to_array()[lane]);
            late.sum::<f64>().max(0.0)
        })
        .collect()
}

/// When the commands of a lane's rollout come; one that a later command has overtaken does not.
///
/// They are issued by a clock of their own, which is that of the rows unless an effect acts on it.
fn arrivals(timeline: &Timeline, clock: &Clock, lane: usize, late: &[f64]) -> Vec<Moment> {
    let issued: Vec<f64> = (0..late.len())
        .scan(0.0, |time, row| {
            let (begin, step) = (*time, clock.step(row));
            *time += f64::from(step.substeps) * step.length_s;
            Some(begin)
        })
        .collect();
    let mut soonest = f64::INFINITY;
    let mut moments = Vec::new();
    for (what, &late) in late.iter().enumerate().rev() {
        let time = issued[what] + late;
        if time < soonest {
            soonest = time;
            let (row, at) = if time == timeline.begins(what, lane) {
                (what, 0.0)
            } else {
                timeline.locate(lane, time, 0)
            };
            moments.push(Moment { row, at, what });
        }
    }
    moments.reverse();
    moments
}
