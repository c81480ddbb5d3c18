//! What a fit may do to one parameter.

use std::f64::consts::FRAC_PI_2;

use super::problem::Problem;
use crate::effects::Parameter;
use crate::error::{Error, Result};
use crate::parameters::{FRICTION, GEAR_Y, MOST_SUBSTEPS, TIME};

/// How far beyond the ranges a fit may look, for a truth that lies a little outside.
const REACH: f64 = 3.0;
/// A logarithm needs a smallest value: this share of the largest that is allowed.
pub(super) const SMALLEST: f64 = 1e-4;
/// A size whose plausible values run over as large a factor is a scale.
const DECADES: f64 = 1e3;
/// Below this a timestep rounds to no physics update at all, and the marble never moves.
const SHORTEST_TIME_SCALE: f64 = 0.5;
/// The share of a right angle by which a fit may tilt the board at most.
const STEEPEST: f64 = 0.99;

/// What a coordinate does to its parameter.
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
    /// Beyond these it costs to go.
    pub(super) reach: (f64, f64),
    /// What it may take at most.
    pub(super) lower: f64,
    pub(super) upper: f64,
    /// With which power of the time scale the parameter changes along the first symmetry, of an effect's.
    pub(super) time_power: f64,
}

impl Axis {
    pub(super) fn half_width(&self) -> f64 {
        0.5 * (self.high - self.low)
    }

    pub(super) fn clip(&self, magnitude: f64) -> f64 {
        magnitude.clamp(self.lower, self.upper)
    }
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
    let (mut lower, mut upper) = (low / REACH, high * REACH);
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

/// The axis of an effect's parameter: a logarithm where it is a scale, whose neutral value is not zero or whose
/// plausible values run over decades.
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
        return Ok(Axis {
            slot,
            shape: Shape::Logarithm,
            sign: 1.0,
            low,
            high,
            reach: (near, far),
            lower: (low / REACH).min(near).max(least),
            upper: (high * REACH).max(far).min(most),
            time_power,
        });
    }
    let width = high - low;
    let beyond = (REACH - 1.0) / 2.0 * width;
    let (low, high) = (low.min(parameter.neutral), high.max(parameter.neutral));
    Ok(Axis {
        slot,
        shape: Shape::Linear(width),
        sign: 1.0,
        low,
        high,
        reach: (near.min(low), far.max(high)),
        lower: (low - beyond).min(near).max(least),
        upper: (high + beyond).max(far).min(most),
        time_power,
    })
}
