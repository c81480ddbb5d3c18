//! A batch of rollouts over the threads.

mod check;
mod lane_packing;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::board::Rig;
use crate::correction::Correction;
use crate::effects::{EffectInstance, in_order};
use crate::engine::obstacles::Obstacles;
use crate::engine::{Clock, Engine, Hold, Job, Measured, Setup, Sink, Step, rapier, rolling};
use crate::error::{Error, Result};
use crate::maze::{Fall, Maze};
use crate::noise::Noise;
use crate::parameters::Parameters;
use crate::per_rollout::PerRollout;
use crate::threads::Threads;

/// How long a command holds.
#[derive(Debug, Clone, Copy)]
pub enum TimeBase<'a> {
    /// round(`time_scale`) physics updates of 1/240 s, as in the paper.
    Rounded,
    /// `time_scale`/240 s exactly; the number of updates may be fixed for each rollout, as finite
    /// differences need it.
    Continuous(Option<&'a [u32]>),
    /// Seconds for each row, from a recording's stamps; `time_scale` is not used.
    Durations(PerRollout<'a, f64>),
}

/// Observations of rollouts: `rows` pairs each, concatenated.
#[derive(Debug, Clone, PartialEq)]
pub struct Observed {
    /// Positions (board edges).
    pub marble: Vec<[f64; 2]>,
    /// The board's angles (rad) about x and y from the tilt sensor at each row, just before the row's command
    /// takes effect.
    pub tilt: Vec<[f64; 2]>,
}

/// What is observed of marbles that may fall through holes.
#[derive(Debug, Clone, PartialEq)]
pub struct Falls {
    /// Positions (board edges), not a number from the row on at which a marble was gone.
    pub marble: Vec<[f64; 2]>,
    /// The board's angles (rad), as in [`Observed::tilt`].
    pub tilt: Vec<[f64; 2]>,
    /// Where each marble fell, one entry a rollout.
    pub falls: Vec<Option<Fall>>,
}

/// Rollouts that share a rig and a set of effects.
#[derive(Debug, Clone, Copy)]
pub struct Batch<'a> {
    /// Board and marble.
    pub rig: &'a Rig,
    /// Inner walls and holes; none on a bare board.
    pub maze: Option<&'a Maze>,
    /// One set of parameters per rollout.
    pub parameters: &'a [Parameters],
    /// The effects, in any order.
    pub effects: &'a [EffectInstance<'a>],
    /// Rows observed of each rollout, the start included.
    pub rows: usize,
    /// Commands, one pair per row; command i holds from row i to row i + 1. Knob angles (rad), or any other
    /// unit with gears in rad per unit. All sequences have the same length, unless they are references.
    pub commands: PerRollout<'a, [f64; 2]>,
    /// How a command continues until the next one.
    pub hold: Hold,
    /// Commands before row 0, one pair.
    pub knobs_before: PerRollout<'a, [f64; 2]>,
    /// The row of the commands in which the marble is released and first observed, one number. Before it only
    /// the knobs move.
    pub first: PerRollout<'a, usize>,
    /// Observed position at that row (board edges), one pair.
    pub start: PerRollout<'a, [f64; 2]>,
    /// Observed velocity at that row (board edges per second), one pair.
    pub start_velocity: PerRollout<'a, [f64; 2]>,
    /// Path length before the release (m), one number.
    pub rolled: PerRollout<'a, f64>,
    /// Rotation of the marble along this path, axis times angle (rad): see [`crate::turned`].
    pub turned: PerRollout<'a, [f64; 3]>,
    /// How long a command holds.
    pub time: TimeBase<'a>,
    /// Seed of the effects' random numbers, one number.
    pub seeds: PerRollout<'a, u64>,
}

impl<'a> Batch<'a> {
    /// Rollouts without effects under the same commands, one for each of `parameters`. The marble starts at row 0
    /// at rest in the board's centre, with level knobs.
    pub fn new(rig: &'a Rig, parameters: &'a [Parameters], commands: &'a [[f64; 2]]) -> Self {
        Self {
            rig,
            maze: None,
            parameters,
            effects: &[],
            rows: commands.len(),
            commands: PerRollout::Shared(commands),
            hold: Hold::Zero,
            knobs_before: PerRollout::Shared(&[[0.0; 2]]),
            first: PerRollout::Shared(&[0]),
            start: PerRollout::Shared(&[[0.0; 2]]),
            start_velocity: PerRollout::Shared(&[[0.0; 2]]),
            rolled: PerRollout::Shared(&[0.0]),
            turned: PerRollout::Shared(&[[0.0; 3]]),
            time: TimeBase::Rounded,
            seeds: PerRollout::Shared(&[0]),
        }
    }

