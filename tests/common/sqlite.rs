//! Writes `.db3` bags as rosbag2 did before Jazzy.
#![allow(dead_code, unreachable_pub)]

use std::path::Path;

use rusqlite::{Connection, params};

use super::bags::{Recorded, messages};

/// The tables of a bag without definitions.
pub const TABLES: &str = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
     serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
     CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, \
     data BLOB NOT NULL);
     CREATE INDEX timestamp_idx ON messages (timestamp ASC);";

/// A recording written again as a `.db3` file, without definitions.
pub fn as_sqlite(source: &Path, path: &Path) {
    write_rows(&messages(source), path);
}

/// These messages as a `.db3` file.
pub fn write_rows(recorded: &[Recorded], path: &Path) {
    let bag = Connection::open(path).unwrap();
    bag.execute_batch(TABLES).unwrap();
    bag.execute_batch("BEGIN").unwrap();
    let mut topics: Vec<String> = Vec::new();
    for Recorded { topic, type_name, log_time, data } in recorded {
        let id = topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            let insert = "INSERT INTO topics VALUES (?1, ?2, ?3, 'cdr', '')";
            bag.execute(insert, params![topics.len() as i64, topic, type_name]).unwrap();
            topics.push(topic.clone());
            topics.len() - 1
        });
        bag.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?1, ?2, ?3)",
            params![id as i64, log_time.0, data],
        )
        .unwrap();
    }
    bag.execute_batch("COMMIT").unwrap();
}
