//! The board's tilt as a sensor reports it, and commands that go evenly to the next ones.

use std::sync::atomic::AtomicBool;

use labsim::effects::{effect, known};
use labsim::{
    Batch, EffectInstance, EffectSpec, Engine, Hold, Observed, Parameters, PerRollout, Rig,
    TimeBase,
};

use crate::commands;

const ROWS: usize = 40;
const ROW_S: f64 = 0.05;
const ENGINES: [Engine; 2] = [Engine::Rolling, Engine::Rapier];

fn parameters() -> Vec<Parameters> {
    let one = |i: usize| [0.3 + 0.01 * i as f64, -0.2, 4e-4, 12.0, 1.0].into();
    (0..11).map(one).collect()
}

fn run(
    engine: Engine,
    effects: &[(&'static EffectSpec, Vec<f64>)],
    change: impl Fn(&mut Batch<'_>),
) -> Observed {
    run_on(engine, effects, &commands(ROWS), 2, change)
}

fn run_on(
    engine: Engine,
    effects: &[(&'static EffectSpec, Vec<f64>)],
    commands: &[[f64; 2]],
    threads: usize,
    change: impl Fn(&mut Batch<'_>),
) -> Observed {
    let (rig, parameters) = (Rig::default(), parameters());
    let durations = vec![ROW_S; commands.len()];
    let chosen = chosen(effects);
    let mut batch = Batch {
        effects: &chosen,
        knobs_before: PerRollout::Shared(&[[0.01, -0.02]]),
        start: PerRollout::Shared(&[[0.1, -0.05]]),
        start_velocity: PerRollout::Shared(&[[0.2, 0.1]]),
        time: TimeBase::Durations(PerRollout::Shared(&durations)),
        ..Batch::new(&rig, &parameters, commands)
    };
    change(&mut batch);
    let cancel = AtomicBool::new(false);
    let observed = batch
        .run_with_tilt(engine, Some(threads), &cancel)
        .expect("the inputs are physical");
    let alone = batch
        .run(engine, Some(threads), &cancel)
        .expect("the inputs are physical");
    let names: Vec<&str> = effects.iter().map(|(effect, _)| effect.name).collect();
    assert_eq!(observed.marble, alone, "{names:?} in {engine:?}");
    observed
}

fn chosen<'a>(effects: &'a [(&'static EffectSpec, Vec<f64>)]) -> Vec<EffectInstance<'a>> {
    effects
        .iter()
        .map(|(effect, values)| EffectInstance {
            effect,
            values: PerRollout::Shared(values),
        })
        .collect()
}

fn one(name: &str, values: &[f64]) -> Vec<(&'static EffectSpec, Vec<f64>)> {
    vec![(effect(name).expect("it is known"), values.to_vec())]
}

/// Neutral but for the first parameter.
fn first(effect: &EffectSpec, value: f64) -> Vec<f64> {
    let mut values = effect.neutral();
    values[0] = value;
    values
}

/// Values at a place of the box of plausible ones; choices are made by halves.
fn within(effect: &'static EffectSpec, place: f64) -> (&'static EffectSpec, Vec<f64>) {
    let at = |one: &labsim::effects::Parameter| {
        if one.is_choice() {
            return place.round();
        }
        one.range.0 + place * (one.range.1 - one.range.0)
    };
    (effect, effect.parameters.iter().map(at).collect())
}

/// The tilt of the first rollout.
fn first_tilt(observed: &Observed) -> &[[f64; 2]] {
    &observed.tilt[..ROWS]
}

fn gears() -> [f64; 2] {
    [0.3, -0.2]
}

fn tilted(knobs: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|axis| gears()[axis] * knobs[axis])
}

fn assert_near(found: &[[f64; 2]], expected: &[[f64; 2]], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (row, (found, expected)) in found.iter().zip(expected).enumerate() {
        for axis in 0..2 {
            let apart = (found[axis] - expected[axis]).abs();
            assert!(apart <= tolerance, "row {row}: {found:?}, {expected:?}");
        }
    }
}

/// The knob of a row is looked at without moving it: `run` compares the marble's bits.
#[test]
fn asking_for_the_tilt_leaves_every_bit_of_the_marble() {
    for engine in ENGINES {
        for place in [0.1, 0.4, 0.6] {
            for hold in [Hold::Zero, Hold::First] {
                for effect in known() {
                    run(engine, &[within(effect, place)], |batch| batch.hold = hold);
                }
                let all: Vec<_> = known().map(|effect| within(effect, place)).collect();
                run(engine, &all, |batch| batch.hold = hold);
            }
        }
    }
}

#[test]
fn threads_company_and_neutral_effects_leave_every_bit_of_the_tilt() {
    for engine in ENGINES {
        let all: Vec<_> = known().map(|effect| within(effect, 0.4)).collect();
        let together = run(engine, &all, |_| ());
        assert_eq!(
            run_on(engine, &all, &commands(ROWS), 1, |_| ()),
            together,
            "{engine:?}"
        );
        let last = parameters().len() - 1;
        let alone = run(engine, &all, |batch| {
            batch.parameters = &batch.parameters[last..];
            batch.seeds = PerRollout::Shared(&[0]);
        });
        assert_eq!(alone.tilt, together.tilt[last * ROWS..]);
        let base = run(engine, &[], |_| ());
        for effect in known() {
            let neutral = run(engine, &[(effect, effect.neutral())], |_| ());
            assert_eq!(neutral.tilt, base.tilt, "{} in {engine:?}", effect.name);
        }
    }
}

#[test]
fn the_tilt_of_a_row_is_that_of_the_command_before() {
    let commands = commands(ROWS);
    let mut expected = vec![tilted([0.01, -0.02])];
    expected.extend(commands[..ROWS - 1].iter().map(|&knobs| tilted(knobs)));
    for engine in ENGINES {
        assert_near(first_tilt(&run(engine, &[], |_| ())), &expected, 1e-15);
        let bias = run(engine, &one("tilt_bias", &[0.004, -0.003]), |_| ());
        let biased: Vec<[f64; 2]> = expected
            .iter()
            .map(|[x, y]| [x + 0.004, y - 0.003])
            .collect();
        assert_near(first_tilt(&bias), &biased, 1e-15);
        let late = run(engine, &one("latency", &[0.12]), |_| ());
        assert_near(first_tilt(&late), &expected, 1e-15);
    }
}

#[test]
fn a_lagging_knob_is_seen_where_it_is_as_the_row_begins() {
    let time = 0.13;
    let mut knobs = [0.01, -0.02];
    let mut expected = vec![tilted(knobs)];
    for command in &commands(ROWS)[..ROWS - 1] {
        for (knob, command) in knobs.iter_mut().zip(command) {
            *knob = command + (*knob - command) * (-ROW_S / time).exp();
        }
        expected.push(tilted(knobs));
    }
    let lag = effect("lag").expect("it is known");
    let values = first(lag, time);
    for engine in ENGINES {
        let seen = run(engine, &[(lag, values.clone())], |_| ());
        assert_near(first_tilt(&seen), &expected, 1e-11);
        // A window that begins later has the same history.
        let later = run(engine, &[(lag, values.clone())], |batch| {
            batch.first = PerRollout::Shared(&[7]);
            batch.rows = ROWS - 7;
        });
        assert_near(&later.tilt[..ROWS - 7], &expected[7..], 1e-11);
    }
}

#[test]
fn a_delayed_knob_is_seen_as_late_as_it_comes() {
    // Two rows and a half: what was commanded three rows before has come, as row 0 was late too.
    let commands = commands(ROWS);
    let before = [[0.01, -0.02]; 3];
    let expected: Vec<[f64; 2]> = before
        .iter()
        .chain(&commands[..ROWS - 3])
        .map(|&knobs| tilted(knobs))
        .collect();
    let delay = effect("delay").expect("it is known");
    let values = first(delay, 2.5 * ROW_S);
    for engine in ENGINES {
        let seen = run(engine, &[(delay, values.clone())], |_| ());
        assert_near(first_tilt(&seen), &expected, 1e-15);
    }
}

#[test]
fn commands_go_evenly_to_the_next_ones() {
    let commands = commands(ROWS);
    let steps = 12_usize;
    let fine: Vec<[f64; 2]> = (0..ROWS * steps)
        .map(|i| {
            let (row, part) = (i / steps, ((i % steps) as f64 + 0.5) / steps as f64);
            let next = commands[(row + 1).min(ROWS - 1)];
            [0, 1].map(|axis| commands[row][axis] + part * (next[axis] - commands[row][axis]))
        })
        .collect();
    let short: &[f64] = vec![ROW_S / steps as f64; fine.len()].leak();
    let lag = effect("lag").expect("it is known");
    let lags = vec![(lag, first(lag, 0.1))];
    for engine in ENGINES {
        for effects in [&[][..], &lags] {
            let ramp = run(engine, effects, |batch| batch.hold = Hold::First);
            let stairs = run_on(engine, effects, &fine, 2, |batch| {
                batch.time = TimeBase::Durations(PerRollout::Shared(short));
            });
            for row in 1..ROWS {
                let (found, expected) = (ramp.marble[row], stairs.marble[row * steps]);
                assert_near(&[found], &[expected], 1e-9);
            }
        }
        let ramp = run(engine, &[], |batch| batch.hold = Hold::First);
        let there: Vec<[f64; 2]> = commands.iter().map(|&knobs| tilted(knobs)).collect();
        assert_near(&first_tilt(&ramp)[1..], &there[1..], 1e-15);
    }
}

#[test]
fn even_commands_come_late_in_one_piece() {
    let delay = effect("delay").expect("it is known");
    let with = |engine, seconds: f64| {
        let values = first(delay, seconds);
        run(engine, &[(delay, values)], |batch| batch.hold = Hold::First)
    };
    let commands = commands(ROWS);
    let mut shifted = vec![[0.01, -0.02]; 2];
    shifted.extend(&commands[..ROWS - 2]);
    for engine in ENGINES {
        let base = run(engine, &[], |batch| batch.hold = Hold::First);
        assert_eq!(with(engine, 0.0).marble, base.marble);
        // The knobs stand still for two rows, then jump to the first command; a ramp would not.
        let late = with(engine, 2.0 * ROW_S);
        let there: Vec<[f64; 2]> = shifted.iter().map(|&knobs| tilted(knobs)).collect();
        assert_near(&first_tilt(&late)[3..], &there[3..], 2e-3);
        assert_near(&first_tilt(&late)[..3], &[there[0]; 3], 2e-3);
    }
}

#[test]
fn commands_may_be_in_any_unit() {
    // Motor currents of some hundreds, with a motor mounted the other way round.
    let units = [-3000.0, 2000.0];
    let commands = commands(ROWS);
    let currents: Vec<[f64; 2]> = commands
        .iter()
        .map(|knobs| [0, 1].map(|axis| units[axis] * knobs[axis]))
        .collect();
    let gears: Vec<Parameters> = parameters()
        .iter()
        .map(|one| Parameters {
            gear_x: one.gear_x / units[0],
            gear_y: one.gear_y / units[1],
            ..*one
        })
        .collect();
    let gears: &[Parameters] = gears.leak();
    let before: &[[f64; 2]] = vec![[0.01 * units[0], -0.02 * units[1]]].leak();
    for name in ["lag", "delay", "clock_drift", "delay_jitter", "tilt_bias"] {
        let effects = [within(effect(name).expect("it is known"), 0.6)];
        for engine in ENGINES {
            for hold in [Hold::Zero, Hold::First] {
                let rad = run(engine, &effects, |batch| batch.hold = hold);
                let other = run_on(engine, &effects, &currents, 2, |batch| {
                    batch.hold = hold;
                    batch.parameters = gears;
                    batch.knobs_before = PerRollout::Shared(before);
                });
                assert_near(&other.tilt, &rad.tilt, 1e-12);
                assert_near(&other.marble[..ROWS], &rad.marble[..ROWS], 1e-6);
            }
        }
    }
}
