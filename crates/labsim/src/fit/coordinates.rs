//! The coordinates of a fit. In logarithms the symmetries of the motion are straight lines.
//!
//! Two families of changes leave a recording of the five parameters as it is, the first without
//! damping, the second until a wall is met:
//!
//! - `gear_x`, `gear_y` and `rolling_friction` times L, `time_scale` divided by √L, and effects' times,
//!   speeds, pushes and tilts with it ([`crate::effects::Parameter::time_power`]);
//! - `observation_scale` times r, `gear_x`, `gear_y` and `rolling_friction` divided by r.
//!
//! With logarithms of the gears and the two scales, and the friction relative to the gears, both are
//! straight lines of constant friction coordinate. Where recordings do not distinguish the members of a
//! family, the loss has a straight valley, and steps of equal size are equal relative changes.
//! Effects' parameters are logarithmic if they are scales, and otherwise in units of their ranges.

mod bounds;
mod shrunk;

pub(super) use self::shrunk::Group;
use self::shrunk::groups_of_effects;
use super::axis::{Axis, SMALLEST, Shape, base_axis, effect_axis};
use super::problem::{ParameterSpec, Problem};
use crate::error::Result;
use crate::parameters::{FRICTION, GEAR_X, GEAR_Y, SCALE, TIME};

/// The map between values (the five parameters and then the effects', in their own units) and the
/// coordinates z of the free ones.
#[derive(Debug, Clone)]
pub(super) struct Coordinates {
    axes: Vec<Axis>,
    /// All values: those of the problem, then the leans of all recordings if they are estimated.
    held: Vec<f64>,
    /// Friction over root-mean-square gear at which its coordinate is 1.
    friction_unit: f64,
    /// The groups that are shrunk towards zero.
    groups: Vec<Group>,
    /// Index of the first lean among the axes, and number of the problem's own values.
    tail: usize,
    own: usize,
}

impl Coordinates {
    /// The coordinates of a problem; `senses` is the sign of each gear.
    pub(super) fn new(problem: &Problem<'_>, senses: [f64; 2]) -> Result<Self> {
        let mut held = Vec::new();
        let mut axes: Vec<Axis> = Vec::new();
        let lean = problem.lean();
        for (slot, sought) in problem.sought().enumerate() {
            held.push(match sought {
                ParameterSpec::Held(value) => value,
                ParameterSpec::Free {
                    range: (low, _), ..
                } => low,
            });
            if lean.as_ref().is_some_and(|lean| lean.contains(&slot)) {
                held[slot] = 0.0;
                continue;
            }
            let ParameterSpec::Free { range, .. } = sought else {
                continue;
            };
            let axis = match problem.effect_parameter(slot) {
                None => base_axis(problem, slot, range, senses),
                Some((effect, parameter)) => effect_axis(effect, parameter, slot, range)?,
            };
            if axis.lower < axis.upper {
                axes.push(axis);
            } else {
                held[slot] = axis.sign * axis.lower;
            }
        }
        let groups = groups_of_effects(problem, &axes);
        let mut coordinates = Self {
            tail: axes.len(),
            own: held.len(),
            axes,
            held,
            friction_unit: 1.0,
            groups,
        };
        if let Some(slots) = lean {
            coordinates.add_leans(problem, slots.start)?;
        }
        let largest = |slot: usize| match coordinates.find(slot) {
            Some(i) => coordinates.axes[i].upper,
            None => coordinates.held[slot].abs(),
        };
        let gear = rms(largest(GEAR_X), largest(GEAR_Y)).max(f64::MIN_POSITIVE);
        coordinates.friction_unit = largest(FRICTION).max(SMALLEST * gear) / gear;
        Ok(coordinates)
    }

    /// The first coordinate of the leans: a pair for each recording from there on.
    pub(super) fn tail(&self) -> usize {
        self.tail
    }

    /// The lean of a recording among all values, if it is estimated.
    pub(super) fn lean(&self, recording: usize) -> Option<std::ops::Range<usize>> {
        let begin = self.own + 2 * recording;
        (begin + 2 <= self.held.len()).then_some(begin..begin + 2)
    }

