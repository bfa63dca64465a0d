//! The frames of a region in a temporary file: any window of any bag can be shown, in memory that no bag makes larger.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;

use serde::Serialize;
use tactile_pose_fusion::units::Stamp;

use super::bins::{Bin, Overview, Traces};
use super::error::ViewError;
use super::scalars::{Scalars, VALUES};

/// Bytes of a frame before its taxels: stamp, values, flags, contact, adaptation, two of nothing.
const HEAD: usize = 8 + 8 * VALUES.len() + 8;

/// Frames that are read from the file at once.
const CHUNK: u64 = 1024;

/// Frames further apart than so many usual steps are not connected.
const GAP_STEPS: i64 = 3;

/// Steps between frames from which the usual one is taken.
const N_STEPS: usize = 1000;

/// A frame of a region, as a page shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct ViewFrame {
    /// s, from the beginning of the session.
    t: f64,
    #[serde(flatten)]
    values: std::collections::BTreeMap<&'static str, f64>,
    contact: bool,
    flags: u32,
    adaptation: u8,
    /// `[taxels]`, as sent; empty where the session has none.
    reading: Vec<f32>,
    /// `[taxels]`, as the model is given them; empty where the session was not computed.
    feature: Vec<f32>,
}

/// Smallest and largest of some numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Range {
    pub(super) low: f32,
    pub(super) high: f32,
}

impl Range {
    /// Of nothing.
    const NONE: Range = Range { low: f32::NAN, high: f32::NAN };

    fn handle(&mut self, value: f32) {
        if value.is_finite() {
            (self.low, self.high) = (self.low.min(value), self.high.max(value));
        }
    }
}

/// The frames of a region, as they come.
#[derive(Debug)]
pub(super) struct Writing {
    file: BufWriter<File>,
    frames: Frames,
    /// ns; the first ones.
    steps: Vec<i64>,
    record: Vec<u8>,
}

/// The frames of a region, to be read.
#[derive(Debug)]
pub(super) struct Frames {
    file: File,
    n_taxels: usize,
    has_features: bool,
    n_frames: u64,
    overview: Overview,
    gap_ns: i64,
    /// Stamps of the first and the last frame.
    pub(super) span: Option<(Stamp, Stamp)>,
    /// Frames whose stamp is not after that of the frame before; they are not kept.
    pub(super) n_disordered: u64,
    /// Which of [`VALUES`] some frame has.
    pub(super) has: [bool; VALUES.len()],
    /// Of all readings, each taxel's.
    pub(super) readings: Vec<Range>,
    /// Of what the model is given.
    pub(super) features: Range,
}

impl Writing {
    /// No frames yet of a region with so many taxels (none where the session doesn't have them).
    pub(super) fn new(n_taxels: usize, has_features: bool) -> Result<Self, ViewError> {
        let file = tempfile::tempfile().map_err(ViewError::keep)?;
        let frames = Frames {
            file: file.try_clone().map_err(ViewError::keep)?,
            n_taxels,
            has_features,
            n_frames: 0,
            overview: Overview::new(),
            gap_ns: i64::MAX,
            span: None,
            n_disordered: 0,
            has: [false; VALUES.len()],
            readings: vec![Range::NONE; n_taxels],
            features: Range::NONE,
        };
        let record = Vec::with_capacity(frames.record_len());
        Ok(Writing { file: BufWriter::with_capacity(1 << 16, file), frames, steps: Vec::new(), record })
    }

    /// Adds the next frame.
    ///
    /// # Shapes
    /// `reading`: `[taxels]`; `feature`: the same, or nothing.
    pub(super) fn handle(
        &mut self,
        stamp: Stamp,
        scalars: &Scalars,
        reading: &[f32],
        feature: &[f32],
    ) -> Result<(), ViewError> {
        let frames = &mut self.frames;
        let first = match frames.span {
            Some((_, last)) if stamp <= last => {
                frames.n_disordered += 1;
                return Ok(());
            }
            Some((first, last)) => {
                if self.steps.len() < N_STEPS {
                    self.steps.push(stamp.nanos_since(last));
                }
                first
            }
            None => stamp,
        };
        frames.span = Some((first, stamp));
        frames.n_frames += 1;
        frames.overview.handle(&Bin::new(stamp, scalars));
        frames.has.iter_mut().zip(scalars.values).for_each(|(has, value)| *has |= value.is_finite());
        frames.readings.iter_mut().zip(reading).for_each(|(range, value)| range.handle(*value));
        feature.iter().for_each(|value| frames.features.handle(*value));
        self.record.clear();
        self.record.extend(stamp.0.to_le_bytes());
        scalars.values.iter().for_each(|value| self.record.extend(value.to_le_bytes()));
        self.record.extend(scalars.flags.to_le_bytes());
        self.record.extend([u8::from(scalars.contact), scalars.adaptation, 0, 0]);
        reading.iter().chain(feature).for_each(|value| self.record.extend(value.to_le_bytes()));
        self.record.resize(frames.record_len(), 0);
        self.file.write_all(&self.record).map_err(ViewError::keep)
    }

