//! A process that is killed at any moment leaves no half output under its name, and a recording that is cut off can be
//! read as far as it goes.

#[path = "tpf_common/mod.rs"]
mod common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use common::ROOT;
use common::bags::{Bag, at, write_session};
use common::onnx::LinearModel;
use common::tpf::write_params;
use tactile_pose_fusion::bag::{BagReader, BagWriter, Compression, WriteOptions};

/// A `tpf replay` that has just begun.
fn replay(folder: &Path, output: &str) -> std::process::Child {
    Command::new(env!("CARGO_BIN_EXE_tpf"))
        .current_dir(folder)
        .args(["replay", "session.mcap", "--params-file", "params.yaml", "--calibrate-first", "3.13"])
        .args(["--backend", "rten", "--batch", "1", "-o", output])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Every file below a folder with its bytes, but for hidden ones.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.file_name().unwrap().to_str().unwrap().starts_with('.') {
            continue;
        }
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push((path.clone(), fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

fn n_hidden(folder: &Path) -> usize {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.starts_with('.')).count()
}

#[test]
fn a_replay_killed_at_any_moment_leaves_its_output_absent_or_complete() {
    const N_KILLS: u32 = 100;
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(&folder.join("session.mcap"), 8);
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    write_params(folder, 2, &["dip"], "");
    let inputs = files(folder);

    // What a run writes that nobody kills, as a file and as a folder, and how long the second takes.
    let mut whole = Vec::new();
    let mut length = Duration::ZERO;
    for output in ["out.mcap", "out"] {
        let started = Instant::now();
        assert!(replay(folder, output).wait().unwrap().success());
        length = started.elapsed();
        let mut written = files(folder);
        written.retain(|file| !inputs.contains(file));
        written.iter().for_each(|(path, _)| fs::remove_file(path).unwrap());
        let _ = fs::remove_dir(folder.join("out"));
        whole.push(written);
    }

    let mut n_killed = 0;
    for k in 0..N_KILLS {
        let (output, whole) = [("out.mcap", &whole[0]), ("out", &whole[1])][k as usize % 2];
        let mut child = replay(folder, output);
        // Moments spread evenly by the golden ratio over the length of a run, which depends on what else runs.
        let part = (f64::from(k) * 0.618_034).fract();
        std::thread::sleep(length.mul_f64(part));
        let is_running = child.try_wait().unwrap().is_none();
        n_killed += u32::from(is_running);
        length = match is_running {
            true if part > 0.8 => length.mul_f64(1.25),
            false if part < 0.8 => length.mul_f64(0.8),
            _ => length,
        };
        child.kill().unwrap();
        child.wait().unwrap();
        let mut left = files(folder);
        left.retain(|file| !inputs.contains(file));
        for file in &left {
            assert!(whole.contains(file), "kill {k}: {} is not what a whole run writes", file.0.display());
        }
        assert_eq!(files(folder).len(), inputs.len() + left.len(), "kill {k}: an input changed");
        if let Some(bag) = left.iter().map(|(path, _)| path).find(|path| path.ends_with("out.mcap")) {
            let mut reader = BagReader::open(std::slice::from_ref(bag)).unwrap();
            while reader.next_message().unwrap().is_some() {}
            assert!(reader.losses().is_empty());
        }
        left.iter().for_each(|(path, _)| fs::remove_file(path).unwrap());
        let _ = fs::remove_dir(folder.join("out"));
    }
    assert!(n_killed > N_KILLS / 2, "only {n_killed} were still running");
    assert!(n_hidden(folder) > 0, "none was killed while it wrote");

    // What earlier kills left stands in nobody's way.
    for (output, whole) in ["out.mcap", "out"].into_iter().zip(&whole) {
        assert!(replay(folder, output).wait().unwrap().success());
        let mut written = files(folder);
        written.retain(|file| !inputs.contains(file));
        assert_eq!(&written, whole);
        written.iter().for_each(|(path, _)| fs::remove_file(path).unwrap());
    }
    assert_eq!(files(folder), inputs);
}

/// The bytes of a recording that nobody has finished, as a kill leaves them on the disk.
fn unfinished(folder: &Path, compression: Compression) -> Vec<u8> {
    let path = folder.join("recording.mcap");
    let options = WriteOptions { compression, ..WriteOptions::default() };
    let mut bag = Bag::of(BagWriter::create(&path, options).unwrap());
    let mut noise = 1u32;
    for k in 0..3000 {
        let values: Vec<f32> = std::iter::repeat_with(|| {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (noise >> 8) as f32
        })
        .take(500)
        .collect();
        bag.joints(at(k * 10), &["dip"], &[0.1]);
        bag.taxels(at(k * 10), &values);
    }
    let hidden = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let hidden = hidden.into_iter().find(|path| path.file_name().unwrap().to_str().unwrap().starts_with(".recording."));
    fs::read(hidden.expect("a recording under way is a hidden file beside its name")).unwrap()
}

/// Messages in the chunks that lie wholly before `len`.
fn n_in_whole_chunks(bytes: &[u8], len: usize) -> usize {
    let mut at = mcap::MAGIC.len();
    let mut n_messages = 0;
    while let Some(head) = bytes.get(at..at + 9) {
        let end = at + 9 + u64::from_le_bytes(head[1..].try_into().unwrap()) as usize;
        if end > len {
            break;
        }
        // Of the index that follows each chunk, one for a channel: an id, and 16 bytes a message.
        if head[0] == 7 {
            n_messages += (end - at - 9 - 2 - 4) / 16;
        }
        at = end;
    }
    n_messages
}

#[test]
fn a_recording_cut_off_anywhere_is_read_up_to_its_last_whole_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let mut cuts: Vec<(PathBuf, usize)> = Vec::new();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let bytes = unfinished(folder.path(), compression);
        assert!(bytes.len() > 4 << 20, "{} bytes", bytes.len());
        for k in 1..=20 {
            let len = (bytes.len() as f64 * (f64::from(k) * 0.618_034).fract()) as usize;
            let path = folder.path().join(format!("{compression:?}_{k}.mcap"));
            fs::write(&path, &bytes[..len]).unwrap();
            let n_whole = n_in_whole_chunks(&bytes, len);
            cuts.push((path.clone(), n_whole));
            if len < 1000 {
                continue;
            }
            let mut reader = BagReader::open(&[path]).unwrap();
            let mut n_read = 0;
            while reader.next_message().unwrap().is_some() {
                n_read += 1;
            }
            assert!(n_read >= n_whole, "{compression:?}, {len} bytes: {n_read} of {n_whole} messages");
            let losses: Vec<String> = reader.losses().iter().map(ToString::to_string).collect();
            assert!(losses.iter().any(|loss| loss.contains("cut off")), "{losses:?}");
        }
    }
    assert!(cuts.iter().filter(|(_, n_whole)| *n_whole > 500).count() > 30);

    let Some(python) = common::python() else { return };
    let mut command = Command::new(python);
    command.arg(format!("{ROOT}/tests/python/read_cut.py"));
    let output = command.args(cuts.iter().map(|(path, _)| path)).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    let n_read: Vec<usize> = text.lines().map(|line| line.parse().unwrap()).collect();
    assert_eq!(n_read.len(), cuts.len());
    for ((path, n_whole), n_read) in cuts.iter().zip(n_read) {
        assert!(n_read >= *n_whole, "{}: mcap for Python reads {n_read} of {n_whole}", path.display());
    }
}
