//! The filter's state at each row, as the smoother needs it.

/// State of a filter along one axis at a row: position (m), velocity (m/s), lasting acceleration (m/s²) and the
/// tracker's lasting error (board edges).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Correction {
    /// Upper triangle of the covariance before the row's correction, row by row.
    pub(crate) covariance: [f64; 10],
    /// Means before the row's correction.
    pub(crate) pull: f64,
    pub(crate) lasting: f64,
    /// Innovation (board edges) and the inverse of its variance; zero where the tracker lost the marble.
    pub(crate) off: f64,
    pub(crate) weight: f64,
    /// Time since the previous row (s), and the remaining shares of lasting error and lasting acceleration.
    pub(crate) seconds: f64,
    pub(crate) remembered: f64,
    pub(crate) kept: f64,
    /// Variance of the velocity gained by random accelerations since then (m²/s²).
    pub(crate) push: f64,
    /// Whether friction holds the marble: 1 or 0.
    pub(crate) rests: f64,
    /// Factor of a wall contact on deviations of position and velocity; 1 without contact.
    pub(crate) rebound: f64,
    pub(crate) edges_per_m: f64,
}
