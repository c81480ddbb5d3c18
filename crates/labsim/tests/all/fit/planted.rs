//! Recordings of a planted truth.

use std::sync::atomic::AtomicBool;

use labsim::effects::effect;
use labsim::fit::{Hypothesis, ParameterSpec, Problem, Recording, Settings, Solution, Stretch};
use labsim::{Batch, EffectInstance, Engine, Error, Hold, Parameters, PerRollout, Rig, TimeBase};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

pub(crate) const ROWS: usize = 100;
pub(crate) const NOISE: f64 = 0.001;
pub(crate) const TRUTH: [f64; 5] = [0.06, 0.05, 4e-4, 18.0, 1.05];
pub(crate) const RANGES: [(f64, f64); 5] = [
    (0.0, 0.1),
    (0.0, 0.1),
    (0.0, 0.001),
    (0.0, 50.0),
    (0.8, 1.2),
];

/// Recordings of a truth, and what is asked of them.
pub(crate) struct Planted {
    pub(crate) rig: Rig,
    pub(crate) parameters: [ParameterSpec; 5],
    pub(crate) effects: Vec<Hypothesis>,
    pub(crate) commands: Vec<Vec<[f64; 2]>>,
    pub(crate) durations: Option<Vec<f64>>,
    pub(crate) observed: Vec<Vec<[f64; 2]>>,
    /// What the tilt sensor measures, in runs that have one, and the truth of it.
    pub(crate) tilt: Vec<Option<Vec<[f64; 2]>>>,
    pub(crate) tilted: Vec<Vec<[f64; 2]>>,
    pub(crate) stretches: Vec<Stretch>,
    pub(crate) threads: Option<usize>,
}

pub(crate) struct Random(pub(crate) ChaCha8Rng);

impl Random {
    pub(crate) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

pub(crate) fn free(range: (f64, f64)) -> ParameterSpec {
    ParameterSpec::Free { range, start: None }
}

/// Three sinusoids a knob, large enough to bring the marble to the rim.
fn excitation(random: &mut Random, rows: usize) -> Vec<[f64; 2]> {
    let waves: Vec<[f64; 4]> = (0..3)
        .map(|_| {
            std::array::from_fn(|i| {
                random.within(0.5, 5.0) + if i < 2 { 0.0 } else { 3.0 * i as f64 }
            })
        })
        .collect();
    let angle = |t: usize, axis: usize| -> f64 {
        let phase = std::f64::consts::TAU * t as f64 / ROWS as f64;
        waves
            .iter()
            .map(|wave| 0.08 * (phase * wave[axis] + wave[2 + axis]).sin())
            .sum()
    };
    (0..rows).map(|t| [angle(t, 0), angle(t, 1)]).collect()
}

impl Planted {
    /// Runs of a truth that may have effects; `stamped` ones determine the time scale, in `moving` ones the
    /// marble rolls at row 0.
    pub(crate) fn new(
        seed: u64,
        runs: usize,
        effects: &[(&str, &[f64])],
        stamped: bool,
        moving: bool,
    ) -> Self {
        Self::made(seed, runs, effects, (stamped, moving), [1.0; 2], &[])
    }

    /// The same with knobs and starts only along some axes: 1 of an axis that moves, else 0.
    pub(crate) fn on_axes(
        seed: u64,
        runs: usize,
        effects: &[(&str, &[f64])],
        stamped: bool,
        moving: bool,
        axes: [f64; 2],
    ) -> Self {
        Self::made(seed, runs, effects, (stamped, moving), axes, &[])
    }

    /// Stamped runs that begin at rest, each on a board that leans by its own angles (rad).
    pub(crate) fn leaning(seed: u64, effects: &[(&str, &[f64])], leans: &[[f64; 2]]) -> Self {
        Self::made(seed, leans.len(), effects, (true, false), [1.0; 2], leans)
    }

