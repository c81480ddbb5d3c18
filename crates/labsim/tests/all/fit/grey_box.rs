//! What is planted is found where the marble is pushed at random as well, and nothing else.

use std::sync::atomic::AtomicBool;

use labsim::Noise;
use labsim::effects::effect;
use labsim::fit::{Hypothesis, Probable};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::planted::{NOISE, Planted, Random, TRUTH, near};

/// Standard deviation of the random angle (rad) that the knobs take in each row, a tenth of the drive.
const PUSH_RAD: f64 = 0.015;

/// Runs whose knobs did not quite do what the recordings say.
fn pushed(seed: u64, effects: &[(&str, &[f64])], push_rad: f64) -> Planted {
    let mut planted = Planted::new(seed, 6, effects, true, false);
    let mut random = Random(ChaCha8Rng::seed_from_u64(seed + 1000));
    for knobs in planted.commands.iter_mut().flatten().flatten() {
        *knobs += push_rad * random.normal();
    }
    planted
}

/// The top that is reached with some effects from a share of the truth.
fn top(planted: &mut Planted, share: f64, effects: &[(&str, &[f64])]) -> Probable {
    top_with_jitter(planted, share, effects, 0.0)
}

/// The same where the jitter of commands begins at a size (s).
fn top_with_jitter(
    planted: &mut Planted,
    share: f64,
    effects: &[(&str, &[f64])],
    jitter: f64,
) -> Probable {
    planted.effects = effects
        .iter()
        .map(|(name, _)| Hypothesis::free(effect(name).unwrap()))
        .collect();
    let own = effects
        .iter()
        .flat_map(|(_, values)| values.iter().copied());
    let mut values: Vec<f64> = TRUTH
        .into_iter()
        .map(|one| share * one)
        .chain(own)
        .collect();
    values[3] = TRUTH[3];
    // A picture's scale is known to some percent, and where it puts a wall decides what an impact looks like.
    values[4] = 1.0 + share * (TRUTH[4] - 1.0);
    let noise = |push| Noise {
        white: NOISE,
        lasting: 1e-5,
        lasting_s: 0.1,
        push,
        pull: 1e-3,
        pull_s: 0.2,
        restitution: 0.1,
        jitter,
        departure: 0.0,
        release: 0.0,
        tilt_white: 0.0,
        tilt_lasting: 0.0,
        tilt_lasting_s: 0.0,
        start_velocity: Some(0.1),
    };
    // The hill has several tops: with a large push it is smooth, and lower ones hold no longer. A complete model has
    // hardly any push.
    let quiet = Noise {
        pull: 1e-4,
        restitution: 0.02,
        ..noise(1e-10)
    };
    let [a, b, c, d] = [1e-8, 1e-6, 1e-4, 1e-2].map(noise);
    let noise = [quiet, a, b, c, d];
    let best = |values: &[f64]| {
        let values = vec![values.to_vec(); noise.len()];
        let tops = planted
            .with(|problem| problem.ascend(&values, &noise, None, 60, &AtomicBool::new(false)));
        let tops = tops.unwrap().into_iter();
        tops.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
            .unwrap()
    };
    let first = best(&values);
    best(&first.values)
}

/// The spectral density of all that pushes at random, at frequencies at which it lasts (m²/s³).
fn density(one: &Probable) -> f64 {
    one.noise.push + 2.0 * one.noise.pull.powi(2) * one.noise.pull_s
}

#[test]
fn effects_are_found_beside_a_random_push() {
    let truth: [(&str, &[f64]); 2] = [("delay", &[0.15, 0.0]), ("viscous_drag", &[0.4])];
    let (mut held, mut count) = (0, 0);
    for seed in 0..3 {
        let mut planted = pushed(seed, &truth, PUSH_RAD);
        let full = top(
            &mut planted,
            0.9,
            &[("delay", &[0.05, 0.0]), ("viscous_drag", &[0.1])],
        );
        let (delay, drag) = (full.values[5], full.values[7]);
        assert!(
            near(delay, 0.15, 0.2) && near(drag, 0.4, 0.5),
            "{:?}",
            full.values
        );
        for rest in [
            [("delay", &[0.05, 0.0][..])],
            [("viscous_drag", &[0.1][..])],
        ] {
            let less = top(&mut planted, 0.9, &rest);
            assert!(full.log_evidence - less.log_evidence > 10.0, "{rest:?}");
            assert!(density(&less) > density(&full));
        }
        let expected: Vec<f64> = TRUTH.into_iter().chain([0.15, 0.0, 0.4]).collect();
        for (i, slot) in full.slots.into_iter().enumerate() {
            let deviation = full.covariance[(i, i)].sqrt();
            held += usize::from((full.values[slot] - expected[slot]).abs() < 1.96 * deviation);
            count += 1;
        }
    }
    // Fewer than 14 of 18 intervals of 95 % hold the truth in one of 1,000 tries.
    assert!(count == 18 && held >= 14, "{held} of {count}");
}

