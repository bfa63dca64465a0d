//! Memory stays bounded however large a chunk is, or however many rows are put in order. Alone in their file, one at a time: the
//! peak is that of the whole process.

#[path = "common/root.rs"]
mod root;
#[path = "common/skip.rs"]
mod skip;

use std::fs;
use std::io::BufWriter;
use std::sync::Mutex;

use tactile_pose_fusion::bag::BagReader;

const MESSAGE_LEN: usize = 1 << 20;
const N_MESSAGES: u32 = 300;

/// One test at a time.
static ALONE: Mutex<()> = Mutex::new(());

/// Most memory that this process ever had, in bytes; `None` where the system doesn't say.
fn peak_memory() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? << 10)
}

#[test]
fn chunk_larger_than_memory_should_be_is_streamed() {
    let _alone = ALONE.lock().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one_chunk.mcap");
    let file = BufWriter::new(fs::File::create(&path).unwrap());
    let options = mcap::WriteOptions::new().profile("ros2").chunk_size(None).compression(Some(mcap::Compression::Zstd));
    let mut writer = options.create(file).unwrap();
    let channel = writer.add_channel(0, "/a", "cdr", &Default::default()).unwrap();
    let data = vec![7; MESSAGE_LEN];
    for sequence in 0..N_MESSAGES {
        let header = mcap::records::MessageHeader { channel_id: channel, sequence, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);

    let Some(before) = peak_memory() else {
        skip::skipped("/proc/self/status is not here");
        return;
    };
    let mut reader = BagReader::open(&[path]).unwrap();
    let mut n_messages = 0;
    while let Some(message) = reader.next_message().unwrap() {
        assert_eq!(message.data.len(), MESSAGE_LEN);
        n_messages += 1;
    }
    assert_eq!((n_messages, reader.losses().len()), (N_MESSAGES, 0));
    let grown = peak_memory().unwrap_or(before) - before;
    // A message twice, the compressor's window and buffers: 300 MB would show that the chunk was held.
    assert!(grown < 30 << 20, "grew by {grown} bytes");
}

#[test]
fn rows_of_a_long_db3_bag_are_put_in_order_outside_of_memory() {
    const N_ROWS: i64 = 2_000_000;
    let _alone = ALONE.lock().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("by_topic.db3");
    let bag = rusqlite::Connection::open(&path).unwrap();
    // Half of the rows are of one topic, the other half of another at the times between.
    let rows = format!(
        "PRAGMA synchronous = OFF; PRAGMA journal_mode = OFF;
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
        INSERT INTO topics VALUES (0, '/a', 'std_msgs/msg/Empty', 'cdr'), (1, '/b', 'std_msgs/msg/Empty', 'cdr');
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
        INSERT INTO messages WITH RECURSIVE r(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM r WHERE n < {N_ROWS} - 1)
            SELECT n, n * 2 / {N_ROWS}, n * 2 % {N_ROWS} + n * 2 / {N_ROWS}, x'0001000000' FROM r;"
    );
    bag.execute_batch(&rows).unwrap();
    drop(bag);

    let Some(before) = peak_memory() else {
        skip::skipped("/proc/self/status is not here");
        return;
    };
    let mut reader = BagReader::open(&[path]).unwrap();
    let mut n_messages = 0;
    while let Some(message) = reader.next_message().unwrap() {
        assert_eq!(message.log_time.0, n_messages);
        n_messages += 1;
    }
    assert_eq!((n_messages, reader.losses().len()), (N_ROWS, 0));
    let grown = peak_memory().unwrap_or(before) - before;
    // Pages of the file and of the order, 4 MiB each, and a batch of messages: 2 million rows would take 32 MB and more.
    assert!(grown < 24 << 20, "grew by {grown} bytes");
}
