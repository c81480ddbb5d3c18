//! What every fit keeps to: bits, bounds, ends, refusals.

use std::sync::atomic::{AtomicBool, Ordering};

use labsim::Error;
use labsim::fit::{ParameterSpec, Settings, tracker_noise};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::planted::{Planted, RANGES, ROWS, Random, TRUTH, free, near};

#[test]
fn bits_do_not_depend_on_threads() {
    let truth: [(&str, &[f64]); 1] = [("lag", &[0.1, 0.0])];
    let mut planted = Planted::new(2, 2, &truth, false, false);
    let mut with = |threads| {
        planted.threads = threads;
        planted.fit(3, 4).unwrap()
    };
    let one = with(Some(1));
    assert_eq!(with(Some(3)), one);
    assert_eq!(with(None), one);
}

#[test]
fn bounds_are_kept() {
    let truth: [(&str, &[f64]); 1] = [("lag", &[0.0, 0.0])];
    let mut planted = Planted::new(4, 2, &truth, true, false);
    // The truth lies far beyond three times these.
    planted.parameters[0] = free((0.0, 0.01));
    planted.parameters[2] = free((0.002, 0.004));
    let solution = planted.fit(2, 0).unwrap();
    for estimate in &solution.estimates {
        for values in &estimate.path {
            assert!((0.0..=0.03).contains(&values[0]), "{values:?}");
            assert!(
                (0.002 / 3.0 - 1e-12..=0.012 + 1e-12).contains(&values[2]),
                "{values:?}"
            );
            assert!(values[5] >= 0.0, "{values:?}");
        }
    }
}

#[test]
fn what_does_nothing_has_no_interval() {
    let mut planted = Planted::new(6, 3, &[("bump", &[0.0, 0.0, 0.0, 0.02])], true, false);
    for commands in &mut planted.commands {
        for knobs in commands.iter_mut() {
            knobs[0] = 0.0;
        }
    }
    for observed in &mut planted.observed {
        let start = observed[0][1];
        for place in observed.iter_mut() {
            place[1] = start;
        }
    }
    // A bump of no height has no place.
    planted.effects[0].values[2] = ParameterSpec::Held(0.0);
    let solution = planted.fit(2, 0).unwrap();
    let information = &solution.information;
    let deviations = information.deviations();
    for slot in [0, 5, 6, 8] {
        let i = information
            .free
            .iter()
            .position(|&free| free == slot)
            .unwrap();
        assert!(
            deviations[i] > information.widths[i],
            "{slot}: {}",
            deviations[i]
        );
    }
    let smallest = information.singular.last().unwrap() / information.singular[0];
    assert!(smallest < 1e-6, "{smallest}");
    assert_eq!(solution.values[7], 0.0);
    let covariance = information.covariance(0.25);
    assert!(covariance.iter().flatten().all(|entry| entry.is_finite()));
}

#[test]
fn one_parameter_alone() {
    let mut planted = Planted::new(8, 2, &[], false, false);
    planted.parameters = TRUTH.map(ParameterSpec::Held);
    planted.parameters[2] = free(RANGES[2]);
    let solution = planted.fit(1, 0).unwrap();
    assert!(
        near(solution.values[2], TRUTH[2], 0.02),
        "{:?}",
        solution.values
    );
    for slot in [0, 1, 3, 4] {
        assert_eq!(solution.values[slot], TRUTH[slot]);
    }
}

#[test]
fn the_sense_of_a_gear_shows_where_its_range_allows_both() {
    let mut planted = Planted::new(9, 3, &[], true, false);
    for commands in &mut planted.commands {
        for knobs in commands.iter_mut() {
            knobs[0] = -knobs[0];
        }
    }
    planted.parameters[0] = free((-0.1, 0.1));
    let solution = planted.fit(3, 0).unwrap();
    assert!(
        near(solution.values[0], -TRUTH[0], 0.05),
        "{:?}",
        solution.values
    );
}

#[test]
fn information_of_values_from_elsewhere_is_that_of_a_fit() {
    let planted = Planted::new(12, 3, &[], true, false).starting_at_truth();
    let solution = planted.fit(1, 0).unwrap();
    let cancel = AtomicBool::new(false);
    planted.with(|problem| {
        let states = Some(solution.states.as_slice());
        let again = problem
            .inform(&solution.values, states, solution.noise, &cancel)
            .unwrap();
        for (one, other) in again
            .deviations()
            .iter()
            .zip(solution.information.deviations())
        {
            assert!(near(*one, other, 1e-9), "{one} {other}");
        }
        let guessed = problem
            .inform(&solution.values, None, solution.noise, &cancel)
            .unwrap();
        for (one, other) in guessed.deviations().iter().zip(again.deviations()) {
            assert!((0.4..2.5).contains(&(one / other)), "{one} {other}");
        }
        let error = problem
            .errors(
                std::slice::from_ref(&solution.values),
                &solution.states,
                &cancel,
            )
            .unwrap();
        let seen = solution.residuals.iter().flatten().flatten();
        let mean = seen.clone().map(|one| one.abs()).sum::<f64>() / seen.count() as f64;
        assert!((error[0] - mean).abs() < 1e-12);
    });
}

