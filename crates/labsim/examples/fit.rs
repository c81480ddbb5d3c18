//! Records three runs of a simulated rig, with noise, and finds its parameters again.
//!
//! The rows are stamped: without stamps a slower clock under larger gears would explain the runs as well.
//!
//! `cargo run --release --package labsim --example fit`

use std::sync::atomic::AtomicBool;

use labsim::fit::{ParameterSpec, Problem, Recording, Settings, Stretch};
use labsim::parameters::NAMES;
use labsim::{Batch, Engine, Hold, Parameters, Result, Rig, paper_drive};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

const ROWS: usize = 100;
/// Standard deviation of the tracker (board edges): half a millimetre.
const NOISE: f64 = 0.002;
/// Updates of 1/240 s a row, and how long a row lasts (s).
const TIME_SCALE: f64 = 24.0;
const ROW_S: f64 = TIME_SCALE / 240.0;
const TRUTH: [f64; 5] = [0.06, 0.05, 4e-4, TIME_SCALE, 1.05];
const RANGES: [(f64, f64); 5] = [
    (0.0, 0.1),
    (0.0, 0.1),
    (0.0, 0.001),
    (0.0, 50.0),
    (0.8, 1.2),
];

fn main() -> Result<()> {
    let (rig, cancel) = (Rig::default(), AtomicBool::new(false));
    let truth: [Parameters; 1] = [TRUTH.into()];
    let tracker = Normal::new(0.0, NOISE).expect("a deviation above 0");
    let mut random = ChaCha8Rng::seed_from_u64(1);

    let drives: Vec<_> = [0.06, 0.1, -0.08]
        .iter()
        .map(|&amplitude| paper_drive(ROWS, amplitude, false))
        .collect();
    let stamps = [ROW_S; ROWS];
    let mut seen = Vec::new();
    for knobs in &drives {
        let mut path = Batch::new(&rig, &truth, knobs).run(Engine::Rolling, None, &cancel)?;
        for value in path.as_flattened_mut() {
            *value += tracker.sample(&mut random);
        }
        seen.push(path);
    }

    let recordings: Vec<_> = drives
        .iter()
        .zip(&seen)
        .map(|(knobs, path)| Recording {
            commands: knobs,
            knobs_before: [0.0; 2],
            durations: Some(&stamps),
            observed: path,
            tilt: None,
            way: None,
            path: None,
        })
        .collect();
    let stretches: Vec<_> = (0..recordings.len())
        .map(|recording| Stretch {
            recording,
            first: 0,
            rows: ROWS,
            at_rest: true,
        })
        .collect();
    let mut parameters = RANGES.map(|range| ParameterSpec::Free { range, start: None });
    parameters[3] = ParameterSpec::Held(TIME_SCALE);
    let problem = Problem {
        rig: &rig,
        parameters,
        effects: &[],
        recordings: &recordings,
        stretches: &stretches,
        noise: None,
        tilt_noise: None,
        engine: Engine::Rolling,
        hold: Hold::Zero,
        threads: None,
    };
    let solution = problem.fit(&Settings::default(), &|_, _, _| (), &cancel)?;

    println!("parameter              truth      found  +- deviation");
    let information = &solution.information;
    for (&i, deviation) in information.free.iter().zip(information.deviations()) {
        let (name, truth, found) = (NAMES[i], TRUTH[i], solution.values[i]);
        println!("{name:<18} {truth:>9.5}  {found:>9.5}  +- {deviation:.5}");
    }
    println!("noise of the tracker: {NOISE}, found {:.5}", solution.noise);
    Ok(())
}
