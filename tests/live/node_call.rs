//! `tpf call` and a running node.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::path::Path;
use std::process::{Command, Stdio};

use common::bags::write_session;
use common::tpf::{Run, tpf};
use node_common::scene::Scene;
use node_common::{Feeder, Live, peer, signal, write_setup};

const PARAMS: [&str; 2] = ["--params-file", "live.yaml"];

/// A type that needs no ROS installation.
const TAXELS: &str = "tactile_pose_fusion/msg/TaxelArray";

fn call(folder: &Path, args: &[&str]) -> Run {
    tpf(folder, &[&["call"], args].concat())
}

/// A folder with a session, parameters of the node and a calibration.
fn folder(extra: &str) -> tempfile::TempDir {
    folder_of("sensor_msgs/msg/LaserScan", extra)
}

fn folder_of(taxel_type: &str, extra: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), taxel_type, extra);
    folder
}

#[test]
fn tpf_call_steers_the_lifecycle_and_tells_why_a_transition_is_refused() {
    if !common::skip::isolated() {
        return;
    }
    let folder = folder_of(TAXELS, "    autostart: false\n");
    let path = folder.path();
    let live = Live::start(path, &[&PARAMS[..], &["--calibration", "calibration.yaml"]].concat());
    for (what, state) in [
        ("state", "unconfigured\n"),
        ("configure", "inactive\n"),
        ("activate", "active\n"),
        ("deactivate", "inactive\n"),
        ("cleanup", "unconfigured\n"),
    ] {
        assert_eq!(call(path, &[what]).ok().stdout, state);
    }
    let refused = call(path, &["activate"]);
    let expected =
        "activate failed: transition \"activate\" is not possible in state unconfigured: expected configure, shutdown";
    assert_eq!(refused.failure(), expected);
    std::fs::rename(path.join("model.onnx"), path.join("gone.onnx")).unwrap();
    assert!(call(path, &["configure"]).failure().starts_with("configure failed: "));
    assert_eq!(call(path, &["state"]).ok().stdout, "unconfigured\n");
    assert_eq!(call(path, &["shutdown"]).ok().stdout, "finalized\n");
    live.stop();
}

#[test]
fn tpf_call_lists_gets_and_sets_parameters_and_gives_the_nodes_reason_for_a_refusal() {
    let Some(scene) = Scene::set("") else { return };
    let all = call(scene.path(), &["parameters"]).ok().stdout;
    assert!(all.lines().count() > 50 && all.contains("region.index.frame_id: \"index_tip\"\n"), "{all}");
    assert!(all.contains("contact.on_frames: 2  # can be set now\n"), "{all}");
    let one = call(scene.path(), &["parameters", "contact.on_frames"]).ok().stdout;
    assert!(one.starts_with("contact.on_frames: 2  # can be set now\n  ") && one.contains("1 to "), "{one}");
    let set = call(scene.path(), &["parameters", "contact.on_frames", "7"]).ok().stdout;
    assert_eq!(set, "contact.on_frames: 7  # can be set now\n");
    // An rclpy node sees the same.
    assert_eq!(peer(&scene.python, "interfaces.py", &["value", "contact.on_frames", "7"], scene.path()), "ok");
    for (args, reason) in [
        (["contact.on_frames", "-1"], "contact.on_frames = -1"),
        (["timing.max_gap_ms", "3.0"], "timing.max_gap_ms is read at start; change the parameter file"),
        (["contact.on_framez", "3"], "contact.on_framez is not a parameter of this node"),
    ] {
        let run = call(scene.path(), &[&["parameters"], &args[..]].concat());
        assert!(run.failure().contains(reason), "{run:?}");
    }
    let unknown = call(scene.path(), &["parameters", "force"]);
    let expected = "\"force\" is not a parameter of node /tactile_pose_fusion; list them with `tpf call parameters`";
    assert_eq!(unknown.failure(), expected);
    scene.live.stop();
}

