//! A running node, and the peers that talk to it.
#![allow(dead_code, unreachable_pub)]

pub mod estimates;
pub mod scene;

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use tactile_pose_fusion::ros::system_now;

use crate::common::ROOT;
use crate::common::onnx::LinearModel;
use crate::common::skip;
use crate::common::tpf::tpf;

/// Parameters for replay of the test's own recording, as `write_setup` leaves them.
pub const PARAMS: &str = "replay.yaml";

/// Model, calibration, and parameters for replay (`replay.yaml`) and for the node (`live.yaml`), whose taxels come as
/// `taxel_type`. Needs `session.mcap` in the folder.
pub fn write_setup(folder: &Path, taxel_type: &str, extra: &str) {
    LinearModel::new(4, 2, 2).gains(0.004, 0.02).metadata("unit", "N").write(folder, "model.onnx");
    let field = if taxel_type.ends_with("LaserScan") { ", field: ranges" } else { "" };
    let params = |kind: &str, extra: &str| {
        format!(
            "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {{topic: /taxels, n_taxels: 2{kind}}}
    joint.hand: {{topic: /joints}}
    model.tip: {{path: model.onnx, backend: rten}}
    region.index: {{model: tip, joints: [pip, dip], frame_id: index_tip, normal: [0.0, 0.0, -1.0]}}
    calibration.max_force: 1.0
    timing.joint_slack_ms: 500.0
{extra}"
        )
    };
    let reliable = "    tactile_timeout_ms: 500.0
    qos_overrides:
      /taxels: {subscription: {reliability: reliable, depth: 1000}}
      /joints: {subscription: {reliability: reliable, depth: 1000}}
      /tactile_pose_fusion/index/wrench: {publisher: {reliability: reliable, depth: 1000}}
      /tactile_pose_fusion/contacts: {publisher: {reliability: reliable, depth: 1000}}
";
    std::fs::write(folder.join(PARAMS), params("", "")).unwrap();
    // What tests play was recorded long ago.
    let any_age = if extra.contains("max_age_ms") { "" } else { "    timing.max_age_ms: 0.0\n" };
    let live = params(&format!(", type: {taxel_type}{field}"), &format!("{reliable}{any_age}{extra}"));
    std::fs::write(folder.join("live.yaml"), live).unwrap();
    let args = ["--params-file", PARAMS, "--calibrate-first", "3", "-o", "calibration.yaml"];
    tpf(folder, &[&["calibrate", "session.mcap"], &args[..]].concat()).ok();
}

