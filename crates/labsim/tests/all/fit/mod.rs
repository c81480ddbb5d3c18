//! Plant a truth, record it, and find it again.

mod contract;
mod grey_box;
mod planted;
mod recovery;
mod refining;
mod shrinking;
mod tilt;
