//! Priors of the values: plausible ranges, and maps with an estimated spread.

use super::coordinates::Coordinates;
use super::scoring::Slope;

/// Maximum factor by which the spread of a map's coefficients changes in a step.
const FARTHEST: f64 = 3.0;
/// Its lower bound, as a share of the largest spread.
const SMALLEST: f64 = 1e-3;
/// It has converged when it changes by less than this share.
const SETTLED: f64 = 0.05;
/// Lower bound of the number of determined coefficients: zero would make the spread infinite.
const KNOWN: f64 = 1e-3;

/// Normal distributions of coordinates.
pub(super) struct Prior {
    /// Mean and standard deviation of each coordinate where its parameter lies anywhere in its range.
    ranges: Vec<(f64, f64)>,
    /// The coordinates of each map, which are drawn from one distribution about zero.
    maps: Vec<Vec<usize>>,
}

impl Prior {
    pub(super) fn new(coordinates: &Coordinates) -> Self {
        Self {
            ranges: coordinates.prior(),
            maps: coordinates.maps(),
        }
    }

    /// The largest spread of each map's coefficients, in coordinates.
    pub(super) fn widest(&self) -> Vec<f64> {
        self.maps.iter().map(|map| self.ranges[map[0]].1).collect()
    }

    /// Mean and standard deviation of each coordinate, where maps have these spreads.
    pub(super) fn of(&self, spreads: &[f64]) -> Vec<(f64, f64)> {
        let mut prior = self.ranges.clone();
        for (map, &spread) in self.maps.iter().zip(spreads) {
            for &i in map {
                prior[i] = (0.0, spread);
            }
        }
        prior
    }

    /// Updates the spreads of maps from a normal posterior about coordinates, and the posterior with them; returns
    /// whether they have converged.
    ///
    /// The fixed point is the spread of the highest evidence (`MacKay`, "Bayesian interpolation", 1992, eq. 4.7).
    pub(super) fn respread(&self, z: &[f64], spreads: &mut [f64], slope: &mut Slope) -> bool {
        if self.maps.is_empty() {
            return true;
        }
        let Some(posterior) = slope.without_starts(0.0).0.cholesky() else {
            return true;
        };
        let posterior = posterior.inverse();
        let mut settled = true;
        for (map, spread) in self.maps.iter().zip(spreads) {
            let squares: f64 = map.iter().map(|&i| z[i].powi(2)).sum();
            let unknown: f64 = map.iter().map(|&i| posterior[(i, i)]).sum();
            let known = (map.len() as f64 - unknown / spread.powi(2)).max(KNOWN);
            let wanted = (squares / known)
                .sqrt()
                .max(SMALLEST * self.ranges[map[0]].1);
            let now = wanted.clamp(*spread / FARTHEST, *spread * FARTHEST);
            settled &= (now / *spread - 1.0).abs() < SETTLED;
            let more = now.powi(-2) - spread.powi(-2);
            for &i in map {
                slope.curvature[(i, i)] += more;
                slope.uphill[i] -= more * z[i];
            }
            *spread = now;
        }
        settled
    }
}
