//! Maximum a posteriori fits with random accelerations of the marble, and the evidence of the model.
//!
//! The likelihood is that of the filter ([`crate::filter`]); the sizes of its random quantities are estimated. Values
//! have a normal prior with the mean and the variance of their plausible ranges. The coefficients of a map have a
//! common normal prior about zero with an estimated spread (`MacKay` 1992). Fisher scoring maximises the posterior of
//! the values, the start states and the sizes together. The evidence is Laplace's approximation at the maximum, over
//! values and start states, with the sizes at their best ("Bayesian interpolation", 1992).

use std::sync::atomic::AtomicBool;

use super::ascent::Probable;
use super::hill::Hill;
use super::problem::Problem;
use super::shooting::Shooting;
use super::windows::State;
use crate::error::Result;
use crate::noise::Noise;

impl Problem<'_> {
    /// Ascends from values and sizes of the random quantities, all in lockstep; start states begin at those of the
    /// stretches, if given.
    ///
    /// The gears of all values must have the signs of the first ones.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn ascend(
        &self,
        values: &[Vec<f64>],
        noise: &[Noise],
        states: Option<&[Vec<Option<[f64; 4]>>]>,
        iterations: usize,
        cancel: &AtomicBool,
    ) -> Result<Vec<Probable>> {
        self.check()?;
        let Some(first) = values.first() else {
            return Ok(Vec::new());
        };
        let (coordinates, whole) = self.around(first, cancel)?;
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        let hill = Hill::new(&shooting, &coordinates, noise);
        let mut ascents = Vec::with_capacity(values.len());
        for (i, (values, noise)) in values.iter().zip(noise).enumerate() {
            self.check_values(values)?;
            let states = self.of_windows(&whole, states.map_or(&[], |states| &states[i]));
            ascents.push(hill.place(values, states, noise).into());
        }
        for _ in 0..iterations {
            if !hill.step(&mut ascents)? {
                break;
            }
        }
        let of_stretches = |states: &[State]| self.of_stretches(&whole, |i| states[i]);
        hill.tops(&mut ascents, of_stretches)
    }

    /// Ascends from the top of all stretches once for each fold, without its stretches, in order of the folds.
    ///
    /// `folds` has the fold of each stretch; one of none is never left out. The derivatives at the start are taken once
    /// for all folds.
    ///
    /// # Errors
    /// As [`Problem::fit`].
    pub fn leave_out(
        &self,
        values: &[f64],
        noise: &Noise,
        states: &[Option<[f64; 4]>],
        folds: &[Option<usize>],
        iterations: usize,
        cancel: &AtomicBool,
    ) -> Result<Vec<Probable>> {
        self.check()?;
        let (coordinates, whole) = self.around(values, cancel)?;
        let shooting = Shooting::new(self, &coordinates, &whole, 1.0, cancel);
        let hill = Hill::new(&shooting, &coordinates, std::slice::from_ref(noise));
        let place = hill.place(values, self.of_windows(&whole, states), noise);
        let mut of_windows = vec![None; whole.all.len()];
        for (window, fold) in self.of_stretches(&whole, |i| i).into_iter().zip(folds) {
            if let Some(window) = window {
                of_windows[window] = *fold;
            }
        }
        let of_stretches = |states: &[State]| self.of_stretches(&whole, |i| states[i]);
        let mut numbers: Vec<usize> = folds.iter().copied().flatten().collect();
        numbers.sort_unstable();
        numbers.dedup();
        hill.leave_out(&place, &numbers, of_windows, iterations, of_stretches)
    }
}
