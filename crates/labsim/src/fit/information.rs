//! Information of recordings about the parameters, to first order around a solution.
//!
//! The Jacobian of all residuals, with the start states eliminated, gives the changes of the parameters that
//! the recordings would show (Gauss-Newton theory). Its rows are weighted by the accuracy of the linearisation:
//! after an impact or a stop a small change may send the marble elsewhere, and such rows hold less information
//! than their slopes suggest.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::robust;
use super::shooting::{Point, Shooting};
use super::slopes::{Linearisation, Look};
use super::windows::{State, Windows};
use crate::error::Result;

/// Draws that check the linearisation, their maximum distance (in coordinates), and the tolerated error (in
/// scales).
const DRAWS: usize = 24;
const FURTHEST: f64 = 0.1;
const WORST: f64 = 5.0;
/// Physics updates more or less with which a row is simulated to see whether it depends on them.
const OTHER_UPDATES: [i32; 4] = [-2, -1, 1, 2];
/// Singular values of a window's slopes by its start state below this share of the largest count as zero.
const SMALLEST: f64 = 1e-9;

/// Information of recordings about the free parameters.
///
/// Directions are in units of the parameters' ranges, so that 1 is from one end to the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Information {
    /// The places of the free parameters among all: the five, then the effects' in order of naming.
    pub free: Vec<usize>,
    /// The widths of their ranges.
    pub widths: Vec<f64>,
    /// Orthonormal combinations of them, that of the largest singular value first.
    pub directions: Vec<Vec<f64>>,
    /// How much the weighted residuals (board edges) change along each direction.
    pub singular: Vec<f64>,
    /// The standard deviation along each direction, infinite if it is undetermined.
    pub deviation: Vec<f64>,
    /// From the solution to the linearised best fit along each direction; NaN if it is undetermined.
    pub offset: Vec<f64>,
    /// Degrees of freedom: effective residuals minus fitted values; at least one.
    pub degrees_of_freedom: f64,
    /// Robust standard deviation of the residuals (board edges).
    pub scale: f64,
}

impl Information {
    /// Covariance of the free parameters in their own units, over the directions whose deviation is below
    /// `flat` ranges.
    pub fn covariance(&self, flat: f64) -> Vec<Vec<f64>> {
        let known: Vec<usize> = (0..self.deviation.len())
            .filter(|&d| self.deviation[d] < flat)
            .collect();
        let entry = |i: usize, j: usize| {
            let along = |&d: &usize| {
                self.directions[d][i]
                    * self.directions[d][j]
                    * self.deviation[d]
                    * self.deviation[d]
            };
            known.iter().map(along).sum::<f64>() * self.widths[i] * self.widths[j]
        };
        let count = self.free.len();
        (0..count)
            .map(|i| (0..count).map(|j| entry(i, j)).collect())
            .collect()
    }

    /// The standard deviation of each free parameter in its own unit, infinite if it is undetermined.
    pub fn deviations(&self) -> Vec<f64> {
        let of_parameter = |i: usize| {
            let along = |(direction, deviation): (&Vec<f64>, &f64)| match direction[i] {
                share if share.abs() < 1e-9 => 0.0,
                share => (share * deviation).powi(2),
            };
            let variance: f64 = self.directions.iter().zip(&self.deviation).map(along).sum();
            variance.sqrt() * self.widths[i]
        };
        (0..self.free.len()).map(of_parameter).collect()
    }
}

/// A linearisation of the residuals at one solution.
struct Linear<'a> {
    shooting: &'a Shooting<'a>,
    point: &'a Point,
    line: Linearisation,
    scale: f64,
    /// Coordinates per unit of the ranges, and the ranges' widths.
    per_unit: DMatrix<f64>,
    widths: Vec<f64>,
}

/// A Gauss-Newton solution in units of the ranges.
struct Solved {
    /// A row each.
    directions: DMatrix<f64>,
    singular: DVector<f64>,
    deviation: Vec<f64>,
    offset: Vec<f64>,
    degrees_of_freedom: f64,
    /// Derivative of each window's start state by the coordinates.
    follow: Vec<DMatrix<f64>>,
    /// Derivative of the leans by the other coordinates.
    of_leans: DMatrix<f64>,
}

/// Weight of each residual's slope around a point, between 0 and 1.
pub(super) fn trust(
    shooting: &Shooting<'_>,
    point: &Point,
    line: &Linearisation,
    noise: f64,
) -> Result<Vec<f64>> {
    let linear = Linear::new(shooting, point, line.clone(), noise);
    linear.trust(&linear.solved(&linear.known()))
}

