//! Substeps a second of both engines on the paper's drive, with parameters drawn over its ranges.

use std::hint::black_box;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use labsim::{Batch, Engine, Rig, paper_drive};

mod paper;

const ROWS: usize = 100;

fn paper_rollouts(criterion: &mut Criterion) {
    let commands = paper_drive(ROWS, 0.1, false);
    let rig = Rig::default();
    // Enough work for a sample to outlast the noise of a shared machine.
    let sizes = [
        (Engine::Rolling, 20_000),
        (Engine::Rolling, 64),
        (Engine::Rolling, 1),
    ]
    .into_iter()
    .chain([
        (Engine::Rapier, 1024),
        (Engine::Rapier, 64),
        (Engine::Rapier, 1),
    ]);
    for (engine, count) in sizes {
        let name = Engine::ALL
            .iter()
            .find(|(_, other)| *other == engine)
            .map_or("", |(name, _)| name);
        let parameters = paper::spread(count);
        let substeps = paper::substeps(&parameters, ROWS);
        let batch = Batch::new(&rig, &parameters, &commands);
        let mut group = criterion.benchmark_group(name);
        group
            .throughput(Throughput::Elements(substeps))
            .sampling_mode(SamplingMode::Flat);
        group
            .sample_size(10)
            .warm_up_time(Duration::from_secs(1))
            .measurement_time(Duration::from_secs(4));
        for threads in if count == 1 { vec![1] } else { vec![1, 2] } {
            let plural = |n: usize| if n == 1 { "" } else { "s" };
            let id = format!(
                "{count} rollout{}, {threads} thread{}",
                plural(count),
                plural(threads)
            );
            group.bench_function(id, |bencher| {
                bencher
                    .iter(|| black_box(batch.run(engine, Some(threads), &AtomicBool::new(false))));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, paper_rollouts);
criterion_main!(benches);
