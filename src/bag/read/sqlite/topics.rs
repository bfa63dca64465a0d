//! Topics of a sqlite3 bag, with the definitions of their types.

use std::collections::BTreeMap;
use std::sync::Arc;

use rusqlite::Connection;

use crate::bag::read::channels::{BagChannel, BagSchema, ChannelTable, MAX_DEFINITION_BYTES};

/// Memory of a channel besides its texts.
const CHANNEL_BYTES: usize = 512;

/// The longest text of a topic or definition that is read.
const MAX_TEXT: usize = 16 << 20;

/// Places in the table of channels by the id of the topic; with what is wrong with them, for a person.
pub(super) fn read(
    bag: &Connection,
    input: usize,
    table: &mut ChannelTable,
) -> rusqlite::Result<(BTreeMap<i64, usize>, Option<String>)> {
    let mut bytes = 0;
    let mut schemas = recorded_schemas(bag, &mut bytes)?;
    let [qos, hash] = ["offered_qos_profiles", "type_description_hash"]
        .map(|column| if has_column(bag, "topics", column) { column } else { "''" });
    let mut statement = bag.prepare(&format!(
        "SELECT id, {}, {}, {}, {}, {} FROM main.topics NOT INDEXED ORDER BY rowid",
        text("name"),
        text("type"),
        text("serialization_format"),
        text(qos),
        text(hash)
    ))?;
    let mut rows = statement.query([])?;
    let mut channels = BTreeMap::new();
    let (mut n_read, mut n_bad) = (0_u64, 0_u64);
    while let Some(row) = rows.next()? {
        n_read += 1;
        let texts: rusqlite::Result<[String; 5]> =
            (|| Ok([row.get(1)?, row.get(2)?, row.get(3)?, row.get(4)?, row.get(5)?]))();
        let (Ok(id), Ok([topic, type_name, message_encoding, qos, hash])) = (row.get::<_, i64>(0), texts) else {
            n_bad += 1;
            continue;
        };
        bytes += CHANNEL_BYTES + topic.len() + type_name.len() + qos.len() + hash.len();
        if bytes > MAX_DEFINITION_BYTES {
            let what = format!(
                "more than {MAX_DEFINITION_BYTES} bytes of topics and definitions: those behind topic {n_read} are not read"
            );
            return Ok((channels, Some(what)));
        }
        let schema = schemas.entry(type_name.clone()).or_insert_with(|| {
            // Before Jazzy a bag has no definitions.
            Arc::new(BagSchema { name: type_name, encoding: String::new(), data: Vec::new() })
        });
        let notes = [("offered_qos_profiles", qos), ("topic_type_hash", hash)];
        let metadata = notes.into_iter().filter(|(_, note)| !note.is_empty());
        let metadata = metadata.map(|(name, note)| (name.to_owned(), note)).collect();
        let schema = Some(Arc::clone(schema));
        channels.insert(id, table.intern(BagChannel { id: 0, input, topic, message_encoding, schema, metadata }));
    }
    let complaint = (n_bad > 0).then(|| format!("{n_bad} of {n_read} topics are malformed and not read"));
    Ok((channels, complaint))
}

/// Definitions that the bag holds, from Jazzy on.
fn recorded_schemas(bag: &Connection, bytes: &mut usize) -> rusqlite::Result<BTreeMap<String, Arc<BagSchema>>> {
    let mut schemas = BTreeMap::new();
    let columns = ["topic_type", "encoding", "encoded_message_definition"];
    if super::check_table(bag, "message_definitions", &columns).is_err() {
        return Ok(schemas);
    }
    let [name, encoding, definition] = columns.map(text);
    let mut statement = bag.prepare(&format!(
        "SELECT {name}, {encoding}, {definition} FROM main.message_definitions NOT INDEXED ORDER BY rowid"
    ))?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        let texts: rusqlite::Result<[String; 3]> = (|| Ok([row.get(0)?, row.get(1)?, row.get(2)?]))();
        // One that can't be read is as one that is not there.
        let Ok([name, encoding, data]) = texts else { continue };
        *bytes += CHANNEL_BYTES + name.len() + data.len();
        if *bytes > MAX_DEFINITION_BYTES {
            break;
        }
        let schema = BagSchema { name: name.clone(), encoding, data: data.into_bytes() };
        schemas.entry(name).or_insert_with(|| Arc::new(schema));
    }
    Ok(schemas)
}

/// A column as text that is not longer than [`MAX_TEXT`].
fn text(column: &str) -> String {
    format!("CASE WHEN octet_length({column}) <= {MAX_TEXT} THEN {column} END")
}

fn has_column(bag: &Connection, table: &str, column: &str) -> bool {
    super::check_table(bag, table, &[column]).is_ok()
}
