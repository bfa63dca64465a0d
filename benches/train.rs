//! Speed of one training step on one thread, each kind of network at two batch sizes.
//!
//! `tests/python/train_speed.py` times the same steps in PyTorch.
#![allow(missing_docs)] // criterion's macros make public items

use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use tactile_pose_fusion::eval::Part;
use tactile_pose_fusion::train::*;

const N_TAXELS: usize = 16;
const N_JOINTS: usize = 4;
const N_FRAMES: usize = 2000;

/// Taps and rests of 100 frames each while the joints swing.
fn dataset(kind: Kind) -> Dataset {
    let mut frames = SessionFrames {
        name: "synthetic".into(),
        n_taxels: N_TAXELS,
        n_joints: N_JOINTS,
        part: vec![Part::Train; N_FRAMES],
        epoch: vec![0; N_FRAMES],
        ..SessionFrames::default()
    };
    for frame in 0..N_FRAMES {
        let loaded = frame % 200 >= 100;
        let force = if loaded { 50.0 + 50.0 * (frame as f32 * 0.3).sin() } else { 0.0 };
        let bend = |joint: usize| (frame as f32 * 0.01 + joint as f32).sin();
        frames.tactile.extend((0..N_TAXELS).map(|taxel| taxel as f32 * force + 30.0 * bend(taxel % N_JOINTS)));
        frames.pose.extend((0..N_JOINTS).map(bend));
        frames.truth_gf.push(force);
        frames.zero_load.push(!loaded);
    }
    let spec = WindowSpec { needs_pose: kind.uses_pose(), ..WindowSpec::default() };
    Dataset::new(vec![Session::new(frames).unwrap()], spec).unwrap()
}

/// Time of `n` steps.
fn steps(trainer: &mut Trainer<'_>, n: u64) -> Duration {
    let stop = AtomicBool::new(false);
    let mut left = n;
    let start = Instant::now();
    let outcome = trainer.run(&stop, None, &mut |progress| {
        black_box(progress.loss);
        left -= 1;
        stop.store(left == 0, Ordering::Relaxed);
    });
    let taken = start.elapsed();
    black_box(outcome.unwrap());
    taken
}

fn step(c: &mut Criterion) {
    for (name, kind) in [("pose-aware", Kind::PoseAware), ("tactile-only", Kind::TactileOnly)] {
        let dataset = dataset(kind);
        let mut group = c.benchmark_group(format!("train_step/{name}"));
        group.sample_size(10);
        for batch in [256, 64] {
            let schedule = Schedule { steps: u64::MAX, ..Schedule::default() };
            let cfg = TrainConfig { kind, batch, schedule, ..TrainConfig::default() };
            let mut trainer = Trainer::new(cfg, &dataset, 1).unwrap();
            steps(&mut trainer, 2);
            group.throughput(Throughput::Elements(batch as u64));
            group.bench_function(format!("batch_{batch}"), |b| b.iter_custom(|n| steps(&mut trainer, n)));
        }
        group.finish();
    }
}

criterion_group!(benches, step);
criterion_main!(benches);
