//! Disks that are full and folders that are read-only: one clear line from every command that writes, and nothing
//! half-written.

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::scored;
use common::tpf::{Run, tpf};
use tactile_pose_fusion::bag::{BagReader, BagWriter, WriteOptions};
use tactile_pose_fusion::msg::TaxelArray;
use tactile_pose_fusion::units::Stamp;

/// A small disk, gone when dropped.
struct Disk(PathBuf);

impl Disk {
    /// `None` where mounting is not permitted.
    fn mount(folder: &Path, options: &str) -> Option<Disk> {
        let path = folder.join("disk");
        fs::create_dir_all(&path).unwrap();
        let mount = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(&path).output();
        mount.is_ok_and(|mount| mount.status.success()).then_some(Disk(path))
    }

    /// Everything on it.
    fn files(&self) -> Vec<PathBuf> {
        let mut found = Vec::new();
        let mut folders = vec![self.0.clone()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() { folders.push(path) } else { found.push(path) }
            }
        }
        found
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

/// A bag whose rows must be put in order, for which SQLite needs a temporary file.
fn bag_by_topic(path: &Path) {
    let bag = rusqlite::Connection::open(path).unwrap();
    bag.execute_batch(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
        INSERT INTO topics VALUES (0, '/a', 'std_msgs/msg/Empty', 'cdr'), (1, '/b', 'std_msgs/msg/Empty', 'cdr');
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
        INSERT INTO messages WITH RECURSIVE r(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM r WHERE n < 999999)
            SELECT n, n / 500000, n % 500000 * 2 + n / 500000, x'0001000000' FROM r;",
    )
    .unwrap();
}

#[test]
fn a_bag_that_needs_more_temporary_space_than_there_is_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let Some(disk) = Disk::mount(folder, "size=64k") else {
        common::skipped("mounting a small disk is not permitted here");
        return;
    };
    bag_by_topic(&folder.join("by_topic.db3"));
    let packed = zstd::encode_all(fs::File::open(folder.join("by_topic.db3")).unwrap(), 1).unwrap();
    fs::write(folder.join("packed.db3.zstd"), packed).unwrap();
    for (bag, what) in [("by_topic.db3", "put its messages in order in"), ("packed.db3.zstd", "unpack to")] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        let command = command.current_dir(folder).args(["diff", bag, bag]);
        let run = Run::from(command.env("SQLITE_TMPDIR", &disk.0).env("TMPDIR", &disk.0).output().unwrap());
        let expected = format!("{bag}: can't {what} the folder for temporary files (TMPDIR): ");
        assert!(run.failure().starts_with(&expected), "{run:?}");
        assert!(disk.files().is_empty(), "{:?}", disk.files());
    }
    // A disk that can't be written is no hindrance to a bag on it.
    let status = Command::new("mount").args(["-o", "remount,size=200m"]).arg(&disk.0).status().unwrap();
    assert!(status.success());
    fs::copy(folder.join("by_topic.db3"), disk.0.join("bag.db3")).unwrap();
    assert!(Command::new("mount").args(["-o", "remount,ro"]).arg(&disk.0).status().unwrap().success());
    let told = tpf(folder, &["inspect", "disk/bag.db3"]).ok();
    assert!(told.stdout.contains("1,000,000 messages on 2 topics"), "{}", told.stdout);
    assert_eq!(disk.files(), [disk.0.join("bag.db3")]);
}

const EVAL: [&str; 6] = ["eval", "bags", "--params-file", "params.yaml", "--model", "model.onnx"];

