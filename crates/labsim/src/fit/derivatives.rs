//! Derivatives of predictions and of their variances: by finite differences, or carried along a step.

#![expect(
    clippy::inline_always,
    reason = "code that is not inlined into the dispatched function runs without its SIMD registers"
)]

use std::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix4, SVector};
use pulp::Arch;

use super::scoring::{Slope, Start, Step};
use super::windows::Windows;
use crate::engine::TAIL;
use crate::filter::{Rows, log_density};

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

/// Innovations of each observation of a window's marble and tilt, along axes that change. A first row that is the
/// start has none of the marble; other predictions may be no numbers, but are as many at all values.
pub(super) fn innovations_of<'a>(
    windows: &'a Windows,
    number: usize,
    rows: Rows<'a>,
) -> impl Iterator<Item = Innovation> + 'a {
    let window = &windows.all[number];
    let of_channels =
        move |places: Range<usize>, predicted: &'a [[f64; 2]], variance: &'a [[f64; 2]]| {
            let known = &windows.known[places.clone()];
            let observed = &windows.observed[places];
            let measured = (0..predicted.len()).flat_map(|row| [(row, 0), (row, 1)]);
            measured
                .filter(move |&(row, axis)| {
                    known[2 * row + axis] && (row > 0 || variance[row][axis].is_finite())
                })
                .map(move |(row, axis)| {
                    let off = observed[2 * row + axis] - predicted[row][axis];
                    (off, variance[row][axis])
                })
        };
    let of_kind = move |is_tilt: bool| {
        move |(off, variance): (f64, f64)| Innovation {
            window: number,
            off,
            variance,
            is_tilt,
        }
    };
    let marble = of_channels(window.marble(), rows.marble, rows.variance).map(of_kind(false));
    let tilt = of_channels(window.tilt(), rows.tilt, rows.tilt_variance).map(of_kind(true));
    marble.chain(tilt)
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
                let own = i * self.count..(i + 1) * self.count;
                kept.innovations.push(*one);
                kept.of_mean.extend(&self.of_mean[own.clone()]);
                kept.of_spread.extend(&self.of_spread[own]);
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
        for (
            i,
            &Innovation {
                window,
                off,
                variance,
                is_tilt: _,
            },
        ) in self.innovations.iter().enumerate()
        {
            let own = i * count..(i + 1) * count;
            let (of_mean, of_spread) = (&self.of_mean[own.clone()], &self.of_spread[own]);
            // The derivatives of Student's t: over the innovation, and over the logarithm of the variance.
            let weight = (TAIL + 1.0) / (TAIL * variance + off * off);
            let wider = 0.5 * (weight * off * off - 1.0);
            for (a, row) in curvature.chunks_exact_mut(count).enumerate() {
                uphill[a] += weight * off * of_mean[a] + wider * of_spread[a];
                add(&mut row[..=a], weight * of_mean[a], of_mean);
                add(&mut row[..=a], SPREAD * of_spread[a], of_spread);
            }
            let start = &mut starts[window];
            let of_state = SVector::from(self.of_state[i]);
            start.uphill += weight * off * of_state;
            start.curvature += weight * of_state * of_state.transpose();
            for (a, of_mean) in of_mean.iter().enumerate() {
                for c in 0..4 {
                    start.cross[(a, c)] += weight * of_mean * of_state[c];
                }
            }
        }
        (curvature, uphill, starts)
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
