//! Files of commands: from `irt suggest`, a recording, or written by hand.

use std::fs;
use std::path::Path;

use crate::config::{Config, TICK_S};
use crate::error::{Error, Result};
use crate::safety::{SetPoint, bounds};

/// Longest duration of a row (s): every tick of a file is looked at before it is played.
const LONGEST_S: f64 = 60.0;

/// The columns of knob angles.
pub const KNOBS: [&str; 2] = ["knob_x_rad", "knob_y_rad"];

/// Commands and their times.
#[derive(Debug, Clone, PartialEq)]
pub struct Commands {
    /// Values of two columns, one pair per row: knob angles about x and about y (rad), or commands of a lab.
    pub values: Vec<[f64; 2]>,
    /// Time of each row (s), from zero.
    pub begins: Vec<f64>,
    /// Duration of the last row (s).
    pub last_s: f64,
    /// Start position in row 0 (board edges), if any.
    pub start: Option<[f64; 2]>,
}

impl Commands {
    /// Reads a CSV with one of these pairs of columns and either `t_s` or a `period` for all rows (s). Returns also which
    /// pair it has.
    ///
    /// # Errors
    /// [`Error::Refused`] names file, row and column.
    pub fn read(path: &Path, pairs: &[[&str; 2]], period: Option<f64>) -> Result<(Self, usize)> {
        let text = fs::read_to_string(path).map_err(|error| {
            Error::refused(format!("{}: cannot be read: {error}", path.display()))
        })?;
        Self::parse(&text, pairs, period)
            .map_err(|what| Error::refused(format!("{}{what}", path.display())))
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// Row and column, and what is wrong there.
    pub fn parse(
        text: &str,
        pairs: &[[&str; 2]],
        period: Option<f64>,
    ) -> std::result::Result<(Self, usize), String> {
        let mut lines = text.trim_start_matches('\u{feff}').lines();
        let header = lines.next().ok_or(": the file is empty")?;
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        let column = |name: &str| names.iter().position(|one| *one == name);
        let found = |pair: &[&str; 2]| pair.iter().any(|name| column(name).is_some());
        let which = match pairs.iter().position(found) {
            Some(which) => which,
            None if pairs.len() > 1 => {
                let all: Vec<String> = pairs.iter().map(|pair| pair.join(", ")).collect();
                return Err(format!(": expected the columns {}", all.join(" or ")));
            }
            None => 0,
        };
        let needed = |name: &str| column(name).ok_or(format!(": column {name} is missing"));
        let (x, y) = (needed(pairs[which][0])?, needed(pairs[which][1])?);
        let stamps = column("t_s");
        let marble = column("marble_x").zip(column("marble_y"));
        let mut commands = Self {
            values: Vec::new(),
            begins: Vec::new(),
            last_s: 0.0,
            start: None,
        };
        for (row, line) in lines.filter(|line| !line.trim().is_empty()).enumerate() {
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let number = |column: usize| -> std::result::Result<f64, String> {
                let cell = cells.get(column).copied().unwrap_or("");
                match cell.parse::<f64>() {
                    Ok(value) if value.is_finite() => Ok(value),
                    _ => Err(format!(
                        ", row {row}, {}: expected a finite number, found \"{cell}\"",
                        names[column]
                    )),
                }
            };
            commands.values.push([number(x)?, number(y)?]);
            if let Some(stamps) = stamps {
                commands.begins.push(number(stamps)?);
            }
            if let (0, Some((x, y))) = (row, marble) {
                commands.start = number(x).ok().zip(number(y).ok()).map(Into::into);
            }
        }
        Ok((commands.timed(stamps.is_some(), period)?, which))
    }

    fn timed(mut self, stamped: bool, period: Option<f64>) -> std::result::Result<Self, String> {
        if self.values.len() < 2 {
            return Err(format!(
                ": expected at least 2 rows, found {}",
                self.values.len()
            ));
        }
        match (stamped, period) {
            (true, Some(_)) => return Err(": has stamps (t_s); leave --period out".to_owned()),
            (false, None) => {
                return Err(
                    ": has no stamps (t_s); say with --period how long a row lasts".to_owned(),
                );
            }
            (false, Some(period)) => {
                if !(TICK_S..=10.0).contains(&period) {
                    return Err(format!(
                        ": --period: expected {TICK_S} to 10 s, found {period}"
                    ));
                }
                self.begins = (0..self.values.len())
                    .map(|row| row as f64 * period)
                    .collect();
            }
            (true, None) => {
                let first = self.begins[0];
                self.begins.iter_mut().for_each(|t| *t -= first);
            }
        }
        let shorter = |pair: &[f64]| !(pair[1] - pair[0] >= TICK_S - 1e-9);
        if let Some(row) = self.begins.windows(2).position(shorter) {
            return Err(format!(", row {row}, t_s: lasts less than {TICK_S} s"));
        }
        let longer = |pair: &[f64]| pair[1] - pair[0] > LONGEST_S;
        if let Some(row) = self.begins.windows(2).position(longer) {
            return Err(format!(
                ", row {row}, t_s: lasts more than {LONGEST_S} s; are the stamps in seconds?"
            ));
        }
        let rows = self.begins.len();
        self.last_s = self.begins[rows - 1] - self.begins[rows - 2];
        Ok(self)
    }

    /// Total duration (s).
    pub fn seconds(&self) -> f64 {
        self.begins[self.begins.len() - 1] + self.last_s
    }

    /// The row that holds at a time (s), none after the end.
    pub fn row(&self, time: f64) -> Option<usize> {
        // A row begins at the tick that is nearest.
        let time = time + TICK_S / 2.0;
        if time >= self.seconds() + TICK_S / 2.0 - 1e-9 {
            return None;
        }
        Some(
            self.begins
                .partition_point(|&begin| begin <= time)
                .saturating_sub(1),
        )
    }

    /// Refuses commands beyond the limits: angles outside the window, or motions that the arms cannot follow.
    ///
    /// # Errors
    /// [`Error::Refused`] names the first row that cannot be played, and why.
    pub fn check(&self, config: &Config) -> Result<()> {
        let limits = &config.limits;
        for (axis, (table, arm)) in config.arms.both().into_iter().enumerate() {
            let name = KNOBS[axis];
            let bounds = bounds(limits, 0.0);
            let mut point = SetPoint::at(0.0);
            let mut tick = 0_usize;
            for (row, knobs) in self.values.iter().enumerate() {
                let angle = arm.gear * knobs[axis];
                if angle.abs() > limits.window_rad {
                    return Err(Error::refused(format!(
                        "row {row}, {name}: {} rad turns the joint of {table} by {angle:.4} rad, outside limits.window_rad, {}",
                        knobs[axis], limits.window_rad
                    )));
                }
                while self.row(tick as f64 * TICK_S) == Some(row) {
                    point = point.next(Some(angle), bounds.velocity, &bounds);
                    tick += 1;
                }
                let behind = (angle - point.position).abs();
                if behind > limits.tracking_error_rad / 2.0 {
                    return Err(Error::refused(format!(
                        "row {row}, {name}: within limits.velocity_rad_s, {}, and limits.acceleration_rad_s2, {}, the joint of {table} is still {behind:.4} rad behind as the row ends; play it slower or smaller",
                        limits.velocity_rad_s, limits.acceleration_rad_s2
                    )));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> Config {
        toml::from_str(crate::config::EXAMPLE).expect("the example is right")
    }

    #[test]
    fn rows_hold_from_their_stamp_to_the_next() {
        let text = "step,t_s,knob_x_rad,knob_y_rad,marble_x,marble_y\n0,5,0,0,0.1,-0.2\n1,5.1,0.01,0,,\n2,5.25,0,0,,\n";
        let (commands, _) = Commands::parse(text, &[KNOBS], None).expect("it is right");
        assert_eq!(commands.start, Some([0.1, -0.2]));
        assert!((commands.seconds() - 0.4).abs() < 1e-9);
        let rows: Vec<_> = [0.0, 0.09, 0.1, 0.24, 0.25, 0.39, 0.4]
            .map(|t| commands.row(t))
            .into();
        assert_eq!(
            rows,
            [Some(0), Some(0), Some(1), Some(1), Some(2), Some(2), None]
        );
    }

    #[test]
    fn what_is_wrong_is_said_with_row_and_column() {
        for (text, period, said) in [
            ("knob_x_rad\n0\n", Some(0.1), "knob_y_rad is missing"),
            (
                "knob_x_rad,knob_y_rad\n0,0\n0,nan\n",
                Some(0.1),
                "row 1, knob_y_rad",
            ),
            ("knob_x_rad,knob_y_rad\n0,0\n0,0\n", None, "--period"),
            (
                "knob_x_rad,knob_y_rad,t_s\n0,0,0\n0,0,0.005\n",
                None,
                "row 0, t_s",
            ),
            // The check of every tick until then took hours.
            (
                "knob_x_rad,knob_y_rad,t_s\n0,0,0\n0,0,0.1\n0,0,1e9\n",
                None,
                "row 1, t_s: lasts more than 60 s",
            ),
            ("knob_x_rad,knob_y_rad\n0,0\n", Some(0.1), "at least 2 rows"),
            ("", None, "empty"),
        ] {
            let error = Commands::parse(text, &[KNOBS], period).expect_err(said);
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn commands_that_arms_cannot_follow_are_refused() {
        let rows = |angle: f64| format!("knob_x_rad,knob_y_rad\n0,0\n0,{angle}\n0,0\n");
        for (angle, period, said) in [(0.6, 2.0, "window"), (0.3, 0.1, "behind")] {
            let (commands, _) =
                Commands::parse(&rows(angle), &[KNOBS], Some(period)).expect("its form is right");
            let error = commands.check(&config()).expect_err(said).to_string();
            assert!(
                error.contains(said) && error.contains("row 1, knob_y_rad"),
                "{error}"
            );
        }
        let (commands, _) =
            Commands::parse(&rows(0.02), &[KNOBS], Some(0.1)).expect("its form is right");
        assert_eq!(commands.check(&config()), Ok(()));
    }
}
