//! The coordinate of one free parameter: its transform, range and bounds.

use std::f64::consts::FRAC_PI_2;

use super::problem::Problem;
use crate::effects::Parameter;
use crate::error::{Error, Result};
use crate::parameters::{FRICTION, GEAR_Y, MOST_SUBSTEPS, TIME};

/// Factor by which a fit may at most leave a range of magnitudes at either end.
const REACH: f64 = 3.0;
/// Smallest value of a logarithmic coordinate, as a share of the largest allowed one.
pub(super) const SMALLEST: f64 = 1e-4;
/// A magnitude whose range spans this factor is a scale parameter.
const DECADES: f64 = 1e3;
/// Below this a timestep rounds to no physics update at all, and the marble never moves.
const SHORTEST_TIME_SCALE: f64 = 0.5;
/// Maximum tilt of the board in a fit, as a share of a right angle.
const STEEPEST: f64 = 0.99;

/// The transform from a coordinate to its parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shape {
    /// The logarithm of its magnitude.
    Logarithm,
    /// Relative to the gears.
    Friction,
    /// In units of this.
    Linear(f64),
}

/// A free parameter; all values are magnitudes where it has a sign.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    /// Its place among all values.
    pub(super) slot: usize,
    pub(super) shape: Shape,
    pub(super) sign: f64,
    /// The range.
    pub(super) low: f64,
    pub(super) high: f64,
    /// Values outside these are penalised.
    pub(super) reach: (f64, f64),
    /// Hard bounds.
    pub(super) lower: f64,
    pub(super) upper: f64,
    /// Power of the time scale with which an effect's parameter changes along the first symmetry.
    pub(super) time_power: f64,
}

impl Axis {
    pub(super) fn half_width(&self) -> f64 {
        0.5 * (self.high - self.low)
    }

    /// The width of its range: of magnitudes in logarithms, else in coordinates.
    pub(super) fn width(&self) -> f64 {
        match self.shape {
            Shape::Linear(unit) => (self.high - self.low) / unit,
            _ => (self.high / self.low).ln(),
        }
    }

    pub(super) fn clip(&self, magnitude: f64) -> f64 {
        magnitude.clamp(self.lower, self.upper)
    }
}

/// The lowest and highest magnitude that a fit may take: beyond the range by its own width in logarithms, for true values
/// slightly outside, and at most by a factor of [`REACH`].
fn allowed(low: f64, high: f64) -> (f64, f64) {
    let factor = (high / low).min(REACH);
    (low / factor, high * factor)
}

/// The axis of one of the five parameters.
pub(super) fn base_axis(
    problem: &Problem<'_>,
    slot: usize,
    range: (f64, f64),
    senses: [f64; 2],
) -> Axis {
    let sign = if slot <= GEAR_Y { senses[slot] } else { 1.0 };
    let ends = [(range.0 * sign).max(0.0), (range.1 * sign).max(0.0)];
    let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    let (mut lower, mut upper) = allowed(low, high);
    if slot <= GEAR_Y {
        let knob = problem.largest_knob(slot);
        upper = upper.min(STEEPEST * FRAC_PI_2 / knob.max(f64::MIN_POSITIVE));
    }
    if slot == TIME {
        lower = lower.max(SHORTEST_TIME_SCALE);
        upper = upper.min(MOST_SUBSTEPS).max(lower);
    } else if slot != FRICTION {
        lower = lower.max(SMALLEST * upper);
    }
    Axis {
        slot,
        shape: if slot == FRICTION {
            Shape::Friction
        } else {
            Shape::Logarithm
        },
        sign,
        low,
        high,
        reach: (low, high),
        lower: lower.min(upper),
        upper,
        time_power: 0.0,
    }
}

/// The axis of an effect's parameter: logarithmic for a scale, whose neutral value is not zero or whose range spans
/// decades.
pub(super) fn effect_axis(
    effect: &str,
    parameter: &Parameter,
    slot: usize,
    (low, high): (f64, f64),
) -> Result<Axis> {
    if !(low < high && high - low < f64::INFINITY) {
        let what = format!("range of {} of {effect}", parameter.name);
        return Err(Error::invalid(
            what,
            "a low and a higher end",
            format!("{low} to {high}"),
        ));
    }
    let (least, most) = parameter.allowed;
    let time_power = f64::from(parameter.time_power);
    let reach = parameter.reach.unwrap_or((low, high));
    let (near, far) = (reach.0.min(low), reach.1.max(high));
    if low > 0.0 && (parameter.neutral > 0.0 || high >= DECADES * low) {
        let (lower, upper) = allowed(low, high);
        return Ok(Axis {
            slot,
            shape: Shape::Logarithm,
            sign: 1.0,
            low,
            high,
            reach: (near, far),
            lower: lower.min(near).max(least),
            upper: upper.max(far).min(most),
            time_power,
        });
    }
    let width = high - low;
    let (low, high) = (low.min(parameter.neutral), high.max(parameter.neutral));
    Ok(Axis {
        slot,
        shape: Shape::Linear(width),
        sign: 1.0,
        low,
        high,
        reach: (near.min(low), far.max(high)),
        lower: (low - width).min(near).max(least),
        upper: (high + width).max(far).min(most),
        time_power,
    })
}
