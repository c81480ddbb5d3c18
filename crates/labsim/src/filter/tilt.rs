//! One-step predictions of the measured tilt, which the marble does not change.
//!
//! Measured tilt = gain × predicted tilt + zero + correlated error + white error. Gain and zero are the sensor's:
//! constant in a recording, with a normal prior that has the variance of their plausible ranges
//! ([`crate::effects`]' `tilt_sensor`). The correlated error is what the actuators do beyond the model, and what the
//! sensor misses for longer than a row: a first-order Gauss-Markov process. Outliers count less, as in the filter of
//! the marble.

use nalgebra::{Matrix3, Vector3};

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
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
}

impl Errors {
    fn pass(&mut self, seconds: f64, noise: &Noise) {
        let kept = (-seconds / noise.tilt_lasting_s).exp();
        let transition = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, kept));
        self.mean[2] *= kept;
        self.covariance = transition * self.covariance * transition;
        self.covariance[(2, 2)] += noise.tilt_lasting.powi(2) * (1.0 - kept * kept);
    }

    fn correct(&mut self, seen: &Vector3<f64>, off: f64, white: f64) {
        let with = self.covariance * seen;
        let own = seen.dot(&with);
        let wild = (TAIL + off * off / (own + white)) / (TAIL + 1.0);
        let gain = with / (own + white * wild.max(1.0));
        self.mean += gain * off;
        self.covariance -= gain * with.transpose();
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
    for axis in 0..2 {
        let deviations = Vector3::new(sensor.gain, sensor.zero, noise.tilt_lasting);
        let mut errors = Errors {
            mean: Vector3::zeros(),
            covariance: Matrix3::from_diagonal(&deviations.component_mul(&deviations)),
        };
        for row in 0..predicted.len() {
            if row > 0 {
                errors.pass(seconds(row - 1), noise);
            }
            let seen = Vector3::new(predicted[row][axis], 1.0, 1.0);
            predicted[row][axis] += seen.dot(&errors.mean);
            variance[row][axis] = seen.dot(&(errors.covariance * seen)) + white;
            let off = measured[row][axis] - predicted[row][axis];
            if off.is_finite() {
                errors.correct(&seen, off, white);
            }
        }
    }
}
