//! Fits without a search: from values that are about right.

use std::sync::atomic::AtomicBool;

use labsim::fit::{Problem, Refined};

use super::planted::{NOISE, Planted, TRUTH};

/// Root mean square of the residuals, in units of the tracker's noise.
fn left(refined: &Refined) -> f64 {
    let all: Vec<f64> = refined
        .residuals
        .iter()
        .flatten()
        .flatten()
        .copied()
        .collect();
    (all.iter().map(|one| one * one).sum::<f64>() / all.len() as f64).sqrt() / NOISE
}

/// Start states that are guessed from the first rows lead parameters astray where the ground is steep.
#[test]
fn no_descent_leaves_the_truth_for_worse() {
    let effects: [&[(&str, &[f64])]; 3] = [
        &[],
        &[("eccentric_marble", &[0.008, 1.0, 0.4, 1.0])],
        &[("point_field", &[0.05, -0.03, 0.002])],
    ];
    let cancel = AtomicBool::new(false);
    for effects in effects {
        let own = effects.first().map_or(&[][..], |one| one.1);
        let truth = [[TRUTH.as_slice(), own].concat()];
        for seed in 0..12 {
            let planted = Planted::new(seed, 6, effects, true, false);
            let refine = |problem: &Problem<'_>, held| {
                left(&problem.refine(&truth, 12, held, &cancel).unwrap()[0])
            };
            let (held, free) =
                planted.with(|problem| (refine(problem, true), refine(problem, false)));
            assert!(free < held + 0.05, "{effects:?} {seed}: {free}, {held}");
        }
    }
}
