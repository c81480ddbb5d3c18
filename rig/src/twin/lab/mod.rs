//! The twin of another lab's rig, with that lab's interface.

mod cyberrunner;
mod drive;
mod eye;
mod painting;
mod tag;

use std::path::Path;

use self::drive::Drive;
use self::eye::Eye;
use super::board::Board;
use super::{TICK_S, pace};
use crate::ending::Watch;
use crate::error::{Error, Result};
use crate::labs::Lab;
use crate::labs::config::TwinConfig;
use crate::model::Model;
use crate::signals::Signals;
use crate::watch::Moment;

/// The lab's interface.
enum Front {
    Cyberrunner(Box<cyberrunner::Front>),
    Tag(tag::Front),
}

/// Board, motors and camera.
struct LabTwin {
    lab: Lab,
    board: Board,
    drive: Drive,
    eye: Eye,
    front: Front,
    /// Ticks between pictures.
    every: u64,
    /// Whether a hand has the marble while the board is levelled.
    resets: bool,
}

/// Runs until a signal, or for some seconds; `ready` is called once it can be used.
///
/// # Errors
/// [`Error::Refused`] for an invalid model or network.
pub fn run(
    lab: Lab,
    config: &TwinConfig,
    model: &Path,
    seed: u64,
    seconds: Option<f64>,
    ready: impl FnOnce(),
) -> Result<()> {
    let signals = Signals::register()?;
    let watch = Watch::start(signals.any(), 0.0, f64::INFINITY)?;
    let model = Model::read(model)?;
    let hz = config.twin.tracker_hz;
    if hz > super::HZ {
        return Err(Error::refused(format!(
            "twin.tracker_hz: expected at most {} for the twin of another lab, found {hz}",
            super::HZ
        )));
    }
    let start = model.start().unwrap_or(config.twin.start);
    let mut twin = LabTwin {
        lab,
        drive: Drive::new(lab, &config.twin, &model),
        eye: Eye::new(&config.twin, &model, seed),
        // Only a reset brings the marble back, as the lab's learners expect it.
        board: Board::new(model, start, f64::INFINITY, seed)?,
        front: match lab {
            Lab::Cyberrunner => Front::Cyberrunner(Box::new(cyberrunner::Front::open(config)?)),
            Lab::TagTcp => Front::Tag(tag::Front::open()?),
        },
        every: u64::from(super::HZ / hz),
        resets: false,
    };
    ready();
    let outcome = pace(&signals, &watch, seconds, |tick, now| twin.tick(tick, now));
    watch.leaves(outcome.as_ref().err());
    outcome
}

impl LabTwin {
    fn tick(&mut self, tick: u64, now: Moment) -> Result<()> {
        let asked = match &mut self.front {
            Front::Cyberrunner(front) => front.hear(),
            Front::Tag(front) => front.hear(),
        };
        // The motors take no commands while they level the board.
        if let (Some(commands), false) = (asked.commands, self.resets) {
            self.drive.command(self.lab.exchanged(commands), now.steady);
        }
        if asked.reset {
            self.resets = true;
            self.drive.reset();
        }
        if tick.is_multiple_of(self.every) {
            let place = if self.resets {
                [f64::NAN; 2]
            } else {
                self.board.seen()
            };
            self.eye.look(place, self.board.tilts(), now.steady)?;
        }
        self.board.tick(self.drive.step(now.steady, TICK_S))?;
        if self.resets && self.drive.is_home() {
            self.resets = false;
            self.board.put_back()?;
            if let Front::Cyberrunner(front) = &mut self.front {
                front.answer_resets();
            }
        }
        while let Some(sight) = self.eye.due(now.steady) {
            match &mut self.front {
                Front::Cyberrunner(front) => front.show(&sight)?,
                Front::Tag(front) => front.show(&sight),
            }
        }
        Ok(())
    }
}

/// What a learner asked for since the last tick.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Asked {
    /// The last commands of motors 1 and 2.
    commands: Option<[f64; 2]>,
    /// Whether the board is to be levelled and the marble brought back.
    reset: bool,
}
