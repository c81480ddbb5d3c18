//! Derivatives of predictions and of their variances: by finite differences, or carried along a step.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use nalgebra::{DMatrix, DVector, Matrix4, SVector};
use pulp::Arch;

use super::scoring::{Slope, Start, Step};
use super::windows::Windows;
use crate::engine::TAIL;
use crate::filter::{Rows, log_density};

/// Innovations whose shares of the curvature are added at once.
const BLOCK: usize = 4;
/// Fisher's information in one innovation about the logarithm of its variance.
const SPREAD: f64 = 0.5 * TAIL / (TAIL + 3.0);

/// An observation minus its prediction, and the variance of the prediction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Innovation {
    pub(super) window: usize,
    pub(super) off: f64,
    pub(super) variance: f64,
    /// Whether it is the tilt's.
    pub(super) is_tilt: bool,
}

/// Appends innovations of each observation of a window's marble and tilt, along axes that change. A first row that is
/// the start has none of the marble; other predictions may be no numbers, but are as many at all values.
pub(super) fn append_innovations(
    to: &mut Vec<Innovation>,
    windows: &Windows,
    number: usize,
    rows: Rows<'_>,
) {
    let window = &windows.all[number];
    let channels = [
        (window.marble(), rows.marble, rows.variance, false),
        (window.tilt(), rows.tilt, rows.tilt_variance, true),
    ];
    for (places, predicted, variance, is_tilt) in channels {
        let known = windows.known[places.clone()].chunks_exact(2);
        let observed = windows.observed[places].chunks_exact(2);
        let of_rows = known.zip(observed).zip(predicted.iter().zip(variance));
        for (row, ((known, observed), (predicted, variance))) in of_rows.enumerate() {
            for axis in 0..2 {
                if known[axis] && (row > 0 || variance[axis].is_finite()) {
                    to.push(Innovation {
                        window: number,
                        off: observed[axis] - predicted[axis],
                        variance: variance[axis],
                        is_tilt,
                    });
                }
            }
        }
    }
}

/// Innovations after a step in which those of the tilt are from a larger step, of which they take a share.
///
/// The tilt of a board that follows its commands at once changes with a delay in steps of rows only.
pub(super) fn with_share_of_tilt(
    here: &[Innovation],
    moved: &[Innovation],
    farther: &[Innovation],
    share: f64,
) -> Vec<Innovation> {
    let of_each = |(here, (moved, farther)): (&Innovation, (&Innovation, &Innovation))| {
        if here.is_tilt {
            Innovation {
                off: here.off + share * (farther.off - here.off),
                ..*here
            }
        } else {
            *moved
        }
    };
    here.iter()
        .zip(moved.iter().zip(farther))
        .map(of_each)
        .collect()
}

/// Log-likelihood of observations.
pub(super) fn log_likelihood(innovations: &[Innovation]) -> f64 {
    let each = innovations.iter();
    each.map(|one| log_density(one.off, one.variance)).sum()
}

/// Derivatives of all innovations.
#[derive(Default)]
pub(super) struct Derivatives {
    /// The innovations at the point.
    innovations: Vec<Innovation>,
    /// Number of values and sizes.
    count: usize,
    /// Of the predictions over values and logarithms of sizes: `count` for each innovation.
    of_mean: Vec<f64>,
    /// Of the logarithms of the variances, likewise.
    of_spread: Vec<f64>,
    /// Of the predictions over the start state of their window.
    of_state: Vec<[f64; 4]>,
}

impl Derivatives {
    /// Finite differences: innovations at a point, after a step in each value and size, and after one in each
    /// component of all start states.
    pub(super) fn of(
        here: Vec<Innovation>,
        common: &[(Vec<Innovation>, f64)],
        states: &[(Vec<Innovation>, f64); 4],
    ) -> Self {
        let count = common.len();
        let size = here.len() * count;
        let (mut of_mean, mut of_spread) = (Vec::with_capacity(size), Vec::with_capacity(size));
        let mut of_state = Vec::with_capacity(here.len());
        for (i, one) in here.iter().enumerate() {
            of_mean.extend(
                common
                    .iter()
                    .map(|(moved, step)| (one.off - moved[i].off) / step),
            );
            let spread = |moved: &Innovation, step| (moved.variance / one.variance).ln() / step;
            of_spread.extend(common.iter().map(|(moved, step)| spread(&moved[i], step)));
            of_state.push(std::array::from_fn(|c| {
                let (moved, step) = &states[c];
                (one.off - moved[i].off) / step
            }));
        }
        Self {
            innovations: here,
            count,
            of_mean,
            of_spread,
            of_state,
        }
    }

    /// Those of some windows.
    pub(super) fn only(&self, is_kept: impl Fn(usize) -> bool) -> Self {
        let mut kept = Self {
            count: self.count,
            ..Self::default()
        };
        for (i, one) in self.innovations.iter().enumerate() {
            if is_kept(one.window) {
                let (of_mean, of_spread) = self.of_values(i);
                kept.innovations.push(*one);
                kept.of_mean.extend(of_mean);
                kept.of_spread.extend(of_spread);
                kept.of_state.push(self.of_state[i]);
            }
        }
        kept
    }

