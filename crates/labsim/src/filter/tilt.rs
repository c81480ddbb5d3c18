//! One-step predictions of the measured tilt, which the marble does not change.
//!
//! Measured tilt = gain × predicted tilt + zero + correlated error + white error. Gain and zero are the sensor's:
//! constant in a recording, with a normal prior that has the variance of their plausible ranges
//! ([`crate::effects`]' `tilt_sensor`). The correlated error is what the actuators do beyond the model, and what the
//! sensor misses for longer than a row: a first-order Gauss-Markov process. Outliers count less, as in the filter of
//! the marble.

use crate::engine::TAIL;
use crate::noise::Noise;
use crate::per_rollout::PerRollout;

/// Measured tilt of the rollouts of a filter.
#[derive(Debug, Clone, Copy)]
pub struct MeasuredTilt<'a> {
    /// Angles about x and y (rad), `rows` pairs; NaN in rows without.
    pub rows: PerRollout<'a, [f64; 2]>,
    /// The tilt without the sensor's errors (rad), `rows` pairs; by default that of the filter's rollouts.
    pub predicted: Option<&'a [[f64; 2]]>,
    /// Prior standard deviation of the sensor's gain in each rollout.
    pub gain: f64,
    /// Prior standard deviation of its zero in each rollout (rad).
    pub zero: f64,
}

/// Errors of the tilt about one axis: of the gain, of the zero (rad), and the correlated one (rad).
struct Errors {
    mean: [f64; 3],
    /// Upper triangle of the covariance, row by row.
    covariance: [f64; 6],
}

impl Errors {
    fn new(deviations: [f64; 3]) -> Self {
        let [gain, zero, lasting] = deviations.map(|one| one * one);
        Self {
            mean: [0.0; 3],
            covariance: [gain, 0.0, 0.0, zero, 0.0, lasting],
        }
    }

    /// A row later: a share of the correlated error is kept, whose variance tends to that of the process.
    fn pass(&mut self, kept: f64, process: f64) {
        let [_, _, gain_lasting, _, zero_lasting, lasting] = &mut self.covariance;
        self.mean[2] *= kept;
        *gain_lasting *= kept;
        *zero_lasting *= kept;
        *lasting = process + kept * kept * (*lasting - process);
    }

    /// What they add to a predicted tilt, its variance, and its covariances with them.
    fn seen(&self, tilt: f64) -> (f64, f64, [f64; 3]) {
        let [gg, gz, gl, zz, zl, ll] = self.covariance;
        let with = [
            gg * tilt + gz + gl,
            gz * tilt + zz + zl,
            gl * tilt + zl + ll,
        ];
        let [gain, zero, lasting] = self.mean;
        let variance = with[0] * tilt + with[1] + with[2];
        (gain * tilt + zero + lasting, variance, with)
    }

    fn correct(&mut self, off: f64, variance: f64, white: f64, with: [f64; 3]) {
        let wild = (TAIL + off * off / (variance + white)) / (TAIL + 1.0);
        let share = 1.0 / (variance + white * wild.max(1.0));
        let [g, z, l] = with.map(|one| one * share);
        for (mean, gain) in self.mean.iter_mut().zip([g, z, l]) {
            *mean += gain * off;
        }
        let [gg, gz, gl, zz, zl, ll] = &mut self.covariance;
        *gg -= g * with[0];
        *gz -= g * with[1];
        *gl -= g * with[2];
        *zz -= z * with[1];
        *zl -= z * with[2];
        *ll -= l * with[2];
    }
}

/// Adds to the predicted tilt of each row what the measured rows before say of the errors, and writes the variances
/// of the measurements about these predictions. `seconds` are the durations of the rows.
pub(super) fn predict(
    predicted: &mut [[f64; 2]],
    variance: &mut [[f64; 2]],
    measured: &[[f64; 2]],
    sensor: &MeasuredTilt<'_>,
    seconds: impl Fn(usize) -> f64,
    noise: &Noise,
) {
    let white = noise.tilt_white.powi(2);
    let process = noise.tilt_lasting.powi(2);
    let mut both = [0, 1].map(|_| Errors::new([sensor.gain, sensor.zero, noise.tilt_lasting]));
    // Most rows last as long as the one before.
    let (mut lasted, mut kept) = (0.0, 1.0);
    for row in 0..predicted.len() {
        if row > 0 {
            if seconds(row - 1) != lasted {
                lasted = seconds(row - 1);
                kept = (-lasted / noise.tilt_lasting_s).exp();
            }
            for errors in &mut both {
                errors.pass(kept, process);
            }
        }
        for (axis, errors) in both.iter_mut().enumerate() {
            let (added, own, with) = errors.seen(predicted[row][axis]);
            predicted[row][axis] += added;
            variance[row][axis] = own + white;
            let off = measured[row][axis] - predicted[row][axis];
            if off.is_finite() {
                errors.correct(off, own, white, with);
            }
        }
    }
}
