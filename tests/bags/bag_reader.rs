//! Bags come out in the order in which they were recorded, and damage is left out and said.

use std::fs;
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use tactile_pose_fusion::bag::{
    BEST_EFFORT_QOS, BagError, BagReader, BagRecord, BagWriter, Compression, NewChannel, WriteOptions, recordings_at,
};
use tactile_pose_fusion::units::Stamp;

const A: NewChannel<'static> = NewChannel {
    topic: "/a",
    type_name: "std_msgs/msg/UInt64",
    schema_text: "uint64 data",
    qos_yaml: BEST_EFFORT_QOS,
    type_hash: "",
};
const B: NewChannel<'static> = NewChannel { topic: "/b", ..A };

/// A bag with messages on `/a` at `times`, each holding its time.
fn write_bag(out: &Path, compression: Compression, times: &[i64]) {
    let mut writer = BagWriter::create(out, WriteOptions { compression, ..WriteOptions::default() }).unwrap();
    let channel = writer.add_channel(A).unwrap();
    for (sequence, &time) in times.iter().enumerate() {
        writer.write(channel, sequence as u32, Stamp(time), Stamp(time), &time.to_le_bytes()).unwrap();
    }
    writer.finish().unwrap();
}

fn times(reader: &mut BagReader) -> Vec<i64> {
    let mut times = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        times.push(message.log_time.0);
    }
    times
}

fn open(path: &Path) -> Result<BagReader, BagError> {
    BagReader::open(&[path.to_path_buf()])
}

fn refusal(path: &Path) -> String {
    let error = match open(path) {
        Ok(mut reader) => loop {
            match reader.next_message() {
                Ok(Some(_)) => {}
                Ok(None) => panic!("{} was read", path.display()),
                Err(error) => break error,
            }
        },
        Err(error) => error,
    };
    let line = error.to_string();
    assert_eq!(line.lines().count(), 1, "{line}");
    line
}

/// A record of an MCAP file.
fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![opcode];
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
    bytes
}

fn string(text: &str) -> Vec<u8> {
    let mut bytes = (text.len() as u32).to_le_bytes().to_vec();
    bytes.extend(text.as_bytes());
    bytes
}

fn header(profile: &str) -> Vec<u8> {
    let mut bytes = mcap::MAGIC.to_vec();
    bytes.extend(record(1, &[string(profile), string("test")].concat()));
    bytes
}

/// Channel 1, with no schema.
fn channel(topic: &str, encoding: &str) -> Vec<u8> {
    record(4, &[vec![1, 0, 0, 0], string(topic), string(encoding), vec![0; 4]].concat())
}

fn message(channel: u16, log_time: u64, data: &[u8]) -> Vec<u8> {
    let mut body = channel.to_le_bytes().to_vec();
    body.extend([0; 4]);
    body.extend(log_time.to_le_bytes());
    body.extend(log_time.to_le_bytes());
    body.extend(data);
    record(5, &body)
}

/// A chunk that claims what it is told about its records.
fn chunk(compression: &str, crc: u32, uncompressed_len: u64, records: &[u8]) -> Vec<u8> {
    let mut body = vec![0; 16];
    body.extend(uncompressed_len.to_le_bytes());
    body.extend(crc.to_le_bytes());
    body.extend(string(compression));
    body.extend((records.len() as u64).to_le_bytes());
    body.extend(records);
    record(6, &body)
}

fn end() -> Vec<u8> {
    [record(15, &[0; 4]), record(2, &[0; 20]), mcap::MAGIC.to_vec()].concat()
}

fn bag_of(folder: &Path, parts: &[Vec<u8>]) -> PathBuf {
    let path = folder.join("bag.mcap");
    fs::write(&path, parts.concat()).unwrap();
    path
}

