//! The rollouts of the paper: its drive, parameters over its ranges.

use labsim::Parameters;

/// Parameters that fill the paper's ranges evenly (additive recurrence, Roberts 2018).
pub fn spread(count: usize) -> Vec<Parameters> {
    let root = 1.236_505_703_391_49_f64; // the positive root of x⁶ = x + 1
    let step: [f64; 5] = std::array::from_fn(|axis| root.powf(-(axis as f64 + 1.0)));
    (1..=count)
        .map(|i| {
            let [a, b, c, d, e] = step.map(|step| (0.5 + step * i as f64).fract());
            [0.1 * a, 0.1 * b, 0.001 * c, 50.0 * d, 0.8 + 0.4 * e].into()
        })
        .collect()
}

/// Physics updates of all rollouts together.
pub fn substeps(parameters: &[Parameters], rows: usize) -> u64 {
    parameters
        .iter()
        .map(|p| p.time_scale.round() as u64 * (rows as u64 - 1))
        .sum()
}
