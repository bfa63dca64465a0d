//! Sessions that can be scored.
#![allow(dead_code, unreachable_pub)]

use std::fs;

use super::onnx::LinearModel;
use super::tpf::tpf;

pub use super::all::scored::PARAMS;

/// Two users' short sessions of a synthetic glove, and a model that sums taxels.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("params.yaml"), PARAMS).unwrap();
    let simulate = ["simulate", "--glove", "1", "--users", "2", "--sessions", "1", "--minutes=1.7", "--seed", "5"];
    tpf(path, &[&simulate[..], &["-o", "bags"]].concat()).ok();
    LinearModel::new(64, 6, 4).metadata("unit", "gF").write(path, "model.onnx");
    LinearModel::new(64, 6, 0).metadata("unit", "gF").write(path, "other.onnx");
    folder
}
