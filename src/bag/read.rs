//! Messages of one or several recordings in the order in which the recorder received them.

mod channels;
mod chunk;
mod fields;
mod file;
mod head;
mod locate;
mod loss;
mod source;
mod summary;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::{BagError, one_line};
use crate::units::Stamp;
use channels::ChannelTable;
pub use channels::{BagChannel, BagSchema};
use file::{Context, McapFile};
use head::{Head, MESSAGE_HEAD_LEN};
pub use locate::bags_at;
pub use loss::Loss;
use loss::Losses;

/// The longest record that is read, in bytes. A message over it is passed over and noted as a loss.
///
/// An image of 8K is 100 MB, so no message comes near it, while a damaged length can't take all memory.
pub const RECORD_LIMIT: usize = 256 << 20;

/// One message, borrowed from the reader until the next is asked for.
#[derive(Debug, Clone, Copy)]
pub struct BagMessage<'a> {
    /// Whose message it is.
    pub channel: &'a Arc<BagChannel>,
    /// When the recorder received it.
    pub log_time: Stamp,
    /// When it was published, where the recorder knew it; many write `log_time` or zero.
    pub publish_time: Stamp,
    /// The recorder's count, which many leave at zero.
    pub sequence: u32,
    /// The message, serialized as the channel says.
    pub data: &'a [u8],
}

/// A file that a recorder stored within the bag.
#[derive(Debug, Clone, Copy)]
pub struct BagAttachment<'a> {
    /// When it was recorded, nanoseconds.
    pub log_time: u64,
    /// When it was made, nanoseconds; zero where that is not known.
    pub create_time: u64,
    /// File name.
    pub name: &'a str,
    /// Media type, as `text/plain`.
    pub media_type: &'a str,
    /// Its bytes.
    pub data: &'a [u8],
}

/// Named notes that a recorder stored within the bag.
#[derive(Debug, Clone, Copy)]
pub struct BagMetadata<'a> {
    /// What the notes are; rosbag2 writes one named `rosbag2`.
    pub name: &'a str,
    /// The notes.
    pub metadata: &'a BTreeMap<String, String>,
}

