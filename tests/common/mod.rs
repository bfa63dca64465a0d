//! What the tests share. Each test program uses a part of it.
#![allow(dead_code, unreachable_pub, unused_imports)]

pub mod bags;
pub mod browser;
pub mod compared;
pub mod devices;
pub mod fake;
pub mod graphs;
pub mod layouts;
pub mod onnx;
pub mod parity;
pub mod root;
pub mod scored;
pub mod skip;
pub mod sqlite;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use root::ROOT;
pub use skip::{python, shared, skipped, without_onnx_runtime};

/// Whether the tests of ONNX Runtime can run. Where it is not found, says so on stderr, or fails when
/// `TPF_REQUIRE_ORT` is set.
pub fn onnx_runtime_is_here() -> bool {
    let folder = tempfile::tempdir().unwrap();
    let path = onnx::LinearModel::new(4, 1, 1).write(folder.path(), "model.onnx");
    let mut spec = tactile_pose_fusion::model::ModelSpec::new(path);
    spec.backend = tactile_pose_fusion::model::BackendChoice::OnnxRuntime;
    match tactile_pose_fusion::model::load(&spec) {
        Ok(_) => true,
        Err(error) => {
            without_onnx_runtime(&error.to_string());
            false
        }
    }
}

/// Runs windows that share nothing.
pub fn run_windows(
    model: &mut tactile_pose_fusion::model::Model,
    windows: tactile_pose_fusion::fusion::Windows<'_>,
) -> Result<tactile_pose_fusion::fusion::Forces, tactile_pose_fusion::fusion::RegressError> {
    let window = model.regressor.contract().window.get();
    let starts: Vec<usize> = (0..windows.n).map(|idx| idx * window).collect();
    let shared = tactile_pose_fusion::fusion::SharedWindows {
        starts: &starts,
        ids: &[],
        tactile: windows.tactile,
        pose: windows.pose,
    };
    let mut forces = tactile_pose_fusion::fusion::Forces::default();
    model.regressor.run(shared, &mut forces).map(|()| forces)
}

/// Writes a file in place of the one that is there, as a new one: ext4 writes a file that was cut to the disk when it is
/// closed, which takes longer than all that thousands of small files are tried for.
pub fn write_anew(path: &Path, bytes: &[u8]) {
    let _ = std::fs::remove_file(path);
    std::fs::write(path, bytes).unwrap();
}

/// Every file below a folder, by its path.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => {
                    let bytes = std::fs::read(&path).unwrap();
                    found.insert(path.strip_prefix(folder).unwrap().to_path_buf(), bytes);
                }
            }
        }
    }
    found
}
