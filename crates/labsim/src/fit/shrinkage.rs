//! Empirical Bayes for coordinates with a common normal prior about zero: the leans of runs, the slopes of a map.
//!
//! Their size, the standard deviation of that distribution, is estimated from the recordings (empirical Bayes:
//! Gelman et al., Bayesian Data Analysis, 3rd ed., ch. 5; `MacKay`, Neural Computation 4, 1992). Around a solution
//! the likelihood of the coordinates is normal, so the evidence of every size has a closed form. It is evaluated
//! on a grid of sizes, so that a fit cannot get stuck at zero. Correlated residuals count by their effective
//! number, so that a model error does not pass for information.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::coordinates::Coordinates;
use super::information::{repetition, trust};
use super::normal::Normal;
use super::robust;
use super::shooting::{Point, Shooting};
use super::slopes::Look;
use crate::error::Result;

/// Number of sizes in the grid, and its decades below the largest size.
const SIZES: usize = 400;
const DECADES: f64 = 3.0;
/// The largest size, over the half width of a coefficient's range.
const LARGEST: f64 = 3.0;
/// Lower bound of a coefficient's standard deviation (rad): stops and impacts that move by a physics update make the
/// loss rough, and a spirit level does not resolve less.
const FINEST: f64 = 5e-5;
/// A group is zero unless the log evidence of its size exceeds that of zero by this: the 95 % point of what noise
/// gives, half of which is exactly zero (Self, Liang, J. American Statistical Association 82, 1987).
const EVIDENT: f64 = 1.353;
/// Half of the 95 % point of the squared normal: how far the log evidence falls to the ends of an interval.
const FALL: f64 = 1.921;
/// Sizes have converged when they change by less than this part.
const SETTLED: f64 = 0.05;

/// Estimated size and coefficients of a group that is shrunk towards zero.
#[derive(Debug, Clone, PartialEq)]
pub struct Shrunk {
    /// Their effect.
    pub effect: &'static str,
    /// Estimated standard deviation of their distribution; zero without evidence in the recordings.
    pub size: f64,
    /// Its 95 % interval, by the profile of the evidence.
    pub interval: [f64; 2],
    /// By how much the log evidence of the best size exceeds that of zero.
    pub gain: f64,
    /// Effective number of coefficients that the recordings determine, and their total number.
    pub effective: f64,
    /// The coefficients; for leans a pair for each recording.
    pub values: Vec<f64>,
    /// Their posterior standard deviations.
    pub deviations: Vec<f64>,
}

/// Evidence of the size of one group.
#[derive(Debug, Clone)]
pub(super) struct Evidence {
    best: f64,
    interval: [f64; 2],
    gain: f64,
    /// Number of correlated residuals per independent one.
    pub(super) repetition: f64,
    /// The likelihood's precision of the coefficients, along its own directions.
    precision: DVector<f64>,
    directions: DMatrix<f64>,
}

impl Evidence {
    /// The size for the next iteration: zero unless there is evidence of one.
    pub(super) fn size(&self) -> f64 {
        if self.gain > EVIDENT { self.best } else { 0.0 }
    }

    /// The result for a group that was fitted with a size.
    pub(super) fn report(&self, coordinates: &Coordinates, group: usize, z: &[f64]) -> Shrunk {
        let own = &coordinates.groups()[group];
        let size = own.size;
        let variance = |&precision: &f64| size * size / (1.0 + precision * size * size);
        let variances: Vec<f64> = self.precision.iter().map(variance).collect();
        let deviation = |i: usize| {
            let along = self.directions.row(i);
            let parts = along.iter().zip(&variances);
            parts
                .map(|(share, variance)| share * share * variance)
                .sum::<f64>()
                .sqrt()
        };
        let effective = self.precision.iter().zip(&variances);
        let of = |&i: &usize| {
            if size > 0.0 {
                coordinates.value(z, i)
            } else {
                0.0
            }
        };
        Shrunk {
            effect: own.effect,
            size,
            interval: self.interval,
            gain: self.gain,
            effective: effective
                .map(|(precision, variance)| precision * variance)
                .sum(),
            values: own.axes.iter().map(of).collect(),
            deviations: (0..own.axes.len()).map(deviation).collect(),
        }
    }
}

