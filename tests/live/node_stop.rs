//! A node that is stopped and goes on, is told to end, or loses a thread: it lives, it leaves in time, or it says why not.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use node_common::scene::Scene;
use node_common::{Feeder, Live, memory_mb, peer, peer_command, signal, stop_for};
use tactile_pose_fusion::bag::BagReader;
use tactile_pose_fusion::config::NodeName;
use tactile_pose_fusion::msg::{TaxelArray, WireType, from_cdr};
use tactile_pose_fusion::ros::environment::Environment;
use tactile_pose_fusion::ros::security::Enclave;
use tactile_pose_fusion::ros::{Delivery, Listening, TopicType};
use tactile_pose_fusion::units::Stamp;

/// Within which contacts go on.
const GO_ON: Duration = Duration::from_secs(2);

impl Scene {
    /// Holds that estimates of now come within two seconds.
    fn goes_on(&self, what: &str) {
        let since = Instant::now();
        let fresh = self.listener.wait_for(what, |heard| heard.flags == 0 && heard.at > since && heard.age_s < 1.0);
        assert!(fresh.at - since < GO_ON, "{what}: went on after {:?}", fresh.at - since);
    }

    fn attach(&self, times: &str) {
        let args = ["hold", &self.live.pid().to_string(), times];
        let n_threads = peer(&self.python, "attach.py", &args, self.path());
        assert!(n_threads.parse::<u32>().unwrap() > 3, "{n_threads} threads");
    }
}

#[test]
fn contacts_go_on_after_a_stop_of_any_length() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "90"]);
    scene.wait_for_estimates();
    for pause_ms in [50, 50, 50, 1000, 10_000, 50] {
        stop_for(scene.live.pid(), Duration::from_millis(pause_ms));
        scene.goes_on(&format!("estimates after a stop of {pause_ms} ms"));
    }
    scene.live.stop();
}

/// Peers have forgotten the node by then, and it would be alive and unheard.
#[test]
fn after_a_stop_near_the_lease_the_node_leaves_with_an_error() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    stop_for(scene.live.pid(), Duration::from_secs(42));
    let (status, text) = scene.live.end();
    assert_eq!(status.code(), Some(1), "{text}");
    assert!(text.lines().last().unwrap_or_default().contains("its peers have forgotten it after 50 s"), "{text}");
}

#[test]
fn contacts_go_on_after_stops_and_debuggers_at_1_khz() {
    // By the model's clock: a frame for each sample would be at the wrong rate, and flagged so.
    let Some(scene) = Scene::set_with("", &["-p", "tactile.glove.frame_clock:=grid"]) else { return };
    let _feeder = scene.feed(&["both", "60", "1000"]);
    scene.wait_for_estimates();
    for pause_ms in [50, 1000, 50] {
        stop_for(scene.live.pid(), Duration::from_millis(pause_ms));
        scene.goes_on(&format!("estimates after a stop of {pause_ms} ms"));
    }
    scene.attach("5");
    scene.goes_on("estimates after a debugger");
    scene.live.stop();
}

#[test]
fn contacts_go_on_after_a_debugger_and_other_signals() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    scene.attach("10");
    scene.goes_on("estimates after a debugger");
    for name in ["TSTP", "TTIN", "TTOU"] {
        signal(scene.live.pid(), name);
        std::thread::sleep(Duration::from_millis(50));
        signal(scene.live.pid(), "CONT");
        scene.goes_on(&format!("estimates after SIG{name}"));
    }
    for name in ["WINCH", "PIPE", "CONT", "CHLD", "URG"] {
        signal(scene.live.pid(), name);
        scene.goes_on(&format!("estimates after SIG{name}"));
    }
    for _ in 0..50 {
        stop_for(scene.live.pid(), Duration::from_millis(10));
        std::thread::sleep(Duration::from_millis(190));
    }
    scene.goes_on("estimates after 50 stops");
    scene.live.stop();
}

