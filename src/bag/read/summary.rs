//! Summary of a file from its end, without reading the whole.

use std::collections::BTreeMap;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::ops::Range;
use std::path::Path;

use mcap::MAGIC;
use mcap::records::op;

use super::BagError;
use super::channels::{ChannelTable, Definitions};
use super::fields::Fields;
use super::order::ChunkPlace;
use super::unpacked::Unpacked;
use crate::units::Stamp;

/// Footer record (head, two offsets, checksum) and the magic behind it.
const FOOTER_LEN: u64 = 1 + 8 + 8 + 8 + 4 + MAGIC.len() as u64;

/// The record that ends the data: head and checksum.
const DATA_END_LEN: u64 = 1 + 8 + 4;

/// The longest record of a summary that is worth reading: a schema of some MB.
const MAX_SUMMARY_RECORD: u64 = 64 << 20;

/// Summary of one file.
#[derive(Debug)]
pub(super) struct FileSummary {
    pub(super) statistics: Option<Statistics>,
    /// A compression that can't be unpacked, where the index names one.
    pub(super) unknown_compression: Option<String>,
    /// Where the index says that chunks are, in its order.
    pub(super) chunks: Vec<ChunkPlace>,
    /// Where the index says that named notes are.
    pub(super) notes: Vec<u64>,
    /// Whether the index knows everything from the first chunk to the end of the data.
    pub(super) is_indexed: bool,
    /// Its channels and schemas.
    pub(super) definitions: Option<Definitions>,
    /// Whether the rows of a sqlite3 file are to be put in the order of time.
    pub(super) by_time: bool,
}

/// Counts of a file, by the place of the channel in the table.
#[derive(Debug)]
pub(super) struct Statistics {
    pub(super) n_messages: u64,
    pub(super) span: Option<(Stamp, Stamp)>,
    pub(super) by_channel: BTreeMap<usize, u64>,
}

/// Read the summary section of the file at `path`, entering its channels into `table`.
///
/// `None` where there is none, or none that makes sense: reading the file finds the same and more.
///
/// # Errors
/// [`BagError::Io`] when the file can't be read.
pub(super) fn read(
    path: &Path,
    mut unpacked: Unpacked,
    input: usize,
    table: &mut ChannelTable,
) -> Result<Option<FileSummary>, BagError> {
    let io_error = |error| BagError::io(path, "read", error);
    let file = &mut unpacked.file;
    let size = file.size().map_err(io_error)?;
    let Some(footer_start) = size.checked_sub(FOOTER_LEN) else { return Ok(None) };
    file.seek(SeekFrom::Start(footer_start)).map_err(io_error)?;
    let mut footer = Vec::new();
    file.by_ref().take(FOOTER_LEN).read_to_end(&mut footer).map_err(io_error)?;
    let Some(start) = summary_start(&footer).filter(|&start| start < footer_start) else { return Ok(None) };
    file.seek(SeekFrom::Start(start)).map_err(io_error)?;
    let mut source = BufReader::new(file).take(footer_start - start);

    let mut definitions = Definitions::default();
    let mut summary = FileSummary {
        statistics: None,
        unknown_compression: None,
        chunks: Vec::new(),
        notes: Vec::new(),
        is_indexed: false,
        definitions: None,
        by_time: false,
    };
    let (mut statistics, mut n_channels) = (None, 0);
    let mut body = Vec::new();
    let mut beside = Vec::new();
    loop {
        let mut head = [0; 9];
        match source.read_exact(&mut head) {
            Ok(()) => {}
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => break,
            Err(error) => return Err(io_error(error)),
        }
        let [opcode, len @ ..] = head;
        let len = u64::from_le_bytes(len);
        if len > source.limit().min(MAX_SUMMARY_RECORD) {
            return Ok(None);
        }
        body.clear();
        source.by_ref().take(len).read_to_end(&mut body).map_err(io_error)?;
        match opcode {
            op::SCHEMA => definitions.handle_schema(&body).unwrap_or_default(),
            op::CHANNEL => {
                n_channels += 1;
                definitions.handle_channel(&body, input, table).unwrap_or_default();
            }
            op::STATISTICS => statistics = parse_statistics(&body),
            op::METADATA_INDEX | op::ATTACHMENT_INDEX => {
                let mut fields = Fields(&body);
                if let (Some(offset), Some(len)) = (fields.u64(), fields.u64()) {
                    beside.push(offset..offset.saturating_add(len));
                    summary.notes.extend((opcode == op::METADATA_INDEX).then_some(offset));
                }
            }
            op::CHUNK_INDEX => {
                if let Some(name) = compression(&body).filter(|name| !matches!(name.as_str(), "" | "zstd" | "lz4")) {
                    summary.unknown_compression.get_or_insert(name);
                }
                summary.chunks.extend(ChunkPlace::parse(&body));
            }
            _ => {}
        }
    }
    // A channel that the summary doesn't define may be defined in a chunk without a message of it.
    let is_defined = |place: &ChunkPlace| place.channels.iter().all(|id| definitions.channel(*id).is_some());
    summary.is_indexed = knows_everything(&summary.chunks, beside, start) && summary.chunks.iter().all(is_defined);
    let Some((n_messages, span, counts)) = statistics else {
        summary.definitions = Some(definitions);
        // Some writers list channels and no statistics, others nothing at all.
        return Ok((n_channels > 0).then_some(summary));
    };
    if n_messages > 0 && n_channels == 0 {
        return Ok(None);
    }
    let mut by_channel = BTreeMap::new();
    for (id, count) in counts {
        if let Some(channel) = definitions.channel(id) {
            let total: &mut u64 = by_channel.entry(channel).or_default();
            *total = total.saturating_add(count);
        }
    }
    summary.definitions = Some(definitions);
    summary.statistics = Some(Statistics { n_messages, span, by_channel });
    Ok(Some(summary))
}