    /// All frames, to be read.
    pub(super) fn finish(self) -> Result<Frames, ViewError> {
        let Writing { mut file, mut frames, mut steps, .. } = self;
        file.flush().map_err(ViewError::keep)?;
        let middle = steps.len() / 2;
        if !steps.is_empty() {
            frames.gap_ns = GAP_STEPS * *steps.select_nth_unstable(middle).1;
        }
        Ok(frames)
    }
}

impl Frames {
    /// Number of frames.
    pub(super) fn len(&self) -> u64 {
        self.n_frames
    }

    /// True if some frame has a true force.
    pub(super) fn has_truth(&self) -> bool {
        VALUES.iter().zip(self.has).any(|(name, has)| has && *name == "truth")
    }

    /// Usual time between frames, s; `None` where there are too few.
    pub(super) fn period_s(&self) -> Option<f64> {
        (self.gap_ns < i64::MAX).then(|| self.gap_ns as f64 / GAP_STEPS as f64 * 1e-9)
    }

    /// The newest frame at a time, unless frames are missing there.
    pub(super) fn at(&self, stamp: Stamp, origin: Stamp) -> Result<Option<ViewFrame>, ViewError> {
        let after = self.first_from(stamp.offset(1))?;
        let Some(idx) = after.checked_sub(1) else { return Ok(None) };
        let mut bytes = vec![0; self.record_len()];
        self.read(idx, &mut bytes)?;
        let (at, scalars) = head(&bytes);
        if stamp.nanos_since(at) > self.gap_ns {
            return Ok(None);
        }
        let floats = bytes[HEAD..].chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap_or_default()));
        let mut reading: Vec<f32> = floats.collect();
        let feature = reading.split_off(self.n_taxels);
        let values = VALUES.into_iter().zip(scalars.values).collect();
        let Scalars { contact, flags, adaptation, .. } = scalars;
        let t = at.nanos_since(origin) as f64 * 1e-9;
        Ok(Some(ViewFrame { t, values, contact, flags, adaptation, reading, feature }))
    }

    /// The traces from one stamp to another, of at most about twice so many points.
    pub(super) fn traces(&self, from: Stamp, to: Stamp, points: usize, origin: Stamp) -> Result<Traces, ViewError> {
        // One frame more on both sides, so that lines go to the edges.
        let begin = self.first_from(from)?.saturating_sub(1);
        let end = (self.first_from(to.offset(1))? + 1).min(self.n_frames);
        let per_bin = end.saturating_sub(begin).div_ceil(points as u64).max(1);
        if per_bin > 1
            && let Some(bins) = self.overview.between(from, to, points)
        {
            let per_bin = bins.len().div_ceil(points);
            let joined = bins.chunks(per_bin).map(|some| {
                let mut joined = some[0];
                some[1..].iter().for_each(|later| joined.join(later));
                joined
            });
            return Ok(Traces::new(joined, origin, self.gap_ns));
        }
        let mut bins: Vec<Bin> = Vec::new();
        let mut bytes = vec![0; self.record_len() * CHUNK as usize];
        let (mut at, mut in_bin) = (begin, per_bin);
        while at < end {
            let n = CHUNK.min(end - at);
            let bytes = &mut bytes[..self.record_len() * n as usize];
            self.read(at, bytes)?;
            for record in bytes.chunks_exact(self.record_len()) {
                let (stamp, scalars) = head(record);
                let bin = Bin::new(stamp, &scalars);
                match bins.last_mut() {
                    Some(last) if in_bin < per_bin => last.join(&bin),
                    _ => {
                        bins.push(bin);
                        in_bin = 0;
                    }
                }
                in_bin += 1;
            }
            at += n;
        }
        Ok(Traces::new(bins.into_iter(), origin, self.gap_ns))
    }

    /// Index of the first frame at or after a stamp.
    fn first_from(&self, stamp: Stamp) -> Result<u64, ViewError> {
        let (mut low, mut high) = (0, self.n_frames);
        while low < high {
            let middle = low + (high - low) / 2;
            let mut bytes = [0; 8];
            self.read(middle, &mut bytes)?;
            if Stamp(i64::from_le_bytes(bytes)) < stamp { low = middle + 1 } else { high = middle }
        }
        Ok(low)
    }

    fn read(&self, frame_idx: u64, bytes: &mut [u8]) -> Result<(), ViewError> {
        self.file.read_exact_at(bytes, frame_idx * self.record_len() as u64).map_err(ViewError::keep)
    }

    fn record_len(&self) -> usize {
        HEAD + 4 * self.n_taxels * if self.has_features { 2 } else { 1 }
    }
}