#[test]
fn a_thread_that_ends_is_said_and_the_node_leaves_with_an_error() {
    if !cfg!(target_arch = "x86_64") {
        return common::skip::skipped("attach.py knows the registers of x86-64 only");
    }
    for (thread, part) in [("RustDDS Partici", "event loop"), ("RustDDS discove", "discovery")] {
        let Some(scene) = Scene::set("") else { return };
        let _feeder = scene.feed(&["both", "60"]);
        scene.wait_for_estimates();
        let args = ["break", &scene.live.pid().to_string(), thread];
        assert_eq!(peer(&scene.python, "attach.py", &args, scene.path()), "ok");
        let (status, text) = scene.live.end(); // a second to be noticed, and one to leave
        assert_eq!(status.code(), Some(1), "{thread}: {text}");
        let said = format!("the part of this process called {part:?} has ended, so the process ends too");
        assert!(text.lines().last().unwrap_or_default().contains(&said), "{thread}: {text}");
    }
}

#[test]
fn requests_of_any_size_keep_nobody_waiting() {
    let Some(scene) = Scene::set_with("", &["--record", "run.mcap"]) else { return };
    let _feeder = scene.feed(&["both", "90"]);
    scene.wait_for_estimates();
    let slowest: f64 = peer(&scene.python, "disturb.py", &["requests"], scene.path()).parse().unwrap();
    // Most of it is the client, which makes and reads 60,000 messages in Python.
    assert!(slowest < 10.0, "{slowest} s");
    scene.goes_on("estimates after large requests");
    let mut busy = peer_command(&scene.python, "disturb.py", &["busy"], scene.path());
    let mut busy = busy.stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(busy.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "busy");
    scene.goes_on("estimates while it is busy with requests");
    signal(scene.live.pid(), "TERM");
    let text = scene.live.stop_quietly();
    busy.kill().unwrap();
    busy.wait().unwrap();
    assert!(text.contains("60000 entries in one request: expected at most 1000"), "{text}");
    assert!(text.contains("run.mcap: "), "{text}");
    let mut reader = BagReader::open(&[scene.folder.path().join("run.mcap")]).unwrap();
    let mut n_messages = 0;
    while reader.next_message().unwrap().is_some() {
        n_messages += 1;
    }
    assert!(reader.losses().is_empty() && n_messages > 500, "{n_messages}");
}

#[test]
fn a_flood_of_datagrams_does_not_keep_the_node_from_leaving() {
    let Some(scene) = Scene::set("") else { return };
    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    let before = memory_mb(scene.live.pid());
    let mut flood = peer_command(&scene.python, "disturb.py", &["flood", "8"], scene.path());
    let mut flood = flood.stdout(Stdio::null()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(4));
    let after = memory_mb(scene.live.pid());
    signal(scene.live.pid(), "TERM");
    scene.live.stop_quietly();
    flood.kill().unwrap();
    flood.wait().unwrap();
    assert!(after - before < 10.0, "{before} MB, then {after} MB");
}

#[test]
fn a_node_is_gone_in_time_at_any_moment_of_its_start() {
    let Some(scene) = Scene::set("") else { return };
    let calibrated = ["--params-file", "live.yaml", "--calibration", "calibration.yaml"];
    let folder = tempfile::tempdir().unwrap();
    for file in ["live.yaml", "calibration.yaml", "model.onnx"] {
        std::fs::copy(scene.path().join(file), folder.path().join(file)).unwrap();
    }
    for k in 0..12 {
        let live = Live::spawn(folder.path(), &calibrated, &[]);
        std::thread::sleep(Duration::from_millis(50 * k));
        signal(live.pid(), "TERM");
        let (status, text) = live.end();
        // Before it listens to signals there is nothing to leave.
        assert!(status.success() || status.signal() == Some(15), "{status} after {} ms: {text}", 50 * k);
        assert!(!text.contains("panicked"), "{text}");
    }
    // Stopped again and again while it starts, it starts; while it leaves, it leaves.
    let live = Live::spawn(folder.path(), &calibrated, &[]);
    while !live.log().contains("[INFO] active") {
        stop_for(live.pid(), Duration::from_millis(100));
        std::thread::sleep(Duration::from_millis(100));
    }
    signal(live.pid(), "TERM");
    for _ in 0..4 {
        stop_for(live.pid(), Duration::from_millis(100));
        std::thread::sleep(Duration::from_millis(20));
    }
    live.stop_quietly();
    scene.live.stop();
}

