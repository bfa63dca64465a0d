//! Outputs that can't be written: one clear line, and nothing left behind.

use crate::common;

use std::fs;
use std::path::Path;
use std::process::Command;

use common::bags::write_session;
use common::onnx::LinearModel;
use common::tpf::{Run, tpf, write_params};

const REPLAY: [&str; 6] = ["replay", "session.mcap", "--params-file", "params.yaml", "--calibrate-first", "3.13"];

fn session() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 8);
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder.path(), "model.onnx");
    write_params(folder.path(), 2, &["dip"], "");
    folder
}

/// Every name in a folder, hidden ones too.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Runs a replay in a shell that first runs `limits`.
fn replay_under(limits: &str, folder: &Path, output: &str) -> Run {
    let script = format!("{limits}; exec \"$0\" \"$@\"");
    let mut command = Command::new("bash");
    command.current_dir(folder).args(["-c", &script, env!("CARGO_BIN_EXE_tpf")]).args(REPLAY).args(["-o", output]);
    command.output().unwrap().into()
}

#[test]
fn a_file_that_may_not_grow_is_one_line_and_leaves_nothing() {
    let folder = session();
    let folder = folder.path();
    let before = names(folder);
    for output in ["out.mcap", "out"] {
        // A limit of 8 KiB on every file, with its signal ignored: writing fails as on a full disk.
        let run = replay_under("trap '' XFSZ; ulimit -f 8", folder, output);
        let line = run.failure();
        assert!(line.contains("out"), "{line}");
        assert_eq!(names(folder), before);
    }
}

#[test]
fn a_full_disk_is_one_line_and_leaves_nothing() {
    let folder = session();
    let folder = folder.path();
    let disk = folder.join("disk");
    fs::create_dir(&disk).unwrap();
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=16k", "tmpfs"]).arg(&disk).output();
    if !mount.is_ok_and(|mount| mount.status.success()) {
        common::skipped("mounting a small disk is not permitted here");
        return;
    }
    let run: Run = tpf(folder, &[&REPLAY[..], &["-o", "disk/out.mcap"]].concat());
    let left = names(&disk);
    assert!(Command::new("umount").arg(&disk).status().unwrap().success());
    let line = run.failure();
    assert!(line.contains("disk/out.mcap") && line.contains("full"), "{line}");
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn an_output_in_no_folder_or_on_a_file_is_refused_before_any_work() {
    let folder = session();
    let folder = folder.path();
    let before = names(folder);
    for (output, expected) in [("nowhere/out.mcap", "nowhere"), ("session.mcap/out.mcap", "session.mcap")] {
        let run = tpf(folder, &[&REPLAY[..], &["-o", output]].concat());
        let line = run.failure();
        assert!(line.contains(expected), "{line}");
        assert!(!run.stderr.contains("model tip"), "models were loaded first: {run:?}");
        assert_eq!(names(folder), before);
    }
}

#[test]
fn an_output_folder_on_the_way_of_the_input_is_refused() {
    let folder = session();
    let folder = folder.path();
    let args = [&REPLAY[..], &["-o", "bag"]].concat();
    tpf(folder, &args).ok();
    assert_eq!(names(&folder.join("bag")), ["bag_0.mcap", "metadata.yaml"]);
    let again = tpf(folder, &args);
    assert!(again.failure().contains("bag"), "{again:?}");
}

#[test]
fn an_interrupt_leaves_nothing() {
    let folder = session();
    let folder = folder.path();
    write_session(&folder.join("long.mcap"), 300);
    let before = names(folder);
    for signal in ["-INT", "-TERM"] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_tpf"))
            .current_dir(folder)
            .args([
                "replay",
                "long.mcap",
                "--params-file",
                "params.yaml",
                "--calibrate-first",
                "3.13",
                "-o",
                "out.mcap",
            ])
            .args(["--batch", "1", "--backend", "rten"])
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        while names(folder) == before {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it began to write");
        }
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
        let run: Run = child.wait_with_output().unwrap().into();
        assert_eq!(run.failure(), "interrupted; nothing was written");
        assert_eq!(names(folder), before);
    }
}
