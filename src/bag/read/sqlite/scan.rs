//! Summary of the rows of a file, without their data.

use std::collections::BTreeMap;
use std::path::Path;

use rusqlite::types::ValueRef;
use rusqlite::{Connection, OptionalExtension as _};

use super::{Trouble, connect, not_a_bag, out_of_order, topics};
use crate::bag::read::BagError;
use crate::bag::read::channels::ChannelTable;
use crate::bag::read::summary::{FileSummary, Statistics};
use crate::bag::read::unpacked::Unpacked;
use crate::units::Stamp;

/// Summary of a file; its channels are entered into `table`.
///
/// The index by time, which every recorder makes, tells whether rows stand in the order of time, and when the first and the
/// last came. It is small beside the rows, which are looked at one by one only where there is none, or where they don't stand in
/// that order. Counts are left out where the file is damaged.
pub(in crate::bag::read) fn summary(
    path: &Path,
    mut unpacked: Unpacked,
    input: usize,
    table: &mut ChannelTable,
) -> Result<FileSummary, BagError> {
    let bag = connect(path, &mut unpacked)?;
    let (channels, _) = topics::read(&bag, input, table).map_err(|error| not_a_bag(path, &error))?;
    let (statistics, by_time) = match by_index(&bag) {
        Ok(Some(statistics)) => (Some(statistics), false),
        Ok(None) | Err(_) => match by_row(&bag, &channels) {
            Ok((statistics, by_time)) => (Some(statistics), by_time),
            Err(_) => (None, false), // said when the messages are read
        },
    };
    Ok(FileSummary {
        statistics,
        unknown_compression: None,
        chunks: Vec::new(),
        notes: Vec::new(),
        is_indexed: false,
        by_time,
        definitions: None,
    })
}

/// Count and span by the index of times; `None` where there is no such index, or rows don't stand in the order of time.
///
/// An index may be wrong without that the rows are. Nothing is read by it: what it says is told to people, and messages that
/// come late are noticed when they are read.
fn by_index(bag: &Connection) -> Result<Option<Statistics>, Trouble> {
    let indexes =
        "SELECT i.name FROM pragma_index_list('messages', 'main') AS i, pragma_index_xinfo(i.name, 'main') AS c
        WHERE i.partial = 0 AND c.seqno = 0 AND c.name = 'timestamp' AND c.\"desc\" = 0";
    let name: Option<String> = bag.query_row(indexes, [], |row| row.get(0)).optional()?;
    let Some(name) = name else { return Ok(None) };
    let quoted = name.replace('"', "\"\"");
    let query = format!("SELECT timestamp, rowid FROM main.messages INDEXED BY \"{quoted}\" ORDER BY timestamp");
    let mut statement = bag.prepare(&query)?;
    let mut rows = statement.query([])?;
    let mut statistics = Statistics { n_messages: 0, span: None, by_channel: BTreeMap::new() };
    let mut last: Option<(i64, i64)> = None;
    while let Some(row) = rows.next()? {
        let ValueRef::Integer(time) = row.get_ref(0)? else { return Ok(None) };
        let number: i64 = row.get(1)?;
        // Ascending in both: the order of time, and an end, because a tree that leads back into itself repeats.
        if time < 0 || last.is_some_and(|(before, above)| time < before || number <= above) {
            return Ok(None);
        }
        last = Some((time, number));
        statistics.n_messages += 1;
        let first = statistics.span.map_or(Stamp(time), |(first, _)| first);
        statistics.span = Some((first, Stamp(time)));
    }
    Ok(Some(statistics))
}

/// Counts, and whether messages are to be put in the order of time: they don't stand in it, and no channel goes back by
/// itself, which would mean that the recorder's clock was set.
fn by_row(bag: &Connection, channels: &BTreeMap<i64, usize>) -> Result<(Statistics, bool), Trouble> {
    let mut statement =
        bag.prepare("SELECT rowid, topic_id, timestamp FROM main.messages NOT INDEXED ORDER BY rowid")?;
    let mut rows = statement.query([])?;
    let mut statistics = Statistics { n_messages: 0, span: None, by_channel: BTreeMap::new() };
    let (mut last_row, mut newest, mut in_order, mut clock_was_set) = (None, 0, true, false);
    let mut newest_of: BTreeMap<usize, i64> = BTreeMap::new();
    while let Some(row) = rows.next()? {
        let number: i64 = row.get(0)?;
        if last_row.is_some_and(|last| number <= last) {
            return Err(out_of_order());
        }
        last_row = Some(number);
        let (ValueRef::Integer(topic), ValueRef::Integer(time)) = (row.get_ref(1)?, row.get_ref(2)?) else { continue };
        let Some(&channel) = channels.get(&topic).filter(|_| time >= 0) else { continue };
        statistics.n_messages += 1;
        *statistics.by_channel.entry(channel).or_default() += 1;
        let stamp = Stamp(time);
        let (first, last) = statistics.span.unwrap_or((stamp, stamp));
        statistics.span = Some((first.min(stamp), last.max(stamp)));
        in_order &= time >= newest;
        newest = newest.max(time);
        let before = newest_of.insert(channel, time);
        clock_was_set |= before.is_some_and(|before| time < before);
    }
    Ok((statistics, !in_order && !clock_was_set))
}
