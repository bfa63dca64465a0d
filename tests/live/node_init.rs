//! `tpf init --live`: from the topics of a live graph to a parameter file with which the node runs.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use common::ROOT;
use common::tpf::tpf;
use node_common::{Live, peer_command, signal};
use tactile_pose_fusion::config::{self, Config, DEFAULT_NODE};

/// A process that publishes until it is dropped.
struct Publishing(Child);

impl Drop for Publishing {
    fn drop(&mut self) {
        signal(self.0.id(), "KILL");
        let _ = self.0.wait();
    }
}

fn start(mut command: Command) -> Publishing {
    Publishing(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
}

fn made(folder: &Path) -> (Config, String) {
    let path = folder.join("made.yaml");
    (config::load(&path, DEFAULT_NODE).unwrap(), fs::read_to_string(&path).unwrap())
}

#[test]
fn init_looks_at_a_live_glove_and_the_node_gives_forces_with_its_file() {
    if !common::skip::isolated() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut glove = Command::new(env!("CARGO_BIN_EXE_tpf"));
    let args = "simulate --live --glove 1 --seed 7 --ignore-prompts --minutes 4";
    glove.args(args.split(' ')).current_dir(folder);
    let _glove = start(glove);
    let model = Path::new(ROOT).join("models/glove1_pose_aware.onnx");
    let init = ["init", "--live", "--seconds", "12", "--yes", "-o", "made.yaml", "--model", model.to_str().unwrap()];
    let run = tpf(folder, &init).ok();
    assert!(run.stdout.contains("next: tpf calibrate --live --params-file made.yaml"), "{run:?}");
    let (cfg, text) = made(folder);
    assert_eq!(
        (cfg.tactile()[0].name.as_str(), cfg.joints()[0].name.as_str()),
        ("/glove/taxels", "/hand/joint_states")
    );
    assert!(text.contains("# /glove/taxels: tactile_pose_fusion/msg/TaxelArray, "), "{text}");
    assert!(text.contains(" Hz, offered ") && text.contains("a live graph, for 12 s"), "{text}");
    let refused = tpf(folder, &init);
    assert!(refused.failure().contains("made.yaml is there already"), "{refused:?}");
    let live = Live::start(folder, &["--params-file", "made.yaml"]);
    let said = tpf(folder, &["monitor", "--plain", "--seconds", "4"]).ok().stdout;
    assert!(said.contains("| index") && !said.contains("SILENT"), "{said}");
    live.stop();
}

#[test]
fn init_looks_at_a_strangers_drivers() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let _glove = start(peer_command(&python, "strangers_glove.py", &["60"], folder));
    let run = tpf(folder, &["init", "--live", "--seconds", "11", "--yes", "-o", "made.yaml"]).ok();
    assert!(run.stdout.contains("next: tpf train BAG --params-file made.yaml"), "{run:?}");
    let (cfg, text) = made(folder);
    let names = [&cfg.tactile()[0].name, &cfg.joints()[0].name, &cfg.truth()[0].name];
    assert_eq!(names, ["/fingertip/pressure", "/mocap/joint_states", "/ft_sensor/wrench"], "{text}");
    assert_eq!(cfg.fusion().regions()[0].taxels.len(), 6);
    assert_eq!(cfg.needed_joints().len(), 3, "{text}");
    assert!(text.contains("offered best effort, volatile") && text.contains("offered reliable, volatile"), "{text}");
    common::onnx::LinearModel::new(4, 6, 3).gains(0.004, 0.0).metadata("unit", "N").write(folder, "model.onnx");
    let path = text.lines().find_map(|line| line.trim().strip_prefix("path: ")).unwrap();
    fs::rename(folder.join("model.onnx"), folder.join(path.split(' ').next().unwrap().trim_matches('"'))).unwrap();
    let live = Live::start(folder, &["--params-file", "made.yaml"]);
    let said = tpf(folder, &["monitor", "--plain", "--seconds", "4"]).ok().stdout;
    let region = &cfg.fusion().regions()[0].name;
    assert!(said.contains(region.as_str()) && !said.contains("SILENT"), "{said}");
    live.stop();
}

#[test]
fn an_empty_graph_is_refused_in_one_line() {
    if !common::skip::isolated() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let refused = tpf(folder.path(), &["init", "--live", "--seconds", "1", "--yes", "-o", "made.yaml"]);
    assert!(refused.failure().contains("no topic in this graph can be looked at"), "{refused:?}");
    assert!(!folder.path().join("made.yaml").exists());
}