#[test]
fn progress_goes_up_and_arrives() {
    let planted = Planted::new(1, 2, &[], false, false);
    let reports = std::cell::RefCell::new(Vec::new());
    let report = |done, total, _| reports.borrow_mut().push((done, total));
    let settings = Settings {
        starts: 2,
        ..Settings::default()
    };
    planted.with(|problem| {
        problem
            .fit(&settings, &report, &AtomicBool::new(false))
            .unwrap()
    });
    let reports = reports.into_inner();
    assert!(reports.is_sorted());
    let &(done, total) = reports.last().unwrap();
    assert_eq!(done, total);
    assert!(reports.iter().all(|report| report.1 == total));
}

#[test]
fn a_fit_can_be_stopped() {
    let planted = Planted::new(1, 2, &[], false, false);
    let cancel = AtomicBool::new(false);
    let stop = |done: usize, _: usize, _: usize| cancel.store(done > 2, Ordering::Relaxed);
    let result = planted.with(|problem| problem.fit(&Settings::default(), &stop, &cancel));
    assert_eq!(result, Err(Error::Cancelled));
}

#[test]
fn what_cannot_be_fitted_is_refused_in_one_line() {
    let refused = |change: &dyn Fn(&mut Planted), expected: &str| {
        let mut planted = Planted::new(1, 1, &[("lag", &[0.1, 0.0])], true, false);
        change(&mut planted);
        let message = planted.fit(1, 0).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
        assert!(!message.contains('\n'));
    };
    refused(&|one| one.parameters[3] = free(RANGES[3]), "time_scale");
    refused(&|one| one.parameters[0] = free((0.0, 0.0)), "gear_x");
    refused(
        &|one| one.parameters[2] = free((-1.0, 1.0)),
        "rolling_friction",
    );
    refused(
        &|one| one.parameters[4] = ParameterSpec::Held(0.0),
        "observation_scale",
    );
    refused(
        &|one| one.effects[0].values[0] = free((0.5, 0.1)),
        "time_constant_s of lag",
    );
    refused(&|one| one.effects[0].values.clear(), "lag");
    refused(
        &|one| one.commands[0][3] = [f64::NAN; 2],
        "commands of recording 0",
    );
    refused(
        &|one| one.observed[0].truncate(5),
        "observed of recording 0",
    );
    refused(&|one| one.observed[0].fill([f64::NAN; 2]), "three rows");
    refused(&|one| one.stretches[0].rows = ROWS + 1, "stretch 0");
    refused(
        &|one| one.durations = Some(vec![0.1; 3]),
        "durations of recording 0",
    );
    assert!(Planted::new(1, 1, &[], false, false).fit(0, 0).is_err());
}

#[test]
fn the_trackers_noise_shows_in_fourth_differences() {
    let mut random = Random(ChaCha8Rng::seed_from_u64(3));
    let path: Vec<[f64; 2]> = (0..2000)
        .map(|t| [(0.05 * f64::from(t)).sin(), 0.3].map(|x| x + 0.01 * random.normal()))
        .collect();
    assert!(near(tracker_noise([path.as_slice()]), 0.01, 0.06));
}

#[test]
fn a_tracker_that_errs_alike_within_a_pixel_tells_its_noise_while_the_marble_moves() {
    let mut random = Random(ChaCha8Rng::seed_from_u64(4));
    let errors: Vec<f64> = (0..3000).map(|_| 0.01 * random.normal()).collect();
    // A hundred rows at rest, then a hundred of three pixels each.
    let pixel = |t: usize| 300 * (t / 200) + 3 * (t % 200).saturating_sub(100);
    let path: Vec<[f64; 2]> = (0..2000)
        .map(|t| [pixel(t), pixel(t) + 1500].map(|one| 0.002 * one as f64 + errors[one % 3000]))
        .collect();
    let noise = tracker_noise([path.as_slice()]);
    assert!(near(noise, 0.01, 0.15), "{noise}");
}
