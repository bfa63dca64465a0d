//! What the tests share. Each test program uses a part of it.
#![allow(dead_code, unreachable_pub, clippy::print_stderr)]

use std::path::PathBuf;

pub mod onnx;

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