/// Leaves the definitions of a bag's types where a node finds them: as a driver's package installs them.
pub fn write_definitions(folder: &Path, bag: &str) {
    let mut reader = tactile_pose_fusion::bag::BagReader::open(&[folder.join(bag)]).unwrap();
    while reader.next_message().unwrap().is_some() {}
    for channel in reader.channels() {
        let schema = channel.schema.as_ref().unwrap();
        let text = String::from_utf8(schema.data.to_vec()).unwrap();
        let mut name = schema.name.clone();
        for part in text.split(&"=".repeat(80)) {
            let text = match part.trim_start().strip_prefix("MSG: ") {
                Some(named) => {
                    let (short, text) = named.split_once('\n').unwrap();
                    name = short.replacen('/', "/msg/", 1);
                    text
                }
                None => part,
            };
            let path = folder.join("definitions").join(format!("{name}.msg"));
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
    }
}

/// A node that runs until it is stopped, or dropped.
pub struct Live {
    child: Child,
    log: PathBuf,
}

impl Live {
    /// Starts `tpf run` and waits until it is active, or has said that it waits for a manager.
    pub fn start(folder: &Path, args: &[&str]) -> Live {
        Live::start_with(folder, args, &[])
    }

    /// As [`start`](Self::start), in an environment with these variables besides.
    pub fn start_with(folder: &Path, args: &[&str], vars: &[(&str, &str)]) -> Live {
        let live = Live::spawn(folder, args, vars);
        live.wait_for(&["[INFO] active", "waiting for a lifecycle manager"]);
        live
    }

    /// Starts `tpf run` in an environment with these variables besides.
    pub fn spawn(folder: &Path, args: &[&str], vars: &[(&str, &str)]) -> Live {
        assert_eq!(std::env::var("TPF_ISOLATED").as_deref(), Ok("1"), "a node must not reach the network");
        let log = folder.join(format!("node-{}.log", std::process::id()));
        let stderr = File::create(&log).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(folder).arg("run").args(args).stderr(stderr).stdout(Stdio::null());
        command.env("AMENT_PREFIX_PATH", skip::ros_venv()).envs(vars.iter().copied());
        Live { child: command.spawn().unwrap(), log }
    }

    /// What it has said so far.
    pub fn log(&self) -> String {
        self_log(&self.log)
    }

    /// Waits until it has said one of these.
    pub fn wait_for(&self, texts: &[&str]) {
        let deadline = Instant::now() + Duration::from_secs(20);
        while !texts.iter().any(|text| self.log().contains(text)) {
            assert!(Instant::now() < deadline, "never said {texts:?}: {}", self.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Asks it to end, by SIGINT; what it said. It must be gone within two seconds, and without failure.
    pub fn stop(self) -> String {
        signal(self.pid(), "INT");
        self.stop_quietly()
    }

    /// What it said, when it has been told to end already.
    pub fn stop_quietly(self) -> String {
        let (status, text) = self.end();
        assert!(status.success() && !text.contains("panicked"), "{status}: {text}");
        text
    }

    /// How it ended, which it does within two seconds, and what it said.
    pub fn end(mut self) -> (ExitStatus, String) {
        let status = end(&mut self.child, || self_log(&self.log));
        let text = self.log();
        (status, text)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn self_log(path: &Path) -> String {
    let mut text = String::new();
    File::open(path).unwrap().read_to_string(&mut text).unwrap();
    text
}

/// How a process ended, which it does within two seconds.
pub fn end(child: &mut Child, said: impl Fn() -> String) -> ExitStatus {
    let deadline = Instant::now() + Duration::from_secs(2);
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        assert!(Instant::now() < deadline, "still there: {}", said());
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Sends a signal to a process that a test started.
pub fn signal(pid: u32, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &pid.to_string()]).status().unwrap();
    assert!(sent.success());
}

/// Stops a process for a while, as Ctrl-Z and `fg` do.
pub fn stop_for(pid: u32, pause: Duration) {
    signal(pid, "STOP");
    std::thread::sleep(pause);
    signal(pid, "CONT");
}

/// A peer: a script of tests/ros with a real ROS 2.
pub fn peer_command(python: &Path, script: &str, args: &[&str], folder: &Path) -> Command {
    let mut command = Command::new(python);
    command.arg(Path::new(ROOT).join("tests/ros").join(script));
    command.args(args).current_dir(folder).env("AMENT_PREFIX_PATH", skip::ros_venv()).env("ROS_LOG_DIR", folder);
    command
}

/// Runs a peer to its end; what it printed.
pub fn peer(python: &Path, script: &str, args: &[&str], folder: &Path) -> String {
    said(peer_command(python, script, args, folder), folder)
}

/// Runs a peer to its end; the last line that it printed.
pub fn said(mut peer: Command, folder: &Path) -> String {
    let output = peer.output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    let log = std::fs::read_dir(folder).unwrap().filter_map(Result::ok).map(|entry| entry.path());
    let log = log.filter(|path| path.extension().is_some_and(|extension| extension == "log"));
    let said: String = log.filter_map(|path| std::fs::read_to_string(path).ok()).collect();
    assert!(output.status.success(), "{peer:?}: {stderr}\nnode: {said}");
    // Only the last line: the middleware may print of its own before it.
    let stdout = String::from_utf8(output.stdout).unwrap();
    stdout.lines().last().unwrap_or_default().to_owned()
}

/// A process that publishes taxels, joints or both until it is dropped: `feed.py`.
pub struct Feeder(Child);

impl Feeder {
    pub fn start(python: &Path, args: &[&str], folder: &Path) -> Feeder {
        Feeder(peer_command(python, "feed.py", args, folder).stdout(Stdio::null()).spawn().unwrap())
    }

    pub fn pid(&self) -> u32 {
        self.0.id()
    }
}

impl Drop for Feeder {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// One message of `~/contacts`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heard {
    pub flags: u32,
    pub force: f64,
    pub force_base: f64,
    pub stamp: i64,
    /// s; NaN where there is no frame.
    pub age: f64,
    pub at: Instant,
    /// Stamp to arrival, s.
    pub age_s: f64,
}

/// A process that listens to `~/contacts`: `listen.py`.
pub struct Listener {
    child: Child,
    heard: Receiver<Heard>,
}

impl Listener {
    pub fn start(python: &Path, folder: &Path) -> Listener {
        let mut child = peer_command(python, "listen.py", &["120"], folder).stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let (sender, heard) = channel();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let parts: Vec<&str> = line.split(' ').collect();
                let number = |idx: usize| parts[idx].parse::<f64>().unwrap();
                let (flags, stamp) = (parts[0].parse().unwrap(), parts[3].parse().unwrap());
                let (at, age_s) = (Instant::now(), (system_now().0 - stamp) as f64 * 1e-9);
                let (force, force_base, age) = (number(1), number(2), number(4));
                if sender.send(Heard { flags, force, force_base, stamp, age, at, age_s }).is_err() {
                    return;
                }
            }
        });
        Listener { child, heard }
    }

    /// The first message from now on that is as wanted.
    pub fn wait_for(&self, what: &str, wanted: impl Fn(&Heard) -> bool) -> Heard {
        let deadline = Instant::now() + Duration::from_secs(20);
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.heard.recv_timeout(left) {
                Ok(heard) if wanted(&heard) => return heard,
                Ok(_) => {}
                Err(_) => panic!("never heard: {what}"),
            }
        }
    }

    /// Everything that was heard by now and not asked for yet.
    pub fn drain(&self) -> Vec<Heard> {
        self.heard.try_iter().collect()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Resident memory of a process, MB.
pub fn memory_mb(pid: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
}
