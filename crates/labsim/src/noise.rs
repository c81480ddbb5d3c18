//! Random quantities of a recording: errors of tracker and tilt sensor, and random accelerations of the marble.

use crate::error::{Error, Result};

/// Sizes of the random quantities of a filter (Kristensen, Madsen and Jørgensen 2004: a stochastic grey box).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation of the tracker's white errors (board edges).
    pub white: f64,
    /// Standard deviation of the tracker's correlated errors (board edges).
    pub lasting: f64,
    /// Correlation time of those (s): their autocorrelation is exp(-t / `lasting_s`).
    pub lasting_s: f64,
    /// Spectral density of the marble's random acceleration (m²/s³): the standard deviation of the velocity (m/s)
    /// grows by its square root times the square root of the time.
    pub push: f64,
    /// Standard deviation of the correlated random acceleration (m/s²).
    pub pull: f64,
    /// Correlation time of that (s): its autocorrelation is exp(-t / `pull_s`).
    pub pull_s: f64,
    /// Standard deviation of the coefficient of restitution from impact to impact.
    pub restitution: f64,
    /// Standard deviation of the delay from command to command (s).
    pub jitter: f64,
    /// Standard deviation of the time at which a marble at a wall follows a turn of the board (s): the wall turns
    /// along and knocks the marble away, or holds it.
    pub departure: f64,
    /// Standard deviation of the time at which a marble breaks away that friction holds more firmly than it brakes a
    /// rolling one (s): how firmly differs from place to place.
    pub release: f64,
    /// Standard deviation of the white errors of the measured tilt (rad); zero without a measured tilt.
    pub tilt_white: f64,
    /// Standard deviation of the correlated errors of the predicted and measured tilt (rad).
    pub tilt_lasting: f64,
    /// Correlation time of those (s).
    pub tilt_lasting_s: f64,
    /// Standard deviation of the start velocity (m/s), zero for a marble at rest, if it is released at the first
    /// observed position; none if the start state is known.
    pub start_velocity: Option<f64>,
}

impl Noise {
    /// Refuses impossible sizes.
    ///
    /// # Errors
    /// [`Error::Invalid`] names the first size that is negative, not finite, or zero where it may not be.
    pub fn check(&self) -> Result<()> {
        let positive = [
            ("white", self.white),
            ("lasting_s", self.lasting_s),
            ("pull_s", self.pull_s),
        ];
        let others = [
            ("lasting", self.lasting),
            ("push", self.push),
            ("pull", self.pull),
            ("restitution", self.restitution),
            ("jitter", self.jitter),
            ("departure", self.departure),
            ("release", self.release),
            ("tilt_white", self.tilt_white),
            ("tilt_lasting", self.tilt_lasting),
            ("tilt_lasting_s", self.tilt_lasting_s),
            ("start_velocity", self.start_velocity.unwrap_or(0.0)),
        ];
        for (name, size) in positive {
            if !(size > 0.0 && size.is_finite()) {
                return Err(Error::invalid(name, "a number above 0", size));
            }
        }
        for (name, size) in others {
            if !(size >= 0.0 && size.is_finite()) {
                return Err(Error::invalid(name, "a number of at least 0", size));
            }
        }
        Ok(())
    }
}

/// In the order of the fields; NaN as the start velocity means a known start state.
impl From<[f64; 14]> for Noise {
    fn from(sizes: [f64; 14]) -> Self {
        let [
            white,
            lasting,
            lasting_s,
            push,
            pull,
            pull_s,
            restitution,
            jitter,
            departure,
            release,
            tilt_white,
            tilt_lasting,
            tilt_lasting_s,
            start_velocity,
        ] = sizes;
        Self {
            white,
            lasting,
            lasting_s,
            push,
            pull,
            pull_s,
            restitution,
            jitter,
            departure,
            release,
            tilt_white,
            tilt_lasting,
            tilt_lasting_s,
            start_velocity: (!start_velocity.is_nan()).then_some(start_velocity),
        }
    }
}

impl From<Noise> for [f64; 14] {
    fn from(noise: Noise) -> Self {
        [
            noise.white,
            noise.lasting,
            noise.lasting_s,
            noise.push,
            noise.pull,
            noise.pull_s,
            noise.restitution,
            noise.jitter,
            noise.departure,
            noise.release,
            noise.tilt_white,
            noise.tilt_lasting,
            noise.tilt_lasting_s,
            noise.start_velocity.unwrap_or(f64::NAN),
        ]
    }
}
