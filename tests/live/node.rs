//! The live node between real ROS 2 peers: what it publishes is what replay writes.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use common::bags::{at, decoded, messages, write_session};
use common::onnx::LinearModel;
use common::tpf::tpf;
use node_common::estimates::{assert_equals_replay, replay};
use node_common::{Live, PARAMS, peer, write_setup};
use tactile_pose_fusion::msg::{ContactArray, ContactState};

const NODE: &str = "/tactile_pose_fusion";

/// What a peer wrote down: the wrenches and the contacts that it received.
fn received(python: &std::path::Path, folder: &std::path::Path, who: &str) -> serde_json::Value {
    let output = peer(python, "play_session.py", &["session.mcap", "4", who, NODE, "/taxels", "/joints"], folder);
    serde_json::from_str(&output).unwrap_or_else(|error| panic!("{error}: {output}"))
}

#[test]
fn rclpy_receives_what_replay_of_the_same_data_writes() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 12);
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", "");
    replay(folder.path(), "session.mcap", "replayed.mcap");
    let live = Live::start(folder.path(), &["--params-file", "live.yaml", "--calibration", "calibration.yaml"]);
    let got = received(&python, folder.path(), "rclpy");
    live.stop();
    assert_equals_replay(&got, &folder.path().join("replayed.mcap"));
}

#[test]
fn a_simulated_session_through_rclpy_gives_what_replay_gives() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let args = ["--glove", "1", "--users", "1", "--sessions", "1", "--seed", "3", "--minutes", "1.7", "-o", "sim"];
    tpf(folder.path(), &[&["simulate"], &args[..]].concat()).ok();
    let bag = "sim/glove1_user01_session1/glove1_user01_session1_0.mcap";
    LinearModel::new(64, 6, 4).gains(0.001, 0.5).metadata("unit", "N").write(folder.path(), "model.onnx");
    let params = |taxels: &str, rest: &str| {
        format!(
            "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {{topic: /glove/taxels, n_taxels: 6{taxels}}}
    joint.hand: {{topic: /hand/joint_states}}
    model.tip: {{path: model.onnx, backend: rten}}
    region.index:
      model: tip
      joints: [index_dip, index_pip, index_mcp_flex, index_mcp_abd]
      frame_id: index_tip
    calibration: {{max_force: 1000.0, file: calibration.yaml}}
    timing.joint_slack_ms: 500.0
{rest}"
        )
    };
    std::fs::write(folder.path().join(PARAMS), params("", "")).unwrap();
    let reliable = "    qos_overrides:
      /glove/taxels: {subscription: {reliability: reliable, depth: 1000}}
      /hand/joint_states: {subscription: {reliability: reliable, depth: 1000}}
      /tactile_pose_fusion/index/wrench: {publisher: {reliability: reliable, depth: 1000}}
      /tactile_pose_fusion/contacts: {publisher: {reliability: reliable, depth: 1000}}
    tactile_timeout_ms: 500.0
    timing.max_age_ms: 0.0
";
    let live = params(", type: sensor_msgs/msg/LaserScan, field: ranges", reliable);
    std::fs::write(folder.path().join("live.yaml"), live).unwrap();
    tpf(folder.path(), &["calibrate", bag, "--params-file", PARAMS, "-o", "calibration.yaml"]).ok();
    replay(folder.path(), bag, "replayed.mcap");
    // The calibration that the parameters name is read at start.
    let live = Live::start(folder.path(), &["--params-file", "live.yaml"]);
    let output = peer(
        &python,
        "play_session.py",
        &[bag, "6", "rclpy", NODE, "/glove/taxels", "/hand/joint_states"],
        folder.path(),
    );
    live.stop();
    let got = serde_json::from_str(&output).unwrap_or_else(|error| panic!("{error}: {output}"));
    assert_equals_replay(&got, &folder.path().join("replayed.mcap"));
}

#[test]
fn cyclone_dds_exchanges_our_own_messages_with_the_node() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 12);
    write_setup(folder.path(), "tactile_pose_fusion/msg/TaxelArray", "");
    replay(folder.path(), "session.mcap", "replayed.mcap");
    let live = Live::start(folder.path(), &["--params-file", "live.yaml", "--calibration", "calibration.yaml"]);
    let got = received(&python, folder.path(), "cyclone");
    live.stop();
    assert_equals_replay(&got, &folder.path().join("replayed.mcap"));
}

#[test]
fn a_recorded_run_replays_to_the_same_bytes() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 12);
    // The session is of long ago, so every frame is late: how late, replay knows from the recording.
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", "    timing.max_age_ms: 100.0\n");
    let args = ["--params-file", "live.yaml", "--calibration", "calibration.yaml", "--record", "run.mcap"];
    let live = Live::start(folder.path(), &args);
    received(&python, folder.path(), "rclpy");
    let text = live.stop();
    assert!(text.contains("run.mcap: "), "{text}");
    let args = ["--params-file", "live.yaml", "--calibration", "calibration.yaml", "--batch", "1", "--backend", "rten"];
    tpf(folder.path(), &[&["replay", "run.mcap", "-o", "again.mcap"], &args[..]].concat()).ok();
    let estimates = |name: &str| -> Vec<_> {
        let all = messages(&folder.path().join(name)).into_iter();
        all.filter(|message| message.topic.starts_with(NODE))
            .map(|message| (message.topic, message.log_time, message.data))
            .collect()
    };
    let (live, again) = (estimates("run.mcap"), estimates("again.mcap"));
    assert!(live.len() > 1000 && live == again, "{} and {} messages", live.len(), again.len());
    assert!(at(0) < live[0].1);
    let contacts: Vec<ContactArray> = decoded(&folder.path().join("again.mcap"), &format!("{NODE}/contacts"));
    let late = |array: &ContactArray| array.contacts[0].flags & ContactState::LATE != 0 && array.contacts[0].age > 1e6;
    assert!(contacts.iter().all(late), "{:?}", contacts[0]);
}
