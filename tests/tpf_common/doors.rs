//! Every place of the command line where a path is given, with a URI in it.

use std::collections::BTreeSet;
use std::path::Path;

use super::tpf::Run;

/// Commands for the folder of `scored::folder`, in which `BAG` is a bag, `PARAMS` gives the parameters, and `NO/` begins a
/// URI of a bucket that is not there.
pub const DOORS: &[&str] = &[
    "inspect NO/bag.mcap",
    "inspect BAG --message-definitions NO/msgs",
    "init NO/bag.mcap -o new.yaml --yes",
    "init BAG -o NO/new.yaml --yes",
    "init BAG -o new.yaml --yes --model NO/model.onnx",
    "init BAG -o new.yaml --yes --message-definitions NO/msgs",
    "replay NO/bag.mcap PARAMS -o new.mcap",
    "replay BAG PARAMS -o NO/new.mcap",
    "replay BAG PARAMS -o NO/new",
    "replay BAG --params-file NO/params.yaml -o new.mcap",
    "replay BAG PARAMS --calibration NO/zero.yaml -o new.mcap",
    "replay BAG PARAMS --model NO/model.onnx -o new.mcap",
    "replay BAG PARAMS -p model.tip.path:=NO/model.onnx -o new.mcap",
    "replay BAG PARAMS -p message_definitions:=NO/msgs -o new.mcap",
    "replay NO/bags PARAMS --each -o new",
    "eval NO/bag.mcap PARAMS --model model.onnx",
    "eval bags PARAMS --model NO/model.onnx",
    "eval bags PARAMS --model model.onnx --compare NO/other.onnx",
    "eval bags PARAMS --model model.onnx --gate NO/gates.yaml",
    "eval bags PARAMS --model model.onnx --gate gates.yaml --junit NO/j.xml",
    "eval bags PARAMS --model model.onnx --gate gates.yaml --jsonl NO/j.jsonl",
    "eval bags PARAMS --model model.onnx --report NO/r.html",
    "eval bags PARAMS --model model.onnx --parquet NO/r.parquet",
    "eval bags PARAMS --model model.onnx --frames NO/f.parquet",
    "eval bags PARAMS --model model.onnx --partial NO/p.parquet",
    "merge NO/p.parquet",
    "merge bags --expect NO/bags.txt",
    "merge NO/s0 --lerobot new",
    "export NO/bag.mcap PARAMS --csv new.csv",
    "export bags PARAMS --csv NO/t.csv",
    "export bags PARAMS --parquet NO/t.parquet",
    "export bags PARAMS --lerobot NO/set",
    "calibrate NO/bag.mcap PARAMS -o new.yaml",
    "calibrate BAG PARAMS -o NO/zero.yaml",
    "characterize NO/bag.mcap PARAMS",
    "characterize bags PARAMS --report NO/r.html",
    "view NO/bag.mcap PARAMS --no-open",
    "view BAG --params-file NO/params.yaml --no-open",
    "diff NO/a.mcap BAG",
    "diff BAG NO/b.mcap",
    #[cfg(feature = "train")]
    "train NO/bag.mcap PARAMS -o new.onnx",
    #[cfg(feature = "train")]
    "train bags PARAMS -o NO/new.onnx",
    "simulate --glove 1 --users 1 --sessions 1 --minutes=1.7 --seed 5 -o NO/new",
    "demo -o NO/demo",
    "completions --man NO/man",
];

/// As [`DOORS`], of commands that talk to a graph when they are not refused: only for `tests/ros/isolated`.
#[cfg(feature = "ros")]
pub const LIVE_DOORS: &[&str] = &[
    "run --ros-args --params-file NO/params.yaml",
    "run --record NO/r.mcap --ros-args --params-file params.yaml",
    "run --calibration NO/zero.yaml --ros-args --params-file params.yaml",
    "run --ros-args --params-file params.yaml -p calibration.file:=NO/zero.yaml",
    "run --ros-args --params-file params.yaml -p message_definitions:=NO/msgs",
    "doctor --params-file NO/params.yaml",
    "view --live --params-file NO/params.yaml --no-open",
    "play NO/bag.mcap",
    "collect PARAMS -o NO/anna",
    "collect PARAMS -o NO/anna --resume",
    "collect PARAMS -o anna --protocol NO/p.yaml",
    "simulate --live --glove 1 --seed 5 --minutes 1 --protocol NO/p.yaml",
    "init --live -o NO/new.yaml",
    "calibrate --live PARAMS -o NO/zero.yaml",
    "call load NO/zero.yaml",
];

/// The words of a door, and a part of the folder that they are run in.
pub fn words(door: &str) -> Vec<String> {
    let door = door
        .replace("BAG", "bags/glove1_user01_session1")
        .replace("PARAMS", "--params-file params.yaml")
        .replace("NO/", "s3://none/");
    door.split_whitespace().map(str::to_owned).collect()
}

/// Gates for them.
pub fn write_gates(folder: &Path) {
    std::fs::write(folder.join("gates.yaml"), "gates:\n  - {metric: ba, at_least: 0.0}\n").unwrap();
}

/// What is in a folder.
pub fn names(folder: &Path) -> BTreeSet<std::ffi::OsString> {
    std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect()
}

/// Checks that a run was refused in one line about the URI, for one of these reasons.
pub fn check_refused(door: &str, run: &Run, reasons: &[&str]) {
    // Bags that fail are named one by one, each in its line.
    let lines: Vec<&str> = run.stderr.lines().collect();
    let is_told = |line: &&str| line.contains("s3://none/") && reasons.iter().any(|reason| line.contains(reason));
    assert!(run.code == 1 || run.code == 3, "{door}: {run:?}");
    assert!(lines.iter().any(is_told), "{door}: {run:?}");
    for wrong in ["os error", "s3:/n", "panicked"] {
        assert!(!run.stderr.contains(wrong), "{door}: {run:?}");
    }
}
