//! Ascents of the log-posterior ([`super::hill`]): their points, and the maxima that they reach.

use nalgebra::DMatrix;

use super::derivatives::Derivatives;
use super::windows::State;
use crate::noise::Noise;

/// The damping of the first step.
pub(super) const DAMPING: f64 = 1e-3;

/// The maximum that an ascent has reached.
#[derive(Debug, Clone, PartialEq)]
pub struct Probable {
    /// The five parameters, then those of the effects.
    pub values: Vec<f64>,
    /// Start states of the stretches, as of [`super::Refined`].
    pub states: Vec<Option<[f64; 4]>>,
    /// The sizes of the random quantities.
    pub noise: Noise,
    /// Log-likelihood of the observations [nats].
    pub log_likelihood: f64,
    /// Log evidence: marginal likelihood of the observations over all values [nats].
    pub log_evidence: f64,
    /// Places of the free parameters among all.
    pub slots: Vec<usize>,
    /// Their covariance, with the sizes marginalised.
    pub covariance: DMatrix<f64>,
}

/// Present point of an ascent.
#[derive(Clone)]
pub(super) struct Place {
    pub(super) z: Vec<f64>,
    pub(super) states: Vec<State>,
    pub(super) noise: Noise,
    /// Spreads of the coefficients of each map, in coordinates.
    pub(super) spreads: Vec<f64>,
    /// The fold whose observations are left out.
    pub(super) left_out: Option<usize>,
}

/// Whether derivatives are those of the present place.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Look {
    /// Not at all: they have to be taken.
    Needed,
    /// By finite differences there.
    Taken,
    /// Carried along from another place.
    Carried,
}

/// An ascent: its point, the derivatives there, its damping and its last gain.
pub(super) struct Ascent {
    pub(super) place: Place,
    pub(super) derivatives: Derivatives,
    pub(super) look: Look,
    pub(super) damping: f64,
    /// Gain of the last step; infinite before the first and after one that failed.
    pub(super) gain: f64,
}

impl From<Place> for Ascent {
    fn from(place: Place) -> Self {
        Self {
            place,
            derivatives: Derivatives::default(),
            look: Look::Needed,
            damping: DAMPING,
            gain: f64::INFINITY,
        }
    }
}
