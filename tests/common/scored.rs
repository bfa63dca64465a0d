//! Sessions that can be scored.
#![allow(dead_code, unreachable_pub)]

use std::fs;

use super::onnx::LinearModel;
use super::tpf::tpf;

/// Parameters of the sessions in [`folder`].
pub const PARAMS: &str = "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    truth_sources: [load_cell]
    tactile.glove: {topic: /glove/taxels, n_taxels: 6}
    joint.hand: {topic: /hand/joint_states}
    truth.load_cell: {topic: /load_cell/wrench}
    model.tip: {path: model.onnx}
    calibration.max_force: 1000.0 # the models only add up taxels: a hand that moves in the air reads as force
    region.index: {model: tip, joints: [index_dip, index_pip, index_mcp_flex, index_mcp_abd], frame_id: index_tip}
";

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
