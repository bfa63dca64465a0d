//! One MCAP file, record by record, with what is damaged left out and said.

mod ordered;

use std::collections::{BTreeSet, VecDeque};
use std::path::Path;

use mcap::MAGIC;
use mcap::records::op;

use super::channels::{ChannelTable, Definitions};
use super::chunk::{ChunkHeader, ChunkRecords, ChunkTrouble, MIN_HEADER_LEN};
use super::fields::Fields;
use super::foreign::not_mcap;
use super::head::{self, Head};
use super::loss::Losses;
use super::order::{ChunkPlace, Only, Order};
use super::source::Source;
use super::unpacked::Unpacked;
use super::window::Window;
use super::{BagError, RECORD_LIMIT};
use ordered::Ordered;

/// A record begins with its opcode and a 64-bit length.
const RECORD_HEAD_LEN: u64 = 1 + 8;

/// A header names a profile and a library.
const MAX_HEADER_LEN: u64 = 1 << 20;

/// No compression has a name as long as this; what claims one is damaged.
const MAX_COMPRESSION_NAME: u32 = 32;

/// Where the reader of a file stands besides the file itself.
pub(super) struct Context<'a> {
    /// Channels of all inputs.
    pub(super) table: &'a mut ChannelTable,
    /// Where damage is noted.
    pub(super) losses: &'a mut Losses,
    /// Which input the file belongs to.
    pub(super) input: usize,
    /// Whether attachments and metadata are passed over unread.
    pub(super) messages_only: bool,
}

struct OpenChunk {
    records: ChunkRecords,
    start: u64,
    /// The first byte behind the chunk record.
    end: u64,
    n_messages: u64,
}

/// One file that is being read.
pub(super) struct McapFile {
    source: Source,
    /// Whether messages come as they stand, not in the order of time.
    as_written: bool,
    chunk: Option<OpenChunk>,
    /// Messages of the chunk that are unpacked.
    window: Window,
    ordered: Option<Ordered>,
    /// The chunks and notes that are still to be read, where that isn't all of the file.
    only: Option<VecDeque<u64>>,
    /// Whether it has come to the first chunk of a file of which only some are read.
    among_chunks: bool,
    /// Where the first chunk of the index stands, in a file of which only some are read.
    first_indexed: Option<u64>,
    definitions: Definitions,
    n_messages: u64,
    /// Messages of channels that the file does not define: how many, and the first one's place and channel.
    unknown_channel: Option<(u64, u64, u16)>,
    data_ended: bool,
    done: bool,
}

impl McapFile {
    /// Open `path`, which begins with the MCAP magic. Its messages come as they stand, or else each chunk's in the order of
    /// time, and the chunks in the order given.
    pub(super) fn open(path: &Path, unpacked: Unpacked, order: Order) -> Result<Self, BagError> {
        let Order { chunks, as_written, only, .. } = order;
        let mut source = Source::open(path, unpacked)?;
        let mut magic = Vec::new();
        source.read_up_to(MAGIC.len() as u64, &mut magic)?;
        if magic != MAGIC {
            return Err(not_mcap(path, &mut source));
        }
        let mut ordered = chunks.map(Ordered::new);
        let mut definitions = Definitions::default();
        let only = only.map(|Only { places, first, notes, definitions: known }| {
            source.plan(places.iter().map(ChunkPlace::span).collect());
            definitions = known;
            let chunks: BTreeSet<u64> = places.iter().map(|place| place.offset).collect();
            let notes = notes.into_iter();
            // Chunks that are put in order are no part of the way through the file.
            let stops: BTreeSet<u64> = match &mut ordered {
                Some(ordered) => {
                    ordered.read_only(&chunks);
                    notes.collect()
                }
                None => notes.chain(chunks).collect(),
            };
            (VecDeque::from_iter(stops), first)
        });
        let first_indexed = only.as_ref().map(|(_, first)| *first);
        let only = only.map(|(stops, _)| stops);
        Ok(McapFile {
            source,
            as_written,
            chunk: None,
            window: Window::default(),
            ordered,
            only,
            among_chunks: false,
            first_indexed,
            definitions,
            n_messages: 0,
            unknown_channel: None,
            data_ended: false,
            done: false,
        })
    }

    /// Refuse a recording of ROS 1 by its header, before anything else is read.
    pub(super) fn check_header(&mut self) -> Result<(), BagError> {
        let mut head = [0; RECORD_HEAD_LEN as usize];
        if !self.source.read_exact(&mut head)? {
            return Ok(()); // noted as cut off when the messages are read
        }
        let [opcode, len @ ..] = head;
        let len = u64::from_le_bytes(len);
        if opcode != op::HEADER || len > MAX_HEADER_LEN {
            return Ok(());
        }
        let mut body = vec![0; len as usize];
        if self.source.read_exact(&mut body)? { self.handle_header(&body) } else { Ok(()) }
    }

