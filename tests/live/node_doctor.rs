//! `tpf doctor` beside a real ROS 2.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::path::Path;
use std::process::Command;

use common::bags::write_session;
use common::skip;
use common::tpf::Run;
use node_common::{Feeder, Live, peer, write_setup};

const CALIBRATED: [&str; 4] = ["--params-file", "live.yaml", "--calibration", "calibration.yaml"];

fn doctor(folder: &Path, args: &[&str], vars: &[(&str, &str)]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
    command.current_dir(folder).arg("doctor").args(args);
    command.env("AMENT_PREFIX_PATH", skip::ros_venv()).envs(vars.iter().copied());
    command.output().unwrap().into()
}

fn folder(extra: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    // On a busy machine the feeder is uneven.
    let patient = format!("    diagnostics.max_jitter_ms: 1000.0\n    diagnostics.min_estimates: 0.3\n{extra}");
    write_setup(folder.path(), "sensor_msgs/msg/LaserScan", &patient);
    folder
}

/// The findings with a word and a part that begins so.
fn found<'f>(json: &'f serde_json::Value, level: &str, part: &str) -> Vec<&'f str> {
    let of = |finding: &&serde_json::Value| {
        finding["level"] == level && finding["part"].as_str().is_some_and(|text| text.starts_with(part))
    };
    json["findings"].as_array().unwrap().iter().filter(of).filter_map(|finding| finding["text"].as_str()).collect()
}

fn one<'f>(json: &'f serde_json::Value, level: &str, part: &str, words: &str) -> &'f str {
    let all = found(json, level, part);
    all.iter().find(|text| text.contains(words)).unwrap_or_else(|| panic!("{level} {part} {words}: {json:#}"))
}

#[test]
fn doctor_says_ok_of_what_a_fed_node_would_find() {
    let Some(python) = skip::ros_python() else { return };
    let folder = folder("");
    let _feeder = Feeder::start(&python, &["both", "60"], folder.path());
    let run = doctor(folder.path(), &[&CALIBRATED[..], &["--json"]].concat(), &[]);
    let json = run.ok().json();
    assert_eq!(found(&json, "problem", ""), Vec::<&str>::new(), "{json:#}");
    one(&json, "ok", "network", "lo (127.0.0.1): multicast works here: a datagram to 239.255.0.1 came back");
    one(&json, "ok", "clock", "no jump within");
    one(&json, "ok", "nodes", "/feeder_both");
    one(&json, "ok", "topics", "the types and QoS of all publishers and subscriptions match");
    let taxels = one(&json, "ok", "input tactile.glove", "/taxels as sensor_msgs/msg/LaserScan: ");
    assert!(taxels.contains(", 2 taxels, stamps "), "{taxels}");
    one(&json, "ok", "input joint.hand", "/joints as sensor_msgs/msg/JointState");
    one(&json, "ok", "joints", "all 2 joints that the regions need come");
    one(&json, "ok", "models", "calibration calibration.yaml");
    one(&json, "ok", "names", "/tactile_pose_fusion is free");
    one(&json, "ok", "estimates", "frames have a full estimate");
    let topics = json["topics"].as_array().unwrap();
    let taxels = topics.iter().find(|topic| topic["name"] == "/taxels").unwrap();
    assert_eq!(taxels["types"][0], "sensor_msgs/msg/LaserScan");
    assert_eq!(taxels["publishers"][0], "reliable, volatile");
    let text = doctor(folder.path(), &["--seconds", "1", "--topics"], &[]).ok().stdout;
    assert!(text.starts_with("0 problems, ") && text.contains("reliable, volatile"), "{text}");
}

