//! The `metadata.yaml` of bag folders.

use std::sync::OnceLock;

use tactile_pose_fusion::bag::BagReader;

use super::common::bags::{Bag, at};
use super::driver::{Answer, Target, file_of};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "metadata", seeds, mutate: other, run, min_understood: 0.2 };

const WORDS: [&str; 24] = [
    "rosbag2_bagfile_information",
    "relative_file_paths",
    "storage_identifier",
    "compression_mode",
    "mcap",
    "sqlite3",
    "FILE",
    "NONE",
    "zstd",
    "fuzzed_0.mcap",
    "../fuzzed_0.mcap",
    "/etc/passwd",
    ".",
    "..",
    "[]",
    "{}",
    "-",
    ":",
    "&a",
    "*a",
    "~",
    "\"",
    "18446744073709551616",
    "\u{0}",
];

/// A folder with one bag, whose `metadata.yaml` is an input, and what recorders write.
fn folder() -> &'static (tempfile::TempDir, Vec<u8>) {
    static FOLDER: OnceLock<(tempfile::TempDir, Vec<u8>)> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let memory = file_of("in_memory", b"");
        let folder = tempfile::tempdir_in(memory.parent().unwrap()).unwrap();
        let mut bag = Bag::create(&folder.path().join("fuzzed"));
        bag.taxels(at(0), &[1.0]);
        bag.joints(at(1), &["dip"], &[0.1]);
        bag.finish();
        let written = std::fs::read(folder.path().join("fuzzed/metadata.yaml")).unwrap();
        (folder, written)
    })
}

fn seeds() -> Vec<Vec<u8>> {
    let short = b"rosbag2_bagfile_information:\n  version: 4\n  storage_identifier: mcap\n  compression_mode: \"\"\n  \
                  relative_file_paths:\n    - fuzzed_0.mcap\n";
    vec![folder().1.clone(), short.to_vec()]
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    mutate::text(random, seed, other, &WORDS)
}

fn run(input: &[u8]) -> Answer {
    let folder = &folder().0.path().join("fuzzed");
    std::fs::write(folder.join("metadata.yaml"), input).unwrap();
    let mut reader = match BagReader::open(&[folder.to_owned()]) {
        Ok(reader) => reader,
        Err(error) => return super::one_line(&error),
    };
    let mut n_messages = 0;
    loop {
        match reader.next_message() {
            Ok(Some(_)) => n_messages += 1,
            Ok(None) => break,
            Err(error) => return super::one_line(&error),
        }
    }
    assert!(n_messages == 2 || n_messages == 0, "{n_messages} messages of a bag that has 2");
    Answer::understood(&(n_messages, reader.losses().len()))
}
