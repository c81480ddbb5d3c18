//! The smoother against Gaussian conditioning.

use std::sync::atomic::AtomicBool;

use labsim::filter::Smoothed;
use labsim::{Noise, Rig};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

use crate::filter::{ROW_S, noise, rolled, with_filter};

pub(crate) fn smoothed(
    values: [f64; 5],
    commands: &[[f64; 2]],
    observed: &[[f64; 2]],
    noise: Noise,
) -> Vec<[Smoothed; 2]> {
    with_filter(values, &[], commands, observed, noise, |filter| {
        filter.smoothed(Some(1), &AtomicBool::new(false)).unwrap()
    })
}

/// What is random about a marble that rolls freely along one axis, as sums of independent standard normal numbers:
/// rows that are seen (board edges), accelerations by pushes since the row before (m/s²), and lasting errors.
fn sums(rows: usize, noise: &Noise, edge_m: f64) -> [DMatrix<f64>; 3] {
    // The first velocity, then for each row two of the push, and one each of the push that lasts, the lasting error
    // and the error of the row.
    let count = 1 + 5 * rows;
    let one = |i: usize, size: f64| DVector::from_fn(count, |j, _| if i == j { size } else { 0.0 });
    let of_row = |row: usize, which: usize| 1 + 5 * row + which;
    let kept = (-ROW_S / noise.pull_s).exp();
    let remembered = (-ROW_S / noise.lasting_s).exp();
    let fresh = |share: f64| (1.0 - share * share).sqrt();
    let mut lasting = one(of_row(0, 3), noise.lasting);
    let mut pull = one(of_row(0, 2), noise.pull);
    let mut speed = one(0, noise.start_velocity.unwrap_or(0.0));
    // The marble is where it was first seen, but for the tracker's errors.
    let mut place = -edge_m * (&lasting + one(of_row(0, 4), noise.white));
    let none = || DMatrix::zeros(rows, count);
    let (mut seen, mut pushes, mut errors) = (none(), none(), none());
    errors.set_row(0, &lasting.transpose());
    for row in 1..rows {
        // White noise makes a velocity, and a place that is correlated with it by sqrt(3)/2.
        let faster = one(of_row(row, 0), (noise.push * ROW_S).sqrt());
        let apart = one(of_row(row, 1), (noise.push * ROW_S / 12.0).sqrt() * ROW_S);
        let pushed = &pull * (0.5 * ROW_S * (1.0 + kept));
        place += &speed * ROW_S
            + &pull * (ROW_S * ROW_S * (2.0 + kept) / 6.0)
            + &faster * (0.5 * ROW_S)
            + apart;
        let gained = pushed + faster;
        pushes.set_row(row, &(&gained / ROW_S).transpose());
        speed += gained;
        pull = pull * kept + one(of_row(row, 2), noise.pull * fresh(kept));
        lasting = lasting * remembered + one(of_row(row, 3), noise.lasting * fresh(remembered));
        errors.set_row(row, &lasting.transpose());
        let shown = &place / edge_m + &lasting + one(of_row(row, 4), noise.white);
        seen.set_row(row, &shown.transpose());
    }
    [seen, pushes, errors]
}

proptest! {
    #[test]
    fn a_push_and_a_lasting_error_are_smoothed_as_the_normal_distribution_says(
        white in 1e-4..1e-2,
        lasting in 0.0..3e-3,
        lasting_s in 0.02..2.0,
        push in 0.0..1e-3,
        (pull, pull_s) in (0.0..0.1, 0.02..2.0),
        start_velocity in 0.0..0.2,
        signs in prop::collection::vec(prop::option::weighted(0.9, prop::array::uniform2(-0.5..0.5)), 15),
    ) {
        let noise = Noise {
            white, lasting, lasting_s, push, pull, pull_s, start_velocity: Some(start_velocity), ..noise()
        };
        let values = [0.02, 0.03, 0.0, 12.0, 1.1];
        let commands: Vec<[f64; 2]> = (0..15).map(|i| [0.05 * f64::from(i % 5), -0.03]).collect();
        let free = rolled(values, &[], &commands, [0.02, -0.01]);
        let off = |row: usize| if row == 0 { Some([0.0; 2]) } else { signs[row] };
        let observed: Vec<[f64; 2]> = (0..free.len())
            .map(|row| std::array::from_fn(|axis| off(row).map_or(f64::NAN, |off| free[row][axis] + white * off[axis])))
            .collect();
        let found = smoothed(values, &commands, &observed, noise);
        let [seen, pushes, errors] = sums(15, &noise, Rig::default().board.edge_x_m / values[4]);
        let rows: Vec<usize> = (1..15).filter(|&row| signs[row].is_some()).collect();
        prop_assume!(!rows.is_empty());
        let seen = seen.select_rows(&rows);
        let information = (&seen * seen.transpose()).cholesky().unwrap();
        for axis in [0, 1] {
            let off = DVector::from_iterator(rows.len(), rows.iter().map(|&row| white * signs[row].unwrap()[axis]));
            for (row, found) in found.iter().enumerate() {
                for (of, all) in [(found[axis].push, &pushes), (found[axis].lasting, &errors)] {
                    let with = &seen * all.row(row).transpose();
                    let (mean, gained) = (with.dot(&information.solve(&off)), with.dot(&information.solve(&with)));
                    let prior = all.row(row).norm_squared();
                    if row == 0 && of.mean.is_nan() {
                        prop_assert_eq!(prior, 0.0);
                        continue;
                    }
                    let tolerance = 1e-6 * prior.sqrt() + 1e-12;
                    prop_assert!((of.mean - mean).abs() < tolerance, "row {}: {} {}", row, of.mean, mean);
                    let (got, variance) = (of.deviation.powi(2), (prior - gained).max(0.0));
                    prop_assert!((got - variance).abs() < 1e-6 * prior + 1e-15, "row {}: {} {}", row, got, variance);
                }
            }
        }
    }
}

#[test]
fn no_push_is_known_while_friction_holds_the_marble() {
    let values = [0.02, 0.03, 2e-3, 12.0, 1.1];
    let commands: Vec<[f64; 2]> = (0..20)
        .map(|i| [if i < 10 { 0.0 } else { 1.0 }; 2])
        .collect();
    let observed = rolled(values, &[], &commands, [0.02, -0.01]);
    let noise = Noise {
        start_velocity: None,
        pull: 0.01,
        ..noise()
    };
    let found = smoothed(values, &commands, &observed, noise);
    let known: Vec<bool> = found
        .iter()
        .map(|row| row[0].push.mean.is_finite())
        .collect();
    let first = known.iter().position(|&is| is).unwrap();
    assert!((10..12).contains(&first), "{known:?}");
    assert!(known[first..].iter().all(|&is| is), "{known:?}");
    assert!(
        found[first..]
            .iter()
            .flatten()
            .all(|one| one.push.deviation > 0.0)
    );
}
