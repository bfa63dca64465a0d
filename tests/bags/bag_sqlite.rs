//! rosbag2's `.db3` bags read as MCAP does, and whatever is wrong with one is said in a line.

use crate::common;

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::bags::{Recorded, messages, write_session};
use common::onnx::LinearModel;
use common::sqlite::{TABLES, as_sqlite, write_rows};
use common::tpf::{Run, tpf, write_params};
use rusqlite::{Connection, params};
use sha2::{Digest as _, Sha256};
use tactile_pose_fusion::bag::{BagError, BagReader, recordings_at};

/// A bag as Humble records it, without definitions: `rows` are of topics `/a`, `/b` and so on, with their times.
fn humble(path: &Path, rows: &[(i64, i64)]) -> Connection {
    let bag = Connection::open(path).unwrap();
    bag.execute_batch(TABLES).unwrap();
    for (id, name) in [(1, "/a"), (2, "/b")] {
        let insert = "INSERT INTO topics VALUES (?1, ?2, 'std_msgs/msg/Float32MultiArray', 'cdr', '')";
        bag.execute(insert, params![id, name]).unwrap();
    }
    for (n, (topic, time)) in rows.iter().enumerate() {
        let data = [&[0, 1, 0, 0][..], &n.to_le_bytes()].concat();
        bag.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)", params![topic, time, data])
            .unwrap();
    }
    bag
}

type TopicsAndLosses = (Vec<(String, i64)>, Vec<String>);

/// Topics and times of what is read, with the losses.
fn read(path: &Path) -> Result<TopicsAndLosses, BagError> {
    let mut reader = BagReader::open(&[path.to_path_buf()])?;
    let mut found = Vec::new();
    while let Some(message) = reader.next_message()? {
        found.push((message.channel.topic.clone(), message.log_time.0));
    }
    Ok((found, reader.losses().iter().map(ToString::to_string).collect()))
}

fn refusal(path: &Path) -> String {
    let line = read(path).unwrap_err().to_string();
    assert!(!line.chars().any(char::is_control), "{line:?}");
    line
}

fn told(recorded: &[Recorded]) -> Vec<(String, String, i64, String)> {
    let digest = |data: &[u8]| {
        Sha256::digest(data).iter().fold(String::new(), |mut text, byte| {
            write!(text, "{byte:02x}").unwrap();
            text
        })
    };
    recorded
        .iter()
        .map(|message| (message.topic.clone(), message.type_name.clone(), message.log_time.0, digest(&message.data)))
        .collect()
}

#[test]
fn a_db3_bag_replays_to_the_same_bytes_as_the_same_data_in_mcap() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(&folder.join("session.mcap"), 8);
    as_sqlite(&folder.join("session.mcap"), &folder.join("same.db3"));
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    write_params(folder, 2, &["dip"], "");
    let replay = |bag: &str, out: &str, more: &[&str]| {
        let args = ["replay", bag, "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", out];
        tpf(folder, &[&args[..], more].concat()).ok();
    };
    replay("session.mcap", "a.mcap", &[]);
    replay("same.db3", "b.mcap", &[]);
    assert!(messages(&folder.join("a.mcap")).len() > 400);
    assert_eq!(fs::read(folder.join("a.mcap")).unwrap(), fs::read(folder.join("b.mcap")).unwrap());
    replay("session.mcap", "merged_a.mcap", &["--merge"]);
    replay("same.db3", "merged_b.mcap", &["--merge"]);
    let [a, b] = ["merged_a.mcap", "merged_b.mcap"].map(|name| messages(&folder.join(name)));
    assert_eq!(a, b);
    let inspected = tpf(folder, &["inspect", "same.db3"]).ok();
    assert!(inspected.stdout.contains("/taxels"), "{}", inspected.stdout);
    // Split: parts plain or packed, listed or not.
    let session = messages(&folder.join("session.mcap"));
    let parts: Vec<_> = session.chunks(session.len() / 3 + 1).collect();
    for (name, is_packed, is_listed) in [("split", false, false), ("listed", false, true), ("packed", true, true)] {
        fs::create_dir(folder.join(name)).unwrap();
        let mut listed = String::new();
        for (n, part) in parts.iter().enumerate() {
            let path = folder.join(format!("{name}/{name}_{n}.db3"));
            write_rows(part, &path);
            listed += &format!("    - {name}_{n}.db3{}\n", if is_packed { ".zstd" } else { "" });
            if is_packed {
                fs::write(path.with_extension("db3.zstd"), zstd::encode_all(&fs::read(&path).unwrap()[..], 1).unwrap())
                    .unwrap();
                fs::remove_file(path).unwrap();
            }
        }
        if is_listed {
            let mode = if is_packed { "  compression_mode: FILE\n  compression_format: zstd\n" } else { "" };
            let listing = format!(
                "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n{mode}  relative_file_paths:\n{listed}"
            );
            fs::write(folder.join(name).join("metadata.yaml"), listing).unwrap();
        }
        replay(name, &format!("{name}.mcap"), &[]);
        let [a, b] = ["a.mcap", &format!("{name}.mcap")].map(|name| fs::read(folder.join(name)).unwrap());
        assert!(a == b, "{name}");
    }
    // A part that is missing is never passed over.
    fs::remove_file(folder.join("listed/listed_1.db3")).unwrap();
    fs::remove_file(folder.join("split/split_1.db3")).unwrap();
    let failed = |bag: &str| {
        let run =
            tpf(folder, &["replay", bag, "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", "x.mcap"]);
        run.failure().to_owned()
    };
    assert!(failed("listed").contains("lists listed_1.db3, which is not there"));
    assert!(failed("split").contains("holds 2 recordings"));
    let left: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!left.iter().any(|name| name.to_string_lossy().contains("-journal")), "{left:?}");
}