/// Stamp and scalars of a record.
fn head(record: &[u8]) -> (Stamp, Scalars) {
    let eight = |at: usize| record[at..at + 8].try_into().unwrap_or_default();
    let values = std::array::from_fn(|idx| f64::from_le_bytes(eight(8 + 8 * idx)));
    let flags = u32::from_le_bytes(record[HEAD - 8..HEAD - 4].try_into().unwrap_or_default());
    let (contact, adaptation) = (record[HEAD - 4] != 0, record[HEAD - 3]);
    (Stamp(i64::from_le_bytes(eight(0))), Scalars { values, contact, flags, adaptation })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(n_frames: i64) -> Frames {
        let mut writing = Writing::new(2, true).unwrap();
        for number in 0..n_frames {
            let force = number as f64 / 3.0;
            let scalars = Scalars { values: [force; 7], contact: number % 2 == 1, flags: 4, adaptation: 3 };
            // Half a second is missing after frame 100.
            let stamp = Stamp(1_000 + number * 10_000_000 + if number > 100 { 500_000_000 } else { 0 });
            writing.handle(stamp, &scalars, &[number as f32, -1.0], &[0.5, f32::NAN]).unwrap();
        }
        writing
            .handle(
                Stamp(5),
                &Scalars { values: [0.0; 7], contact: false, flags: 0, adaptation: 0 },
                &[0.0; 2],
                &[0.0; 2],
            )
            .unwrap();
        writing.finish().unwrap()
    }

    #[test]
    fn a_frame_is_read_as_it_was_written_and_where_frames_are_missing_there_is_none() {
        let frames = frames(3000);
        let origin = Stamp(1_000);
        assert_eq!((frames.len(), frames.n_disordered), (3000, 1));
        let frame = frames.at(Stamp(1_000 + 42 * 10_000_000 + 5), origin).unwrap().unwrap();
        assert_eq!((frame.t, frame.values["force"], frame.flags, frame.adaptation), (420_000_000.0 * 1e-9, 14.0, 4, 3));
        assert_eq!((frame.reading.as_slice(), frame.feature[0]), ([42.0, -1.0].as_slice(), 0.5));
        assert!(frame.feature[1].is_nan());
        assert_eq!(frames.at(Stamp(999), origin).unwrap(), None, "before the first");
        assert_eq!(frames.at(Stamp(1_000 + 1_300_000_000), origin).unwrap(), None, "in the gap");
        assert_eq!(frames.readings[0], Range { low: 0.0, high: 2999.0 });
    }

    #[test]
    fn a_window_has_the_frames_where_they_fit_and_else_the_extremes() {
        let frames = frames(30_000);
        let origin = Stamp(1_000);
        let seconds = |s: f64| Stamp(1_000 + (s * 1e9) as i64);
        let text = |traces: Traces| serde_json::to_value(traces).unwrap();
        let few = text(frames.traces(seconds(0.2), seconds(0.3), 500, origin).unwrap());
        assert_eq!(few["full_rate"], true);
        let t: Vec<f64> = serde_json::from_value(few["t"].clone()).unwrap();
        assert!(t.len() == 13 && t[0] < 0.2 && t[12] > 0.3, "the frames and one on each side: {t:?}");
        for points in [100, 2000] {
            let all = text(frames.traces(seconds(0.0), seconds(1e6), points, origin).unwrap());
            let force: Vec<Option<f64>> = serde_json::from_value(all["force"].clone()).unwrap();
            assert!(all["full_rate"] == false && force.len() <= 2 * points + 2, "{}", force.len());
            let numbers = || force.iter().flatten().copied();
            assert_eq!(numbers().fold(0.0, f64::max), 29_999.0 / 3.0);
            assert_eq!(numbers().fold(9.0, f64::min), 0.0);
        }
        let around = text(frames.traces(seconds(0.9), seconds(1.7), 500, origin).unwrap());
        let force: Vec<Option<f64>> = serde_json::from_value(around["force"].clone()).unwrap();
        assert_eq!(force.iter().filter(|force| force.is_none()).count(), 1, "the gap breaks the line");
    }
}
