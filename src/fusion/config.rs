//! Configuration of the fusion core. Values here are valid: invalid ones were refused when they were built.

use std::time::Duration;

use super::artifact::Following;
use super::geometry::Patch;
use super::regressor::{TouchLevels, TouchOutput};
use crate::units::Newton;

/// A pose as old as this is as usual, however fast its source is.
pub(super) const USUAL_POSE_AGE: Duration = Duration::from_millis(50);

/// Unless it is set, a pose is held for this long at least: a hand that a tracker loses for a moment.
pub(super) const SHORTEST_HOLD: Duration = Duration::from_millis(200);

/// How model frames are cut from tactile samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FrameClock {
    /// Each sample is one frame, at its own stamp. For sources that run at the model's rate.
    #[default]
    Tactile,
    /// Frames at `t0 + k / rate`: averaged over the interval when samples are dense, interpolated when they are sparse.
    Grid,
}

/// A stream of taxels.
#[derive(Debug, Clone, PartialEq)]
pub struct TactileSource {
    /// Name in the parameters.
    pub name: String,
    /// Taxels in a sample; a sample of another length is dropped and counted.
    pub n_taxels: usize,
    /// Added to every stamp of this source, ns.
    pub stamp_offset_ns: i64,
    /// True if a lower reading means more pressure.
    pub inverted: bool,
    /// How frames are cut from samples.
    pub frame_clock: FrameClock,
}

/// A stream of joint angles.
#[derive(Debug, Clone, PartialEq)]
pub struct JointSource {
    /// Name in the parameters.
    pub name: String,
    /// Added to every stamp of this source, ns.
    pub stamp_offset_ns: i64,
    /// Radians per unit of the source: 1 for radians, pi / 180 for degrees.
    pub scale: f64,
}

/// Tolerances in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timing {
    /// Frames missing for up to this long are interpolated; longer empties the window.
    pub max_gap: Duration,
    /// How much data time a frame waits for the joint state after it.
    pub joint_slack: Duration,
    /// How long the last joint state is held, and the longest span that is interpolated across. `None` follows the measured
    /// period of each joint, within bounds: see [`JointTimelines`](super::JointTimelines).
    pub max_pose_age: Option<Duration>,
    /// A stamp this far behind the newest one of its stream is a jump of time, not a late sample.
    pub time_jump: Duration,
    /// A frame whose stamp is further than this from its receipt is LATE, where receipts are those of a live run. `None`
    /// for no limit.
    pub max_age: Option<Duration>,
}

impl Timing {
    /// How long an angle stands for a time where no rate is known: what is set, or 50 ms.
    pub fn usual_pose_age(&self) -> Duration {
        self.max_pose_age.unwrap_or(USUAL_POSE_AGE)
    }

    /// How long an angle is held at least: what is set, or 200 ms.
    pub fn shortest_hold(&self) -> Duration {
        self.max_pose_age.unwrap_or(SHORTEST_HOLD)
    }
}

/// The signal that contact is decided on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactBy {
    /// The touch output of a model that has one, else the force.
    #[default]
    Model,
    /// The force.
    Force,
}

/// When a force or a probability of touch becomes a contact, and when it stops being one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactThresholds {
    /// The signal that contact is decided on.
    pub by: ContactBy,
    /// Replaces the levels that the model gives for its touch output.
    pub touch: Option<TouchLevels>,
    /// At or above this force there may be contact; also the single threshold of `contact_raw`.
    pub force_on: Newton,
    /// Below this force contact may end; less than `force_on`.
    pub force_off: Newton,
    /// Consecutive frames at or above `force_on`, or the touch level, before contact begins; at least 1.
    pub on_frames: u32,
    /// Consecutive frames below `force_off`, or the touch level, before contact ends; at least 1.
    pub off_frames: u32,
}

impl ContactThresholds {
    /// The levels of the touch output of a model; `None` where contact is decided on the force.
    pub fn touch_levels(&self, output: Option<&TouchOutput>) -> Option<TouchLevels> {
        match self.by {
            ContactBy::Force => None,
            ContactBy::Model => output.map(|output| self.touch.unwrap_or(output.levels)),
        }
    }
}

impl FusionConfig {
    /// Taxels of a source that some region has.
    pub fn taxels_in_use(&self, source: super::TactileSourceIdx) -> impl Iterator<Item = usize> {
        self.regions
            .iter()
            .filter(move |region| region.source == source)
            .flat_map(|region| region.taxels.iter().copied())
    }
}

/// One patch of the hand with one force.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionConfig {
    /// Name in topics and messages.
    pub name: String,
    /// Index of its tactile source.
    pub source: super::TactileSourceIdx,
    /// Its taxels as indices into a sample of the source, in the order of the model's input.
    pub taxels: Vec<usize>,
    /// Its joints by name, in the order of the model's pose input; empty for a model without pose.
    pub joints: Vec<String>,
    /// Names by which its model knows these joints, for a model of another finger; empty where they are the same.
    pub model_joints: Vec<String>,
    /// Index of its model among the regressors given to [`Fusion::new`](super::Fusion::new).
    pub model: usize,
    /// Where its force acts and along which direction.
    pub patch: Patch,
    /// Contact thresholds.
    pub contact: ContactThresholds,
}

/// Meaning of the receipt times of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Receipts {
    /// Nothing of how old the data were: they mark outputs and reach no estimate. A bag of any other recorder.
    #[default]
    Unknown,
    /// When a live node had each event, by its ROS time: the age of a frame follows from them, and LATE.
    Live,
}

/// Everything the core needs to know, apart from models and calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct FusionConfig {
    /// Streams of taxels.
    pub tactile_sources: Vec<TactileSource>,
    /// Streams of joint angles.
    pub joint_sources: Vec<JointSource>,
    /// The patches to estimate.
    pub regions: Vec<RegionConfig>,
    /// Tolerances in time.
    pub timing: Timing,
    /// Meaning of the receipt times of events.
    pub receipts: Receipts,
    /// Handling of artifacts after the calibration, for models that have them.
    pub following: Following,
    /// Frames run in one inference call; 1 gives each frame its own, and the same bytes live and offline.
    pub batch: usize,
    /// True if ticks also hold the taxels of their frame, for those who look at them.
    pub keep_taxels: bool,
}
