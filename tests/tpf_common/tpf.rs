//! The binary as a user runs it.

use std::path::Path;
use std::process::{Command, Output};

/// What a run of `tpf` left.
#[derive(Debug)]
pub struct Run {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl From<Output> for Run {
    fn from(output: Output) -> Self {
        Run {
            code: output.status.code().unwrap_or(-1),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

impl Run {
    /// The summary that `--json` printed.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    pub fn ok(self) -> Run {
        assert_eq!(self.code, 0, "{self:?}");
        self
    }

    /// The one line that a failed run says, without the program's name.
    ///
    /// Lines about models and the zero may stand before it; a panic or a second line of error is refused.
    pub fn failure(&self) -> &str {
        assert_eq!(self.code, 1, "{self:?}");
        assert!(!self.stderr.contains("panicked"), "{self:?}");
        let mut lines = self.stderr.lines().filter_map(|line| line.strip_prefix("tpf: "));
        let line = lines.next().unwrap_or_else(|| panic!("no line of failure: {self:?}"));
        assert!(lines.next().is_none() && self.stderr.trim_end().ends_with(line), "{self:?}");
        line
    }
}

/// Runs `tpf` in a folder.
pub fn tpf(folder: &Path, args: &[&str]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
    command.current_dir(folder).args(args).output().unwrap().into()
}

/// Parameters of one region on `/taxels` and `/joints`.
pub fn write_params(folder: &Path, n_taxels: usize, joints: &[&str], extra: &str) {
    let joints = joints.join(", ");
    let text = format!(
        "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {{topic: /taxels, n_taxels: {n_taxels}}}
    joint.hand: {{topic: /joints}}
    model.tip: {{path: model.onnx}}
    region.index: {{model: tip, joints: [{joints}], frame_id: index_tip, normal: [0.0, 0.0, -1.0]}}
{extra}"
    );
    std::fs::write(folder.join("params.yaml"), text).unwrap();
}
