//! One file of a recording, whichever storage wrote it.

use std::io::{self, Read as _};
use std::path::Path;

use super::channels::ChannelTable;
use super::chunk;
use super::file::{Context, McapFile};
use super::head::{Head, MESSAGE_HEAD_LEN};
use super::loss::Losses;
use super::order::Order;
use super::sqlite::{self, SqliteFile};
use super::summary::{self, FileSummary};
use super::unpacked::{Unpacked, ZSTD_MAGIC};
use super::{BagError, RECORD_LIMIT};
use crate::location::Place;
use crate::units::Stamp;

/// A file that is being read.
pub(super) enum Storage {
    Mcap(Box<McapFile>),
    Sqlite(Box<SqliteFile>),
}

impl Storage {
    /// Open a file, which may be packed with zstd as a whole.
    pub(super) fn open(place: &Place, order: Order) -> Result<Self, BagError> {
        let path = place.path();
        let mut unpacked = Unpacked::open(place)?;
        if sqlite::is_sqlite(&mut unpacked)? {
            let file = SqliteFile::open(path, unpacked, order.by_time && !order.as_written)?;
            return Ok(Storage::Sqlite(Box::new(file)));
        }
        Ok(Storage::Mcap(Box::new(McapFile::open(path, unpacked, order)?)))
    }

    /// Refuse a recording of ROS 1 by its header, before anything else is read.
    pub(super) fn check_header(&mut self) -> Result<(), BagError> {
        match self {
            Storage::Mcap(file) => file.check_header(),
            Storage::Sqlite(_) => Ok(()),
        }
    }

    /// Size of the file when it was last asked for, in bytes.
    pub(super) fn size(&self) -> u64 {
        match self {
            Storage::Mcap(file) => file.size(),
            Storage::Sqlite(file) => file.size(),
        }
    }

    /// Bytes read so far; it never goes back.
    pub(super) fn bytes_read(&self) -> u64 {
        match self {
            Storage::Mcap(file) => file.bytes_read(),
            Storage::Sqlite(file) => file.bytes_read(),
        }
    }

    /// The file, as it was given.
    pub(super) fn path(&self) -> &Path {
        match self {
            Storage::Mcap(file) => file.path(),
            Storage::Sqlite(file) => file.path(),
        }
    }

    /// The next message, attachment or metadata: its body is put into `body`. `None` at the end of what can be read.
    ///
    /// Messages that the recorder packed one by one are unpacked here: no CDR begins as zstd does.
    pub(super) fn next(&mut self, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<Option<Head>, BagError> {
        loop {
            let head = match self {
                Storage::Mcap(file) => file.next(body, cx)?,
                Storage::Sqlite(file) => file.next(body, cx)?,
            };
            let Some(Head::Message { channel, message }) = &head else { return Ok(head) };
            let is_packed = body.get(MESSAGE_HEAD_LEN..).is_some_and(|data| data.starts_with(ZSTD_MAGIC));
            if !is_packed || cx.table.all()[*channel].message_encoding != "cdr" {
                return Ok(head);
            }
            match unpack(body) {
                Ok(()) => return Ok(head),
                Err(why) => {
                    let (topic, time) = (super::one_line(&cx.table.all()[*channel].topic), message.log_time.0);
                    let what = format!("the message of {topic} at {time} ns is packed with zstd and lost: {why}");
                    cx.losses.push(self.path(), 0, what);
                }
            }
        }
    }
}

/// Replaces the data of a message by what it unpacks to.
fn unpack(body: &mut Vec<u8>) -> Result<(), String> {
    let mut data = Vec::new();
    let decoder = zstd::stream::read::Decoder::with_buffer(&body[MESSAGE_HEAD_LEN..]);
    let said = |error: io::Error| {
        let why = super::one_line(&error.to_string());
        chunk::end_without_memory(&why, body.len());
        why
    };
    let decoder = decoder.map_err(said)?;
    let read = decoder.take(RECORD_LIMIT as u64 + 1).read_to_end(&mut data);
    read.map_err(said)?;
    if data.len() > RECORD_LIMIT {
        return Err(format!("it holds more than the limit of {RECORD_LIMIT} bytes"));
    }
    body.truncate(MESSAGE_HEAD_LEN);
    body.append(&mut data);
    Ok(())
}

/// Summary of a file, with its channels entered into `table`; `None` where all of it has to be read for that.
///
/// # Errors
/// [`BagError::Io`] when the file can't be read, [`BagError::NotABag`] where a sqlite3 file holds no bag.
pub(super) fn summary(place: &Place, input: usize, table: &mut ChannelTable) -> Result<Option<FileSummary>, BagError> {
    let path = place.path();
    let mut unpacked = Unpacked::open(place)?;
    match sqlite::is_sqlite(&mut unpacked)? {
        true => sqlite::summary(path, unpacked, input, table).map(Some),
        false => summary::read(path, unpacked, input, table),
    }
}

/// Log time of the first message that stands in a file; `None` of a file without one.
pub(super) fn first_log_time(place: &Place) -> Result<Option<Stamp>, BagError> {
    let mut file = Storage::open(place, Order { as_written: true, ..Order::default() })?;
    let (table, losses) = (&mut ChannelTable::default(), &mut Losses::default());
    let head = file.next(&mut Vec::new(), &mut Context { table, losses, input: 0, messages_only: true })?;
    Ok(match head {
        Some(Head::Message { message, .. }) => Some(message.log_time),
        _ => None,
    })
}