#[test]
fn tpf_call_takes_a_zero_that_the_node_uses_and_keeps() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = folder("    calibration.file: kept.yaml\n");
    let path = folder.path();
    let live = Live::start(path, &PARAMS);
    let feeder = Feeder::start(&python, &["both", "60"], path);
    peer(&python, "interfaces.py", &["fed"], path);
    let tared = call(path, &["tare"]).ok().stdout;
    assert!(tared.starts_with("tared live from "), "{tared}");
    let calibrated = call(path, &["calibrate", "--seconds", "2.5"]).ok();
    assert!(calibrated.stdout.starts_with("calibrated live from ") && calibrated.stdout.contains("kept in "));
    assert!(path.join("kept.yaml").exists());
    drop(feeder);
    let silent = call(path, &["tare"]);
    assert!(silent.failure().contains("glove"), "{silent:?}");
    live.stop();
}

#[test]
fn a_calibration_that_the_node_refuses_fails_with_its_reason() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = folder("");
    let live = Live::start(folder.path(), &PARAMS);
    let _feeder = Feeder::start(&python, &["both", "60", "100", "still"], folder.path());
    peer(&python, "interfaces.py", &["fed"], folder.path());
    let run = call(folder.path(), &["calibrate", "--seconds", "2.5"]);
    assert!(run.failure().contains("hardly moved"), "{run:?}");
    live.stop();
}

#[test]
fn an_interrupt_cancels_the_calibration_and_leaves_the_way_free() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = folder("");
    let path = folder.path();
    let live = Live::start(path, &[&PARAMS[..], &["--calibration", "calibration.yaml"]].concat());
    let _feeder = Feeder::start(&python, &["both", "60"], path);
    peer(&python, "interfaces.py", &["fed"], path);
    let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
    command.current_dir(path).args(["call", "calibrate", "--seconds", "60"]);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // A file is loaded at once unless a calibration is under way.
    let busy = (0..20).any(|_| call(path, &["load", "calibration.yaml"]).stderr.contains("a calibration is under way"));
    assert!(busy, "the calibration never began: {}", live.log());
    signal(child.id(), "INT");
    let run: Run = child.wait_with_output().unwrap().into();
    assert_eq!(run.failure(), "interrupted", "{run:?}");
    live.wait_for(&["cancelled; the baseline is what it was"]);
    call(path, &["tare"]).ok();
    live.stop();
}

#[test]
fn a_node_that_is_not_there_is_told_with_those_that_are() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = folder("");
    let path = folder.path();
    let run = call(path, &["tare", "--wait", "1"]);
    let nobody = "no node /tactile_pose_fusion answers within 1 s: there is none of this package in domain 0; start it";
    assert!(run.failure().starts_with(nobody), "{run:?}");
    let _feeder = Feeder::start(&python, &["both", "60"], path);
    let live = Live::start(path, &["--ros-args", "--params-file", "live.yaml", "-r", "__ns:=/left"]);
    let run = call(path, &["state", "--wait", "1"]);
    assert!(run.failure().ends_with("there is /left/tactile_pose_fusion; name it with --node"), "{run:?}");
    let run = tpf(path, &["monitor", "--seconds", "2"]);
    let expected = "no node /tactile_pose_fusion is there: there is /left/tactile_pose_fusion; name it with --node";
    assert!(run.failure().ends_with(expected), "{run:?}");
    let run = call(path, &["state", "--node", "/feeder_both", "--wait", "4"]);
    assert!(run.failure().starts_with("node /feeder_both is there, but is no node of this package"), "{run:?}");
    assert_eq!(call(path, &["state", "--node", "/left/tactile_pose_fusion"]).ok().stdout, "active\n");
    live.stop();
}

#[test]
fn two_nodes_of_one_name_are_not_called() {
    if !common::skip::isolated() {
        return;
    }
    let folders = [(); 2].map(|()| folder_of(TAXELS, "    autostart: false\n"));
    let live = folders.each_ref().map(|folder| Live::start(folder.path(), &PARAMS));
    let run = call(folders[0].path(), &["configure"]);
    assert!(run.failure().starts_with("2 nodes are called /tactile_pose_fusion, so a call would reach all"), "{run:?}");
    live.into_iter().for_each(|live| drop(live.stop()));
}

