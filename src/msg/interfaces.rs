//! Our own messages. Each matches a definition under `msg`, which explains its fields in full.

use serde::{Deserialize, Serialize};

use super::{Duration, Header, Time, WireType};

/// Raw block of consecutive samples of a tactile array.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TaxelArray {
    /// Stamp of the last row.
    pub header: Header,
    /// Counter that grows by one per message and wraps.
    pub sequence: u32,
    /// Samples in the message.
    pub rows: u32,
    /// Time between rows.
    pub row_period: Duration,
    /// `[rows, taxels]`, row-major.
    pub values: Vec<f32>,
}

/// Force and contact of one region.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ContactState {
    /// Name of the region.
    pub region: String,
    /// Frame of the region's wrench.
    pub frame_id: String,
    /// True if `touch` of this frame alone is at or above `touch_on`. If that is NaN, true if the force is at or above
    /// `on_threshold`.
    pub contact_raw: bool,
    /// True if there is contact, after hysteresis and debounce.
    pub contact: bool,
    /// [`NONE`](Self::NONE), [`ONSET`](Self::ONSET) or [`OFFSET`](Self::OFFSET).
    pub event: u8,
    /// Stamp of the first frame of the run that led to the current value of `contact`.
    pub since: Time,
    /// N; NaN if there is no estimate.
    pub force: f64,
    /// N, before pose correction; NaN if the model doesn't give it.
    pub force_base: f64,
    /// N, `force_base - force`; NaN if either is unknown.
    pub artifact: f64,
    /// N.
    pub on_threshold: f64,
    /// N.
    pub off_threshold: f64,
    /// N; NaN if unknown.
    pub mdf: f64,
    /// s; 0 if the joint angles were interpolated, NaN if there were none.
    pub pose_age: f64,
    /// s, from the stamp until the node had received the whole frame; NaN if unknown.
    pub age: f64,
    /// Bits from [`WARMUP`](Self::WARMUP) on, combined with OR.
    pub flags: u32,
    /// One of [`ADAPTATION_OFF`](Self::ADAPTATION_OFF) and those after it.
    pub adaptation: u8,
    /// Distance of the artifact from its calibration, as a share of its gains; NaN if the artifact is not removed.
    pub artifact_change: f64,
    /// Probability that something touches the region; NaN without an estimate, or if the model doesn't give it.
    pub touch: f64,
    /// Contact may begin at or above this probability; NaN if contact is decided on force.
    pub touch_on: f64,
    /// Contact may end below this probability; NaN if contact is decided on force.
    pub touch_off: f64,
}

impl ContactState {
    /// `event`: no change of contact since the frame before.
    pub const NONE: u8 = 0;
    /// `event`: contact became true in this frame.
    pub const ONSET: u8 = 1;
    /// `event`: contact became false in this frame.
    pub const OFFSET: u8 = 2;

    /// `adaptation`: the model has no artifact model, or the artifact is not removed from the taxels.
    pub const ADAPTATION_OFF: u8 = 0;
    /// `adaptation`: the artifact of the calibration is removed, or without one the artifact of the training donnings.
    pub const ADAPTATION_FROZEN: u8 = 1;
    /// `adaptation`: the artifact is removed, and its changes are followed.
    pub const ADAPTATION_LEARNING: u8 = 2;
    /// `adaptation`: as before, but this frame is not reliable for learning: a touch, missing joint angles, or a fault.
    pub const ADAPTATION_WAITING: u8 = 3;
    /// `adaptation`: as before, but the artifact has reached its largest distance from the calibration.
    pub const ADAPTATION_CAPPED: u8 = 4;
    /// `adaptation`: the same, and joint angles are so noisy that changes are followed slowly, and `touch` is lowered.
    pub const ADAPTATION_NOISY: u8 = 5;

    /// `flags`: the window of the model is not full yet.
    pub const WARMUP: u32 = 1;
    /// `flags`: there is no baseline to subtract.
    pub const UNCALIBRATED: u32 = 2;
    /// `flags`: a joint angle of the window is unknown or too old. The force is the base force, or is computed with the
    /// artifact of the last known angles removed, or there is no estimate.
    pub const STALE_POSE: u32 = 4;
    /// `flags`: no taxels arrived in time.
    pub const STALE_TACTILE: u32 = 8;
    /// `flags`: a joint angle is outside the range of the training data.
    pub const POSE_OUT_OF_RANGE: u32 = 16;
    /// `flags`: a taxel of the region never changed during the calibration of the baseline, or doesn't change now.
    pub const FAULTY_TAXEL: u32 = 32;
    /// `flags`: an input or the output of the model was not finite.
    pub const NON_FINITE: u32 = 64;
    /// `flags`: `age` is larger than `timing.max_age_ms`, or negative by more than that.
    pub const LATE: u32 = 128;
    /// `flags`: joint angles of the window are missing, and the last ones are held.
    pub const HELD_POSE: u32 = 256;
    /// `flags`: no taxel has changed for longer than their noise explains.
    pub const FROZEN: u32 = 512;
    /// `flags`: taxels of two senders are interleaved.
    pub const INTERLEAVED: u32 = 1024;
    /// `flags`: taxels arrive faster than the model's rate, and each is used as a frame.
    pub const WRONG_RATE: u32 = 2048;
}

/// All regions of one glove at one frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ContactArray {
    /// Stamp of the frame.
    pub header: Header,
    /// `[regions]`, in the order of the parameters.
    pub contacts: Vec<ContactState>,
}

/// Annotation of a recording by the collection protocol. It holds from its stamp until the next one.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Stage {
    /// Begin of the annotation.
    pub header: Header,
    /// Stage, 1 to 3, or [`OUTSIDE`](Self::OUTSIDE).
    pub stage: u8,
    /// Substage in snake_case; empty if there is none.
    pub substage: String,
    /// Instructed pose or movement in snake_case; empty when free.
    pub pose: String,
    /// Repetition of the pose, from 0.
    pub repetition: u16,
    /// True if the fingertip is known to touch nothing.
    pub zero_load: bool,
}

impl Stage {
    /// `stage`: between the stages, or not in a protocol.
    pub const OUTSIDE: u8 = 0;
    /// `stage`: in-air pose changes without load.
    pub const ZERO_LOAD_POSES: u8 = 1;
    /// `stage`: taps and presses, with still and with moving poses.
    pub const LOAD_UNLOAD_POSES: u8 = 2;
    /// `stage`: pose changes while a press is held.
    pub const LOADED_POSES: u8 = 3;
}

impl WireType for TaxelArray {
    const TYPE_NAME: &'static str = "tactile_pose_fusion/msg/TaxelArray";
}

impl WireType for ContactState {
    const TYPE_NAME: &'static str = "tactile_pose_fusion/msg/ContactState";
}

impl WireType for ContactArray {
    const TYPE_NAME: &'static str = "tactile_pose_fusion/msg/ContactArray";
}

impl WireType for Stage {
    const TYPE_NAME: &'static str = "tactile_pose_fusion/msg/Stage";
}
