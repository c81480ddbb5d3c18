//! The measured channels: the marble's x and y, the tilt about x and y.
//!
//! Each channel has its own noise. Residuals are kept in units of one common scale (board edges): those of a
//! channel are multiplied by its weight, the common scale over the channel's. Model errors count as well as
//! sensor noise, so the weights follow the residuals as soon as there are any.

use super::problem::Problem;
use super::robust::{self, signal_noise};

/// Marble x, marble y, tilt x, tilt y.
pub(super) const CHANNELS: usize = 4;
/// The channels of the tilt.
pub(super) const TILT: std::ops::Range<usize> = 2..4;
pub(super) const MARBLE: std::ops::Range<usize> = 0..2;

/// Weights have converged when they change by less than this part: scales are known to a few percent.
const SETTLED: f64 = 0.05;

/// The channels of a problem, and how they count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Channels {
    /// Whether the measured values ever change. A constant channel is ignored.
    pub(super) active: [bool; CHANNELS],
    /// Standard deviations of the sensors (board edges, rad), given or from the recordings' own changes.
    pub(super) noise: [f64; CHANNELS],
    /// Common units over the channel's.
    pub(super) weights: [f64; CHANNELS],
    /// Lower bound of the scale of the residuals (common units).
    pub(super) floor: f64,
}

impl Channels {
    /// The channels of a problem, weighted by their sensors' noise; without tilt all weights are 1.
    pub(super) fn of(problem: &Problem<'_>) -> Self {
        let marble: Vec<&[[f64; 2]]> = problem
            .stretches
            .iter()
            .map(|stretch| problem.observed(stretch))
            .collect();
        let tilt: Vec<&[[f64; 2]]> = problem
            .stretches
            .iter()
            .filter_map(|stretch| problem.tilt(stretch))
            .collect();
        let mut active = [false; CHANNELS];
        active[MARBLE].copy_from_slice(&robust::changes(&marble));
        // A marble that never moves still shows that it rests.
        if !active[0] && !active[1] {
            let seen = marble.iter().copied().flatten();
            active[MARBLE].fill(seen.flatten().any(|one| one.is_finite()));
        }
        active[TILT].copy_from_slice(&robust::changes(&tilt));
        let mut channels = Self {
            active,
            noise: [1.0; CHANNELS],
            weights: [1.0; CHANNELS],
            floor: 1.0,
        };
        if channels.has_marble() {
            channels.floor = problem.tracker_noise();
            channels.noise[MARBLE].fill(channels.floor);
        }
        if !channels.has_tilt() {
            return channels;
        }
        for axis in 0..2 {
            let of_axis = |all: &[&[[f64; 2]]]| -> Vec<Vec<f64>> {
                let one = |rows: &&[[f64; 2]]| rows.iter().map(|row| row[axis]).collect();
                all.iter().map(one).collect()
            };
            if problem.noise.is_none() && channels.active[axis] {
                channels.noise[axis] = signal_noise(&of_axis(&marble));
            }
            channels.noise[2 + axis] = problem
                .tilt_noise
                .unwrap_or_else(|| signal_noise(&of_axis(&tilt)));
        }
        let common = if channels.has_marble() {
            problem.tracker_noise()
        } else {
            channels.common(channels.noise)
        };
        channels.weighted(common, channels.noise)
    }

    pub(super) fn has_marble(&self) -> bool {
        self.active[MARBLE].contains(&true)
    }

    pub(super) fn has_tilt(&self) -> bool {
        self.active[TILT].contains(&true)
    }

    /// Number of axes of the marble in use.
    pub(super) fn marble_axes(&self) -> usize {
        self.active[MARBLE].iter().filter(|active| **active).count()
    }

    /// Whether other weights are nearly the same.
    pub(super) fn is_settled(&self, other: &Self) -> bool {
        let same = |(one, other): (&f64, &f64)| (one / other).ln().abs() < SETTLED;
        self.weights.iter().zip(&other.weights).all(same)
    }

    /// Weights by the channels' scales, in units of a common one.
    pub(super) fn weighted(mut self, common: f64, scales: [f64; CHANNELS]) -> Self {
        self.floor = f64::INFINITY;
        for (channel, scale) in scales.into_iter().enumerate() {
            if self.active[channel] {
                self.weights[channel] = common / scale;
                let floor = self.weights[channel] * self.noise[channel];
                self.floor = self.floor.min(floor);
            }
        }
        self
    }

    /// The root mean square of scales: the marble's, or the tilt's where there is none.
    pub(super) fn common(&self, scales: [f64; CHANNELS]) -> f64 {
        let own = if self.has_marble() { MARBLE } else { TILT };
        let squares: Vec<f64> = own
            .filter(|&channel| self.active[channel])
            .map(|channel| scales[channel] * scales[channel])
            .collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }
}