    /// Moves to other innovations after a step, with the least change of the derivatives that explains them
    /// (Broyden, "A class of methods for solving nonlinear simultaneous equations", 1965), in units of what the
    /// innovations resolve.
    pub(super) fn follow(&mut self, there: Vec<Innovation>, step: &Step, slope: &Slope) {
        let count = self.count;
        let weighed: Vec<f64> = (0..count)
            .map(|a| slope.curvature[(a, a)] * step.common[a])
            .collect();
        let length: f64 = weighed.iter().zip(&step.common).map(|(a, b)| a * b).sum();
        let starts: Vec<([f64; 4], f64)> = step
            .states
            .iter()
            .zip(&slope.starts)
            .map(|(state, start)| {
                let weighed: [f64; 4] = std::array::from_fn(|c| start.curvature[(c, c)] * state[c]);
                let own: f64 = weighed.iter().zip(state).map(|(a, b)| a * b).sum();
                (weighed, length + own)
            })
            .collect();
        for (i, (one, moved)) in self.innovations.iter().zip(&there).enumerate() {
            let own = i * count..(i + 1) * count;
            let (of_mean, of_spread) = (&mut self.of_mean[own.clone()], &mut self.of_spread[own]);
            let of_state = &mut self.of_state[i];
            let (of_start, whole) = &starts[one.window];
            let expected = dot(of_mean, &step.common) + dot(of_state, &step.states[one.window]);
            if *whole > 0.0 {
                let missed = (one.off - moved.off - expected) / whole;
                add(of_mean, missed, &weighed);
                add(of_state, missed, of_start);
            }
            if length > 0.0 {
                let wider = (moved.variance / one.variance).ln();
                add(
                    of_spread,
                    (wider - dot(of_spread, &step.common)) / length,
                    &weighed,
                );
            }
        }
        self.innovations = there;
    }

    /// Slope and curvature of the log-likelihood by Fisher's scoring: of predictions and of the logarithms of their
    /// variances.
    pub(super) fn slope(&self, windows: usize) -> Slope {
        // With the widest registers of the machine; sums have the same order in all of them.
        let (log_likelihood, count) = (log_likelihood(&self.innovations), self.count);
        let (curvature, uphill, starts) = Arch::new().dispatch(|| self.sums(windows));
        Slope {
            log_likelihood,
            curvature: DMatrix::from_fn(count, count, |a, b| {
                curvature[a.max(b) * count + a.min(b)]
            }),
            uphill,
            starts,
        }
    }

    /// Lower triangle of the curvature, slope, and those of the start states.
    #[inline(always)]
    fn sums(&self, windows: usize) -> (Vec<f64>, DVector<f64>, Vec<Start>) {
        let count = self.count;
        let mut curvature = vec![0.0; count * count];
        let mut uphill = DVector::zeros(count);
        let no_start = Start {
            curvature: Matrix4::zeros(),
            cross: DMatrix::zeros(count, 4),
            uphill: SVector::zeros(),
        };
        let mut starts = vec![no_start; windows];
        let mut weights = Vec::with_capacity(self.innovations.len());
        let mut weighed = vec![0.0; count];
        for (i, one) in self.innovations.iter().enumerate() {
            let (of_mean, of_spread) = self.of_values(i);
            // The derivatives of Student's t: over the innovation, and over the logarithm of the variance.
            let weight = (TAIL + 1.0) / (TAIL * one.variance + one.off * one.off);
            let wider = 0.5 * (weight * one.off * one.off - 1.0);
            let of_both = of_mean.iter().zip(of_spread);
            for (uphill, (of_mean, of_spread)) in uphill.iter_mut().zip(of_both) {
                *uphill += weight * one.off * of_mean + wider * of_spread;
            }
            let start = &mut starts[one.window];
            let of_state = SVector::from(self.of_state[i]);
            start.uphill += weight * one.off * of_state;
            start.curvature += weight * of_state * of_state.transpose();
            for (weighed, of_mean) in weighed.iter_mut().zip(of_mean) {
                *weighed = weight * of_mean;
            }
            let cross = start.cross.as_mut_slice().chunks_exact_mut(count.max(1));
            for (cross, of_state) in cross.zip(&self.of_state[i]) {
                add(cross, *of_state, &weighed);
            }
            weights.push(weight);
        }
        let whole = weights.len() - weights.len() % BLOCK;
        for first in (0..whole).step_by(BLOCK) {
            self.add_curvature::<BLOCK>(first, &weights, &mut curvature);
        }
        for i in whole..weights.len() {
            self.add_curvature::<1>(i, &weights, &mut curvature);
        }
        (curvature, uphill, starts)
    }

    /// Adds some innovations' share of the curvature, one after the other: a block is as many single ones, and loads
    /// and stores each sum once.
    #[inline(always)]
    fn add_curvature<const N: usize>(&self, first: usize, weights: &[f64], curvature: &mut [f64]) {
        let own: [_; N] = std::array::from_fn(|k| self.of_values(first + k));
        for (a, row) in curvature.chunks_exact_mut(self.count.max(1)).enumerate() {
            let row = &mut row[..=a];
            let factors: [_; N] = std::array::from_fn(|k| {
                let (of_mean, of_spread) = own[k];
                (weights[first + k] * of_mean[a], SPREAD * of_spread[a])
            });
            let own = own.map(|(of_mean, of_spread)| (&of_mean[..=a], &of_spread[..=a]));
            for (b, sum) in row.iter_mut().enumerate() {
                for ((of_mean, of_spread), (mean, spread)) in own.iter().zip(factors) {
                    *sum += mean * of_mean[b];
                    *sum += spread * of_spread[b];
                }
            }
        }
    }

    /// Derivatives of an innovation's prediction and of the logarithm of its variance over values and sizes.
    #[inline(always)]
    fn of_values(&self, i: usize) -> (&[f64], &[f64]) {
        let own = i * self.count..(i + 1) * self.count;
        (&self.of_mean[own.clone()], &self.of_spread[own])
    }
}

fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(a, b)| a * b).sum()
}

/// Adds a multiple of the first elements of another vector.
#[inline(always)]
fn add(to: &mut [f64], factor: f64, other: &[f64]) {
    for (to, other) in to.iter_mut().zip(other) {
        *to += factor * other;
    }
}
