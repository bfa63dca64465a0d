//! The tools beside the live node: `tpf play`, a bag as a live graph, and what the README does with all of them.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::ROOT;
use common::bags::{Bag, at, decoded, messages, write_session};
use common::layouts;
use common::sqlite::as_sqlite;
use common::tpf::{Run, tpf};
use node_common::{Listener, Live, PARAMS, peer_command, signal, write_setup};
use tactile_pose_fusion::msg::{ContactArray, Header};
use tactile_pose_fusion::units::Stamp;

const CALIBRATED: [&str; 2] = ["--calibration", "calibration.yaml"];

fn play(folder: &std::path::Path, args: &[&str]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
    command.current_dir(folder).arg("play").args(args).output().unwrap().into()
}

#[test]
fn a_played_db3_bag_gives_the_node_what_replay_reads_from_the_same_data_in_mcap() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 8);
    write_setup(folder.path(), "tactile_pose_fusion/msg/TaxelArray", "");
    let args = ["--params-file", PARAMS, "--batch", "1", "-o", "replayed.mcap"];
    tpf(folder.path(), &[&["replay", "session.mcap"], &args[..], &CALIBRATED].concat()).ok();
    let live = Live::start(folder.path(), &[&["--params-file", "live.yaml"], &CALIBRATED[..]].concat());
    let listener = Listener::start(&python, folder.path());
    std::thread::sleep(Duration::from_secs(2)); // the listener has no way to say that it was found
    as_sqlite(&folder.path().join("session.mcap"), &folder.path().join("session.db3"));
    let started = Instant::now();
    let run = play(folder.path(), &["session.db3", "--rate", "4", "--delay", "3"]).ok();
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

#[test]
fn one_topic_with_taxels_and_angles_gives_live_and_recorded_what_it_gives_in_replay() {
    if !common::skip::isolated() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_session(&path.join("session.mcap"), 8);
    let scan = "sensor_msgs/msg/LaserScan";
    write_setup(path, scan, "");
    let mut bag = Bag::create(&path.join("hand.mcap"));
    let hand = layouts::add::<layouts::LaserScan>(&mut bag, "/hand");
    for k in 0..800 {
        let header = Header { stamp: at(10 * k).into(), frame_id: String::new() };
        let load = if k % 200 < 100 { 0.0 } else { 90.0 };
        let (ranges, intensities) = (vec![10.0 + load, 5.0 + (k % 7) as f32], vec![0.001 * k as f32, 0.2]);
        layouts::send(
            &mut bag,
            hand,
            at(10 * k),
            &layouts::LaserScan { header, ranges, intensities, ..Default::default() },
        );
    }
    bag.finish();
    let live = std::fs::read_to_string(path.join("live.yaml")).unwrap();
    let live = live
        .replace("/taxels", "/hand")
        .replace("      /joints: {subscription: {reliability: reliable, depth: 1000}}\n", "");
    let joints = format!("{{topic: /hand, type: {scan}, field: intensities, names: [pip, dip]}}");
    std::fs::write(path.join("live.yaml"), live.replace("{topic: /joints}", &joints)).unwrap();
    let args = [&["--params-file", "live.yaml"], &CALIBRATED[..]].concat();
    let node = Live::start(path, &[&args[..], &["--record", "run.mcap"]].concat());
    std::thread::sleep(Duration::from_secs(1));
    play(path, &["hand.mcap", "--rate", "4", "--delay", "3"]).ok();
    std::thread::sleep(Duration::from_millis(300));
    node.stop();
    tpf(path, &[&["replay", "run.mcap", "-o", "again.mcap", "--batch", "1"], &args[..]].concat()).ok();
    tpf(path, &[&["replay", "hand.mcap", "-o", "replayed.mcap", "--batch", "1"], &args[..]].concat()).ok();
    let contacts = "/tactile_pose_fusion/contacts";
    let of = |file: &str| -> Vec<ContactArray> { decoded(&path.join(file), contacts) };
    let bytes = |file: &str| -> Vec<_> {
        let all = messages(&path.join(file)).into_iter().filter(|message| message.topic == contacts);
        all.map(|message| (message.log_time, message.data)).collect()
    };
    assert!(bytes("run.mcap") == bytes("again.mcap"), "the recorded run replays to the same bytes");
    let recorded = messages(&path.join("run.mcap")).into_iter().filter(|message| message.topic == "/hand").count();
    let (live, replayed) = (of("run.mcap"), of("replayed.mcap"));
    assert_eq!(recorded, live.len(), "a message is recorded once");
    assert!(live.len() + 2 >= replayed.len() && replayed.len() == 800, "{} of {}", live.len(), replayed.len());
    let late = replayed.len() - live.len();
    for (live, replayed) in live.iter().zip(&replayed[late..]) {
        assert_eq!(live.header.stamp, replayed.header.stamp);
    }
    let forces =
        |all: &[ContactArray]| -> Vec<u64> { all.iter().map(|array| array.contacts[0].force.to_bits()).collect() };
    assert!(forces(&live)[10..] == forces(&replayed[late..])[10..]);
}

