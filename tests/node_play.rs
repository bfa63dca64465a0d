//! `tpf play`: a bag as a live graph.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.
#![cfg(feature = "ros")]

mod common;
mod node_common;

use std::process::Command;
use std::time::{Duration, Instant};

use common::bags::{decoded, write_session};
use common::tpf::{Run, tpf};
use node_common::{Listener, Live, PARAMS, peer_command, write_setup};
use tactile_pose_fusion::msg::ContactArray;
use tactile_pose_fusion::units::Stamp;

const CALIBRATED: [&str; 2] = ["--calibration", "calibration.yaml"];

fn play(folder: &std::path::Path, args: &[&str]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
    command.current_dir(folder).args(["play", "session.mcap"]).args(args).output().unwrap().into()
}

#[test]
fn a_played_bag_gives_the_node_what_replay_reads_from_it() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 8);
    write_setup(folder.path(), "tactile_pose_fusion/msg/TaxelArray", "");
    let args = ["--params-file", PARAMS, "--batch", "1", "-o", "replayed.mcap"];
    tpf(folder.path(), &[&["replay", "session.mcap"], &args[..], &CALIBRATED].concat()).ok();
    let live = Live::start(folder.path(), &[&["--params-file", "live.yaml"], &CALIBRATED[..]].concat());
    let listener = Listener::start(&python, folder.path());
    std::thread::sleep(Duration::from_secs(2)); // the listener has no way to say that it was found
    let started = Instant::now();
    let run = play(folder.path(), &["--rate", "4", "--delay", "3"]).ok();
    let took = started.elapsed();
    assert_eq!(run.stdout, "1600 messages on 2 topics\n");
    assert!(
        took > Duration::from_secs(5) && took < Duration::from_secs(9),
        "3 s, and 8 s at 4 times the speed: {took:?}"
    );
    std::thread::sleep(Duration::from_millis(300));
    let heard: Vec<_> = listener.drain().into_iter().filter(|heard| heard.flags != 8).collect();
    let expected: Vec<ContactArray> = decoded(&folder.path().join("replayed.mcap"), "/tactile_pose_fusion/contacts");
    assert!(heard.len() + 2 >= expected.len(), "{} of {}", heard.len(), expected.len());
    for (heard, expected) in heard.iter().zip(&expected) {
        let state = &expected.contacts[0];
        assert_eq!((heard.stamp, heard.flags), (Stamp::from(expected.header.stamp).0, state.flags));
        assert!(heard.force == state.force || (heard.force.is_nan() && state.force.is_nan()));
    }
    live.stop();
}

#[test]
fn the_time_of_the_recording_is_on_clock_and_the_bag_begins_again() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 1);
    let mut playing = Command::new(env!("CARGO_BIN_EXE_tpf"));
    let args = ["play", "session.mcap", "--loop", "--clock", "50", "--", "--ros-args", "-r", "/taxels:=/glove/taxels"];
    let mut playing = playing.current_dir(folder.path()).args(args).spawn().unwrap();
    let output = peer_command(&python, "hear_clock.py", &[], folder.path()).output().unwrap();
    node_common::signal(playing.id(), "INT");
    let status = playing.wait().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(status.success());
}
