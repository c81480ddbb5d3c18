//! What each effect costs over the base rollout, in the fast engine on one thread.

use std::hint::black_box;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use labsim::{Batch, EffectInstance, EffectSpec, Engine, PerRollout, Rig, effects, paper_drive};

mod paper;

const ROWS: usize = 100;
const ROLLOUTS: usize = 2048;

/// Values in the middle of the plausible ones, a little different for each rollout, as in a search; choices
/// are answered as usual, or the other way.
fn values(effect: &EffectSpec, is_usual: bool) -> Vec<f64> {
    (0..ROLLOUTS)
        .flat_map(|rollout| {
            let place = 0.4 + 0.2 * rollout as f64 / ROLLOUTS as f64;
            effect.parameters.iter().map(move |one| match one.range {
                (usual, _) if one.is_choice() && !is_usual => 1.0 - usual,
                (low, high) => low + place * (high - low),
            })
        })
        .collect()
}

fn cost_of_effects(criterion: &mut Criterion) {
    let (rig, commands) = (Rig::default(), paper_drive(ROWS, 0.1, false));
    let parameters = paper::spread(ROLLOUTS);
    let mut group = criterion.benchmark_group("effects");
    group
        .throughput(Throughput::Elements(paper::substeps(&parameters, ROWS)))
        .sampling_mode(SamplingMode::Flat)
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    let mut measure = |name: &str, chosen: &[EffectInstance<'_>]| {
        let batch = Batch {
            effects: chosen,
            ..Batch::new(&rig, &parameters, &commands)
        };
        group.bench_function(name, |bencher| {
            bencher
                .iter(|| black_box(batch.run(Engine::Rolling, Some(1), &AtomicBool::new(false))));
        });
    };
    measure("base", &[]);
    for effect in effects() {
        let mut measure = |name: &str, values: &[f64]| {
            let values = PerRollout::Each(values);
            measure(name, &[EffectInstance { effect, values }]);
        };
        measure(effect.name, &values(effect, true));
        if let Some(choice) = effect.parameters.iter().find(|one| one.is_choice()) {
            let other = 1.0 - choice.neutral;
            let name = format!("{}, {} = {other}", effect.name, choice.name);
            measure(&name, &values(effect, false));
        }
    }
    group.finish();
}

criterion_group!(benches, cost_of_effects);
criterion_main!(benches);
