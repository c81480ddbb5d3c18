//! Predictions of the measured tilt against Gaussian conditioning, and beside those of the marble.

use std::sync::atomic::AtomicBool;

use labsim::effects::effect;
use labsim::filter::{Filter, MeasuredTilt, Predictions};
use labsim::{Batch, EffectInstance, Engine, Noise, Parameters, PerRollout, Rig, TimeBase};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

use crate::commands;
use crate::filter::{ROW_S, noise};

const ROWS: usize = 40;
const VALUES: [f64; 5] = [0.8, -0.6, 0.001, 12.0, 1.05];
const LAG: [f64; 2] = [0.07, 0.0];

/// Calls with a batch of rollouts, one for each of some values, whose board lags.
fn with_batch<T>(values: &[[f64; 5]], work: impl FnOnce(&Batch<'_>) -> T) -> T {
    let (rig, commands, durations) = (Rig::default(), commands(ROWS), vec![ROW_S; ROWS]);
    let parameters: Vec<Parameters> = values.iter().copied().map(Parameters::from).collect();
    let lag = EffectInstance {
        effect: effect("lag").unwrap(),
        values: PerRollout::Shared(&LAG),
    };
    work(&Batch {
        effects: &[lag],
        time: TimeBase::Durations(PerRollout::Shared(&durations)),
        ..Batch::new(&rig, &parameters, &commands)
    })
}

/// Marble and tilt without noise.
fn simulated() -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    with_batch(&[VALUES], |batch| {
        let found = batch
            .run_with_tilt(Engine::Rolling, Some(1), &AtomicBool::new(false))
            .unwrap();
        (found.marble, found.tilt)
    })
}

fn filtered(
    values: &[[f64; 5]],
    marble: Option<&[[f64; 2]]>,
    tilt: Option<(&[[f64; 2]], [f64; 2])>,
    noise: Noise,
    threads: usize,
) -> labsim::Result<(Predictions, Vec<[f64; 4]>)> {
    with_batch(values, |batch| {
        let filter = Filter {
            batch: *batch,
            observed: marble.map(PerRollout::Shared),
            tilt: tilt.map(|(rows, [gain, zero])| MeasuredTilt {
                rows: PerRollout::Shared(rows),
                predicted: None,
                gain,
                zero,
            }),
            noise: PerRollout::Shared(&[noise]),
        };
        let found = filter.run(Some(threads), &AtomicBool::new(false))?;
        let likelihoods = filter.log_likelihoods(&found);
        Ok((found, likelihoods))
    })
}

/// Mean and variance of each measured row given all before, by conditioning their joint normal distribution.
fn conditioned(
    free: &[f64],
    measured: &[f64],
    noise: &Noise,
    [gain, zero]: [f64; 2],
) -> Vec<(f64, f64)> {
    let covariance = DMatrix::from_fn(free.len(), free.len(), |i, j| {
        let apart = i.abs_diff(j) as f64 * ROW_S;
        let lasting = noise.tilt_lasting.powi(2) * (-apart / noise.tilt_lasting_s).exp();
        let white = if i == j {
            noise.tilt_white.powi(2)
        } else {
            0.0
        };
        gain * gain * free[i] * free[j] + zero * zero + lasting + white
    });
    let mut seen: Vec<usize> = Vec::new();
    let mut found = Vec::new();
    for row in 0..free.len() {
        let known = DMatrix::from_fn(seen.len(), seen.len(), |i, j| {
            covariance[(seen[i], seen[j])]
        });
        let with = DVector::from_fn(seen.len(), |i, _| covariance[(seen[i], row)]);
        let off = DVector::from_fn(seen.len(), |i, _| measured[seen[i]] - free[seen[i]]);
        let weights = known.cholesky().unwrap().solve(&with);
        found.push((
            free[row] + weights.dot(&off),
            covariance[(row, row)] - weights.dot(&with),
        ));
        if measured[row].is_finite() {
            seen.push(row);
        }
    }
    found
}

