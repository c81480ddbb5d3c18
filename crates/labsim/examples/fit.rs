//! Records three runs of a simulated rig, with noise, and finds its five parameters again.
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
const TRUTH: [f64; 5] = [0.06, 0.05, 4e-4, 18.0, 1.05];
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
            durations: None,
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
    let problem = Problem {
        rig: &rig,
        parameters: RANGES.map(|range| ParameterSpec::Free { range, start: None }),
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
    let deviations = solution.information.deviations();
    for (i, name) in NAMES.iter().enumerate() {
        let (truth, found, deviation) = (TRUTH[i], solution.values[i], deviations[i]);
        println!("{name:<18} {truth:>9.5}  {found:>9.5}  +- {deviation:.5}");
    }
    println!("noise of the tracker: {NOISE}, found {:.5}", solution.noise);
    Ok(())
}
