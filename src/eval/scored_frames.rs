//! The frames that are scored.

use super::groups::Origin;
use crate::units::Stamp;

/// The frames of one session that are scored.
///
/// # Shapes
/// All but `origins`, `asked` and `resumes`: `[n_frames]`, in the order of their stamps.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScoredFrames {
    /// Stamps.
    pub stamp: Vec<Stamp>,
    /// True force, gF, tared.
    pub truth_gf: Vec<f64>,
    /// Estimated force, gF; `None` where there is no estimate.
    pub estimate_gf: Vec<Option<f64>>,
    /// True tangential force, gF, tared: x y z in the frame of the patch. Empty where the truth has one axis.
    pub true_tangential_gf: Vec<Option<[f64; 3]>>,
    /// Estimated tangential force, gF: x y z in the frame of the patch. Empty where the model gives one axis.
    pub tangential_gf: Vec<Option<[f64; 3]>>,
    /// Base force, gF, where the model gives it; else empty.
    pub base_gf: Vec<Option<f64>>,
    /// Probability of touch, where contact is decided on it; else empty.
    pub touch: Vec<Option<f64>>,
    /// Whether the probability of touch is at its threshold, where contact is decided on it; else empty, and a frame's
    /// touch is judged by its force.
    pub touched: Vec<bool>,
    /// Contact, with hysteresis and debounce.
    pub contact: Vec<bool>,
    /// The same of the base force, where the model gives it; else empty.
    pub base_contact: Vec<bool>,
    /// Age of the oldest joint angle, ns.
    pub pose_age_ns: Vec<Option<i64>>,
    /// Index into `origins`.
    pub origin: Vec<usize>,
    /// Where frames come from: they share glove, user and session.
    pub origins: Vec<Origin>,
    /// `[origins]`: what was asked for there.
    pub asked: Vec<Asked>,
    /// Frames right before which others were left out, because they are not scored.
    pub resumes: Vec<usize>,
}

/// The pose and the contact that a stretch of the protocol asked for.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Asked {
    /// Pose or movement; that of the substage where none was named.
    pub pose: String,
    /// Whether nothing touches the glove.
    pub zero_load: bool,
}