/// Delays (s) that differ by so much (s): in each of the recordings by other draws.
const LATE: [(&str, &[f64]); 1] = [("delay", &[0.15, 0.0])];
const JITTER_S: f64 = 0.05;

#[test]
fn planted_jitter_is_found_in_its_size() {
    for seed in 0..3 {
        let differing: [(&str, &[f64]); 2] = [LATE[0], ("delay_jitter", &[JITTER_S])];
        let mut planted = Planted::new(seed, 6, &differing, true, false);
        let begun: [(&str, &[f64]); 1] = [("delay", &[0.1, 0.0])];
        let with = top_with_jitter(&mut planted, 0.9, &begun, 0.01);
        let without = top(&mut planted, 0.9, &begun);
        let found = with.noise.jitter;
        assert!(near(found, JITTER_S, 0.5), "{found}");
        assert!(near(with.values[5], 0.15, 0.2), "{:?}", with.values);
        // A push makes up for it, but acts where no command changes as well.
        let gain = with.log_likelihood - without.log_likelihood;
        assert!(gain > 10.0, "{gain}");
        assert!(density(&with) < 0.5 * density(&without));
    }
}

#[test]
fn jitter_shrinks_where_delays_are_the_same_and_stays_zero_where_it_was() {
    let mut planted = Planted::new(5, 6, &LATE, true, false);
    let with = top_with_jitter(&mut planted, 1.0, &LATE, 0.03);
    let without = top(&mut planted, 1.0, &LATE);
    assert!(with.noise.jitter < 0.1 * JITTER_S, "{}", with.noise.jitter);
    assert_eq!(without.noise.jitter, 0.0);
    let gain = with.log_likelihood - without.log_likelihood;
    assert!(gain < 10.0, "{gain}");
}

#[test]
fn a_push_alone_asks_for_no_effect() {
    let candidates: [(&str, &[f64]); 4] = [
        ("delay", &[0.02, 0.0]),
        ("viscous_drag", &[0.05]),
        ("tilt_bias", &[0.0, 0.0]),
        ("backlash", &[0.005, 0.005]),
    ];
    for seed in 10..12 {
        for push_rad in [0.0, PUSH_RAD] {
            let mut planted = pushed(seed, &[], push_rad);
            // From the truth, so that the evidence decides and not the search.
            let base = top(&mut planted, 1.0, &[]);
            for one in candidates {
                let more = top(&mut planted, 1.0, &[one]);
                // The hill is rough: less begins where more has ended, too.
                planted.effects = Vec::new();
                let from = (&[more.values[..5].to_vec()], &[more.noise], [more.states]);
                let less = planted.with(|problem| {
                    problem.ascend(from.0, from.1, Some(&from.2), 60, &AtomicBool::new(false))
                });
                let less = less.unwrap().remove(0).log_evidence;
                let gain = more.log_evidence - less.max(base.log_evidence);
                assert!(gain < 10.0, "{} {push_rad} {gain}", one.0);
            }
        }
    }
}

#[test]
fn threads_change_no_bit() {
    let truth: [(&str, &[f64]); 1] = [("delay", &[0.15, 0.0])];
    let mut planted = pushed(3, &truth, PUSH_RAD);
    let tops = [1, 2, 4].map(|threads| {
        planted.threads = Some(threads);
        top(&mut planted, 0.9, &truth)
    });
    assert!(tops[0] == tops[1] && tops[1] == tops[2]);
}

#[test]
fn threads_change_no_bit_without_a_fold() {
    let truth: [(&str, &[f64]); 1] = [("delay", &[0.15, 0.0])];
    let mut planted = pushed(3, &truth, PUSH_RAD);
    let all = top(&mut planted, 0.9, &truth);
    let found = [1, 2, 4].map(|threads| {
        planted.threads = Some(threads);
        let found = planted.with(|problem| {
            problem.leave_out(
                &all.values,
                &all.noise,
                &all.states,
                &[Some(2), Some(0), Some(1), None, Some(1), Some(2)],
                12,
                &AtomicBool::new(false),
            )
        });
        found.unwrap()
    });
    assert_eq!(found[0].len(), 3);
    assert!(found[0] == found[1] && found[1] == found[2]);
    assert!(
        found[0]
            .iter()
            .all(|one| one.log_likelihood < all.log_likelihood)
    );
}
