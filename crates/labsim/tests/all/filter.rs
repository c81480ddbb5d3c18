//! The filter against Gaussian conditioning, against free runs, and against itself.

use std::sync::atomic::AtomicBool;

use labsim::board::GRAVITY;
use labsim::effects::{effect, effects};
use labsim::filter::{Filter, Predictions};
use labsim::{Batch, EffectInstance, Engine, Noise, Parameters, PerRollout, Rig, TimeBase};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use crate::smoother::smoothed;

pub(crate) const ROW_S: f64 = 0.05;

pub(crate) fn noise() -> Noise {
    Noise {
        white: 1e-3,
        lasting: 5e-4,
        lasting_s: 0.2,
        push: 1e-4,
        pull: 0.0,
        pull_s: 0.2,
        restitution: 0.1,
        jitter: 0.0,
        departure: 0.0,
        release: 0.0,
        tilt_white: 0.0,
        tilt_lasting: 0.0,
        tilt_lasting_s: 0.0,
        start_velocity: Some(0.1),
    }
}

/// Filters one run of stamped rows from where it was first seen.
pub(crate) fn filtered(
    values: [f64; 5],
    effects: &[EffectInstance<'_>],
    commands: &[[f64; 2]],
    observed: &[[f64; 2]],
    noise: Noise,
) -> (Predictions, [f64; 2]) {
    with_filter(values, effects, commands, observed, noise, |filter| {
        let predictions = filter.run(Some(1), &AtomicBool::new(false)).unwrap();
        let [x, y, ..] = filter.log_likelihoods(&predictions)[0];
        (predictions, [x, y])
    })
}

pub(crate) fn with_filter<T>(
    values: [f64; 5],
    effects: &[EffectInstance<'_>],
    commands: &[[f64; 2]],
    observed: &[[f64; 2]],
    noise: Noise,
    work: impl Fn(&Filter<'_>) -> T,
) -> T {
    let rig = Rig::default();
    let durations = vec![ROW_S; commands.len()];
    let parameters = [Parameters::from(values)];
    work(&Filter {
        batch: Batch {
            effects,
            start: PerRollout::Shared(&observed[..1]),
            time: TimeBase::Durations(PerRollout::Shared(&durations)),
            ..Batch::new(&rig, &parameters, commands)
        },
        observed: Some(PerRollout::Shared(observed)),
        tilt: None,
        noise: PerRollout::Shared(&[noise]),
    })
}

pub(crate) fn rolled(
    values: [f64; 5],
    effects: &[EffectInstance<'_>],
    commands: &[[f64; 2]],
    start: [f64; 2],
) -> Vec<[f64; 2]> {
    let rig = Rig::default();
    let durations = vec![ROW_S; commands.len()];
    Batch {
        effects,
        start: PerRollout::Shared(&[start]),
        time: TimeBase::Durations(PerRollout::Shared(&durations)),
        ..Batch::new(&rig, &[Parameters::from(values)], commands)
    }
    .run(Engine::Rolling, Some(1), &AtomicBool::new(false))
    .unwrap()
}

/// Mean and variance of each row given all rows before, for a marble that rolls freely along one axis from a place
/// of which nothing is known: by conditioning the joint normal distribution of all rows.
///
/// `turns` are the changes of the board's tilt as each row begins (rad).
fn conditioned(
    free: &[f64],
    observed: &[f64],
    turns: &[f64],
    noise: &Noise,
    edge_m: f64,
) -> Vec<(f64, f64)> {
    let rows = free.len();
    let kick = |row: usize| (noise.jitter * 5.0 / 7.0 * GRAVITY * turns[row]).powi(2);
    let covariance = DMatrix::from_fn(rows, rows, |i, j| {
        let (s, t) = (i.min(j) as f64 * ROW_S, i.max(j) as f64 * ROW_S);
        let push = noise.push * s * s * (3.0 * t - s) / 6.0;
        let start = noise.start_velocity.unwrap_or(0.0).powi(2) * s * t;
        let lasting = noise.lasting.powi(2) * (-(t - s) / noise.lasting_s).exp();
        let white = if i == j { noise.white.powi(2) } else { 0.0 };
        // A push that lasts goes over evenly from row to row.
        let kept = (-ROW_S / noise.pull_s).exp();
        let moves = |row: usize, k: usize| {
            let rolls = (row - 1 - k) as f64 * ROW_S * ROW_S * (1.0 + kept) / 2.0;
            rolls + ROW_S * ROW_S * (2.0 + kept) / 6.0
        };
        let mut pull = 0.0;
        for k in 0..i {
            for l in 0..j {
                let both = kept.powf(k.abs_diff(l) as f64) * noise.pull.powi(2);
                pull += both * moves(i, k) * moves(j, l);
            }
        }
        // A command at the wrong time leaves another velocity from its row on.
        let kicked: f64 = (0..i.min(j))
            .map(|k| kick(k) * (i - k) as f64 * (j - k) as f64 * ROW_S * ROW_S)
            .sum();
        (push + start + pull + kicked) / edge_m.powi(2) + lasting + white
    });
    // The first place was seen, and nothing else is known of it: differences from it are all that counts.
    let from_first = DMatrix::from_fn(rows - 1, rows - 1, |i, j| {
        covariance[(i + 1, j + 1)] + covariance[(0, 0)]
            - covariance[(i + 1, 0)]
            - covariance[(0, j + 1)]
    });
    let off = DVector::from_fn(rows - 1, |i, _| observed[i + 1] - free[i + 1]);
    (0..rows - 1)
        .map(|row| {
            if row == 0 {
                return (free[1], from_first[(0, 0)]);
            }
            let known = from_first.view((0, 0), (row, row)).into_owned();
            let with = from_first.view((0, row), (row, 1)).into_owned();
            let weights = known.cholesky().unwrap().solve(&with);
            let mean = weights.dot(&off.rows(0, row));
            (
                free[row + 1] + mean,
                from_first[(row, row)] - weights.dot(&with),
            )
        })
        .collect()
}

proptest! {
    #[test]
    fn a_marble_that_rolls_freely_is_filtered_as_the_normal_distribution_says(
        white in 1e-4..1e-2,
        lasting in 0.0..3e-3,
        lasting_s in 0.02..2.0,
        push in 0.0..1e-3,
        (pull, pull_s) in (0.0..0.1, 0.02..2.0),
        start_velocity in 0.0..0.2,
        jitter in 0.0..0.1,
        signs in prop::collection::vec(prop::array::uniform2(-0.5..0.5), 25),
    ) {
        let start_velocity = Some(start_velocity);
        let noise = Noise {
            white, lasting, lasting_s, push, pull, pull_s, restitution: 0.3, jitter, departure: 0.1, release: 0.1, start_velocity,
            ..noise()
        };
        let values = [0.02, 0.03, 0.0, 12.0, 1.1];
        let commands: Vec<[f64; 2]> = (0..25).map(|i| [0.05 * f64::from(i % 5), -0.03]).collect();
        let start = [0.02, -0.01];
        let free = rolled(values, &[], &commands, start);
        // Less than a standard deviation off, so that no row counts as an outlier.
        let observed: Vec<[f64; 2]> = free
            .iter()
            .zip(&signs)
            .enumerate()
            .map(|(row, (place, sign))| if row == 0 { *place } else {
                [place[0] + white * sign[0], place[1] + white * sign[1]]
            })
            .collect();
        let (predicted, _) = filtered(values, &[], &commands, &observed, noise);
        let edge_m = Rig::default().board.edge_x_m / values[4];
        for axis in 0..2 {
            let of = |rows: &[[f64; 2]]| -> Vec<f64> { rows.iter().map(|row| row[axis]).collect() };
            // A turn about y pushes along x, and a turn about x against y.
            let other = 1 - axis;
            let turns: Vec<f64> = (0..commands.len())
                .map(|row| values[other] * (commands[row][other] - if row > 0 { commands[row - 1][other] } else { 0.0 }))
                .collect();
            let expected = conditioned(&of(&free), &of(&observed), &turns, &noise, edge_m);
            for (row, (mean, variance)) in expected.into_iter().enumerate() {
                let (got, spread) = (predicted.marble[row + 1][axis], predicted.variance[row + 1][axis]);
                prop_assert!((spread / variance - 1.0).abs() < 1e-6, "row {row}: {spread} {variance}");
                prop_assert!((got - mean).abs() < 1e-6 * variance.sqrt(), "row {row}: {got} {mean}");
            }
        }
    }

    #[test]
    fn rows_of_a_free_run_are_predicted_as_they_are(
        gears in prop::array::uniform2(0.05..0.6),
        friction in 0.0..0.02,
        push in 0.0..1e-2,
        chosen in 0..effects().len(),
        amplitude in 0.02..0.2,
    ) {
        let about = effects()[chosen];
        let values: Vec<f64> = about
            .parameters
            .iter()
            .map(|one| if one.is_choice() || one.optional { one.neutral } else { 0.75 * one.range.1 + 0.25 * one.range.0 })
            .collect();
        // A draw for each row, and a picture older than its row, are seen only once they have happened.
        prop_assume!(!["delay_jitter", "latency"].contains(&about.name));
        let effects = [EffectInstance { effect: about, values: PerRollout::Shared(&values) }];
        let commands: Vec<[f64; 2]> = (0..60)
            .map(|i| [amplitude * (0.3 * f64::from(i)).sin(), amplitude * (0.2 * f64::from(i)).cos()])
            .collect();
        let values = [gears[0], gears[1], friction, 12.0, 1.0];
        let free = rolled(values, &effects, &commands, [0.1, -0.05]);
        let (predicted, _) = filtered(values, &effects, &commands, &free, Noise { push, ..noise() });
        for (row, (predicted, free)) in predicted.marble.iter().zip(&free).enumerate() {
            for axis in 0..2 {
                prop_assert!((predicted[axis] - free[axis]).abs() < 1e-12, "{} row {row}", about.name);
            }
        }
    }

    #[test]
    fn nothing_makes_it_fail(
        values in (-0.8..0.8, -0.8..0.8, 0.0..0.1, 0.0..50.0, 0.2..5.0),
        sizes in prop::array::uniform9(0.0..1.0f64),
        seen in prop::collection::vec(prop::option::of(prop::array::uniform2(-2.0..2.0)), 40),
        amplitude in 0.0..1.5,
    ) {
        let noise = Noise {
            white: 1e-6 + sizes[0],
            lasting: sizes[1],
            lasting_s: 1e-3 + sizes[2],
            push: sizes[3],
            restitution: sizes[4],
            start_velocity: Some(sizes[5]),
            pull: sizes[6],
            pull_s: 1e-3 + sizes[7],
            jitter: sizes[8],
            departure: sizes[8],
            release: sizes[8],
            ..noise()
        };
        let values = [values.0, values.1, values.2, values.3, values.4];
        let commands: Vec<[f64; 2]> = (0..40)
            .map(|i| [amplitude * (0.7 * f64::from(i)).sin(), amplitude * (0.5 * f64::from(i)).cos()])
            .collect();
        let mut observed: Vec<[f64; 2]> = seen.iter().map(|one| one.unwrap_or([f64::NAN; 2])).collect();
        observed[0] = [0.0; 2];
        let (predicted, likelihood) = filtered(values, &[], &commands, &observed, noise);
        prop_assert!(predicted.marble.as_flattened().iter().all(|one| one.is_finite()));
        prop_assert!(predicted.variance[1..].as_flattened().iter().all(|one| *one > 0.0 && one.is_finite()));
        prop_assert!(likelihood.iter().all(|one| one.is_finite()));
        let smoothed = smoothed(values, &commands, &observed, noise);
        for row in &smoothed[1..] {
            // Where friction holds the marble, nothing is known of a push along either axis.
            let held = row[0].push.mean.is_nan();
            for one in row {
                prop_assert!(one.lasting.mean.is_finite() && one.lasting.deviation.is_finite());
                for known in [one.push.mean, one.push.deviation] {
                    prop_assert_eq!((known.is_nan(), known.is_finite()), (held, !held));
                }
            }
        }
    }
}

/// Nothing but a command that changes can come at another time.
#[test]
fn jitter_changes_no_bit_before_the_first_command_that_changes() {
    let change = 20;
    let commands: Vec<[f64; 2]> = (0..40)
        .map(|row| {
            if row < change {
                [0.0; 2]
            } else {
                [0.05, -0.03]
            }
        })
        .collect();
    let observed: Vec<[f64; 2]> = (0..40)
        .map(|row| [0.1 + 0.002 * f64::from(row), -0.1 + 0.003 * f64::from(row)])
        .collect();
    let run = |jitter| {
        let noise = Noise { jitter, ..noise() };
        filtered([0.3, 0.2, 0.0, 12.0, 1.0], &[], &commands, &observed, noise).0
    };
    let (none, some, more) = (run(0.0), run(0.01), run(0.1));
    // What a command does is seen a row later.
    let first = 1 + change as usize;
    let until = |one: &Predictions| -> Vec<u64> {
        let all = [&one.marble[..first], &one.variance[..first]];
        let all = all.into_iter().flat_map(<[[f64; 2]]>::as_flattened);
        all.map(|value| value.to_bits()).collect()
    };
    assert!(until(&none) == until(&some) && until(&some) == until(&more));
    for axis in 0..2 {
        let [none, some, more] = [&none, &some, &more].map(|one| one.variance[first][axis]);
        assert!(none < some && some < more, "{none} {some} {more}");
    }
}

#[test]
fn sizes_and_their_array_are_the_same_noise() {
    for start_velocity in [Some(0.1), None] {
        let one = Noise {
            jitter: 0.03,
            start_velocity,
            ..noise()
        };
        let sizes = <[f64; 14]>::from(one);
        assert_eq!(sizes[7], 0.03);
        assert_eq!(Noise::from(sizes), one);
    }
}

#[test]
fn a_jitter_below_zero_is_refused() {
    for jitter in [-1e-3, f64::NAN, f64::INFINITY] {
        let refused = Noise { jitter, ..noise() }.check().unwrap_err();
        assert!(refused.to_string().contains("jitter"), "{refused}");
    }
}

/// A random tilt that the filter does not know of is a random push: the predictions' variances are right, and the
/// likelihood is the highest where the size of the push is.
#[test]
fn a_push_that_is_there_is_found() {
    let (rows, size) = (60, 0.01);
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let values = [0.3, 0.3, 0.002, 12.0, 1.0];
    let truth = (5.0 / 7.0 * GRAVITY * size).powi(2) * ROW_S;
    let factors = [0.1, 0.5, 1.0, 2.0, 10.0];
    let mut sums = [0.0; 5];
    let (mut squares, mut count) = (0.0, 0.0);
    for _ in 0..20 {
        let commands: Vec<[f64; 2]> = (0..rows)
            .map(|i| {
                [
                    0.1 * (0.4 * f64::from(i)).sin(),
                    0.1 * (0.3 * f64::from(i)).cos(),
                ]
            })
            .collect();
        let pushed: Vec<[f64; 2]> = commands
            .iter()
            .map(|one| one.map(|angle| angle + size / 0.3 * normal()))
            .collect();
        let mut observed = rolled(values, &[], &pushed, [0.0; 2]);
        for place in observed.as_flattened_mut() {
            *place += 1e-3 * normal();
        }
        for (sum, factor) in sums.iter_mut().zip(factors) {
            let noise = Noise {
                lasting: 0.0,
                push: factor * truth,
                start_velocity: Some(0.0),
                ..noise()
            };
            let (predicted, likelihood) = filtered(values, &[], &commands, &observed, noise);
            *sum += likelihood[0] + likelihood[1];
            if factor == 1.0 {
                let all = observed
                    .as_flattened()
                    .iter()
                    .zip(predicted.marble.as_flattened());
                for ((seen, mean), variance) in all.zip(predicted.variance.as_flattened()).skip(2) {
                    // A stop and an impact are no normal deviations.
                    squares += ((seen - mean).powi(2) / variance).min(9.0);
                    count += 1.0;
                }
            }
        }
    }
    let ratio: f64 = squares / count;
    assert!((ratio - 1.0).abs() < 0.15, "{ratio}");
    let best = (0..5).max_by(|&a, &b| sums[a].total_cmp(&sums[b])).unwrap();
    assert!((1..=3).contains(&best), "{sums:?}");
}

#[test]
fn threads_and_neighbours_change_no_bit() {
    let rig = Rig::default();
    let commands: Vec<[f64; 2]> = (0..50)
        .map(|i| {
            [
                0.1 * (0.4 * f64::from(i)).sin(),
                0.1 * (0.3 * f64::from(i)).cos(),
            ]
        })
        .collect();
    let values: Vec<[f64; 5]> = (0..37)
        .map(|i| {
            [
                0.1 + 0.01 * f64::from(i),
                0.3,
                0.001 * f64::from(i),
                12.0,
                1.0,
            ]
        })
        .collect();
    let lag = EffectInstance {
        effect: effect("lag").unwrap(),
        values: PerRollout::Shared(&[0.05, 0.0]),
    };
    let observed = rolled(values[20], &[lag], &commands, [0.0; 2]);
    let durations = vec![ROW_S; commands.len()];
    let run = |values: &[[f64; 5]], threads: usize| {
        let parameters: Vec<Parameters> = values.iter().copied().map(Parameters::from).collect();
        let effects = [lag];
        let filter = Filter {
            batch: Batch {
                effects: &effects,
                time: TimeBase::Durations(PerRollout::Shared(&durations)),
                ..Batch::new(&rig, &parameters, &commands)
            },
            observed: Some(PerRollout::Shared(&observed)),
            tilt: None,
            noise: PerRollout::Shared(&[noise()]),
        };
        filter.run(Some(threads), &AtomicBool::new(false)).unwrap()
    };
    let together = run(&values, 1);
    for threads in [2, 4] {
        let other = run(&values, threads);
        assert!(bits(&together) == bits(&other));
    }
    for (i, one) in values.iter().enumerate() {
        let alone = run(&[*one], 1);
        let own = i * commands.len()..(i + 1) * commands.len();
        assert_eq!(alone.marble, together.marble[own]);
    }
}

fn bits(predictions: &Predictions) -> Vec<u64> {
    let all = [&predictions.marble, &predictions.variance];
    all.into_iter()
        .flat_map(|one| one.as_flattened().iter().map(|value| value.to_bits()))
        .collect()
}