/// Whether indexed records follow one another from the first chunk to the end of the data, in front of the summary: messages
/// outside of chunks stand in no index.
fn knows_everything(chunks: &[ChunkPlace], beside: Vec<Range<u64>>, summary_start: u64) -> bool {
    let with_indexes = |place: &ChunkPlace| place.offset..place.span().end.saturating_add(place.indexes_len);
    let Some(first) = chunks.iter().map(|place| place.offset).min() else { return false };
    let beside = beside.into_iter().filter(|record| record.start >= first);
    let mut records: Vec<Range<u64>> = chunks.iter().map(with_indexes).chain(beside).collect();
    records.sort_by_key(|record| record.start);
    let follow = records.windows(2).all(|pair| pair[0].end == pair[1].start);
    follow && records.last().is_some_and(|last| last.end.saturating_add(DATA_END_LEN) == summary_start)
}

/// Where the summary begins, by the footer; `None` where the footer is none or names no summary.
fn summary_start(footer: &[u8]) -> Option<u64> {
    let mut fields = Fields(footer);
    let opcode = fields.bytes(1)?;
    let (len, start, _offsets, _crc) = (fields.u64()?, fields.u64()?, fields.u64()?, fields.u32()?);
    (opcode == [op::FOOTER] && len == 20 && fields.0 == MAGIC && start > 0).then_some(start)
}

type Counts = (u64, Option<(Stamp, Stamp)>, BTreeMap<u16, u64>);

fn parse_statistics(body: &[u8]) -> Option<Counts> {
    let mut fields = Fields(body);
    let n_messages = fields.u64()?;
    let _counts_of_other_records = fields.bytes(2 + 4 * 4)?;
    let (first, last) = (fields.u64()?, fields.u64()?);
    let stamp = |time| i64::try_from(time).ok().map(Stamp);
    let span = stamp(first).zip(stamp(last)).filter(|_| n_messages > 0);
    Some((n_messages, span, fields.count_map()?))
}

fn compression(chunk_index: &[u8]) -> Option<String> {
    let mut fields = Fields(chunk_index);
    let _times_and_place = fields.bytes(4 * 8)?;
    let _offsets = fields.block()?;
    let _length = fields.u64()?;
    fields.string()
}
