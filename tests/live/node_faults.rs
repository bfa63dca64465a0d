//! What goes wrong around the node, and what it does then: no panic, no blocked input, no stale force.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use common::ROOT;
use node_common::scene::Scene;
use node_common::{Heard, memory_mb, peer, peer_command, signal};
use tactile_pose_fusion::config::NodeName;
use tactile_pose_fusion::msg::{ContactState, Text, WireType};
use tactile_pose_fusion::ros::environment::Environment;
use tactile_pose_fusion::ros::security::Enclave;
use tactile_pose_fusion::ros::{Delivery, Listening, TopicType};

const STALE_TACTILE: u32 = ContactState::STALE_TACTILE;
const STALE_POSE: u32 = ContactState::STALE_POSE;
const LATE: u32 = ContactState::LATE;

#[test]
fn tactile_data_that_stops_is_said_within_its_limit_and_recovers_when_it_comes_back() {
    let Some(scene) = Scene::set("") else { return };
    let feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    let stopped = Instant::now();
    drop(feeder); // killed, as a driver that crashes
    let stale = scene.listener.wait_for("STALE_TACTILE", |heard| heard.flags & STALE_TACTILE != 0);
    // 500 ms of silence, a tenth of that to notice, and what two busy cores take on top.
    assert!(stale.at - stopped < Duration::from_millis(1000), "{:?}", stale.at - stopped);
    assert!(stale.force.is_nan());
    let again = scene.listener.wait_for("STALE_TACTILE again", |heard| heard.flags & STALE_TACTILE != 0);
    assert!(again.at - stale.at > Duration::from_millis(300), "said once a timeout");
    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    assert!(scene.live.stop().contains("tactile source glove is back"));
}

#[test]
fn what_a_stalled_link_delivers_late_is_not_published_after_newer_and_a_delay_is_flagged() {
    let Some(scene) = Scene::set("    timing.max_age_ms: 100.0\n") else { return };
    let feeder = scene.feed(&["both", "60", "100", "loaded", "0", "6", "1"]);
    scene.wait_for_estimates();
    std::thread::sleep(Duration::from_secs(8)); // the stall, and what comes after it
    let heard = scene.listener.drain();
    let stale = heard.iter().find(|heard| heard.flags & STALE_TACTILE != 0).expect("silence is said");
    assert!(stale.age.is_nan());
    let again = heard.iter().any(|heard| heard.flags == 0 && heard.stamp > stale.stamp && heard.age < 0.1);
    assert!(again, "estimates come again");
    assert!(heard.windows(2).all(|pair| pair[0].stamp <= pair[1].stamp), "a stamp older than one before it");
    let aged = heard.iter().filter(|heard| heard.age.abs() > 0.1);
    assert!(aged.clone().all(|heard| heard.flags & LATE != 0), "{:?}", aged.collect::<Vec<_>>());
    drop(feeder);
    std::thread::sleep(Duration::from_millis(200));
    let since = scene.listener.drain(); // nothing, where all had come before
    let last = heard.iter().chain(&since).last().map_or(i64::MIN, |heard| heard.stamp);
    // A link that is two seconds behind, for ever: nothing is dropped, and every frame says so. A frame of the link before
    // may still wait for its joint angles; it comes first, and is late by as long as nothing came.
    let _behind = scene.feed(&["both", "60", "100", "moving", "-2"]);
    let of_this_link = |heard: &Heard| heard.stamp > last.saturating_add(50_000_000);
    let late =
        scene.listener.wait_for("LATE", |heard| heard.flags == LATE && !heard.force.is_nan() && of_this_link(heard));
    assert!((2.0..2.5).contains(&late.age), "{late:?}");
    let _ = scene.live.stop();
}

#[test]
fn a_node_that_is_too_late_to_publish_says_so() {
    let Some(scene) = Scene::set("    timing.max_age_ms: 0.01\n") else { return };
    let _feeder = scene.feed(&["both", "60"]);
    scene.live.wait_for(&["estimates of the last second were not published: "]);
    std::thread::sleep(Duration::from_secs(2)); // the problem lasts
    assert!(scene.listener.drain().iter().all(|heard| heard.force.is_nan()), "no estimate is that fast");
    let log = scene.live.stop();
    assert!(log.contains("waited in this node for longer than timing.max_age_ms"), "{log}");
}

