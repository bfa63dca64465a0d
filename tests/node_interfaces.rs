//! Names, parameters, lifecycle, diagnostics, tare and calibration of the node as rclpy meets them.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.
#![cfg(feature = "ros")]

mod common;
mod node_common;

use std::path::Path;

use common::bags::write_session;
use node_common::{Feeder, Live, peer, write_setup};

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
fn under_sim_time_stamps_are_those_of_clock() {
    check(&CALIBRATED, "    use_sim_time: true\n", &["both", "60"], &["sim_time"]);
}

#[test]
fn calibrate_gives_feedback_and_keeps_what_it_found() {
    check(&[], "    calibration.file: kept.yaml\n", &["both", "60"], &["calibrate"]);
}

#[test]
fn a_calibration_is_refused_when_the_hand_hardly_moved() {
    check(&[], "", &["both", "60", "100", "still"], &["calibrate", "2.5", "hardly moved"]);
}

#[test]
fn a_calibration_is_refused_when_it_looks_loaded() {
    check(&[], "", &["both", "60", "100", "loaded"], &["calibrate", "4.5", "looks loaded"]);
}
