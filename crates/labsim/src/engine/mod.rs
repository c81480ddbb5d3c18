//! The two engines. Both return the observed position of the marble at each row.

mod actuation;
mod camera;
mod command_delay;
mod hole;
pub(crate) mod obstacles;
pub(crate) mod rapier;
pub(crate) mod rolling;
mod schedule;

pub(crate) use self::rolling::TAIL;

use std::cmp::Ordering;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{self, AtomicBool};

use pulp::Simd;

use self::obstacles::Obstacles;
use crate::board::{Rig, SUBSTEP_S};
use crate::correction::Correction;
use crate::effects::{Any, EffectInstance, Hook, acting};
use crate::error::Error;
use crate::lanes::Lanes;
use crate::maze::Fall;
use crate::motion::{Pair, Rims, Rolled};
use crate::noise::Noise;
use crate::parameters::Parameters;

/// The physics engine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Engine {
    /// Full 3-D rigid bodies: the reference.
    Rapier,
    /// A rolling sphere on a tilting plane, many rollouts to a SIMD register: the fast one.
    Rolling,
}

impl Engine {
    /// All engines with their public names.
    pub const ALL: [(&str, Self); 2] = [("rolling", Self::Rolling), ("rapier", Self::Rapier)];
}

impl FromStr for Engine {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        let found = Self::ALL.iter().find(|(known, _)| *known == name);
        found
            .map(|&(_, engine)| engine)
            .ok_or_else(|| Error::Unknown {
                kind: "engine",
                name: name.to_owned(),
                possible: Self::ALL.map(|(known, _)| known).join(", "),
            })
    }
}

/// The physics updates of one timestep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Number of updates.
    pub substeps: u32,
    /// Length of each update (s).
    pub length_s: f64,
}

impl Step {
    /// A timestep as the paper simulates it: round(`time_scale`) updates of 1/240 s.
    pub fn rounded(time_scale: f64) -> Self {
        Self {
            substeps: time_scale.round() as u32,
            length_s: SUBSTEP_S,
        }
    }

    /// A timestep of exactly `time_scale`/240 s, so that a fit sees a smooth parameter.
    ///
    /// Finite differences need the same `substeps` on both sides; without it the count is that of
    /// [`Step::rounded`], at least one.
    pub fn continuous(time_scale: f64, substeps: Option<u32>) -> Self {
        let substeps = substeps.unwrap_or_else(|| (time_scale.round() as u32).max(1));
        Self {
            substeps,
            length_s: time_scale * SUBSTEP_S / f64::from(substeps),
        }
    }

    /// A timestep of a known duration, in updates as near to 1/240 s as whole numbers allow.
    pub fn lasting(seconds: f64) -> Self {
        Self::continuous(seconds / SUBSTEP_S, None)
    }
}

/// The timesteps of one rollout.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Clock {
    /// All timesteps are equal.
    Even(Step),
    /// Each timestep has its own length.
    Stamped(Vec<Step>),
}

impl Clock {
    pub(crate) fn step(&self, row: usize) -> Step {
        match self {
            Self::Even(step) => *step,
            Self::Stamped(steps) => steps[row],
        }
    }

    /// Number of updates until the last of `rows` rows is observed.
    pub(crate) fn total_substeps(&self, rows: usize) -> u64 {
        match self {
            Self::Even(step) => u64::from(step.substeps) * (rows as u64 - 1),
            Self::Stamped(steps) => steps[..rows - 1]
                .iter()
                .map(|step| u64::from(step.substeps))
                .sum(),
        }
    }

    /// Orders by duration of the work; equal only where every row has the same number of updates.
    pub(crate) fn compare(&self, other: &Self, rows: usize) -> Ordering {
        let totals = self.total_substeps(rows).cmp(&other.total_substeps(rows));
        totals.then_with(|| match (self, other) {
            (Self::Stamped(a), Self::Stamped(b)) => {
                let substeps = |step: &Step| step.substeps;
                a[..rows - 1]
                    .iter()
                    .map(substeps)
                    .cmp(b[..rows - 1].iter().map(substeps))
            }
            _ => Ordering::Equal,
        })
    }
}

/// How a command continues until the next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Hold {
    /// It holds.
    #[default]
    Zero,
    /// Linear ramp to the next command; the last one holds. Used for a measured tilt.
    First,
}

impl Hold {
    /// All kinds with their public names.
    pub const ALL: [(&str, Self); 2] = [("zero", Self::Zero), ("first", Self::First)];
}

impl FromStr for Hold {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        let found = Self::ALL.iter().find(|(known, _)| *known == name);
        found.map(|&(_, hold)| hold).ok_or_else(|| Error::Unknown {
            kind: "hold",
            name: name.to_owned(),
            possible: Self::ALL.map(|(known, _)| known).join(", "),
        })
    }
}

/// Output of a rollout, one pair per row.
pub(crate) struct Sink<'a> {
    /// Observed positions (board edges).
    pub(crate) marble: &'a mut [[f64; 2]],
    /// The board's angles from the tilt sensor (rad); none if not requested.
    pub(crate) tilt: &'a mut [[f64; 2]],
    /// Variances of predictions (board edges squared); none in a free run.
    pub(crate) variance: &'a mut [[f64; 2]],
    /// The filter's state at each row, along both axes; none if not requested.
    pub(crate) corrections: &'a mut [[Correction; 2]],
    /// Where the marble fell, if it did; of one entry, or none where nobody asks.
    pub(crate) fall: &'a mut [Option<Fall>],
}