/// Every output that a command has, on the disk.
fn commands() -> Vec<Vec<&'static str>> {
    let bag = "bags/glove1_user01_session1";
    let eval = |more: &[&'static str]| [&EVAL[..], more].concat();
    let mut commands = vec![
        vec!["replay", bag, "--params-file", "params.yaml", "-o", "disk/out.mcap"],
        vec!["replay", bag, "--params-file", "params.yaml", "-o", "disk/out"],
        vec!["calibrate", bag, "--params-file", "params.yaml", "-o", "disk/calibration.yaml"],
        vec!["simulate", "--glove=1", "--users=1", "--sessions=1", "--seed=1", "--minutes=1.7", "-o", "disk/sessions"],
        eval(&["--report", "disk/report.html"]),
        eval(&["--parquet", "disk/scores.parquet"]),
        eval(&["--frames", "disk/frames.parquet"]),
        eval(&["--gate", "gates.yaml", "--junit", "disk/gates.xml"]),
        eval(&["--gate", "gates.yaml", "--jsonl", "disk/gates.jsonl"]),
        vec!["characterize", "bags", "--params-file", "params.yaml", "--report", "disk/page.html"],
        vec!["export", "bags", "--params-file", "params.yaml", "--lerobot", "disk/dataset"],
        vec!["export", "bags", "--params-file", "params.yaml", "--parquet", "disk/frames.parquet"],
        vec!["export", "bags", "--params-file", "params.yaml", "--csv", "disk/frames.csv"],
    ];
    if cfg!(feature = "train") {
        let train = ["train", "bags", "--params-file", "params.yaml", "--steps", "2", "--batch", "16"];
        commands.push([&train[..], &["--stride", "50", "-o", "disk/model.onnx"]].concat());
    }
    commands
}

/// Sessions, parameters, models and gates.
fn folder() -> tempfile::TempDir {
    let folder = scored::folder();
    fs::write(folder.path().join("gates.yaml"), "gates:\n  - {metric: ba, at_least: 0.0}\n").unwrap();
    folder
}

#[test]
fn outputs_on_a_read_only_disk_are_one_line() {
    let folder = folder();
    let folder = folder.path();
    let Some(disk) = Disk::mount(folder, "size=64k,ro") else {
        common::skipped("mounting a small disk is not permitted here");
        return;
    };
    for command in commands() {
        let run: Run = tpf(folder, &command);
        let line = run.failure();
        assert!(line.contains("disk") && line.contains("Read-only file system"), "{command:?}: {line}");
    }
    assert!(disk.files().is_empty());
}

#[test]
fn outputs_on_a_full_disk_are_one_line_and_leave_nothing() {
    let folder = folder();
    let folder = folder.path();
    let Some(disk) = Disk::mount(folder, "size=4k") else {
        common::skipped("mounting a small disk is not permitted here");
        return;
    };
    fs::write(disk.0.join("full"), vec![1; 4096]).unwrap();
    for command in commands() {
        let run: Run = tpf(folder, &command);
        let line = run.failure();
        assert!(line.contains("disk/"), "{command:?}: {line}");
        assert!(line.contains("full") || line.contains("No space left"), "{command:?}: {line}");
        assert_eq!(disk.files(), [disk.0.join("full")], "{command:?}");
    }
}

#[test]
fn a_recording_that_fills_its_disk_is_kept_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    let Some(disk) = Disk::mount(folder.path(), "size=256k") else {
        common::skipped("mounting a small disk is not permitted here");
        return;
    };
    let mut writer = BagWriter::create(&disk.0.join("live.mcap"), WriteOptions::default()).unwrap();
    let channel = writer.add_topic::<TaxelArray>("/glove/taxels").unwrap();
    let unfinished = writer.keep_unfinished();
    let noise = |k: i64| (0..500).map(|byte: i64| (k * 7919 + byte * 104_729) as u8 ^ (k * byte) as u8).collect();
    let record = |k: i64| {
        let data: Vec<u8> = noise(k);
        let stamp = Stamp(k * 10_000_000);
        writer.write(channel, 0, stamp, stamp, &data).and_then(|()| writer.flush())
    };
    let (n, error) = (0..10_000).map(record).enumerate().find_map(|(n, wrote)| Some((n, wrote.err()?))).unwrap();
    assert!(error.to_string().contains("full"), "{error}");
    drop(writer);
    let mut reader = BagReader::open(&[unfinished]).unwrap();
    let kept = std::iter::from_fn(|| reader.next_message().unwrap().map(|_| ())).count();
    assert!(n > 50 && kept >= n - 1, "{kept} of {n} messages were kept");
}