/// Anything that a copy of a bag carries over.
#[derive(Debug, Clone, Copy)]
pub enum BagRecord<'a> {
    /// A message.
    Message(BagMessage<'a>),
    /// An attached file.
    Attachment(BagAttachment<'a>),
    /// Named notes.
    Metadata(BagMetadata<'a>),
}

/// What the ends of the files tell about all inputs before they are read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BagSummary {
    /// Whether [`BagReader::channels`] is complete: every file ends with a list of its channels, or was scanned.
    pub lists_channels: bool,
    /// Number of messages, where every file ends with statistics.
    pub n_messages: Option<u64>,
    /// First and last log time, where every file with messages states them.
    pub span: Option<(Stamp, Stamp)>,
    /// Number of messages by [`BagChannel::id`]; complete where `n_messages` is known.
    pub by_channel: BTreeMap<usize, u64>,
}

/// One recording: a file, or the files of a split bag one after the other.
struct Input {
    files: Vec<PathBuf>,
    /// Which of `files` is opened next.
    next_file: usize,
    current: Option<McapFile>,
    /// What was read last and not handed out yet.
    head: Option<Head>,
    body: Vec<u8>,
}

/// Streams messages out of one or several recordings, in bounded memory.
///
/// Within a file messages come in the order of the file, which is the order in which the recorder received them.
/// Several inputs are parts of one recording: of their next messages the one with the earliest log time comes first,
/// and the input that was given first where two are equal.
///
/// Damage is not an error: what can be read is read, and the rest stands in [`losses`](Self::losses).
/// The checksum of a chunk is known to be wrong only after its messages were handed out; the loss then says so.
pub struct BagReader {
    inputs: Vec<Input>,
    table: ChannelTable,
    losses: Losses,
    summary: BagSummary,
    /// Files without a list of their channels, with their inputs.
    unlisted: Vec<(usize, PathBuf)>,
    /// The input whose record was handed out last; it reads on when the next one is asked for.
    handed_out: Option<usize>,
    bytes_total: u64,
    bytes_done: u64,
}

impl BagReader {
    /// Open the bags at `inputs`: each a `.mcap` file, or a folder with a `metadata.yaml` or just `.mcap` files.
    ///
    /// # Errors
    /// One line on the first input that is not there, no MCAP bag, of ROS 1, packed in an unknown way, or given twice.
    pub fn open(inputs: &[PathBuf]) -> Result<Self, BagError> {
        let mut reader = BagReader {
            inputs: Vec::new(),
            table: ChannelTable::default(),
            losses: Losses::default(),
            summary: BagSummary { lists_channels: true, n_messages: Some(0), ..BagSummary::default() },
            unlisted: Vec::new(),
            handed_out: None,
            bytes_total: 0,
            bytes_done: 0,
        };
        let mut seen = BTreeSet::new();
        for input in inputs {
            reader.open_input(input, &mut seen)?;
        }
        Ok(reader)
    }

    fn open_input(&mut self, input: &Path, seen: &mut BTreeSet<PathBuf>) -> Result<(), BagError> {
        let input_idx = self.inputs.len();
        let located = locate::files(input)?;
        let mut files = Vec::new();
        let mut first_error = None;
        for path in located.paths {
            let canonical = path.canonicalize().map_err(|error| BagError::io(&path, "open", error))?;
            if !seen.insert(canonical) {
                return Err(BagError::DuplicateInput { path });
            }
            match self.inspect(&path, input_idx) {
                Ok(()) => files.push(path),
                // A recorder that was killed leaves its last file without a first byte on the disk.
                Err(error @ BagError::NotABag { .. }) if located.unlisted => {
                    if let BagError::NotABag { why, .. } = &error {
                        self.losses.push(&path, 0, format!("nothing can be read from it: {why}"));
                    }
                    first_error.get_or_insert(error);
                }
                Err(error) => return Err(error),
            }
        }
        if let (true, Some(error)) = (files.is_empty(), first_error) {
            return Err(error);
        }
        self.inputs.push(Input { files, next_file: 0, current: None, head: None, body: Vec::new() });
        Ok(())
    }

    /// Look at the begin and the end of one file.
    fn inspect(&mut self, path: &Path, input: usize) -> Result<(), BagError> {
        let mut file = McapFile::open(path)?;
        file.check_header()?;
        self.bytes_total = self.bytes_total.saturating_add(file.size());
        let Some(of_file) = summary::read(path, input, &mut self.table)? else {
            self.unlisted.push((input, path.to_path_buf()));
            self.summary = BagSummary::default();
            return Ok(());
        };
        if let Some(got) = of_file.unknown_compression {
            return Err(BagError::Compression { path: path.to_path_buf(), got });
        }
        let known = self.summary.n_messages.zip(of_file.statistics);
        let Some((n_before, statistics)) = known else {
            self.summary = BagSummary { lists_channels: self.summary.lists_channels, ..BagSummary::default() };
            return Ok(());
        };
        self.summary.n_messages = Some(n_before.saturating_add(statistics.n_messages));
        for (channel, count) in statistics.by_channel {
            let total = self.summary.by_channel.entry(channel).or_default();
            *total = total.saturating_add(count);
        }
        self.summary.span = match (self.summary.span, statistics.span) {
            (Some((first, last)), Some((begin, end))) => Some((first.min(begin), last.max(end))),
            (span, None) | (None, span) => span,
        };
        Ok(())
    }

    /// Make [`channels`](Self::channels) know every topic of `needed` that is there, before messages are read.
    ///
    /// Files that end with a list of their channels were asked when they were opened. A file without one (cut off, or
    /// of a writer that leaves it out) is read from its start until all of `needed` are known, and to its end where one
    /// of them isn't found or `needed` is empty. The reading position doesn't change.
    ///
    /// # Errors
    /// As [`next_record`](Self::next_record).
    pub fn scan(&mut self, needed: &[&str]) -> Result<(), BagError> {
        // What is damaged is noted when the messages are read.
        let mut losses = Losses::default();
        let mut body = Vec::new();
        for (input, path) in &self.unlisted {
            let mut file = McapFile::open(path)?;
            let mut n_known = usize::MAX;
            loop {
                let known = self.table.all();
                if n_known != known.len() {
                    n_known = known.len();
                    let is_known = |topic: &&str| known.iter().any(|channel| channel.topic == *topic);
                    if !needed.is_empty() && needed.iter().all(is_known) {
                        return Ok(());
                    }
                }
                let cx =
                    &mut Context { table: &mut self.table, losses: &mut losses, input: *input, messages_only: true };
                if file.next(&mut body, cx)?.is_none() {
                    break;
                }
            }
        }
        self.unlisted.clear();
        self.summary.lists_channels = true;
        Ok(())
    }

    /// The next message, attachment or metadata. `None` at the end of all inputs.
    ///
    /// # Errors
    /// [`BagError::Io`] when a file went away or the disk fails, [`BagError::Compression`] and [`BagError::Profile`]
    /// where only reading the file could find them.
    pub fn next_record(&mut self) -> Result<Option<BagRecord<'_>>, BagError> {
        let Some(idx) = self.advance(false)? else { return Ok(None) };
        Ok(self.record_of(idx))
    }

    /// The next message; attachments and metadata are passed over unread. `None` at the end of all inputs.
    ///
    /// # Errors
    /// As [`next_record`](Self::next_record).
    pub fn next_message(&mut self) -> Result<Option<BagMessage<'_>>, BagError> {
        let Some(idx) = self.advance(true)? else { return Ok(None) };
        // `advance(true)` stops at nothing else.
        Ok(self.record_of(idx).and_then(|record| match record {
            BagRecord::Message(message) => Some(message),
            BagRecord::Attachment(_) | BagRecord::Metadata(_) => None,
        }))
    }

    /// Every channel that is known by now, in order of their ids.
    pub fn channels(&self) -> &[Arc<BagChannel>] {
        self.table.all()
    }

    /// What the ends of the files tell.
    pub fn summary(&self) -> &BagSummary {
        &self.summary
    }

    /// What could not be read so far, in the order in which it was met.
    pub fn losses(&self) -> &[Loss] {
        self.losses.list()
    }

    /// The files of all inputs, in the order in which they are read within each.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.inputs.iter().flat_map(|input| &input.files).map(PathBuf::as_path)
    }

    /// Size of all files when they were opened, in bytes.
    pub fn bytes_total(&self) -> u64 {
        self.bytes_total
    }

    /// How much of [`bytes_total`](Self::bytes_total) lies behind the reader.
    pub fn bytes_read(&self) -> u64 {
        let current = self.inputs.iter().filter_map(|input| input.current.as_ref()).map(McapFile::bytes_read);
        self.bytes_done.saturating_add(current.sum())
    }

    /// The channels of a topic that a caller can't do without: known by now, and all of them cdr.
    ///
    /// # Errors
    /// [`BagError::MissingTopic`] lists the topics that are there, [`BagError::Encoding`] names what is not cdr.
    pub fn required(&self, topic: &str) -> Result<Vec<&Arc<BagChannel>>, BagError> {
        let of_topic: Vec<_> = self.channels().iter().filter(|channel| channel.topic == topic).collect();
        if of_topic.is_empty() {
            let there: BTreeSet<String> =
                self.channels().iter().map(|channel| format!("{} [{}]", channel.topic, channel.type_name())).collect();
            return Err(BagError::MissingTopic { topic: topic.to_owned(), there: there.into_iter().collect() });
        }
        match of_topic.iter().find(|channel| channel.message_encoding != "cdr") {
            Some(other) => Err(BagError::Encoding { topic: topic.to_owned(), got: one_line(&other.message_encoding) }),
            None => Ok(of_topic),
        }
    }

    /// Read on in every input that has nothing in hand, and choose the input whose turn it is.
    fn advance(&mut self, messages_only: bool) -> Result<Option<usize>, BagError> {
        if let Some(idx) = self.handed_out.take() {
            self.inputs[idx].head = None;
        }
        let mut earliest: Option<(Stamp, usize)> = None;
        for idx in 0..self.inputs.len() {
            if messages_only && matches!(self.inputs[idx].head, Some(Head::Attachment { .. } | Head::Metadata { .. })) {
                self.inputs[idx].head = None;
            }
            if self.inputs[idx].head.is_none() {
                self.fill(idx, messages_only)?;
            }
            match &self.inputs[idx].head {
                // Attachments and metadata have no place in the order of messages and go first.
                Some(Head::Attachment { .. } | Head::Metadata { .. }) => {
                    self.handed_out = Some(idx);
                    return Ok(self.handed_out);
                }
                Some(Head::Message { message, .. }) if earliest.is_none_or(|(time, _)| message.log_time < time) => {
                    earliest = Some((message.log_time, idx));
                }
                _ => {}
            }
        }
        self.handed_out = earliest.map(|(_, idx)| idx);
        Ok(self.handed_out)
    }

    /// Read the next record of one input, on into its next file where one ends.
    fn fill(&mut self, idx: usize, messages_only: bool) -> Result<(), BagError> {
        let input = &mut self.inputs[idx];
        loop {
            let Some(current) = &mut input.current else {
                let Some(path) = input.files.get(input.next_file) else { return Ok(()) };
                input.next_file += 1;
                input.current = Some(McapFile::open(path)?);
                continue;
            };
            let cx = &mut Context { table: &mut self.table, losses: &mut self.losses, input: idx, messages_only };
            input.head = current.next(&mut input.body, cx)?;
            if input.head.is_some() {
                return Ok(());
            }
            self.bytes_done = self.bytes_done.saturating_add(current.size());
            input.current = None;
        }
    }

    fn record_of(&self, idx: usize) -> Option<BagRecord<'_>> {
        let input = &self.inputs[idx];
        Some(match input.head.as_ref()? {
            Head::Message { channel, message } => BagRecord::Message(BagMessage {
                channel: self.table.all().get(*channel)?,
                log_time: message.log_time,
                publish_time: message.publish_time,
                sequence: message.sequence,
                data: input.body.get(MESSAGE_HEAD_LEN..)?,
            }),
            Head::Attachment { log_time, create_time, name, media_type, data } => {
                let data = input.body.get(data.clone())?;
                let (log_time, create_time) = (*log_time, *create_time);
                BagRecord::Attachment(BagAttachment { log_time, create_time, name, media_type, data })
            }
            Head::Metadata { name, metadata } => BagRecord::Metadata(BagMetadata { name, metadata }),
        })
    }
}
