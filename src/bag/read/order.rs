//! The order of time, where the order of a file is another one.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, VecDeque};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::Part;
use super::channels::Definitions;
use super::fields::Fields;
use super::loss::Losses;
use super::names::natural_order;
use super::window::WINDOW;
use crate::units::Stamp;

/// How far behind a message may stand before it is said. A recorder with several threads is some milliseconds late, which
/// the fusion waits for.
const LATE_NS: i64 = 100_000_000;

/// Bytes of chunks, unpacked, that overlap in time and are held at once.
const MAX_HELD_BYTES: u64 = 256 << 20;

/// Chunks that are held at once.
const MAX_HELD: usize = 1024;

/// Where a chunk lies, and when its messages were received, as the index of its file says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChunkPlace {
    pub(super) first: u64,
    pub(super) last: u64,
    /// The first byte of the chunk record.
    pub(super) offset: u64,
    /// Bytes of the chunk record.
    pub(super) len: u64,
    /// Bytes of the indexes behind it.
    pub(super) indexes_len: u64,
    unpacked: u64,
    /// Ids of the channels that it has messages of.
    pub(super) channels: Vec<u16>,
}

impl ChunkPlace {
    /// Read from the body of a chunk index record; `None` where it is none.
    pub(super) fn parse(body: &[u8]) -> Option<Self> {
        let mut fields = Fields(body);
        let (first, last, offset, len) = (fields.u64()?, fields.u64()?, fields.u64()?, fields.u64()?);
        let channels = fields.count_map()?.into_keys().collect();
        let indexes_len = fields.u64()?;
        let _compression = (fields.string()?, fields.u64()?);
        Some(ChunkPlace { first, last, offset, len, indexes_len, unpacked: fields.u64()?, channels })
    }

    /// Whether a channel that is wanted has messages in it; `true` where the index doesn't say.
    pub(super) fn may_hold(&self, definitions: &Definitions, is_wanted: &dyn Fn(usize) -> bool) -> bool {
        let known = |id: &u16| definitions.channel(*id);
        self.channels.is_empty() || self.channels.iter().any(|id| known(id).is_none_or(is_wanted))
    }

    /// The bytes of the chunk record.
    pub(super) fn span(&self) -> Range<u64> {
        self.offset..self.offset.saturating_add(self.len)
    }

    fn is_empty(&self) -> bool {
        (self.first, self.last) == (0, 0)
    }
}

/// The chunks of a file that overlap in time, or stand in another order: in the order of their first messages.
#[derive(Debug)]
pub(super) struct Chunks(pub(super) VecDeque<ChunkPlace>);

impl Chunks {
    /// `None` where the chunks stand in the order of time already, where a channel goes back by itself (the recorder's clock
    /// was set: what stands first came first), or where so many overlap that they can't be held at once: then a file is
    /// read as it stands.
    pub(super) fn to_be_ordered(mut places: Vec<ChunkPlace>) -> Option<Self> {
        places.sort_by_key(|place| place.offset);
        let mut newest = 0;
        let in_order = places.iter().filter(|place| !place.is_empty()).all(|place| {
            let follows = place.first >= newest;
            newest = newest.max(place.last);
            follows
        });
        if in_order {
            return None;
        }
        let mut newest_of_channel: BTreeMap<u16, u64> = BTreeMap::new();
        for place in places.iter().filter(|place| !place.is_empty()) {
            if place.channels.is_empty() {
                return None; // a writer that doesn't say which channels a chunk has
            }
            for channel in &place.channels {
                if newest_of_channel.insert(*channel, place.last).is_some_and(|newest| place.first < newest) {
                    return None;
                }
            }
        }
        places.sort_by_key(|place| (place.first, place.offset));
        let mut held: BinaryHeap<Reverse<(u64, u64)>> = BinaryHeap::new();
        let mut held_bytes = 0_u64;
        for place in &places {
            while let Some(&Reverse((last, bytes))) = held.peek()
                && last < place.first
            {
                held_bytes -= bytes;
                held.pop();
            }
            held_bytes = held_bytes.checked_add(place.unpacked)?;
            held.push(Reverse((place.last, place.unpacked)));
            if place.unpacked > WINDOW as u64 || held_bytes > MAX_HELD_BYTES || held.len() > MAX_HELD {
                return None;
            }
        }
        Some(Chunks(places.into()))
    }
}

/// How a file is to be read.
#[derive(Default)]
pub(super) struct Order {
    /// Chunks of an MCAP file in the order of time, where they don't stand in it.
    pub(super) chunks: Option<Chunks>,
    /// Whether the rows of a sqlite3 file don't stand in the order of time, and can be put in it.
    pub(super) by_time: bool,
    /// Whether messages come as they stand.
    pub(super) as_written: bool,
    /// The parts of an MCAP file that are read, where that is not everything.
    pub(super) only: Option<Only>,
}

