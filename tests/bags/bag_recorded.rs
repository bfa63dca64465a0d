//! Every recorded bag opens or is refused with one line, and a bag cut off anywhere yields what is in front of the cut.

use crate::common::skip;

use std::fs;
use std::path::{Path, PathBuf};

use skip::shared;
use tactile_pose_fusion::bag::{BagError, BagReader, BagStats, BagWriter, WriteOptions};

/// The recorded bags, which lie beside the repository.
fn data() -> Option<PathBuf> {
    shared().map(|shared| shared.join("data"))
}

fn walk(folder: &Path, files: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            walk(&path, files);
        } else {
            files.push(path);
        }
    }
}

/// Log time and length of each message.
type Messages = Vec<(i64, usize)>;

/// All messages, and the losses.
fn read(path: &Path) -> Result<(Messages, Vec<String>), BagError> {
    let mut reader = BagReader::open(&[path.to_path_buf()])?;
    let stated = reader.summary().n_messages;
    let mut messages = Vec::new();
    while let Some(message) = reader.next_message()? {
        messages.push((message.log_time.0, message.data.len()));
    }
    if let Some(stated) = stated.filter(|_| reader.losses().is_empty()) {
        assert_eq!(stated, messages.len() as u64, "{}", path.display());
    }
    Ok((messages, reader.losses().iter().map(ToString::to_string).collect()))
}

#[test]
fn every_recorded_file_opens_or_is_refused_with_one_line() {
    let Some(data) = data() else { return };
    let mut files = Vec::new();
    walk(&data, &mut files);
    let mut n_opened = 0;
    for path in files {
        let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
        let name = path.file_name().unwrap().to_str().unwrap();
        let outcome = read(&path);
        let line = outcome.as_ref().err().map(ToString::to_string).unwrap_or_default();
        assert!(line.lines().count() <= 1, "{line}");
        match (extension, name) {
            ("mcap", "compressed.mcap" | "uncompressed.mcap") => {
                assert!(matches!(outcome, Err(BagError::Profile { .. })), "{line}");
            }
            ("mcap", "chunk_not_closed.mcap") => {
                let (messages, losses) = outcome.unwrap();
                assert!(messages.is_empty());
                assert!(losses[0].contains("cut off at byte 92"), "{losses:?}");
            }
            ("mcap", _) => {
                let (messages, losses) = outcome.unwrap_or_else(|error| panic!("{error}"));
                // This one holds messages of channels that it never defines.
                let undefined = name == "zstd_chunk_with_padding.mcap";
                assert_eq!((messages.is_empty(), losses.is_empty()), (undefined, !undefined), "{name}: {losses:?}");
                n_opened += 1;
            }
            ("db3", _) => {
                let (_, losses) = outcome.unwrap_or_else(|error| panic!("{error}"));
                assert!(losses.is_empty(), "{name}: {losses:?}");
            }
            ("yaml", _) => assert!(line.contains("give the folder"), "{line}"),
            _ => assert!(line.contains("looks like text"), "{line}"),
        }
    }
    assert!(n_opened > 20);
}

#[test]
fn every_recorded_folder_opens_or_is_refused_with_one_line() {
    let Some(data) = data() else { return };
    let mut files = Vec::new();
    walk(&data, &mut files);
    let mut n_opened = 0;
    for listing in files.iter().filter(|path| path.ends_with("metadata.yaml")) {
        let folder = listing.parent().unwrap();
        let stated = fs::read_to_string(listing).unwrap();
        let (messages, losses) = read(folder).unwrap_or_else(|error| panic!("{error}"));
        assert!(losses.is_empty(), "{losses:?}");
        assert!(stated.contains(&format!("\n  message_count: {}\n", messages.len())), "{}", folder.display());
        n_opened += 1;
    }
    assert!(n_opened > 10);
}

#[test]
fn bag_cut_off_anywhere_yields_a_prefix_of_its_messages() {
    let Some(data) = data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.mcap");
    for name in [
        "mcap_byu_auv/SO_bag_0.mcap",
        "mcap_small/cmd_vel_only_2.mcap",
        "mcap_rosbags_rs_alltypes/test_bags/test_bag_mcap/test_bag_mcap.mcap",
    ] {
        let whole = data.join(name);
        let (messages, _) = read(&whole).unwrap();
        let bytes = fs::read(&whole).unwrap();
        let mut longest = 0;
        for len in (0..bytes.len()).step_by(997) {
            fs::write(&cut, &bytes[..len]).unwrap();
            match read(&cut) {
                Ok((some, losses)) => {
                    assert_eq!(some, messages[..some.len()], "{name} cut at {len}");
                    assert!(some.len() == messages.len() || !losses.is_empty(), "{name} cut at {len}");
                    assert!(some.len() >= longest);
                    longest = some.len();
                }
                Err(error) => assert_eq!(len, 0, "{error}"),
            }
        }
        assert!(longest * 10 > messages.len() * 9, "{name}: {longest} of {}", messages.len());
    }
}

#[test]
fn foreign_channels_are_copied_with_all_that_belongs_to_them() {
    let Some(data) = data() else { return };
    let folder = tempfile::tempdir().unwrap();
    for (n, name) in ["mcap_byu_auv/SO_bag_0.mcap", "mcap_crab_loadcell/adya_gait.bag"].into_iter().enumerate() {
        let input = data.join(name);
        let out = folder.path().join(format!("copy{n}"));
        let mut reader = BagReader::open(std::slice::from_ref(&input)).unwrap();
        let mut writer = BagWriter::create(&out, WriteOptions::default()).unwrap();
        let channels: Vec<_> =
            reader.channels().to_vec().iter().map(|channel| writer.copy_channel(channel).unwrap()).collect();
        while let Some(message) = reader.next_message().unwrap() {
            let channel = channels[message.channel.id];
            writer.write(channel, message.sequence, message.log_time, message.publish_time, message.data).unwrap();
        }
        writer.finish().unwrap();
        let copy = BagReader::open(std::slice::from_ref(&out)).unwrap();
        assert_eq!(copy.summary().n_messages, reader.summary().n_messages);
        for (copied, original) in copy.channels().iter().zip(reader.channels()) {
            assert_eq!((&copied.topic, &copied.schema), (&original.topic, &original.schema));
            assert_eq!(copied.metadata.get("topic_type_hash"), original.metadata.get("topic_type_hash"));
        }
        assert_eq!(read(&out).unwrap().0, read(&input).unwrap().0);
    }
}

#[test]
fn statistics_of_a_recorded_load_cell_are_those_that_its_readme_states() {
    let Some(data) = data() else { return };
    let mut reader = BagReader::open(&[data.join("mcap_crab_loadcell/adya_gait.bag")]).unwrap();
    let mut stats = BagStats::default();
    while let Some(message) = reader.next_message().unwrap() {
        stats.handle_message(&message);
    }
    let topics = stats.topics();
    let load_cell = topics.iter().find(|topic| topic.topic == "/load_cell_data").unwrap();
    assert_eq!(load_cell.n_messages, 4285);
    // The README rounds its figures, and a bin of the histogram is 3 % wide.
    assert!((load_cell.interval_p50_ms.unwrap() - 1.95).abs() < 0.1, "{load_cell:?}");
    assert!((load_cell.interval_p99_ms.unwrap() - 4.6).abs() < 0.2, "{load_cell:?}");
    assert!((load_cell.interval_max_ms.unwrap() - 301.0).abs() < 1.0, "{load_cell:?}");
}
