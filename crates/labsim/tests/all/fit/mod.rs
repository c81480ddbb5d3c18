//! Plant a truth, record it, and find it again.

mod contract;
mod planted;
mod recovery;
mod refining;
mod shrinking;
mod tilt;
