//! Speed of one tick and of replay, on each runtime that is here, side by side in one run.
//!
//! The model is the paper's network at its full size.
#![allow(missing_docs)] // criterion's macros make public items
#![allow(clippy::print_stdout)] // criterion prints the results

#[path = "../tests/tpf_common/mod.rs"]
mod common;

use std::hint::black_box;
use std::path::PathBuf;
use std::process::Command;

use common::bags::{Bag, at};
use common::fake::{config, region};
use common::parity::Parity;
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use tactile_pose_fusion::model::{BackendChoice, ModelSpec, load, vectors};

const JOINTS: [&str; 4] = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"];
const N_TAXELS: usize = 16;
const N_FRAMES: i64 = 18_000; // three minutes at 100 Hz

/// The model file, and what it is.
fn model() -> (PathBuf, &'static str) {
    (Parity::read().model, "paper")
}

fn backends() -> Vec<(&'static str, BackendChoice)> {
    let mut backends = vec![("auto", BackendChoice::Auto), ("rten", BackendChoice::Rten)];
    if common::onnx_runtime_is_here() {
        backends.push(("onnxruntime", BackendChoice::OnnxRuntime));
    }
    backends
}

fn taxels(k: i64) -> [f32; N_TAXELS] {
    std::array::from_fn(|taxel_idx| ((k * 31 + taxel_idx as i64 * 17) % 97) as f32 * 0.01)
}

fn angles(k: i64) -> [f64; 4] {
    std::array::from_fn(|joint_idx| (k as f64 * 0.01 + joint_idx as f64).sin())
}

/// A tick: one joint state and one frame of taxels in, the estimates of all regions out.
fn tick(c: &mut Criterion) {
    println!("vectors of the built-in code: {}", vectors());
    let (path, kind) = model();
    for n_regions in [1, 5] {
        let mut group = c.benchmark_group(format!("tick/{n_regions}_regions/{kind}"));
        for (name, backend) in backends() {
            let mut spec = ModelSpec::new(&path);
            spec.backend = backend;
            let all: Vec<usize> = (0..N_TAXELS).collect();
            let regions = (0..n_regions).map(|idx| region(&format!("r{idx}"), &all, &JOINTS)).collect();
            let mut fusion = common::fake::fusion(config(N_TAXELS, regions), vec![load(&spec).unwrap().regressor]);
            let names: Vec<String> = JOINTS.iter().map(|joint| joint.to_string()).collect();
            let mut k = 0;
            let mut step = move || {
                let (stamp, positions, values) = (at(k * 10), angles(k), taxels(k));
                fusion.handle(common::fake::joints(stamp, &names, &positions)).unwrap();
                fusion.handle(common::fake::tactile(stamp, &values)).unwrap();
                k += 1;
                black_box(fusion.poll().unwrap().map(|tick| tick.estimates.len()))
            };
            (0..100).for_each(|_| {
                step();
            });
            group.bench_function(name, |b| b.iter(&mut step));
        }
        group.finish();
    }
}

/// `tpf replay` as a user runs it: a process that loads the model, reads a minute of recording and writes its estimates.
fn replay(c: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (path, kind) = model();
    common::tpf::write_params(folder, N_TAXELS, &JOINTS, "    calibration.max_loaded_fraction: 1.0\n");
    let mut bag = Bag::create(&folder.join("session.mcap"));
    for k in 0..N_FRAMES {
        bag.joints(at(k * 10), &JOINTS, &angles(k));
        bag.taxels(at(k * 10 + 1), &taxels(k));
    }
    bag.finish();
    let mut group = c.benchmark_group(format!("replay/{kind}"));
    group.throughput(Throughput::Elements(N_FRAMES as u64)).sample_size(10);
    for (name, _) in backends() {
        for batch in ["1", "32", "4096"] {
            let run = || {
                let output = Command::new(env!("CARGO_BIN_EXE_tpf"))
                    .current_dir(folder)
                    .args(["replay", "session.mcap", "--params-file", "params.yaml", "--calibrate-first", "5"])
                    .args(["-o", "out.mcap", "--overwrite", "--backend", name, "--batch", batch])
                    .arg("--model")
                    .arg(&path)
                    .output()
                    .unwrap();
                assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            };
            group.bench_function(format!("{name}/batch_{batch}"), |b| {
                b.iter_batched(|| (), |()| run(), BatchSize::PerIteration);
            });
        }
    }
    group.finish();
}

criterion_group!(benches, tick, replay);
criterion_main!(benches);