#[test]
fn messages_of_a_channel_keep_the_order_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    for (name, compression) in [("n", Compression::None), ("l", Compression::Lz4), ("z", Compression::Zstd)] {
        let path = folder.path().join(name).with_extension("mcap");
        write_bag(&path, compression, &[30, 10, 20, 20, 5]);
        let mut reader = open(&path).unwrap();
        assert_eq!(reader.summary().n_messages, Some(5));
        assert_eq!(reader.summary().span, Some((Stamp(5), Stamp(30))));
        assert_eq!(times(&mut reader), [30, 10, 20, 20, 5]);
        assert_eq!(reader.losses(), []);
        assert_eq!(reader.bytes_read(), reader.bytes_total());
    }
}

#[test]
fn two_bags_merge_by_log_time_and_the_first_goes_first_where_equal() {
    let folder = tempfile::tempdir().unwrap();
    let (left, right) = (folder.path().join("left.mcap"), folder.path().join("right.mcap"));
    write_bag(&left, Compression::Zstd, &[10, 40, 30, 50]);
    write_bag(&right, Compression::None, &[10, 20, 45]);
    let mut reader = BagReader::open(&[left, right]).unwrap();
    assert_eq!(reader.channels().len(), 2);
    let mut order = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        order.push((message.log_time.0, message.channel.input));
    }
    assert_eq!(order, [(10, 0), (10, 1), (20, 1), (40, 0), (30, 0), (45, 1), (50, 0)]);
}

#[test]
fn parts_of_a_split_bag_are_read_one_after_the_other_and_share_channels() {
    let folder = tempfile::tempdir().unwrap();
    let split = folder.path().join("split");
    fs::create_dir(&split).unwrap();
    for (name, times) in [("s_10.mcap", [7, 8]), ("s_9.mcap", [5, 6]), ("s_8.mcap", [3, 4])] {
        write_bag(&split.join(name), Compression::Zstd, &times);
    }
    let mut reader = open(&split).unwrap();
    assert_eq!(times(&mut reader), [3, 4, 5, 6, 7, 8]);
    assert_eq!(reader.channels().len(), 1);
    assert!(reader.notes()[0].contains("s_8.mcap to s_10.mcap follow one another"), "{:?}", reader.notes());

    // A listing says which files count; time says in which order.
    let listing = "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  relative_file_paths:\n    \
                   - s_10.mcap\n    - split/s_8.mcap\n";
    fs::write(split.join("metadata.yaml"), listing).unwrap();
    let mut reader = open(&split).unwrap();
    assert_eq!(times(&mut reader), [3, 4, 7, 8]);
    assert!(reader.notes().is_empty() && reader.losses().is_empty());
}

#[test]
fn files_of_one_folder_are_one_recording_only_where_they_go_on_from_each_other() {
    const S: i64 = 1_000_000_000;
    let is_one = |parts: &[(&str, [i64; 2])]| {
        let folder = tempfile::tempdir().unwrap();
        for (name, times) in parts {
            write_bag(&folder.path().join(name), Compression::Zstd, times);
        }
        let found = recordings_at(folder.path()).unwrap();
        let itself = found.paths == [folder.path()];
        match open(folder.path()) {
            Ok(_) => assert!(itself),
            Err(BagError::Several { names, .. }) => {
                assert_eq!(found.paths, names.iter().map(|name| folder.path().join(name)).collect::<Vec<_>>());
                let note = found.note.unwrap();
                assert!(note.contains(&format!("{} recordings, each by itself: ", names.len())), "{note}");
            }
            Err(error) => panic!("{error}"),
        }
        itself
    };
    assert!(is_one(&[("a_0.mcap", [0, S]), ("a_1.mcap", [2 * S, 3 * S])]), "a second between two messages");
    assert!(is_one(&[("only.mcap", [0, S])]));
    assert!(!is_one(&[("a_0.mcap", [0, S]), ("a_1.mcap", [2 * S + 1, 3 * S])]), "a pause: two takes");
    assert!(!is_one(&[("a_0.mcap", [0, S]), ("a_1.mcap", [S - 1, 3 * S])]), "at the same time: two recorders");
    assert!(!is_one(&[("a_0.mcap", [0, 1]), ("a_2.mcap", [2, 3])]), "a part is missing");
    assert!(!is_one(&[("a_0.mcap", [0, 1]), ("b_1.mcap", [2, 3])]));
    assert!(!is_one(&[("monday.mcap", [0, 1]), ("tuesday.mcap", [2, 3])]));
}