#[test]
fn a_calibration_file_is_put_into_use_while_the_node_runs() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = folder("    calibration.file: zeros/first.yaml\n    user: ada\n");
    let path = folder.path();
    std::fs::create_dir(path.join("zeros")).unwrap();
    let text = std::fs::read_to_string(path.join("calibration.yaml")).unwrap();
    let zeros = path.join("zeros");
    std::fs::write(zeros.join("second.yaml"), &text).unwrap();
    std::fs::write(zeros.join("bob.yaml"), with_user(&text, "bob")).unwrap();
    let hash = text.lines().find_map(|line| line.trim().strip_prefix("tip: ")).unwrap().to_owned();
    std::fs::write(zeros.join("model.yaml"), text.replace(&hash, &"0".repeat(64))).unwrap();
    std::fs::write(zeros.join("empty.yaml"), "").unwrap();
    let live = Live::start(path, &PARAMS);
    let listener = node_common::Listener::start(&python, path);
    let _feeder = Feeder::start(&python, &["both", "90"], path);
    let uncalibrated = listener.wait_for("contacts", |_| true);
    assert!(uncalibrated.force.is_nan(), "{uncalibrated:?}");
    for (file, reason) in [
        ("zeros/bob.yaml", "made for user \"bob\", the parameters say \"ada\"; calibrate again, or correct `user`"),
        ("zeros/model.yaml", "was judged with another model tip than this one; calibrate again"),
        ("zeros/empty.yaml", "not a calibration file"),
        ("zeros/nowhere.yaml", "this node takes calibrations only from the folder"),
        ("calibration.yaml", "this node takes calibrations only from the folder"),
        ("/etc/hostname", "this node takes calibrations only from the folder"),
    ] {
        let run = call(path, &["load", file]);
        assert!(run.failure().contains(reason), "{file}: {run:?}");
    }
    assert!(!live.log().contains("[INFO] calibration "), "{}", live.log());
    let loaded = call(path, &["load", "zeros/second.yaml"]).ok().stdout;
    assert!(loaded.starts_with("in use: ") && loaded.contains("second.yaml"), "{loaded}");
    listener.wait_for("an estimate", |heard| heard.flags == 0 && !heard.force.is_nan());
    assert!(live.log().contains("[INFO] calibration ") && live.log().contains("second.yaml"), "{}", live.log());
    let now = call(path, &["parameters", "calibration.file"]).ok().stdout;
    assert!(now.contains("second.yaml"), "{now}");
    // By its name in the folder, and by rclpy.
    call(path, &["load", "second.yaml"]).ok();
    peer(&python, "interfaces.py", &["text", "calibration.file", "second.yaml"], path);
    for what in ["deactivate", "cleanup"] {
        call(path, &[what]).ok();
    }
    let run = call(path, &["load", "zeros/second.yaml"]);
    assert!(run.failure().contains("the node is unconfigured; configure it first"), "{run:?}");
    call(path, &["configure"]).ok();
    let log = live.stop();
    assert_eq!(log.matches("[INFO] calibration ").count(), 4, "{log}");
}

/// A calibration of another user.
fn with_user(calibration: &str, user: &str) -> String {
    let line = |line: &str| if line.starts_with("user:") { format!("user: {user}\n") } else { format!("{line}\n") };
    calibration.lines().map(line).collect()
}

#[test]
fn a_node_that_was_started_without_a_calibration_loads_none() {
    if !common::skip::isolated() {
        return;
    }
    let folder = folder_of(TAXELS, "");
    let live = Live::start(folder.path(), &PARAMS);
    let run = call(folder.path(), &["load", "calibration.yaml"]);
    assert!(run.failure().ends_with("start it with calibration.file or --calibration"), "{run:?}");
    live.stop();
}