proptest! {
    #[test]
    fn tilts_are_predicted_as_the_normal_distribution_says(
        tilt_white in 1e-4..1e-2,
        tilt_lasting in 0.0..1e-2,
        tilt_lasting_s in 0.02..2.0,
        sensor in (0.0..0.3, 0.0..0.1),
        // Less than a standard deviation off, so that no row counts as an outlier.
        signs in prop::collection::vec(prop::option::weighted(0.8, prop::array::uniform2(-0.5..0.5)), ROWS),
    ) {
        let sensor = [sensor.0, sensor.1];
        let noise = Noise { tilt_white, tilt_lasting, tilt_lasting_s, ..noise() };
        let (marble, free) = simulated();
        let measured: Vec<[f64; 2]> = free
            .iter()
            .zip(&signs)
            .map(|(free, signs)| std::array::from_fn(|axis| {
                signs.map_or(f64::NAN, |signs| free[axis] + tilt_white * signs[axis])
            }))
            .collect();
        let (found, likelihoods) = filtered(&[VALUES], Some(&marble), Some((&measured, sensor)), noise, 1).unwrap();
        for axis in 0..2 {
            let of = |rows: &[[f64; 2]]| -> Vec<f64> { rows.iter().map(|row| row[axis]).collect() };
            let expected = conditioned(&of(&free), &of(&measured), &noise, sensor);
            for (row, (mean, variance)) in expected.into_iter().enumerate() {
                let (got, spread) = (found.tilt[row][axis], found.tilt_variance[row][axis]);
                prop_assert!((spread / variance - 1.0).abs() < 1e-6, "row {row}: {spread} {variance}");
                prop_assert!((got - mean).abs() < 1e-6 * variance.sqrt(), "row {row}: {got} {mean}");
            }
        }
        prop_assert!(likelihoods[0].iter().all(|one| one.is_finite()));
    }

    /// An outlier of any size leaves numbers, and costs what Student's t says.
    #[test]
    fn no_measured_tilt_leaves_no_number(
        rows in prop::collection::vec(prop::option::of(prop::array::uniform2(-1e3..1e3)), ROWS),
        sizes in prop::array::uniform3(0.0..1.0f64),
        sensor in prop::array::uniform2(0.0..1.0f64),
        gears in prop::array::uniform2(-5.0..5.0),
    ) {
        let noise = Noise {
            tilt_white: 1e-6 + sizes[0],
            tilt_lasting: sizes[1],
            tilt_lasting_s: 1e-3 + sizes[2],
            ..noise()
        };
        let measured: Vec<[f64; 2]> = rows.iter().map(|one| one.unwrap_or([f64::NAN; 2])).collect();
        let values = [gears[0], gears[1], VALUES[2], VALUES[3], VALUES[4]];
        let marble = vec![[f64::NAN; 2]; ROWS];
        let (found, likelihoods) = filtered(&[values], Some(&marble), Some((&measured, sensor)), noise, 1).unwrap();
        prop_assert!(found.tilt.as_flattened().iter().all(|one| one.is_finite()));
        prop_assert!(found.tilt_variance.as_flattened().iter().all(|one| *one > 0.0 && one.is_finite()));
        prop_assert!(likelihoods[0].iter().all(|one| one.is_finite()));
    }
}

#[test]
fn tilt_and_marble_change_no_bit_of_each_other_and_threads_none_of_either() {
    let sized = Noise {
        tilt_white: 1e-3,
        tilt_lasting: 2e-3,
        tilt_lasting_s: 0.2,
        ..noise()
    };
    let (marble, tilt) = simulated();
    let values: Vec<[f64; 5]> = (0..21)
        .map(|i| {
            [
                VALUES[0] + 0.01 * f64::from(i),
                VALUES[1],
                VALUES[2],
                VALUES[3],
                VALUES[4],
            ]
        })
        .collect();
    let run = |tilt, threads| filtered(&values, Some(&marble), tilt, sized, threads).unwrap();
    let (without, none) = run(None, 1);
    assert!(without.tilt.is_empty() && none.iter().all(|one| one[2..] == [0.0; 2]));
    let (found, likelihoods) = run(Some((&tilt, [0.1, 0.05])), 1);
    assert_eq!(found.marble, without.marble);
    for (with, without) in likelihoods.iter().zip(&none) {
        assert_eq!(with[..2], without[..2]);
    }
    for threads in [2, 4] {
        let (other, same) = run(Some((&tilt, [0.1, 0.05])), threads);
        assert_eq!(other.tilt, found.tilt);
        assert_eq!(other.tilt_variance, found.tilt_variance);
        assert_eq!(same, likelihoods);
    }
    let sweep = Some((&tilt[..], [0.1, 0.05]));
    let (alone, of_alone) = filtered(&values, None, sweep, sized, 2).unwrap();
    assert_eq!(alone.tilt, found.tilt);
    assert_eq!(alone.tilt_variance, found.tilt_variance);
    assert!(alone.marble.as_flattened().iter().all(|one| one.is_nan()));
    for (alone, with) in of_alone.iter().zip(&likelihoods) {
        assert_eq!(*alone, [0.0, 0.0, with[2], with[3]]);
    }
    // Gears are the less probable the farther they are from those that tilted the board.
    let of_tilt = |i: usize| likelihoods[i][2] + likelihoods[i][3];
    assert!(of_tilt(0) > of_tilt(10) && of_tilt(10) > of_tilt(20));
}

#[test]
fn a_measured_tilt_without_sizes_of_its_noise_is_refused() {
    let (marble, tilt) = simulated();
    let refused = filtered(
        &[VALUES],
        Some(&marble),
        Some((&tilt, [0.1, 0.1])),
        noise(),
        1,
    )
    .unwrap_err();
    assert!(refused.to_string().contains("tilt_white"), "{refused}");
}
