//! From commands to the accelerations of the marbles of a register: knobs, board, gravity.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use std::f64::consts::FRAC_PI_2;

use pulp::{NullaryFnOnce, Simd};

use super::command_delay::CommandDelay;
use super::schedule::Timeline;
use super::{Hold, Job, Setup};
use crate::board::GRAVITY;
use crate::effects::{Any, Hook};
use crate::lanes::Lanes;
use crate::motion::{PEEK_S, Pair, Push};

/// The knobs, the board and its tilt, for the rollouts of a register.
pub(crate) struct Actuation<S: Simd> {
    gear: Pair<S>,
    rolling_friction: Lanes<S>,
    sliding_friction: f64,
    spinning_friction: Lanes<S>,
    damping_per_s: f64,
    clock: Vec<Any<S>>,
    knobs: Vec<Any<S>>,
    /// Room for a copy of those.
    peeked: Vec<Any<S>>,
    tilts: Vec<Any<S>>,
    gauges: Vec<Any<S>>,
    /// Delayed commands, and the times of rows.
    command_delay: Option<(CommandDelay<S>, Timeline)>,
    /// Whether knobs move within rows.
    moves: bool,
    /// Ramps from the commands of this row to the next ones.
    ramp: Option<Ramp<S>>,
    /// The commands as they have arrived (rad), on average over the last substep.
    command: Pair<S>,
    /// Where the knobs were in the last substep (rad).
    turned: Pair<S>,
    length: Lanes<S>,
    /// Damping factor of velocities in a substep of this row.
    damping: Lanes<S>,
    /// The board's angles (rad).
    pub(super) tilt: Pair<S>,
    /// Gravity, friction and damping of a substep.
    pub(super) push: Push<S>,
}

/// Linear ramps from one row's command to the next one's.
struct Ramp<S: Simd> {
    /// At the row's beginning and end (rad).
    ends: [Pair<S>; 2],
    /// One over the substeps of the row.
    share: f64,
}

impl<S: Simd> Actuation<S> {
    /// Knobs in the steady state of the angles before row 0; `job` maps a lane to its rollout.
    pub(super) fn new<'a, 'b: 'a>(
        simd: S,
        setup: &Setup<'_>,
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Self {
        let lanes = |value: &dyn Fn(&Job<'_>) -> f64| Lanes::from_fn(simd, |lane| value(job(lane)));
        let effects = |places: fn(Hook) -> bool| setup.acting(simd, places, &job);
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
            sliding_friction: setup.rig.board.sliding_friction,
            spinning_friction: setup.spinning_friction(simd, &job),
            damping_per_s: setup.rig.marble.damping_per_s,
            clock: effects(|acts| acts == Hook::OnClock),
            knobs: effects(|acts| matches!(acts, Hook::OnKnob { .. })),
            peeked: Vec::new(),
            tilts: effects(|acts| acts == Hook::OnTilt),
            gauges: effects(|acts| acts == Hook::OnGauge),
            command_delay: None,
            moves: setup.any(|acts| acts == Hook::OnKnob { moves: true })
                || setup.hold == Hold::First,
            ramp: None,
            command: before,
            turned: before,
            length: zero,
            damping: zero,
            tilt: [zero; 2],
            push: still(zero),
        };
        let late = effects(|acts| acts == Hook::OnArrival);
        // Where rows have a clock of their own, commands keep to theirs.
        if !late.is_empty() || !actuation.clock.is_empty() {
            let rows = actuation.timeline(setup, &job);
            let issued = timeline(setup, &job, |row| clock_length(simd, row, &job));
            let times = [&issued, &rows];
            let command_delay = CommandDelay::new(simd, setup.hold, &late, times, before, &job);
            actuation.command_delay = Some((command_delay, rows));
        } else if setup.hold == Hold::First {
            let ends = [before; 2];
            actuation.ramp = Some(Ramp { ends, share: 1.0 });
        }
        let knob = actuation.answer(before);
        actuation.tilt(knob);
        actuation
    }

    /// Sets the command of a row (rad) in the first lane, if it was not known from the start.
    pub(crate) fn issue(&mut self, row: usize, command: [f64; 2]) {
        if let Some((command_delay, _)) = &mut self.command_delay {
            command_delay.issue(row, command);
        }
    }

    /// Whether the board moves within a row.
    pub(super) fn moves(&self) -> bool {
        self.moves || self.command_delay.is_some()
    }

    /// Duration of a row's substeps (s).
    #[inline(always)]
    pub(super) fn length<'a, 'b: 'a>(
        &self,
        row: usize,
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Lanes<S> {
        let simd = self.length.simd();
        let mut length = clock_length(simd, row, &job);
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
    pub(super) fn timeline<'a, 'b: 'a>(
        &self,
        setup: &Setup<'_>,
        job: impl Fn(usize) -> &'a Job<'b>,
    ) -> Timeline {
        timeline(setup, &job, |row| self.length(row, &job))
    }

