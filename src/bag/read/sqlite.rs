//! A bag of rosbag2's sqlite3 storage (`.db3`), row by row.
//!
//! The file is untrusted: it is opened read-only and immutable, so that nothing is written beside it; views, triggers,
//! virtual tables and computed columns are not followed; and rows are read in the order of the table itself, so that no
//! message is found, or missed, by an index. Rows that don't follow one another are damage, which bounds the work by the size of the file.

mod scan;
mod topics;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Read as _, Seek as _};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rusqlite::config::DbConfig;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags, Row};

use super::file::{Context, message_of};
use super::head::{Head, MESSAGE_HEAD_LEN};
use super::unpacked::{SQLITE_MAGIC, Unpacked};
use super::window::Window;
use super::{BagError, RECORD_LIMIT, one_line};
use crate::bag::error::quoted;
use crate::location::{self, Reader};
use crate::units::Stamp;

pub(super) use scan::summary;

/// Bytes of messages that are taken out of the file at once; one longer message is taken whole.
const BATCH: usize = 1 << 20;

/// Whether a file is one of sqlite3, by its first bytes.
pub(super) fn is_sqlite(unpacked: &mut Unpacked) -> Result<bool, BagError> {
    let head = head(unpacked).map_err(|error| BagError::io(&unpacked.path, "read", error))?;
    Ok(head.starts_with(SQLITE_MAGIC))
}

/// The first bytes of a file, up to the number of its pages.
fn head(unpacked: &mut Unpacked) -> std::io::Result<Vec<u8>> {
    let file = &mut unpacked.file;
    let mut head = Vec::new();
    file.rewind()?;
    file.by_ref().take(32).read_to_end(&mut head)?;
    file.rewind()?;
    Ok(head)
}

/// A file that is being read.
pub(super) struct SqliteFile {
    path: PathBuf,
    /// Holds a file that was unpacked until it has been read.
    unpacked: Unpacked,
    state: FileState,
    bag: Connection,
    by_time: bool,
    /// Rows whose turn has come: the first that is not read yet.
    next_row: Option<i64>,
    window: Window,
    /// Places in the table of channels, by the id of the topic; read with the first message.
    channels: Option<BTreeMap<i64, usize>>,
    bytes_read: u64,
    left_out: LeftOut,
}

/// Tells a file that is written to from one that isn't.
#[derive(PartialEq)]
struct FileState {
    size: u64,
    modified: Option<SystemTime>,
}

impl FileState {
    fn of(unpacked: &Unpacked) -> std::io::Result<Self> {
        // Always on this machine by now, and open, even where its name is gone.
        let Reader::Local(file) = &unpacked.file else { return Err(std::io::Error::other("is not on this machine")) };
        let metadata = file.metadata()?;
        Ok(FileState { size: metadata.len(), modified: metadata.modified().ok() })
    }
}