#[test]
fn joint_angles_that_stop_leave_the_base_branch_and_recover() {
    let Some(scene) = Scene::set("") else { return };
    let _taxels = scene.feed(&["taxels", "60"]);
    let joints = scene.feed(&["joints", "60"]);
    scene.wait_for_estimates();
    drop(joints);
    let stale = scene.listener.wait_for("STALE_POSE", |heard| heard.flags & STALE_POSE != 0);
    assert!(!stale.force.is_nan() && stale.force == stale.force_base, "{stale:?}");
    let _joints = scene.feed(&["joints", "60"]);
    scene.wait_for_estimates();
    scene.live.stop();
}

#[test]
fn stamps_that_jump_start_the_window_anew() {
    let Some(scene) = Scene::set("") else { return };
    let now = scene.feed(&["both", "60"]);
    let before = scene.wait_for_estimates();
    drop(now);
    let _then = scene.feed(&["both", "60", "100", "moving", "-1000"]);
    let after = scene.listener.wait_for("an estimate of then", |heard| heard.flags == 0 && heard.stamp < before.stamp);
    assert!(!after.force.is_nan());
    scene.live.stop();
}

#[test]
fn another_type_on_the_topic_changes_nothing() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    scene.disturb(&["wrong_type"]);
    scene.listener.drain();
    scene.wait_for_estimates();
    scene.live.stop();
}

#[test]
fn malformed_messages_are_dropped_and_said_once() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    scene.disturb(&["malformed"]);
    scene.listener.drain();
    scene.wait_for_estimates();
    let log = scene.live.stop();
    let said = log.lines().filter(|line| line.contains("topic /taxels: ")).count();
    assert!((1..=3).contains(&said), "once a reason: {log}");
}

#[test]
fn a_frozen_reliable_subscriber_takes_no_frame_from_another() {
    let Some(scene) = Scene::set("") else { return };
    let mut frozen = peer_command(&scene.python, "disturb.py", &["frozen"], scene.path());
    let mut frozen = frozen.stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(frozen.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "ready");
    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    signal(frozen.id(), "STOP");
    scene.listener.drain();
    std::thread::sleep(Duration::from_secs(12)); // what is measured is this time
    let heard = scene.listener.drain();
    signal(frozen.id(), "KILL");
    frozen.wait().unwrap();
    let steps = heard.windows(2).map(|pair| pair[1].stamp - pair[0].stamp);
    let longest_ms = steps.max().unwrap() / 1_000_000;
    assert!(heard.len() > 1000, "{} frames of 1200", heard.len());
    // The feeder sleeps between frames, so a step is as long as it is late; a lost frame would show as twice that.
    assert!(longest_ms < 60, "{longest_ms} ms between frames");
    scene.live.stop();
}

#[test]
fn two_hundred_restarts_of_a_peer_leave_memory_flat() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "120"]);
    scene.wait_for_estimates();
    scene.disturb(&["restarts", "50"]);
    let before = memory_mb(scene.live.pid());
    scene.disturb(&["restarts", "150"]);
    let after = memory_mb(scene.live.pid());
    // 150 peers that were kept would each hold their endpoints and caches: some 100 kB each.
    assert!(after - before < 10.0, "{before} MB, then {after} MB");
    scene.listener.drain();
    scene.wait_for_estimates();
    scene.live.stop();
}

