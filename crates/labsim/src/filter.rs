//! One-step predictions, their variances and the likelihood of recordings, for a marble with random accelerations.
//!
//! Without random accelerations the filter is a free run whose start state is estimated along the way. With large
//! ones it predicts each row from the one before. A real rig lies between the two: some of its error never repeats.

use std::sync::atomic::AtomicBool;

use crate::board::SUBSTEP_S;
use crate::correction::Correction;
use crate::engine::{Engine, TAIL};
use crate::error::{Error, Result};
use crate::noise::Noise;
use crate::per_rollout::PerRollout;
use crate::rollout::{Batch, Simulated, TimeBase, Wanted};
use crate::threads::Threads;

mod smoother;
mod tilt;

use self::smoother::smoothed;
pub use self::smoother::{Estimate, Smoothed};
pub use self::tilt::MeasuredTilt;

/// One-step predictions of rollouts, `rows` pairs each, concatenated.
#[derive(Debug, Clone, PartialEq)]
pub struct Predictions {
    /// Positions predicted from all earlier rows (board edges).
    pub marble: Vec<[f64; 2]>,
    /// Variances of the observations about the predictions (board edges squared); NaN in first rows, which are
    /// the start.
    pub variance: Vec<[f64; 2]>,
    /// The measured tilt as predicted from all earlier rows (rad); empty if none was given.
    pub tilt: Vec<[f64; 2]>,
    /// Variances of the measurements about these predictions (rad²).
    pub tilt_variance: Vec<[f64; 2]>,
}

/// The rows of one rollout, as in [`Predictions`].
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    pub(crate) marble: &'a [[f64; 2]],
    pub(crate) variance: &'a [[f64; 2]],
    pub(crate) tilt: &'a [[f64; 2]],
    pub(crate) tilt_variance: &'a [[f64; 2]],
}

impl Predictions {
    pub(crate) fn of_rollout(&self, rollout: usize, rows: usize) -> Rows<'_> {
        let own = rollout * rows..(rollout + 1) * rows;
        let of_tilt = if self.tilt.is_empty() {
            0..0
        } else {
            own.clone()
        };
        Rows {
            marble: &self.marble[own.clone()],
            variance: &self.variance[own],
            tilt: &self.tilt[of_tilt.clone()],
            tilt_variance: &self.tilt_variance[of_tilt],
        }
    }
}

