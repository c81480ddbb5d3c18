//! Fixed-interval smoothing of the filter: the random acceleration and the tracker's error in each row, given all rows.
//!
//! The filter is linear about the simulated marble, so what comes after a row acts on it through sums that are built
//! from the last row backwards (Bierman 1973, "Fixed interval smoothing with discrete measurements"; no covariance
//! is inverted).

use nalgebra::{Matrix4, Vector4};

use crate::correction::Correction;

/// A mean and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

/// Smoothed estimates of one axis of one row, given all rows of the stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoothed {
    /// Random acceleration of all kinds between the previous row and this one (m/s²); NaN in first rows, and where
    /// friction holds the marble, which shows nothing of what pushes it.
    pub push: Estimate,
    /// The tracker's lasting error (board edges).
    pub lasting: Estimate,
}

impl Correction {
    fn covariance(&self) -> Matrix4<f64> {
        let [xx, xv, xa, xb, vv, va, vb, aa, ab, bb] = self.covariance;
        Matrix4::new(
            xx, xv, xa, xb, xv, vv, va, vb, xa, va, aa, ab, xb, vb, ab, bb,
        )
    }

    /// Observation of the state (board edges).
    fn seen(&self) -> Vector4<f64> {
        Vector4::new(self.edges_per_m, 0.0, 0.0, 1.0)
    }

    /// A deviation after the row's correction.
    fn taken_in(&self, covariance: &Matrix4<f64>) -> Matrix4<f64> {
        let seen = self.seen();
        Matrix4::identity() - self.weight * covariance * seen * seen.transpose()
    }

    /// Velocity and position per m/s² of the lasting acceleration since the previous row (s, s²).
    fn of_pull(&self) -> (f64, f64) {
        let s = self.seconds;
        (0.5 * s * (self.kept + 1.0), s * s * (self.kept + 2.0) / 6.0)
    }

    /// Propagation of the state since the previous row.
    fn transition(&self) -> Matrix4<f64> {
        let (of_velocity, of_place) = self.of_pull();
        let moves = 1.0 - self.rests;
        #[rustfmt::skip]
        let free = Matrix4::new(
            1.0, self.seconds, of_place, 0.0,
            0.0, moves, moves * of_velocity, 0.0,
            0.0, 0.0, self.kept, 0.0,
            0.0, 0.0, 0.0, self.remembered,
        );
        self.rim() * free
    }

    fn rim(&self) -> Matrix4<f64> {
        Matrix4::from_diagonal(&Vector4::new(self.rebound, self.rebound, 1.0, 1.0))
    }
}

/// Smooths the rows of one axis, from the last one backwards.
pub(super) fn smoothed(rows: &[Correction]) -> Vec<Smoothed> {
    let (mut slope, mut curvature) = (Vector4::zeros(), Matrix4::zeros());
    let mut found = Vec::with_capacity(rows.len());
    for (number, row) in rows.iter().enumerate().rev() {
        let before = row.covariance();
        let (seen, taken_in) = (row.seen(), row.taken_in(&before));
        slope = taken_in.transpose() * slope + row.weight * row.off * seen;
        curvature =
            taken_in.transpose() * curvature * taken_in + row.weight * seen * seen.transpose();
        let last = number.checked_sub(1).map(|last| &rows[last]);
        found.push(Smoothed {
            push: last
                .filter(|_| row.rests == 0.0)
                .map_or(Estimate::UNKNOWN, |last| {
                    push(last, row, &slope, &curvature)
                }),
            lasting: {
                let own = before.column(3);
                Estimate {
                    mean: row.lasting + own.dot(&slope),
                    deviation: deviation(before[(3, 3)] - own.dot(&(curvature * own))),
                }
            },
        });
        let transition = row.transition();
        slope = transition.transpose() * slope;
        curvature = transition.transpose() * curvature * transition;
    }
    found.reverse();
    found
}

/// The acceleration between two rows, from the information of all rows from the second one on.
fn push(
    last: &Correction,
    row: &Correction,
    slope: &Vector4<f64>,
    curvature: &Matrix4<f64>,
) -> Estimate {
    let before = last.covariance();
    let after = last.taken_in(&before) * before;
    let pull = last.pull + last.weight * last.off * last.seen().dot(&before.column(2));
    let s = row.seconds;
    let of_pull = row.of_pull().0 / s;
    // Covariances of the acceleration with the state in the second row.
    let with_pull = row.transition() * after.column(2) * of_pull;
    let with_white = row.rim() * Vector4::new(0.5 * s, 1.0, 0.0, 0.0) * (row.push / s);
    let with_state = with_pull + with_white;
    let variance = of_pull * of_pull * after[(2, 2)] + row.push / (s * s);
    Estimate {
        mean: of_pull * pull + with_state.dot(slope),
        deviation: deviation(variance - with_state.dot(&(curvature * with_state))),
    }
}

impl Estimate {
    const UNKNOWN: Self = Self {
        mean: f64::NAN,
        deviation: f64::NAN,
    };
}

/// The root of a variance that rounding may have made negative.
fn deviation(variance: f64) -> f64 {
    variance.max(0.0).sqrt()
}
