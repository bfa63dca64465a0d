//! Configuration of the fusion core.

use std::cmp::Ordering;
use std::num::{NonZeroU32, NonZeroUsize};
use std::time::Duration;

use super::artifact::Following;
use super::error::SetupError;
use super::geometry::Patch;
use super::idx::{JointSourceIdx, ModelIdx, RegionIdx, TactileSourceIdx};
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
    /// period of each joint: three of them, at least 200 ms and at most 500 ms.
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

/// [`ContactThresholds::touch_evidence`] unless it is set.
pub const TOUCH_EVIDENCE: f64 = 5.0;

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
    /// How much the log odds of touch above those of the lower level must add up to, over the frames before, until contact begins:
    /// 0 for none. A probability just above the level takes longer than one that leaves no doubt.
    pub touch_evidence: f64,
    /// At or above this force there may be contact; also the single threshold of `contact_raw`.
    pub force_on: Newton,
    /// Below this force contact may end; less than `force_on`.
    pub force_off: Newton,
    /// Consecutive frames at or above `force_on`, or the touch level, before contact begins.
    pub on_frames: NonZeroU32,
    /// Consecutive frames below `force_off`, or the touch level, before contact ends.
    pub off_frames: NonZeroU32,
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

/// One patch of the hand with one force. [`FusionConfig::new`] checks it.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionConfig {
    /// Name in topics and messages.
    pub name: String,
    /// Its tactile source.
    pub source: TactileSourceIdx,
    /// Its taxels as indices into a sample of the source, in the order of the model's input.
    pub taxels: Vec<usize>,
    /// Its joints by name, in the order of the model's pose input; empty for a model without pose.
    pub joints: Vec<String>,
    /// Names by which its model knows these joints, for a model of another finger; empty where they are the same.
    pub model_joints: Vec<String>,
    /// Its model.
    pub model: ModelIdx,
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
///
/// # Invariant
/// A configuration that exists is whole: every region has a source, taxels of that source, and thresholds in their order.
/// Nothing changes it. The methods `with_*`, `without_*` and [`FusionConfig::only`] consume it and give another one, of
/// which the same is true. That it also fits its models is checked where it meets them, by
/// [`Fusion::new`](super::Fusion::new), which is the only way into a core:
/// `fusion_config::a_config_that_is_not_whole_is_refused`, `fusion_config::what_is_made_of_a_config_is_whole`.
#[derive(Debug, Clone, PartialEq)]
pub struct FusionConfig {
    tactile_sources: Vec<TactileSource>,
    joint_sources: Vec<JointSource>,
    regions: Vec<RegionConfig>,
    timing: Timing,
    receipts: Receipts,
    following: Following,
    batch: NonZeroUsize,
    keeps_taxels: bool,
}

impl FusionConfig {
    /// A configuration that runs each frame at once, knows nothing of receipts and keeps no taxels.
    ///
    /// # Errors
    /// [`SetupError::EmptySource`], [`SetupError::NoTactileSource`], [`SetupError::NoTaxel`],
    /// [`SetupError::ForceThresholds`] and [`SetupError::TouchThresholds`].
    pub fn new(
        tactile_sources: Vec<TactileSource>,
        joint_sources: Vec<JointSource>,
        regions: Vec<RegionConfig>,
        timing: Timing,
    ) -> Result<Self, SetupError> {
        check_sources(&tactile_sources, &regions)?;
        regions.iter().try_for_each(|region| check_thresholds(&region.name, &region.contact))?;
        Ok(FusionConfig {
            tactile_sources,
            joint_sources,
            regions,
            timing,
            receipts: Receipts::default(),
            following: Following::default(),
            batch: NonZeroUsize::MIN,
            keeps_taxels: false,
        })
    }

    /// The same with other tolerances in time.
    pub fn with_timing(self, timing: Timing) -> Self {
        FusionConfig { timing, ..self }
    }

