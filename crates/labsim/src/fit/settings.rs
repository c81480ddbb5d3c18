//! How thoroughly a fit searches, and where it reports its progress.

/// Called with how many iterations are done, how many there will be, and the rows of a window.
pub type Progress<'a> = &'a dyn Fn(usize, usize, usize);

/// How thoroughly a fit searches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// Start points that are refined.
    pub starts: usize,
    /// Of the draw of start points; the same seed gives the same bits for any number of threads.
    pub seed: u64,
    /// How often the best one's surroundings are searched for a better one, at most: where the ground is
    /// rough, slopes end a little above the bottom. None for a quick look.
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