#[test]
fn a_folder_of_several_recordings_is_never_one() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["monday.mcap", "tuesday.mcap", ".hidden.mcap", "._monday.mcap"] {
        write_bag(&folder.path().join(name), Compression::Zstd, &[1]);
    }
    fs::create_dir(folder.path().join("more")).unwrap();
    write_bag(&folder.path().join("more/wednesday"), Compression::Zstd, &[1]);
    write_bag(&folder.path().join("thursday"), Compression::Zstd, &[1]);
    let found = recordings_at(folder.path()).unwrap();
    let names: Vec<_> = found.paths.iter().map(|path| path.strip_prefix(folder.path()).unwrap().to_owned()).collect();
    assert_eq!(names, ["monday.mcap", "tuesday.mcap", "thursday"].map(PathBuf::from));
    let refused = refusal(folder.path());
    assert!(refused.ends_with(
        "holds 2 recordings, monday.mcap, tuesday.mcap: name the one that is meant, or the files of a split one, each with its folder"
    ));
    fs::remove_file(folder.path().join("tuesday.mcap")).unwrap();
    assert_eq!(times(&mut open(folder.path()).unwrap()), [1], "a hidden file is no part");
}

/// Messages on `/a`, then those on `/b`, each topic in chunks of its own.
fn write_by_topic(out: &Path, a: &[i64], b: &[i64]) {
    let mut writer = BagWriter::create(out, WriteOptions::default()).unwrap();
    for (channel, times) in [(A, a), (B, b)] {
        let channel = writer.add_channel(channel).unwrap();
        for &time in times {
            writer.write(channel, 0, Stamp(time), Stamp(time), &time.to_le_bytes()).unwrap();
        }
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn a_file_written_topic_by_topic_comes_in_the_order_of_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("by_topic.mcap");
    let (a, b): (Vec<i64>, Vec<i64>) =
        ((0..500).map(|k| 10 * k).collect(), (0..500).map(|k| 10 * k + 3 * (k % 2)).collect());
    write_by_topic(&path, &a, &b);
    let mut reader = open(&path).unwrap();
    let (mut order, mut read) = (Vec::new(), 0);
    while let Some(message) = reader.next_message().unwrap() {
        assert_eq!(message.data, message.log_time.0.to_le_bytes());
        order.push((message.log_time.0, message.channel.topic.clone()));
        assert!(reader.bytes_read() >= read, "progress goes back");
        read = reader.bytes_read();
    }
    let mut expected: Vec<_> = a.iter().map(|&time| (time, "/a".to_owned())).collect();
    expected.extend(b.iter().map(|&time| (time, "/b".to_owned())));
    expected.sort();
    assert_eq!(order, expected, "of equal times the first in the file goes first");
    assert!(reader.losses().is_empty(), "{:?}", reader.losses());
    // Who looks at the file sees it as it stands.
    let mut reader = BagReader::open_as_written(&[path]).unwrap();
    assert_eq!(times(&mut reader), [a, b].concat());
}

#[test]
fn parts_listed_in_reverse_and_parts_of_one_topic_each_come_in_the_order_of_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for (name, times) in [("x.mcap", [50, 60]), ("y.mcap", [10, 90]), ("z.mcap", [20, 30])] {
        write_bag(&path.join(name), Compression::Zstd, &times);
    }
    let listing =
        "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths: [x.mcap, z.mcap, y.mcap]\n";
    fs::write(path.join("metadata.yaml"), listing).unwrap();
    let mut reader = open(path).unwrap();
    assert_eq!(times(&mut reader), [10, 20, 30, 50, 60, 90]);
    assert!(reader.losses().is_empty());
}

