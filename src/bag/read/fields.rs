//! Fields of an MCAP record, read with every length checked against the bytes that are there.
//!
//! The `mcap` crate's own record parser reserves memory for a string by its length prefix and panics on some hostile
//! records, so records that come from a file are read here.

use std::collections::BTreeMap;

/// The unread rest of a record's body. Every reader gives `None` where the body ends too early.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn bytes(&mut self, len: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes behind a `u32` length.
    pub(super) fn block(&mut self) -> Option<&'a [u8]> {
        let len = usize::try_from(self.u32()?).ok()?;
        self.bytes(len)
    }

    pub(super) fn string(&mut self) -> Option<String> {
        std::str::from_utf8(self.block()?).ok().map(str::to_owned)
    }

    pub(super) fn string_map(&mut self) -> Option<BTreeMap<String, String>> {
        let mut entries = Fields(self.block()?);
        let mut map = BTreeMap::new();
        while !entries.0.is_empty() {
            let key = entries.string()?;
            map.insert(key, entries.string()?);
        }
        Some(map)
    }

    /// A map from channel id to count, as statistics carry it.
    pub(super) fn count_map(&mut self) -> Option<BTreeMap<u16, u64>> {
        let mut entries = Fields(self.block()?);
        let mut map = BTreeMap::new();
        while !entries.0.is_empty() {
            let id = entries.u16()?;
            map.insert(id, entries.u64()?);
        }
        Some(map)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn length_beyond_the_record_is_refused() {
        assert_eq!(Fields(&[0xFF, 0xFF, 0xFF, 0xFF, b'a']).string(), None);
        assert_eq!(Fields(&[8, 0, 0, 0, 1, 0, 0, 0, b'k', 9, 0, 0]).string_map(), None);
        assert_eq!(Fields(&[1]).u16(), None);
    }

    #[test]
    fn text_that_is_not_utf8_is_refused() {
        assert_eq!(Fields(&[1, 0, 0, 0, 0xFF]).string(), None);
    }
}
