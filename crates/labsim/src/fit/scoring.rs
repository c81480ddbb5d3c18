//! Fisher scoring of an ascent: slope and curvature, with separate blocks for the start states.

use nalgebra::{DMatrix, DVector, Matrix4, SVector};

use super::windows::State;

/// Log-likelihood at a point, and curvature and slope of the log-posterior in values, in logarithms of sizes and in
/// the start state of each window.
pub(super) struct Slope {
    pub(super) log_likelihood: f64,
    pub(super) curvature: DMatrix<f64>,
    pub(super) uphill: DVector<f64>,
    pub(super) starts: Vec<Start>,
}

/// The block of a start state, which is coupled only to the values and sizes common to all windows.
#[derive(Clone)]
pub(super) struct Start {
    pub(super) curvature: Matrix4<f64>,
    pub(super) cross: DMatrix<f64>,
    pub(super) uphill: SVector<f64, 4>,
}

/// A step in coordinates, logarithms of sizes, and start states.
pub(super) struct Step {
    pub(super) common: Vec<f64>,
    pub(super) states: Vec<State>,
}

impl Slope {
    /// The gain of a step in the quadratic that they describe.
    pub(super) fn gain(&self, step: &Step) -> f64 {
        let common = DVector::from_column_slice(&step.common);
        let mut gain = common.dot(&(&self.uphill - 0.5 * &self.curvature * &common));
        for (start, state) in self.starts.iter().zip(&step.states) {
            let state = SVector::from(*state);
            let bent = start.cross.transpose() * &common;
            let bent = SVector::<f64, 4>::from_column_slice(bent.as_slice());
            gain += state.dot(&(start.uphill - bent - 0.5 * start.curvature * state));
        }
        gain
    }

    /// Curvature and slope in values and sizes with the start states eliminated, and the inverse curvatures of those.
    pub(super) fn without_starts(
        &self,
        damping: f64,
    ) -> (DMatrix<f64>, DVector<f64>, Vec<Matrix4<f64>>) {
        let (mut curvature, mut uphill) = (self.curvature.clone(), self.uphill.clone());
        for i in 0..curvature.nrows() {
            curvature[(i, i)] *= 1.0 + damping;
        }
        let mut inverses = Vec::with_capacity(self.starts.len());
        for start in &self.starts {
            let mut own = start.curvature;
            for i in 0..4 {
                own[(i, i)] *= 1.0 + damping;
            }
            let inverse = own.try_inverse().unwrap_or_else(Matrix4::zeros);
            let gain = &start.cross * inverse;
            curvature -= &gain * start.cross.transpose();
            uphill -= gain * start.uphill;
            inverses.push(inverse);
        }
        (curvature, uphill, inverses)
    }
}
