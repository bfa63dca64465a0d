//! One checked recording of one donning, frame by frame.

use sha2::{Digest, Sha256};

use super::super::error::DatasetError;
use crate::eval::Part;

/// The columns of a session. All have one entry per frame, matrices one row per frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SessionFrames {
    /// Name for errors and reports: the recording.
    pub name: String,
    /// Taxels per frame.
    pub n_taxels: usize,
    /// Joint angles per frame; 0 for a recording without pose.
    pub n_joints: usize,
    /// `[n, T]` row-major: features as the core ([`fusion`](crate::fusion)) writes them, baseline subtracted.
    pub tactile: Vec<f32>,
    /// `[n, P]` row-major, rad; empty without pose.
    pub pose: Vec<f32>,
    /// `[n]`, gF, tared on the zero-load stretches.
    pub truth_gf: Vec<f32>,
    /// `[n, 2]`, gF: the tangential force along two tangents, tared; empty for a truth of one axis.
    pub tangential_gf: Vec<f32>,
    /// `[n]`: frames annotated as free of load.
    pub zero_load: Vec<bool>,
    /// `[n]`: part of the split.
    pub part: Vec<Part>,
    /// `[n]`: changes at each gap in the frames. No window crosses a gap.
    pub epoch: Vec<u32>,
}

/// A session that can be used for training.
#[derive(Debug, Clone, PartialEq)]
pub struct Session(SessionFrames);

impl Session {
    /// Checks the columns.
    ///
    /// # Errors
    /// [`DatasetError`] for columns of different lengths, no truth, no zero-load annotation, or a number that is not
    /// finite.
    pub fn new(frames: SessionFrames) -> Result<Self, DatasetError> {
        let name = || frames.name.clone();
        if frames.n_taxels == 0 {
            return Err(DatasetError::NoTaxels { session: name() });
        }
        let n = frames.tactile.len() / frames.n_taxels;
        if frames.truth_gf.is_empty() {
            return Err(DatasetError::NoTruth { session: name() });
        }
        let width = |width: usize| n.saturating_mul(width);
        for (column, got, expected) in [
            ("tactile", frames.tactile.len(), width(frames.n_taxels)),
            ("pose", frames.pose.len(), width(frames.n_joints)),
            ("truth_gf", frames.truth_gf.len(), n),
            ("tangential_gf", frames.tangential_gf.len(), if frames.tangential_gf.is_empty() { 0 } else { width(2) }),
            ("zero_load", frames.zero_load.len(), n),
            ("part", frames.part.len(), n),
            ("epoch", frames.epoch.len(), n),
        ] {
            if got != expected {
                return Err(DatasetError::Length { session: name(), column, frames: n, expected, got });
            }
        }
        for (column, values, width) in [
            ("tactile", &frames.tactile, frames.n_taxels),
            ("pose", &frames.pose, frames.n_joints),
            ("truth_gf", &frames.truth_gf, 1),
            ("tangential_gf", &frames.tangential_gf, 2),
        ] {
            if let Some((idx, value)) = values.iter().enumerate().find(|(_, value)| !value.is_finite()) {
                let frame = idx / width.max(1);
                return Err(DatasetError::NonFinite { session: name(), column, frame, value: *value });
            }
        }
        if !frames.zero_load.contains(&true) {
            return Err(DatasetError::NoZeroLoad { session: name() });
        }
        Ok(Session(frames))
    }

    /// Its columns.
    pub fn frames(&self) -> &SessionFrames {
        &self.0
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Taxels per frame.
    pub fn n_taxels(&self) -> usize {
        self.0.n_taxels
    }

    /// Joint angles per frame.
    pub fn n_joints(&self) -> usize {
        self.0.n_joints
    }

    /// Axes of its true force: 1 or 3.
    pub fn n_axes(&self) -> usize {
        if self.0.tangential_gf.is_empty() { 1 } else { 3 }
    }

    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.0.truth_gf.len()
    }

    /// Adds all data that affects training to a hash.
    pub(super) fn hash_into(&self, hash: &mut Sha256) {
        let frames = &self.0;
        for size in [self.n_frames(), frames.n_taxels, frames.n_joints] {
            hash.update((size as u64).to_le_bytes());
        }
        // One axis adds nothing, so that data of one axis are what they were before there were three.
        for column in [&frames.tactile, &frames.pose, &frames.truth_gf, &frames.tangential_gf] {
            column.iter().for_each(|value| hash.update(value.to_le_bytes()));
        }
        frames.zero_load.iter().for_each(|zero_load| hash.update([u8::from(*zero_load)]));
    }
}
