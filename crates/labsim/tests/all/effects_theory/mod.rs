//! Effects of the catalogue against closed forms, in both engines.

mod actuation;
mod board;
mod contact;
mod rim;
mod sensing;
mod timing;
mod unlisted;

use std::sync::atomic::AtomicBool;

use labsim::effects::effect;
use labsim::{Batch, EffectInstance, Engine, Parameters, PerRollout, Rig, TimeBase};

const EDGE: f64 = 0.276;
const SUBSTEP: f64 = 1.0 / 240.0;

/// Substeps to a row, and how long it lasts (s).
const SUBSTEPS: usize = 24;
const ROW: f64 = 0.1;

/// Each engine, and how near it comes to what a substep should do (m): one rolls by the closed form,
/// the other lets contacts settle.
const ENGINES: [(Engine, f64); 2] = [(Engine::Rolling, 1e-9), (Engine::Rapier, 5e-6)];

/// A rollout on the paper's board, whose gear is 1, in metres.
#[derive(Clone)]
struct Trial {
    rig: Rig,
    friction: f64,
    commands: Vec<[f64; 2]>,
    /// How long rows last (s), where that is not `ROW`.
    durations: Option<Vec<f64>>,
    start: [f64; 2],
    velocity: [f64; 2],
    effects: Vec<(&'static str, Vec<f64>)>,
    seed: u64,
    /// The row in which the marble is let go, and how far it has rolled before (m).
    first: usize,
    rolled: f64,
}

impl Trial {
    /// A marble at rest in the middle, without friction.
    fn of(commands: Vec<[f64; 2]>) -> Self {
        Self {
            rig: Rig::default(),
            friction: 0.0,
            commands,
            durations: None,
            start: [0.0; 2],
            velocity: [0.0; 2],
            effects: Vec::new(),
            seed: 0,
            first: 0,
            rolled: 0.0,
        }
    }

    /// A board that stays level.
    fn level(rows: usize) -> Self {
        Self::of(vec![[0.0; 2]; rows])
    }

    /// Adds an effect; of its last parameters those without a value are neutral.
    fn with(mut self, name: &'static str, values: &[f64]) -> Self {
        let neutral = effect(name).expect("it is of the catalogue").neutral();
        let values = [values, &neutral[values.len()..]].concat();
        self.effects.push((name, values));
        self
    }

    /// Where the marble is seen (m).
    fn run(&self, engine: Engine) -> Vec<[f64; 2]> {
        let effects: Vec<EffectInstance<'_>> = self
            .effects
            .iter()
            .map(|(name, values)| EffectInstance {
                effect: effect(name).expect("it is of the catalogue"),
                values: PerRollout::Shared(values),
            })
            .collect();
        let parameters: Parameters = [1.0, 1.0, self.friction, SUBSTEPS as f64, 1.0].into();
        let batch = Batch {
            effects: &effects,
            first: PerRollout::Shared(&[self.first]),
            rolled: PerRollout::Shared(&[self.rolled]),
            rows: self.commands.len() - self.first,
            start: PerRollout::Shared(&[self.start.map(|x| x / EDGE)]),
            start_velocity: PerRollout::Shared(&[self.velocity.map(|v| v / EDGE)]),
            seeds: PerRollout::Shared(&[self.seed]),
            time: self.durations.as_deref().map_or(TimeBase::Rounded, |each| {
                TimeBase::Durations(PerRollout::Shared(each))
            }),
            ..Batch::new(&self.rig, std::slice::from_ref(&parameters), &self.commands)
        };
        let seen = batch
            .run(engine, Some(1), &AtomicBool::new(false))
            .expect("the inputs are physical");
        seen.iter().map(|seen| seen.map(|x| x * EDGE)).collect()
    }
}

/// The board's angles (rad) as each row begins, read off the picture of a marble that friction holds:
/// parallax shifts it by an edge for each radian. Angles stay below the 0.25 that the board can hold.
fn angles(
    engine: Engine,
    effects: &[(&'static str, &[f64])],
    commands: Vec<[f64; 2]>,
) -> Vec<[f64; 2]> {
    let trial = Trial {
        friction: 0.3,
        ..Trial::of(commands).with("parallax", &[EDGE])
    };
    let trial = effects
        .iter()
        .fold(trial, |trial, (name, values)| trial.with(name, values));
    let seen = trial.run(engine);
    seen.iter().map(|[x, y]| [-y / EDGE, x / EDGE]).collect()
}

fn assert_close(found: f64, expected: f64, within: f64, what: &str) {
    assert!(
        (found - expected).abs() <= within,
        "{what}: {found}, not {expected}"
    );
}

/// Integral by Simpson's rule.
fn integral(from: f64, to: f64, of: impl Fn(f64) -> f64) -> f64 {
    let (n, step) = (2000, (to - from) / 2000.0);
    let weight = |i: i32| match i {
        0 => 1.0,
        i if i == n => 1.0,
        i => 2.0 + 2.0 * f64::from(i % 2),
    };
    (0..=n)
        .map(|i| weight(i) * of(from + step * f64::from(i)))
        .sum::<f64>()
        * step
        / 3.0
}

/// Holds a path along a straight line to the speed that it should have at each place.
fn assert_speeds(way: &[f64], speed: impl Fn(f64) -> f64, within_s: f64, what: &str) {
    for (row, &place) in way.iter().enumerate() {
        let time = integral(way[0], place, |x| 1.0 / speed(x));
        assert_close(
            time,
            ROW * row as f64,
            within_s,
            &format!("{what}, row {row}"),
        );
    }
}
