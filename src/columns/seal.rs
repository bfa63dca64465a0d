//! Checksum of a table. It is checked before any page is decoded, because the decoder trusts its input.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use parquet::file::metadata::RowGroupMetaData;
use sha2::{Digest, Sha256};

/// Name of the note with the seal.
pub(super) const NOTE: &str = "tpf_seal";

/// Seal of the first `n_bytes` of a file, and of the positions of the columns in its groups of rows.
pub(super) fn of<'a>(
    path: &Path,
    n_bytes: u64,
    groups: impl Iterator<Item = &'a RowGroupMetaData>,
) -> std::io::Result<String> {
    let file = File::open(path)?;
    let mut hash = Sha256::new();
    let n_read = std::io::copy(&mut file.take(n_bytes), &mut Hashing(&mut hash))?;
    for group in groups {
        hash.update(format!("{} rows\n", group.num_rows()));
        for column in group.columns() {
            hash.update(format!(
                "{} {:?} {:?} {} {} {} {:?} {}\n",
                column.column_path(),
                column.column_type(),
                column.compression(),
                column.num_values(),
                column.compressed_size(),
                column.uncompressed_size(),
                column.dictionary_page_offset(),
                column.data_page_offset(),
            ));
        }
    }
    let digest = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    Ok(format!("{n_read} {digest}"))
}

/// Number of bytes that a seal covers.
pub(super) fn n_bytes(seal: &str) -> Option<u64> {
    seal.split_once(' ')?.0.parse().ok()
}

struct Hashing<'a>(&'a mut Sha256);

impl std::io::Write for Hashing<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