/// Linearises the residuals at a solution; they count with their own scale where `noise` is smaller.
pub(super) fn inform(shooting: &Shooting<'_>, point: &Point, noise: f64) -> Result<Information> {
    let line = shooting
        .linearise(std::slice::from_ref(point), Look::Careful, false)?
        .remove(0);
    let linear = Linear::new(shooting, point, line, noise);
    let known = linear.known();
    let trust = linear.trust(&linear.solved(&known))?;
    let weight: Vec<f64> = known
        .iter()
        .zip(trust)
        .map(|(known, trust)| known * trust)
        .collect();
    let solved = linear.solved(&weight);
    Ok(Information {
        free: shooting.coordinates.slots()[..shooting.coordinates.tail()].to_vec(),
        widths: linear.widths,
        directions: solved
            .directions
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect(),
        singular: solved.singular.iter().copied().collect(),
        deviation: solved.deviation,
        offset: solved.offset,
        degrees_of_freedom: solved.degrees_of_freedom,
        scale: linear.scale,
    })
}

impl<'a> Linear<'a> {
    fn new(shooting: &'a Shooting<'a>, point: &'a Point, line: Linearisation, noise: f64) -> Self {
        // Leans are no parameters: each recording has its own.
        let count = shooting.coordinates.tail();
        let mut widths = shooting.coordinates.widths();
        widths.truncate(count);
        let derivative = shooting.coordinates.derivative(&point.z);
        let per_z = DMatrix::from_fn(count, count, |i, j| derivative[i][j] / widths[i]);
        Self {
            shooting,
            point,
            scale: robust::scale(&line.residual, &shooting.windows.known).max(noise),
            line,
            per_unit: per_z
                .try_inverse()
                .unwrap_or_else(|| DMatrix::zeros(count, count)),
            widths,
        }
    }

    /// 1 where something was measured, else 0.
    fn known(&self) -> Vec<f64> {
        let known = self.shooting.windows.known.iter();
        known.map(|&known| f64::from(u8::from(known))).collect()
    }

    /// Solves with residuals weighted by weights of at most 1.
    fn solved(&self, weight: &[f64]) -> Solved {
        let windows = self.shooting.windows;
        let (rows, all) = (windows.len(), self.point.z.len());
        let count = self.shooting.coordinates.tail();
        let root: Vec<f64> = weight.iter().map(|weight| weight.sqrt()).collect();
        // Rows of zeros, so that there are as many singular values as parameters.
        let mut jacobian = DMatrix::zeros(rows + all, all);
        let mut follow = Vec::with_capacity(windows.all.len());
        for window in &windows.all {
            let own = window.marble();
            let of = |own: &Range<usize>, columns: &[Vec<f64>]| {
                DMatrix::from_fn(own.len(), columns.len(), |i, j| {
                    root[own.start + i] * columns[j][own.start + i]
                })
            };
            let (by_z, by_state) = (of(&own, &self.line.by_z), of(&own, &self.line.by_state));
            let inverse = pseudo_inverse(&by_state);
            let follows = -(inverse * &by_z);
            jacobian
                .rows_mut(own.start, own.len())
                .copy_from(&(by_z + by_state * &follows));
            let tilt = window.tilt();
            jacobian
                .rows_mut(tilt.start, tilt.len())
                .copy_from(&of(&tilt, &self.line.by_z));
            follow.push(follows);
        }
        let mut pull = DVector::zeros(rows + all);
        let (mut slopes, mut weights) = (0.0, 0.0);
        for (i, &residual) in self.line.residual.iter().enumerate() {
            let (psi, slope) = robust::influence(residual, self.scale);
            pull[i] = root[i] * psi;
            slopes += slope * weight[i];
            weights += weight[i];
        }
        let mean_slope = slopes / weights;
        let degrees_of_freedom = (weights - windows.unknowns() as f64 - count as f64).max(1.0);
        let variance = pull.norm_squared() / degrees_of_freedom / (mean_slope * mean_slope)
            * repetition(windows, pull.as_slice());
        // Shrunk coordinates have a prior precision.
        if !self.shooting.coordinates.groups().is_empty() {
            let precisions = self.shooting.coordinates.known_before();
            for (i, precision) in precisions.into_iter().enumerate() {
                let row = (precision * variance).sqrt();
                jacobian[(rows + i, i)] = row;
                pull[rows + i] = row * self.point.z[i] * mean_slope;
            }
        }
        let leans = jacobian.columns(count, all - count).into_owned();
        let of_leans = -(pseudo_inverse(&leans) * jacobian.columns(0, count));
        let jacobian = jacobian.columns(0, count) + leans * &of_leans;
        let svd = (jacobian * &self.per_unit).svd(true, true);
        let (left, directions) = (svd.u.unwrap_or_default(), svd.v_t.unwrap_or_default());
        let along = left.tr_mul(&pull);
        let per = |singular: f64, value: f64| value / singular;
        Solved {
            directions,
            deviation: svd
                .singular_values
                .iter()
                .map(|&singular| {
                    if singular > 0.0 {
                        per(singular, variance.sqrt())
                    } else {
                        f64::INFINITY
                    }
                })
                .collect(),
            offset: svd
                .singular_values
                .iter()
                .zip(&along)
                .map(|(&singular, &along)| -per(singular, along) / mean_slope)
                .collect(),
            singular: svd.singular_values,
            degrees_of_freedom,
            follow,
            of_leans,
        }
    }