    /// The same with another meaning of the receipt times of events.
    pub fn with_receipts(self, receipts: Receipts) -> Self {
        FusionConfig { receipts, ..self }
    }

    /// The same with another handling of artifacts after the calibration.
    pub fn with_following(self, following: Following) -> Self {
        FusionConfig { following, ..self }
    }

    /// The same with another number of frames in one inference call.
    pub fn with_batch(self, batch: NonZeroUsize) -> Self {
        FusionConfig { batch, ..self }
    }

    /// The same with the taxels of each frame in its tick, or without them.
    pub fn with_kept_taxels(self, keeps_taxels: bool) -> Self {
        FusionConfig { keeps_taxels, ..self }
    }

    /// The same with other contact thresholds.
    ///
    /// # Shapes
    /// `thresholds`: `[regions]`.
    ///
    /// # Errors
    /// [`SetupError::NThresholds`], [`SetupError::ForceThresholds`] and [`SetupError::TouchThresholds`].
    pub fn with_thresholds(mut self, thresholds: &[ContactThresholds]) -> Result<Self, SetupError> {
        let (expected, got) = (self.regions.len(), thresholds.len());
        if got != expected {
            return Err(SetupError::NThresholds { expected, got });
        }
        for (region, thresholds) in self.regions.iter_mut().zip(thresholds) {
            check_thresholds(&region.name, thresholds)?;
            region.contact = *thresholds;
        }
        Ok(self)
    }

    /// The same with these joints for every region, which its model knows by the same names.
    pub fn with_joints(self, joints: &[String]) -> Self {
        self.with_joints_of(|_| Some(joints.to_vec()))
    }

    /// The same with one model for all regions: the only one that [`Fusion::new`](super::Fusion::new) is then given.
    pub fn with_one_model(mut self) -> Self {
        self.regions.iter_mut().for_each(|region| region.model = ModelIdx::at(0));
        self
    }

    /// The same with other joints for the regions for which `joints` has them; their models know them by these names.
    pub fn with_joints_of(mut self, joints: impl Fn(&RegionConfig) -> Option<Vec<String>>) -> Self {
        for region in &mut self.regions {
            if let Some(joints) = joints(region) {
                region.joints = joints;
                region.model_joints.clear();
            }
        }
        self
    }

    /// The same without any joint, and without the sources of joint angles.
    pub fn without_pose(self) -> Self {
        FusionConfig { joint_sources: Vec::new(), ..self.with_joints_of(|_| Some(Vec::new())) }
    }

    /// The same with a single region; `None` if it doesn't have that region. Sources and models keep their indices, also
    /// those that no region uses any more.
    pub fn only(self, region: RegionIdx) -> Option<Self> {
        self.only_these(&[region])
    }

    /// The same with these regions, in this order; `None` if it doesn't have one of them, or none is given. Sources and models
    /// keep their indices, also those that no region uses any more.
    pub fn only_these(self, regions: &[RegionIdx]) -> Option<Self> {
        let regions: Vec<RegionConfig> =
            regions.iter().map(|region| self.regions.get(region.position()).cloned()).collect::<Option<_>>()?;
        (!regions.is_empty()).then_some(FusionConfig { regions, ..self })
    }

    /// Streams of taxels.
    pub fn tactile_sources(&self) -> &[TactileSource] {
        &self.tactile_sources
    }

    /// Streams of joint angles.
    pub fn joint_sources(&self) -> &[JointSource] {
        &self.joint_sources
    }

    /// The patches to estimate.
    pub fn regions(&self) -> &[RegionConfig] {
        &self.regions
    }

    /// Indices of the tactile sources, in their order.
    pub fn tactile_source_idxs(&self) -> impl Iterator<Item = TactileSourceIdx> + Clone + use<> {
        (0..self.tactile_sources.len()).map(TactileSourceIdx::at)
    }

    /// Indices of the joint sources, in their order.
    pub fn joint_source_idxs(&self) -> impl Iterator<Item = JointSourceIdx> + Clone + use<> {
        (0..self.joint_sources.len()).map(JointSourceIdx::at)
    }