#[test]
fn every_form_that_rosbags_writes_reads_as_rosbags_reads_it() {
    let Some(python) = common::python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(&folder.join("session.mcap"), 6);
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    write_params(folder, 2, &["dip"], "");
    let replayed = |bag: &Path| {
        let args = ["replay", bag.to_str().unwrap(), "--params-file", "params.yaml", "--calibrate-first", "3.13"];
        tpf(folder, &[&args[..], &["--overwrite", "-o", "out.mcap"]].concat()).ok();
        fs::read(folder.join("out.mcap")).unwrap()
    };
    let expected = replayed(&folder.join("session.mcap"));
    assert!(messages(&folder.join("out.mcap")).len() > 300);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/sqlite_bags.py");
    let bags = folder.join("bags");
    fs::create_dir(&bags).unwrap();
    let output = Command::new(python).arg(script).arg(folder.join("session.mcap")).arg(&bags).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let session = messages(&folder.join("session.mcap"));
    let mut n_bags = 0;
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        type Line = (String, Vec<(String, String, i64, String)>);
        let (name, theirs): Line = serde_json::from_str(line).unwrap();
        let ours = messages(&bags.join(&name));
        assert_eq!(told(&ours), theirs, "{name}");
        assert_eq!(ours, session, "{name}");
        assert!(replayed(&bags.join(&name)) == expected, "{name}");
        // Without metadata.yaml, and the file alone.
        fs::remove_file(bags.join(&name).join("metadata.yaml")).unwrap();
        assert_eq!(messages(&bags.join(&name)), session, "{name}");
        let file = fs::read_dir(bags.join(&name)).unwrap().next().unwrap().unwrap().path();
        assert_eq!(messages(&file), session, "{}", file.display());
        assert_eq!(recordings_at(&bags.join(&name)).unwrap().paths, [bags.join(&name)]);
        n_bags += 1;
    }
    assert_eq!(n_bags, 8);
}

#[test]
fn recorded_db3_bags_have_the_messages_that_their_metadata_states() {
    let Some(shared) = common::shared() else { return };
    let root = shared.join("data/mcap_rosbag2_resources");
    let mut folders = vec![root];
    let mut n_read = 0;
    while let Some(folder) = folders.pop() {
        folders.extend(fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()));
        let Ok(stated) = fs::read_to_string(folder.join("metadata.yaml")) else { continue };
        if !stated.contains("storage_identifier: sqlite3") {
            continue;
        }
        let (found, losses) = read(&folder).unwrap();
        assert!(losses.is_empty(), "{losses:?}");
        assert!(stated.contains(&format!("\n  message_count: {}\n", found.len())), "{}", folder.display());
        assert!(found.is_sorted_by_key(|(_, time)| *time), "{}", folder.display());
        n_read += 1;
    }
    assert!(n_read > 3, "{n_read}");
}

