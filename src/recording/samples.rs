//! Taxels and joint angles as sent, for outputs that show them beside the estimates.

use std::collections::BTreeMap;

use crate::fusion::{Event, FusionConfig, JointSample, JointSource, RowStamps, TactileBlock, TactileSource};
use crate::units::{NANOS_PER_SEC, Stamp, nanos};

/// Maximum number of joints that are kept. Two hands and two arms have fewer.
const MAX_JOINTS: usize = 256;

/// Readings of one tactile source.
#[derive(Debug, Clone, Default)]
pub struct TactileTrack {
    /// `[n]`, strictly rising.
    pub stamp: Vec<Stamp>,
    /// `[n, taxels of the source]`, row-major, as sent by the sensor.
    pub values: Vec<f32>,
    /// Number of rows that were late or duplicate.
    pub late: u64,
    /// Number of messages whose length doesn't fit the source.
    pub wrong_length: u64,
}

/// Angles of one joint.
#[derive(Debug, Clone, Default)]
pub struct JointTrack {
    /// `[n]`, strictly rising.
    pub stamp: Vec<Stamp>,
    /// `[n]`, rad, finite.
    pub angle: Vec<f64>,
    /// Number of angles that were late, duplicate or not finite.
    pub unused: u64,
}

/// Samples whose stamps jump back, or with too many joints.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum SampleError {
    #[error(
        "source {source_name}: its stamps jump back by {seconds:.2} s at {at}, expected one run of time: cut the bag there"
    )]
    TimeJump { source_name: String, at: Stamp, seconds: f64 },
    #[error("source {source_name}: it names more than {MAX_JOINTS} joints")]
    TooManyJoints { source_name: String },
}

/// Samples of all sensors of a recording.
#[derive(Debug, Clone)]
pub struct Samples {
    /// `[tactile sources]`.
    pub tactile: Vec<TactileTrack>,
    /// All joints that were sent, by name, also those that no region uses.
    pub joints: BTreeMap<String, JointTrack>,
    /// Names of the joints, in the order in which they were first sent.
    pub joint_names: Vec<String>,
    tactile_sources: Vec<TactileSource>,
    joint_sources: Vec<JointSource>,
    time_jump_ns: i64,
}

impl Samples {
    /// No samples yet, for the sources of a configuration.
    pub fn new(cfg: &FusionConfig) -> Self {
        Samples {
            tactile: vec![TactileTrack::default(); cfg.tactile_sources().len()],
            joints: BTreeMap::new(),
            joint_names: Vec::new(),
            tactile_sources: cfg.tactile_sources().to_vec(),
            joint_sources: cfg.joint_sources().to_vec(),
            time_jump_ns: nanos(cfg.timing().time_jump),
        }
    }

    /// Adds a message.
    ///
    /// # Errors
    /// [`SampleError`] if time jumps back, or if there are too many joints.
    pub fn handle_event(&mut self, event: &Event<'_>) -> Result<(), SampleError> {
        match event {
            Event::Tactile(block) => self.handle_taxels(block),
            Event::Joints(sample) => self.handle_joints(sample),
        }
    }

    fn handle_taxels(&mut self, block: &TactileBlock<'_>) -> Result<(), SampleError> {
        let source = &self.tactile_sources[block.source.position()];
        let track = &mut self.tactile[block.source.position()];
        if block.rows.checked_mul(source.n_taxels) != Some(block.values.len()) {
            track.wrong_length += 1;
            return Ok(());
        }
        let newest = track.stamp.last().copied();
        let last_stamp = block.stamp.offset(source.stamp_offset_ns);
        if !is_newer(last_stamp, newest.as_ref(), self.time_jump_ns, &source.name)? {
            track.late += block.rows as u64;
            return Ok(());
        }
        let Some(stamps) = RowStamps::new(last_stamp, block.rows, block.row_period_ns, newest) else { return Ok(()) };
        for (row_idx, row) in block.values.chunks_exact(source.n_taxels).enumerate() {
            let stamp = stamps.at(row_idx);
            if track.stamp.last().is_none_or(|newest| stamp > *newest) {
                track.stamp.push(stamp);
                track.values.extend_from_slice(row);
            } else {
                track.late += 1;
            }
        }
        Ok(())
    }

    fn handle_joints(&mut self, sample: &JointSample<'_>) -> Result<(), SampleError> {
        let source = &self.joint_sources[sample.source.position()];
        let stamp = sample.stamp.offset(source.stamp_offset_ns);
        for (name, position) in sample.names.iter().zip(sample.positions) {
            if !self.joints.contains_key(name) {
                if self.joints.len() == MAX_JOINTS {
                    return Err(SampleError::TooManyJoints { source_name: source.name.clone() });
                }
                self.joints.insert(name.clone(), JointTrack::default());
                self.joint_names.push(name.clone());
            }
            let Some(track) = self.joints.get_mut(name) else { continue };
            let angle = position * source.scale;
            if angle.is_finite() && is_newer(stamp, track.stamp.last(), self.time_jump_ns, &source.name)? {
                track.stamp.push(stamp);
                track.angle.push(angle);
            } else {
                track.unused += 1;
            }
        }
        Ok(())
    }
}

