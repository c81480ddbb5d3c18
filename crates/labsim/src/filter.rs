//! One-step predictions, their variances and the likelihood of recordings, for a marble with random accelerations.
//!
//! Without random accelerations the filter is a free run whose start state is estimated along the way. With large
//! ones it predicts each row from the one before. A real rig lies between the two: some of its error never repeats.

use std::sync::atomic::AtomicBool;

use crate::correction::Correction;
use crate::engine::TAIL;
use crate::error::Result;
use crate::noise::Noise;
use crate::per_rollout::PerRollout;
use crate::rollout::Batch;

mod smoother;

use self::smoother::smoothed;
pub use self::smoother::{Estimate, Smoothed};

/// One-step predictions of rollouts, `rows` pairs each, concatenated.
#[derive(Debug, Clone, PartialEq)]
pub struct Predictions {
    /// Positions predicted from all earlier rows (board edges).
    pub marble: Vec<[f64; 2]>,
    /// Variances of the observations about the predictions (board edges squared); NaN in first rows, which are
    /// the start.
    pub variance: Vec<[f64; 2]>,
}

/// Rollouts that are corrected in every row by its observation.
#[derive(Debug, Clone, Copy)]
pub struct Filter<'a> {
    /// The rollouts; their `start` is the first observed position.
    pub batch: Batch<'a>,
    /// Observed positions (board edges), `rows` pairs; NaN where the tracker lost the marble.
    pub observed: PerRollout<'a, [f64; 2]>,
    /// Sizes of the random quantities, shared or one for each rollout.
    pub noise: PerRollout<'a, Noise>,
}

impl Filter<'_> {
    /// Filters every rollout in the rolling engine.
    ///
    /// The result depends on neither the other rollouts of the batch nor the number of threads, to the bit.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for physically impossible values, [`crate::Error::Cancelled`] once `cancel` is set.
    pub fn run(&self, threads: Option<usize>, cancel: &AtomicBool) -> Result<Predictions> {
        self.check()?;
        let measured = (self.observed, self.noise);
        let all = self.batch.filtered(measured, false, threads, cancel)?;
        Ok(Predictions {
            marble: all.marble,
            variance: all.variance,
        })
    }

    /// Smoothed estimates of each row from all rows of its rollout: the random acceleration and the tracker's lasting
    /// error, along each axis; `rows` pairs per rollout.
    ///
    /// # Errors
    /// As [`Filter::run`].
    pub fn smoothed(
        &self,
        threads: Option<usize>,
        cancel: &AtomicBool,
    ) -> Result<Vec<[Smoothed; 2]>> {
        self.check()?;
        let measured = (self.observed, self.noise);
        let all = self.batch.filtered(measured, true, threads, cancel)?;
        let of_rollout = |rows: &[[Correction; 2]]| {
            let of_axis =
                |axis: usize| smoothed(&rows.iter().map(|row| row[axis]).collect::<Vec<_>>());
            let (x, y) = (of_axis(0), of_axis(1));
            x.into_iter()
                .zip(y)
                .map(|(x, y)| [x, y])
                .collect::<Vec<_>>()
        };
        let rollouts = all.corrections.chunks_exact(self.batch.rows.max(1));
        Ok(rollouts.flat_map(of_rollout).collect())
    }

    fn check(&self) -> Result<()> {
        let rollouts = self.batch.parameters.len();
        self.observed.check("observed", rollouts, self.batch.rows)?;
        self.noise.check("noise", rollouts, 1)?;
        (0..rollouts).try_for_each(|rollout| self.noise.of(rollout, 1)[0].check())
    }

    /// Log-likelihood of the observations along each axis, for each rollout: Student's t about the predictions.
    pub fn log_likelihoods(&self, predictions: &Predictions) -> Vec<[f64; 2]> {
        let rows = self.batch.rows;
        let rollouts = 0..self.batch.parameters.len();
        rollouts
            .map(|rollout| {
                let own = rollout * rows..(rollout + 1) * rows;
                let seen = self.observed.of(rollout, rows);
                let mut sum = [0.0; 2];
                for (row, i) in own.enumerate() {
                    for (axis, sum) in sum.iter_mut().enumerate() {
                        let off = seen[row][axis] - predictions.marble[i][axis];
                        let variance = predictions.variance[i][axis];
                        if off.is_finite() && variance.is_finite() {
                            *sum += log_density(off, variance);
                        }
                    }
                }
                sum
            })
            .collect()
    }
}

/// Γ((ν + 1)/2) / (Γ(ν/2) √(ν π)) for ν = [`TAIL`] = 4.
const PEAK: f64 = 0.375;

/// Logarithm of the density of Student's t distribution with [`TAIL`] degrees of freedom.
pub(crate) fn log_density(off: f64, variance: f64) -> f64 {
    let ratio = off * off / (TAIL * variance);
    PEAK.ln() - 0.5 * variance.ln() - 0.5 * (TAIL + 1.0) * ratio.ln_1p()
}