    fn handle_header(&self, body: &[u8]) -> Result<(), BagError> {
        match Fields(body).string() {
            Some(profile) if profile == "ros1" => Err(BagError::Profile { path: self.source.path.clone(), profile }),
            _ => Ok(()),
        }
    }

    /// Size of the file when it was last asked for, in bytes.
    pub(super) fn size(&self) -> u64 {
        self.source.size
    }

    /// Bytes read so far; it never goes back.
    pub(super) fn bytes_read(&self) -> u64 {
        self.ordered.as_ref().map_or(self.source.pos, |ordered| ordered.bytes_read)
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.source.path
    }

    /// The next message, attachment or metadata: its body is put into `body`. `None` at the end of what can be read.
    pub(super) fn next(&mut self, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<Option<Head>, BagError> {
        loop {
            if let Some(channel) = self.window.pop(body) {
                return Ok(Some(message_of(channel, body)));
            }
            if self.ordered.as_ref().is_some_and(|ordered| ordered.at_chunks) {
                return self.next_in_order(body, cx);
            }
            if self.done {
                return Ok(None);
            }
            let head = match self.chunk {
                Some(_) if !self.as_written => self.unpack(body, cx)?,
                Some(_) => self.next_of_chunk(body, cx)?,
                None => self.next_of_file(body, cx)?,
            };
            if head.is_some() {
                return Ok(head);
            }
        }
    }

    /// Unpack the chunk as far as the window reaches, and put that in order. What is no message is returned at once.
    fn unpack(&mut self, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<Option<Head>, BagError> {
        let mut other = None;
        while self.chunk.is_some() && other.is_none() && !self.window.is_full() {
            match self.next_of_chunk(body, cx)? {
                Some(Head::Message { channel, message }) => self.window.push(message.log_time, channel, body),
                head => other = head,
            }
        }
        self.window.order();
        Ok(other)
    }

    /// Make sense of one record; `None` for those that the caller doesn't see.
    fn handle_record(&mut self, opcode: u8, body: &[u8], cx: &mut Context<'_>) -> Result<Option<Head>, BagError> {
        let at = self
            .chunk
            .as_ref()
            .map_or(self.source.pos.saturating_sub(body.len() as u64 + RECORD_HEAD_LEN), |chunk| chunk.start);
        let complaint = match opcode {
            op::HEADER => {
                self.handle_header(body)?;
                None
            }
            op::SCHEMA => self.definitions.handle_schema(body).err(),
            op::CHANNEL => self.definitions.handle_channel(body, cx.input, cx.table).err(),
            op::MESSAGE => match head::message(body) {
                Ok((channel_id, message)) => match self.definitions.channel(channel_id) {
                    Some(channel) => {
                        self.n_messages += 1;
                        if let Some(chunk) = &mut self.chunk {
                            chunk.n_messages += 1;
                        }
                        return Ok(Some(Head::Message { channel, message }));
                    }
                    None => {
                        self.unknown_channel.get_or_insert((0, at, channel_id)).0 += 1;
                        None
                    }
                },
                Err(complaint) => Some(complaint),
            },
            op::ATTACHMENT => match head::attachment(body) {
                Some(head) => return Ok((!cx.messages_only).then_some(head)),
                None => Some("an attachment is malformed and not read".to_owned()),
            },
            op::METADATA => match head::metadata(body) {
                Some(head) => return Ok((!cx.messages_only).then_some(head)),
                None => Some("a metadata record is malformed and not read".to_owned()),
            },
            op::DATA_END => {
                self.data_ended = true;
                None
            }
            op::FOOTER => {
                self.handle_footer(cx)?;
                None
            }
            _ => None,
        };
        // Behind the end of the data stand copies and indexes: what is wrong there loses nothing.
        if let Some(complaint) = complaint.filter(|_| !self.data_ended) {
            cx.losses.push(&self.source.path, at, format!("at byte {at}: {complaint}"));
        }
        Ok(None)
    }

    /// The next record of the chunk that the caller sees, or `None`; at its end the chunk is no longer there.
    fn next_of_chunk(&mut self, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<Option<Head>, BagError> {
        let Some(chunk) = &mut self.chunk else { return Ok(None) };
        let next = chunk.records.next(&mut self.source, body);
        let (start, end, n_messages) = (chunk.start, chunk.end, chunk.n_messages);
        let complaint = match next {
            Ok(Some(opcode)) => return self.handle_record(opcode, body, cx),
            Ok(None) => None,
            Err(ChunkTrouble::CutOff) => {
                self.cut_off(start, cx);
                return Ok(None);
            }
            Err(ChunkTrouble::Io(error)) => return Err(self.source.error(error)),
            Err(ChunkTrouble::Checksum) => Some(format!(
                "the checksum of the chunk at byte {start} is wrong: the {n_messages} messages read from it may be damaged"
            )),
            Err(ChunkTrouble::Damaged(why)) => Some(format!(
                "the chunk at byte {start} is damaged ({why}): {n_messages} messages were read from it, the rest of it is lost"
            )),
        };
        self.chunk = None;
        if let Some(complaint) = complaint {
            cx.losses.push(&self.source.path, start, complaint);
        }
        if !self.source.reaches(end) {
            self.cut_off(start, cx);
            return Ok(None);
        }
        self.source.skip_to(end)?;
        Ok(None)
    }

    /// Goes on to the next chunk of those that are read; `false` behind the last.
    fn skip_to_wanted(&mut self) -> Result<bool, BagError> {
        let Some(only) = &mut self.only else { return Ok(true) };
        while only.front().is_some_and(|offset| *offset < self.source.pos) {
            only.pop_front();
        }
        match only.front() {
            Some(&offset) => self.source.seek_to(offset).map(|()| true),
            None => Ok(false),
        }
    }

    fn next_of_file(&mut self, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<Option<Head>, BagError> {
        if self.among_chunks && !self.skip_to_wanted()? {
            self.finish(cx);
            return Ok(None);
        }
        let start = self.source.pos;
        let mut head = [0; RECORD_HEAD_LEN as usize];
        if !self.source.read_exact(&mut head)? {
            self.cut_off(start, cx);
            return Ok(None);
        }
        let [opcode, len @ ..] = head;
        let len = u64::from_le_bytes(len);
        if self.among_chunks && !matches!(opcode, op::CHUNK | op::METADATA) {
            let what = format!("there is nothing to be read at byte {start}, where the index has something");
            cx.losses.push(&self.source.path, start, what);
            return Ok(None);
        }
        if opcode == op::CHUNK && self.only.is_some() && !self.among_chunks {
            // From here on only what is wanted is read; notes in front of the first chunk were read on the way.
            self.among_chunks = true;
            if self.first_indexed.is_some_and(|first| start < first) {
                let what = format!("the chunk at byte {start} is not in the index and not read");
                cx.losses.push(&self.source.path, start, what);
            }
            self.source.seek_to(start)?;
            return Ok(None);
        }
        if opcode == 0 || (opcode > op::DATA_END && opcode < 0x80) {
            self.garbage(start, &format!("opcode {opcode:#04x} is none of MCAP's"), cx);
            return Ok(None);
        }
        if opcode == op::CHUNK && !self.data_ended {
            match &self.ordered {
                None => return self.open_chunk(start, len, body, cx).map(|()| None),
                Some(ordered) if !ordered.knows(start) => {
                    let what = format!("the chunk at byte {start} is not in the index and not read");
                    cx.losses.push(&self.source.path, start, what);
                }
                Some(_) => {}
            }
        }
        let Some(end) = self.source.pos.checked_add(len).filter(|&end| self.source.reaches(end)) else {
            // A length that no recorder writes is damage; one that fits a recording was cut short.
            if len > RECORD_LIMIT as u64 {
                self.garbage(start, &format!("a record claims {len} bytes"), cx);
            } else {
                self.cut_off(start, cx);
            }
            return Ok(None);
        };
        let wanted = match opcode {
            op::ATTACHMENT | op::METADATA => !cx.messages_only,
            op::MESSAGE_INDEX | op::CHUNK_INDEX | op::ATTACHMENT_INDEX | op::METADATA_INDEX => false,
            op::SUMMARY_OFFSET | op::STATISTICS | op::CHUNK => false,
            opcode => opcode < 0x80,
        };
        if !wanted {
            self.source.skip_to(end)?;
            return Ok(None);
        }
        if len > RECORD_LIMIT as u64 {
            if !self.data_ended {
                let what =
                    format!("a record of {len} bytes at byte {start} is over the limit of {RECORD_LIMIT} and not read");
                cx.losses.push(&self.source.path, start, what);
            }
            self.source.skip_to(end)?;
            return Ok(None);
        }
        self.source.read_up_to(len, body)?;
        if (body.len() as u64) < len {
            self.cut_off(start, cx);
            return Ok(None);
        }
        self.handle_record(opcode, body, cx)
    }

    /// Start on the chunk at `start`; its head is read through `body`.
    fn open_chunk(&mut self, start: u64, len: u64, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<(), BagError> {
        body.resize(MIN_HEADER_LEN, 0);
        if !self.source.read_exact(body)? {
            self.cut_off(start, cx);
            return Ok(());
        }
        let name_len = u32::from_le_bytes([body[28], body[29], body[30], body[31]]);
        if name_len > MAX_COMPRESSION_NAME {
            self.garbage(start, &format!("a chunk names its compression in {name_len} bytes"), cx);
            return Ok(());
        }
        body.resize(MIN_HEADER_LEN + name_len as usize, 0);
        let mut rest = body.split_off(MIN_HEADER_LEN);
        let complete = self.source.read_exact(&mut rest)?;
        body.append(&mut rest);
        if !complete {
            self.cut_off(start, cx);
            return Ok(());
        }
        let header = ChunkHeader::parse(body);
        let room = len.checked_sub(body.len() as u64);
        let (Some(header), Some(room)) = (header, room) else {
            self.garbage(start, "a chunk's head is malformed", cx);
            return Ok(());
        };
        // A chunk that was never closed claims all there could be, and holds what is there.
        if header.compressed_size > room && len != u64::MAX {
            self.garbage(start, "a chunk claims more records than fit into it", cx);
            return Ok(());
        }
        if !matches!(header.compression.as_str(), "" | "zstd" | "lz4") {
            return self.unknown_compression(start, header.compression, cx);
        }
        let end = self.source.pos.saturating_add(room);
        self.window.expect(header.uncompressed_size);
        self.chunk = Some(OpenChunk { records: ChunkRecords::new(&header), start, end, n_messages: 0 });
        Ok(())
    }

    /// An unknown compression is refused, unless earlier chunks were readable: then it is damage.
    fn unknown_compression(&mut self, start: u64, got: String, cx: &mut Context<'_>) -> Result<(), BagError> {
        if self.n_messages == 0 && got.chars().all(|letter| letter.is_ascii_graphic()) {
            return Err(BagError::Compression { path: self.source.path.clone(), got });
        }
        self.garbage(start, &format!("a chunk names the compression {got:?}"), cx);
        Ok(())
    }

    /// Behind the footer stands the magic again, and then nothing.
    fn handle_footer(&mut self, cx: &mut Context<'_>) -> Result<(), BagError> {
        let mut magic = [0; MAGIC.len()];
        let complete = self.source.read_exact(&mut magic)? && magic == *MAGIC;
        let rest = self.source.size_now().saturating_sub(self.source.pos);
        if complete && rest > 0 {
            let what =
                format!("{rest} bytes behind the end of the recording, at byte {}, are not read", self.source.pos);
            cx.losses.push(&self.source.path, self.source.pos, what);
        }
        self.finish(cx);
        Ok(())
    }

    fn cut_off(&mut self, record_start: u64, cx: &mut Context<'_>) {
        if !self.data_ended {
            let size = self.source.size_now();
            let what = if record_start == size {
                format!("cut off at byte {size}: the end of the file is missing")
            } else {
                format!(
                    "cut off at byte {size}: the end of the file is missing, from within the record at byte {record_start}"
                )
            };
            cx.losses.push(&self.source.path, size, what);
        }
        self.forget_from(record_start);
        self.finish(cx);
    }

    fn garbage(&mut self, at: u64, why: &str, cx: &mut Context<'_>) {
        if !self.data_ended {
            let lost = self.source.size_now().saturating_sub(at);
            let what = format!("damaged at byte {at} ({why}): the {lost} bytes from there on are lost");
            cx.losses.push(&self.source.path, at, what);
        }
        self.forget_from(at);
        self.finish(cx);
    }

    fn finish(&mut self, cx: &mut Context<'_>) {
        self.chunk = None;
        if let Some(ordered) = &mut self.ordered
            && !ordered.at_chunks
        {
            (ordered.at_chunks, self.data_ended) = (true, false);
            return;
        }
        if let Some((count, at, channel)) = self.unknown_channel.take() {
            let what = format!(
                "{count} messages of channels that the file doesn't define are lost, the first of channel {channel} at byte {at}"
            );
            cx.losses.push(&self.source.path, at, what);
        }
        self.done = true;
    }
}

/// The head of a message whose record has been understood once.
pub(super) fn message_of(channel: usize, body: &[u8]) -> Head {
    let (_, message) = head::message(body).expect("only messages that were read are held");
    Head::Message { channel, message }
}
