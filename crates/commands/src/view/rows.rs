//! The samples of a tactile source in a temporary file, to be read back beside frames of rising stamps.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};

use tactile_pose_fusion::fusion::{TactileBlock, TactileSource};
use tactile_pose_fusion::units::Stamp;

use super::error::ViewError;

/// Samples of a source, as they come.
#[derive(Debug)]
pub(super) struct RowsWriting {
    file: BufWriter<File>,
    newest: Option<Stamp>,
}

/// Samples of a source, oldest first.
#[derive(Debug)]
pub(super) struct Rows {
    file: BufReader<File>,
    n_taxels: usize,
    /// The newest sample at the stamp that was asked for last.
    current: Option<(Stamp, Vec<f32>)>,
    next: Option<(Stamp, Vec<f32>)>,
}

impl RowsWriting {
    /// No samples yet.
    pub(super) fn new() -> Result<Self, ViewError> {
        let file = BufWriter::with_capacity(1 << 16, tempfile::tempfile().map_err(ViewError::keep)?);
        Ok(RowsWriting { file, newest: None })
    }

    /// Adds the samples of a message, but for those that are late or of another length.
    pub(super) fn handle(&mut self, block: &TactileBlock<'_>, source: &TactileSource) -> Result<(), ViewError> {
        if block.rows.checked_mul(source.n_taxels) != Some(block.values.len()) {
            return Ok(());
        }
        for (row_idx, row) in block.values.chunks_exact(source.n_taxels).enumerate() {
            let before_last = (block.rows - 1 - row_idx) as i64;
            let stamp = block.stamp.offset(source.stamp_offset_ns - block.row_period_ns.saturating_mul(before_last));
            if self.newest.is_some_and(|newest| stamp <= newest) {
                continue;
            }
            self.newest = Some(stamp);
            self.file.write_all(&stamp.0.to_le_bytes()).map_err(ViewError::keep)?;
            for value in row {
                self.file.write_all(&value.to_le_bytes()).map_err(ViewError::keep)?;
            }
        }
        Ok(())
    }

    /// All samples of `n_taxels`, to be read.
    pub(super) fn finish(self, n_taxels: usize) -> Result<Rows, ViewError> {
        let mut file = self.file.into_inner().map_err(|error| ViewError::keep(error.into_error()))?;
        file.rewind().map_err(ViewError::keep)?;
        let mut rows = Rows { file: BufReader::with_capacity(1 << 16, file), n_taxels, current: None, next: None };
        rows.next = rows.read()?;
        Ok(rows)
    }
}

impl Rows {
    /// The newest sample at a stamp, if it is not older than `max_age_ns`. Stamps must rise from call to call.
    pub(super) fn at(&mut self, stamp: Stamp, max_age_ns: i64) -> Result<Option<&[f32]>, ViewError> {
        while self.next.as_ref().is_some_and(|(next, _)| *next <= stamp) {
            let after = self.read()?;
            self.current = std::mem::replace(&mut self.next, after);
        }
        let current = self.current.as_ref().filter(|(at, _)| (0..=max_age_ns).contains(&stamp.nanos_since(*at)));
        Ok(current.map(|(_, row)| row.as_slice()))
    }

    fn read(&mut self) -> Result<Option<(Stamp, Vec<f32>)>, ViewError> {
        let mut bytes = vec![0; 8 + 4 * self.n_taxels];
        match self.file.read_exact(&mut bytes) {
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(None),
            read => read.map_err(ViewError::keep)?,
        }
        let stamp = Stamp(i64::from_le_bytes(bytes[..8].try_into().unwrap_or_default()));
        let floats = bytes[8..].chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap_or_default()));
        Ok(Some((stamp, floats.collect())))
    }
}
