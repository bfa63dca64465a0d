//! Messages of one or several recordings in the order in which the recorder received them.

mod channels;
mod chunk;
mod fields;
mod file;
mod foreign;
mod head;
mod locate;
mod loss;
mod names;
mod order;
mod source;
mod sqlite;
mod storage;
mod summary;
mod unpacked;
mod window;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::error::{BagError, one_line};
use crate::location::{self, Place};
use crate::msg::definition::Definitions as Types;
use crate::units::Stamp;
use channels::ChannelTable;
pub use channels::{BagChannel, BagSchema, SchemaError};
use file::Context;
use head::{Head, MESSAGE_HEAD_LEN};
pub use locate::{Recordings, recordings_at, stored_bytes};
pub use loss::Loss;
use loss::Losses;
use order::{ChunkPlace, Chunks, Late, Only, Order};
use storage::{Storage, first_log_time};

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
    /// Name of the notes; rosbag2 writes some named `rosbag2`.
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

/// Summary of all inputs, from the ends of their files, before the messages are read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BagSummary {
    /// Whether [`BagReader::channels`] is complete: every file ends with a list of its channels, or was scanned.
    pub lists_channels: bool,
    /// Number of messages, where every file ends with statistics.
    pub n_messages: Option<u64>,
    /// First and last log time, where every file with messages states them.
    pub span: Option<(Stamp, Stamp)>,
    /// Number of messages by [`BagChannel::id`], as MCAP files state it.
    pub by_channel: BTreeMap<usize, u64>,
}

/// Files of one recording that are read at the same time because they overlap in time.
const MAX_OPEN: usize = 16;

/// One recording: a file, or the files of a split bag.
struct OpenInput {
    /// In the order of their first messages.
    files: Vec<Part>,
    /// Which of `files` is opened next.
    next_file: usize,
    /// Those whose turn it is: one, but where files overlap in time.
    open: Vec<OpenFile>,
    late: Late,
}

/// One file of a recording.
struct Part {
    place: Place,
    /// Name of the file.
    path: PathBuf,
    /// Where its chunks are, as its index says, and its channels: of a file that is not on this machine.
    index: Option<Only>,
    /// Log time of its first message, where it matters and is known.
    begin: Option<Stamp>,
    order: Order,
}

/// A file that is being read.
struct OpenFile {
    file: Storage,
    /// The record that was read last and not handed out yet.
    head: Option<Head>,
    body: Vec<u8>,
}

/// Streams messages out of one or several recordings, in bounded memory.
///
/// Messages come in the order in which the recorder received them, by their log time; where two are equal, the one that
/// stands first in the file, and of several inputs the one that was given first. A file whose messages don't stand in that
/// order, as one that was written topic by topic, is put in order chunk by chunk, and by its index where chunks overlap.
/// Messages that can't be put in order are read as they stand, which is a loss where it
/// [matters](Self::watch_order). Messages of one channel are never put in another order:
/// where its log times go back, the recorder's clock was set.
///
/// Damage is not an error: what can be read is read, and the rest stands in [`losses`](Self::losses).
/// The checksum of a chunk is known to be wrong only after its messages were handed out; the loss then says so.
pub struct BagReader {
    inputs: Vec<OpenInput>,
    as_written: bool,
    table: ChannelTable,
    losses: Losses,
    notes: Vec<String>,
    summary: BagSummary,
    /// Files without a list of their channels, with their inputs.
    unlisted: Vec<(usize, Place)>,
    /// The input, and the file of those that it has open, whose record was handed out last; it reads on when the next one
    /// is asked for.
    handed_out: Option<(usize, usize)>,
    /// Topics whose messages must come in the order of time among each other.
    watched: BTreeSet<String>,
    /// The same, by channel id.
    is_watched: BTreeMap<usize, bool>,
    bytes_total: u64,
    bytes_done: u64,
}