/// A pipe that takes nothing more, as a terminal that was told to wait.
fn full_pipe() -> (std::io::PipeReader, std::io::PipeWriter) {
    let (reader, mut writer) = std::io::pipe().unwrap();
    writer.write_all(&vec![b'x'; 65_536]).unwrap();
    (reader, writer)
}

#[test]
fn a_second_signal_ends_a_process_that_hangs_at_once_and_so_does_its_limit() {
    if common::skip::ros_python().is_none() {
        return;
    }
    // Under `nohup`, which children inherit, a hangup concerns nobody.
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap().trim().to_owned();
    let hangups_are_ignored = u64::from_str_radix(&ignored, 16).unwrap() & 1 == 1;
    for (name, again, code) in [("INT", true, 130), ("TERM", true, 143), ("TERM", false, 143), ("HUP", false, 129)] {
        if name == "HUP" && hangups_are_ignored {
            continue;
        }
        let (_reader, writer) = full_pipe();
        let mut glove = Command::new(env!("CARGO_BIN_EXE_tpf"));
        let args = ["simulate", "--live", "--glove", "1", "--seed", "7", "--ignore-prompts"];
        let mut glove = glove.args(args).stdout(writer).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(1500));
        let told = Instant::now();
        signal(glove.id(), name);
        std::thread::sleep(Duration::from_millis(1200)); // it has left the graph, and hangs at its last line
        assert!(glove.try_wait().unwrap().is_none());
        if again {
            signal(glove.id(), name);
        }
        let status = node_common::end(&mut glove, || format!("SIG{name}, again: {again}"));
        assert_eq!(status.code(), Some(code), "{status}");
        assert!(told.elapsed() < Duration::from_millis(if again { 1700 } else { 2500 }), "{:?}", told.elapsed());
    }
}

#[test]
fn a_terminal_that_hangs_takes_no_estimate_and_holds_nobody() {
    let Some(Scene { python, folder, live, listener }) = Scene::set("") else { return };
    live.stop();
    let (_reader, writer) = full_pipe();
    let mut quiet = Command::new(env!("CARGO_BIN_EXE_tpf"));
    quiet.args(["run", "--params-file", "live.yaml", "--calibration", "calibration.yaml"]).current_dir(folder.path());
    quiet.env("AMENT_PREFIX_PATH", common::skip::ros_venv()).stdout(Stdio::null()).stderr(writer);
    let mut quiet = quiet.spawn().unwrap();
    let _feeder = Feeder::start(&python, &["both", "60"], folder.path());
    listener.wait_for("an estimate of a node whose terminal hangs", |heard| heard.flags == 0 && !heard.force.is_nan());
    signal(quiet.id(), "TERM");
    assert!(node_common::end(&mut quiet, String::new).success());
}

/// Someone in this process who hears a topic.
fn ears(topic: &str, type_name: &str) -> tactile_pose_fusion::ros::Listener {
    let environment = Environment::from_vars(|_| None, &Enclave::default()).unwrap();
    let mut listening = Listening::join(&NodeName::parse("/ears").unwrap(), &environment, &[]).unwrap();
    listening.subscribe(topic, TopicType::Known(type_name), Delivery::Data).unwrap();
    listening.start().unwrap()
}

