//! The five parameters that are tuned (paper, section 5.2).

use crate::error::{Error, Result};

/// The names of the parameters, in the order of arrays.
pub const NAMES: [&str; 5] = [
    "gear_x",
    "gear_y",
    "rolling_friction",
    "time_scale",
    "observation_scale",
];

/// Places in arrays of the parameters.
pub(crate) const GEAR_X: usize = 0;
pub(crate) const GEAR_Y: usize = 1;
pub(crate) const FRICTION: usize = 2;
pub(crate) const TIME: usize = 3;
pub(crate) const SCALE: usize = 4;

/// Maximum number of physics updates in a timestep: a hundred times the paper's range.
pub(crate) const MOST_SUBSTEPS: f64 = 5000.0;

/// One set of values of the five parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// Board angle over knob angle, about x.
    pub gear_x: f64,
    /// Board angle over knob angle, about y.
    pub gear_y: f64,
    /// Resisting torque over (radius × normal force).
    pub rolling_friction: f64,
    /// Physics updates of 1/240 s in a timestep.
    pub time_scale: f64,
    /// Observed position over true position.
    pub observation_scale: f64,
}

impl From<[f64; 5]> for Parameters {
    /// Values in the order of [`NAMES`].
    fn from(
        [
            gear_x,
            gear_y,
            rolling_friction,
            time_scale,
            observation_scale,
        ]: [f64; 5],
    ) -> Self {
        Self {
            gear_x,
            gear_y,
            rolling_friction,
            time_scale,
            observation_scale,
        }
    }
}

impl Parameters {
    /// Refuses physically impossible values.
    ///
    /// # Errors
    /// [`Error::Invalid`] names the first parameter that is out of bounds.
    pub fn check(&self) -> Result<()> {
        let Self {
            gear_x,
            gear_y,
            rolling_friction,
            time_scale,
            observation_scale,
        } = *self;
        for (name, gear) in [("gear_x", gear_x), ("gear_y", gear_y)] {
            if !gear.is_finite() {
                return Err(Error::invalid(name, "a finite number", gear));
            }
        }
        if !(rolling_friction >= 0.0 && rolling_friction.is_finite()) {
            return Err(Error::invalid(
                "rolling_friction",
                "a number of at least 0",
                rolling_friction,
            ));
        }
        if !(0.0..=MOST_SUBSTEPS).contains(&time_scale) {
            let expected = format!("a number from 0 to {MOST_SUBSTEPS}");
            return Err(Error::invalid("time_scale", &expected, time_scale));
        }
        if !(observation_scale > 0.0 && observation_scale.is_finite()) {
            return Err(Error::invalid(
                "observation_scale",
                "a number above 0",
                observation_scale,
            ));
        }
        Ok(())
    }
}
