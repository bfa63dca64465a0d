//! Parameters of sessions that can be scored.
#![allow(dead_code, unreachable_pub)]

/// Parameters of a synthetic glove, with a model that only adds up taxels.
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
