//! The tilt as a second signal: what was planted is found from both, and from the tilt alone.

use labsim::fit::{ParameterSpec, Solution, tracker_noise};

use super::planted::{NOISE, Planted, ROWS, TRUTH, near};

/// Of the tilt sensor (rad).
const TILT_NOISE: [f64; 2] = [0.001, 0.0005];
const ACTUATION: [(&str, &[f64]); 4] = [
    ("delay", &[0.12, 0.0]),
    ("lag", &[0.09, 0.0]),
    ("backlash", &[0.03, 0.05]),
    ("tilt_bias", &[0.004, -0.003]),
];

/// Values that lie farther from a truth than so many standard deviations.
fn missed(solution: &Solution, truth: &[f64], deviations: f64) -> Vec<String> {
    let slots = solution.information.free.iter();
    slots
        .zip(solution.information.deviations())
        .filter(|&(&slot, deviation)| {
            let miss = (solution.values[slot] - truth[slot]).abs();
            miss > deviations * deviation + 1e-3 * truth[slot].abs()
        })
        .map(|(&slot, deviation)| {
            let (found, truth) = (solution.values[slot], truth[slot]);
            format!("{slot}: {found} ± {deviation}, not {truth}")
        })
        .collect()
}

fn truth(effects: &[(&str, &[f64])]) -> Vec<f64> {
    let of_effects = effects.iter().flat_map(|one| one.1.iter().copied());
    TRUTH.into_iter().chain(of_effects).collect()
}

fn tilt_scale(solution: &Solution) -> [f64; 2] {
    solution.tilt.as_ref().expect("tilt was measured").scale
}

/// What the tilt says nothing of is held.
fn held(mut planted: Planted) -> Planted {
    planted.parameters[2] = ParameterSpec::Held(TRUTH[2]);
    planted.parameters[4] = ParameterSpec::Held(TRUTH[4]);
    planted
}

#[test]
fn marble_and_tilt_give_actuation_and_motion() {
    let planted = Planted::new(21, 4, &ACTUATION, true, false).with_tilt(TILT_NOISE);
    let solution = planted.fit(4, 0).unwrap();
    let missed = missed(&solution, &truth(&ACTUATION), 4.0);
    assert!(missed.is_empty(), "{missed:?}");
    assert!(near(solution.noise, NOISE, 0.1), "{}", solution.noise);
    let tilt = solution.tilt.as_ref().unwrap();
    for (axis, noise) in TILT_NOISE.into_iter().enumerate() {
        assert!(near(tilt.noise[axis], noise, 0.2), "{:?}", tilt.noise);
        assert!(near(tilt.scale[axis], noise, 0.15), "{:?}", tilt.scale);
        assert!(near(solution.axis_noise[axis], NOISE, 0.15));
    }
    // The tilt determines what the marble hardly shows.
    let mut without = planted;
    without.tilt.fill(None);
    let alone = without.fit(4, 0).unwrap().information.deviations();
    let both = solution.information.deviations();
    for (both, alone) in both.iter().zip(&alone) {
        assert!(*both <= 1.2 * alone, "{both} and {alone}");
    }
}

#[test]
fn tilt_alone_gives_gears_and_actuation() {
    let mut planted = held(Planted::new(22, 4, &ACTUATION, true, false).with_tilt(TILT_NOISE));
    for observed in &mut planted.observed {
        observed.fill([f64::NAN; 2]);
    }
    for at_rest in [true, false] {
        for stretch in &mut planted.stretches {
            stretch.at_rest = at_rest;
        }
        let solution = planted.fit(4, 0).unwrap();
        let missed = missed(&solution, &truth(&ACTUATION), 4.0);
        assert!(missed.is_empty(), "{missed:?}");
        assert!(solution.noise.is_nan() && solution.tracker_noise.is_nan());
        for (scale, noise) in tilt_scale(&solution).iter().zip(TILT_NOISE) {
            assert!(near(*scale, noise, 0.15), "{scale}");
        }
    }
}

/// A pure delay shows in the tilt by whole rows only, where no finite difference sees it.
#[test]
fn tilt_alone_gives_a_delay_to_within_a_row() {
    let effects: [(&str, &[f64]); 1] = [("delay", &[0.26, 0.0])];
    for seed in 0..3 {
        let mut planted = held(Planted::new(40 + seed, 2, &effects, true, false));
        planted = planted.with_tilt(TILT_NOISE);
        for observed in &mut planted.observed {
            observed.fill([f64::NAN; 2]);
        }
        let solution = planted.fit(4, seed).unwrap();
        let row_s = TRUTH[3] / 240.0;
        assert!(
            (solution.values[5] - 0.26).abs() < row_s,
            "{:?}",
            solution.values
        );
        assert!(near(solution.values[0], TRUTH[0], 0.05));
        assert!(near(solution.values[1], TRUTH[1], 0.05));
    }
}