#[test]
fn what_cannot_be_put_in_the_order_of_time_is_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("by_topic.mcap");
    const MS: i64 = 1_000_000;
    let late = |b: [i64; 2]| {
        let _ = fs::remove_file(&path); // of the last call
        write_by_topic(&path, &[0, 300 * MS], &b.map(|ms| ms * MS));
        // Without its end there is no index.
        let bytes = fs::read(&path).unwrap();
        fs::remove_file(&path).unwrap();
        let data_end = bytes.windows(9).rposition(|window| window == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
        fs::write(&path, &bytes[..data_end]).unwrap();
        let mut reader = open(&path).unwrap();
        reader.watch_order(&["/a", "/b"]);
        assert_eq!(times(&mut reader).len(), 4);
        let losses = reader.losses().iter().map(|loss| loss.what.clone()).collect::<Vec<_>>();
        losses.into_iter().filter(|what| !what.contains("cut off")).collect::<Vec<_>>()
    };
    let said = late([50, 301]);
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].starts_with("1 messages stand behind later ones of other topics, by up to 0.250 s"), "{said:?}");
    assert!(said[0].ends_with("put the file in order with `mcap sort`"), "{said:?}");
    // What a recorder with several threads does is not worth a word.
    assert!(late([250, 301]).is_empty());
}

#[test]
fn empty_last_part_of_a_killed_recorder_is_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    write_bag(&folder.path().join("s_0.mcap"), Compression::Zstd, &[1, 2]);
    fs::write(folder.path().join("s_1.mcap"), b"").unwrap();
    let mut reader = open(folder.path()).unwrap();
    assert_eq!(times(&mut reader), [1, 2]);
    assert_eq!(reader.losses().len(), 1);
    assert!(reader.losses()[0].what.contains("it is empty"));
}

#[test]
fn what_is_no_bag_is_refused_by_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        refusal(&path)
    };
    assert!(at("a.db3", b"SQLite format 3\0....").contains("cut off"));
    assert!(at("metadata.yaml", b"rosbag2_bagfile_information:\n").contains("give the folder"));
    assert!(at("empty.mcap", b"").contains("empty"));
    assert!(at("text.mcap", "grüße an alle".as_bytes()).contains("text"));
    assert!(at("zeros.mcap", &[0; 100]).contains("zeros"));
    assert!(at("a.bag", b"#ROSBAG V2.0\n").contains("ROS 1"));
    assert!(at("a.mcap.zstd", &[0x28, 0xB5, 0x2F, 0xFD, 1]).contains("can't be unpacked"));
    assert!(at("noise.mcap", &[1, 200, 3]).contains("01 c8 03"));
    assert!(at("short.mcap", &mcap::MAGIC[..5]).contains("cut off after 5 bytes"));
    assert!(refusal(&folder.path().join("nowhere.mcap")).contains("not found"));
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    assert!(refusal(&empty).contains("no .mcap or .db3 file"));
    fs::write(empty.join("a.db3"), b"").unwrap();
    assert!(refusal(&empty).contains("it is empty"));
    let listing = |text: &str| {
        fs::write(empty.join("metadata.yaml"), format!("rosbag2_bagfile_information:\n{text}")).unwrap();
        refusal(&empty)
    };
    assert!(listing("  storage_identifier: rosbag_v2\n").contains("ros2 bag convert"));
    assert!(
        listing("  storage_identifier: mcap\n  compression_mode: MESSAGE\n  compression_format: lz4\n")
            .contains("compression_mode")
    );
    assert!(listing("  storage_identifier: mcap\n  relative_file_paths: [x.mcap]\n").contains("x.mcap"));
    assert!(listing("  - [\n").contains("no rosbag2 metadata"));
}

#[test]
fn ros1_profile_and_unknown_compression_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag_of(folder.path(), &[header("ros1"), end()]);
    assert!(refusal(&path).contains("profile \"ros1\""));
    let path = bag_of(folder.path(), &[header("ros2"), chunk("brotli", 0, 4, b"abcd"), end()]);
    assert!(refusal(&path).contains("\"brotli\""));
}