/// Age of what comes within a while, s, in the order of coming.
fn ages<M: WireType>(
    ears: &tactile_pose_fusion::ros::Listener,
    during: Duration,
    stamp: impl Fn(M) -> Stamp,
) -> Vec<f64> {
    let end = Instant::now() + during;
    let mut ages = Vec::new();
    while let Some(left) = end.checked_duration_since(Instant::now()) {
        let Some(heard) = ears.next(left) else { break };
        let message: M = from_cdr(&heard.cdr.unwrap()).unwrap();
        ages.push(heard.received.nanos_since(stamp(message)) as f64 * 1e-9);
    }
    ages
}

#[test]
fn the_tools_beside_the_node_go_on_too_and_end_when_their_time_is_over() {
    let Some(scene) = Scene::set("") else { return };
    let tpf = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(scene.path()).args(args).env("AMENT_PREFIX_PATH", common::skip::ros_venv());
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let said = |child: Child| {
        let output = child.wait_with_output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{text}");
        text
    };

    let ears = ears("/glove/taxels", TaxelArray::TYPE_NAME);
    let begun = Instant::now();
    let glove = tpf(&["simulate", "--live", "--glove=1", "--seed=7", "--minutes=0.4"]);
    let stamp = |message: TaxelArray| message.header.stamp.into();
    assert!(!ages(&ears, Duration::from_secs(3), stamp).is_empty());
    for pause_ms in [50, 1000, 3000] {
        stop_for(glove.id(), Duration::from_millis(pause_ms));
        let ages = ages(&ears, Duration::from_secs(2), stamp);
        assert!(ages.len() > 50, "{} messages after a stop of {pause_ms} ms", ages.len());
        // The one that was on its way when the process was stopped has the stamp of then.
        let n_old = ages.iter().filter(|age| **age >= 0.5).count();
        assert!(n_old <= 1, "{n_old} messages of half a second ago or more after a stop of {pause_ms} ms: {ages:?}");
    }
    let text = said(glove);
    let took = begun.elapsed();
    assert!(took > Duration::from_secs(23) && took < Duration::from_secs(27), "--minutes 0.4: {took:?}");
    assert!(text.contains("were not sent, because this process was stopped"), "{text}");
    ears.leave();

    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    let monitor = tpf(&["monitor", "--plain", "--seconds", "6"]);
    let calibrating = tpf(&["calibrate", "--live", "--params-file", "live.yaml", "--seconds", "5", "-o", "again.yaml"]);
    std::thread::sleep(Duration::from_millis(2500));
    for tool in [&monitor, &calibrating] {
        stop_for(tool.id(), Duration::from_millis(50));
    }
    let text = said(monitor);
    let rate: f64 = text.split(" Hz").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!(rate > 60.0, "{text}");
    let text = said(calibrating);
    let frames: u32 = text.split(" live frames").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!(frames > 400, "{text}");

    let played =
        ["play", "session.mcap", "--delay", "2", "--", "--ros-args", "-r", "/taxels:=/played", "-r", "/joints:=/other"];
    let ears = self::ears("/played", TaxelArray::TYPE_NAME);
    let playing = tpf(&played);
    std::thread::sleep(Duration::from_millis(3500));
    stop_for(playing.id(), Duration::from_millis(1000));
    let text = said(playing);
    assert_eq!(text.lines().next(), Some("800 messages on 2 topics"), "{text}");
    let mut heard = Vec::new();
    while let Some(message) = ears.next(Duration::from_millis(300)) {
        heard.push(message.received.0);
    }
    ears.leave();
    let steps: Vec<i64> = heard.windows(2).map(|pair| (pair[1] - pair[0]) / 1_000_000).collect();
    assert!(heard.len() > 380, "{} of 400", heard.len());
    assert!(steps.iter().filter(|ms| **ms > 700).count() == 1, "one pause: {steps:?}");
    let after = steps.iter().position(|ms| *ms > 700).unwrap();
    let in_a_burst = steps[after + 1..].iter().take(50).filter(|ms| **ms < 2).count();
    assert!(in_a_burst < 10, "{in_a_burst} of 50 messages came at once after the pause");
    scene.live.stop();
}