    /// Indices of the regions, in their order.
    pub fn region_idxs(&self) -> impl Iterator<Item = RegionIdx> + Clone + use<> {
        (0..self.regions.len()).map(RegionIdx::at)
    }

    /// A tactile source; `None` if there is no such one.
    pub fn tactile_source(&self, source: TactileSourceIdx) -> Option<&TactileSource> {
        self.tactile_sources.get(source.position())
    }

    /// A joint source; `None` if there is no such one.
    pub fn joint_source(&self, source: JointSourceIdx) -> Option<&JointSource> {
        self.joint_sources.get(source.position())
    }

    /// A region; `None` if there is no such one.
    pub fn region(&self, region: RegionIdx) -> Option<&RegionConfig> {
        self.regions.get(region.position())
    }

    /// The tactile source of a name.
    pub fn tactile_source_named(&self, name: &str) -> Option<TactileSourceIdx> {
        self.tactile_sources.iter().position(|source| source.name == name).map(TactileSourceIdx::at)
    }

    /// The joint source of a name.
    pub fn joint_source_named(&self, name: &str) -> Option<JointSourceIdx> {
        self.joint_sources.iter().position(|source| source.name == name).map(JointSourceIdx::at)
    }

    /// The region of a name.
    pub fn region_named(&self, name: &str) -> Option<RegionIdx> {
        self.regions.iter().position(|region| region.name == name).map(RegionIdx::at)
    }

    /// Taxels of a source that some region has.
    pub fn taxels_in_use(&self, source: TactileSourceIdx) -> impl Iterator<Item = usize> {
        self.regions
            .iter()
            .filter(move |region| region.source == source)
            .flat_map(|region| region.taxels.iter().copied())
    }

    /// Tolerances in time.
    pub fn timing(&self) -> &Timing {
        &self.timing
    }

    /// Meaning of the receipt times of events.
    pub fn receipts(&self) -> Receipts {
        self.receipts
    }

    /// Handling of artifacts after the calibration, for models that have them.
    pub fn following(&self) -> Following {
        self.following
    }

    /// Frames run in one inference call; 1 gives each frame its own, and the same bytes live and offline.
    pub fn batch(&self) -> NonZeroUsize {
        self.batch
    }

    /// True if ticks also hold the taxels of their frame, for those who look at them.
    pub fn keeps_taxels(&self) -> bool {
        self.keeps_taxels
    }
}

/// Checks that every source has taxels, and that every region has a source with its taxels.
fn check_sources(sources: &[TactileSource], regions: &[RegionConfig]) -> Result<(), SetupError> {
    if let Some(empty) = sources.iter().find(|source| source.n_taxels == 0) {
        return Err(SetupError::EmptySource { source_name: empty.name.clone() });
    }
    for region in regions {
        let name = || region.name.clone();
        let (got, n_sources) = (region.source.position(), sources.len());
        let source = sources.get(got);
        let n_taxels = source.ok_or_else(|| SetupError::NoTactileSource { region: name(), got, n_sources })?.n_taxels;
        if let Some(&got) = region.taxels.iter().find(|taxel| **taxel >= n_taxels) {
            return Err(SetupError::NoTaxel { region: name(), got, n_taxels });
        }
    }
    Ok(())
}

/// Checks that contact ends below the levels at which it begins.
fn check_thresholds(region: &str, thresholds: &ContactThresholds) -> Result<(), SetupError> {
    let name = || region.to_owned();
    let (on, off) = (thresholds.force_on.0, thresholds.force_off.0);
    if off.partial_cmp(&on) != Some(Ordering::Less) {
        return Err(SetupError::ForceThresholds { region: name(), on, off });
    }
    match thresholds.touch {
        Some(TouchLevels { on, off }) if off.partial_cmp(&on) != Some(Ordering::Less) => {
            Err(SetupError::TouchThresholds { region: name(), on, off })
        }
        _ => Ok(()),
    }
}