    /// Simulates every rollout; returns the observations (board edges), `rows` pairs a rollout.
    ///
    /// A rollout's result does not depend on the rest of the batch nor on the number of `threads` (`None`: one for
    /// each core), to the bit. Setting `cancel` ends the work soon.
    ///
    /// # Errors
    /// [`Error::Invalid`] for physically impossible values, [`Error::Cancelled`] once `cancel` is set.
    pub fn run(
        &self,
        engine: Engine,
        threads: Option<usize>,
        cancel: &AtomicBool,
    ) -> Result<Vec<[f64; 2]>> {
        Ok(self
            .simulate(engine, threads, cancel, Asked::Marble)?
            .marble)
    }

    /// Simulates every rollout as [`Batch::run`] does, to the same bits, and returns the board's tilt beside
    /// the observations.
    ///
    /// # Errors
    /// As [`Batch::run`].
    pub fn run_with_tilt(
        &self,
        engine: Engine,
        threads: Option<usize>,
        cancel: &AtomicBool,
    ) -> Result<Observed> {
        let all = self.simulate(engine, threads, cancel, Asked::Tilt)?;
        Ok(Observed {
            marble: all.marble,
            tilt: all.tilt,
        })
    }

    /// Simulates every rollout as [`Batch::run_with_tilt`] does, and says which marbles fell where.
    ///
    /// # Errors
    /// As [`Batch::run`].
    pub fn run_with_falls(
        &self,
        engine: Engine,
        threads: Option<usize>,
        cancel: &AtomicBool,
    ) -> Result<Falls> {
        let all = self.simulate(engine, threads, cancel, Asked::Falls)?;
        Ok(Falls {
            marble: all.marble,
            tilt: all.tilt,
            falls: all.falls,
        })
    }

    /// Simulates every rollout in the rolling engine with a correction by each row's observation; returns the
    /// predictions, their variances and what else is wanted.
    pub(crate) fn filtered(
        &self,
        (observed, noise): (PerRollout<'_, [f64; 2]>, PerRollout<'_, Noise>),
        wanted: Wanted,
        threads: Option<usize>,
        cancel: &AtomicBool,
    ) -> Result<Simulated> {
        let asked = Asked::Filtered(observed, noise, wanted);
        if self.maze.is_some() {
            let expected = "a bare board, where predictions are corrected";
            return Err(Error::invalid("maze", expected, "walls or holes"));
        }
        self.simulate(Engine::Rolling, threads, cancel, asked)
    }

