//! Our own messages. Each mirrors a text under `msg`, which is where its fields are explained in full.

use serde::{Deserialize, Serialize};

use super::{Duration, Header, Time, WireType};

/// A block of consecutive samples of one tactile array, raw.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TaxelArray {
    /// Stamp of the last row.
    pub header: Header,
    /// One up a message, wrapping.
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
    /// Whether `touch` of this frame alone is at or above `touch_on`; where that is NaN, whether the force is at or above
    /// `on_threshold`.
    pub contact_raw: bool,
    /// Whether there is contact, with hysteresis and debounce.
    pub contact: bool,
    /// [`NONE`](Self::NONE), [`ONSET`](Self::ONSET) or [`OFFSET`](Self::OFFSET).
    pub event: u8,
    /// Stamp of the first frame of the run that led to the current value of `contact`.
    pub since: Time,
    /// N; NaN when there is no estimate.
    pub force: f64,
    /// N, before pose correction; NaN when the model does not give it.
    pub force_base: f64,
    /// N, `force_base - force`; NaN when either is unknown.
    pub artifact: f64,
    /// N.
    pub on_threshold: f64,
    /// N.
    pub off_threshold: f64,
    /// N; NaN when unknown.
    pub mdf: f64,
    /// s; 0 when angles were interpolated, NaN when there were none.
    pub pose_age: f64,
    /// s, from the stamp until the node had received all of the frame; NaN where nobody knows.
    pub age: f64,
    /// Bits from [`WARMUP`](Self::WARMUP) on, or-ed.
    pub flags: u32,
    /// One of [`ADAPTATION_OFF`](Self::ADAPTATION_OFF) and those after it.
    pub adaptation: u8,
    /// How far the artifact is from its calibration, as a share of its gains; NaN where it is not taken out.
    pub artifact_change: f64,
    /// Probability that something touches the region; NaN without an estimate, or where the model doesn't give it.
    pub touch: f64,
    /// Contact may begin at or above this probability; NaN where contact is decided on force.
    pub touch_on: f64,
    /// Contact may end below this probability; NaN where contact is decided on force.
    pub touch_off: f64,
}

impl ContactState {
    /// `event`: contact is what it was a frame ago.
    pub const NONE: u8 = 0;
    /// `event`: contact became true in this frame.
    pub const ONSET: u8 = 1;
    /// `event`: contact became false in this frame.
    pub const OFFSET: u8 = 2;

    /// `adaptation`: the model tells no artifact, or it is left in the taxels.
    pub const ADAPTATION_OFF: u8 = 0;
    /// `adaptation`: the artifact of the calibration is taken out, or without one that of the training donnings.
    pub const ADAPTATION_FROZEN: u8 = 1;
    /// `adaptation`: the artifact is taken out, and how it changes is followed.
    pub const ADAPTATION_LEARNING: u8 = 2;
    /// `adaptation`: the same, and this frame teaches nothing for sure.
    pub const ADAPTATION_WAITING: u8 = 3;
    /// `adaptation`: the same, and the artifact is as far from its calibration as it may go.
    pub const ADAPTATION_CAPPED: u8 = 4;
    /// `adaptation`: the same, and joint angles are so noisy that changes are followed slowly, and `touch` is lowered.
    pub const ADAPTATION_NOISY: u8 = 5;

    /// `flags`: the window of the model is not full yet.
    pub const WARMUP: u32 = 1;
    /// `flags`: there is no baseline to subtract.
    pub const UNCALIBRATED: u32 = 2;
    /// `flags`: a joint angle of the window is unknown or too old, so the force is without pose correction.
    pub const STALE_POSE: u32 = 4;
    /// `flags`: no taxels came in time.
    pub const STALE_TACTILE: u32 = 8;
    /// `flags`: a joint angle lies outside of what the model was trained on.
    pub const POSE_OUT_OF_RANGE: u32 = 16;
    /// `flags`: a taxel of the region never moved while the baseline was taken, or stands still now.
    pub const FAULTY_TAXEL: u32 = 32;
    /// `flags`: an input or the output of the model was not finite.
    pub const NON_FINITE: u32 = 64;
    /// `flags`: `age` is beyond `timing.max_age_ms`, before or after.
    pub const LATE: u32 = 128;
    /// `flags`: joint angles of the window are missing, and the last ones are held.
    pub const HELD_POSE: u32 = 256;
    /// `flags`: all taxels stand still for longer than their noise allows.
    pub const FROZEN: u32 = 512;
    /// `flags`: taxels of two senders come in turn.
    pub const INTERLEAVED: u32 = 1024;
    /// `flags`: taxels come faster than the model's rate, each taken as a frame.
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

/// Annotation of a recording by the collection protocol, from its stamp until the next one.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Stage {
    /// From when on it holds.
    pub header: Header,
    /// 1 to 3; [`OUTSIDE`](Self::OUTSIDE) otherwise.
    pub stage: u8,
    /// Substage in snake_case; empty outside of one.
    pub substage: String,
    /// Instructed pose or movement in snake_case; empty when free.
    pub pose: String,
    /// Repetition of the pose, from 0.
    pub repetition: u16,
    /// Whether the fingertip is known to touch nothing.
    pub zero_load: bool,
}

impl Stage {
    /// `stage`: between the stages, or no protocol at all.
    pub const OUTSIDE: u8 = 0;
    /// `stage`: in-air pose changes without load.
    pub const ZERO_LOAD_POSES: u8 = 1;
    /// `stage`: taps and presses at still and moving poses.
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
