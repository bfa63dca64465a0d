//! Replay of a bag that is larger than anything it may hold.

use crate::common;

use std::path::Path;
use std::process::{Command, Stdio};

use common::bags::{Bag, at};
use common::onnx::LinearModel;
use common::tpf::write_params;
use tactile_pose_fusion::msg::{Float32MultiArray, MultiArrayLayout};

/// A session beside a camera that sends `n_images` of a megabyte that don't compress.
fn write_large(path: &Path, n_images: i64) {
    let mut bag = Bag::create(path);
    let mut noise = 1u32;
    for k in 0..500.max(n_images) {
        bag.joints(at(k * 10 + 3), &["dip"], &[0.1]);
        bag.taxels(at(k * 10 + 10), &[(k % 3) as f32, 1.0]);
        if k < n_images {
            let random = std::iter::repeat_with(|| {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f32::from_bits(noise >> 2)
            });
            let image = Float32MultiArray { layout: MultiArrayLayout::default(), data: random.take(1 << 18).collect() };
            bag.send("/camera", at(k * 10 + 5), &image);
        }
    }
    bag.finish();
}

/// Peak resident memory of a replay with `--merge`, in MiB.
fn peak_mib(folder: &Path, bag: &str) -> u64 {
    let args = ["--params-file", "params.yaml", "--calibrate-first", "3", "--merge", "--backend", "rten"];
    let mut child = Command::new(env!("CARGO_BIN_EXE_tpf"))
        .current_dir(folder)
        .args(["replay", bag, "-o", &format!("out_{bag}")])
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak_kib = 0;
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0);
        peak_kib = peak_kib.max(kib);
    }
    assert!(child.wait().unwrap().success());
    peak_kib / 1024
}

#[test]
fn memory_does_not_grow_with_the_length_of_a_bag() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    LinearModel::new(64, 2, 1).metadata("unit", "N").write(folder, "model.onnx");
    write_params(folder, 2, &["dip"], "    calibration.max_force: 1000.0\n");
    write_large(&folder.join("short.mcap"), 20);
    write_large(&folder.join("long.mcap"), 240);
    let grown = folder.join("long.mcap").metadata().unwrap().len() >> 20;
    assert!(grown > 200, "{grown} MiB");
    let (short, long) = (peak_mib(folder, "short.mcap"), peak_mib(folder, "long.mcap"));
    // Twelve times the data; what may differ is a chunk in flight and the allocator's slack.
    assert!(long < short + 48, "{short} MiB for 20 images, {long} MiB for 240");
}
