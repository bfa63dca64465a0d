//! Files that are packed with zstd as a whole, as `ros2 bag record --compression-mode file` leaves them, and `.db3` files that
//! are not on this machine: both are read from a temporary file.

use std::fs::File;
use std::io::{self, Read, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use tempfile::{NamedTempFile, TempPath};

use super::chunk::end_without_memory;
use super::{BagError, one_line};
use crate::location::{self, Place, Reader};

pub(super) const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
pub(super) const ZSTD_MAGIC: &[u8] = &[0x28, 0xB5, 0x2F, 0xFD];

/// A file may unpack to this many times its size and [`UNPACKED_BASE`], but never to more than [`MAX_UNPACKED`]: a few
/// hostile bytes can't fill a disk.
const MAX_RATIO: u64 = 1000;
const UNPACKED_BASE: u64 = 64 << 20;
const MAX_UNPACKED: u64 = 256 << 30;

const COPY: &str = "copy to the folder for temporary files (TMPDIR)";

/// A file as its storage wrote it: the one at the path, or a temporary one that it was unpacked or copied to.
pub(super) struct Unpacked {
    pub(super) file: Reader,
    /// Where `file` lies.
    pub(super) path: PathBuf,
    /// Removes what was unpacked; `None` of a file that is read where it is.
    pub(super) temporary: Option<Arc<TempPath>>,
}

impl Unpacked {
    /// Open the file at `path`; one that is packed is unpacked to the folder for temporary files. Of a file that is cut off,
    /// what is there is unpacked, and its end is missing then.
    ///
    /// # Errors
    /// [`BagError::Io`] where it can't be read or unpacked, [`BagError::NotABag`] where it unpacks to too much.
    pub(super) fn open(place: &Place) -> Result<Self, BagError> {
        let path = place.path();
        if let Some(copy) = place.copy() {
            return Self::of_copy(path, copy);
        }
        let mut file = place.open().map_err(|error| BagError::io(path, "open", error))?;
        let mut magic = Vec::new();
        let read = Read::by_ref(&mut file).take(SQLITE_MAGIC.len() as u64).read_to_end(&mut magic);
        read.and_then(|_| file.rewind()).map_err(|error| BagError::io(path, "read", error))?;
        if place.is_remote() && magic == SQLITE_MAGIC {
            return Self::copied(place, file);
        }
        if !magic.starts_with(ZSTD_MAGIC) {
            return Ok(Unpacked { file, path: path.to_path_buf(), temporary: None });
        }
        // A full disk too is that of the temporary files, not one that is written to.
        let unpack = |source| {
            let action = "unpack to the folder for temporary files (TMPDIR)";
            BagError::Io { path: path.to_path_buf(), action, source }
        };
        let size = file.size().map_err(|error| BagError::io(path, "read", error))?;
        let limit = size.saturating_mul(MAX_RATIO).saturating_add(UNPACKED_BASE).min(MAX_UNPACKED);
        let mut out = NamedTempFile::new().map_err(unpack)?;
        let mut packed = zstd::stream::read::Decoder::new(file).map_err(unpack)?;
        let mut buffer = vec![0; 256 << 10];
        let mut n_bytes = 0;
        loop {
            let n = match packed.read(&mut buffer) {
                Ok(0) => break,
                Ok(n) => n,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                // What a store refuses to send isn't lost, but can't be read now.
                Err(error) if location::is_refusal(&error) => {
                    return Err(BagError::io(path, "read", error));
                }
                Err(error) if n_bytes == 0 => {
                    end_without_memory(&error.to_string(), buffer.len());
                    let why = format!("it is packed with zstd and can't be unpacked: {}", one_line(&error.to_string()));
                    return Err(BagError::NotABag { path: path.to_path_buf(), why });
                }
                // Cut off or damaged: what is missing is said by who reads the rest.
                Err(error) => {
                    end_without_memory(&error.to_string(), buffer.len());
                    break;
                }
            };
            n_bytes += n as u64;
            if n_bytes > limit {
                let why = format!(
                    "its {size} bytes of zstd unpack to more than {limit} bytes, the limit of {MAX_RATIO} times its size and 64 MiB, at most 256 GiB: unpack it with `zstd -d` if it is a recording"
                );
                return Err(BagError::NotABag { path: path.to_path_buf(), why });
            }
            out.write_all(&buffer[..n]).map_err(unpack)?;
        }
        Self::kept(place, out)
    }

    /// Copy a file that isn't on this machine.
    fn copied(place: &Place, mut file: Reader) -> Result<Self, BagError> {
        let failed = |action, source| BagError::Io { path: place.path().to_path_buf(), action, source };
        let mut out = NamedTempFile::new().map_err(|error| failed(COPY, error))?;
        let mut buffer = vec![0; 1 << 20];
        loop {
            match file.read(&mut buffer).map_err(|error| failed("read", error))? {
                0 => break,
                n => out.write_all(&buffer[..n]).map_err(|error| failed(COPY, error))?,
            }
        }
        Self::kept(place, out)
    }

    /// Keeps an unpacked or copied file. That of a remote file is there for the next reader, too.
    fn kept(place: &Place, out: NamedTempFile) -> Result<Self, BagError> {
        let temporary = out.into_temp_path();
        let temporary = if place.is_remote() { place.keep(temporary) } else { Arc::new(temporary) };
        Self::of_copy(place.path(), temporary)
    }

    fn of_copy(path: &Path, copy: Arc<TempPath>) -> Result<Self, BagError> {
        let file = File::open(&**copy).map_err(|error| BagError::io(path, "open", error))?;
        Ok(Unpacked { file: Reader::Local(file), path: copy.to_path_buf(), temporary: Some(copy) })
    }
}