#[test]
fn rows_come_in_the_order_of_time_unless_the_clock_was_set() {
    let folder = tempfile::tempdir().unwrap();
    let times = |rows: &[(i64, i64)], name: &str| -> Vec<i64> {
        let path = folder.path().join(name);
        humble(&path, rows);
        read(&path).unwrap().0.into_iter().map(|(_, time)| time).collect()
    };
    assert_eq!(times(&[(1, 10), (2, 30), (1, 20), (2, 40)], "late.db3"), [10, 20, 30, 40]);
    assert_eq!(times(&[(1, 10), (1, 30), (1, 20), (2, 15)], "set.db3"), [10, 30, 20, 15]);
    let by_topic: Vec<(i64, i64)> =
        (0..20_000).map(|k| (1, k * 2)).chain((0..20_000).map(|k| (2, k * 2 + 1))).collect();
    let path = folder.path().join("by_topic.db3");
    let bag = humble(&path, &[]);
    bag.execute_batch("BEGIN").unwrap();
    for (topic, time) in by_topic {
        bag.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, zeroblob(200))",
            params![topic, time],
        )
        .unwrap();
    }
    bag.execute_batch("COMMIT").unwrap();
    let (found, losses) = read(&path).unwrap();
    assert_eq!((found.len(), losses.len()), (40_000, 0));
    assert!(found.iter().enumerate().all(|(n, (_, time))| *time == n as i64));
}

#[test]
fn what_is_no_message_is_counted_and_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("odd.db3");
    let bag = humble(&path, &[(1, 10), (1, -5), (9, 20), (2, 30)]);
    bag.execute_batch(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 40, 'text'), (1, 'noon', x'00'), (2, 50, x'28b52ffd00');",
    )
    .unwrap();
    drop(bag);
    let (found, losses) = read(&path).unwrap();
    assert_eq!(found, [("/a".to_owned(), 10), ("/b".to_owned(), 30)]);
    for part in ["before 1970", "doesn't define", "no blob", "no whole number", "packed with zstd and lost"] {
        assert_eq!(losses.iter().filter(|loss| loss.contains(part)).count(), 1, "{part}: {losses:?}");
    }
}

#[test]
fn what_a_recorder_left_beside_the_bag_is_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    drop(humble(&path, &[(1, 10)]));
    fs::write(folder.path().join("bag.db3-wal"), b"frames").unwrap();
    let (found, losses) = read(&path).unwrap();
    assert_eq!((found.len(), losses.len()), (1, 1), "{losses:?}");
    assert!(losses[0].contains("bag.db3-wal beside it") && losses[0].contains("PRAGMA journal_mode"), "{losses:?}");
}

#[test]
fn the_command_for_a_bag_that_was_not_ended_gives_the_whole_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    // What a recorder of the preset `resilient` leaves when it is killed: even the tables are in the log.
    let killed = folder.path().join("killed.db3");
    let recorder = Connection::open(&killed).unwrap();
    recorder.query_row("PRAGMA journal_mode = WAL", [], |_| Ok(())).unwrap();
    recorder.execute_batch(TABLES).unwrap();
    recorder.execute_batch("INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/Empty', 'cdr', '')").unwrap();
    recorder.execute_batch("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 10, x'00010000')").unwrap();
    fs::copy(&killed, &path).unwrap();
    fs::copy(folder.path().join("killed.db3-wal"), folder.path().join("bag.db3-wal")).unwrap();
    drop(recorder);
    let line = refusal(&path);
    assert!(line.contains("bag.db3-wal beside it"), "{line}");
    Connection::open(&path).unwrap().query_row("PRAGMA journal_mode=DELETE", [], |_| Ok(())).unwrap();
    assert_eq!(read(&path).unwrap(), (vec![("/a".to_owned(), 10)], vec![]));
}

#[test]
fn a_bag_that_is_written_to_while_it_is_read_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    let recorder = humble(&path, &[(1, 10), (1, 20)]);
    let mut reader = BagReader::open(&[path]).unwrap();
    assert!(reader.next_message().unwrap().is_some());
    recorder.execute_batch("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 30, zeroblob(100000))").unwrap();
    while reader.next_message().unwrap().is_some() {}
    let losses: Vec<String> = reader.losses().iter().map(ToString::to_string).collect();
    assert!(losses.iter().any(|loss| loss.contains("written to while it was read")), "{losses:?}");
}

