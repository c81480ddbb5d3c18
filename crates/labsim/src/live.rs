//! A rollout with commands that arrive one by one, as a simulated rig needs it.

use std::sync::atomic::AtomicBool;

use pulp::Scalar;

use crate::board::Rig;
use crate::effects::{EffectInstance, Hook, in_order};
use crate::engine::rolling::{LaneGroup, Register};
use crate::engine::{Clock, Engine, Hold, Job, Setup, Sink, Step};
use crate::error::{Error, Result};
use crate::motion::Marbles;
use crate::parameters::Parameters;
use crate::per_rollout::PerRollout;
use crate::rollout::{Batch, TimeBase};

/// A rollout of the rolling engine whose commands arrive one by one.
///
/// It begins at rest with level knobs, and gives the same bits as a [`Batch`] of as many rows with the same
/// commands.
pub struct Live {
    register: Register<Scalar>,
    marbles: Marbles<Scalar>,
    parameters: Parameters,
    step: Step,
    seed: u64,
    row: usize,
    commands: Vec<[f64; 2]>,
    seen: Vec<[f64; 2]>,
}

impl Live {
    /// A marble at rest with the observed position `start` (board edges), for at most `rows` rows of `row_s` seconds.
    ///
    /// # Errors
    /// [`Error::Invalid`] for physically impossible values, and for an effect whose rows begin at other times
    /// than their commands: it would need the commands of future rows.
    pub fn new(
        rig: &Rig,
        parameters: Parameters,
        effects: &[EffectInstance<'_>],
        start: [f64; 2],
        (rows, row_s): (usize, f64),
        seed: u64,
    ) -> Result<Self> {
        if let Some(one) = effects.iter().find(|one| one.effect.acts == Hook::OnClock) {
            return Err(Error::invalid(
                "effects",
                "effects without a second clock",
                one.effect.name,
            ));
        }
        let commands = vec![[0.0; 2]; rows];
        Batch {
            effects,
            rows: rows.min(1),
            start: PerRollout::Shared(&[start]),
            time: TimeBase::Durations(PerRollout::Shared(&vec![row_s; rows])),
            ..Batch::new(rig, &[parameters], &commands)
        }
        .run(Engine::Rolling, Some(1), &AtomicBool::new(false))?;
        let effects = in_order(effects);
        let setup = Setup {
            rig,
            effects: &effects,
            rows,
            hold: Hold::Zero,
            cancel: &AtomicBool::new(false),
        };
        let step = Step::lasting(row_s);
        let job = job(parameters, &commands, start, step, seed);
        let group = LaneGroup {
            jobs: std::slice::from_ref(&job),
            filler: &job,
        };
        let register = Register::new(Scalar, &setup, group);
        let marbles = register.release(group);
        Ok(Self {
            marbles,
            register,
            parameters,
            step,
            seed,
            row: 0,
            seen: vec![start; rows],
            commands,
        })
    }

    /// Observed position (board edges) at the beginning of the present row.
    pub fn seen(&self) -> [f64; 2] {
        self.seen[self.row]
    }

    /// Number of remaining rows.
    pub fn left(&self) -> usize {
        self.commands.len() - 1 - self.row
    }

    /// Simulates the present row under a command (knob angles, rad); returns the observed position after it.
    ///
    /// # Panics
    /// If no row remains.
    pub fn play(&mut self, command: [f64; 2]) -> [f64; 2] {
        let row = self.row;
        assert!(
            self.left() > 0,
            "all {} rows are played",
            self.commands.len()
        );
        self.commands[row] = command;
        self.register.actuation.issue(row, command);
        let job = job(
            self.parameters,
            &self.commands,
            self.seen[0],
            self.step,
            self.seed,
        );
        let group = LaneGroup {
            jobs: std::slice::from_ref(&job),
            filler: &job,
        };
        self.register.begin_row(row, group);
        let mut out = [Sink {
            marble: &mut self.seen,
            tilt: &mut [],
            variance: &mut [],
            corrections: &mut [],
        }];
        for substep in 0..self.step.substeps {
            self.register
                .substep(row, substep, &mut self.marbles, &mut out);
        }
        self.row += 1;
        self.register
            .observe(self.row, &self.marbles, group, &mut out);
        self.seen[self.row]
    }
}

fn job(
    parameters: Parameters,
    commands: &[[f64; 2]],
    start: [f64; 2],
    step: Step,
    seed: u64,
) -> Job<'_> {
    Job {
        rollout: 0,
        parameters,
        commands,
        knobs_before: [0.0; 2],
        first: 0,
        start,
        start_velocity: [0.0; 2],
        rolled: 0.0,
        turned: [0.0; 3],
        clock: Clock::Even(step),
        seed,
        measured: None,
    }
}