    /// The values of the problem itself, without the leans.
    pub(super) fn own<'a>(&self, values: &'a [f64]) -> &'a [f64] {
        &values[..self.own]
    }

    /// Parameters a coordinate.
    pub(super) fn unit(&self, i: usize) -> f64 {
        match self.axes[i].shape {
            Shape::Linear(unit) => unit,
            _ => 1.0,
        }
    }

    /// Standard deviation of a coordinate that lies anywhere in its range.
    pub(super) fn spread_of_range(&self, i: usize) -> f64 {
        let axis = &self.axes[i];
        let width = match axis.shape {
            Shape::Logarithm => (axis.high / axis.low.max(axis.lower)).ln(),
            Shape::Friction => 1.0,
            Shape::Linear(unit) => (axis.high - axis.low) / unit,
        };
        width / 12f64.sqrt()
    }

    /// Mean and standard deviation of each coordinate where its parameter lies anywhere in its range.
    pub(super) fn prior(&self) -> Vec<(f64, f64)> {
        let middle = |axis: &Axis| match axis.shape {
            Shape::Logarithm => 0.5 * (axis.high.ln() + axis.low.max(axis.lower).ln()),
            Shape::Friction => 0.5,
            Shape::Linear(unit) => 0.5 * (axis.high + axis.low) / unit,
        };
        let of = |(i, axis)| (middle(axis), self.spread_of_range(i));
        self.axes.iter().enumerate().map(of).collect()
    }

    /// The value of a linear coordinate.
    pub(super) fn value(&self, z: &[f64], i: usize) -> f64 {
        z[i] * self.unit(i)
    }

    /// Whether two coordinates are leans of different recordings, which no residual ties together.
    pub(super) fn are_apart(&self, i: usize, j: usize) -> bool {
        i.min(j) >= self.tail && (i - self.tail) / 2 != (j - self.tail) / 2
    }

    /// How many coordinates there are.
    pub(super) fn len(&self) -> usize {
        self.axes.len()
    }

    /// The coordinate of a parameter, if it is free.
    pub(super) fn find(&self, slot: usize) -> Option<usize> {
        self.axes.iter().position(|axis| axis.slot == slot)
    }

    /// The places of the free parameters among all values.
    pub(super) fn slots(&self) -> Vec<usize> {
        self.axes.iter().map(|axis| axis.slot).collect()
    }

    /// Coordinates of values, clamped to the bounds.
    pub(super) fn to_z(&self, values: &[f64]) -> Vec<f64> {
        let clipped = |slot: usize| match self.find(slot) {
            Some(i) => {
                let value = values.get(slot).copied().unwrap_or(0.0);
                self.axes[i].clip(value * self.axes[i].sign)
            }
            None => self.held[slot].abs(),
        };
        let gear = rms(clipped(GEAR_X), clipped(GEAR_Y));
        let coordinate = |axis: &Axis| match axis.shape {
            Shape::Logarithm => clipped(axis.slot).ln(),
            Shape::Friction => {
                clipped(axis.slot) / (self.friction_unit * gear.max(f64::MIN_POSITIVE))
            }
            Shape::Linear(unit) => clipped(axis.slot) / unit,
        };
        self.axes.iter().map(coordinate).collect()
    }

    /// All values at coordinates, within the bounds.
    pub(super) fn to_values(&self, z: &[f64]) -> Vec<f64> {
        let mut values = self.held.clone();
        for (axis, magnitude) in self.axes.iter().zip(self.magnitudes(z)) {
            values[axis.slot] = axis.sign * axis.clip(magnitude);
        }
        values
    }

    /// Coordinates after a step along the direction in which the slope of one of them is taken.
    ///
    /// The time scale and the observation scale move along the symmetries of the motion: differences along
    /// single coordinates would each see other stops and impacts, and their jumps would not cancel along a
    /// symmetry, which changes nothing. The gears move without the friction, so that a gear without any
    /// influence has no slope.
    pub(super) fn shifted(&self, z: &[f64], i: usize, step: f64) -> Vec<f64> {
        let mut shifted = z.to_vec();
        shifted[i] += step;
        if self.axes[i].slot <= GEAR_Y
            && let Some(friction) = self.find(FRICTION)
        {
            shifted[friction] *= self.gear(z) / self.gear(&shifted);
        }
        for (other, rate) in self.symmetry(i) {
            match self.axes[other].shape {
                Shape::Linear(_) => shifted[other] *= (rate * step).exp(),
                _ => shifted[other] += rate * step,
            }
        }
        shifted
    }

    /// The other coordinates that move along that direction, and their rates.
    pub(super) fn along(&self, z: &[f64], i: usize) -> Vec<(usize, f64)> {
        match self.find(FRICTION) {
            Some(friction) if self.axes[i].slot <= GEAR_Y => {
                vec![(friction, -self.gear_shares(z)[i] * z[friction])]
            }
            _ => {
                let rate_of = |(other, rate): (usize, f64)| match self.axes[other].shape {
                    Shape::Linear(_) => (other, rate * z[other]),
                    _ => (other, rate),
                };
                self.symmetry(i).into_iter().map(rate_of).collect()
            }
        }
    }

    /// The coordinates that move along a symmetry with one of the scales, and their powers of it.
    fn symmetry(&self, i: usize) -> Vec<(usize, f64)> {
        let (Some(x), Some(y)) = (self.find(GEAR_X), self.find(GEAR_Y)) else {
            return Vec::new();
        };
        match self.axes[i].slot {
            TIME => {
                let of_effects = self.axes.iter().map(|axis| axis.time_power).enumerate();
                let moved = of_effects.filter(|(_, power)| *power != 0.0);
                [(x, -2.0), (y, -2.0)].into_iter().chain(moved).collect()
            }
            SCALE => vec![(x, -1.0), (y, -1.0)],
            _ => Vec::new(),
        }
    }

    /// Moves coordinates along the first symmetry until their time scale is this one.
    pub(super) fn along_time(&self, z: &[f64], time_scale: f64) -> Option<Vec<f64>> {
        let time = self.find(TIME)?;
        Some(self.shifted(z, time, time_scale.ln() - z[time]))
    }

    /// The lowest and highest time scale allowed, if it is free.
    pub(super) fn time_scales(&self) -> Option<(f64, f64)> {
        self.find(TIME)
            .map(|i| (self.axes[i].lower, self.axes[i].upper))
    }

    /// Values from the ends of the ranges: 0 is the low end, 1 the high one.
    pub(super) fn drawn(&self, place: &[f64]) -> Vec<f64> {
        let mut values = self.held.clone();
        let drawn = (0..self.len()).filter(|&i| !self.is_shrunk(i));
        for (i, place) in drawn.zip(place) {
            let axis = &self.axes[i];
            values[axis.slot] = axis.sign * (axis.low + place * (axis.high - axis.low));
        }
        for &i in self.groups.iter().flat_map(|group| &group.axes) {
            values[self.axes[i].slot] = 0.0;
        }
        values
    }

    /// The coordinate of a parameter at a relative position in its range, 0 to 1.
    pub(super) fn within(&self, i: usize, place: f64) -> f64 {
        let axis = &self.axes[i];
        let value = axis.clip(axis.low + place * (axis.high - axis.low));
        match axis.shape {
            Shape::Linear(unit) => value / unit,
            _ => value.ln(),
        }
    }

    /// Change of a coordinate for a change of its parameter.
    pub(super) fn per_unit(&self, i: usize, change: f64) -> f64 {
        match self.axes[i].shape {
            Shape::Linear(unit) => change / unit,
            _ => change,
        }
    }

    /// The derivatives of the free values by the coordinates, a row for each value; bounds are
    /// ignored.
    pub(super) fn derivative(&self, z: &[f64]) -> Vec<Vec<f64>> {
        let magnitudes = self.magnitudes(z);
        let row = |i: usize| {
            let axis = &self.axes[i];
            let mut row = vec![0.0; self.len()];
            match axis.shape {
                Shape::Logarithm => row[i] = magnitudes[i],
                Shape::Linear(unit) => row[i] = unit,
                Shape::Friction => {
                    row = self.gear_shares(z);
                    for share in &mut row {
                        *share *= magnitudes[i];
                    }
                    row[i] = self.friction_unit * self.gear(z);
                }
            }
            row.iter().map(|slope| axis.sign * slope).collect()
        };
        (0..self.len()).map(row).collect()
    }

    /// The widths of the free parameters' ranges.
    pub(super) fn widths(&self) -> Vec<f64> {
        let width = |axis: &Axis| axis.high - axis.low;
        self.axes.iter().map(width).collect()
    }

    fn magnitudes(&self, z: &[f64]) -> Vec<f64> {
        let gear = self.gear(z);
        let magnitude = |(axis, &z): (&Axis, &f64)| match axis.shape {
            Shape::Logarithm => z.exp(),
            Shape::Friction => z * self.friction_unit * gear,
            Shape::Linear(unit) => z * unit,
        };
        self.axes.iter().zip(z).map(magnitude).collect()
    }

    fn gear_of(&self, slot: usize, z: &[f64]) -> f64 {
        self.find(slot)
            .map_or(self.held[slot].abs(), |i| z[i].exp())
    }

    /// The root mean square of the two gears, which stays positive when one of them vanishes.
    fn gear(&self, z: &[f64]) -> f64 {
        rms(self.gear_of(GEAR_X, z), self.gear_of(GEAR_Y, z))
    }

    /// The derivatives of the logarithm of the gear.
    fn gear_shares(&self, z: &[f64]) -> Vec<f64> {
        let mut shares = vec![0.0; self.len()];
        let squares = [GEAR_X, GEAR_Y].map(|slot| self.gear_of(slot, z).powi(2));
        for (slot, square) in [GEAR_X, GEAR_Y].into_iter().zip(squares) {
            if let Some(i) = self.find(slot) {
                shares[i] = square / (squares[0] + squares[1]);
            }
        }
        shares
    }
}

fn rms(a: f64, b: f64) -> f64 {
    (0.5 * (a * a + b * b)).sqrt()
}

#[cfg(test)]
mod tests;
