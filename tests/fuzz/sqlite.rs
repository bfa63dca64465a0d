//! Bags of rosbag2's sqlite3 storage, from bytes of a file to estimates.

use rusqlite::{Connection, params};
use tactile_pose_fusion::bag::BagReader;

use super::bag;
use super::driver::Target;
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "sqlite", seeds, mutate: other, run: bag::run, min_understood: 0.2 };

/// The recordings of the MCAP target, written again row by row, with small pages and with some that overflow.
fn seeds() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source.mcap");
    std::fs::write(&source, &bag::seeds()[0]).unwrap();
    [512, 4096]
        .map(|page| {
            let path = folder.path().join(format!("{page}.db3"));
            let file = Connection::open(&path).unwrap();
            file.execute_batch(&format!(
                "PRAGMA page_size = {page};
                CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
                CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
                CREATE INDEX timestamp_idx ON messages (timestamp ASC); BEGIN;"
            ))
            .unwrap();
            let mut reader = BagReader::open(std::slice::from_ref(&source)).unwrap();
            while let Some(message) = reader.next_message().unwrap() {
                let (id, channel) = (message.channel.id as i64, message.channel);
                let topic = "INSERT OR IGNORE INTO topics VALUES (?1, ?2, ?3, 'cdr')";
                file.execute(topic, params![id, channel.topic, channel.type_name()]).unwrap();
                let row = "INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)";
                file.execute(row, params![id, message.log_time.0, message.data]).unwrap();
            }
            file.execute_batch("COMMIT").unwrap();
            drop(file);
            std::fs::read(&path).unwrap()
        })
        .into()
}

/// A few bytes of a page, or a page in the place of another.
fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut input = seed.to_vec();
    if input.len() < 1024 || random.percent(15) {
        mutate::bytes(random, &mut input, other);
        return input;
    }
    for _ in 0..1 + random.below(3) {
        let n_pages = input.len() / 512;
        let (from, to) = (random.below(n_pages) * 512, random.below(n_pages) * 512);
        match random.below(5) {
            0 => input.copy_within(from..from + 512, to),
            // The head of a page and the places of its rows.
            1 | 2 => input[to + random.below(24)] = random.byte(),
            3 => input[to + random.below(512)] = random.byte(),
            _ => input[random.below(100)] = random.byte(),
        }
    }
    input
}
