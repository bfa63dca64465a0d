//! What the tests of messages share.
#![allow(dead_code, missing_docs, unreachable_pub, unused_imports)]

#[path = "../common/skip.rs"]
mod skip;

use std::path::{Path, PathBuf};

pub use skip::shared;

/// Every `.mcap` file below `folder`, in the order of their paths.
pub fn mcap_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = vec![];
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder of data can be listed") {
            let path = entry.expect("an entry can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "mcap") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

/// Appends values as CDR does: each aligned to its own size, counted from the end of the encapsulation header.
pub struct CdrWriter {
    pub cdr: Vec<u8>,
    little_endian: bool,
}

impl CdrWriter {
    pub fn new(little_endian: bool) -> Self {
        CdrWriter { cdr: vec![0, u8::from(little_endian), 0, 0], little_endian }
    }

    pub fn bytes<const N: usize>(mut self, little_endian_bytes: [u8; N]) -> Self {
        while !(self.cdr.len() - 4).is_multiple_of(N) {
            self.cdr.push(0xee); // padding that would show if it were read
        }
        if self.little_endian {
            self.cdr.extend(little_endian_bytes);
        } else {
            self.cdr.extend(little_endian_bytes.iter().rev());
        }
        self
    }

    pub fn u8(self, value: u8) -> Self {
        self.bytes([value])
    }

    pub fn u16(self, value: u16) -> Self {
        self.bytes(value.to_le_bytes())
    }

    pub fn u32(self, value: u32) -> Self {
        self.bytes(value.to_le_bytes())
    }

    pub fn f32(self, value: f32) -> Self {
        self.bytes(value.to_le_bytes())
    }

    pub fn f64(self, value: f64) -> Self {
        self.bytes(value.to_le_bytes())
    }

    pub fn text(self, value: &str) -> Self {
        let mut writer = self.u32(value.len() as u32 + 1);
        writer.cdr.extend(value.as_bytes());
        writer.cdr.push(0);
        writer
    }
}
