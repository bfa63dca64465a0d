//! Names, parameters, lifecycle, diagnostics, tare and calibration of the node as rclpy meets them.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::path::Path;

use common::bags::write_session;
use common::onnx::LinearModel;
use node_common::{Feeder, Live, PARAMS, peer, write_setup};

/// A node with live data, and a check of `interfaces.py` against it.
fn check(args: &[&str], extra: &str, feed: &[&str], check: &[&str]) {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", extra);
    let all = [&["--params-file", "live.yaml"], args].concat();
    let live = Live::start(folder.path(), &all);
    let _feeder = Feeder::start(&python, feed, folder.path());
    run(&python, check, folder.path());
    live.stop();
}

fn run(python: &Path, check: &[&str], folder: &Path) {
    assert_eq!(peer(python, "interfaces.py", check, folder), "ok");
}

const CALIBRATED: [&str; 2] = ["--calibration", "calibration.yaml"];

#[test]
fn names_topics_and_types_are_seen() {
    check(&CALIBRATED, "", &["both", "60"], &["graph"]);
}

#[test]
fn parameters_are_listed_described_set_and_refused_with_the_reason() {
    check(&CALIBRATED, "", &["both", "60"], &["parameters"]);
}

#[test]
fn diagnostics_tell_rates_and_latency_once_a_second_and_rosout_what_was_refused() {
    check(&CALIBRATED, "", &["both", "60"], &["reports"]);
}

#[test]
fn tare_takes_a_new_zero() {
    check(&[], "", &["both", "60"], &["tare"]);
}

#[test]
fn a_lifecycle_manager_brings_the_node_up_and_down() {
    check(&CALIBRATED, "    autostart: false\n", &["both", "60"], &["lifecycle"]);
}

#[test]
fn every_new_client_is_answered() {
    check(&CALIBRATED, "", &["both", "60"], &["new_clients"]);
}

#[test]
fn a_client_that_the_node_learns_of_late_is_answered() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", "    autostart: false\n");
    let on_cyclone = [("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")];
    let live = Live::start_with(folder.path(), &["--params-file", "live.yaml"], &on_cyclone);
    assert_eq!(peer(&python, "late_client.py", &[], folder.path()), "unconfigured");
    live.stop();
}

#[test]
fn under_sim_time_stamps_are_those_of_clock() {
    check(&CALIBRATED, "    use_sim_time: true\n", &["both", "60"], &["sim_time"]);
}

#[test]
fn calibrate_gives_feedback_and_keeps_what_it_found_for_the_next_start() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", "    calibration.file: kept.yaml\n    user: ada\n");
    let params = ["--params-file", "live.yaml"];
    let live = Live::start(folder.path(), &params);
    let feeder = Feeder::start(&python, &["both", "60"], folder.path());
    run(&python, &["calibrate"], folder.path());
    drop(feeder);
    assert!(live.stop().contains("no calibration there yet"));
    let again = Live::start(folder.path(), &params).stop();
    assert!(again.contains("[INFO] calibration ") && again.contains("kept.yaml"), "{again}");
    let other = Live::start(folder.path(), &[&params[..], &["-p", "user:=bob"]].concat()).stop();
    assert!(other.contains("made for user \"ada\", the parameters say \"bob\""), "{other}");
}

#[test]
fn a_calibration_of_another_model_is_refused_at_the_start() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", "    calibration.file: kept.yaml\n");
    let params = ["--params-file", "live.yaml"];
    let live = Live::start(folder.path(), &params);
    let feeder = Feeder::start(&python, &["both", "60"], folder.path());
    run(&python, &["calibrate"], folder.path());
    drop(feeder);
    live.stop();
    LinearModel::new(4, 2, 2).gains(0.008, 0.02).metadata("unit", "N").write(folder.path(), "model.onnx");
    let other = Live::start(folder.path(), &params).stop();
    let refusal = "kept.yaml: was judged with another model tip than this one; calibrate again; until then no force";
    assert!(other.contains(refusal), "{other}");
}