#[test]
fn doctor_tells_what_a_node_would_lack_and_fails() {
    let Some(python) = skip::ros_python() else { return };
    let folder = folder("    use_sim_time: true\n");
    let text = std::fs::read_to_string(folder.path().join("live.yaml")).unwrap();
    let write = |file: &str, from: &str, to: &str| {
        assert!(text.contains(from), "{text}");
        std::fs::write(folder.path().join(file), text.replace(from, to)).unwrap();
    };
    write(
        "type.yaml",
        "type: sensor_msgs/msg/LaserScan, field: ranges",
        "type: sensor_msgs/msg/Imu, field: orientation_covariance",
    );
    write("topic.yaml", "topic: /joints", "topic: /hand/joints");
    write("many.yaml", "n_taxels: 2", "n_taxels: 3");
    write("joints.yaml", "joints: [pip, dip]", "joints: [pip, tip]");
    write("model.yaml", "path: model.onnx", "path: gone.onnx");
    let _feeder = Feeder::start(&python, &["both", "120"], folder.path());
    for (file, part, words) in [
        (
            "type.yaml",
            "input tactile.glove",
            "/taxels is published as sensor_msgs/msg/LaserScan, and this node reads sensor_msgs/msg/Imu",
        ),
        (
            "topic.yaml",
            "input joint.hand",
            "nobody publishes /hand/joints, but sensor_msgs/msg/JointState comes on /joints",
        ),
        ("many.yaml", "models", "taxels"),
        ("joints.yaml", "joints", "1 of 2 joints are missing: tip; dip, pip came"),
        ("model.yaml", "models", "gone.onnx"),
    ] {
        let run = doctor(folder.path(), &["--params-file", file, "--seconds", "3", "--json"], &[]);
        assert_eq!(run.code, 1, "{file}: {run:?}");
        let json = run.json();
        one(&json, "problem", part, words);
        one(&json, "problem", "clock", "use_sim_time is true and nobody publishes /clock");
    }
    // The feeder offers volatile, and the node would ask for more.
    write(
        "strict.yaml",
        "/taxels: {subscription: {reliability",
        "/taxels: {subscription: {durability: transient_local, reliability",
    );
    let json = doctor(folder.path(), &["--params-file", "strict.yaml", "--seconds", "3", "--json"], &[]).json();
    one(
        &json,
        "problem",
        "input tactile.glove",
        "/taxels is published, but as volatile, where transient_local is asked for",
    );
}

#[test]
fn doctor_shows_what_a_running_node_says_and_that_its_name_is_taken() {
    let Some(python) = skip::ros_python() else { return };
    let folder = folder("");
    let live = Live::start(folder.path(), &CALIBRATED);
    let json = doctor(folder.path(), &[&CALIBRATED[..], &["--json"]].concat(), &[]).json();
    one(&json, "problem", "input tactile.glove", "nobody publishes /taxels: start its driver");
    one(&json, "ok", "names", "/tactile_pose_fusion runs already; start no second one");
    assert!(!found(&json, "problem", "node /tactile_pose_fusion").is_empty(), "{json:#}");
    let _feeder = Feeder::start(&python, &["both", "60"], folder.path());
    assert_eq!(peer(&python, "interfaces.py", &["fed"], folder.path()), "ok");
    let other = doctor(folder.path(), &["--seconds", "6", "--json"], &[("CYCLONEDDS_URI", "file:///c.xml")]);
    let json = other.json();
    one(&json, "ok", "node /tactile_pose_fusion", "estimates: estimating: ");
    one(&json, "ok", "node /tactile_pose_fusion", "stamp to here p50");
    one(&json, "warning", "environment", "CYCLONEDDS_URI is set");
    live.stop();
}

#[test]
fn doctor_in_an_empty_graph_says_that_nobody_is_there() {
    if !skip::isolated() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let run = doctor(folder.path(), &["--seconds", "1", "--json"], &[("ROS_DOMAIN_ID", "77")]);
    let json = run.ok().json();
    one(&json, "warning", "nodes", "no other node is in domain 77");
    one(&json, "warning", "network", "there is no interface but loopback");
    let refused = doctor(folder.path(), &[], &[("ROS_DOMAIN_ID", "233")]);
    assert!(refused.failure().starts_with("ROS_DOMAIN_ID=233: expected a number from 0 to 232"), "{refused:?}");
}
