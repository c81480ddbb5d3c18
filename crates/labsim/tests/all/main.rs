//! Tests of the crate from outside. They share one binary: linking the engines takes longer than most tests.

mod agreement;
mod effects;
mod effects_theory;
mod filter;
mod fit;
mod rapier_invariants;
mod rapier_theory;
mod rolling_theory;
mod slower;
mod tilt;
