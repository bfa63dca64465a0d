//! Sessions that can be scored.
#![allow(dead_code, unreachable_pub)]

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use super::onnx::LinearModel;
use super::tpf::tpf;

pub use super::all::scored::PARAMS;

/// Two users' short sessions of a synthetic glove, and a model that sums taxels.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("params.yaml"), PARAMS).unwrap();
    for (name, bytes) in super::all::files(sessions()) {
        let file = path.join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, bytes).unwrap();
    }
    LinearModel::new(64, 6, 4).metadata("unit", "gF").write(path, "model.onnx");
    LinearModel::new(64, 6, 0).metadata("unit", "gF").write(path, "other.onnx");
    folder
}

/// A folder with these sessions in `bags`. Made once for all tests of a program, each of which gets a copy of them.
fn sessions() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    FOLDER
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let simulate =
                ["simulate", "--glove", "1", "--users", "2", "--sessions", "1", "--minutes=1.7", "--seed", "5"];
            tpf(folder.path(), &[&simulate[..], &["-o", "bags"]].concat()).ok();
            folder
        })
        .path()
}
