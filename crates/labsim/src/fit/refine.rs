//! From values that are about right to the bottom of the valley they lie in, and what values as they are
//! leave over: fits without a search, for those who know where to look.

use std::sync::atomic::AtomicBool;

use super::Problem;
use super::descent::{Pace, minimise};
use super::shooting::{Point, Shooting};
use super::slopes::Look;
use crate::error::Result;

/// Start states tried with each step.
const VARIANTS: usize = 4;

/// Where values have led.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// The five parameters, then those of the effects.
    pub values: Vec<f64>,
    /// Start states, as those of a [`super::Solution`].
    pub states: Vec<Option<[f64; 4]>>,
    /// Predicted minus observed for each row of each stretch (board edges); not a number where nothing
    /// was seen.
    pub residuals: Vec<Vec<[f64; 2]>>,
}

impl Problem<'_> {
    /// Refines values over whole stretches, all of them in lockstep; where `held`, parameters stay as they
    /// are and only start states are estimated.
    ///
    /// The gears of all values must have the signs of the first ones.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn refine(
        &self,
        values: &[Vec<f64>],
        iterations: usize,
        held: bool,
        cancel: &AtomicBool,
    ) -> Result<Vec<Refined>> {
        self.check()?;
        let Some(first) = values.first() else {
            return Ok(Vec::new());
        };
        let (coordinates, whole) = self.around(first, cancel)?;
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        let mut starts = Vec::with_capacity(values.len());
        for values in values {
            self.check_values(values)?;
            starts.push(Point {
                z: coordinates.to_z(values),
                states: whole.guesses(),
            });
        }
        let pace = Pace {
            iterations,
            look: Look::Both,
            variants: VARIANTS,
            held,
        };
        let ends = minimise(&shooting, &starts, self.tracker_noise(), pace, &|_| ())?;
        let refined = ends.into_iter().map(|end| Refined {
            values: coordinates.to_values(&end.point.z),
            states: self.of_stretches(&whole, |i| end.point.states[i]),
            residuals: self.residuals(&whole, &end.residual),
        });
        Ok(refined.collect())
    }
}