#[test]
fn an_index_that_lies_hides_no_message() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.db3");
    drop(humble(&path, &[(1, 10), (2, 20)]));
    // The index is put away while rows are added, so that it doesn't know them.
    let without_index = "PRAGMA writable_schema = ON;
        CREATE TABLE away AS SELECT * FROM sqlite_schema WHERE name = 'timestamp_idx';
        DELETE FROM sqlite_schema WHERE name = 'timestamp_idx';";
    Connection::open(&path).unwrap().execute_batch(without_index).unwrap();
    let more = "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 40, x'00'), (2, 30, x'00');
        PRAGMA writable_schema = ON; INSERT INTO sqlite_schema SELECT * FROM away; DROP TABLE away;";
    Connection::open(&path).unwrap().execute_batch(more).unwrap();
    let reader = BagReader::open(std::slice::from_ref(&path)).unwrap();
    assert_eq!(reader.summary().n_messages, Some(2), "the index is asked");
    let (found, _) = read(&path).unwrap();
    assert_eq!(found.iter().map(|(_, time)| *time).collect::<Vec<_>>(), [10, 20, 40, 30]);
}

#[test]
fn a_type_that_the_bag_does_not_define_is_one_that_is_installed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(&folder.join("session.mcap"), 5);
    let mut recorded = messages(&folder.join("session.mcap"));
    for message in recorded.iter_mut().filter(|message| message.topic == "/taxels") {
        message.type_name = "glove_msgs/msg/Raw".to_owned();
    }
    write_rows(&recorded, &folder.join("humble.db3"));
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    let source = "    tactile.glove.type: glove_msgs/msg/Raw\n    tactile.glove.field: values\n    tactile.glove.stamp: header.stamp\n";
    let run = |ament: &str, out: &str| {
        let args = ["replay", "humble.db3", "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", out];
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        Run::from(command.current_dir(folder).env("AMENT_PREFIX_PATH", ament).args(args).output().unwrap())
    };
    write_params(folder, 2, &["dip"], source);
    let refused = run("/nowhere", "x.mcap");
    let line = refused.failure();
    for part in ["topic /taxels", "glove_msgs/msg/Raw", "in /nowhere/share", "message_definitions", "AMENT_PREFIX_PATH"]
    {
        assert!(line.contains(part), "{part}: {line}");
    }
    let package = folder.join("prefix/share/glove_msgs/msg");
    fs::create_dir_all(&package).unwrap();
    let text = "std_msgs/Header header\nuint32 sequence\nuint32 rows\nbuiltin_interfaces/Duration row_period\nfloat32[] values\n";
    fs::write(package.join("Raw.msg"), text).unwrap();
    run(folder.join("prefix").to_str().unwrap(), "installed.mcap").ok();
    write_params(folder, 2, &["dip"], &format!("{source}    message_definitions: prefix/share\n"));
    run("", "folder.mcap").ok();
    assert!(messages(&folder.join("folder.mcap")).len() > 150);
    let [a, b] = ["installed.mcap", "folder.mcap"].map(|name| fs::read(folder.join(name)).unwrap());
    assert!(a == b);
    // What a definition is made of is needed too.
    fs::write(package.join("Raw.msg"), text.replace("float32[] values", "Patch[] patches\nfloat32[] values")).unwrap();
    let refused = run("", "x.mcap");
    assert!(
        refused.failure().contains("glove_msgs/msg/Raw uses glove_msgs/msg/Patch, which is not defined"),
        "{refused:?}"
    );
    fs::write(package.join("Raw.msg"), text).unwrap();
    // A recorder of MCAP that found no definition leaves an empty one; a message without fields is defined by an empty text.
    let file = fs::File::create(folder.join("humble.mcap")).unwrap();
    let mut writer = mcap::WriteOptions::new().profile("ros2").create(file).unwrap();
    for (name, encoding) in
        [("glove_msgs/msg/Raw", ""), ("glove_msgs/msg/Raw", "unknown"), ("a_msgs/msg/None", "ros2msg")]
    {
        let schema = writer.add_schema(name, encoding, b"").unwrap();
        writer.add_channel(schema, &format!("/{}", schema), "cdr", &Default::default()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let mut reader = BagReader::open(&[folder.join("humble.mcap")]).unwrap();
    let lengths = |reader: &BagReader| -> Vec<usize> {
        reader.channels().iter().map(|channel| channel.schema.as_ref().unwrap().data.len()).collect()
    };
    assert_eq!(lengths(&reader), [0, 0, 0]);
    reader.look_for_definitions_in(&folder.join("prefix/share")).unwrap();
    let found = lengths(&reader);
    assert!(found[0] > 100 && found[1] == found[0] && found[2] == 0, "{found:?}");
    for channel in reader.channels() {
        channel.schema.as_ref().unwrap().tree(reader.definitions()).unwrap();
    }
    let inspect = |more: &[&str]| tpf(folder, &[&["inspect", "humble.db3"], more].concat()).ok().stdout;
    assert!(inspect(&[]).contains("the bag has no definition of its type: glove_msgs/msg/Raw"), "{}", inspect(&[]));
    assert!(!inspect(&["--message-definitions", "prefix/share"]).contains("no definition"));
}

#[test]
fn hostile_files_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    let whole = at("whole.db3");
    drop(humble(&whole, &[(1, 10), (2, 20)]));
    let bytes = fs::read(&whole).unwrap();
    for len in [1, 16, 20, 99, 100, 512, bytes.len() - 1] {
        fs::write(at("cut.db3"), &bytes[..len]).unwrap();
        let line = refusal(&at("cut.db3"));
        assert!(line.contains("cut off"), "{len}: {line}");
    }
    let made = |name: &str, sql: &str| {
        Connection::open(at(name)).unwrap().execute_batch(sql).unwrap();
        refusal(&at(name))
    };
    assert!(made("none.db3", "CREATE TABLE x(y)").contains("no table topics"));
    assert!(
        made("half.db3", "CREATE TABLE topics(id, name, type, serialization_format)").contains("no table messages")
    );
    let topics = "CREATE TABLE topics(id, name, type, serialization_format);";
    let endless = format!(
        "{topics} CREATE VIEW messages AS WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n FROM r) SELECT n AS topic_id, n AS timestamp, n AS data FROM r"
    );
    assert!(made("view.db3", &endless).contains("no table messages"));
    let computed = format!("{topics} CREATE TABLE messages(topic_id, timestamp, data AS (zeroblob(900000000)))");
    assert!(made("computed.db3", &computed).contains("no column data"));
    let without_rowid =
        format!("{topics} CREATE TABLE messages(id PRIMARY KEY, topic_id, timestamp, data) WITHOUT ROWID");
    assert!(made("rowid.db3", &without_rowid).contains("rowid"));
    fs::write(at("one.bag"), b"#ROSBAG V2.0\n").unwrap();
    let line = refusal(&at("one.bag"));
    assert!(line.contains("`pip install rosbags`") && line.contains("--dst-storage mcap"), "{line}");
    fs::create_dir(at("folder")).unwrap();
    fs::write(at("folder/metadata.yaml"), "rosbag2_bagfile_information: [").unwrap();
    assert!(refusal(&at("folder")).contains("no rosbag2 metadata"));
}

