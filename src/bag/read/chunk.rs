//! Records of one chunk, unpacked as they are needed so that a chunk of any size takes little memory.

use std::alloc::Layout;
use std::io::{self, Read};

use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::RECORD_LIMIT;
use super::fields::Fields;

/// Bytes that are read at a time; what a chunk claims about its length reserves no more than this.
const FEED: usize = 64 << 10;

/// Unpacking needs a block of the compressor at once: 4 MiB with lz4, 128 KiB with zstd.
const MIN_LIMIT: usize = 8 << 20;

/// Length of a chunk's header with an empty compression name.
pub(super) const MIN_HEADER_LEN: usize = 8 + 8 + 8 + 4 + 4 + 8;

/// The head of a chunk record, in front of its records.
#[derive(Debug)]
pub(super) struct ChunkHeader {
    pub(super) compression: String,
    pub(super) uncompressed_size: u64,
    uncompressed_crc: u32,
    pub(super) compressed_size: u64,
}

impl ChunkHeader {
    /// Read from the header's bytes, `None` where they are no chunk header.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let mut fields = Fields(bytes);
        let _times = fields.bytes(16)?;
        let uncompressed_size = fields.u64()?;
        let uncompressed_crc = fields.u32()?;
        let compression = fields.string()?;
        Some(ChunkHeader { compression, uncompressed_size, uncompressed_crc, compressed_size: fields.u64()? })
    }
}

/// Why no further record comes out of a chunk.
#[derive(Debug)]
pub(super) enum ChunkTrouble {
    /// The file ends within the chunk.
    CutOff,
    /// The operating system refused.
    Io(io::Error),
    /// Every record came out, but the checksum says that some were changed.
    Checksum,
    /// The chunk holds something else than it should.
    Damaged(String),
}

/// Reads one chunk through the `mcap` crate's reader, which unpacks record by record and checks the checksum.
///
/// The crate's reader is given this one chunk and no byte beyond it: it subtracts lengths unchecked where a record
/// claims to reach past its chunk, which then can't happen.
pub(super) struct ChunkRecords {
    reader: LinearReader,
    /// Bytes of the chunk's records field that have not been read from the file.
    unread: u64,
}

impl ChunkRecords {
    pub(super) fn new(header: &ChunkHeader) -> Self {
        let limit = usize::try_from(header.uncompressed_size).unwrap_or(usize::MAX).clamp(MIN_LIMIT, RECORD_LIMIT);
        let mut reader = LinearReader::new_with_options(
            LinearReaderOptions::default()
                .with_skip_start_magic(true)
                .with_skip_end_magic(true)
                .with_validate_chunk_crcs(true)
                .with_record_length_limit(limit),
        );
        // Padding behind the records is left out; a chunk that was never closed claims the whole 64 bits.
        let compressed_size = header.compressed_size.min(i64::MAX as u64);
        let header_len = (MIN_HEADER_LEN + header.compression.len()) as u64;
        let mut head = vec![op::CHUNK];
        head.extend((header_len + compressed_size).to_le_bytes());
        head.extend([0; 16]); // start and end time, which nobody reads here
        head.extend(header.uncompressed_size.to_le_bytes());
        head.extend(header.uncompressed_crc.to_le_bytes());
        head.extend((header.compression.len() as u32).to_le_bytes());
        head.extend(header.compression.as_bytes());
        head.extend(compressed_size.to_le_bytes());
        reader.insert(head.len()).copy_from_slice(&head);
        reader.notify_read(head.len());
        ChunkRecords { reader, unread: compressed_size }
    }

    /// The next record: its opcode is returned and its body put into `body`. `None` at the chunk's end.
    pub(super) fn next(&mut self, source: &mut impl Read, body: &mut Vec<u8>) -> Result<Option<u8>, ChunkTrouble> {
        loop {
            match self.reader.next_event() {
                None => return Ok(None),
                Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                    body.clear();
                    body.extend_from_slice(data);
                    return Ok(Some(opcode));
                }
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    let left = usize::try_from(self.unread).unwrap_or(usize::MAX);
                    let len = wanted.clamp(1, FEED).min(left);
                    if len == 0 {
                        self.reader.notify_read(0);
                        continue;
                    }
                    let read = read_some(source, self.reader.insert(len)).map_err(ChunkTrouble::Io)?;
                    if read == 0 {
                        return Err(ChunkTrouble::CutOff);
                    }
                    self.reader.notify_read(read);
                    self.unread -= read as u64;
                }
                Some(Err(McapError::BadChunkCrc { .. })) => return Err(ChunkTrouble::Checksum),
                Some(Err(McapError::UnexpectedEof)) => {
                    return Err(ChunkTrouble::Damaged("a record reaches past the end of its chunk".to_owned()));
                }
                Some(Err(McapError::RecordTooLarge { len, .. })) => {
                    return Err(ChunkTrouble::Damaged(format!("a record claims {len} bytes")));
                }
                Some(Err(error)) => {
                    let why = crate::bag::error::one_line(&error.to_string());
                    end_without_memory(&why, FEED);
                    return Err(ChunkTrouble::Damaged(why));
                }
            }
        }
    }
}

/// Ends the process, as any allocation does that fails, where a decompressor had no memory for `n_bytes` more: the input is
/// not damaged then, and must not be told to be.
pub(super) fn end_without_memory(why: &str, n_bytes: usize) {
    if is_no_memory(why) {
        let layout = Layout::array::<u8>(n_bytes).unwrap_or(Layout::new::<u8>());
        std::alloc::handle_alloc_error(layout);
    }
}

/// Whether this is how zstd or LZ4 name an allocation that failed.
fn is_no_memory(why: &str) -> bool {
    ["Allocation error", "allocation_failed"].iter().any(|name| why.contains(name))
}

/// Read at least a byte unless the source is at its end.
fn read_some(source: &mut impl Read, into: &mut [u8]) -> io::Result<usize> {
    loop {
        match source.read(into) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            other => return other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decompressor_without_memory_is_told_from_damaged_input() {
        let name = |code: usize| zstd::zstd_safe::get_error_name(0_usize.wrapping_sub(code)); // as zstd_errors.h numbers them
        assert!(is_no_memory(name(64)), "{}", name(64));
        assert!(is_no_memory("ERROR_allocation_failed"));
        assert!(!is_no_memory(name(20)) && !is_no_memory("ERROR_frameType_unknown"), "{}", name(20));
    }
}
