//! Bounds of the coordinates, and the penalty outside the ranges.

use super::Coordinates;
use crate::fit::axis::{Axis, SMALLEST, Shape};
use crate::parameters::FRICTION;

/// Distance outside a range that is penalised like a residual of one standard deviation, as a share of the width of the
/// range ([`Axis::width`]); of ranges of magnitudes at most this relative distance.
const LEEWAY: f64 = 0.1;

fn leeway(axis: &Axis) -> f64 {
    match axis.shape {
        Shape::Linear(_) => LEEWAY,
        _ => LEEWAY * axis.width().min(1.0),
    }
}

impl Coordinates {
    /// Moves coordinates to the nearest allowed ones.
    pub(in crate::fit) fn clip(&self, z: &[f64]) -> Vec<f64> {
        let bounds = self.bounds(z);
        z.iter()
            .zip(bounds)
            .map(|(z, (low, high))| z.clamp(low, high))
            .collect()
    }

    /// Lowest and highest coordinates; the friction's depend on the gears at z.
    pub(in crate::fit) fn bounds(&self, z: &[f64]) -> Vec<(f64, f64)> {
        let plain = |axis: &Axis| match axis.shape {
            Shape::Logarithm => (axis.lower.ln(), axis.upper.ln()),
            Shape::Linear(unit) => (axis.lower / unit, axis.upper / unit),
            Shape::Friction => (f64::NEG_INFINITY, f64::INFINITY),
        };
        let mut bounds: Vec<(f64, f64)> = self.axes.iter().map(plain).collect();
        if let Some(i) = self.find(FRICTION) {
            let clipped: Vec<f64> = z
                .iter()
                .zip(&bounds)
                .map(|(z, (low, high))| z.clamp(*low, *high))
                .collect();
            let unit = self.friction_unit * self.gear(&clipped).max(f64::MIN_POSITIVE);
            bounds[i] = (self.axes[i].lower / unit, self.axes[i].upper / unit);
        }
        bounds
    }

    /// Distances of parameters outside their reach in units of their leeway, to be squared and halved like
    /// residuals. They keep a fit near the ranges where recordings hold no information.
    pub(in crate::fit) fn excess(&self, z: &[f64]) -> Vec<f64> {
        let magnitudes = self.magnitudes(z);
        let beyond = |(axis, &p): (&Axis, &f64)| {
            let (least, most) = axis.reach;
            if let Shape::Linear(unit) = axis.shape {
                return ((p - most).max(0.0) + (p - least).min(0.0)) / unit;
            }
            let past = |p: f64, end: f64| {
                if p > 0.0 && end > 0.0 {
                    (p / end).ln().max(0.0)
                } else {
                    0.0
                }
            };
            let p = p.max(f64::MIN_POSITIVE);
            past(p, most) - past(least, p)
        };
        let all = self.axes.iter().zip(&magnitudes);
        all.map(|of| beyond(of) / leeway(of.0)).collect()
    }

    /// The derivative of [`Coordinates::excess`]: a row for each excess.
    pub(in crate::fit) fn excess_slope(&self, z: &[f64]) -> Vec<Vec<f64>> {
        let excess = self.excess(z);
        let row = |i: usize| {
            let mut row = vec![0.0; self.len()];
            if excess[i] != 0.0 {
                if self.axes[i].shape == Shape::Friction {
                    row = self.gear_shares(z);
                    row[i] = 1.0 / z[i].max(SMALLEST);
                } else {
                    row[i] = 1.0;
                }
            }
            let leeway = leeway(&self.axes[i]);
            row.iter().map(|slope| slope / leeway).collect()
        };
        (0..self.len()).map(row).collect()
    }
}
