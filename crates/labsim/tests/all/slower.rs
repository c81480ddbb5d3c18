//! All of the motion may run slower under weaker pushes: effects say how their parameters change with it.

use std::sync::atomic::AtomicBool;

use labsim::effects::{Parameter, effects};
use labsim::{Batch, Board, EffectInstance, EffectSpec, Engine, Parameters, PerRollout, Rig};
use proptest::prelude::*;

const ROWS: usize = 40;
/// Physics updates of a row, and how many times slower all of the motion runs.
const UPDATES: f64 = 20.0;
const SLOWER: f64 = 3.0;
/// Updates of other lengths, angles that have sines: to this share of the way the path is the same.
const SAME: f64 = 0.05;
/// With a parameter that did not change with the rest it is farther from there, so many times.
const OTHER: f64 = 3.0;
/// A heavy side also pulls outwards as the marble turns, whose size its gravity does not determine; and what
/// passes close to a point that pulls is thrown far.
const NEARLY: ([&str; 2], f64) = (["eccentric_marble", "point_field"], 0.5);
/// Of the tilt itself, which is smaller where the motion runs slower, so that its parameter makes no difference.
const OF_TILT: &str = "inertial_forces";

/// Knob angles with jumps, rests and reversals (rad).
fn commands() -> Vec<[f64; 2]> {
    (0..ROWS)
        .map(|i| {
            let t = i as f64;
            let hold = if i % 20 < 5 { 0.0 } else { 1.0 };
            [
                0.12 * (0.5 * t).sin() * hold,
                0.1 * (0.4 * t).cos() - 0.04 * hold,
            ]
        })
        .collect()
}

/// Where the marble goes on a board without end, its motion so many times slower.
fn path(effect: &'static EffectSpec, values: &[f64], slower: f64) -> Vec<[f64; 2]> {
    let rig = Rig {
        board: Board {
            edge_x_m: 20.0,
            edge_y_m: 20.0,
            ..Board::default()
        },
        ..Rig::default()
    };
    let push = slower.powi(-2);
    let parameters: [Parameters; 1] = [[
        0.008 * push,
        0.012 * push,
        3e-4 * push,
        UPDATES * slower,
        1.0,
    ]
    .into()];
    let (commands, chosen) = (
        commands(),
        [EffectInstance {
            effect,
            values: PerRollout::Shared(values),
        }],
    );
    let batch = Batch {
        effects: &chosen,
        start: PerRollout::Shared(&[[0.0005, -0.0005]]),
        start_velocity: PerRollout::Shared(&[[0.004 / slower, 0.002 / slower]]),
        ..Batch::new(&rig, &parameters, &commands)
    };
    batch
        .run(Engine::Rolling, Some(1), &AtomicBool::new(false))
        .expect("the inputs are physical")
}

/// The largest distance between two paths, over the largest from where one begins.
fn apart(one: &[[f64; 2]], other: &[[f64; 2]]) -> f64 {
    let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let way = one.iter().map(|at| distance(at, &one[0]));
    let between = one.iter().zip(other).map(|(a, b)| distance(a, b));
    between.fold(0.0, f64::max) / way.fold(0.0, f64::max)
}

/// Values at places of an effect's ranges, and the same where all of the motion runs slower.
fn slowed(effect: &EffectSpec, places: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let at = |(one, place): (&Parameter, &f64)| {
        let (low, high) = one.range;
        let within = low + place * (high - low);
        let value = if one.is_choice() {
            place.round()
        } else {
            within
        };
        (value, value * SLOWER.powi(one.time_power.into()))
    };
    effect.parameters.iter().zip(places).map(at).unzip()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn the_path_is_the_same_with_every_effect(places in proptest::collection::vec(0.0..1.0_f64, 14)) {
        for effect in effects() {
            let (values, slow) = slowed(effect, &places);
            let found = apart(&path(effect, &values, 1.0), &path(effect, &slow, SLOWER));
            let most = if NEARLY.0.contains(&effect.name) { NEARLY.1 } else { SAME };
            prop_assert!(found < most, "{}: {found} at {values:?}", effect.name);
        }
    }
}

#[test]
fn with_values_as_they_were_it_is_another() {
    for effect in effects() {
        let mut required = effect.parameters.iter().filter(|one| !one.optional);
        if required.all(|one| one.time_power == 0) || effect.name == OF_TILT {
            continue;
        }
        let (values, slow) = slowed(effect, &[0.8; 14]);
        let usual = path(effect, &values, 1.0);
        let [same, other] =
            [slow, values].map(|values| apart(&usual, &path(effect, &values, SLOWER)));
        assert!(other > OTHER * same, "{}: {other} and {same}", effect.name);
    }
}