/// Evidence of the sizes of all groups, linearised at a point; residuals count with their own scale if `noise` is
/// smaller.
pub(super) fn evidence(
    shooting: &Shooting<'_>,
    point: &Point,
    noise: f64,
) -> Result<Vec<Evidence>> {
    let (coordinates, windows) = (shooting.coordinates, shooting.windows);
    if coordinates.groups().is_empty() {
        return Ok(Vec::new());
    }
    let points = std::slice::from_ref(point);
    let line = shooting.linearise(points, Look::Both, false)?.remove(0);
    let scale = robust::scale(&line.residual, &windows.known).max(noise);
    let pull: Vec<f64> = line
        .residual
        .iter()
        .map(|&residual| robust::influence(residual, scale).0)
        .collect();
    let repetition = repetition(windows, &pull);
    let trust = trust(shooting, point, &line, noise)?;
    let (matrix, gradient) = Normal::likelihood(&line, windows, coordinates, scale, &trust);
    let prior = coordinates.precisions();
    let of_group = |group: usize| {
        let own = &coordinates.groups()[group].axes;
        let others: Vec<usize> = (0..point.z.len())
            .filter(|&i| !own.contains(&i) && !coordinates.is_held(i))
            .collect();
        let part = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| {
                matrix[(rows[i], columns[j])]
            })
        };
        // Changes that the other coordinates can absorb within their ranges are no evidence. Without the ranges they
        // could absorb everything: pushes of any size look the same at another observation scale.
        let mut of_others = part(&others, &others);
        let largest = of_others.diagonal().amax().max(f64::MIN_POSITIVE);
        for (i, &other) in others.iter().enumerate() {
            let range = repetition / coordinates.spread_of_range(other).powi(2);
            of_others[(i, i)] += prior[other] + range + 1e-9 * largest;
        }
        let pulled = DVector::from_fn(others.len(), |i, _| {
            gradient[others[i]] + prior[others[i]] * point.z[others[i]]
        });
        let across = part(&others, own);
        let inverse = of_others
            .try_inverse()
            .unwrap_or_else(|| DMatrix::zeros(others.len(), others.len()));
        let taken = across.tr_mul(&inverse);
        let schur = part(own, own) - &taken * &across;
        let slope = DVector::from_fn(own.len(), |i, _| gradient[own[i]]) - &taken * pulled;
        let z = DVector::from_fn(own.len(), |i, _| point.z[own[i]]);
        let pull = (&schur * z - slope) / repetition;
        let units = own.iter().map(|&i| coordinates.unit(i));
        let units = DVector::from_iterator(own.len(), units);
        let precision = DMatrix::from_fn(own.len(), own.len(), |i, j| {
            0.5 * (schur[(i, j)] + schur[(j, i)]) / (repetition * units[i] * units[j])
        });
        profile(
            precision,
            &pull.component_div(&units),
            largest_size(coordinates, own),
            repetition,
        )
    };
    Ok((0..coordinates.groups().len()).map(of_group).collect())
}

fn largest_size(coordinates: &Coordinates, own: &[usize]) -> f64 {
    let widths = coordinates.widths();
    let widest = own.iter().map(|&i| widths[i]).fold(0.0, f64::max);
    LARGEST * 0.5 * widest
}

/// The evidence of all sizes of coefficients, given the precision of their likelihood and its pull from zero.
fn profile(
    precision: DMatrix<f64>,
    pull: &DVector<f64>,
    largest: f64,
    repetition: f64,
) -> Evidence {
    let SymmetricEigen {
        eigenvectors: directions,
        eigenvalues,
    } = SymmetricEigen::new(precision);
    let rough = eigenvalues.map(|value| 1.0 + value.max(0.0) * FINEST * FINEST);
    let precision = eigenvalues
        .map(|value| value.max(0.0))
        .component_div(&rough);
    let along = directions.tr_mul(pull).component_div(&rough);
    let log_evidence = |size: f64| -> f64 {
        let variance = size * size;
        let of_direction = |(precision, along): (&f64, &f64)| {
            let widening = 1.0 + variance * precision;
            0.5 * (variance * along * along / widening - widening.ln())
        };
        precision.iter().zip(&along).map(of_direction).sum()
    };
    let size =
        |i: usize| largest * 10f64.powf(-DECADES * (SIZES - 1 - i) as f64 / (SIZES - 1) as f64);
    let all: Vec<(f64, f64)> = (0..SIZES)
        .map(|i| (size(i), log_evidence(size(i))))
        .collect();
    let (best, most) =
        all.iter().copied().fold(
            (0.0, 0.0),
            |best, one| if one.1 > best.1 { one } else { best },
        );
    let inside = |one: &&(f64, f64)| one.1 >= most - FALL;
    let low = if most <= FALL {
        0.0
    } else {
        all.iter().find(inside).map_or(0.0, |one| one.0)
    };
    let high = all.iter().rev().find(inside).map_or(size(0), |one| one.0);
    Evidence {
        best,
        interval: [low, high],
        gain: most,
        repetition,
        precision,
        directions,
    }
}

/// Whether sizes have converged.
pub(super) fn is_settled(before: &[f64], after: &[f64]) -> bool {
    let same = |(before, after): (&f64, &f64)| {
        before == after || *before > 0.0 && *after > 0.0 && (after / before).ln().abs() < SETTLED
    };
    before.iter().zip(after).all(same)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Coefficients of a size, each measured alone with a standard deviation of 1.
    fn measured(size: f64, count: usize, seed: u64) -> Evidence {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let seen = DVector::from_fn(count, |_, _| size * normal() + normal());
        profile(DMatrix::identity(count, count), &seen, 100.0, 1.0)
    }

    #[test]
    fn the_interval_of_the_size_holds_it() {
        for size in [0.0, 0.5, 3.0] {
            let held = |seed: &u64| {
                let [low, high] = measured(size, 12, *seed).interval;
                (low..=high).contains(&size)
            };
            let held = (0..200).filter(held).count();
            assert!(held >= 180, "{size}: {held} of 200");
        }
    }

    #[test]
    fn nothing_is_rarely_taken_for_a_size_and_a_large_one_never_for_nothing() {
        let named = |size: f64| {
            (0..200)
                .filter(|&seed| measured(size, 12, seed).size() > 0.0)
                .count()
        };
        assert!(named(0.0) < 20, "{}", named(0.0));
        assert_eq!(named(3.0), 200);
    }

    #[test]
    fn a_tenth_of_the_evidence_is_a_tenth_of_the_precision() {
        let (precision, pull) = (DMatrix::identity(3, 3), DVector::from_element(3, 4.0));
        let full = profile(precision.clone(), &pull, 100.0, 1.0);
        let repeated = profile(0.1 * precision, &(0.1 * pull), 100.0, 10.0);
        assert!(repeated.gain < full.gain && repeated.interval[0] <= full.interval[0]);
    }
}
