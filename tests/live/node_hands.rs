//! Hands that are not told as angles, live: in every form of the simulator, and as frames that Cyclone DDS tells.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use common::ROOT;
use common::bags::{Bag, at, decoded};
use common::onnx::LinearModel;
use common::tpf::tpf;
use node_common::{Live, peer_command, write_definitions};
use tactile_pose_fusion::hand::NamedLayout;
use tactile_pose_fusion::msg::{ContactArray, ContactState, Float32MultiArray, MultiArrayLayout};

const INDEX: [&str; 4] = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"];

/// A process that publishes until it is dropped.
struct Publisher(Child);

impl Drop for Publisher {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Parameters of a glove with six taxels beside this hand.
fn write_params(folder: &Path, taxels: &str, hand: &str) {
    let joints = INDEX.join(", ");
    let params = format!(
        "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {{n_taxels: 6, {taxels}}}
    joint.hand: {{{hand}}}
    model.tip: {{path: model.onnx, backend: rten}}
    region.index: {{model: tip, joints: [{joints}], frame_id: index_tip}}
    message_definitions: definitions
    calibration: {{max_force: 1000.0, file: zero.yaml}}
"
    );
    fs::write(folder.join("params.yaml"), params).unwrap();
}

/// Holds what a node recorded against a replay of it; the frames that had a pose, and their forces, N.
fn forces_as_in_replay(folder: &Path, what: &str) -> Vec<f64> {
    tpf(folder, &["replay", "live.mcap", "--params-file", "params.yaml", "-o", "again.mcap", "--overwrite"]).ok();
    let compared = tpf(folder, &["diff", "live.mcap", "again.mcap"]).ok();
    assert!(compared.stdout.contains("every field equal, bit by bit"), "{what}: {compared:?}");
    let arrays: Vec<ContactArray> = decoded(&folder.join("live.mcap"), "/tactile_pose_fusion/contacts");
    let of = arrays.iter().map(|array| &array.contacts[0]);
    // While a pose in the window is unknown, at the start or when a sender was held up, force is force_base.
    of.filter(|state| state.flags & ContactState::STALE_POSE == 0)
        .map(|state| state.force)
        .filter(|force| force.is_finite())
        .collect()
}

#[test]
fn the_simulators_hand_in_every_form_gives_live_what_its_recording_gives_in_replay() {
    if !common::skip::isolated() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    LinearModel::new(8, 6, 4).gains(0.001, 0.5).metadata("unit", "N").write(folder, "model.onnx");
    let forms = [
        ("openxr", "topic: /hand/poses, type: geometry_msgs/msg/PoseArray, hand.layout: openxr, hand.side: right"),
        (
            "keypoints21",
            "topic: /hand/keypoints, type: std_msgs/msg/Float64MultiArray, field: data, stamp: receipt, hand.layout: mano21, hand.side: right",
        ),
        (
            "named",
            "topic: /hand/named_poses, type: teleop_ros2_interfaces/msg/HandJointPoses, hand.layout: openxr, hand.side: right",
        ),
        (
            "manus",
            "topic: /manus_glove_0, type: manus_ros2_msgs/msg/ManusGlove, only: side=Right, stamp: receipt, hand.layout: manus, hand.side: right",
        ),
        ("transforms", "topic: /tf, type: tf2_msgs/msg/TFMessage, hand.layout: openxr25, hand.side: right"),
    ];
    for (form, hand) in forms {
        write_params(folder, "topic: /glove/taxels", hand);
        let glove = ["simulate", "--glove", "1", "--seed", "5", "--minutes", "2", "--hand", form];
        tpf(folder, &[&glove[..], &["--users", "1", "--sessions", "1", "-o", form]].concat()).ok();
        let bag = format!("{form}/glove1_user01_session1");
        write_definitions(folder, &bag);
        if !folder.join("zero.yaml").exists() {
            tpf(folder, &["calibrate", &bag, "--params-file", "params.yaml", "-o", "zero.yaml"]).ok();
        }
        let _ = fs::remove_file(folder.join("live.mcap"));
        // The frames that never move are told once, before the node is there.
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(folder).args(glove).args(["--live", "--ignore-prompts"]);
        let _glove = Publisher(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
        std::thread::sleep(Duration::from_secs(1)); // it publishes before anyone listens
        let node = Live::start(folder, &["--params-file", "params.yaml", "--record", "live.mcap"]);
        std::thread::sleep(Duration::from_secs(8)); // to find each other on a busy machine, and two of data
        node.stop();
        let n = forces_as_in_replay(folder, form).len();
        assert!(n > 150, "{form}: {n} frames with a pose");
    }
}

#[derive(serde::Deserialize)]
struct Hand {
    side: String,
    angles: Vec<f64>,
    #[serde(default)]
    frames: Vec<serde_json::Value>,
}

#[test]
fn frames_that_another_middleware_told_before_the_node_was_there_place_the_points_of_the_hand() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let model = LinearModel::new(8, 6, 4).gains(0.001, 0.5).metadata("unit", "N");
    model.write(folder, "model.onnx");
    let reference = &format!("{ROOT}/tests/data/hand_reference.json");
    let hands: Vec<Hand> = serde_json::from_slice(&fs::read(reference).unwrap()).unwrap();
    let of_frames = |hand: &Hand| hand.frames.len() == 25 && hand.side == "right";
    let idx = hands.iter().position(of_frames).unwrap();
    let names = NamedLayout::OpenXr25.points().join(",");
    let taxels = "topic: /fingertip/pressure, type: std_msgs/msg/Float32MultiArray, field: data, stamp: receipt";
    // A zero needs no joint angles, but a bag in which their topic is.
    let mut rest = Bag::create(&folder.join("rest.mcap"));
    for k in 0..400 {
        let data = (0..6).map(|taxel| 100.0 + taxel as f32).collect();
        rest.send("/fingertip/pressure", at(10 * k), &Float32MultiArray { layout: MultiArrayLayout::default(), data });
        rest.joints(at(10 * k), &INDEX, &[0.0; 4]);
    }
    rest.finish();
    let zero =
        ["calibrate", "rest.mcap", "--params-file", "zero-params.yaml", "--calibrate-first", "3", "-o", "zero.yaml"];
    write_params(folder, taxels, "topic: /joints");
    fs::rename(folder.join("params.yaml"), folder.join("zero-params.yaml")).unwrap();
    tpf(folder, &zero).ok();
    write_params(folder, taxels, "topic: /tf, type: tf2_msgs/msg/TFMessage, hand.layout: openxr25, hand.side: right");
    let args = [reference, &idx.to_string(), &names, "60"];
    let mut frames = peer_command(&python, "frames.py", &args, folder).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(frames.stdout.take().unwrap()).lines();
    let frames = Publisher(frames);
    assert!(lines.by_ref().map_while(Result::ok).any(|line| line == "told"));
    let node = Live::start(folder, &["--params-file", "params.yaml", "--record", "live.mcap"]);
    std::thread::sleep(Duration::from_secs(8)); // to find each other on a busy machine, and two of data
    node.stop();
    drop(frames);
    let forces = forces_as_in_replay(folder, "Cyclone DDS");
    let angles: Vec<f32> = hands[idx].angles[..4].iter().map(|angle| *angle as f32).collect();
    let expected = f64::from(model.expected(&[0.0; 6], &angles).0);
    assert!(forces.len() > 150, "{}", forces.len());
    let off = forces.iter().map(|force| (force - expected).abs()).fold(0.0, f64::max);
    assert!(off < 1e-4, "{off} N from {expected}");
}