/// Rollouts that are corrected in every row by its observation.
#[derive(Debug, Clone, Copy)]
pub struct Filter<'a> {
    /// The rollouts; their `start` is the first observed position.
    pub batch: Batch<'a>,
    /// Observed positions (board edges), `rows` pairs; NaN where the tracker lost the marble. None without a marble,
    /// whose predictions are no numbers then.
    pub observed: Option<PerRollout<'a, [f64; 2]>>,
    /// Measured tilt, if any. It does not correct the marble.
    pub tilt: Option<MeasuredTilt<'a>>,
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
        let wanted = Wanted {
            tilt: self.tilt.is_some_and(|tilt| tilt.predicted.is_none()),
            corrections: false,
        };
        let mut all = match self.observed {
            Some(observed) => {
                let measured = (observed, self.noise);
                self.batch.filtered(measured, wanted, threads, cancel)?
            }
            None => self.without_marble(wanted, threads, cancel)?,
        };
        let mut tilt_variance = Vec::new();
        if let Some(measured) = self.tilt {
            if let Some(predicted) = measured.predicted {
                all.tilt = predicted.to_vec();
            }
            tilt_variance = self.predict_tilt(&measured, &mut all.tilt, threads)?;
        }
        Ok(Predictions {
            marble: all.marble,
            variance: all.variance,
            tilt: all.tilt,
            tilt_variance,
        })
    }

    /// The rollouts' tilt, if it is wanted, beside positions that are no numbers.
    fn without_marble(
        &self,
        wanted: Wanted,
        threads: Option<usize>,
        cancel: &AtomicBool,
    ) -> Result<Simulated> {
        let mut all = Simulated::default();
        if wanted.tilt {
            let found = self.batch.run_with_tilt(Engine::Rolling, threads, cancel)?;
            all.tilt = found.tilt;
        }
        let unknown = vec![[f64::NAN; 2]; self.batch.parameters.len() * self.batch.rows];
        all.variance.clone_from(&unknown);
        all.marble = unknown;
        Ok(all)
    }

    /// Corrects the predicted tilt by the measured one, row by row, and returns the variances.
    fn predict_tilt(
        &self,
        measured: &MeasuredTilt<'_>,
        predicted: &mut [[f64; 2]],
        threads: Option<usize>,
    ) -> Result<Vec<[f64; 2]>> {
        let rows = self.batch.rows;
        let mut variance = vec![[0.0; 2]; predicted.len()];
        let of_rollouts = predicted
            .chunks_exact_mut(rows.max(1))
            .zip(variance.chunks_exact_mut(rows.max(1)));
        let pieces = of_rollouts.enumerate().collect();
        let issued = self.batch.issued();
        Threads::new(threads)?.each(pieces, |(rollout, (predicted, variance))| {
            let first = self.batch.first.of(rollout, 1)[0];
            let even = self.batch.parameters[rollout].time_scale * SUBSTEP_S;
            let durations = match self.batch.time {
                TimeBase::Durations(durations) => Some(durations.of(rollout, issued)),
                _ => None,
            };
            let seconds = |row: usize| durations.map_or(even, |each| each[first + row]);
            let noise = &self.noise.of(rollout, 1)[0];
            let rows = measured.rows.of(rollout, rows);
            tilt::predict(predicted, variance, rows, measured, seconds, noise);
        });
        Ok(variance)
    }

    /// Smoothed estimates of each row from all rows of its rollout: the random acceleration and the tracker's lasting
    /// error, along each axis; `rows` pairs per rollout, none without a marble.
    ///
    /// # Errors
    /// As [`Filter::run`].
    pub fn smoothed(
        &self,
        threads: Option<usize>,
        cancel: &AtomicBool,
    ) -> Result<Vec<[Smoothed; 2]>> {
        self.check()?;
        let Some(observed) = self.observed else {
            return Ok(Vec::new());
        };
        let measured = (observed, self.noise);
        let wanted = Wanted {
            tilt: false,
            corrections: true,
        };
        let all = self.batch.filtered(measured, wanted, threads, cancel)?;
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
        if let Some(observed) = self.observed {
            observed.check("observed", rollouts, self.batch.rows)?;
        }
        self.noise.check("noise", rollouts, 1)?;
        if let Some(tilt) = self.tilt {
            tilt.rows.check("tilt", rollouts, self.batch.rows)?;
            if let Some(predicted) = tilt.predicted {
                let all = PerRollout::Each(predicted);
                all.check("predicted tilt", rollouts, self.batch.rows)?;
            }
        }
        (0..rollouts).try_for_each(|rollout| {
            let noise = &self.noise.of(rollout, 1)[0];
            noise.check()?;
            let needed = [
                ("tilt_white", noise.tilt_white),
                ("tilt_lasting_s", noise.tilt_lasting_s),
            ];
            for (name, size) in needed {
                if self.tilt.is_some() && size == 0.0 {
                    let expected = "a number above 0 beside a measured tilt";
                    return Err(Error::invalid(name, expected, size));
                }
            }
            Ok(())
        })
    }

    /// Log-likelihood of the observations of each channel, for each rollout: the marble along both axes, the tilt
    /// about both. Student's t about the predictions; zero where nothing was measured.
    pub fn log_likelihoods(&self, predictions: &Predictions) -> Vec<[f64; 4]> {
        let rows = self.batch.rows;
        let rollouts = 0..self.batch.parameters.len();
        rollouts
            .map(|rollout| {
                let own = predictions.of_rollout(rollout, rows);
                let [x, y] = self.observed.map_or([0.0; 2], |observed| {
                    log_likelihood(observed.of(rollout, rows), own.marble, own.variance)
                });
                let [about_x, about_y] = self.tilt.map_or([0.0; 2], |measured| {
                    log_likelihood(measured.rows.of(rollout, rows), own.tilt, own.tilt_variance)
                });
                [x, y, about_x, about_y]
            })
            .collect()
    }
}

/// Log-likelihood of measured rows along both axes; rows without a measurement or a variance do not count.
fn log_likelihood(
    measured: &[[f64; 2]],
    predicted: &[[f64; 2]],
    variance: &[[f64; 2]],
) -> [f64; 2] {
    let mut sum = [0.0; 2];
    for (measured, (predicted, variance)) in measured.iter().zip(predicted.iter().zip(variance)) {
        for (axis, sum) in sum.iter_mut().enumerate() {
            let off = measured[axis] - predicted[axis];
            if off.is_finite() && variance[axis].is_finite() {
                *sum += log_density(off, variance[axis]);
            }
        }
    }
    sum
}

/// Γ((ν + 1)/2) / (Γ(ν/2) √(ν π)) for ν = [`TAIL`] = 4.
const PEAK: f64 = 0.375;

/// Logarithm of the density of Student's t distribution with [`TAIL`] degrees of freedom.
pub(crate) fn log_density(off: f64, variance: f64) -> f64 {
    let ratio = off * off / (TAIL * variance);
    PEAK.ln() - 0.5 * variance.ln() - 0.5 * (TAIL + 1.0) * ratio.ln_1p()
}
