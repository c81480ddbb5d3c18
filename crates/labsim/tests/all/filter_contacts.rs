//! What the filter makes of walls, outliers of the tracker and marbles that are lost.

use labsim::board::GRAVITY;
use labsim::effects::effect;
use labsim::{EffectInstance, Noise, PerRollout, Rig};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use crate::filter::{ROW_S, filtered, noise, rolled};

/// The variances of predictions where a marble rolls into the wall at positive x with a speed along it, lies there, and
/// leaves when the board turns back.
fn at_a_wall(restitution: f64, departure: f64) -> Vec<[f64; 2]> {
    let values = [0.3, 0.3, 0.0, 12.0, 1.0];
    let mut commands = vec![[0.02, 0.2]; 40];
    commands.extend([[0.02, -0.2]; 10]);
    let observed = rolled(values, &[], &commands, [0.3, 0.0]);
    let noise = Noise {
        lasting: 0.0,
        push: 0.0,
        start_velocity: Some(0.0),
        restitution,
        departure,
        ..noise()
    };
    filtered(values, &[], &commands, &observed, noise)
        .0
        .variance
}

#[test]
fn an_impact_makes_the_velocity_along_the_wall_uncertain_too() {
    let (sure, unsure) = (at_a_wall(0.0, 0.0), at_a_wall(0.1, 0.0));
    let differs = |axis: usize| (1..40).find(|&row| unsure[row][axis] > 1.01 * sure[row][axis]);
    let hit = differs(0).expect("the marble meets the wall");
    assert_eq!(differs(1), Some(hit));
    assert_eq!(sure[1..hit], unsure[1..hit]);
}

#[test]
fn a_turn_of_the_board_makes_uncertain_how_a_marble_leaves_its_wall() {
    let (sure, unsure) = (at_a_wall(0.0, 0.0), at_a_wall(0.0, 0.05));
    assert_eq!(sure[1..=40], unsure[1..=40]);
    // A row later its place has the deviation of the push that came 0.05 s early or late.
    let speed = 0.05 * 5.0 / 7.0 * GRAVITY * 0.3 * 0.4;
    let expected = (speed * ROW_S / Rig::default().board.edge_x_m).powi(2);
    let found = unsure[41][0] - sure[41][0];
    assert!(
        (found / expected - 1.0).abs() < 0.05,
        "{found}, not {expected}"
    );
    // Along the wall nothing has changed.
    for row in 1..50 {
        assert_eq!(sure[row][1], unsure[row][1]);
    }
}

/// Predicted variances of a marble that comes to rest at a knob's angle (rad) and is freed by a larger turn, if
/// friction holds it so many times as firmly as it brakes a rolling one, and it breaks away at a time of that
/// deviation (s).
fn freed(ratio: f64, angle: f64, release: f64) -> Vec<[f64; 2]> {
    let friction = [EffectInstance {
        effect: effect("static_friction").unwrap(),
        values: PerRollout::Shared(&[ratio, 0.0]),
    }];
    let values = [0.3, 0.3, 0.004, 12.0, 1.0];
    let commands: Vec<[f64; 2]> = (0..80)
        .map(|row| match row {
            0..10 => [0.0, 0.06],
            10..60 => [0.0, angle],
            _ => [0.0, 0.2],
        })
        .collect();
    let observed = rolled(values, &friction, &commands, [0.0; 2]);
    assert_eq!(observed[50], observed[60]);
    let noise = Noise {
        lasting: 0.0,
        push: 0.0,
        start_velocity: Some(0.0),
        release,
        ..noise()
    };
    let (predicted, _) = filtered(values, &friction, &commands, &observed, noise);
    predicted.variance
}

#[test]
fn it_is_uncertain_when_a_marble_breaks_away() {
    let [sure, unsure] = [0.0, 0.05].map(|release| freed(3.0, -0.02, release));
    assert_eq!(sure[1..=60], unsure[1..=60]);
    // A row later its place has the deviation of 0.05 s more or less under what held it beyond rolling friction.
    let speed = 0.05 * 5.0 / 7.0 * GRAVITY * (0.3 * 0.02 - 0.004);
    let expected = (speed * ROW_S / Rig::default().board.edge_x_m).powi(2);
    let found = unsure[61][0] - sure[61][0];
    assert!(
        (found / expected - 1.0).abs() < 0.05,
        "{found}, not {expected}"
    );
    // Nothing pushes along y.
    for row in 1..80 {
        assert_eq!(sure[row][1], unsure[row][1]);
    }
}

#[test]
fn a_marble_that_rolling_friction_alone_holds_breaks_away_at_a_certain_time() {
    let [sure, unsure] = [0.0, 0.05].map(|release| freed(1.0, -0.01, release));
    assert_eq!(sure[1..], unsure[1..]);
}

/// Rolls along x, seen with an alternating error of the tracker's size.
fn rolling() -> ([f64; 5], Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let values = [0.3, 0.3, 0.0, 12.0, 1.0];
    let commands = vec![[0.0, 0.02]; 30];
    let mut observed = rolled(values, &[], &commands, [-0.2, 0.0]);
    for (row, place) in observed.iter_mut().enumerate().skip(1) {
        place[0] += if row % 2 == 0 { 5e-4 } else { -5e-4 };
    }
    (values, commands, observed)
}

