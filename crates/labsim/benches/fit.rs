//! Time of a fit from nothing: eight recordings of 120 rows, five parameters, then three effects more.

use std::hint::black_box;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use criterion::{BatchSize, Criterion, SamplingMode, criterion_group, criterion_main};
use labsim::effects::effect;
use labsim::fit::{Hypothesis, ParameterSpec, Problem, Recording, Settings, Stretch};
use labsim::{Batch, EffectInstance, Engine, Hold, Parameters, PerRollout, Rig, TimeBase};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// An effect's name, and the values that are planted.
type Planted = (&'static str, &'static [f64]);

const ROWS: usize = 120;
const RUNS: usize = 8;
const STARTS: usize = 4;
const NOISE: f64 = 0.001;
const TRUTH: [f64; 5] = [0.06, 0.05, 4e-4, 18.0, 1.05];
const RANGES: [(f64, f64); 5] = [
    (0.0, 0.1),
    (0.0, 0.1),
    (0.0, 0.001),
    (0.0, 50.0),
    (0.8, 1.2),
];

/// Three sinusoids a knob, others in each run.
fn excitation(run: usize) -> Vec<[f64; 2]> {
    let angle = |row: usize, knob: usize| -> f64 {
        let wave = |k: usize| {
            let periods = 0.5 + 4.5 * (0.618 * (7 * run + 3 * knob + k) as f64).fract();
            0.08 * (std::f64::consts::TAU * periods * row as f64 / ROWS as f64
                + (run + 2 * k) as f64)
                .sin()
        };
        (0..3).map(wave).sum()
    };
    (0..ROWS)
        .map(|row| [angle(row, 0), angle(row, 1)])
        .collect()
}

fn fits(criterion: &mut Criterion) {
    let rig = Rig::default();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let commands: Vec<Vec<[f64; 2]>> = (0..RUNS).map(excitation).collect();
    let cases: [(&str, &[Planted]); 2] = [
        ("five parameters", &[]),
        (
            "with lag, tilt_bias and viscous_drag",
            &[
                ("lag", &[0.15, 0.0]),
                ("tilt_bias", &[0.004, -0.003]),
                ("viscous_drag", &[0.5]),
            ],
        ),
    ];
    let mut group = criterion.benchmark_group("fit of eight recordings");
    group
        .sampling_mode(SamplingMode::Flat)
        .sample_size(10)
        .measurement_time(Duration::from_secs(10));
    for (name, effects) in cases {
        let chosen: Vec<EffectInstance<'_>> = effects
            .iter()
            .map(|(name, values)| EffectInstance {
                effect: effect(name).expect("it is of the catalogue"),
                values: PerRollout::Shared(values),
            })
            .collect();
        let mut observe = |commands: &[[f64; 2]]| -> Vec<[f64; 2]> {
            let parameters = [Parameters::from(TRUTH)];
            let batch = Batch {
                effects: &chosen,
                time: TimeBase::Continuous(None),
                ..Batch::new(&rig, &parameters, commands)
            };
            let exact = batch.run(Engine::Rolling, None, &AtomicBool::new(false));
            let mut noisy = |x: f64| {
                let draw: f64 = StandardNormal.sample(&mut random);
                x + NOISE * draw
            };
            exact
                .expect("the truth is physical")
                .iter()
                .map(|place| place.map(&mut noisy))
                .collect()
        };
        let observed: Vec<Vec<[f64; 2]>> = commands.iter().map(|one| observe(one)).collect();
        let recordings: Vec<Recording<'_>> = commands
            .iter()
            .zip(&observed)
            .map(|(commands, observed)| Recording {
                commands,
                knobs_before: [0.0; 2],
                durations: None,
                observed,
                tilt: None,
                way: None,
                path: None,
            })
            .collect();
        let stretches: Vec<Stretch> = (0..RUNS)
            .map(|recording| Stretch {
                recording,
                first: 0,
                rows: ROWS,
                at_rest: true,
            })
            .collect();
        let hypotheses: Vec<Hypothesis> = chosen
            .iter()
            .map(|one| Hypothesis::free(one.effect))
            .collect();
        let problem = Problem {
            rig: &rig,
            parameters: RANGES.map(|range| ParameterSpec::Free { range, start: None }),
            effects: &hypotheses,
            recordings: &recordings,
            stretches: &stretches,
            noise: None,
            tilt_noise: None,
            engine: Engine::Rolling,
            hold: Hold::Zero,
            threads: None,
        };
        let mut seed = 0;
        group.bench_function(name, |bencher| {
            let settings = || {
                seed += 1;
                Settings {
                    starts: STARTS,
                    seed,
                    ..Settings::default()
                }
            };
            let fit = |settings: Settings| {
                black_box(problem.fit(&settings, &|_, _, _| (), &AtomicBool::new(false)))
            };
            bencher.iter_batched(settings, fit, BatchSize::SmallInput);
        });
    }
    group.finish();
}

criterion_group!(benches, fits);
criterion_main!(benches);
