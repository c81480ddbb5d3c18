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

/// Normal distributions of the parameters.
pub(super) struct Prior<'a> {
    coordinates: &'a Coordinates,
    /// The coordinates of each map, which are drawn from one distribution about zero.
    maps: Vec<Vec<usize>>,
}

impl<'a> Prior<'a> {
    pub(super) fn new(coordinates: &'a Coordinates) -> Self {
        Self {
            coordinates,
            maps: coordinates.maps(),
        }
    }

    /// The largest spread of each map's coefficients, in coordinates.
    pub(super) fn widest(&self) -> Vec<f64> {
        self.maps.iter().map(|map| self.widest_of(map)).collect()
    }

    /// Coefficients are linear: their range is the same at any coordinates.
    fn widest_of(&self, map: &[usize]) -> f64 {
        self.coordinates.prior(&[], map[0]).1
    }

    /// Mean and standard deviation of each coordinate beside the others at z, where maps have these spreads.
    fn of(&self, z: &[f64], spreads: &[f64]) -> Vec<(f64, f64)> {
        let own = (0..z.len()).map(|i| self.coordinates.prior(z, i));
        let mut prior: Vec<(f64, f64)> = own.collect();
        for (map, &spread) in self.maps.iter().zip(spreads) {
            for &i in map {
                prior[i] = (0.0, spread);
            }
        }
        prior
    }

    /// Logarithm of the density at z, up to the terms of the widths alone.
    pub(super) fn log(&self, z: &[f64], spreads: &[f64]) -> f64 {
        let square = |(z, (mean, deviation)): (&f64, (f64, f64))| ((z - mean) / deviation).powi(2);
        -0.5 * z.iter().zip(self.of(z, spreads)).map(square).sum::<f64>()
    }

    /// Sum of the logarithms of the widths at z.
    pub(super) fn log_width(&self, z: &[f64], spreads: &[f64]) -> f64 {
        let prior = self.of(z, spreads);
        prior.iter().map(|(_, deviation)| deviation.ln()).sum()
    }

    /// Adds its part to slope and curvature at z.
    pub(super) fn add(&self, z: &[f64], spreads: &[f64], slope: &mut Slope) {
        let is_of_map = |i: &usize| self.maps.iter().any(|map| map.contains(i));
        for (i, (mean, deviation)) in self.of(z, spreads).into_iter().enumerate() {
            let off = (z[i] - mean) / deviation;
            if is_of_map(&i) {
                slope.curvature[(i, i)] += deviation.powi(-2);
                slope.uphill[i] -= off / deviation;
                continue;
            }
            let row = self.coordinates.prior_slope(z, i);
            for a in (0..z.len()).filter(|&a| row[a] != 0.0) {
                slope.uphill[a] -= row[a] * off;
                for b in 0..z.len() {
                    slope.curvature[(a, b)] += row[a] * row[b];
                }
            }
        }
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
            let wanted = (squares / known).sqrt().max(SMALLEST * self.widest_of(map));
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
