//! Tests of the crate from outside. They share one binary: linking the engines takes longer than most tests.

mod agreement;
mod effects;
mod effects_theory;
mod filter;
mod filter_contacts;
mod filter_tilt;
mod fit;
mod fleet;
mod maze;
mod rapier_invariants;
mod rapier_theory;
mod rolling_theory;
mod slower;
mod smoother;
mod tilt;

/// Knob angles with jumps, rests and reversals (rad).
fn commands(rows: usize) -> Vec<[f64; 2]> {
    (0..rows)
        .map(|i| {
            let t = i as f64;
            let hold = if i % 20 < 5 { 0.0 } else { 1.0 };
            [
                0.12 * (0.21 * t).sin() * hold,
                0.1 * (0.13 * t).cos() - 0.04 * hold,
            ]
        })
        .collect()
}