    /// Weight of each residual's slope, between 0 and 1.
    ///
    /// Parameters are drawn from the uncertainty of the solution. The error of the linearisation there counts
    /// as noise, and so does the difference by a few physics updates more or less.
    fn trust(&self, solved: &Solved) -> Result<Vec<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let (mut points, mut foreseen) = (Vec::new(), Vec::new());
        for _ in 0..DRAWS {
            let draw = DVector::from_fn(solved.deviation.len(), |i, _| {
                let normal: f64 = StandardNormal.sample(&mut random);
                normal * solved.deviation[i].min(1.0 / f64::EPSILON)
            });
            let step = &self.per_unit * solved.directions.tr_mul(&draw);
            let leans = &solved.of_leans * &step;
            let step: Vec<f64> = step.iter().chain(&leans).copied().collect();
            let aim: Vec<f64> = self
                .point
                .z
                .iter()
                .zip(&step)
                .map(|(z, step)| z + step.clamp(-FURTHEST, FURTHEST))
                .collect();
            let z = self.shooting.coordinates.clip(&aim);
            let step = DVector::from_fn(z.len(), |i, _| z[i] - self.point.z[i]);
            let moves: Vec<DVector<f64>> =
                solved.follow.iter().map(|follow| follow * &step).collect();
            foreseen.push(self.foreseen(&step, &moves));
            let states = self.point.states.iter().zip(&moves);
            let states = states.map(|(state, moves)| {
                let mut moved: State = *state;
                moved
                    .iter_mut()
                    .zip(moves)
                    .for_each(|(state, moves)| *state += moves);
                moved
            });
            points.push(Point {
                states: states.collect(),
                z,
            });
        }
        let residuals = self.shooting.residuals(&points)?;
        let mut doubt = vec![0.0; self.line.residual.len()];
        for (residual, foreseen) in residuals.iter().zip(&foreseen) {
            self.add_doubt(&mut doubt, residual, Some(foreseen), DRAWS);
        }
        if !self.shooting.problem.is_stamped() {
            for more in OTHER_UPDATES {
                let points = std::slice::from_ref(self.point);
                let residual = self.shooting.residuals_with(points, more)?.remove(0);
                self.add_doubt(&mut doubt, &residual, None, OTHER_UPDATES.len());
            }
        }
        Ok(doubt.iter().map(|doubt| 1.0 / (1.0 + doubt)).collect())
    }

    /// The change of the residuals by the linearisation.
    fn foreseen(&self, step: &DVector<f64>, moves: &[DVector<f64>]) -> Vec<f64> {
        let mut change = vec![0.0; self.line.residual.len()];
        for (column, step) in self.line.by_z.iter().zip(step) {
            for (change, slope) in change.iter_mut().zip(column) {
                *change += slope * step;
            }
        }
        for (window, moves) in self.shooting.windows.all.iter().zip(moves) {
            for (column, step) in self.line.by_state.iter().zip(moves) {
                for i in window.marble() {
                    change[i] += column[i] * step;
                }
            }
        }
        change
    }

    /// Adds to the mean square error of the linearisation, in scales, bounded against rare large ones.
    fn add_doubt(
        &self,
        doubt: &mut [f64],
        residual: &[f64],
        foreseen: Option<&Vec<f64>>,
        count: usize,
    ) {
        for (i, doubt) in doubt.iter_mut().enumerate() {
            let error =
                residual[i] - self.line.residual[i] - foreseen.map_or(0.0, |change| change[i]);
            *doubt += (error / self.scale).powi(2).min(WORST * WORST) / count as f64;
        }
    }
}

/// Correlation length of residuals in rows: 1 for white noise, more for a model error.
///
/// One plus twice the sum of the autocorrelations, up to the first that noise alone could have: the
/// factor by which the variance of a mean of correlated values exceeds that of independent ones.
pub(super) fn repetition(windows: &Windows, pull: &[f64]) -> f64 {
    let total = pull
        .iter()
        .map(|pull| pull * pull)
        .sum::<f64>()
        .max(f64::MIN_POSITIVE);
    let counted = pull.iter().filter(|pull| **pull != 0.0).count().max(1);
    let by_chance = 2.0 / (counted as f64).sqrt();
    let mut factor = 1.0;
    for lag in 1..windows.rows {
        let mut sum = 0.0;
        for window in &windows.all {
            for own in [&pull[window.marble()], &pull[window.tilt()]] {
                sum += own
                    .iter()
                    .zip(own.iter().skip(2 * lag))
                    .map(|(a, b)| a * b)
                    .sum::<f64>();
            }
        }
        if sum / total < by_chance {
            break;
        }
        factor += 2.0 * sum / total;
    }
    factor
}

fn pseudo_inverse(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    if matrix.is_empty() {
        return DMatrix::zeros(matrix.ncols(), matrix.nrows());
    }
    let svd = matrix.clone().svd(true, true);
    let least = SMALLEST * svd.singular_values.max();
    svd.pseudo_inverse(least.max(f64::MIN_POSITIVE))
        .unwrap_or_else(|_| DMatrix::zeros(matrix.ncols(), matrix.nrows()))
}
