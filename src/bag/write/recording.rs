//! One MCAP file that is being written.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;

use super::{BagAttachment, BagError, Compression};

/// Uncompressed size at which a chunk is closed: what a reader that seeks unpacks at once.
const CHUNK_SIZE: u64 = 1 << 20;

const WRITE_BUFFER: usize = 256 << 10;

const LIBRARY: &str = concat!("tactile_pose_fusion ", env!("CARGO_PKG_VERSION"));

pub(super) struct McapOutput {
    // `None` once finished.
    writer: Option<mcap::Writer<NoSeek<BufWriter<File>>>>,
    /// The output's name, for errors.
    out: PathBuf,
}

impl McapOutput {
    pub(super) fn start(file: File, out: &Path, compression: Compression) -> Result<Self, BagError> {
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .library(LIBRARY)
            .chunk_size(Some(CHUNK_SIZE))
            .use_chunks(true)
            // A chunk is put together in memory and written at once.
            .disable_seeking(true)
            // Threads of the compressor change its bytes, and their number is the machine's.
            .compression_threads(0)
            .compression(match compression {
                Compression::None => None,
                Compression::Lz4 => Some(mcap::Compression::Lz4),
                Compression::Zstd => Some(mcap::Compression::Zstd),
            });
        let sink = NoSeek::new(BufWriter::with_capacity(WRITE_BUFFER, file));
        let writer = options.create(sink).map_err(|error| BagError::mcap(out, error))?;
        Ok(McapOutput { writer: Some(writer), out: out.to_path_buf() })
    }

    fn with<T>(
        &mut self,
        call: impl FnOnce(&mut mcap::Writer<NoSeek<BufWriter<File>>>) -> mcap::McapResult<T>,
    ) -> Result<T, BagError> {
        let writer = self.writer.as_mut().ok_or(mcap::McapError::AttemptedWriteAfterFailure);
        writer.and_then(call).map_err(|error| BagError::mcap(&self.out, error))
    }

    /// The file's id of the channel; equal channels and equal schemas have one.
    pub(super) fn add_channel(
        &mut self,
        topic: &str,
        encoding: &str,
        schema: Option<(&str, &str, &[u8])>,
        metadata: &BTreeMap<String, String>,
    ) -> Result<u16, BagError> {
        self.with(|writer| {
            let schema_id = match schema {
                Some((name, encoding, data)) => writer.add_schema(name, encoding, data)?,
                None => 0,
            };
            writer.add_channel(schema_id, topic, encoding, metadata)
        })
    }

    pub(super) fn write(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), BagError> {
        self.with(|writer| writer.write_to_known_channel(header, data))
    }

    pub(super) fn attach(&mut self, attachment: &BagAttachment<'_>) -> Result<(), BagError> {
        let attachment = mcap::Attachment {
            log_time: attachment.log_time,
            create_time: attachment.create_time,
            name: attachment.name.to_owned(),
            media_type: attachment.media_type.to_owned(),
            data: Cow::Borrowed(attachment.data),
        };
        self.with(|writer| writer.attach(&attachment))
    }

    pub(super) fn write_metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), BagError> {
        let record = Metadata { name: name.to_owned(), metadata };
        self.with(|writer| writer.write_metadata(&record))
    }

    pub(super) fn flush(&mut self) -> Result<(), BagError> {
        self.with(|writer| writer.flush())
    }

    pub(super) fn refuse(&self, why: &str) -> BagError {
        BagError::Format { path: self.out.clone(), why: why.to_owned() }
    }

    /// Write the summary, and see everything onto the disk.
    pub(super) fn finish(&mut self) -> Result<(), BagError> {
        self.with(|writer| writer.finish().map(|_| ()))?;
        let Some(writer) = self.writer.take() else { return Ok(()) };
        let mut sink = writer.into_inner().into_inner();
        let written = sink.flush().and_then(|()| sink.get_ref().sync_all());
        written.map_err(|error| BagError::io(&self.out, "write", error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_disk_is_one_clear_line() {
        let Ok(full) = File::options().write(true).open("/dev/full") else {
            let _ = writeln!(std::io::stderr(), "skipped full_disk_is_one_clear_line: /dev/full is not here");
            return;
        };
        let mut recording = McapOutput::start(full, Path::new("out.mcap"), Compression::None).unwrap();
        let channel = recording.add_channel("/a", "cdr", None, &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
        let error = (0..100).find_map(|_| recording.write(&header, &[7; 100_000]).err()).unwrap();
        assert!(matches!(error, BagError::DiskFull { .. }), "{error}");
        assert_eq!(error.to_string().lines().count(), 1);
        assert!(recording.finish().is_err());
    }
}
