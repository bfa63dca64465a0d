//! Losses: parts of a bag that could not be read, kept for a person to see.

use std::path::{Path, PathBuf};

/// The most losses that are listed; a file of garbage could make millions.
const MAX_LISTED: usize = 200;

/// A part of the input that could not be read, or can't be trusted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loss {
    /// The file.
    pub file: PathBuf,
    /// Where in the file: the first byte of the record, or where the file ends.
    pub at_byte: u64,
    /// The reason, in words for a person; it names the byte where that helps.
    pub what: String,
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.file.display(), self.what)
    }
}

/// Losses in the order in which they were met.
#[derive(Debug, Default)]
pub(super) struct Losses {
    listed: Vec<Loss>,
    unlisted: u64,
}

impl Losses {
    pub(super) fn push(&mut self, file: &Path, at_byte: u64, what: String) {
        let loss = Loss { file: file.to_path_buf(), at_byte, what };
        if self.listed.len() < MAX_LISTED {
            self.listed.push(loss);
            return;
        }
        self.unlisted += 1;
        if let Some(last) = self.listed.last_mut() {
            *last =
                Loss { what: format!("{} more losses are not listed; the last: {}", self.unlisted, loss.what), ..loss };
        }
    }

    pub(super) fn list(&self) -> &[Loss] {
        &self.listed
    }
}