#[test]
fn one_file_given_twice_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write_bag(&path, Compression::Zstd, &[1]);
    let error = BagReader::open(&[path.clone(), folder.path().join(".").join("a.mcap")]).err().unwrap();
    assert!(matches!(error, BagError::DuplicateInput { .. }), "{error}");
}

#[test]
fn needed_topic_that_is_missing_or_not_cdr_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let parts = [header(""), channel("/plan", "json"), message(1, 5, b"{}"), end()];
    let mut reader = open(&bag_of(folder.path(), &parts)).unwrap();
    assert!(!reader.summary().lists_channels);
    reader.scan(&["/plan"]).unwrap();
    assert!(matches!(reader.required("/plan"), Err(BagError::Encoding { got, .. }) if got == "json"));
    let error = reader.required("/taxels").unwrap_err().to_string();
    assert_eq!(error, "topic /taxels is not in the bag; there are: /plan []");
    // Scanning has not moved the reader.
    assert_eq!(times(&mut reader), [5]);
}

#[test]
fn damaged_chunk_is_left_out_and_reading_goes_on_behind_it() {
    let folder = tempfile::tempdir().unwrap();
    let good = message(1, 1, &[0; 100]);
    let overrun = [message(1, 2, b"ok"), record(5, &[0; 22])[..20].to_vec()].concat();
    for (bad, n_read, said) in [
        (chunk("", 0, overrun.len() as u64, &overrun), vec![1, 2, 9], "past the end of its chunk"),
        (chunk("", 77, good.len() as u64, &good), vec![1, 1, 9], "checksum"),
        (chunk("zstd", 0, 500, &[1; 50]), vec![1, 9], "damaged"),
        (chunk("lz4", 0, 500, &[1; 50]), vec![1, 9], "damaged"),
    ] {
        let parts = [header("ros2"), channel("/a", "cdr"), good.clone(), bad, message(1, 9, b""), end()];
        let mut reader = open(&bag_of(folder.path(), &parts)).unwrap();
        assert_eq!(times(&mut reader), n_read, "{said}");
        assert_eq!(reader.losses().len(), 1, "{:?}", reader.losses());
        assert!(reader.losses()[0].what.contains(said), "{:?}", reader.losses());
    }
}

#[test]
fn chunk_that_was_never_closed_is_read_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    for (compression, n_expected) in [(None, 500), (Some(mcap::Compression::Zstd), 300)] {
        let options = mcap::WriteOptions::new().chunk_size(None).compression(compression).compression_threads(0);
        let mut writer = options.create(std::io::Cursor::new(Vec::new())).unwrap();
        let channel_id = writer.add_channel(0, "/a", "cdr", &Default::default()).unwrap();
        let mut noise = 1u32;
        for sequence in 0..500 {
            let header = mcap::records::MessageHeader { channel_id, sequence, log_time: 1, publish_time: 1 };
            // Noise, which zstd can't hold back in its window.
            let data: Vec<u8> = (0..2000)
                .map(|_| {
                    noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (noise >> 24) as u8
                })
                .collect();
            writer.write_to_known_channel(&header, &data).unwrap();
        }
        let bytes = writer.into_inner().into_inner();
        let mut reader = open(&bag_of(folder.path(), &[bytes])).unwrap();
        let n_read = times(&mut reader).len();
        assert!((n_expected..=500).contains(&n_read), "{compression:?}: {n_read}");
        assert!(reader.losses()[0].what.starts_with("cut off"), "{:?}", reader.losses());
    }
}

#[test]
fn huge_length_is_refused_without_reserving_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut huge = vec![5];
    huge.extend((1u64 << 62).to_le_bytes());
    let mut in_chunk = huge.clone();
    in_chunk.extend([0; 30]);
    let n = in_chunk.len() as u64;
    for bad in [huge, chunk("", 0, n, &in_chunk), chunk("zstd", 0, u64::MAX, &[0x28, 0xB5, 0x2F, 0xFD])] {
        let parts = [header("ros2"), channel("/a", "cdr"), message(1, 1, b""), bad];
        let mut reader = open(&bag_of(folder.path(), &parts)).unwrap();
        assert_eq!(times(&mut reader), [1]);
        assert!(!reader.losses().is_empty());
    }
}

