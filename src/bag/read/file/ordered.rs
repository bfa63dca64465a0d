//! A file whose chunks overlap in time, or stand in another order than that of time: read by its index.

use std::collections::{BTreeSet, VecDeque};

use mcap::records::op;

use super::{BagError, Context, Head, McapFile, RECORD_HEAD_LEN, message_of};
use crate::bag::read::order::{ChunkPlace, Chunks};
use crate::bag::read::window::Window;

/// A file whose chunks are read in another order than theirs: everything else first, then they.
pub(super) struct Ordered {
    /// Offsets of the chunks that the index knows.
    known: BTreeSet<u64>,
    waiting: VecDeque<ChunkPlace>,
    /// Whether it has come to the chunks.
    pub(super) at_chunks: bool,
    /// Chunks that are being handed out, with their offsets.
    open: Vec<(u64, Window)>,
    pub(super) bytes_read: u64,
}

impl Ordered {
    pub(super) fn new(Chunks(waiting): Chunks) -> Self {
        let known = waiting.iter().map(|place| place.offset).collect();
        Ordered { known, waiting, at_chunks: false, open: Vec::new(), bytes_read: 0 }
    }

    /// Reads these chunks only.
    pub(super) fn read_only(&mut self, offsets: &BTreeSet<u64>) {
        self.waiting.retain(|place| offsets.contains(&place.offset));
    }

    /// Whether the index has a chunk there.
    pub(super) fn knows(&self, offset: u64) -> bool {
        self.known.contains(&offset)
    }
}

impl McapFile {
    /// The next message of the chunks that are read in order.
    pub(super) fn next_in_order(&mut self, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<Option<Head>, BagError> {
        while let Some(Ordered { waiting, open, .. }) = &mut self.ordered {
            let times = open.iter().enumerate().filter_map(|(idx, (at, window))| Some((window.next_time()?, *at, idx)));
            let earliest = times.min();
            let is_due = |place: &&ChunkPlace| {
                earliest.is_none_or(|(time, ..)| i64::try_from(place.first).unwrap_or(i64::MAX) <= time.0)
            };
            if let Some(place) = waiting.front().filter(is_due).cloned() {
                waiting.pop_front();
                self.open_in_order(&place, body, cx)?;
                continue;
            }
            let Some((.., idx)) = earliest else { break };
            let channel = open[idx].1.pop(body);
            if open[idx].1.next_time().is_none() {
                self.window = open.swap_remove(idx).1;
                self.window.clear();
            }
            return Ok(channel.map(|channel| message_of(channel, body)));
        }
        if !self.done {
            self.finish(cx);
        }
        Ok(None)
    }

    /// Unpack a chunk whose turn has come.
    fn open_in_order(&mut self, place: &ChunkPlace, body: &mut Vec<u8>, cx: &mut Context<'_>) -> Result<(), BagError> {
        self.source.seek_to(place.offset)?;
        let mut head = [0; RECORD_HEAD_LEN as usize];
        let is_there = self.source.read_exact(&mut head)?;
        let [opcode, len @ ..] = head;
        if !is_there || opcode != op::CHUNK {
            let what = format!("there is no chunk at byte {}, where the index has one", place.offset);
            cx.losses.push(&self.source.path, place.offset, what);
            return Ok(());
        }
        self.open_chunk(place.offset, u64::from_le_bytes(len), body, cx)?;
        let mut window = std::mem::take(&mut self.window);
        while self.chunk.is_some() && !window.is_full() {
            match self.next_of_chunk(body, cx)? {
                Some(Head::Message { channel, message }) => window.push(message.log_time, channel, body),
                Some(Head::Attachment { .. } | Head::Metadata { .. }) => {
                    let what =
                        format!("the chunk at byte {} holds more than messages, which is not read", place.offset);
                    cx.losses.push(&self.source.path, place.offset, what);
                }
                None => {}
            }
        }
        if self.chunk.take().is_some() {
            let what =
                format!("the chunk at byte {} holds more than its index says; the rest of it is lost", place.offset);
            cx.losses.push(&self.source.path, place.offset, what);
        }
        window.order();
        if let Some(ordered) = &mut self.ordered {
            ordered.bytes_read = ordered.bytes_read.saturating_add(place.len).min(self.source.size);
            ordered.open.push((place.offset, window));
        }
        Ok(())
    }

    /// Chunks from there on are lost.
    pub(super) fn forget_from(&mut self, at: u64) {
        if let Some(ordered) = &mut self.ordered {
            ordered.waiting.retain(|place| place.offset < at);
        }
    }
}
