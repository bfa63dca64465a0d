//! Frames in bins that keep the smallest and the largest value: a trace of any length in bounded memory.

use serde::Serialize;
use tactile_pose_fusion::units::Stamp;

use super::scalars::Scalars;

/// Values that are drawn over time: the first ones of [`super::scalars::VALUES`].
pub(super) const N_TRACES: usize = 4;

/// Bins of an overview, at most. More than a screen has columns, so that a part of a bag is drawn from it, too.
const MOST_BINS: usize = 8192;

/// Some consecutive frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bin {
    /// Stamp of the first frame.
    pub(super) from: Stamp,
    /// Stamp of the last frame.
    pub(super) to: Stamp,
    n_frames: u64,
    /// NaN where no frame has a value.
    low: [f64; N_TRACES],
    high: [f64; N_TRACES],
    contact: bool,
    flags: u32,
}

impl Bin {
    /// A bin of one frame.
    pub(super) fn new(stamp: Stamp, scalars: &Scalars) -> Self {
        let values: [f64; N_TRACES] = std::array::from_fn(|idx| scalars.values[idx]);
        let (contact, flags) = (scalars.contact, scalars.flags);
        Bin { from: stamp, to: stamp, n_frames: 1, low: values, high: values, contact, flags }
    }

    /// Adds the frames of a later bin.
    pub(super) fn join(&mut self, later: &Bin) {
        self.to = later.to;
        self.n_frames += later.n_frames;
        for idx in 0..N_TRACES {
            // Of a number and NaN, the smaller and the larger is the number.
            self.low[idx] = self.low[idx].min(later.low[idx]);
            self.high[idx] = self.high[idx].max(later.high[idx]);
        }
        self.contact |= later.contact;
        self.flags |= later.flags;
    }
}

/// All frames of a region in bins of one length, which doubles where they become too many.
#[derive(Debug, Clone)]
pub(super) struct Overview {
    bins: Vec<Bin>,
    /// Frames in a bin; the last one may have fewer.
    per_bin: u64,
}

impl Overview {
    pub(super) fn new() -> Self {
        Overview { bins: Vec::new(), per_bin: 1 }
    }

    /// Adds the next frame.
    pub(super) fn handle(&mut self, bin: &Bin) {
        match self.bins.last_mut() {
            Some(last) if last.n_frames < self.per_bin => last.join(bin),
            _ => self.bins.push(*bin),
        }
        if self.bins.len() > MOST_BINS {
            self.per_bin *= 2;
            let pairs = self.bins.chunks(2).map(|pair| {
                let mut joined = pair[0];
                pair[1..].iter().for_each(|later| joined.join(later));
                joined
            });
            self.bins = pairs.collect();
        }
    }

    /// The bins with a frame from one stamp to another, if they are at least so many.
    pub(super) fn between(&self, from: Stamp, to: Stamp, at_least: usize) -> Option<&[Bin]> {
        let begin = self.bins.partition_point(|bin| bin.to < from);
        let end = self.bins.partition_point(|bin| bin.from <= to);
        let bins = self.bins.get(begin..end)?;
        (bins.len() >= at_least).then_some(bins)
    }
}

/// The traces of a region within a window of time, as a page draws them.
///
/// Where frames are drawn together, each bin is two points: its smallest and its largest values. Between frames that are
/// further apart than they should be stands a point without values, which breaks the line.
///
/// # Shapes
/// `[points]` each.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Traces {
    /// s, from the beginning of the session.
    t: Vec<f64>,
    force: Vec<f64>,
    force_base: Vec<f64>,
    truth: Vec<f64>,
    artifact: Vec<f64>,
    contact: Vec<bool>,
    flags: Vec<u32>,
    /// True if every frame is a point of its own.
    full_rate: bool,
}

impl Traces {
    /// Traces of bins. Frames further apart than `gap_ns` are not connected.
    pub(super) fn new(bins: impl Iterator<Item = Bin>, origin: Stamp, gap_ns: i64) -> Self {
        let mut traces = Traces { full_rate: true, ..Traces::default() };
        let mut before = None::<Stamp>;
        let at = |stamp: Stamp| stamp.nanos_since(origin) as f64 * 1e-9;
        for bin in bins {
            if let Some(before) = before.filter(|before| bin.from.nanos_since(*before) > gap_ns) {
                let middle = before.offset(bin.from.nanos_since(before) / 2);
                traces.push(at(middle), &[f64::NAN; N_TRACES], false, 0);
            }
            before = Some(bin.to);
            traces.push(at(bin.from), &bin.low, bin.contact, bin.flags);
            if bin.n_frames > 1 {
                traces.full_rate = false;
                traces.push(at(bin.to), &bin.high, bin.contact, bin.flags);
            }
        }
        traces
    }

    fn push(&mut self, t: f64, values: &[f64; N_TRACES], contact: bool, flags: u32) {
        self.t.push(t);
        let columns = [&mut self.force, &mut self.force_base, &mut self.truth, &mut self.artifact];
        columns.into_iter().zip(values).for_each(|(column, value)| column.push(*value));
        self.contact.push(contact);
        self.flags.push(flags);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bin(number: i64, force: f64) -> Bin {
        let scalars = Scalars { values: [force; 7], contact: number == 7, flags: 1 << (number % 3), adaptation: 0 };
        Bin::new(Stamp(number * 10), &scalars)
    }

    #[test]
    fn whatever_is_joined_the_smallest_and_the_largest_value_stay() {
        let mut overview = Overview::new();
        let n_frames = 5 * MOST_BINS as i64 + 3;
        for number in 0..n_frames {
            let force = if number == 4321 {
                99.0
            } else if number == 777 {
                -5.0
            } else {
                f64::from(number as i32 % 7)
            };
            overview.handle(&bin(number, if number % 5 == 0 { f64::NAN } else { force }));
        }
        assert!(overview.bins.len() <= MOST_BINS);
        assert_eq!(overview.bins.iter().map(|bin| bin.n_frames).sum::<u64>(), n_frames as u64);
        let all = overview.between(Stamp(0), Stamp(i64::MAX), 1).unwrap();
        let low = all.iter().map(|bin| bin.low[0]).fold(f64::NAN, f64::min);
        let high = all.iter().map(|bin| bin.high[0]).fold(f64::NAN, f64::max);
        assert_eq!((low, high), (-5.0, 99.0));
        assert_eq!(all.iter().filter(|bin| bin.contact).count(), 1);
        assert!(overview.between(Stamp(0), Stamp(100), 1000).is_none(), "a part that needs the frames themselves");
    }

    #[test]
    fn a_line_breaks_where_frames_are_missing_and_bins_are_two_points() {
        let mut joined = bin(6, 3.0);
        joined.join(&bin(7, 5.0));
        let traces = Traces::new([bin(0, 1.0), bin(1, 2.0), joined].into_iter(), Stamp(0), 15);
        assert_eq!(traces.force[..2], [1.0, 2.0]);
        assert!(traces.force[2].is_nan() && !traces.full_rate);
        assert_eq!(traces.force[3..], [3.0, 5.0]);
        assert_eq!(traces.contact, [false, false, false, true, true]);
        assert_eq!(traces.t.len(), traces.flags.len());
    }
}