#[test]
fn who_joins_late_costs_nothing_for_what_was_published_before() {
    const N_BEFORE: usize = 300_000;
    const N_READERS: usize = 10;
    if !common::skip::isolated() {
        return;
    }
    let environment = Environment::from_vars(|_| None, &Enclave::default()).unwrap();
    let join = |name: &str| Listening::join(&NodeName::parse(name).unwrap(), &environment, &[]).unwrap();
    let text = TopicType::Known(Text::TYPE_NAME);
    let mut talker = join("/talker");
    let topic = talker.add_publisher("/long_lived", text, Delivery::Data).unwrap();
    let talker = talker.start().unwrap();
    let message = Text { data: "force".to_owned() };
    (0..N_BEFORE).for_each(|_| {
        talker.publish(topic, &message);
    });
    let before = memory_mb(std::process::id());
    let mut reader = join("/readers");
    (0..N_READERS).for_each(|_| {
        reader.subscribe("/long_lived", text, Delivery::Data).unwrap();
    });
    let reader = reader.start().unwrap();
    let mut heard = BTreeSet::new();
    let deadline = Instant::now() + Duration::from_secs(60);
    while heard.len() < N_READERS {
        assert!(Instant::now() < deadline, "{heard:?} of {N_READERS} readers heard something");
        talker.publish(topic, &message);
        heard.extend(reader.next(Duration::from_millis(20)).map(|heard| heard.topic));
    }
    let after = memory_mb(std::process::id());
    // A set of the numbers of all messages is some 4 MB a reader.
    assert!(after - before < 15.0, "{before} MB, then {after} MB with {N_READERS} readers");
    reader.leave();
    talker.leave();
}

#[test]
fn half_a_minute_among_peers_that_hang_and_die_loses_nothing_and_grows_nothing() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let binaries = Path::new(env!("CARGO_BIN_EXE_tpf")).parent().unwrap().to_str().unwrap();
    let model = &format!("{ROOT}/models/glove1_pose_aware.onnx");
    // The short form of `just soak`: frames at 100 Hz, because this is no release build and the machine is busy.
    let args = ["run", binaries, model, "--minutes", "0.5", "--clock", "grid", "--backend", "rten", "--reliable"];
    let output = peer_command(&python, "soak.py", &args, folder.path()).output().unwrap();
    let (said, failed) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}{failed}");
    assert!(said.contains("Steady: nothing grew, drifted or was lost."), "{said}");
}

#[test]
fn sigterm_under_load_ends_the_node_at_once() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "60", "1000"]);
    scene.wait_for_estimates();
    signal(scene.live.pid(), "TERM");
    scene.live.wait_for(&["leaving"]);
    scene.live.stop_quietly();
}

/// What malformed packets in the names of peers do, for twenty seconds: every kind that RTPS has, and discovery.
#[test]
fn a_flood_of_malformed_packets_costs_a_bounded_amount_and_contacts_go_on() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "120"]);
    scene.wait_for_estimates();
    let before = memory_mb(scene.live.pid());
    let said = peer(&scene.python, "rtps_flood.py", &["20"], scene.path());
    let ended = Instant::now();
    let sent: BTreeMap<String, u64> = serde_json::from_str(said.lines().last().unwrap()).unwrap();
    assert!(sent.len() >= 16 && sent.values().all(|n| *n > 500), "every kind, often: {sent:?}");
    let again =
        scene.listener.wait_for("an estimate", |heard| heard.flags == 0 && heard.at > ended && heard.age_s < 1.0);
    assert!(again.at - ended < Duration::from_secs(2), "went on after {:?}", again.at - ended);
    let after = memory_mb(scene.live.pid());
    assert!(after - before < 100.0, "{before} MB, then {after} MB");
    let log = scene.live.stop();
    assert!(!log.contains("panicked"), "{log}");
}

#[test]
fn a_dozen_ways_in_which_inputs_go_wrong_are_told_within_five_seconds() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let binaries = Path::new(env!("CARGO_BIN_EXE_tpf")).parent().unwrap().to_str().unwrap();
    // All of them, with a table: tests/ros/isolated python tests/ros/wrong_inputs.py run target/debug --out FILE.md
    let output =
        peer_command(&python, "wrong_inputs.py", &["run", binaries, "--short"], folder.path()).output().unwrap();
    let (said, failed) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}{failed}");
    assert!(said.contains("12 of 12 ways"), "{said}");
}
