//! Properties that all effects of the engine share.

use std::sync::LazyLock;
use std::sync::atomic::AtomicBool;

use labsim::effects::{Parameter, known};
use labsim::{
    Batch, EffectInstance, EffectSpec, Engine, Live, Parameters, PerRollout, Rig, TimeBase,
};
use proptest::prelude::*;

use crate::commands;

const ROWS: usize = 60;
const ENGINES: [Engine; 2] = [Engine::Rolling, Engine::Rapier];

fn parameters() -> [Parameters; 3] {
    [
        [0.05, 0.08, 3e-4, 12.0, 1.0].into(),
        [0.08, 0.03, 7e-4, 12.0, 0.9].into(),
        [0.02, 0.02, 0.0, 17.0, 1.1].into(),
    ]
}

fn run(
    engine: Engine,
    effects: &[EffectInstance<'_>],
    threads: usize,
    change: impl Fn(&mut Batch<'_>),
) -> Vec<[f64; 2]> {
    let (rig, parameters, commands) = (Rig::default(), parameters(), commands(ROWS));
    let mut batch = Batch {
        effects,
        start: PerRollout::Shared(&[[0.1, -0.05]]),
        start_velocity: PerRollout::Shared(&[[0.2, 0.1]]),
        ..Batch::new(&rig, &parameters, &commands)
    };
    change(&mut batch);
    batch
        .run(engine, Some(threads), &AtomicBool::new(false))
        .expect("the inputs are physical")
}

fn chosen<'a>(effect: &'static EffectSpec, values: &'a [f64]) -> EffectInstance<'a> {
    EffectInstance {
        effect,
        values: PerRollout::Shared(values),
    }
}

/// Values at a place of a box, 0 to 1 along each side; choices are made by halves.
fn values(
    effect: &EffectSpec,
    ends: fn(&Parameter) -> (f64, f64),
    place: impl Fn(usize) -> f64,
) -> Vec<f64> {
    let at = |(i, one): (usize, &Parameter)| {
        let ((low, high), place) = if one.is_choice() {
            (one.allowed, place(i).round())
        } else {
            (ends(one), place(i))
        };
        low + place * (high - low)
    };
    effect.parameters.iter().enumerate().map(at).collect()
}

/// Values at a place of the box of plausible ones.
fn within(effect: &EffectSpec, place: impl Fn(usize) -> f64) -> Vec<f64> {
    values(effect, |one| one.range, place)
}

/// Values at a place of the box of allowed ones.
fn allowed(effect: &EffectSpec, place: impl Fn(usize) -> f64) -> Vec<f64> {
    values(effect, |one| (one.allowed.0, one.allowed.1.min(1e6)), place)
}

#[test]
fn at_neutral_values_a_rollout_keeps_every_bit() {
    let none: fn(&mut Batch<'_>) = |_| ();
    let stamped: fn(&mut Batch<'_>) = |batch| {
        batch.time = TimeBase::Durations(PerRollout::Shared(&[0.061; ROWS]));
        batch.first = PerRollout::Shared(&[7]);
        batch.rows = 20;
    };
    for change in [none, stamped] {
        for engine in ENGINES {
            let base = run(engine, &[], 1, change);
            for effect in known() {
                let same = run(engine, &[chosen(effect, &effect.neutral())], 1, change);
                assert_eq!(same, base, "{} in {engine:?}", effect.name);
            }
            let neutral: Vec<Vec<f64>> = known().map(EffectSpec::neutral).collect();
            let all: Vec<EffectInstance<'_>> = known()
                .zip(&neutral)
                .map(|(effect, values)| chosen(effect, values))
                .collect();
            assert_eq!(
                run(engine, &all, 1, change),
                base,
                "all together in {engine:?}"
            );
        }
    }
}

#[test]
fn neighbours_that_are_not_neutral_do_not_matter() {
    /// Enough for a register of any width.
    static CROWD: LazyLock<Vec<Parameters>> =
        LazyLock::new(|| parameters().into_iter().cycle().take(12).collect());
    for engine in ENGINES {
        let base = run(engine, &[], 1, |batch| batch.parameters = &CROWD);
        for effect in known() {
            let values: Vec<f64> = (0..CROWD.len())
                .flat_map(|rollout| match rollout % 2 {
                    0 => effect.neutral(),
                    _ => within(effect, |_| 0.1 * (rollout % 10) as f64),
                })
                .collect();
            let each = [EffectInstance {
                effect,
                values: PerRollout::Each(&values),
            }];
            let mixed = run(engine, &each, 1, |batch| batch.parameters = &CROWD);
            for rollout in (0..CROWD.len()).step_by(2) {
                let rows = rollout * ROWS..(rollout + 1) * ROWS;
                assert_eq!(
                    mixed[rows.clone()],
                    base[rows],
                    "{} of rollout {rollout} in {engine:?}",
                    effect.name
                );
            }
        }
    }
}

#[test]
fn next_to_neutral_is_next_to_the_base() {
    // A rim that gives nothing back holds the marble at once: the least restitution is another motion.
    static LIVELY: LazyLock<Rig> = LazyLock::new(|| {
        let mut rig = Rig::default();
        rig.board.wall_restitution = 0.3;
        rig
    });
    let lively: fn(&mut Batch<'_>) = |batch| batch.rig = &LIVELY;
    for engine in ENGINES {
        let base = run(engine, &[], 1, lively);
        for effect in known() {
            for side in [1e-8, -1e-8] {
                let values: Vec<f64> = effect
                    .parameters
                    .iter()
                    .map(|one| {
                        let (least, most) = one.allowed;
                        let near = one.neutral + side * (one.range.1 - one.range.0);
                        near.clamp(least, most.min(1e9))
                    })
                    .collect();
                let near = run(engine, &[chosen(effect, &values)], 1, lively);
                let apart = near.iter().zip(&base);
                let apart = apart.map(|(a, b)| (a[0] - b[0]).abs().max((a[1] - b[1]).abs()));
                let apart = apart.fold(0.0, f64::max);
                assert!(
                    apart < 1e-4,
                    "{} at {values:?} in {engine:?}: {apart}",
                    effect.name
                );
            }
        }
    }
}

#[test]
fn every_effect_shows() {
    for engine in ENGINES {
        let base = run(engine, &[], 1, |_| ());
        for effect in known().filter(|effect| !effect.is_of_gauge()) {
            for answer in [0.0, 1.0] {
                let is_choice = |i: usize| effect.parameters[i].is_choice();
                // What has a place on the board shows where the marble comes by, and friction that grows with
                // the time at rest only after long rests: with optional parameters neutral too.
                let shows = [(0.9, true), (0.9, false), (0.4, true)];
                let shows = shows.iter().any(|&(place, refined)| {
                    let mut values = within(effect, |i| if is_choice(i) { answer } else { place });
                    for (value, one) in values.iter_mut().zip(effect.parameters) {
                        if one.optional && !refined {
                            *value = one.neutral;
                        }
                    }
                    run(engine, &[chosen(effect, &values)], 1, |_| ()) != base
                });
                assert!(shows, "{} in {engine:?}", effect.name);
            }
        }
    }
}

#[test]
fn company_and_threads_do_not_matter() {
    for (engine, place) in ENGINES
        .into_iter()
        .flat_map(|engine| [(engine, 0.4), (engine, 0.6)])
    {
        let values: Vec<Vec<f64>> = known().map(|effect| within(effect, |_| place)).collect();
        let all: Vec<EffectInstance<'_>> = known()
            .zip(&values)
            .map(|(effect, values)| chosen(effect, values))
            .collect();
        let together = run(engine, &all, 1, |_| ());
        assert_eq!(
            run(engine, &all, 2, |_| ()),
            together,
            "{engine:?} with two threads"
        );
        let backwards: Vec<EffectInstance<'_>> = all.iter().rev().copied().collect();
        assert_eq!(
            run(engine, &backwards, 1, |_| ()),
            together,
            "{engine:?}, named backwards"
        );
        for (i, alone) in parameters().iter().enumerate() {
            let (rig, commands) = (Rig::default(), commands(ROWS));
            let batch = Batch {
                effects: &all,
                start: PerRollout::Shared(&[[0.1, -0.05]]),
                start_velocity: PerRollout::Shared(&[[0.2, 0.1]]),
                ..Batch::new(&rig, std::slice::from_ref(alone), &commands)
            };
            let path = batch
                .run(engine, Some(1), &AtomicBool::new(false))
                .expect("the inputs are physical");
            assert_eq!(
                path,
                together[i * ROWS..(i + 1) * ROWS],
                "rollout {i} alone in {engine:?}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn rollouts_stay_finite_for_plausible_and_allowed_values(
        places in prop::collection::vec(0.0..=1.0_f64, 8), corner: bool,
    ) {
        for (number, effect) in known().enumerate() {
            let place = |i: usize| {
                let place = places[(number + i) % places.len()];
                if corner { place.round() } else { place }
            };
            for values in [within(effect, place), allowed(effect, place)] {
                for engine in ENGINES {
                    let path = run(engine, &[chosen(effect, &values)], 1, |_| ());
                    let finite = path.as_flattened().iter().all(|seen| seen.is_finite());
                    prop_assert!(finite, "{} at {values:?} in {engine:?}", effect.name);
                }
            }
        }
    }
}

#[test]
fn engines_agree_while_no_rim_is_met() {
    for effect in known() {
        for place in [0.2, 0.8] {
            let values = within(effect, |_| place);
            let gentle: [Parameters; 1] = [[0.02, 0.02, 3e-4, 12.0, 1.0].into()];
            let (rig, commands) = (Rig::default(), commands(ROWS));
            let paths = ENGINES.map(|engine| {
                let effects = [chosen(effect, &values)];
                let mut batch = Batch::new(&rig, &gentle, &commands);
                batch.effects = &effects;
                batch.start = PerRollout::Shared(&[[0.1, -0.05]]);
                batch
                    .run(engine, None, &AtomicBool::new(false))
                    .expect("the inputs are physical")
            });
            let room = rig.reach_m().map(|reach| 0.8 * reach / rig.board.edge_x_m);
            let apart = paths[0]
                .iter()
                .zip(&paths[1])
                .take_while(|(rolling, _)| {
                    rolling
                        .iter()
                        .zip(room)
                        .all(|(seen, room)| seen.abs() < room)
                })
                .flat_map(|(a, b)| [(a[0] - b[0]).abs(), (a[1] - b[1]).abs()])
                .fold(0.0, f64::max);
            assert!(apart < 1e-3, "{} at {values:?}: {apart}", effect.name);
        }
    }
}

#[test]
fn what_is_measured_of_the_tilt_moves_no_marble() {
    for engine in ENGINES {
        let base = run(engine, &[], 1, |_| ());
        for effect in known().filter(|effect| effect.is_of_gauge()) {
            let values = within(effect, |_| 0.9);
            let same = run(engine, &[chosen(effect, &values)], 1, |_| ());
            assert_eq!(same, base, "{} in {engine:?}", effect.name);
        }
    }
}

#[test]
fn optional_parameters_come_last() {
    for effect in known() {
        let optional: Vec<bool> = effect.parameters.iter().map(|one| one.optional).collect();
        assert!(optional.is_sorted(), "{}", effect.name);
        assert!(optional.contains(&false), "{}", effect.name);
        for one in effect.parameters.iter().filter(|one| one.optional) {
            assert!(one.neutral.is_finite() && !one.is_choice(), "{}", one.name);
        }
    }
}

#[test]
fn the_catalogue_is_in_order() {
    for effect in known() {
        assert!(
            !effect.parameters.is_empty() && !effect.references.is_empty(),
            "{}",
            effect.name
        );
        for parameter in effect.parameters {
            let (low, high) = parameter.range;
            let (least, most) = parameter.allowed;
            let name = parameter.name;
            if parameter.is_choice() {
                assert_eq!(parameter.allowed, (0.0, 1.0), "{name}");
            } else {
                assert!(low < high, "{name}");
            }
            assert!(least <= low && high <= most, "{name}");
            let (near, far) = parameter.reach.unwrap_or(parameter.range);
            assert!(
                least <= near && near <= low && high <= far && far <= most,
                "{name}"
            );
            assert!(
                (least..=most).contains(&parameter.neutral),
                "{}",
                parameter.name
            );
        }
        let twins = known().filter(|other| other.name == effect.name).count();
        assert_eq!(twins, 1, "{}", effect.name);
    }
}

/// A marble that learns its commands one by one goes the same way as one whose commands are known.
#[test]
fn a_live_rollout_has_the_bits_of_a_batch() {
    let (rig, parameters, commands, start) = (
        Rig::default(),
        parameters()[0],
        commands(ROWS),
        [0.1, -0.05],
    );
    let causal = known().filter(|effect| effect.name != "clock_drift");
    let sets = causal
        .clone()
        .map(|effect| vec![(effect, within(effect, |i| 0.3 + 0.1 * (i % 5) as f64))]);
    let all = [0.4, 0.6].map(|place| {
        let at_place = |effect| (effect, within(effect, |_| place));
        causal.clone().map(at_place).collect()
    });
    for set in sets.chain([vec![]]).chain(all) {
        let effects: Vec<_> = set
            .iter()
            .map(|(effect, values)| chosen(effect, values))
            .collect();
        let known = Batch {
            effects: &effects,
            start: PerRollout::Shared(&[start]),
            time: TimeBase::Durations(PerRollout::Shared(&[0.05; ROWS])),
            seeds: PerRollout::Shared(&[3]),
            ..Batch::new(&rig, &[parameters], &commands)
        }
        .run_with_tilt(Engine::Rolling, Some(1), &AtomicBool::new(false))
        .expect("the inputs are physical");
        let mut live = Live::new(&rig, None, parameters, &effects, start, (ROWS, 0.05), 3)
            .expect("the inputs are physical");
        let mut found = vec![(live.seen(), live.tilt())];
        found.extend(commands[..ROWS - 1].iter().map(|&command| {
            let seen = live.play(command);
            (seen, live.tilt())
        }));
        let known: Vec<_> = known.marble.into_iter().zip(known.tilt).collect();
        assert_eq!(live.left(), 0);
        assert_eq!(
            found,
            known,
            "{:?}",
            effects
                .iter()
                .map(|one| one.effect.name)
                .collect::<Vec<_>>()
        );
    }
}

#[test]
fn a_live_rollout_refuses_what_would_need_commands_to_come() {
    let drift = known()
        .find(|effect| effect.name == "clock_drift")
        .expect("it is known");
    let (values, rig) = (drift.neutral(), Rig::default());
    let refused = Live::new(
        &rig,
        None,
        parameters()[0],
        &[chosen(drift, &values)],
        [0.0; 2],
        (10, 0.05),
        0,
    );
    assert!(refused.is_err_and(|error| error.to_string().contains("clock_drift")));
}
