//! Settings of a fit's search and its progress callback.

/// Called with the number of iterations done, their total, and the rows of a window.
pub type Progress<'a> = &'a dyn Fn(usize, usize, usize);

/// Settings of a fit's search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// Number of start points that are refined.
    pub starts: usize,
    /// Seed of the start points; the same seed gives the same bits for any number of threads.
    pub seed: u64,
    /// Maximum number of random searches around the best point: on a rough loss, slopes end slightly above the
    /// minimum. Zero for a quick fit.
    pub rounds: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            starts: 8,
            seed: 0,
            rounds: 3,
        }
    }
}