#[test]
fn an_outlier_changes_what_is_predicted_no_more_than_a_lost_row() {
    let (values, commands, observed) = rolling();
    let sizes = Noise {
        push: 1e-6,
        ..noise()
    };
    for off in [0.02, -0.05, 0.3] {
        for row in [10, 15, 27] {
            let [mut glitch, mut gap] = [observed.clone(), observed.clone()];
            glitch[row][0] += off;
            gap[row] = [f64::NAN; 2];
            let [glitch, gap] =
                [glitch, gap].map(|seen| filtered(values, &[], &commands, &seen, sizes).0);
            for later in row + 1..commands.len() {
                let differs = glitch.marble[later][0] - gap.marble[later][0];
                let deviation = gap.variance[later][0].sqrt();
                assert!(
                    differs.abs() < deviation,
                    "{off} in row {row}: {differs} in row {later}, beside {deviation}"
                );
                let wider = glitch.variance[later][0] / gap.variance[later][0];
                assert!(wider < 1.05, "{off} in row {row}: {wider} in row {later}");
            }
        }
    }
}

#[test]
fn a_marble_that_another_wall_turned_is_followed() {
    let (values, commands, mut observed) = rolling();
    let (turned, wall) = (12, 21);
    for row in turned..wall {
        observed[row][0] = observed[turned - 1][0] - 0.03 * (row + 1 - turned) as f64;
    }
    let (predicted, _) = filtered(values, &[], &commands, &observed, noise());
    let rows = observed.iter().zip(&predicted.marble).enumerate();
    for (row, (seen, predicted)) in rows.take(wall).skip(turned + 2) {
        let off = (seen[0] - predicted[0]).abs();
        assert!(off < 0.01, "row {row}: {off}");
    }
}

/// A marble that just reaches a wall, or just does not, is on both sides of a choice that a filter with one mean
/// makes. The likelihood of a marble that is also pushed at random must hardly notice.
#[test]
fn a_wall_that_is_just_touched_leaves_no_jump_of_the_likelihood() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let commands: Vec<[f64; 2]> = (0..60)
        .map(|row| {
            [
                0.0,
                if row < 12 {
                    0.1
                } else {
                    -0.08 + 0.008 * f64::from(row - 12)
                },
            ]
        })
        .collect();
    let truth = [0.3, 0.3, 0.0, 12.0, 1.0];
    let sizes = Noise {
        push: 1e-6,
        restitution: 0.0,
        start_velocity: Some(0.0),
        ..noise()
    };
    let mut largest: f64 = 0.0;
    for _ in 0..10 {
        let pushed: Vec<[f64; 2]> = commands
            .iter()
            .map(|one| one.map(|angle| angle + 0.003 * normal()))
            .collect();
        let mut observed = rolled(truth, &[], &pushed, [0.17, 0.0]);
        for place in observed.as_flattened_mut() {
            *place += 1e-3 * normal();
        }
        let likelihoods: Vec<f64> = (0..400)
            .map(|step| {
                let mut values = truth;
                values[1] *= 0.9 + 5e-4 * f64::from(step);
                let (_, likelihood) = filtered(values, &[], &commands, &observed, sizes);
                likelihood[0]
            })
            .collect();
        let jumps = likelihoods.windows(2).map(|two| (two[1] - two[0]).abs());
        largest = jumps.fold(largest, f64::max);
    }
    assert!(largest < 2.0, "{largest}");
}

/// A marble that turns while the board still brakes it rolls back; one that turns a moment later is held, since the
/// board lies flatter then. A mean that did the other thing has to follow it.
#[test]
fn a_mean_that_stops_where_the_marble_does_not_is_mended_by_the_next_rows() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let friction = [EffectInstance {
        effect: effect("static_friction").unwrap(),
        values: PerRollout::Shared(&[3.0, 0.0]),
    }];
    let values = [0.3, 0.3, 0.004, 12.0, 1.0];
    let sizes = Noise {
        push: 1e-10,
        lasting: 0.0,
        start_velocity: Some(0.1),
        ..noise()
    };
    let [mut stopped, mut gone] = [Vec::new(), Vec::new()];
    for step in 0..60 {
        let start = 0.0863 + 5e-6 * f64::from(step);
        let commands: Vec<[f64; 2]> = (0..60)
            .map(|row| match row {
                0..10 => [0.0, start],
                20..50 => [0.0, -0.035],
                _ => [0.0, -0.06],
            })
            .collect();
        let mut observed = rolled(values, &friction, &commands, [-0.3, 0.0]);
        let rests = observed[30] == observed[40];
        for place in observed.as_flattened_mut() {
            *place += 1e-3 * normal();
        }
        let (_, [along, _]) = filtered(values, &friction, &commands, &observed, sizes);
        if rests { &mut stopped } else { &mut gone }.push(along);
    }
    // Where the mean did what the marble did it is 310, and without a comparison 134 to 280 where it did not.
    for (of, least) in [(stopped, 295.0), (gone, 245.0)] {
        assert!(of.len() > 20, "{of:?}");
        assert!(of.iter().all(|&one| one > least), "{of:?}");
    }
}
