//! The labyrinth simulator: a marble on a board that two knobs tilt, thousands of rollouts at a time.
//!
//! Knob angles go in, observations come out: the marble's position in units of the board's long
//! edge. The board's frame has its origin at the centre, x along the long edge, y along the short
//! one, z up out of the board; `knob_x` and `knob_y` tilt the board about x and y by the right-hand
//! rule, so a pure roll accelerates by 5/7 g sin(tilt y) along x and by -5/7 g sin(tilt x) along y.
//!
//! The engine knows nothing of files, networks or plots.

pub mod board;
pub mod drive;
pub mod effects;
pub mod engine;
pub mod error;
pub mod filter;
pub mod fit;
mod lanes;
mod live;
mod motion;
mod noise;
mod orientation;
pub mod parameters;
mod per_rollout;
pub mod rollout;

pub use board::{Board, Marble, Rig};
pub use drive::paper_drive;
pub use effects::{EffectInstance, EffectSpec, effects};
pub use engine::{Engine, Hold};
pub use error::{Error, Result};
pub use live::Live;
pub use noise::Noise;
pub use orientation::turned;
pub use parameters::Parameters;
pub use per_rollout::PerRollout;
pub use rollout::{Batch, Observed, TimeBase};