/// Data shared by all rollouts of a batch.
#[derive(Clone, Copy)]
pub(crate) struct Setup<'a> {
    pub(crate) rig: &'a Rig,
    /// In the order in which they act.
    pub(crate) effects: &'a [EffectInstance<'a>],
    /// Number of observed rows.
    pub(crate) rows: usize,
    pub(crate) hold: Hold,
    /// Inner walls and holes, unless there are none.
    pub(crate) obstacles: Option<&'a Arc<Obstacles>>,
    pub(crate) cancel: &'a AtomicBool,
}

impl Setup<'_> {
    /// Whether an effect acts in one of these places.
    fn any(&self, places: impl Fn(Hook) -> bool) -> bool {
        self.effects.iter().any(|one| places(one.effect.acts))
    }

    /// Whether only the marbles change within a row.
    pub(crate) fn is_plain(&self) -> bool {
        if self.hold == Hold::First || self.obstacles.is_some() {
            return false;
        }
        !self.any(|acts| match acts {
            Hook::OnTilt | Hook::OnRims | Hook::OnSpin | Hook::OnPicture | Hook::OnGauge => false,
            Hook::OnKnob { moves } => moves,
            Hook::OnArrival
            | Hook::OnClock
            | Hook::OnMarble(_)
            | Hook::OnMarbleAndPicture
            | Hook::OnExposure => true,
        })
    }

    /// The effects of some hooks, for a register; `job` maps a lane to its rollout.
    fn acting<'j, 'b: 'j, S: Simd>(
        &self,
        simd: S,
        places: impl Fn(Hook) -> bool,
        job: impl Fn(usize) -> &'j Job<'b>,
    ) -> Vec<Any<S>> {
        acting(simd, self.rig, self.effects, places, |lane| {
            job(lane).rollout
        })
    }

    /// The rims as the marbles of a register meet them.
    fn rims<'j, 'b: 'j, S: Simd>(&self, simd: S, job: impl Fn(usize) -> &'j Job<'b>) -> Rims<S> {
        let mut rims = Rims::new(simd, self.rig);
        for effect in self.acting(simd, |acts| acts == Hook::OnRims, job) {
            effect.rims(&mut rims);
        }
        rims
    }

    /// The board's torque against spins about the vertical, over weight and radius.
    fn spinning_friction<'j, 'b: 'j, S: Simd>(
        &self,
        simd: S,
        job: impl Fn(usize) -> &'j Job<'b>,
    ) -> Lanes<S> {
        let mut friction = Lanes::splat(simd, self.rig.board.spinning_friction);
        for effect in self.acting(simd, |acts| acts == Hook::OnSpin, job) {
            effect.spin(&mut friction);
        }
        friction
    }

    /// The effects on marbles, which are released on boards at these angles.
    fn forces<'j, 'b: 'j, S: Simd>(
        &self,
        simd: S,
        tilt: &Pair<S>,
        job: impl Fn(usize) -> &'j Job<'b>,
    ) -> Vec<Any<S>> {
        let before = Rolled {
            way: Lanes::from_fn(simd, |lane| job(lane).rolled),
            turned: [0, 1, 2].map(|axis| Lanes::from_fn(simd, |lane| job(lane).turned[axis])),
        };
        let mut forces = self.acting(simd, Hook::is_on_marble, job);
        for effect in &mut forces {
            effect.pass(tilt, Lanes::splat(simd, 0.0));
            effect.let_go(&before);
        }
        forces
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.load(atomic::Ordering::Relaxed)
    }
}

/// One marble to simulate.
#[derive(Debug, Clone)]
pub(crate) struct Job<'a> {
    /// Its number in the batch.
    pub(crate) rollout: usize,
    pub(crate) parameters: Parameters,
    /// Knob angles (rad), one pair a row; command i holds from row i to row i + 1.
    pub(crate) commands: &'a [[f64; 2]],
    /// Knob angles before row 0 (rad).
    pub(crate) knobs_before: [f64; 2],
    /// The row in which the marble is released and first observed.
    pub(crate) first: usize,
    /// Observed position at that row (board edges).
    pub(crate) start: [f64; 2],
    /// Observed velocity at that row (board edges per second); the marble rolls without slip.
    pub(crate) start_velocity: [f64; 2],
    /// Path length before the release (m).
    pub(crate) rolled: f64,
    /// Rotation of the marble along this path: axis times angle (rad).
    pub(crate) turned: [f64; 3],
    pub(crate) clock: Clock,
    /// Seed of the effects' random numbers.
    pub(crate) seed: u64,
    /// Observations that correct the marble in every row; none in a free run.
    pub(crate) measured: Option<Measured<'a>>,
}

/// Observations of a marble, from the row of its release on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured<'a> {
    /// Positions (board edges); NaN where the tracker lost the marble.
    pub(crate) observed: &'a [[f64; 2]],
    pub(crate) noise: Noise,
}

impl Job<'_> {
    /// The command of a row (rad); the last one holds.
    pub(crate) fn command(&self, row: usize) -> [f64; 2] {
        self.commands[row.min(self.commands.len() - 1)]
    }
}
