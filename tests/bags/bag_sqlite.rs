//! rosbag2's `.db3` bags read as MCAP does, and whatever is wrong with one is said in a line.

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};

use common::sqlite::TABLES;
use rusqlite::{Connection, params};
use tactile_pose_fusion::bag::{BagError, BagReader};

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
        common::write_anew(&changed, &bytes);
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
