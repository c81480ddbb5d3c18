//! Plant a truth, record it, and find it again.

use std::sync::atomic::{AtomicBool, Ordering};

use labsim::effects::effect;
use labsim::fit::{
    Hypothesis, Problem, Recording, Settings, Solution, Sought, Stretch, tracker_noise,
};
use labsim::{Batch, Chosen, Engine, Error, Parameters, PerRollout, Rig, TimeBase};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

const ROWS: usize = 100;
const NOISE: f64 = 0.001;
const TRUTH: [f64; 5] = [0.06, 0.05, 4e-4, 18.0, 1.05];
const RANGES: [(f64, f64); 5] = [
    (0.0, 0.1),
    (0.0, 0.1),
    (0.0, 0.001),
    (0.0, 50.0),
    (0.8, 1.2),
];

/// Recordings of a truth, and what is asked of them.
struct Planted {
    rig: Rig,
    parameters: [Sought; 5],
    effects: Vec<Hypothesis>,
    commands: Vec<Vec<[f64; 2]>>,
    durations: Option<Vec<f64>>,
    observed: Vec<Vec<[f64; 2]>>,
    stretches: Vec<Stretch>,
    threads: Option<usize>,
}

struct Random(ChaCha8Rng);

impl Random {
    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

fn free(range: (f64, f64)) -> Sought {
    Sought::Free { range, start: None }
}

/// Three sinusoids a knob, large enough to bring the marble to the rim.
fn excitation(random: &mut Random, rows: usize) -> Vec<[f64; 2]> {
    let waves: Vec<[f64; 4]> = (0..3)
        .map(|_| {
            std::array::from_fn(|i| {
                random.within(0.5, 5.0) + if i < 2 { 0.0 } else { 3.0 * i as f64 }
            })
        })
        .collect();
    let angle = |t: usize, axis: usize| -> f64 {
        let phase = std::f64::consts::TAU * t as f64 / ROWS as f64;
        waves
            .iter()
            .map(|wave| 0.08 * (phase * wave[axis] + wave[2 + axis]).sin())
            .sum()
    };
    (0..rows).map(|t| [angle(t, 0), angle(t, 1)]).collect()
}

impl Planted {
    /// Runs of a truth that may have effects; `stamped` ones tell the time scale, in `moving` ones the
    /// marble rolls at row 0.
    fn new(
        seed: u64,
        runs: usize,
        effects: &[(&str, &[f64])],
        stamped: bool,
        moving: bool,
    ) -> Self {
        let mut random = Random(ChaCha8Rng::seed_from_u64(seed));
        let chosen: Vec<Chosen<'_>> = effects
            .iter()
            .map(|(name, values)| Chosen {
                effect: effect(name).unwrap(),
                values: PerRollout::Shared(values),
            })
            .collect();
        let mut planted = Self {
            rig: Rig::default(),
            parameters: RANGES.map(free),
            effects: effects
                .iter()
                .map(|(name, _)| Hypothesis::free(effect(name).unwrap()))
                .collect(),
            commands: (0..runs).map(|_| excitation(&mut random, ROWS)).collect(),
            durations: stamped.then(|| vec![TRUTH[3] / 240.0; ROWS]),
            observed: Vec::new(),
            stretches: (0..runs)
                .map(|recording| Stretch {
                    recording,
                    first: 0,
                    rows: ROWS,
                    at_rest: !moving,
                })
                .collect(),
            threads: Some(2),
        };
        if stamped {
            planted.parameters[3] = Sought::Held(TRUTH[3]);
        }
        for commands in &planted.commands {
            let place =
                |random: &mut Random, reach: f64| [(); 2].map(|()| random.within(-reach, reach));
            let start = [place(&mut random, 0.25)];
            let velocity = [place(&mut random, if moving { 0.1 } else { 0.0 })];
            let parameters = [Parameters::from(TRUTH)];
            let batch = Batch {
                effects: &chosen,
                start: PerRollout::Shared(&start),
                start_velocity: PerRollout::Shared(&velocity),
                time: TimeBase::Continuous(None),
                ..Batch::new(&planted.rig, &parameters, commands)
            };
            let exact = batch
                .run(Engine::Rolling, Some(1), &AtomicBool::new(false))
                .unwrap();
            let seen = exact
                .iter()
                .map(|place| place.map(|x| x + NOISE * random.normal()))
                .collect();
            planted.observed.push(seen);
        }
        planted
    }