    fn simulate(
        &self,
        engine: Engine,
        threads: Option<usize>,
        cancel: &AtomicBool,
        asked: Asked<'_>,
    ) -> Result<Simulated> {
        self.check()?;
        let count = self.parameters.len() * self.rows;
        let rows_if = |asked: bool| vec![[0.0; 2]; if asked { count } else { 0 }];
        let mut observed = Simulated {
            marble: rows_if(true),
            tilt: rows_if(match asked {
                Asked::Filtered(_, _, wanted) => wanted.tilt,
                Asked::Tilt | Asked::Falls => true,
                Asked::Marble => false,
            }),
            variance: rows_if(matches!(asked, Asked::Filtered(..))),
            corrections: match asked {
                Asked::Filtered(_, _, wanted) if wanted.corrections => {
                    vec![[Correction::default(); 2]; count]
                }
                _ => Vec::new(),
            },
            falls: match asked {
                Asked::Falls => vec![None; self.parameters.len()],
                _ => Vec::new(),
            },
        };
        if count == 0 {
            return Ok(observed);
        }
        let threads = Threads::new(threads)?;
        let effects = in_order(self.effects);
        let obstacles = self.maze.and_then(|maze| Obstacles::new(maze, self.rig));
        let obstacles = obstacles.map(Arc::new);
        let setup = Setup {
            rig: self.rig,
            effects: &effects,
            rows: self.rows,
            hold: self.hold,
            obstacles: obstacles.as_ref(),
            cancel,
        };
        let run = |(jobs, mut out): Group<'_>| {
            if !cancel.load(Ordering::Relaxed) {
                match engine {
                    Engine::Rapier => rapier::run(&setup, &jobs, &mut out),
                    Engine::Rolling => rolling::run(&setup, &jobs, &mut out),
                }
            }
        };
        let all = Sink {
            marble: &mut observed.marble,
            tilt: &mut observed.tilt,
            variance: &mut observed.variance,
            corrections: &mut observed.corrections,
            fall: &mut observed.falls,
        };
        for (number, sink) in parts(all, BLOCK, self.rows).enumerate() {
            let first = number * BLOCK;
            let groups = self.groups(&setup, engine, threads.count, (first, sink), asked);
            threads.each(groups, run);
        }
        if cancel.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        Ok(observed)
    }

    /// Number of commands of a rollout, unless they are references.
    pub(crate) fn issued(&self) -> usize {
        self.commands.length(self.parameters.len())
    }

    fn clock(&self, rollout: usize) -> Clock {
        let time_scale = self.parameters[rollout].time_scale;
        match self.time {
            TimeBase::Rounded => Clock::Even(Step::rounded(time_scale)),
            TimeBase::Continuous(substeps) => Clock::Even(Step::continuous(
                time_scale,
                substeps.map(|each| each[rollout]),
            )),
            TimeBase::Durations(durations) => Clock::Stamped(
                durations
                    .of(rollout, self.issued())
                    .iter()
                    .map(|&s| Step::lasting(s))
                    .collect(),
            ),
        }
    }

    /// Rollouts that an engine simulates together, with the places for their results.
    fn groups<'b>(
        &'b self,
        setup: &Setup<'_>,
        engine: Engine,
        workers: usize,
        (begin, observed): (usize, Sink<'b>),
        asked: Asked<'b>,
    ) -> Vec<Group<'b>> {
        let mut places: Vec<_> = parts(observed, 1, self.rows)
            .enumerate()
            .map(|(i, sink)| Some((self.job(begin + i, asked), sink)))
            .collect();
        let jobs: Vec<&Job<'_>> = places.iter().flatten().map(|(job, _)| job).collect();
        let order = lane_packing::order(&jobs, &self.rig.board, self.rows);
        // A small batch has smaller groups, two for each thread: one of long and one of short rollouts.
        let share = places.len().div_ceil(2 * workers.max(1));
        let most = match engine {
            Engine::Rapier => share.min(rapier::GROUP),
            Engine::Rolling => share
                .next_multiple_of(lane_packing::REGISTER)
                .min(rolling::GROUP),
        };
        let together = |a: &usize, b: &usize| match engine {
            Engine::Rapier => true,
            Engine::Rolling => {
                lane_packing::may_share(jobs[*a], jobs[*b], self.rows, setup.is_plain())
            }
        };
        let groups: Vec<&[usize]> = order
            .chunk_by(together)
            .flat_map(|alike| alike.chunks(most))
            .collect();
        groups
            .iter()
            .map(|group| group.iter().filter_map(|&i| places[i].take()).unzip())
            .collect()
    }

    fn job<'b>(&'b self, rollout: usize, asked: Asked<'b>) -> Job<'b> {
        let measured = match asked {
            Asked::Filtered(observed, noise, _) => Some(Measured {
                observed: observed.of(rollout, self.rows),
                noise: noise.of(rollout, 1)[0],
            }),
            _ => None,
        };
        Job {
            measured,
            rollout,
            parameters: self.parameters[rollout],
            commands: self.commands.of(rollout, self.issued()),
            knobs_before: self.knobs_before.of(rollout, 1)[0],
            first: self.first.of(rollout, 1)[0],
            start: self.start.of(rollout, 1)[0],
            start_velocity: self.start_velocity.of(rollout, 1)[0],
            rolled: self.rolled.of(rollout, 1)[0],
            turned: self.turned.of(rollout, 1)[0],
            clock: self.clock(rollout),
            seed: self.seeds.of(rollout, 1)[0],
        }
    }
}

/// Requested output besides the positions.
#[derive(Clone, Copy)]
enum Asked<'a> {
    Marble,
    Tilt,
    /// The tilt, and where marbles fell.
    Falls,
    /// Predictions that are corrected by these observations, with this noise, and their variances.
    Filtered(PerRollout<'a, [f64; 2]>, PerRollout<'a, Noise>, Wanted),
}

/// Wanted output of a filter besides predictions and variances.
#[derive(Clone, Copy)]
pub(crate) struct Wanted {
    pub(crate) tilt: bool,
    /// The filter's state at each row.
    pub(crate) corrections: bool,
}

/// The requested output; the rest is empty.
#[derive(Default)]
pub(crate) struct Simulated {
    pub(crate) marble: Vec<[f64; 2]>,
    pub(crate) tilt: Vec<[f64; 2]>,
    pub(crate) variance: Vec<[f64; 2]>,
    pub(crate) corrections: Vec<[Correction; 2]>,
    falls: Vec<Option<Fall>>,
}

/// Number of rollouts in progress at once, so that memory does not grow with the batch.
const BLOCK: usize = 1 << 16;

type Group<'a> = (Vec<Job<'a>>, Vec<Sink<'a>>);

/// The places for results of so many rollouts at a time.
fn parts(all: Sink<'_>, rollouts: usize, rows: usize) -> impl Iterator<Item = Sink<'_>> {
    let Sink {
        marble,
        tilt,
        variance,
        corrections,
        fall,
    } = all;
    let length = rollouts * rows;
    let mut tilts = tilt.chunks_mut(length);
    let mut variances = variance.chunks_mut(length);
    let mut corrections = corrections.chunks_mut(length);
    let mut falls = fall.chunks_mut(rollouts);
    marble.chunks_mut(length).map(move |marble| Sink {
        marble,
        tilt: tilts.next().unwrap_or_default(),
        variance: variances.next().unwrap_or_default(),
        corrections: corrections.next().unwrap_or_default(),
        fall: falls.next().unwrap_or_default(),
    })
}
