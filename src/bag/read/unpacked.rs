//! Files that are packed with zstd as a whole, as `ros2 bag record --compression-mode file` leaves them.

use std::fs::File;
use std::io::{self, Read, Seek as _, Write as _};
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempPath};

use super::{BagError, one_line};

pub(super) const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
pub(super) const ZSTD_MAGIC: &[u8] = &[0x28, 0xB5, 0x2F, 0xFD];

/// A file may unpack to this many times its size and [`UNPACKED_BASE`], but never to more than [`MAX_UNPACKED`]: a few
/// hostile bytes can't fill a disk.
const MAX_RATIO: u64 = 1000;
const UNPACKED_BASE: u64 = 64 << 20;
const MAX_UNPACKED: u64 = 256 << 30;

/// A file as its storage wrote it: the one at the path, or a temporary one that it was unpacked to.
pub(super) struct Unpacked {
    pub(super) file: File,
    /// Where `file` lies.
    pub(super) path: PathBuf,
    /// Removes what was unpacked; `None` of a file that was not packed.
    pub(super) temporary: Option<TempPath>,
}

impl Unpacked {
    /// Open the file at `path`; one that is packed is unpacked to the folder for temporary files. Of a file that is cut off,
    /// what is there is unpacked, and its end is missing then.
    ///
    /// # Errors
    /// [`BagError::Io`] where it can't be read or unpacked, [`BagError::NotABag`] where it unpacks to too much.
    pub(super) fn open(path: &Path) -> Result<Self, BagError> {
        let mut file = File::open(path).map_err(|error| BagError::io(path, "open", error))?;
        let mut magic = Vec::new();
        let read = Read::by_ref(&mut file).take(ZSTD_MAGIC.len() as u64).read_to_end(&mut magic);
        read.and_then(|_| file.rewind()).map_err(|error| BagError::io(path, "read", error))?;
        if magic != ZSTD_MAGIC {
            return Ok(Unpacked { file, path: path.to_path_buf(), temporary: None });
        }
        // A full disk too is that of the temporary files, not one that is written to.
        let unpack = |source| {
            let action = "unpack to the folder for temporary files (TMPDIR)";
            BagError::Io { path: path.to_path_buf(), action, source }
        };
        let size = file.metadata().map_err(|error| BagError::io(path, "read", error))?.len();
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
                Err(error) if n_bytes == 0 => {
                    let why = format!("it is packed with zstd and can't be unpacked: {}", one_line(&error.to_string()));
                    return Err(BagError::NotABag { path: path.to_path_buf(), why });
                }
                // Cut off or damaged: what is missing is said by who reads the rest.
                Err(_) => break,
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
        let (mut file, temporary) = out.into_parts();
        file.rewind().map_err(unpack)?;
        Ok(Unpacked { file, path: temporary.to_path_buf(), temporary: Some(temporary) })
    }
}