impl TactileTrack {
    /// Samples per second, from the median step between them. `None` for fewer than two samples.
    pub fn rate_hz(&self) -> Option<f64> {
        rate_hz(&self.stamp)
    }
}

impl JointTrack {
    /// The newest angle at or before a stamp, if it is not older than `max_age_ns`.
    pub fn at(&self, stamp: Stamp, max_age_ns: i64) -> Option<f64> {
        newest_at(&self.stamp, stamp, max_age_ns).map(|idx| self.angle[idx])
    }
}

/// Stamps per second, from the median step between them. `None` for fewer than two stamps.
pub fn rate_hz(stamps: &[Stamp]) -> Option<f64> {
    let mut steps: Vec<i64> = stamps.windows(2).map(|pair| pair[1].nanos_since(pair[0])).collect();
    let middle = steps.len() / 2;
    (!steps.is_empty()).then(|| NANOS_PER_SEC as f64 / (*steps.select_nth_unstable(middle).1).max(1) as f64)
}

/// Index of the newest stamp at or before `stamp`, if it is not older than `max_age_ns`.
pub fn newest_at(stamps: &[Stamp], stamp: Stamp, max_age_ns: i64) -> Option<usize> {
    let idx = stamps.partition_point(|known| *known <= stamp).checked_sub(1)?;
    (stamp.nanos_since(stamps[idx]) <= max_age_ns).then_some(idx)
}

/// True if a stamp is later than the newest one. An error if it jumps back in time.
fn is_newer(stamp: Stamp, newest: Option<&Stamp>, time_jump_ns: i64, name: &str) -> Result<bool, SampleError> {
    let Some(newest) = newest else { return Ok(true) };
    let back_ns = newest.nanos_since(stamp);
    if back_ns > time_jump_ns {
        let (source_name, seconds) = (name.to_owned(), back_ns as f64 * 1e-9);
        return Err(SampleError::TimeJump { source_name, at: stamp, seconds });
    }
    Ok(back_ns < 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fusion::{FrameClock, TactileSourceIdx};

    const STAMPS: [Stamp; 3] = [Stamp(10), Stamp(20), Stamp(40)];

    #[test]
    fn the_newest_stamp_is_never_of_the_future_and_never_too_old() {
        let at = |stamp| newest_at(&STAMPS, Stamp(stamp), 15);
        assert_eq!(
            [9, 10, 19, 20, 35, 36, 40, 55, 56].map(at),
            [None, Some(0), Some(0), Some(1), Some(1), None, Some(2), Some(2), None]
        );
    }

    #[test]
    fn a_burst_keeps_every_row_as_the_core_does() {
        let (name, frame_clock) = ("glove".to_owned(), FrameClock::Tactile);
        let mut samples = Samples {
            tactile: vec![TactileTrack::default()],
            joints: BTreeMap::new(),
            joint_names: Vec::new(),
            tactile_sources: vec![TactileSource {
                name,
                n_taxels: 1,
                stamp_offset_ns: 0,
                inverted: false,
                frame_clock,
            }],
            joint_sources: Vec::new(),
            time_jump_ns: 1000,
        };
        for (at, values) in [(20, [0.0, 1.0]), (24, [2.0, 3.0]), (24, [4.0, 5.0])] {
            let (source, stamp) = (TactileSourceIdx::at(0), Stamp(at));
            let row_period_ns = 10;
            let block = TactileBlock {
                source,
                stamp,
                rows: 2,
                row_period_ns,
                sequence: None,
                values: &values,
                received: stamp,
            };
            samples.handle_event(&Event::Tactile(block)).unwrap();
        }
        let track = &samples.tactile[0];
        assert_eq!(track.stamp, [10, 20, 22, 24].map(Stamp));
        assert_eq!((track.values.as_slice(), track.late), ([0.0, 1.0, 2.0, 3.0].as_slice(), 2));
    }

    #[test]
    fn late_stamps_are_not_newer_and_a_jump_of_time_is_refused() {
        let is_newer = |stamp| is_newer(Stamp(stamp), STAMPS.last(), 15, "glove");
        assert_eq!([41, 40, 25].map(is_newer), [Ok(true), Ok(false), Ok(false)]);
        assert!(is_newer(24).unwrap_err().to_string().contains("jump back"));
    }
}