impl BagReader {
    /// Open the recordings at `inputs`: each a `.mcap` or `.db3` file, or a folder with a `metadata.yaml`, with one such file,
    /// or with the parts of one split recording. Several are parts of one recording.
    ///
    /// # Errors
    /// One line on the first input that is not there, no bag, of ROS 1, packed in an unknown way, given twice, or a
    /// folder of several recordings.
    pub fn open(inputs: &[PathBuf]) -> Result<Self, BagError> {
        Self::open_with(inputs, false)
    }

    /// As [`open`](Self::open), for who looks at how a bag is written: messages come in the order of the file.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_as_written(inputs: &[PathBuf]) -> Result<Self, BagError> {
        Self::open_with(inputs, true)
    }

    fn open_with(inputs: &[PathBuf], as_written: bool) -> Result<Self, BagError> {
        let mut reader = BagReader {
            inputs: Vec::new(),
            as_written,
            table: ChannelTable::new(Types::of_this_machine(None)),
            losses: Losses::default(),
            notes: Vec::new(),
            summary: BagSummary { lists_channels: true, n_messages: Some(0), ..BagSummary::default() },
            unlisted: Vec::new(),
            handed_out: None,
            watched: BTreeSet::new(),
            is_watched: BTreeMap::new(),
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
        self.notes.extend(located.note);
        let is_split = located.places.len() > 1 && !self.as_written;
        let mut files = Vec::new();
        let mut first_error = None;
        for place in located.places {
            let path = place.path().to_path_buf();
            let canonical = location::canonical(&path).map_err(|error| BagError::io(&path, "open", error))?;
            if !seen.insert(canonical) {
                return Err(BagError::DuplicateInput { path });
            }
            match self.inspect(place, input_idx, is_split) {
                Ok(part) => files.push(part),
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
        order::sort_parts(&mut files);
        self.inputs.push(OpenInput { files, next_file: 0, open: Vec::new(), late: Late::default() });
        Ok(())
    }

    /// Look at the begin and the end of one file.
    fn inspect(&mut self, place: Place, input: usize, is_split: bool) -> Result<Part, BagError> {
        let (as_written, path) = (self.as_written, place.path().to_path_buf());
        let mut file = Storage::open(&place, Order { as_written, ..Order::default() })?;
        file.check_header()?;
        self.bytes_total = self.bytes_total.saturating_add(file.size());
        if place.is_remote()
            && let Some(copy) = place.copy()
        {
            let n_bytes = copy.metadata().map_or(0, |metadata| metadata.len());
            self.notes.push(format!(
                "{}: read from a copy of {n_bytes} bytes in the folder for temporary files",
                path.display()
            ));
        }
        let Some(of_file) = storage::summary(&place, input, &mut self.table)? else {
            self.unlisted.push((input, place.clone()));
            self.summary = BagSummary::default();
            let begin = if is_split { first_log_time(&place)? } else { None };
            return Ok(Part { place, path, index: None, begin, order: Order { as_written, ..Order::default() } });
        };
        let begin = match &of_file.statistics {
            _ if !is_split => None,
            Some(statistics) => statistics.span.map(|(first, _)| first),
            None => first_log_time(&place)?,
        };
        if is_split {
            place.forget_ends(); // of hundreds of files
        }
        let is_indexed = place.is_remote() && of_file.is_indexed;
        let index = of_file.definitions.filter(|_| is_indexed).map(|definitions| Only {
            places: of_file.chunks.clone(),
            first: of_file.chunks.iter().map(|place| place.offset).min().unwrap_or(0),
            notes: of_file.notes,
            definitions,
        });
        let chunks = if as_written { None } else { Chunks::to_be_ordered(of_file.chunks) };
        let order = Order { chunks, by_time: of_file.by_time, as_written, ..Order::default() };
        let part = Part { place, path: path.clone(), index, begin, order };
        if let Some(got) = of_file.unknown_compression {
            return Err(BagError::Compression { path, got });
        }
        let known = self.summary.n_messages.zip(of_file.statistics);
        let Some((n_before, statistics)) = known else {
            self.summary = BagSummary { lists_channels: self.summary.lists_channels, ..BagSummary::default() };
            return Ok(part);
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
        Ok(part)
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
        for (input, place) in &self.unlisted {
            let mut file = Storage::open(place, Order { as_written: true, ..Order::default() })?;
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

    /// Read these topics only, where that spares anything: of a file that is not on this machine and has an index, chunks
    /// without a message of theirs are not asked for, and neither are attachments. All other files are read whole, so that
    /// damage anywhere in them is said. Messages of other topics may still come. Only before messages are read.
    ///
    /// Returns whether something is left out.
    pub fn read_only(&mut self, topics: &BTreeSet<String>) -> bool {
        let table = self.table.all();
        let is_wanted = |channel: usize| table.get(channel).is_some_and(|channel| topics.contains(&channel.topic));
        let mut spares = false;
        for part in self.inputs.iter_mut().flat_map(|input| &mut input.files) {
            if let Some(Only { places, first, notes, definitions }) = &part.index {
                let wanted = |place: &&ChunkPlace| place.may_hold(definitions, &is_wanted);
                let (places, notes) = (places.iter().filter(wanted).cloned().collect(), notes.clone());
                part.order.only = Some(Only { places, first: *first, notes, definitions: definitions.clone() });
                spares = true;
            }
        }
        spares
    }

    /// Watch that messages of these topics come in the order of time among each other; that they don't is a loss.
    pub fn watch_order(&mut self, topics: &[&str]) {
        self.watched.extend(topics.iter().map(|topic| (*topic).to_owned()));
    }

    /// Look for the types that the bag doesn't define in this folder too, before those of packages on `AMENT_PREFIX_PATH`.
    ///
    /// # Errors
    /// [`BagError::Io`] where the folder is not on this machine.
    pub fn look_for_definitions_in(&mut self, folder: &Path) -> Result<(), BagError> {
        location::only_read_here(folder).map_err(|error| BagError::io(folder, "open", error))?;
        let here = location::local(folder);
        self.table.look_among(Types::of_this_machine(here.as_deref()));
        Ok(())
    }

    /// Where types that the bag doesn't define are looked for.
    pub fn definitions(&self) -> &Types {
        self.table.installed()
    }

    /// Every channel that is known by now, in order of their ids.
    pub fn channels(&self) -> &[Arc<BagChannel>] {
        self.table.all()
    }

    /// Summary of all inputs, from the ends of their files.
    pub fn summary(&self) -> &BagSummary {
        &self.summary
    }

    /// Losses so far: parts that could not be read, in the order in which they were met.
    pub fn losses(&self) -> &[Loss] {
        self.losses.list()
    }

    /// Notes for a person on how the inputs were found.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The files of all inputs, in the order in which they are read within each.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.inputs.iter().flat_map(|input| &input.files).map(|part| part.path.as_path())
    }

    /// Size of all files when they were opened, in bytes.
    pub fn bytes_total(&self) -> u64 {
        self.bytes_total
    }

    /// How much of [`bytes_total`](Self::bytes_total) lies behind the reader.
    pub fn bytes_read(&self) -> u64 {
        let open = self.inputs.iter().flat_map(|input| &input.open).map(|open| open.file.bytes_read());
        self.bytes_done.saturating_add(open.sum())
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

    /// Read on in every input that has nothing in hand, and choose the file whose turn it is.
    fn advance(&mut self, messages_only: bool) -> Result<Option<(usize, usize)>, BagError> {
        if let Some((input, file)) = self.handed_out.take() {
            self.inputs[input].open[file].head = None;
        }
        let mut earliest: Option<(Stamp, usize, (usize, usize))> = None;
        for input_idx in 0..self.inputs.len() {
            self.fill(input_idx, messages_only)?;
            for (file_idx, open) in self.inputs[input_idx].open.iter().enumerate() {
                match &open.head {
                    // Attachments and metadata have no place in the order of messages and go first.
                    Some(Head::Attachment { .. } | Head::Metadata { .. }) => {
                        self.handed_out = Some((input_idx, file_idx));
                        return Ok(self.handed_out);
                    }
                    Some(Head::Message { channel, message })
                        if earliest.is_none_or(|(time, ..)| message.log_time < time) =>
                    {
                        earliest = Some((message.log_time, *channel, (input_idx, file_idx)));
                    }
                    _ => {}
                }
            }
        }
        let Some((log_time, channel, place)) = earliest else { return Ok(None) };
        let (watched, table) = (&self.watched, &self.table);
        let is_watched = !watched.is_empty()
            && *self.is_watched.entry(channel).or_insert_with(|| watched.contains(&table.all()[channel].topic));
        if is_watched {
            let OpenInput { open, late, .. } = &mut self.inputs[place.0];
            late.handle(log_time, channel, open[place.1].file.path());
        }
        self.handed_out = Some(place);
        Ok(self.handed_out)
    }

    /// Read the next record of every open file of an input that has none in hand, and open the file whose turn has come.
    fn fill(&mut self, input_idx: usize, messages_only: bool) -> Result<(), BagError> {
        let OpenInput { files, next_file, open, late } = &mut self.inputs[input_idx];
        loop {
            let mut idx = 0;
            let mut earliest: Option<Stamp> = None;
            while let Some(OpenFile { file, head, body }) = open.get_mut(idx) {
                if messages_only && matches!(head, Some(Head::Attachment { .. } | Head::Metadata { .. })) {
                    *head = None;
                }
                if head.is_none() {
                    let (table, losses) = (&mut self.table, &mut self.losses);
                    *head = file.next(body, &mut Context { table, losses, input: input_idx, messages_only })?;
                }
                match head {
                    None => {
                        self.bytes_done = self.bytes_done.saturating_add(file.size());
                        open.remove(idx);
                        continue;
                    }
                    Some(Head::Message { message, .. }) => {
                        let time = message.log_time;
                        earliest = Some(earliest.map_or(time, |earliest| earliest.min(time)));
                    }
                    Some(_) => return Ok(()),
                }
                idx += 1;
            }
            let Some(part) = files.get_mut(*next_file) else {
                if open.is_empty() {
                    late.conclude(&mut self.losses);
                }
                return Ok(());
            };
            let overlaps = || part.begin.zip(earliest).is_some_and(|(begin, earliest)| begin < earliest);
            if !(open.is_empty() || (open.len() < MAX_OPEN && overlaps())) {
                return Ok(());
            }
            *next_file += 1;
            let file = Storage::open(&part.place, std::mem::take(&mut part.order))?;
            open.push(OpenFile { file, head: None, body: Vec::new() });
        }
    }

    fn record_of(&self, (input, file): (usize, usize)) -> Option<BagRecord<'_>> {
        let OpenFile { head, body, .. } = self.inputs[input].open.get(file)?;
        Some(match head.as_ref()? {
            Head::Message { channel, message } => BagRecord::Message(BagMessage {
                channel: self.table.all().get(*channel)?,
                log_time: message.log_time,
                publish_time: message.publish_time,
                sequence: message.sequence,
                data: body.get(MESSAGE_HEAD_LEN..)?,
            }),
            Head::Attachment { log_time, create_time, name, media_type, data } => {
                let data = body.get(data.clone())?;
                let (log_time, create_time) = (*log_time, *create_time);
                BagRecord::Attachment(BagAttachment { log_time, create_time, name, media_type, data })
            }
            Head::Metadata { name, metadata } => BagRecord::Metadata(BagMetadata { name, metadata }),
        })
    }
}
