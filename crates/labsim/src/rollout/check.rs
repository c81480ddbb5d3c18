//! What of a batch is looked at before it is simulated.

use std::f64::consts::FRAC_PI_2;

use super::{Batch, TimeBase};
use crate::error::{Error, Result};
use crate::per_rollout::PerRollout;

impl Batch<'_> {
    /// Refuses what cannot be simulated.
    pub(super) fn check(&self) -> Result<()> {
        let rollouts = self.parameters.len();
        self.rig.check()?;
        if let Some(maze) = self.maze {
            maze.check(self.rig)?;
        }
        let issued = self.issued();
        if !matches!(self.commands, PerRollout::Of(_)) {
            self.commands.check("commands", rollouts, issued)?;
        }
        self.knobs_before.check("knobs_before", rollouts, 1)?;
        self.first.check("first", rollouts, 1)?;
        self.seeds.check("seeds", rollouts, 1)?;
        self.start.check("start", rollouts, 1)?;
        self.start_velocity.check("start_velocity", rollouts, 1)?;
        self.rolled.check("rolled", rollouts, 1)?;
        self.turned.check("turned", rollouts, 1)?;
        if let TimeBase::Durations(durations) = &self.time
            && !matches!(durations, PerRollout::Of(_))
        {
            durations.check("durations", rollouts, issued)?;
        }
        if let TimeBase::Continuous(Some(substeps)) = self.time {
            PerRollout::Each(substeps).check("substeps", rollouts, 1)?;
        }
        for one in self.effects {
            let count = one.effect.parameters.len();
            one.values.check(one.effect.name, rollouts, count)?;
        }
        // Looked at once where all rollouts share them.
        let shared = match self.commands {
            PerRollout::Shared(commands) => Some(largest(commands)),
            _ => None,
        };
        (0..rollouts).try_for_each(|i| {
            let knobs = shared.unwrap_or_else(|| largest(self.commands.of(i, issued)));
            self.check_rollout(i, knobs)
                .map_err(|error| locate(error, i))
        })
    }

    /// Looks at one rollout, whose knobs turn by up to `knobs` (rad).
    fn check_rollout(&self, rollout: usize, knobs: [f64; 2]) -> Result<()> {
        let parameters = &self.parameters[rollout];
        parameters.check()?;
        let finite = |what: &str, values: &[f64]| match values.iter().find(|v| !v.is_finite()) {
            Some(value) => Err(Error::invalid(what, "finite numbers", value)),
            None => Ok(()),
        };
        finite("start", self.start.of(rollout, 1).as_flattened())?;
        let velocity = self.start_velocity.of(rollout, 1);
        finite("start_velocity", velocity.as_flattened())?;
        finite("rolled", self.rolled.of(rollout, 1))?;
        finite("turned", self.turned.of(rollout, 1).as_flattened())?;
        let commands = self.commands.of(rollout, self.issued());
        self.check_length("commands", rollout, commands.len())?;
        let before = self.knobs_before.of(rollout, 1);
        finite("knobs_before", before.as_flattened())?;
        if knobs.contains(&f64::INFINITY) {
            finite("commands", commands.as_flattened())?;
        }
        for (axis, gear) in [parameters.gear_x, parameters.gear_y]
            .into_iter()
            .enumerate()
        {
            let steepest = (gear * knobs[axis]).abs();
            if steepest >= FRAC_PI_2 {
                return Err(Error::invalid(
                    ["gear_x", "gear_y"][axis],
                    "a board that tilts by less than π/2",
                    steepest,
                ));
            }
        }
        for one in self.effects {
            let count = one.effect.parameters.len();
            one.effect.check(one.values.of(rollout, count))?;
        }
        match self.time {
            TimeBase::Durations(durations) => {
                let durations = durations.of(rollout, self.issued());
                self.check_length("durations", rollout, durations.len())?;
                let wrong = durations.iter().find(|&&s| !(0.0..=20.0).contains(&s));
                wrong.map_or(Ok(()), |s| {
                    Err(Error::invalid("durations", "0 to 20 s a row", s))
                })
            }
            TimeBase::Continuous(Some(substeps)) if substeps[rollout] == 0 => {
                Err(Error::invalid("substeps", "at least 1", 0))
            }
            _ => Ok(()),
        }
    }

    /// Refuses sequences that end before the last observed row.
    fn check_length(&self, what: &str, rollout: usize, rows: usize) -> Result<()> {
        let needed = self.first.of(rollout, 1)[0] + self.rows;
        if rows < needed {
            return Err(Error::invalid(
                what,
                &format!("at least {needed} rows"),
                rows,
            ));
        }
        Ok(())
    }
}

/// The largest angle of each knob (rad); infinite where one is not a finite number.
fn largest(commands: &[[f64; 2]]) -> [f64; 2] {
    commands.iter().fold([0.0, 0.0], |largest, knobs| {
        std::array::from_fn(|axis| {
            if knobs[axis].is_finite() {
                knobs[axis].abs().max(largest[axis])
            } else {
                f64::INFINITY
            }
        })
    })
}

fn locate(error: Error, rollout: usize) -> Error {
    match error {
        Error::Invalid {
            what,
            expected,
            got,
        } => Error::Invalid {
            what: format!("{what} of rollout {rollout}"),
            expected,
            got,
        },
        other => other,
    }
}