#[test]
fn any_byte_may_be_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.db3");
    let rows: Vec<(i64, i64)> = (0..300).map(|k| (1 + k % 2, k)).collect();
    drop(humble(&path, &rows));
    let bytes = fs::read(&path).unwrap();
    let changed = folder.path().join("changed.db3");
    for k in 0..1500 {
        let mut bytes = bytes.clone();
        // The head and the pages' heads say most of what can go wrong.
        let at = if k % 2 == 0 { k / 2 % 120 } else { (k * 7919) % bytes.len() };
        bytes[at] = [0, 255, 128, 1, bytes[at].wrapping_add(1)][k % 5];
        fs::write(&changed, &bytes).unwrap();
        match read(&changed) {
            Ok((found, losses)) => {
                assert!(found.len() <= rows.len() + 300, "byte {at}: {}", found.len());
                assert!(losses.iter().all(|loss| !loss.chars().any(char::is_control)), "{losses:?}");
            }
            Err(error) => assert!(!error.to_string().chars().any(char::is_control), "{error}"),
        }
    }
}

#[test]
fn a_small_file_that_unpacks_without_end_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.db3.zstd");
    let zeros = std::io::Read::take(std::io::repeat(0), 400 << 20);
    fs::write(&path, zstd::stream::encode_all(zeros, 1).unwrap()).unwrap();
    assert!(fs::metadata(&path).unwrap().len() < 200 << 10);
    let line = refusal(&path);
    assert!(line.contains("unpack to more than") && line.contains("1000 times"), "{line}");
}

#[test]
fn a_million_topics_take_bounded_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("topics.db3");
    let bag = humble(&path, &[(1, 10)]);
    bag.execute_batch(
        "INSERT INTO topics WITH RECURSIVE r(n) AS (SELECT 10 UNION ALL SELECT n + 1 FROM r WHERE n < 1000000) SELECT n, '/t' || n, 'std_msgs/msg/Empty', 'cdr', '' FROM r",
    )
    .unwrap();
    drop(bag);
    let (found, losses) = read(&path).unwrap();
    assert_eq!(found.len(), 1);
    assert!(losses.iter().any(|loss| loss.contains("topics and definitions")), "{losses:?}");
}