/// Messages that are not read: how many, and the first one's row.
#[derive(Default)]
struct LeftOut(BTreeMap<&'static str, (u64, i64)>);

impl LeftOut {
    fn count(&mut self, why: &'static str, row: i64) {
        self.0.entry(why).or_insert((0, row)).0 += 1;
    }
}

impl SqliteFile {
    /// Open the bag that `path` was unpacked to; its messages come in the order of time, or as they stand.
    pub(super) fn open(path: &Path, mut unpacked: Unpacked, by_time: bool) -> Result<Self, BagError> {
        let bag = connect(path, &mut unpacked)?;
        if by_time {
            // In a temporary file of sqlite's own, so that the order of a long bag takes no memory.
            let sort = "CREATE TEMP TABLE by_time (message INTEGER);
                INSERT INTO by_time SELECT rowid FROM main.messages NOT INDEXED ORDER BY timestamp, rowid";
            bag.execute_batch(sort).map_err(|error| not_sorted(path, &error))?;
        }
        let state = FileState::of(&unpacked).map_err(|error| BagError::io(path, "read", error))?;
        let (next_row, window) = (Some(i64::MIN), Window::default());
        let (path, left_out) = (path.to_path_buf(), LeftOut::default());
        Ok(SqliteFile {
            path,
            unpacked,
            state,
            bag,
            by_time,
            next_row,
            window,
            channels: None,
            bytes_read: 0,
            left_out,
        })
    }

    /// Size of the file, in bytes.
    pub(super) fn size(&self) -> u64 {
        self.state.size
    }

    /// Bytes read so far.
    pub(super) fn bytes_read(&self) -> u64 {
        self.bytes_read.min(self.state.size)
    }

    /// The file, as it was given.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The next message: its body is put into `body`. `None` at the end of what can be read.
    pub(super) fn next(&mut self, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<Option<Head>, BagError> {
        loop {
            if let Some(channel) = self.window.pop(body) {
                return Ok(Some(message_of(channel, body)));
            }
            if self.channels.is_none() {
                let found = topics::read(&self.bag, cx.input, cx.table);
                let (channels, complaint) = found.map_err(|error| not_a_bag(&self.path, &error))?;
                self.channels = Some(channels);
                if let Some(what) = complaint {
                    cx.losses.push(&self.path, 0, what);
                }
                self.look_beside(cx);
            }
            if self.next_row.is_none() {
                self.conclude(cx);
                return Ok(None);
            }
            if let Err(error) = self.fill() {
                let why = one_line(&error.to_string());
                let what = format!("damaged ({why}): the messages from there on are lost");
                cx.losses.push(&self.path, self.bytes_read, what);
                self.next_row = None;
            }
        }
    }

    /// Says once, at the end, what was left out.
    fn conclude(&mut self, cx: &mut Context<'_>) {
        for (why, (count, row)) in std::mem::take(&mut self.left_out.0) {
            let what = format!("{count} messages are not read, the first in row {row}: {why}");
            cx.losses.push(&self.path, 0, what);
        }
        if let Ok(now) = FileState::of(&self.unpacked)
            && now != self.state
        {
            self.state = now;
            let what = "it was written to while it was read, so that messages may be missing: read it again when its recorder has ended";
            cx.losses.push(&self.path, 0, what.to_owned());
        }
    }

    /// Messages that a recorder left in a log beside the file are not in it.
    fn look_beside(&self, cx: &mut Context<'_>) {
        if let Some(what) = beside(&self.path) {
            cx.losses.push(&self.path, 0, what);
        }
    }

    /// Take messages from the next row on into the window, until they are [`BATCH`] bytes.
    fn fill(&mut self) -> Result<(), Trouble> {
        let Some(first) = self.next_row.take() else { return Ok(()) };
        // The data of what is no blob, or of a message beyond the limit, is never loaded.
        let columns = format!(
            "m.topic_id, m.timestamp, typeof(m.data), CASE WHEN typeof(m.data) = 'blob' AND octet_length(m.data) <= {RECORD_LIMIT} THEN m.data END, m.rowid"
        );
        let query = match self.by_time {
            false => format!(
                "SELECT m.rowid, {columns} FROM main.messages AS m NOT INDEXED WHERE m.rowid >= ?1 ORDER BY m.rowid"
            ),
            true => format!(
                "SELECT o.rowid, {columns} FROM temp.by_time AS o CROSS JOIN main.messages AS m ON m.rowid = o.message WHERE o.rowid >= ?1 ORDER BY o.rowid"
            ),
        };
        let mut statement = self.bag.prepare(&query)?;
        let mut rows = statement.query([first])?;
        let mut taken = 0;
        let mut due = Some(first);
        self.window.expect(0);
        while let Some(row) = rows.next()? {
            let number: i64 = row.get(0)?;
            // A tree of rows that leads back into itself would never end.
            if due.is_none_or(|due| number < due) {
                return Err(out_of_order());
            }
            due = number.checked_add(1);
            taken += take(row, self.channels.as_ref(), &mut self.window, &mut self.left_out)?;
            if taken >= BATCH {
                self.next_row = due;
                break;
            }
        }
        self.bytes_read = self.bytes_read.saturating_add(taken as u64);
        Ok(())
    }
}

/// Puts the message of a row into the window; how many bytes it takes.
fn take(
    row: &Row<'_>,
    channels: Option<&BTreeMap<i64, usize>>,
    window: &mut Window,
    left_out: &mut LeftOut,
) -> rusqlite::Result<usize> {
    const NO_MESSAGE: usize = 64;
    let number = row.get(5)?;
    let (ValueRef::Integer(topic), ValueRef::Integer(time)) = (row.get_ref(1)?, row.get_ref(2)?) else {
        left_out.count("topic_id or timestamp is no whole number", number);
        return Ok(NO_MESSAGE);
    };
    let Ok(unsigned_time) = u64::try_from(time) else {
        left_out.count("their time lies before 1970, which no clock of a recorder shows", number);
        return Ok(NO_MESSAGE);
    };
    let Some(&channel) = channels.and_then(|channels| channels.get(&topic)) else {
        left_out.count("they belong to topics that the file doesn't define", number);
        return Ok(NO_MESSAGE);
    };
    let ValueRef::Blob(data) = row.get_ref(4)? else {
        let is_blob = matches!(row.get_ref(3)?, ValueRef::Text(b"blob"));
        let why = if is_blob { "they are longer than the limit of 256 MiB" } else { "their data is no blob" };
        left_out.count(why, number);
        return Ok(NO_MESSAGE);
    };
    // The head of a message as MCAP has it; the storage keeps one time, that of receipt.
    let mut body = Vec::with_capacity(MESSAGE_HEAD_LEN + data.len());
    body.extend([0; 2 + 4]);
    body.extend(unsigned_time.to_le_bytes());
    body.extend(unsigned_time.to_le_bytes());
    body.extend_from_slice(data);
    window.push(Stamp(time), channel, &body);
    Ok(body.len())
}

/// Why a sqlite3 file can't be read as a bag.
#[derive(Debug, thiserror::Error)]
enum Trouble {
    #[error(transparent)]
    Sqlite(#[from] rusqlite::Error),
    #[error("{0}")]
    Content(String),
}

fn out_of_order() -> Trouble {
    Trouble::Content("rows don't follow one another".to_owned())
}

/// The log that a recorder that didn't end left beside its bag, and what to do; `None` where there is none.
fn beside(path: &Path) -> Option<String> {
    let holds = [
        ("-wal", "what its recorder had not yet put into the bag, which is not read"),
        ("-journal", "what a recorder that was stopped in mid-write was about to change back, which is not done"),
    ];
    let is_there = |suffix: &str| {
        let mut log = path.as_os_str().to_owned();
        log.push(suffix);
        match location::open(Path::new(&log)).and_then(|log| log.size()) {
            Ok(size) => size > 0,
            // A store that can't tell whether there is a log may have one.
            Err(error) => location::is_refusal(&error) && error.kind() != std::io::ErrorKind::NotFound,
        }
    };
    let (suffix, what) = holds.into_iter().find(|(suffix, _)| is_there(suffix))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Some(one_line(&format!(
        "{name}{suffix} beside it holds {what}: copy both to a folder that can be written, and `sqlite3 {} 'PRAGMA journal_mode=DELETE'` there makes one whole file",
        quoted(&name)
    )))
}

/// The error where rows can't be put in order: most often the disk with temporary files is full, or can't be written.
fn not_sorted(path: &Path, error: &rusqlite::Error) -> BagError {
    use rusqlite::ErrorCode::{CannotOpen, DiskFull, ReadOnly, SystemIoFailure};
    match error.sqlite_error_code() {
        Some(CannotOpen | DiskFull | ReadOnly | SystemIoFailure) => {
            let source = std::io::Error::other(one_line(&error.to_string()));
            let action = "put its messages in order in the folder for temporary files (TMPDIR)";
            BagError::Io { path: path.to_path_buf(), action, source }
        }
        _ => not_a_bag(path, error),
    }
}

fn not_a_bag(path: &Path, error: &dyn std::fmt::Display) -> BagError {
    if let Some(log) = beside(path) {
        let why = format!("it is a sqlite3 file that can't be read as a bag ({}): {log}", one_line(&error.to_string()));
        return BagError::NotABag { path: path.to_path_buf(), why };
    }
    let why = format!(
        "it is a sqlite3 file that can't be read as a bag ({}): if it is damaged, `sqlite3 DAMAGED.db3 .recover | sqlite3 WHOLE.db3` saves what is there",
        one_line(&error.to_string())
    );
    BagError::NotABag { path: path.to_path_buf(), why }
}

/// Connect to a file so that it is only read, whatever it holds.
fn connect(path: &Path, unpacked: &mut Unpacked) -> Result<Connection, BagError> {
    check_length(path, unpacked)?;
    let mut uri = String::from("file:");
    let absolute = std::path::absolute(&unpacked.path).map_err(|error| BagError::io(path, "open", error))?;
    for byte in absolute.as_os_str().as_encoded_bytes() {
        match byte {
            b'/' | b'.' | b'_' | b'-' | b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' => uri.push(char::from(*byte)),
            // Writing to a string can't fail.
            _ => drop(write!(uri, "%{byte:02X}")),
        }
    }
    uri.push_str("?immutable=1");
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connected = (|| {
        let bag = Connection::open_with_flags(&uri, flags)?;
        bag.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
        bag.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
        bag.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false)?;
        bag.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false)?;
        // In KiB: pages of the file, and of the temporary one that the order is kept in.
        bag.execute_batch("PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0; PRAGMA cache_size = -4096")?;
        check_table(&bag, "topics", &["id", "name", "type", "serialization_format"])?;
        check_table(&bag, "messages", &["topic_id", "timestamp", "data"])?;
        for table in ["topics", "messages"] {
            let has_rowid = bag.prepare(&format!("SELECT rowid FROM main.{table}")).is_ok();
            if !has_rowid {
                return Err(Trouble::Content(format!("its table {table} has no rowid")));
            }
        }
        Ok(bag)
    })();
    connected.map_err(|error: Trouble| not_a_bag(path, &error))
}

/// A file that is shorter than its head says is cut off.
fn check_length(path: &Path, unpacked: &mut Unpacked) -> Result<(), BagError> {
    let io_error = |error| BagError::io(path, "read", error);
    let size = unpacked.file.size().map_err(io_error)?;
    let head = head(unpacked).map_err(io_error)?;
    let stated = match head.get(16..18).zip(head.get(28..32)) {
        Some((page, n_pages)) => {
            let number = |bytes: &[u8]| bytes.iter().fold(0, |number, byte| number << 8 | u64::from(*byte));
            let page = match number(page) {
                1 => 65536,
                page => page,
            };
            page * number(n_pages)
        }
        None => 100,
    };
    if size >= stated {
        return Ok(());
    }
    let why = format!(
        "it is a sqlite3 (.db3) bag that is cut off: {size} bytes of {stated} are there; `sqlite3 CUT.db3 .recover | sqlite3 WHOLE.db3` saves what is"
    );
    Err(BagError::NotABag { path: path.to_path_buf(), why })
}

/// Whether a table is one that holds rows, with the columns that are read, none of them computed.
fn check_table(bag: &Connection, table: &str, columns: &[&str]) -> Result<(), Trouble> {
    let refuse = |why: String| Err(Trouble::Content(why));
    let root = "SELECT count(*) FROM main.sqlite_schema WHERE type = 'table' AND rootpage > 0 AND name = ?1";
    if bag.query_row(root, [table], |row| row.get::<_, i64>(0))? != 1 {
        return refuse(format!("it has no table {table}"));
    }
    let mut stored = bag.prepare("SELECT name, hidden FROM pragma_table_xinfo(?1, 'main')")?;
    let mut rows = stored.query([table])?;
    let mut there = BTreeMap::new();
    while let Some(row) = rows.next()? {
        there.insert(row.get::<_, String>(0)?, row.get::<_, i64>(1)?);
    }
    for column in columns {
        if there.get(*column) != Some(&0) {
            return refuse(format!("its table {table} has no column {column}"));
        }
    }
    Ok(())
}
