//! A node at work between a glove and a listener.

use std::path::{Path, PathBuf};

use super::{Feeder, Heard, Listener, Live, peer, write_setup};
use crate::common::bags::write_session;
use crate::common::skip;

/// A calibrated node that someone listens to.
pub struct Scene {
    pub python: PathBuf,
    pub folder: tempfile::TempDir,
    pub live: Live,
    pub listener: Listener,
}

impl Scene {
    /// Sets it, with parameters besides; none where there is no ROS to test against.
    pub fn set(extra: &str) -> Option<Scene> {
        Scene::set_with(extra, &[])
    }

    /// As [`set`](Self::set), with arguments of `tpf run` besides.
    pub fn set_with(extra: &str, args: &[&str]) -> Option<Scene> {
        let python = skip::ros_python()?;
        let folder = tempfile::tempdir().unwrap();
        write_session(&folder.path().join("session.mcap"), 4);
        write_setup(folder.path(), "sensor_msgs/msg/LaserScan", extra);
        let calibrated = ["--params-file", "live.yaml", "--calibration", "calibration.yaml"];
        let live = Live::start(folder.path(), &[&calibrated[..], args].concat());
        let listener = Listener::start(&python, folder.path());
        Some(Scene { python, folder, live, listener })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn feed(&self, args: &[&str]) -> Feeder {
        Feeder::start(&self.python, args, self.path())
    }

    pub fn wait_for_estimates(&self) -> Heard {
        self.listener.wait_for("an estimate", |heard| heard.flags == 0 && !heard.force.is_nan())
    }

    pub fn disturb(&self, args: &[&str]) {
        peer(&self.python, "disturb.py", args, self.path());
    }
}
