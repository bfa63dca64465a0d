//! What tests need that may not be here, and how they say that they skip: past the test runner's capture, so that a
//! person sees it.
#![allow(dead_code, unreachable_pub)]

use super::root::ROOT;
use std::io::Write;
use std::path::PathBuf;

/// Says that the running test, or a part of it, is skipped.
pub fn skipped(why: &str) {
    let thread = std::thread::current();
    let line = format!("skipped {}: {why}\n", thread.name().unwrap_or("a test"));
    let _ = std::io::stderr().write_all(line.as_bytes()); // at once, because other tests write, too
}

/// The folder of shared data and fixtures: `TPF_SHARED`, else `../shared` beside the repository.
///
/// Where neither is there the test is skipped.
pub fn shared() -> Option<PathBuf> {
    let beside = PathBuf::from(format!("{ROOT}/../shared"));
    let folder = std::env::var_os("TPF_SHARED").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    skipped("../shared is not here");
    None
}

/// The Python of `scripts/python-venv`. Where it is not there the test is skipped, or fails when `TPF_REQUIRE_PYTHON` is
/// set.
pub fn python() -> Option<PathBuf> {
    let python = PathBuf::from(format!("{ROOT}/target/venv/bin/python"));
    if python.exists() {
        return Some(python);
    }
    assert!(std::env::var_os("TPF_REQUIRE_PYTHON").is_none(), "target/venv is not here; run scripts/python-venv");
    skipped("target/venv is not here; scripts/python-venv makes it");
    None
}

/// Skips what needs ONNX Runtime for the reason that its loading gave, or fails when `TPF_REQUIRE_ORT` is set.
pub fn without_onnx_runtime(why: &str) {
    assert!(std::env::var_os("TPF_REQUIRE_ORT").is_none(), "TPF_REQUIRE_ORT is set, but {why}");
    skipped(why);
}

/// Whether this is inside of `tests/ros/isolated`.
///
/// Outside of it no test may start a DDS participant, because it could reach a robot: the test is skipped, or fails when
/// `TPF_REQUIRE_ROS` is set.
pub fn isolated() -> bool {
    let isolated = std::env::var("TPF_ISOLATED").as_deref() == Ok("1");
    if !isolated {
        let required = std::env::var_os("TPF_REQUIRE_ROS").is_some();
        assert!(!required, "TPF_REQUIRE_ROS is set, but this is not inside of tests/ros/isolated");
        skipped("not inside of tests/ros/isolated");
    }
    isolated
}

/// The Python of `scripts/ros-venv`, where a real ROS 2 is, inside of `tests/ros/isolated`. Where either is missing the
/// test is skipped, or fails when `TPF_REQUIRE_ROS` is set.
pub fn ros_python() -> Option<PathBuf> {
    isolated().then(|| here(ros_venv().join("bin/python"), "scripts/ros-venv")).flatten()
}

/// The peer with DDS security of `scripts/fastdds-peer`; skips or fails as [`ros_python`] does.
pub fn fastdds_peer() -> Option<PathBuf> {
    let peer = PathBuf::from(format!("{ROOT}/target/fastdds/peer"));
    isolated().then(|| here(peer, "scripts/fastdds-peer")).flatten()
}

/// A file that a script makes.
fn here(file: PathBuf, script: &str) -> Option<PathBuf> {
    if file.exists() {
        return Some(file);
    }
    let missing = format!("{} is not here; {script} makes it", file.display());
    assert!(std::env::var_os("TPF_REQUIRE_ROS").is_none(), "{missing}");
    skipped(&missing);
    None
}

/// Where Zenoh's Python binding is, beside the Python of [`ros_python`]; skips or fails as that does.
pub fn zenoh_packages() -> Option<PathBuf> {
    let venv = PathBuf::from(format!("{ROOT}/target/zenoh-venv/lib"));
    let versions = std::fs::read_dir(&venv).into_iter().flatten().filter_map(Result::ok);
    let found = versions.map(|version| version.path().join("site-packages")).find(|packages| packages.is_dir());
    if found.is_none() {
        let missing = "target/zenoh-venv is not here; scripts/ros-venv zenoh makes it";
        assert!(std::env::var_os("TPF_REQUIRE_ROS").is_none(), "{missing}");
        skipped(missing);
    }
    found
}

/// Where that Python and its ROS 2 are: `TPF_ROS_VENV`, else `target/ros-venv`.
pub fn ros_venv() -> PathBuf {
    let default = PathBuf::from(format!("{ROOT}/target/ros-venv"));
    std::env::var_os("TPF_ROS_VENV").map_or(default, PathBuf::from)
}
