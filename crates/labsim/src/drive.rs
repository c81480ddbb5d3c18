//! The excitation of the paper.

use std::f64::consts::PI;

/// Knob angles of the paper's drive (Eq. 3), `steps` × (x, y) in radians.
///
/// According to the paper's text, 100 timesteps cover a full period, so the angle is 2πt/100. `literal` uses
/// the printed equation, t/(200π), which covers 0.16 rad in 100 steps.
pub fn paper_drive(steps: usize, amplitude: f64, literal: bool) -> Vec<[f64; 2]> {
    let rate = if literal {
        1.0 / (200.0 * PI)
    } else {
        2.0 * PI / 100.0
    };
    (0..steps)
        .map(|t| {
            let (sin, cos) = (rate * t as f64).sin_cos();
            [amplitude * sin, amplitude * cos]
        })
        .collect()
}