    fn with<T>(&self, ask: impl FnOnce(&Problem<'_>) -> T) -> T {
        let recordings: Vec<Recording<'_>> = self
            .commands
            .iter()
            .zip(&self.observed)
            .map(|(commands, observed)| Recording {
                commands,
                knobs_before: [0.0; 2],
                durations: self.durations.as_deref(),
                observed,
            })
            .collect();
        ask(&Problem {
            rig: &self.rig,
            parameters: self.parameters,
            effects: &self.effects,
            recordings: &recordings,
            stretches: &self.stretches,
            noise: None,
            engine: Engine::Rolling,
            threads: self.threads,
        })
    }

    fn fit(&self, starts: usize, seed: u64) -> Result<Solution, Error> {
        let settings = Settings { starts, seed };
        self.with(|problem| problem.fit(&settings, &|_, _, _| (), &AtomicBool::new(false)))
    }

    /// Looks first at the truth.
    fn from_truth(mut self) -> Self {
        for (sought, truth) in self.parameters.iter_mut().zip(TRUTH) {
            if let Sought::Free { start, .. } = sought {
                *start = Some(truth);
            }
        }
        self
    }
}

fn near(found: f64, truth: f64, part: f64) -> bool {
    (found - truth).abs() <= part * truth.abs()
}

#[test]
fn what_recordings_fix_is_found_from_anywhere() {
    for seed in 0..3 {
        let solution = Planted::new(seed, 8, &[], false, false)
            .fit(4, seed)
            .unwrap();
        assert!(near(solution.noise, NOISE, 0.1), "{}", solution.noise);
        assert!(
            near(solution.tracker_noise, NOISE, 0.1),
            "{}",
            solution.tracker_noise
        );
        // Along the first symmetry nothing but impacts tells the values apart.
        let fixed =
            |values: &[f64]| [0, 1, 2].map(|i| values[i] * values[3] * values[3] * values[4]);
        for (found, truth) in fixed(&solution.values).into_iter().zip(fixed(&TRUTH)) {
            assert!(near(found, truth, 0.02), "{:?}", solution.values);
        }
        assert!(
            near(solution.values[4], TRUTH[4], 0.01),
            "{:?}",
            solution.values
        );
        assert_eq!(solution.estimates[0].values, solution.values);
        assert_eq!(solution.estimates[0].path.last(), Some(&solution.values));
    }
}

#[test]
fn stamps_fix_the_time_scale_and_intervals_hold_the_truth() {
    let (mut held, mut count) = (0, 0);
    for seed in 0..25 {
        let planted = Planted::new(100 + seed, 3, &[], true, false).from_truth();
        let solution = planted.fit(1, 0).unwrap();
        assert_eq!(solution.values[3], TRUTH[3]);
        let information = &solution.information;
        assert_eq!(information.free, [0, 1, 2, 4]);
        for (&slot, deviation) in information.free.iter().zip(information.deviations()) {
            held += usize::from((solution.values[slot] - TRUTH[slot]).abs() <= 1.96 * deviation);
            count += 1;
        }
    }
    // Of 100 intervals of 95 %, fewer than 87 hold the truth in one of 1,000 tries; narrower ones than
    // needed hold it always.
    assert_eq!(count, 100);
    assert!((87..100).contains(&held), "{held} of {count}");
}

#[test]
fn effects_are_found_along_with_the_five() {
    let truth: [(&str, &[f64]); 2] = [("tilt_bias", &[0.004, -0.003]), ("lag", &[0.2])];
    let solution = Planted::new(7, 5, &truth, true, false).fit(4, 1).unwrap();
    assert!(near(solution.noise, NOISE, 0.1), "{}", solution.noise);
    let expected: Vec<f64> = TRUTH.into_iter().chain([0.004, -0.003, 0.2]).collect();
    let deviations = solution.information.deviations();
    for (&slot, deviation) in solution.information.free.iter().zip(deviations) {
        let miss = (solution.values[slot] - expected[slot]).abs();
        assert!(
            miss < 5.0 * deviation + 1e-3 * expected[slot].abs(),
            "{slot}: {:?}",
            solution.values
        );
        assert!(
            near(solution.values[slot], expected[slot], 0.1),
            "{slot}: {:?}",
            solution.values
        );
    }
}

#[test]
fn a_bump_is_found_wherever_it_is() {
    let truth: [(&str, &[f64]); 1] = [("bump", &[0.04, -0.03, 3e-4, 0.02])];
    let solution = Planted::new(3, 8, &truth, true, false).fit(6, 0).unwrap();
    assert!(near(solution.noise, NOISE, 0.1), "{}", solution.noise);
    for (found, truth) in solution.values[5..].iter().zip(truth[0].1) {
        assert!(near(*found, *truth, 0.1), "{:?}", solution.values);
    }
}

#[test]
fn windows_of_a_delayed_knob_know_what_was_commanded_before() {
    let truth: [(&str, &[f64]); 1] = [("delay", &[0.25])];
    let mut planted = Planted::new(5, 3, &truth, true, true);
    planted.stretches = (0..12)
        .map(|i| Stretch {
            recording: i / 4,
            first: 25 * (i % 4),
            rows: 25,
            at_rest: false,
        })
        .collect();
    let solution = planted.fit(4, 0).unwrap();
    assert!(near(solution.noise, NOISE, 0.1), "{}", solution.noise);
    assert!(
        near(solution.values[5], 0.25, 0.02),
        "{:?}",
        solution.values
    );
}

#[test]
fn moving_starts_lost_rows_and_outliers_do_no_harm() {
    let mut planted = Planted::new(11, 6, &[], true, true);
    let mut random = Random(ChaCha8Rng::seed_from_u64(1));
    for observed in &mut planted.observed {
        for (row, place) in observed.iter_mut().enumerate() {
            if row % 10 == 7 {
                *place = [f64::NAN; 2];
            } else if row > 0 && random.within(0.0, 1.0) < 0.05 {
                *place = place.map(|x| x + random.within(-0.4, 0.4));
            }
        }
    }
    let solution = planted.fit(4, 0).unwrap();
    for slot in [0, 1, 2, 4] {
        assert!(
            near(solution.values[slot], TRUTH[slot], 0.05),
            "{:?}",
            solution.values
        );
    }
    for (i, residuals) in solution.residuals.iter().enumerate() {
        assert_eq!(residuals.len(), ROWS);
        for (residual, seen) in residuals.iter().zip(&planted.observed[i]) {
            assert_eq!(residual[0].is_nan(), seen[0].is_nan());
        }
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    let truth: [(&str, &[f64]); 1] = [("lag", &[0.1])];
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
    let truth: [(&str, &[f64]); 1] = [("lag", &[0.0])];
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
        commands.iter_mut().for_each(|knobs| knobs[0] = 0.0);
    }
    for observed in &mut planted.observed {
        let start = observed[0][1];
        observed.iter_mut().for_each(|place| place[1] = start);
    }
    // A bump of no height has no place.
    planted.effects[0].values[2] = Sought::Held(0.0);
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
    planted.parameters = TRUTH.map(Sought::Held);
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
        commands.iter_mut().for_each(|knobs| knobs[0] = -knobs[0]);
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
    let planted = Planted::new(12, 3, &[], true, false).from_truth();
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
            .errors(&[solution.values.clone()], &solution.states, &cancel)
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
    let settings = Settings { starts: 2, seed: 0 };
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
        let mut planted = Planted::new(1, 1, &[("lag", &[0.1])], true, false);
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
        &|one| one.parameters[4] = Sought::Held(0.0),
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
