//! What differs from run to run or from place to place is found with the size of its differences, and nothing is
//! found where there is nothing.

use std::sync::atomic::AtomicBool;

use labsim::effects::effect;
use labsim::fit::{Hypothesis, Settings, Solution};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::planted::{NOISE, Planted, Random, TRUTH, near};

const SIZE: f64 = 0.003;
const DELAY: [(&str, &[f64]); 1] = [("delay", &[0.2, 0.0])];

fn with(mut planted: Planted, name: &str) -> Planted {
    planted
        .effects
        .push(Hypothesis::free(effect(name).unwrap()));
    planted
}

fn leans(size: f64) -> Vec<[f64; 2]> {
    let mut random = Random(ChaCha8Rng::seed_from_u64(5));
    (0..8)
        .map(|_| [0; 2].map(|_| size * random.normal()))
        .collect()
}

#[test]
fn leans_of_runs_and_their_size_are_found() {
    let leans = leans(SIZE);
    let planted = with(Planted::leaning(61, &DELAY, &leans), "lean");
    let solution = planted.fit(3, 0).unwrap();
    let found = &solution.shrunk[0];
    assert_eq!(found.effect, "lean");
    let [low, high] = found.interval;
    assert!((low..=high).contains(&SIZE) && low > 0.001, "{found:?}");
    assert!(near(found.size, SIZE, 0.4), "{found:?}");
    // Sixteen leans, of which one in a few thousand lies four deviations off.
    let pairs = found.values.iter().zip(&found.deviations);
    for ((value, deviation), truth) in pairs.zip(leans.as_flattened()) {
        assert!(
            (value - truth).abs() < 4.0 * deviation,
            "{value} {truth}: {deviation}"
        );
        assert!(*deviation < 0.3 * SIZE, "{deviation}");
    }
    assert!(found.effective > 12.0, "{}", found.effective);
    assert!(near(solution.values[5], 0.2, 0.03), "{:?}", solution.values);
    assert!(near(solution.noise, NOISE, 0.1), "{}", solution.noise);
    // A new run leans by nothing that is known.
    assert_eq!(solution.values[7..9], [0.0; 2]);
    assert_eq!(solution.values[9], found.size);
}

#[test]
fn runs_that_lean_alike_have_no_size() {
    let plain = Planted::leaning(62, &DELAY, &leans(0.0)).fit(3, 0).unwrap();
    let leaning = with(Planted::leaning(62, &DELAY, &leans(0.0)), "lean")
        .fit(3, 0)
        .unwrap();
    let found = &leaning.shrunk[0];
    assert_eq!(found.interval[0], 0.0, "{found:?}");
    assert!(found.size == 0.0 && found.interval[1] < 2e-4, "{found:?}");
    let information = &plain.information;
    for (&slot, deviation) in information.free.iter().zip(information.deviations()) {
        let apart = (leaning.values[slot] - plain.values[slot]).abs();
        assert!(apart < 3.0 * deviation, "{slot}: {apart} and {deviation}");
    }
}

#[test]
fn bits_of_leans_do_not_depend_on_threads() {
    let mut planted = with(Planted::leaning(63, &[], &leans(SIZE)[..3]), "lean");
    let mut fit = |threads| {
        planted.threads = threads;
        planted.fit(2, 1).unwrap()
    };
    let one = fit(Some(1));
    assert_eq!(fit(Some(3)), one);
}

/// A map of the paper's board: half waves and whole ones, smaller the finer they are (rad).
fn map(size: f64) -> [f64; 14] {
    let mut random = Random(ChaCha8Rng::seed_from_u64(8));
    std::array::from_fn(|i| if i < 9 { size * random.normal() } else { 0.0 })
}

/// Mean absolute error of values on other runs (board edges).
fn held_out(values: &[f64], effects: &[Hypothesis], truth: &[(&str, &[f64])]) -> f64 {
    let mut others = Planted::new(900, 6, truth, true, false);
    others.effects = effects.to_vec();
    let cancel = AtomicBool::new(false);
    let left = others.with(|problem| problem.refine(&[values.to_vec()], 8, true, &cancel));
    let left = left.unwrap().remove(0).residuals.concat();
    left.as_flattened().iter().map(|one| one.abs()).sum::<f64>() / (2 * left.len()) as f64
}

fn fit(planted: &Planted, start: bool) -> Solution {
    let settings = Settings {
        starts: if start { 1 } else { 3 },
        ..Settings::default()
    };
    planted.with(|problem| {
        problem
            .fit(&settings, &|_, _, _| (), &AtomicBool::new(false))
            .unwrap()
    })
}

#[test]
fn a_smooth_map_is_found_and_predicts_other_runs() {
    let truth = map(0.002);
    let planted = Planted::new(64, 8, &[("slope_map", &truth)], true, false).starting_at_truth();
    let solution = fit(&planted, true);
    let found = &solution.shrunk[0];
    assert!(found.size > 5e-4 && found.size < 4e-3, "{found:?}");
    let pairs = found.values.iter().zip(&found.deviations).zip(&truth);
    let far = pairs
        .filter(|((value, deviation), truth)| (*value - *truth).abs() > 3.0 * *deviation + 2e-4);
    assert!(far.count() <= 1, "{found:?}");
    let mut plain = planted;
    plain.effects.clear();
    let without = fit(&plain, true);
    let all: [(&str, &[f64]); 1] = [("slope_map", &truth)];
    let hypothesis = [Hypothesis::free(effect("slope_map").unwrap())];
    let with_map = held_out(&solution.values, &hypothesis, &all);
    let without_map = held_out(&without.values, &[], &all);
    assert!(with_map < 0.5 * without_map, "{with_map} and {without_map}");
}

/// Runs that never meet most of the board, of a model that is wrong elsewhere: a drag that is not sought.
#[test]
fn a_map_learned_from_one_run_does_no_harm() {
    let drag: [(&str, &[f64]); 1] = [("viscous_drag", &[0.4])];
    for (seed, runs) in [(70, 1), (71, 1), (72, 2), (73, 2)] {
        let mut plain = Planted::new(seed, runs, &drag, true, false).starting_at_truth();
        plain.effects.clear();
        let without = fit(&plain, true);
        let planted = with(plain, "slope_map");
        let solution = fit(&planted, true);
        let hypothesis = [Hypothesis::free(effect("slope_map").unwrap())];
        let with_map = held_out(&solution.values, &hypothesis, &drag);
        let without_map = held_out(&without.values, &[], &drag);
        assert!(
            with_map < 1.1 * without_map,
            "{with_map} and {without_map}: {:?}",
            solution.shrunk
        );
        assert_eq!(TRUTH.len() + 14, solution.values.len());
    }
}
