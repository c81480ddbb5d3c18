//! The simulated board, and the hand that returns the marble to its start.

use labsim::Live;

use super::TICK_S;
use crate::error::{Error, Result};
use crate::model::Model;

/// Maximum number of ticks of a run, half an hour. A longer run continues from the marble's position then.
const ROWS: usize = 30 * 60 * super::HZ as usize;

/// Knobs closer to level than this are level (rad).
const LEVEL_RAD: f64 = 1e-4;

/// A marble that a hand holds at its start until the knobs turn, and returns after they have been level for
/// `hand_s`: from its position, or from below the board.
pub struct Board {
    model: Model,
    live: Live,
    start: [f64; 2],
    hand_ticks: u64,
    seed: u64,
    level_for: u64,
    held: bool,
}

impl Board {
    /// The marble lies at its start (board edges).
    ///
    /// # Errors
    /// [`Error::Refused`] for a model that the engine refuses, or a start off the board.
    pub fn new(model: Model, start: [f64; 2], hand_s: f64, seed: u64) -> Result<Self> {
        let reach = model.reach();
        if !start
            .iter()
            .zip(reach)
            .all(|(place, reach)| place.abs() <= reach)
        {
            return Err(Error::refused(format!(
                "twin.start: expected a place on the board, up to {:.3} and {:.3}, found {start:?}",
                reach[0], reach[1]
            )));
        }
        Ok(Self {
            live: model.live(start, (ROWS, TICK_S), seed)?,
            model,
            start,
            hand_ticks: (hand_s / TICK_S) as u64,
            seed,
            level_for: 0,
            held: true,
        })
    }

    /// Observed position (board edges).
    pub fn seen(&self) -> [f64; 2] {
        self.live.seen()
    }

    /// The board's tilts about x and y (rad).
    pub fn tilts(&mut self) -> [f64; 2] {
        self.live.tilt()
    }

    /// Puts the marble back to its start, on a board at rest.
    ///
    /// # Errors
    /// [`Error::Refused`] if the engine refuses a restart.
    pub fn put_back(&mut self) -> Result<()> {
        self.held = true;
        self.seed += 1;
        self.live = self.model.live(self.start, (ROWS, TICK_S), self.seed)?;
        Ok(())
    }

    /// One tick under these knob angles (rad), or commands in the model's own unit.
    ///
    /// # Errors
    /// [`Error::Refused`] if the engine refuses a restart.
    pub fn tick(&mut self, knobs: [f64; 2]) -> Result<()> {
        let level = knobs.iter().all(|angle| angle.abs() < LEVEL_RAD);
        self.level_for = if level { self.level_for + 1 } else { 0 };
        if !level {
            self.held = false;
        }
        if self.held {
            return Ok(());
        }
        if self.live.left() == 0 {
            let seen = self.live.seen();
            let fallen = self.live.fall().is_some();
            let start = if fallen { self.start } else { seen };
            self.live = self.model.live(start, (ROWS, TICK_S), self.seed)?;
        }
        self.live.play(knobs);
        if self.level_for > self.hand_ticks {
            self.put_back()?;
        }
        Ok(())
    }
}