#[test]
fn runs_of_tilt_alone_stand_beside_runs_of_a_marble() {
    let mut planted = Planted::new(23, 4, &ACTUATION, true, false).with_tilt(TILT_NOISE);
    planted.observed[1].fill([f64::NAN; 2]);
    planted.tilt[2] = None;
    // Gaps, and one axis alone.
    for row in (5..ROWS).step_by(7) {
        planted.tilt[0].as_mut().unwrap()[row] = [f64::NAN; 2];
        planted.tilt[3].as_mut().unwrap()[row][1] = f64::NAN;
    }
    let solution = planted.fit(4, 0).unwrap();
    let missed = missed(&solution, &truth(&ACTUATION), 4.0);
    assert!(missed.is_empty(), "{missed:?}");
    let tilt = &solution.tilt.as_ref().unwrap().residuals;
    for (run, measured) in planted.tilt.iter().enumerate() {
        for row in 0..ROWS {
            for axis in 0..2 {
                let known = measured
                    .as_ref()
                    .is_some_and(|one| one[row][axis].is_finite());
                assert_eq!(tilt[run][row][axis].is_finite(), known, "{run} {row}");
            }
        }
    }
    assert!(solution.states[1].is_none_or(|state| state == [0.0; 4]));
    assert!(
        solution.residuals[1]
            .as_flattened()
            .iter()
            .all(|one| one.is_nan())
    );
}

#[test]
fn bits_of_a_fit_with_tilt_do_not_depend_on_threads() {
    let mut planted = Planted::new(24, 2, &ACTUATION[..2], true, true).with_tilt(TILT_NOISE);
    let mut with = |threads| {
        planted.threads = threads;
        planted.fit(2, 4).unwrap()
    };
    let one = with(Some(1));
    assert_eq!(with(Some(3)), one);
}

#[test]
fn tilt_that_never_changes_leaves_every_bit() {
    let mut planted = Planted::new(25, 2, &ACTUATION[1..2], true, false);
    let without = planted.fit(2, 0).unwrap();
    planted.tilt = vec![Some(vec![[0.01, f64::NAN]; ROWS]); 2];
    assert_eq!(planted.fit(2, 0).unwrap(), without);
}

#[test]
fn an_axis_that_never_moves_counts_for_nothing() {
    let mut planted = Planted::on_axes(26, 3, &[], true, false, [1.0, 0.0]);
    for observed in &mut planted.observed {
        for place in observed.iter_mut() {
            place[1] = 0.0;
        }
    }
    let observed = planted.observed.iter().map(Vec::as_slice);
    assert!(near(tracker_noise(observed), NOISE, 0.15));
    let solution = planted.fit(3, 0).unwrap();
    assert!(
        near(solution.tracker_noise, NOISE, 0.15),
        "{}",
        solution.tracker_noise
    );
    assert!(near(solution.noise, NOISE, 0.15), "{}", solution.noise);
    assert!(solution.axis_noise[1].is_nan());
    let deviations = solution.information.deviations();
    assert!(
        deviations[0] > solution.information.widths[0],
        "{deviations:?}"
    );
    assert!(deviations.iter().all(|deviation| !deviation.is_nan()));
    for slot in [1, 2, 4] {
        let place = solution
            .information
            .free
            .iter()
            .position(|&free| free == slot);
        let deviation = deviations[place.unwrap()];
        let miss = (solution.values[slot] - TRUTH[slot]).abs();
        assert!(miss < 4.0 * deviation, "{slot}: {:?}", solution.values);
        assert!(deviation < 0.1 * TRUTH[slot], "{slot}: {deviation}");
    }
}

#[test]
fn motor_currents_are_commands() {
    let mut planted = Planted::new(27, 4, &ACTUATION[..2], true, false).with_tilt(TILT_NOISE);
    let unit = [-3000.0, 2000.0];
    for commands in &mut planted.commands {
        for knobs in commands.iter_mut() {
            *knobs = [0, 1].map(|axis| unit[axis] * knobs[axis]);
        }
    }
    for axis in 0..2 {
        planted.parameters[axis] = ParameterSpec::Free {
            range: (-2e-4, 2e-4),
            start: None,
        };
    }
    let solution = planted.fit(4, 0).unwrap();
    let mut truth = truth(&ACTUATION[..2]);
    for axis in 0..2 {
        truth[axis] /= unit[axis];
    }
    let missed = missed(&solution, &truth, 4.0);
    assert!(missed.is_empty(), "{missed:?}");
}

#[test]
fn judged_values_leave_the_tilt_that_they_do() {
    let planted = Planted::new(28, 2, &ACTUATION[..2], true, false).with_tilt(TILT_NOISE);
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let truth = vec![truth(&ACTUATION[..2])];
    for held in [true, false] {
        let refined = planted.with(|problem| problem.refine(&truth, 6, held, &cancel).unwrap());
        let all = refined[0].tilt_residuals.iter().flatten();
        let square = all.clone().map(|one| one[0] * one[0]).sum::<f64>();
        let scale = (square / all.count() as f64).sqrt();
        assert!(near(scale, TILT_NOISE[0], 0.15), "{scale}");
    }
    let wide = planted.with(|problem| problem.inform(&truth[0], None, NOISE, &cancel).unwrap());
    assert!(wide.deviations().iter().all(|one| one.is_finite()));
}