/// The words behind `tpf` of the lines of a block of the README, without what stands behind two blanks and a hash.
fn lines_of(block: &str) -> Vec<Vec<String>> {
    let readme = include_str!("../../README.md");
    let fence = format!("```sh {block}\n");
    let blocks = readme.split(&fence).skip(1).map(|rest| rest.split("```").next().unwrap());
    let lines = blocks.flat_map(str::lines).map(|line| line.split("  #").next().unwrap().trim());
    lines.map(|line| line.strip_prefix("tpf ").unwrap().split(' ').map(str::to_owned).collect()).collect()
}

fn words(line: &[String]) -> Vec<&str> {
    line.iter().map(String::as_str).collect()
}

/// Where the README's commands run: a folder with what the repository has.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for shown in ["params", "models"] {
        let from = Path::new(ROOT).join(shown);
        std::os::unix::fs::symlink(from, folder.path().join(shown)).unwrap();
    }
    folder
}

/// `tpf` at work until it is dropped.
struct Running(Child);

impl Running {
    fn start(folder: &Path, args: &[&str]) -> Running {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.args(args).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::null());
        Running(command.spawn().unwrap())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        signal(self.0.id(), "KILL");
        let _ = self.0.wait();
    }
}

/// What a monitor of a node says after some seconds.
fn monitored(folder: &Path, node: &str) -> String {
    tpf(folder, &["monitor", "--plain", "--seconds", "4", "--node", node]).ok().stdout
}

#[test]
fn the_three_live_commands_of_the_readme_lead_to_forces() {
    if !common::skip::isolated() {
        return;
    }
    let folder = workplace();
    let simulate: Vec<&str> = "simulate --live --glove 1 --seed 7 --ignore-prompts --minutes 4".split(' ').collect();
    let _glove = Running::start(folder.path(), &simulate);
    let lines = lines_of("live");
    let [calibrate, run, monitor, ..] = lines.as_slice() else { panic!("{lines:?}") };
    assert_eq!((calibrate[0].as_str(), run[0].as_str(), monitor[0].as_str()), ("calibrate", "run", "monitor"));
    tpf(folder.path(), &words(calibrate)).ok();
    let live = Live::start(folder.path(), &words(&run[1..]));
    let said = monitored(folder.path(), "/tactile_pose_fusion");
    assert!(said.contains("index") && !said.contains("UNCALIBRATED"), "{said}");
    live.stop();
}

#[test]
fn the_robots_command_of_the_readme_hears_the_glove_of_its_namespace() {
    if !common::skip::isolated() {
        return;
    }
    let folder = workplace();
    let simulate = "simulate --live --glove 1 --seed 7 --ignore-prompts --minutes 4 -- --ros-args -r __ns:=/left";
    let _glove = Running::start(folder.path(), &simulate.split(' ').collect::<Vec<_>>());
    let lines = lines_of("robot");
    let live = Live::start(folder.path(), &words(&lines[0][1..]));
    let said = monitored(folder.path(), "/left/tactile_pose_fusion");
    // Not calibrated yet: it is the frames that came.
    assert!(said.contains("UNCALIBRATED"), "{said}");
    live.stop();
}

#[test]
fn a_live_calibration_of_wrong_inputs_ends_within_seconds_and_says_why() {
    if !common::skip::isolated() {
        return;
    }
    let folder = workplace();
    let simulate: Vec<&str> = "simulate --live --glove 1 --seed 7 --ignore-prompts --minutes 4".split(' ').collect();
    let _glove = Running::start(folder.path(), &simulate);
    let wrong = [
        ("joint.hand.scale:=57.3", "correct joint.hand.scale"),
        ("tactile.glove.stamp_offset_ms:=-2000.0", "s behind this node's clock"),
        ("joint.hand.topic:=/hand/joints", "nobody publishes /hand/joints"),
    ];
    for (param, words) in wrong {
        let began = Instant::now();
        let args = ["calibrate", "--live", "--params-file", "params/glove1.yaml", "-p", param, "--seconds", "60"];
        let refused = tpf(folder.path(), &[&args[..], &["-o", "zero.yaml"]].concat());
        assert!(refused.failure().contains(words), "{refused:?}");
        assert!(began.elapsed() < Duration::from_secs(15), "{param}: {:?}", began.elapsed());
        assert!(!folder.path().join("zero.yaml").exists());
    }
}
