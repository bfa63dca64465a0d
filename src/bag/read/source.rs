//! The bytes of one file, with the place of the next one known.

use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::TempPath;

use super::BagError;
use super::unpacked::Unpacked;
use crate::location::Reader;

const READ_BUFFER: usize = 256 << 10;

/// A file that is read from its start.
pub(super) struct Source {
    pub(super) path: PathBuf,
    /// Removes a file that was unpacked once it is read.
    _temporary: Option<Arc<TempPath>>,
    reader: BufReader<Reader>,
    /// The next byte of the file to be read.
    pub(super) pos: u64,
    /// Size of the file when it was last asked for, in bytes.
    pub(super) size: u64,
}

impl Source {
    /// The file that `path` was unpacked to.
    pub(super) fn open(path: &Path, unpacked: Unpacked) -> Result<Self, BagError> {
        let Unpacked { file, temporary, .. } = unpacked;
        let size = file.size().map_err(|error| BagError::io(path, "open", error))?;
        let reader = BufReader::with_capacity(READ_BUFFER, file);
        Ok(Source { path: path.to_path_buf(), _temporary: temporary, reader, pos: 0, size })
    }

    /// Put the next `len` bytes into `into`, or fewer where the file ends. Memory grows with what is there only.
    pub(super) fn read_up_to(&mut self, len: u64, into: &mut Vec<u8>) -> Result<(), BagError> {
        into.clear();
        let read = Read::by_ref(&mut self.reader).take(len).read_to_end(into);
        self.pos += read.map_err(|error| self.error(error))? as u64;
        Ok(())
    }

    /// Fill `into`; `false` where the file ends before.
    pub(super) fn read_exact(&mut self, into: &mut [u8]) -> Result<bool, BagError> {
        match self.reader.read_exact(into) {
            Ok(()) => {
                self.pos += into.len() as u64;
                Ok(true)
            }
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
            Err(error) => Err(self.error(error)),
        }
    }

    pub(super) fn skip_to(&mut self, end: u64) -> Result<(), BagError> {
        let by = end.saturating_sub(self.pos);
        if by <= self.reader.buffer().len() as u64 {
            self.reader.consume(by as usize);
        } else {
            self.reader.seek(SeekFrom::Start(end)).map_err(|error| self.error(error))?;
        }
        self.pos = end;
        Ok(())
    }

    /// Go to a byte of the file.
    pub(super) fn seek_to(&mut self, pos: u64) -> Result<(), BagError> {
        self.reader.seek(SeekFrom::Start(pos)).map_err(|error| self.error(error))?;
        self.pos = pos;
        Ok(())
    }

    /// Whether the file has the bytes up to `end`. Its size is asked for again only there: a recording may still grow.
    pub(super) fn reaches(&mut self, end: u64) -> bool {
        end <= self.size || end <= self.size_now()
    }

    /// Size of the file at this moment.
    pub(super) fn size_now(&mut self) -> u64 {
        if let Ok(size) = self.reader.get_ref().size() {
            self.size = size;
        }
        self.size
    }

    /// Say which stretches will be read, in order; of a file that is not on this machine, nothing else is asked for.
    pub(super) fn plan(&mut self, stretches: Vec<Range<u64>>) {
        self.reader.get_mut().plan(stretches);
    }

    pub(super) fn error(&self, error: io::Error) -> BagError {
        BagError::io(&self.path, "read", error)
    }
}

impl Read for Source {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.reader.read(into)?;
        self.pos += read as u64;
        Ok(read)
    }
}