    /// Issues the command of a row.
    #[inline(always)]
    pub(super) fn begin_row<'a, 'b: 'a>(&mut self, row: usize, job: impl Fn(usize) -> &'a Job<'b>) {
        let simd = self.length.simd();
        self.length = match &self.command_delay {
            Some((_, timeline)) => Lanes::load(simd, timeline.lengths(row)),
            None => self.length(row, &job),
        };
        let one = self.length.like(1.0);
        self.damping = one.over(one + self.damping_per_s * self.length);
        if self.command_delay.is_none() {
            let command = |axis: usize| Lanes::from_fn(simd, |lane| job(lane).commands[row][axis]);
            self.command = [command(0), command(1)];
            if let Some(ramp) = &mut self.ramp {
                let next = |axis| Lanes::from_fn(simd, |lane| job(lane).command(row + 1)[axis]);
                ramp.ends = [self.command, [next(0), next(1)]];
                ramp.share = 1.0 / f64::from(job(0).clock.step(row).substeps);
            }
        }
        if !self.moves() {
            let knob = self.answer(self.command);
            self.tilt(knob);
        }
    }

    /// Updates the board's angles for this substep, if they change within rows.
    #[inline(always)]
    pub(super) fn substep(&mut self, row: usize, substep: u32) {
        let arrived = match &mut self.command_delay {
            Some((command_delay, _)) => command_delay.substep(row, substep),
            None => None,
        };
        if let Some(command) = arrived {
            self.command = command;
        }
        if let Some(Ramp { ends, share }) = &self.ramp {
            let part = (f64::from(substep) + 0.5) * share;
            let command = |axis: usize| ends[0][axis] + part * (ends[1][axis] - ends[0][axis]);
            self.command = [command(0), command(1)];
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

    /// Mean angles of the knobs under a command over a substep.
    #[inline(always)]
    fn answer(&mut self, mut knob: Pair<S>) -> Pair<S> {
        if !self.knobs.is_empty() {
            self.length.simd().vectorize(Turning {
                effects: &mut self.knobs,
                knob: &mut knob,
                length: self.length,
            });
        }
        self.turned = knob;
        knob
    }

    /// The board's angles (rad) as the tilt sensor reports them before the next substep begins.
    #[inline(always)]
    pub(crate) fn gauged(&mut self) -> Pair<S> {
        let mut tilt = self.tilt;
        if self.moves() {
            let mut knob = match (&self.command_delay, &self.ramp) {
                (Some((command_delay, _)), _) => command_delay.last(),
                (None, Some(ramp)) => ramp.ends[1],
                (None, None) => self.command,
            };
            let length = self.length.like(PEEK_S);
            // On copies, because an effect remembers every angle that it is called with.
            self.peeked.clone_from(&self.knobs);
            length.simd().vectorize(Turning {
                effects: &mut self.peeked,
                knob: &mut knob,
                length,
            });
            tilt = self.tilted(knob);
        }
        for effect in &self.gauges {
            effect.gauge(&mut tilt);
        }
        tilt
    }

    /// Tilts the board by its knobs.
    #[inline(always)]
    fn tilt(&mut self, knob: Pair<S>) {
        self.tilt = self.tilted(knob);
        self.push = self.gravity(self.tilt);
    }

    /// The board's angles (rad) under knobs.
    #[inline(always)]
    fn tilted(&self, knob: Pair<S>) -> Pair<S> {
        let mut tilt = [self.gear[0] * knob[0], self.gear[1] * knob[1]];
        for effect in &self.tilts {
            effect.tilt(&mut tilt, &knob);
        }
        // Tilts beyond a right angle are clamped.
        let most = tilt[0].like(FRAC_PI_2);
        [tilt[0].clamp(most), tilt[1].clamp(most)]
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
            grip: self.sliding_friction * (normal * length),
            spinning: 2.5 * (self.spinning_friction * normal * length),
            damping: self.damping,
            length,
        }
    }
}

/// The effects on knobs, in a separate function: inlined, all effects would slow down the loop over substeps.
struct Turning<'a, S: Simd> {
    effects: &'a mut [Any<S>],
    knob: &'a mut Pair<S>,
    length: Lanes<S>,
}

impl<S: Simd> NullaryFnOnce for Turning<'_, S> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for effect in self.effects {
            effect.turn(self.knob, self.length);
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
        spinning: zero,
        damping: zero,
        length: zero,
    }
}

/// Duration of a row's substeps (s) by the clock of the commands.
#[inline(always)]
fn clock_length<'a, 'b: 'a, S: Simd>(
    simd: S,
    row: usize,
    job: impl Fn(usize) -> &'a Job<'b>,
) -> Lanes<S> {
    Lanes::from_fn(simd, |lane| job(lane).clock.step(row).length_s)
}

/// When the rows of the register's rollouts begin whose substeps last so long.
fn timeline<'a, 'b: 'a, S: Simd>(
    setup: &Setup<'_>,
    job: impl Fn(usize) -> &'a Job<'b>,
    length: impl Fn(usize) -> Lanes<S>,
) -> Timeline {
    let first = job(0);
    // What is issued later comes after the last observation.
    Timeline::new((0..first.first + setup.rows).map(|row| {
        let substeps = first.clock.step(row).substeps;
        (substeps, length(row).to_array())
    }))
}
