//! A replay on several cores, and in batches of any size: what it writes and says is what one core writes and says, frame by
//! frame as the live node.

use crate::common;

use std::fs;
use std::path::Path;

use common::ROOT;
use common::bags::{Bag, at};
use common::onnx::LinearModel;
use common::tpf::{Run, tpf, write_params};
use tactile_pose_fusion::msg::{Float32MultiArray, MultiArrayLayout};

const JOINTS: [&str; 4] = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"];
const N_TAXELS: usize = 6;

/// A session of `n` frames with single frames missing and a gap, beside a topic that only `--merge` looks at.
fn session(n: i64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("session.mcap"));
    for k in 0..n {
        let angles: [f64; 4] = std::array::from_fn(|joint| 0.5 + 0.5 * (k as f64 * 0.02 + joint as f64).sin());
        bag.joints(at(k * 10), &JOINTS, &angles);
        if k % 97 != 0 && !(700..730).contains(&k) {
            let taxels: [f32; N_TAXELS] = std::array::from_fn(|taxel| ((k * 31 + taxel as i64 * 17) % 97) as f32);
            bag.taxels(at(k * 10 + 1), &taxels);
        }
        if k % 50 == 0 {
            let image = Float32MultiArray { layout: MultiArrayLayout::default(), data: vec![k as f32; 20_000] };
            bag.send("/camera", at(k * 10 + 2), &image);
        }
    }
    bag.finish();
    write_params(folder.path(), N_TAXELS, &JOINTS, "    calibration.max_loaded_fraction: 1.0\n");
    folder
}

fn replay(folder: &Path, jobs: &str, output: &str, more: &[&str]) -> Run {
    let args = ["replay", "session.mcap", "--params-file", "params.yaml", "--calibrate-first", "5"];
    tpf(folder, &[&args[..], &["--jobs", jobs, "-o", output], more].concat())
}

#[test]
fn any_number_of_jobs_writes_the_same_bytes() {
    let folder = session(1400);
    let folder = folder.path();
    let model = &format!("{ROOT}/models/glove1_pose_aware.onnx");
    for merge in [&[][..], &["--merge"]] {
        let written = |jobs: &str| {
            let output = format!("{jobs}{}.mcap", merge.len());
            let run = replay(folder, jobs, &output, &[&["--model", model, "--json"], merge].concat()).ok().json();
            assert!(run["regions"][0]["estimates"].as_u64().unwrap() > 1000, "{run}");
            let busy: f64 = run["busy_s"].as_object().unwrap().values().map(|busy| busy.as_f64().unwrap()).sum();
            assert!(busy > 0.0 && busy <= 4.0 * run["wall_s"].as_f64().unwrap(), "{run}");
            fs::read(folder.join(output)).unwrap()
        };
        let one = written("1");
        for jobs in ["2", "5"] {
            assert!(written(jobs) == one, "{jobs} jobs, {merge:?}");
        }
    }
}

#[test]
fn with_the_papers_network_any_batch_writes_the_same_bytes() {
    let folder = session(1400);
    let folder = folder.path();
    let model = &format!("{ROOT}/models/glove1_pose_aware.onnx");
    let written = |more: &[&str]| {
        let output = format!("out{}.mcap", more.concat());
        replay(folder, "2", &output, &[&["--model", model], more].concat()).ok();
        fs::read(folder.join(output)).unwrap()
    };
    let by_default = written(&[]);
    for batch in ["1", "2", "32", "1000"] {
        assert!(written(&["--batch", batch]) == by_default, "batches of {batch}");
    }
}

#[test]
fn any_number_of_jobs_says_the_same_of_input_that_is_lost() {
    let folder = session(600);
    let folder = folder.path();
    LinearModel::new(64, N_TAXELS, 4).metadata("unit", "N").write(folder, "model.onnx");
    let bytes = fs::read(folder.join("session.mcap")).unwrap();
    fs::write(folder.join("session.mcap"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    let said = |jobs: &str| {
        let run = replay(folder, jobs, &format!("{jobs}.mcap"), &["-p", "calibration.max_force:=1000.0"]);
        assert_eq!(run.code, 3, "{run:?}");
        let lost: Vec<String> = run.stderr.lines().filter(|line| line.contains("lost")).map(str::to_owned).collect();
        assert!(!lost.is_empty(), "{run:?}");
        (lost, fs::read(folder.join(format!("{jobs}.mcap"))).unwrap())
    };
    assert!(said("1") == said("3"));
}

#[test]
fn a_run_that_fails_leaves_nothing_and_says_the_same_on_any_number_of_jobs() {
    let folder = session(900);
    let folder = folder.path();
    LinearModel::new(64, N_TAXELS, 4).metadata("unit", "N").write(folder, "model.onnx");
    let names = || {
        let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let before = names();
    let failure = |jobs: &str, more: &[&str]| {
        let run = replay(folder, jobs, "out.mcap", more);
        assert!(!folder.join("out.mcap").exists());
        run.failure().to_owned()
    };
    // Refused when the calibration is over, and when the bag is.
    for more in [&["-p", "calibration.max_loaded_fraction:=0.0"][..], &["-p", "region.index.joints:=[a, b, c, d]"]] {
        assert_eq!(failure("1", more), failure("4", more));
    }
    assert_eq!(names(), before);
}
