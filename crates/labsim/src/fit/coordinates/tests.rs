use proptest::prelude::*;

use super::*;
use crate::board::Rig;
use crate::effects::effect;
use crate::engine::{Engine, Hold};
use crate::fit::{Hypothesis, ParameterSpec};

/// The optional difference of the lags about x and y, and the time of the break-away, are held.
const VALUES: [f64; 11] = [
    0.06, 0.03, 4e-4, 20.0, 1.05, 0.3, 0.0, 0.002, -0.003, 3.0, 0.0,
];
const FREE: usize = 9;

const RANGES: [(f64, f64); 5] = [
    (0.0, 0.1),
    (0.0, 0.1),
    (0.0, 0.001),
    (0.0, 50.0),
    (0.8, 1.2),
];

fn coordinates() -> Coordinates {
    coordinates_of(RANGES)
}

/// The five over these ranges, and a lag, a bias and a ratio.
fn coordinates_of(ranges: [(f64, f64); 5]) -> Coordinates {
    let names = ["lag", "tilt_bias", "static_friction"];
    let effects = names.map(|name| Hypothesis::free(effect(name).unwrap()));
    let problem = Problem {
        rig: &Rig::default(),
        parameters: ranges.map(|range| ParameterSpec::Free { range, start: None }),
        effects: &effects,
        recordings: &[],
        stretches: &[],
        noise: None,
        tilt_noise: None,
        engine: Engine::Rolling,
        hold: Hold::Zero,
        threads: None,
    };
    Coordinates::new(&problem, [1.0; 2]).unwrap()
}

fn assert_near(one: &[f64], other: &[f64], tolerance: f64) {
    for (one, other) in one.iter().zip(other) {
        assert!(
            (one - other).abs() <= tolerance * (1.0 + other.abs()),
            "{one} {other}"
        );
    }
}

#[test]
fn values_come_back() {
    let coordinates = coordinates();
    assert_near(
        &coordinates.to_values(&coordinates.to_z(&VALUES)),
        &VALUES,
        1e-12,
    );
}

#[test]
fn along_the_symmetries_products_stand_still() {
    let coordinates = coordinates();
    let z = coordinates.to_z(&VALUES);
    let moved = coordinates.to_values(&coordinates.along_time(&z, 25.0).unwrap());
    let slower = 25.0 / VALUES[TIME];
    let push = slower.powi(-2);
    let effects = [
        VALUES[5] * slower,
        0.0,
        VALUES[7] * push,
        VALUES[8] * push,
        VALUES[9],
    ];
    assert_near(&moved[3..5], &[25.0, VALUES[SCALE]], 1e-12);
    assert_near(&moved[5..], &effects, 1e-12);
    let scaled = coordinates.to_values(&coordinates.shifted(&z, SCALE, 0.01));
    for i in 0..3 {
        let time = |values: &[f64]| values[i] * values[TIME] * values[TIME];
        assert_near(&[time(&moved)], &[time(&VALUES)], 1e-12);
        assert_near(
            &[scaled[i] * scaled[SCALE]],
            &[VALUES[i] * VALUES[SCALE]],
            1e-12,
        );
    }
}

#[test]
fn a_gear_moves_without_the_friction() {
    let coordinates = coordinates();
    let z = coordinates.to_z(&VALUES);
    let moved = coordinates.to_values(&coordinates.shifted(&z, GEAR_X, 0.1));
    assert_near(&moved[1..], &VALUES[1..], 1e-12);
    // To first order the direction is the one that slopes are unwound by.
    let step = 1e-6;
    let along = coordinates.along(&z, GEAR_X);
    let shifted = coordinates.shifted(&z, GEAR_X, step);
    for (i, rate) in along {
        assert_near(&[(shifted[i] - z[i]) / step], &[rate], 1e-5);
    }
}

#[test]
fn derivatives_are_those_of_the_maps() {
    let coordinates = coordinates();
    for values in [
        VALUES,
        [
            0.15, 0.05, 0.002, 60.0, 0.7, 1.2, 0.0, 0.013, 0.0, 11.0, 0.0,
        ],
    ] {
        let z = coordinates.to_z(&values);
        let (derivative, slope) = (coordinates.derivative(&z), coordinates.excess_slope(&z));
        for j in 0..z.len() {
            let beside = |step: f64| {
                let mut z = z.clone();
                z[j] += step;
                z
            };
            let (ahead, behind) = (beside(1e-6), beside(-1e-6));
            let difference = |of: &dyn Fn(&[f64]) -> Vec<f64>| -> Vec<f64> {
                let pairs = of(&ahead).into_iter().zip(of(&behind));
                pairs
                    .map(|(ahead, behind)| (ahead - behind) / 2e-6)
                    .collect()
            };
            let column = |matrix: &[Vec<f64>]| matrix.iter().map(|row| row[j]).collect::<Vec<_>>();
            assert_near(
                &difference(&|z| {
                    let values = coordinates.to_values(z);
                    coordinates
                        .slots()
                        .iter()
                        .map(|&slot| values[slot])
                        .collect()
                }),
                &column(&derivative),
                1e-6,
            );
            assert_near(
                &difference(&|z| coordinates.excess(z)),
                &column(&slope),
                1e-4,
            );
        }
    }
}

proptest! {
    /// A scale of pictures, whose range has ends a factor apart: narrow and wide ones alike.
    #[test]
    fn a_range_is_left_by_its_own_width_and_at_most_threefold(
        low in 0.2..2.0_f64, factor in 1.001..30.0_f64,
    ) {
        let mut ranges = RANGES;
        ranges[SCALE] = (low, low * factor);
        let coordinates = coordinates_of(ranges);
        let scale = |far: f64| coordinates.to_values(&coordinates.clip(&[far; FREE]))[SCALE];
        let beyond = factor.min(3.0);
        assert_near(&[scale(-20.0), scale(20.0)], &[low / beyond, low * factor * beyond], 1e-9);
        // Inside it is free; a width outside costs as much for a narrow range as for one of a factor of e.
        let excess = |scale: f64| {
            let mut values = VALUES;
            values[SCALE] = scale;
            coordinates.excess(&coordinates.to_z(&values))[SCALE]
        };
        assert_near(&[excess(low * factor.sqrt())], &[0.0], 1e-9);
        if factor < 3.0_f64.min(1.0_f64.exp()) {
            assert_near(&[excess(low / factor), excess(low * factor * factor)], &[-10.0, 10.0], 1e-6);
        }
    }
}

#[test]
fn proposed_steps_stay_within_reach() {
    let coordinates = coordinates();
    for far in [-20.0, 20.0] {
        let clipped = coordinates.clip(&[far; FREE]);
        assert_near(&coordinates.clip(&clipped), &clipped, 1e-12);
        let values = coordinates.to_values(&clipped);
        assert!((0.0..=0.3 + 1e-9).contains(&values[GEAR_X]));
        assert!((0.5..=150.0 + 1e-9).contains(&values[TIME]));
        assert!(values[5] >= 0.0, "{values:?}");
        assert!(values[9] >= 1.0, "{values:?}");
    }
}
