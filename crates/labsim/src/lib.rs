//! The labyrinth simulator: a marble on a board that two knobs tilt, thousands of rollouts at a time.
//!
//! Knob angles go in, observations come out: the marble's position in units of the board's long
//! edge. The board's frame has its origin at the centre, x along the long edge, y along the short
//! one, z up out of the board; `knob_x` and `knob_y` tilt the board about x and y by the right-hand
//! rule, so a pure roll accelerates by 5/7 g sin(tilt y) along x and by -5/7 g sin(tilt x) along y.
//!
//! The engine contains no code for files, networks or plots.
//!
//! # Example
//!
//! A board that one knob tilts about y: the marble rolls along x, by 5/7 g sin(tilt) t²/2.
//!
//! ```
//! use std::sync::atomic::AtomicBool;
//!
//! use labsim::{Batch, Engine, Parameters, Rig};
//!
//! let rig = Rig::default();
//! // Gears about x and y, rolling friction, updates of 1/240 s a row, observed over true position.
//! let parameters: [Parameters; 1] = [[0.05, 0.05, 0.0, 24.0, 1.0].into()];
//! let knobs = [[0.0, 0.2]; 6]; // 0.2 rad for six rows of 0.1 s
//! let path = Batch::new(&rig, &parameters, &knobs).run(
//!     Engine::Rolling,
//!     None,
//!     &AtomicBool::new(false),
//! )?;
//!
//! let [x, y] = path[5];
//! let rolled_m = 5.0 / 7.0 * 9.81 * (0.05_f64 * 0.2).sin() * 0.5_f64.powi(2) / 2.0;
//! assert!((x - rolled_m / rig.board.edge_x_m).abs() < 0.01 * x);
//! assert_eq!(y, 0.0);
//! # Ok::<(), labsim::Error>(())
//! ```
//!
//! `examples/simulate.rs` prints the path under the drive of the paper; `examples/fit.rs` fits
//! the parameters of a simulated rig.

pub mod board;
mod correction;
pub mod drive;
pub mod effects;
pub mod engine;
pub mod error;
pub mod filter;
pub mod fit;
mod fleet;
mod lanes;
mod live;
pub mod maze;
mod motion;
mod noise;
mod orientation;
pub mod parameters;
mod per_rollout;
pub mod rollout;
pub mod scene;
mod threads;

pub use board::{Board, Marble, Rig};
pub use drive::paper_drive;
pub use effects::{EffectInstance, EffectNoise, EffectSpec, effects, seen};
pub use engine::{Engine, Hold};
pub use error::{Error, Result};
pub use fleet::{Fleet, State, Tracker};
pub use live::Live;
pub use maze::{Fall, Maze};
pub use noise::Noise;
pub use orientation::turned;
pub use parameters::Parameters;
pub use per_rollout::PerRollout;
pub use rollout::{Batch, Falls, Observed, TimeBase};
pub use scene::Scene;

/// Runs the example of the crate's README with the doctests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