#[test]
fn garbage_zeros_and_a_second_recording_behind_the_first_are_said() {
    let folder = tempfile::tempdir().unwrap();
    let start = [header("ros2"), channel("/a", "cdr"), message(1, 1, b"")].concat();
    for (tail, said) in [
        (vec![0; 500], "opcode 0x00"),
        (b"once upon a time".to_vec(), "opcode 0x6f"),
        ([end(), start.clone()].concat(), "behind the end"),
        (message(9, 4, b""), "channels that the file doesn't define"),
        (message(1, u64::MAX, b""), "no clock reaches"),
        (Vec::new(), "cut off at byte"),
    ] {
        let mut reader = open(&bag_of(folder.path(), &[start.clone(), tail])).unwrap();
        assert_eq!(times(&mut reader), [1]);
        let losses: Vec<String> = reader.losses().iter().map(ToString::to_string).collect();
        assert!(losses.iter().any(|loss| loss.contains(said)), "{losses:?}");
    }
}

#[test]
fn malformed_attachments_and_definitions_are_said_and_passed() {
    let folder = tempfile::tempdir().unwrap();
    for bad in [record(9, &[]), record(9, &[255; 40]), record(3, &[1]), record(4, &[9; 20]), record(12, &[255; 4])] {
        let parts = [header("ros2"), channel("/a", "cdr"), bad, message(1, 1, b""), end()];
        let mut reader = open(&bag_of(folder.path(), &parts)).unwrap();
        let mut n_records = 0;
        while reader.next_record().unwrap().is_some() {
            n_records += 1;
        }
        assert_eq!(n_records, 1);
        assert_eq!(reader.losses().len(), 1);
    }
}

#[test]
fn flood_of_losses_is_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let mut parts = vec![header("ros2")];
    parts.extend((0..5000).map(|_| record(3, &[1])));
    parts.push(end());
    let mut reader = open(&bag_of(folder.path(), &parts)).unwrap();
    assert!(times(&mut reader).is_empty());
    assert!(reader.losses().len() < 1000);
    assert!(reader.losses().last().unwrap().what.contains("4800 more"), "{:?}", reader.losses().last());
}

#[test]
fn changing_one_byte_anywhere_never_panics() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let path = folder.path().join("good.mcap");
        let _ = fs::remove_file(&path);
        write_bag(&path, compression, &[1, 2, 3]);
        let good = fs::read(&path).unwrap();
        // Changed in place: writing each file anew would take most of the time.
        let mut file = fs::File::options().write(true).open(&path).unwrap();
        let mut put = |at: usize, byte: u8| {
            file.seek(SeekFrom::Start(at as u64)).unwrap();
            file.write_all(&[byte]).unwrap();
        };
        for (at, byte) in good.into_iter().enumerate() {
            for change in [0x01, 0x80, 0xFF] {
                put(at, byte ^ change);
                if let Ok(mut reader) = open(&path) {
                    while let Ok(Some(_)) = reader.next_record() {}
                }
            }
            put(at, byte);
        }
    }
}

#[test]
fn file_cut_while_it_is_read_is_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let messages = (0..100).map(|time| message(1, time, &[0; 10_000]));
    let parts: Vec<_> = [header("ros2"), channel("/a", "cdr")].into_iter().chain(messages).chain([end()]).collect();
    let path = bag_of(folder.path(), &parts);
    let mut reader = open(&path).unwrap();
    assert!(reader.next_message().unwrap().is_some());
    fs::File::options().write(true).open(&path).unwrap().set_len(600_000).unwrap();
    let n_read = times(&mut reader).len();
    assert!(n_read < 99);
    assert!(reader.losses()[0].what.starts_with("cut off at byte 600000"), "{:?}", reader.losses());
}

