//! What the tests share. Each test program uses a part of it.
#![allow(dead_code, unreachable_pub, clippy::print_stderr)]

use std::path::PathBuf;

pub mod bags;
pub mod fake;
pub mod onnx;
pub mod tpf;

/// The folder of shared data and fixtures: `TPF_SHARED`, else `../shared` beside the repository.
///
/// Where neither is there, says so on stderr and gives `None`, and the test returns.
pub fn shared() -> Option<PathBuf> {
    let folder = std::env::var_os("TPF_SHARED")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared")), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: ../shared is not here");
    None
}

/// Whether the tests of ONNX Runtime can run. Where it is not found, says so on stderr, or fails when
/// `TPF_REQUIRE_ORT` is set.
pub fn onnx_runtime_is_here() -> bool {
    let folder = tempfile::tempdir().unwrap();
    let path = onnx::LinearModel::new(4, 1, 1).write(folder.path(), "model.onnx");
    let mut spec = tactile_pose_fusion::model::ModelSpec::new(path);
    spec.backend = tactile_pose_fusion::model::BackendChoice::OnnxRuntime;
    match tactile_pose_fusion::model::load(&spec) {
        Ok(_) => true,
        Err(error) if std::env::var_os("TPF_REQUIRE_ORT").is_some() => panic!("{error}"),
        Err(error) => {
            eprintln!("skipped ONNX Runtime: {error}");
            false
        }
    }
}

/// The Python of `scripts/python-venv`. Where it is not there, says so on stderr, or fails when `TPF_REQUIRE_PYTHON` is
/// set.
pub fn python() -> Option<PathBuf> {
    let python = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/target/venv/bin/python"));
    if python.exists() {
        return Some(python);
    }
    assert!(std::env::var_os("TPF_REQUIRE_PYTHON").is_none(), "target/venv is not here; run scripts/python-venv");
    eprintln!("skipped: target/venv is not here; scripts/python-venv makes it");
    None
}
