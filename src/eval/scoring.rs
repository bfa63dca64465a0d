//! Scoring rules: what counts as touch, and how frames are binned; all that a score depends on besides the frames.

use serde::{Deserialize, Serialize};

use crate::units::GramForce;

/// The true force from which on a frame is touch.
///
/// # Source
/// Pose-aware tactile gloves, Sec. VI-A: the truth of every zero-load action stays below it.
pub const TOUCH: GramForce = GramForce(2.5);

/// Width of a bin of true force. Source: Sec. VI-A.
pub const BIN_WIDTH: GramForce = GramForce(10.0);

/// Balanced accuracy at which a force counts as detectable. Source: Sec. VI-A.
pub const MDF_BALANCED_ACCURACY: f64 = 0.9;

/// Bins kept of one tally: 20 kgF at the default width, twenty times what the protocol presses.
pub(super) const MAX_BINS: u32 = 2000;

/// How a frame without an estimate is scored for touch. It never enters MAE and R2, and is counted either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MissingEstimate {
    /// Nothing: the frame is left out of every metric.
    #[default]
    Excluded,
    /// That no touch was reported: a miss during touch, and right in the air.
    NoTouch,
}

/// A scoring rule that can't be.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ScoringError {
    #[error("touch threshold is {0}, expected a finite force above 0 gF; the paper's is 2.5")]
    Touch(GramForce),
    #[error("width of force bins is {0}, expected a finite force of at least 0.001 gF; the paper's is 10")]
    BinWidth(GramForce),
    #[error("least number of frames in a force bin is 0, expected 1 or more; an empty bin has no accuracy")]
    MinBinFrames,
}

/// How frames are scored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Scoring {
    touch_gf: f64,
    bin_width_gf: f64,
    min_bin_frames: u64,
    missing: MissingEstimate,
}

impl Default for Scoring {
    /// The paper's: touch at 2.5 gF, bins of 10 gF with at least one frame, frames without an estimate left out.
    fn default() -> Self {
        Scoring { touch_gf: TOUCH.0, bin_width_gf: BIN_WIDTH.0, min_bin_frames: 1, missing: MissingEstimate::Excluded }
    }
}

impl Scoring {
    /// Touch at or above `touch`, bins of `bin_width` that count from `min_bin_frames` on.
    ///
    /// # Errors
    /// [`ScoringError`] names the value that can't be.
    pub fn new(
        touch: GramForce,
        bin_width: GramForce,
        min_bin_frames: u64,
        missing: MissingEstimate,
    ) -> Result<Self, ScoringError> {
        if !(touch.0.is_finite() && touch.0 > 0.0) {
            return Err(ScoringError::Touch(touch));
        }
        if !(bin_width.0.is_finite() && bin_width.0 >= 1e-3) {
            return Err(ScoringError::BinWidth(bin_width));
        }
        if min_bin_frames == 0 {
            return Err(ScoringError::MinBinFrames);
        }
        Ok(Scoring { touch_gf: touch.0, bin_width_gf: bin_width.0, min_bin_frames, missing })
    }

    /// Whether `force_gf` is touch. NaN is not.
    pub fn is_touch(&self, force_gf: f64) -> bool {
        force_gf >= self.touch_gf
    }

    /// The touch threshold.
    pub fn touch(&self) -> GramForce {
        GramForce(self.touch_gf)
    }

    /// Frames that a bin needs to be on the curve.
    pub fn min_bin_frames(&self) -> u64 {
        self.min_bin_frames
    }

    /// How a frame without an estimate is scored for touch.
    pub fn missing(&self) -> MissingEstimate {
        self.missing
    }

    /// The bin of a true force that is touch; `None` past the last bin that is kept.
    pub(super) fn bin_of(&self, force_gf: f64) -> Option<u32> {
        let bin = (force_gf / self.bin_width_gf).floor() - self.first_bin();
        // The comparison is in floating point, so that no force can wrap around.
        (bin < f64::from(MAX_BINS)).then_some(bin as u32)
    }

    /// Lower edge (inclusive) and upper edge (exclusive) of a bin, gF. The bin that holds the touch threshold begins
    /// there.
    pub(super) fn edges(&self, bin: u32) -> (f64, f64) {
        let bin = self.first_bin() + f64::from(bin);
        ((bin * self.bin_width_gf).max(self.touch_gf), (bin + 1.0) * self.bin_width_gf)
    }

    fn first_bin(&self) -> f64 {
        (self.touch_gf / self.bin_width_gf).floor()
    }
}