    fn made(
        seed: u64,
        runs: usize,
        effects: &[(&str, &[f64])],
        (stamped, moving): (bool, bool),
        [x, y]: [f64; 2],
        leans: &[[f64; 2]],
    ) -> Self {
        let mut random = Random(ChaCha8Rng::seed_from_u64(seed));
        let chosen: Vec<EffectInstance<'_>> = effects
            .iter()
            .map(|(name, values)| EffectInstance {
                effect: effect(name).unwrap(),
                values: PerRollout::Shared(values),
            })
            .collect();
        let mut planted = Self {
            rig: Rig::default(),
            parameters: RANGES.map(free),
            effects: effects
                .iter()
                .map(|(name, _)| Hypothesis::free(effect(name).unwrap()))
                .collect(),
            commands: (0..runs)
                .map(|_| {
                    let knobs = excitation(&mut random, ROWS);
                    knobs
                        .iter()
                        .map(|knobs| [y * knobs[0], x * knobs[1]])
                        .collect()
                })
                .collect(),
            durations: stamped.then(|| vec![TRUTH[3] / 240.0; ROWS]),
            observed: Vec::new(),
            tilt: vec![None; runs],
            tilted: Vec::new(),
            stretches: (0..runs)
                .map(|recording| Stretch {
                    recording,
                    first: 0,
                    rows: ROWS,
                    at_rest: !moving,
                })
                .collect(),
            threads: Some(2),
        };
        if stamped {
            planted.parameters[3] = ParameterSpec::Held(TRUTH[3]);
        }
        for (run, commands) in planted.commands.iter().enumerate() {
            let place =
                |random: &mut Random, reach: f64| [(); 2].map(|()| random.within(-reach, reach));
            let start = [place(&mut random, 0.25)].map(|place| [x * place[0], y * place[1]]);
            let velocity = [place(&mut random, if moving { 0.1 } else { 0.0 })];
            let parameters = [Parameters::from(TRUTH)];
            let [lean_x, lean_y] = leans.get(run).copied().unwrap_or_default();
            let lean = [lean_x, lean_y, 0.0];
            let mut effects = chosen.clone();
            effects.push(EffectInstance {
                effect: effect("lean").unwrap(),
                values: PerRollout::Shared(&lean),
            });
            let batch = Batch {
                effects: &effects,
                start: PerRollout::Shared(&start),
                start_velocity: PerRollout::Shared(&velocity),
                time: TimeBase::Continuous(None),
                ..Batch::new(&planted.rig, &parameters, commands)
            };
            let exact = batch
                .run_with_tilt(Engine::Rolling, Some(1), &AtomicBool::new(false))
                .unwrap();
            let seen = exact
                .marble
                .iter()
                .map(|place| place.map(|x| x + NOISE * random.normal()))
                .collect();
            planted.observed.push(seen);
            planted.tilted.push(exact.tilt);
        }
        planted
    }

    pub(crate) fn with<T>(&self, ask: impl FnOnce(&Problem<'_>) -> T) -> T {
        let recordings: Vec<Recording<'_>> = self
            .commands
            .iter()
            .zip(&self.observed)
            .zip(&self.tilt)
            .map(|((commands, observed), tilt)| Recording {
                commands,
                knobs_before: [0.0; 2],
                durations: self.durations.as_deref(),
                observed,
                tilt: tilt.as_deref(),
                way: None,
                path: None,
            })
            .collect();
        ask(&Problem {
            rig: &self.rig,
            parameters: self.parameters,
            effects: &self.effects,
            recordings: &recordings,
            stretches: &self.stretches,
            noise: None,
            tilt_noise: None,
            hold: Hold::Zero,
            engine: Engine::Rolling,
            threads: self.threads,
        })
    }

    pub(crate) fn fit(&self, starts: usize, seed: u64) -> Result<Solution, Error> {
        let settings = Settings {
            starts,
            seed,
            ..Settings::default()
        };
        self.with(|problem| problem.fit(&settings, &|_, _, _| (), &AtomicBool::new(false)))
    }

    /// Measures the tilt as well, with noise (rad) about x and about y.
    pub(crate) fn with_tilt(mut self, noise: [f64; 2]) -> Self {
        let mut random = Random(ChaCha8Rng::seed_from_u64(77));
        let mut measured =
            |angles: &[f64; 2]| [0, 1].map(|axis| angles[axis] + noise[axis] * random.normal());
        let runs = self.tilted.iter();
        self.tilt = runs
            .map(|rows| Some(rows.iter().map(&mut measured).collect()))
            .collect();
        self
    }

    /// Looks first at the truth.
    pub(crate) fn starting_at_truth(mut self) -> Self {
        for (sought, truth) in self.parameters.iter_mut().zip(TRUTH) {
            if let ParameterSpec::Free { start, .. } = sought {
                *start = Some(truth);
            }
        }
        self
    }
}

pub(crate) fn near(found: f64, truth: f64, part: f64) -> bool {
    (found - truth).abs() <= part * truth.abs()
}
