//! What a filter knows as it takes in a row: all that a smoother needs to go back.

/// What a filter knew of one axis as it took in a row: of place (m), velocity (m/s), push that lasts (m/s²) and the
/// tracker's lasting error (board edges).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Correction {
    /// The upper triangle of the covariance before the row was seen, row by row.
    pub(crate) covariance: [f64; 10],
    /// Means before the row was seen.
    pub(crate) pull: f64,
    pub(crate) lasting: f64,
    /// How far off the prediction was (board edges), and the inverse of the variance that this counts with; zero
    /// where nothing was seen.
    pub(crate) off: f64,
    pub(crate) weight: f64,
    /// How long it is since the row before (s), and the shares of lasting error and push that are kept.
    pub(crate) seconds: f64,
    pub(crate) remembered: f64,
    pub(crate) kept: f64,
    /// Variance of the velocity that a random push gave since then (m²/s²).
    pub(crate) push: f64,
    /// Whether friction holds the marble: 1 or 0.
    pub(crate) rests: f64,
    /// What a wall made of all deviations of place and velocity: 1 where none was met.
    pub(crate) rebound: f64,
    pub(crate) edges_per_m: f64,
}