/// The chunks that are read.
pub(super) struct Only {
    /// Those that may hold something that is wanted.
    pub(super) places: Vec<ChunkPlace>,
    /// Where the first of all chunks in the index stands.
    pub(super) first: u64,
    /// Where named notes stand.
    pub(super) notes: Vec<u64>,
    /// The file's channels, some of which it may define in a chunk that is not read.
    pub(super) definitions: Definitions,
}

/// Put the files of a recording in the order of their first messages, unless their names count up: then the recorder's
/// clock was set, where one begins before the file in front of it. One whose begin is not known stays behind the one that
/// it stands behind.
pub(super) fn sort_parts(files: &mut Vec<Part>) {
    let mut before = Stamp(i64::MIN);
    let counts_up =
        files.is_sorted_by(|a, b| natural_order(&a.path.to_string_lossy(), &b.path.to_string_lossy()).is_le());
    if counts_up {
        for part in files {
            part.begin = part.begin.filter(|begin| *begin >= before);
            before = part.begin.unwrap_or(before);
        }
        return;
    }
    let mut keyed: Vec<(Stamp, Part)> = Vec::new();
    for part in files.drain(..) {
        before = part.begin.unwrap_or(before);
        keyed.push((before, part));
    }
    keyed.sort_by_key(|(begin, _)| *begin);
    files.extend(keyed.into_iter().map(|(_, part)| part));
}

/// Notices messages of an input that come behind later ones of other channels.
#[derive(Debug, Default)]
pub(super) struct Late {
    newest: Option<Stamp>,
    of_channel: BTreeMap<usize, Stamp>,
    n: u64,
    most_ns: i64,
    first_in: Option<PathBuf>,
}

impl Late {
    pub(super) fn handle(&mut self, log_time: Stamp, channel: usize, file: &Path) {
        let before = self.of_channel.insert(channel, log_time);
        if before.is_some_and(|before| before.nanos_since(log_time) > LATE_NS) {
            // The recorder's clock was set: from here on another time counts.
            self.newest = Some(log_time);
            self.of_channel.clear();
            self.of_channel.insert(channel, log_time);
            return;
        }
        let newest = self.newest.get_or_insert(log_time);
        let late_ns = newest.nanos_since(log_time);
        *newest = log_time.max(*newest);
        if late_ns > LATE_NS {
            self.n += 1;
            self.most_ns = self.most_ns.max(late_ns);
            self.first_in.get_or_insert_with(|| file.to_path_buf());
        }
    }

    /// Says once, at the end of an input, what was noticed.
    pub(super) fn conclude(&mut self, losses: &mut Losses) {
        if let Some(file) = self.first_in.take() {
            let (n, seconds) = (self.n, self.most_ns as f64 * 1e-9);
            let what = format!(
                "{n} messages stand behind later ones of other topics, by up to {seconds:.3} s, and could not be put in the order of time: what is made of them is not reliable; put the file in order with `mcap sort`"
            );
            losses.push(&file, 0, what);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(first: u64, last: u64, offset: u64, unpacked: u64) -> ChunkPlace {
        ChunkPlace { first, last, offset, len: 1, indexes_len: 0, unpacked, channels: vec![offset as u16] }
    }

    #[test]
    fn chunks_that_follow_one_another_are_read_as_they_stand() {
        let places = vec![place(20, 30, 200, 1), place(10, 20, 100, 1), place(0, 0, 300, 0), place(30, 31, 400, 1)];
        assert!(Chunks::to_be_ordered(places).is_none());
    }

    #[test]
    fn chunks_that_overlap_are_put_in_order_as_far_as_memory_goes() {
        let ordered = Chunks::to_be_ordered(vec![place(10, 30, 100, 1), place(5, 29, 200, 1)]).unwrap();
        assert_eq!(ordered.0.iter().map(|place| place.offset).collect::<Vec<_>>(), [200, 100]);
        let wide = |n: u64, unpacked| (0..n).map(|k| place(k, 9999, 9999 - k, unpacked)).collect::<Vec<_>>();
        assert!(Chunks::to_be_ordered(wide(8, 30 << 20)).is_some());
        assert!(Chunks::to_be_ordered(wide(9, 30 << 20)).is_none(), "270 MiB at once");
        assert!(Chunks::to_be_ordered(wide(2, u64::MAX)).is_none());
        assert!(Chunks::to_be_ordered(wide(1025, 0)).is_none());
        let of_channel = |place, channel| ChunkPlace { channels: vec![channel], ..place };
        let by_topic = |channel| vec![of_channel(place(10, 30, 100, 1), 1), of_channel(place(5, 29, 200, 1), channel)];
        assert!(Chunks::to_be_ordered(by_topic(2)).is_some());
        assert!(Chunks::to_be_ordered(by_topic(1)).is_none(), "the recorder's clock was set back");
        // In reverse order, but one after the other.
        let reverse = (0..9).map(|k| place(k * 10 + 1, k * 10 + 10, 100 - k, 30 << 20)).collect();
        assert!(Chunks::to_be_ordered(reverse).is_some());
    }
}
