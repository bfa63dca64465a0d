//! Messages of a chunk, unpacked, in the order of time.

use std::collections::BTreeMap;

use crate::units::Stamp;

/// Bytes of messages that are unpacked at once, so that they can be put in order. Recorders close their chunks far earlier.
pub(super) const WINDOW: usize = 64 << 20;

/// The same of a chunk that is longer and can't be put in order anyway.
const STREAM: usize = 2 << 20;

/// A stretch of a chunk: all of it, unless it is longer than [`WINDOW`].
#[derive(Debug, Default)]
pub(super) struct Window {
    limit: usize,
    bytes: Vec<u8>,
    messages: Vec<Held>,
    next: usize,
    unordered: bool,
    /// Newest of each channel.
    newest: BTreeMap<usize, Stamp>,
    /// Whether a channel goes back by itself: then the recorder's clock was set, and what stands first came first.
    clock_was_set: bool,
}

#[derive(Debug, Clone, Copy)]
struct Held {
    log_time: Stamp,
    begin: usize,
    len: usize,
    channel: usize,
}

impl Window {
    /// Gets ready for a chunk of so many bytes.
    pub(super) fn expect(&mut self, unpacked: u64) {
        self.limit = if unpacked > WINDOW as u64 { STREAM } else { WINDOW };
    }

    /// Takes the body of a message record of a channel of the table.
    pub(super) fn push(&mut self, log_time: Stamp, channel: usize, body: &[u8]) {
        self.unordered |= self.messages.last().is_some_and(|last| log_time < last.log_time);
        let newest = self.newest.entry(channel).or_insert(log_time);
        self.clock_was_set |= log_time < *newest;
        *newest = log_time;
        self.messages.push(Held { log_time, begin: self.bytes.len(), len: body.len(), channel });
        self.bytes.extend_from_slice(body);
    }

    /// Whether no more messages are to be taken.
    pub(super) fn is_full(&self) -> bool {
        // What is kept of a message besides its bytes counts too: there may be millions of empty ones.
        self.bytes.len() + self.messages.len() * size_of::<Held>() >= self.limit
    }

    /// Puts what was taken in order; equal times stay as they stand, and so do messages of one channel.
    pub(super) fn order(&mut self) {
        if std::mem::take(&mut self.unordered) && !self.clock_was_set {
            self.messages.sort_by_key(|held| held.log_time);
        }
    }

    /// Log time of the message that comes next.
    pub(super) fn next_time(&self) -> Option<Stamp> {
        self.messages.get(self.next).map(|held| held.log_time)
    }

    /// The next message: its channel is returned and its record put into `body`. Emptied once it has given everything.
    pub(super) fn pop(&mut self, body: &mut Vec<u8>) -> Option<usize> {
        let Some(&Held { begin, len, channel, .. }) = self.messages.get(self.next) else {
            self.clear();
            return None;
        };
        self.next += 1;
        body.clear();
        body.extend_from_slice(&self.bytes[begin..begin + len]);
        Some(channel)
    }

    /// Empties it, but for memory that the next chunk can use.
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.messages.clear();
        self.next = 0;
        self.unordered = false;
        self.newest.clear();
        self.clock_was_set = false;
    }
}