#[test]
fn a_calibration_that_is_cancelled_leaves_the_zero_and_the_way_free() {
    check(&[], "", &["both", "60"], &["cancel"]);
}

#[test]
fn a_calibration_is_refused_when_the_hand_hardly_moved() {
    check(&[], "", &["both", "60", "100", "still"], &["calibrate", "2.5", "hardly moved"]);
}

#[test]
fn a_calibration_is_refused_when_it_looks_loaded() {
    check(&[], "", &["both", "60", "100", "loaded"], &["calibrate", "4.5", "looks loaded"]);
}

#[test]
fn node_topics_and_services_go_by_the_names_that_remaps_give() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", "");
    let params = std::fs::read_to_string(folder.path().join(PARAMS)).unwrap(); // without overrides of topics by name
    std::fs::write(folder.path().join("live.yaml"), params.replace("topic: /taxels", "topic: taxels")).unwrap();
    let remaps = "--ros-args --params-file live.yaml -p contact.on_frames:=3 -r __ns:=/left -r __node:=fusion \
                  -r taxels:=/glove/raw -r ~/index/wrench:=/index/force -r rosservice://~/tare:=/zero";
    let live = Live::start(folder.path(), &remaps.split_whitespace().collect::<Vec<_>>());
    run(&python, &["renamed"], folder.path());
    live.stop();
}

#[test]
fn sigterm_takes_the_node_out_of_the_graph_at_once() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", "");
    let live = Live::start(folder.path(), &["--params-file", "live.yaml", "--calibration", "calibration.yaml"]);
    run(&python, &["leaves", &live.pid().to_string()], folder.path());
    live.stop_quietly();
}

/// Ends by itself, before it joins a graph; what it said.
fn refused(args: &[&str]) -> String {
    assert_eq!(std::env::var("TPF_ISOLATED").as_deref(), Ok("1"), "a node must not reach the network");
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", "");
    // Under the node's own name; what is under `/**` may be another node's.
    let own = "/tactile_pose_fusion:
  ros__parameters:
    qos_overrides./taxels.subscription.depth: 10
";
    std::fs::write(folder.path().join("own.yaml"), own).unwrap();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_tactile_pose_fusion_node"))
        .current_dir(folder.path())
        .args(args)
        .env("AMENT_PREFIX_PATH", common::skip::ros_venv())
        .output()
        .unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    text.lines().last().unwrap_or_default().to_owned()
}

#[test]
fn what_can_not_run_is_refused_in_one_line() {
    if common::skip::ros_python().is_none() {
        return;
    }
    for (args, said) in [
        (&["--ros-args"][..], "no parameters: give --ros-args --params-file FILE"),
        (&["--ros-args", "--params-file", "none.yaml"], "none.yaml: can't be read"),
        (
            &["--params-file", "live.yaml", "-p", "tactile.glove.type:=glove_msgs/msg/Raw"],
            "no glove_msgs/msg/Raw.msg in ",
        ),
        (&["--params-file", "live.yaml", "-p", "tactile.glove.field:=rangez"], "topic /taxels: values: "),
        (&["--params-file", "live.yaml", "-p", "model.tip.path:=none.onnx"], "none.onnx"),
        (&["--params-file", "live.yaml", "--calibration", "none.yaml"], "none.yaml: cannot read the calibration"),
        (
            &["--params-file", "live.yaml", "--ros-args", "-r", "/taxels:=/raw", "--params-file", "own.yaml"],
            "is for nothing that this node has",
        ),
        (&["--params-file", "live.yaml", "--ros-args", "-r", "__ns:=left"], "a namespace is absolute"),
    ] {
        let text = refused(args);
        assert!(text.starts_with("tactile_pose_fusion_node: ") && text.contains(said), "{args:?}: {text}");
    }
}