#[test]
fn file_deleted_or_replaced_while_it_is_read_is_read_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    for replaced in [false, true] {
        let messages = (0..100).map(|time| message(1, time, &[0; 10_000]));
        let parts: Vec<_> = [header("ros2"), channel("/a", "cdr")].into_iter().chain(messages).chain([end()]).collect();
        let path = bag_of(folder.path(), &parts);
        let mut reader = open(&path).unwrap();
        assert!(reader.next_message().unwrap().is_some());
        if replaced {
            let other = folder.path().join("other.mcap");
            fs::write(&other, b"something else").unwrap();
            fs::rename(&other, &path).unwrap();
        } else {
            fs::remove_file(&path).unwrap();
        }
        assert_eq!((times(&mut reader).len(), reader.losses().len()), (99, 0), "replaced: {replaced}");
    }
}

#[test]
fn file_overwritten_while_it_is_read_is_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let messages = (0..100).map(|time| message(1, time, &[0; 10_000]));
    let parts: Vec<_> = [header("ros2"), channel("/a", "cdr")].into_iter().chain(messages).chain([end()]).collect();
    let path = bag_of(folder.path(), &parts);
    let mut reader = open(&path).unwrap();
    assert!(reader.next_message().unwrap().is_some());
    let len = fs::metadata(&path).unwrap().len();
    fs::write(&path, vec![0xAB; len as usize]).unwrap();
    assert!(times(&mut reader).len() < 99);
    assert!(!reader.losses().is_empty());
}

#[test]
fn file_that_goes_away_between_parts_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    write_bag(&folder.path().join("s_0.mcap"), Compression::Zstd, &[1]);
    write_bag(&folder.path().join("s_1.mcap"), Compression::Zstd, &[2]);
    let mut reader = open(folder.path()).unwrap();
    fs::remove_file(folder.path().join("s_1.mcap")).unwrap();
    assert!(reader.next_message().unwrap().is_some());
    assert!(matches!(reader.next_message(), Err(BagError::Io { .. })));
}

#[test]
fn attachments_and_metadata_come_with_records_and_not_with_messages() {
    let folder = tempfile::tempdir().unwrap();
    let attachment = [vec![7; 16], string("photo"), string("image/png"), vec![3, 0, 0, 0, 0, 0, 0, 0], b"png".to_vec()];
    let attachment = record(9, &[attachment.concat(), vec![0; 4]].concat());
    let notes = record(12, &[string("rig"), vec![0; 4]].concat());
    let parts =
        [header("ros2"), channel("/a", "cdr"), attachment, message(1, 1, b"x"), notes, message(1, 2, b""), end()];
    let path = bag_of(folder.path(), &parts);
    let mut reader = open(&path).unwrap();
    let mut seen = Vec::new();
    while let Some(record) = reader.next_record().unwrap() {
        seen.push(match record {
            BagRecord::Message(message) => format!("message {}", message.log_time.0),
            BagRecord::Attachment(file) => format!("{} {} {}", file.name, file.media_type, file.data.len()),
            BagRecord::Metadata(notes) => notes.name.to_owned(),
        });
    }
    assert_eq!(seen, ["photo image/png 3", "message 1", "rig", "message 2"]);
    assert_eq!(times(&mut open(&path).unwrap()), [1, 2]);
}

#[test]
fn channel_without_messages_is_known_from_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut writer = BagWriter::create(&path, WriteOptions::default()).unwrap();
    let a = writer.add_channel(A).unwrap();
    writer.add_channel(B).unwrap();
    writer.write(a, 0, Stamp(1), Stamp(1), b"").unwrap();
    writer.finish().unwrap();
    let reader = open(&path).unwrap();
    let topics: Vec<_> = reader.channels().iter().map(|channel| channel.topic.as_str()).collect();
    assert_eq!(topics, ["/a", "/b"]);
    assert_eq!(reader.required("/b").unwrap()[0].type_name(), "std_msgs/msg/UInt64");
}
