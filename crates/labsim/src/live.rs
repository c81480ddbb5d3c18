//! A rollout with commands that arrive one by one, as a simulated rig needs it.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use pulp::Scalar;

use crate::board::Rig;
use crate::effects::{EffectInstance, Hook, in_order};
use crate::engine::obstacles::Obstacles;
use crate::engine::rolling::{LaneGroup, Register};
use crate::engine::{Clock, Engine, Hold, Job, Setup, Sink, Step};
use crate::error::{Error, Result};
use crate::lanes::Lanes;
use crate::maze::{Fall, Maze};
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
        maze: Option<&Maze>,
        parameters: Parameters,
        effects: &[EffectInstance<'_>],
        start: [f64; 2],
        (rows, row_s): (usize, f64),
        seed: u64,
    ) -> Result<Self> {
        check(rig, maze, parameters, effects, start, row_s)?;
        let obstacles = maze
            .and_then(|maze| Obstacles::new(maze, rig))
            .map(Arc::new);
        let effects = in_order(effects);
        let setup = setup(rig, &effects, rows, obstacles.as_ref());
        Ok(Self::begin(
            &setup,
            parameters,
            Start::Seen(start),
            row_s,
            seed,
        ))
    }

    /// As [`Live::new`], of what was found possible before; effects are in the order in which they act.
    pub(crate) fn begin(
        setup: &Setup<'_>,
        parameters: Parameters,
        start: Start,
        row_s: f64,
        seed: u64,
    ) -> Self {
        let step = Step::lasting(row_s);
        let commands = vec![[0.0; 2]; setup.rows];
        let begun = |seen: [f64; 2]| {
            let job = job(parameters, &commands, seen, step, seed);
            let group = LaneGroup {
                jobs: std::slice::from_ref(&job),
                filler: &job,
            };
            let register = Register::new(Scalar, setup, group);
            let marbles = register.release(group);
            (register, marbles)
        };
        let (seen, (register, marbles)) = match start {
            Start::Seen(seen) => (seen, begun(seen)),
            Start::Place(place) => {
                let (register, marbles) = begun([0.0; 2]);
                let [x, y] = place.map(|one| Lanes::splat(Scalar::new(), one));
                let seen = register.seen([x, y]).map(|one| one.to_array()[0]);
                (seen, (register, Marbles { x, y, ..marbles }))
            }
        };
        Self {
            register,
            marbles,
            parameters,
            step,
            seed,
            row: 0,
            seen: vec![seen; setup.rows],
            commands,
        }
    }

    /// Observed position (board edges) at the beginning of the present row.
    pub fn seen(&self) -> [f64; 2] {
        self.seen[self.row]
    }

    /// Where the marble has fallen through the board; it is not a number where it is seen from then on.
    pub fn fall(&self) -> Option<Fall> {
        self.register.fall(0, 0)
    }

    /// Where the marble is (m from the board's centre), however it is seen.
    pub fn place(&self) -> [f64; 2] {
        [self.marbles.x, self.marbles.y].map(|one| one.to_array()[0])
    }

    /// The board's angles about x and about y (rad) as the tilt sensor reports them.
    pub fn tilt(&mut self) -> [f64; 2] {
        self.register
            .actuation
            .gauged()
            .map(|one| one.to_array()[0])
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
            fall: &mut [],
        }];
        let substeps = self.step.substeps;
        self.register
            .play(row, substeps, &mut self.marbles, &mut out);
        self.row += 1;
        self.register
            .observe(self.row, &self.marbles, group, &mut out);
        self.seen[self.row]
    }
}

/// Where a marble begins.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Start {
    /// Where it is seen (board edges).
    Seen([f64; 2]),
    /// Where it is (m from the board's centre).
    Place([f64; 2]),
}

/// What marbles in rows of commands to come share.
pub(crate) fn setup<'a>(
    rig: &'a Rig,
    effects: &'a [EffectInstance<'a>],
    rows: usize,
    obstacles: Option<&'a Arc<Obstacles>>,
) -> Setup<'a> {
    static NEVER: AtomicBool = AtomicBool::new(false);
    Setup {
        rig,
        effects,
        rows,
        hold: Hold::Zero,
        obstacles,
        cancel: &NEVER,
    }
}

/// Refuses what no physics allows, and what would have to know commands to come.
pub(crate) fn check(
    rig: &Rig,
    maze: Option<&Maze>,
    parameters: Parameters,
    effects: &[EffectInstance<'_>],
    start: [f64; 2],
    row_s: f64,
) -> Result<()> {
    if let Some(one) = effects.iter().find(|one| one.effect.acts == Hook::OnClock) {
        return Err(Error::invalid(
            "effects",
            "effects without a second clock",
            one.effect.name,
        ));
    }
    Batch {
        effects,
        maze,
        start: PerRollout::Shared(&[start]),
        time: TimeBase::Durations(PerRollout::Shared(&[row_s])),
        ..Batch::new(rig, &[parameters], &[[0.0; 2]])
    }
    .run(Engine::Rolling, Some(1), &AtomicBool::new(false))?;
    Ok(())
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
