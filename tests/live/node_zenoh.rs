//! The node on Zenoh, between peers that speak it as rmw_zenoh's design document says.
//!
//! rmw_zenoh_cpp itself can't be had from PyPI: the peer is Zenoh's own Python binding, with the CDR of rclpy. Every test
//! here opens Zenoh sessions, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use common::bags::write_session;
use common::skip;
use common::tpf::Run;
use node_common::estimates::{assert_equals_replay, replay};
use node_common::{Live, peer_command, said, write_setup};

const ON_ZENOH: [(&str, &str); 1] = [("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")];
const CALIBRATED: [&str; 4] = ["--params-file", "live.yaml", "--calibration", "calibration.yaml"];

/// What a peer is run by.
struct Peers {
    python: PathBuf,
    packages: PathBuf,
    folder: tempfile::TempDir,
}

impl Peers {
    /// In a folder with a session, and parameters whose taxels come as `taxel_type`.
    fn new(seconds: i64, taxel_type: &str, extra: &str) -> Option<Peers> {
        let (python, packages) = (skip::ros_python()?, skip::zenoh_packages()?);
        let folder = tempfile::tempdir().unwrap();
        write_session(&folder.path().join("session.mcap"), seconds);
        write_setup(folder.path(), taxel_type, extra);
        Some(Peers { python, packages, folder })
    }

    fn folder(&self) -> &Path {
        self.folder.path()
    }

    fn node(&self, args: &[&str]) -> Live {
        Live::start_with(self.folder(), args, &ON_ZENOH)
    }

    fn command(&self, check: &[&str]) -> Command {
        let mut command = peer_command(&self.python, "zenoh_peer.py", check, self.folder());
        command.env("PYTHONPATH", &self.packages);
        command
    }

    fn check(&self, check: &[&str]) {
        assert_eq!(said(self.command(check), self.folder()), "ok");
    }
}

#[test]
fn a_zenoh_peer_receives_what_replay_of_the_same_data_writes() {
    let Some(peers) = Peers::new(12, "sensor_msgs/msg/LaserScan", "") else { return };
    replay(peers.folder(), "session.mcap", "replayed.mcap");
    let live = peers.node(&CALIBRATED);
    let text = said(peers.command(&["session", "session.mcap", "4", "/taxels", "/joints"]), peers.folder());
    live.stop();
    let got = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"));
    assert_equals_replay(&got, &peers.folder().join("replayed.mcap"));
}

#[test]
fn a_bag_played_on_zenoh_reaches_the_node() {
    let Some(peers) = Peers::new(8, "tactile_pose_fusion/msg/TaxelArray", "") else { return };
    replay(peers.folder(), "session.mcap", "replayed.mcap");
    let live = peers.node(&CALIBRATED);
    let mut command = peers.command(&["session", "session.mcap", "4", "/taxels", "/joints", "tpf"]);
    let mut peer = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(peer.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "ready");
    let mut play = Command::new(env!("CARGO_BIN_EXE_tpf"));
    let args = ["play", "session.mcap", "--rate", "4", "--delay", "5"];
    let played = play.current_dir(peers.folder()).args(args).envs(ON_ZENOH).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&played.stdout), "1600 messages on 2 topics\n");
    peer.stdin.take().unwrap().write_all(b"\n").unwrap();
    let text = lines.last().unwrap().unwrap();
    assert!(peer.wait().unwrap().success());
    live.stop();
    let got = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"));
    assert_equals_replay(&got, &peers.folder().join("replayed.mcap"));
}

#[test]
fn the_graph_holds_every_entity_with_the_hash_that_ros_2_has_for_its_type() {
    let Some(peers) = Peers::new(4, "sensor_msgs/msg/LaserScan", "    use_sim_time: true\n") else { return };
    let live = peers.node(&CALIBRATED);
    peers.check(&["graph"]);
    live.stop();
}

#[test]
fn parameters_tare_and_rosout_answer_on_zenoh() {
    let Some(peers) = Peers::new(4, "sensor_msgs/msg/LaserScan", "") else { return };
    let live = peers.node(&["--params-file", "live.yaml"]);
    peers.check(&["services"]);
    live.stop();
}

#[test]
fn calibrate_gives_feedback_and_a_result_on_zenoh() {
    let Some(peers) = Peers::new(4, "sensor_msgs/msg/LaserScan", "    calibration.file: kept.yaml\n") else { return };
    let live = peers.node(&["--params-file", "live.yaml"]);
    peers.check(&["calibrate"]);
    live.stop();
    assert!(peers.folder().join("kept.yaml").exists());
}

#[test]
fn sigterm_takes_the_node_out_of_the_graph_of_zenoh_at_once() {
    let Some(peers) = Peers::new(4, "sensor_msgs/msg/LaserScan", "") else { return };
    let live = peers.node(&CALIBRATED);
    peers.check(&["leaves", &live.pid().to_string()]);
    live.stop_quietly();
}

/// The node stands in for the router of its host, so nobody else is needed.
#[test]
fn tpf_call_and_doctor_reach_a_node_on_zenoh() {
    if !skip::isolated() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 4);
    write_setup(folder.path(), "tactile_pose_fusion/msg/TaxelArray", "");
    let listens = ("ZENOH_CONFIG_OVERRIDE", "listen/endpoints=[\"tcp/localhost:7447\"]");
    let live = Live::start_with(folder.path(), &CALIBRATED, &[ON_ZENOH[0], listens]);
    let tpf = |args: &[&str]| -> Run {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(folder.path()).args(args).envs(ON_ZENOH).output().unwrap().into()
    };
    assert_eq!(tpf(&["call", "state"]).ok().stdout, "active\n");
    assert_eq!(tpf(&["call", "deactivate"]).ok().stdout, "inactive\n");
    let refused = tpf(&["call", "deactivate"]);
    assert!(refused.failure().contains("is not possible in state inactive"), "{refused:?}");
    assert!(tpf(&["call", "load", "calibration.yaml"]).ok().stdout.starts_with("in use: "));
    let set = tpf(&["call", "parameters", "contact.on_frames", "5"]).ok().stdout;
    assert_eq!(set, "contact.on_frames: 5  # can be set now\n");
    let refused = tpf(&["call", "calibrate", "--seconds", "1"]);
    assert!(refused.failure().contains("no angle of its joints came"), "nobody publishes: {refused:?}");
    let absent = tpf(&["call", "state", "--node", "/left/tactile_pose_fusion", "--wait", "1"]);
    assert!(absent.failure().ends_with("there is /tactile_pose_fusion; name it with --node"), "{absent:?}");
    let found = tpf(&["doctor", "--seconds", "2", "--json"]).json();
    assert_eq!(found["nodes"], serde_json::json!(["/tactile_pose_fusion"]), "{found:#}");
    let topics = found["topics"].as_array().unwrap();
    let contacts = topics.iter().find(|topic| topic["name"] == "/tactile_pose_fusion/contacts").unwrap();
    assert_eq!(contacts["types"][0], "tactile_pose_fusion/msg/ContactArray");
    live.stop();
}
