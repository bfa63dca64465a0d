//! Interface of a force model for the fusion core: a contract that is known before the first window, and one batched run.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::num::NonZeroUsize;
use std::sync::Arc;

use serde::Serialize;

use super::artifact::ArtifactModel;
use crate::units::{GramForce, Newton};

/// The unit of the forces of a model or a force sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ForceUnit {
    /// Grams-force, as in the paper.
    GramForce,
    /// Newtons.
    Newton,
    /// Kilograms-force, which force sensors send.
    KilogramForce,
    /// Millinewtons, which force sensors send.
    Millinewton,
}

impl ForceUnit {
    /// A model's output or a sensor's reading as newtons.
    pub fn to_newton(self, raw: impl Into<f64>) -> Newton {
        let raw = raw.into();
        match self {
            ForceUnit::GramForce => GramForce(raw).into(),
            ForceUnit::Newton => Newton(raw),
            ForceUnit::KilogramForce => GramForce(1e3 * raw).into(),
            ForceUnit::Millinewton => Newton(1e-3 * raw),
        }
    }
}

/// A joint angle's span in the data that a model was trained on, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseRange {
    /// Smallest angle, rad.
    pub min: f64,
    /// Largest angle, rad.
    pub max: f64,
}

/// Touch probabilities at which contact begins and ends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TouchLevels {
    /// At or above this probability there may be contact; also the single threshold of `contact_raw`.
    pub on: f64,
    /// Below this probability contact may end; less than `on`.
    pub off: f64,
}

impl TouchLevels {
    /// Contact from this probability on, and its end where hysteresis is as usual: below 0.7 of it.
    pub fn from_on(on: f64) -> Self {
        TouchLevels { on, off: 0.7 * on }
    }
}

/// A model's touch output: the probability that something touches the region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TouchOutput {
    /// The levels that the model was judged with when it was trained, or the defaults for a model without levels.
    #[serde(flatten)]
    pub levels: TouchLevels,
    /// False touches a minute in the air at these levels, as measured when the model was trained, if the model has it.
    pub false_per_min: Option<f64>,
}

impl Default for TouchOutput {
    /// For a model without levels.
    fn default() -> Self {
        TouchOutput { levels: TouchLevels::from_on(0.5), false_per_min: None }
    }
}

/// Axes of a model's forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ForceAxes {
    /// One number: the normal force, positive under pressure.
    #[default]
    Normal,
    /// Three numbers: x, y, z of the force on the hand by the object, in the frame of the patch.
    Patch,
}

impl ForceAxes {
    /// Numbers of a force.
    pub fn n(self) -> usize {
        match self {
            ForceAxes::Normal => 1,
            ForceAxes::Patch => 3,
        }
    }
}

/// What a model that serves several regions has for one of them.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionTerms {
    /// Joint names in the order of the region's joints.
    pub joints: Vec<String>,
    /// Per joint, in their order; empty if the model doesn't have it.
    pub pose_range: Vec<PoseRange>,
    /// Effect of pose on the region's taxels.
    pub artifact: Arc<ArtifactModel>,
}

/// Contract of a model: read from the file once, checked against the parameters at start.
#[derive(Debug, Clone, PartialEq)]
pub struct Contract {
    /// Frames in a window.
    pub window: NonZeroUsize,
    /// Taxels in a frame.
    pub n_taxels: usize,
    /// Joint angles in a frame; 0 for a model without a pose input.
    pub n_joints: usize,
    /// Model frames a second.
    pub rate_hz: f64,
    /// The unit of every force output.
    pub unit: ForceUnit,
    /// Axes of every force output.
    pub axes: ForceAxes,
    /// True if the model also gives the force of its tactile branch alone, unmoved by pose.
    pub has_base: bool,
    /// The model's touch output, where it has one: contact is decided on it.
    pub touch: Option<TouchOutput>,
    /// Effect of pose on the taxels, if the model has it: it is taken out of them before they reach the model. The
    /// joints of a region are its joints, then, also for a model without a pose input.
    pub artifact: Option<Arc<ArtifactModel>>,
    /// Joint names in the order of the region's joints, if the model has them.
    pub joints: Option<Vec<String>>,
    /// Per joint, in the order of the region's joints, if the model has it.
    pub pose_range: Option<Vec<PoseRange>>,
    /// Minimum detectable force as measured when the model was trained, if the model has it.
    pub mdf: Option<Newton>,
    /// By the name of the region, for a model of several regions: where pose acts on each in its own way. There is no `artifact` then,
    /// no `joints` and no `pose_range`. Empty for any other model.
    pub regions: BTreeMap<String, RegionTerms>,
}

impl Contract {
    /// The contract of a region: that of the model, or what a model of several regions has for this one. `None` if it has
    /// nothing for a region of this name.
    pub fn of_region(&self, name: &str) -> Option<Cow<'_, Contract>> {
        if self.regions.is_empty() {
            return Some(Cow::Borrowed(self));
        }
        let RegionTerms { joints, pose_range, artifact } = self.regions.get(name)?.clone();
        Some(Cow::Owned(Contract {
            artifact: Some(artifact),
            joints: Some(joints),
            pose_range: Some(pose_range).filter(|ranges| !ranges.is_empty()),
            regions: BTreeMap::new(),
            ..self.clone()
        }))
    }

    /// True if it takes the effect of pose out of taxels.
    pub fn has_artifact(&self) -> bool {
        self.artifact.is_some() || !self.regions.is_empty()
    }

    /// Columns of the tactile input in a frame: the taxels, and what the artifact filter knows of touch if the network gets it.
    pub fn n_columns(&self) -> usize {
        self.n_taxels + self.any_artifact().map_or(0, |artifact| artifact.n_trust_inputs())
    }

    fn any_artifact(&self) -> Option<&Arc<ArtifactModel>> {
        self.artifact.as_ref().or_else(|| self.regions.values().next().map(|region| &region.artifact))
    }

    /// Joint angles that a region needs: those of the pose input, and those that make the artifact.
    pub fn n_region_joints(&self) -> usize {
        self.any_artifact().map_or(self.n_joints, |artifact| artifact.n_joints)
    }
}

/// Windows in the model's own layout, one below the other.
#[derive(Debug, Clone, Copy)]
pub struct Windows<'a> {
    /// Number of windows `N`.
    pub n: usize,
    /// `[N, window, columns]`, row-major: baseline-subtracted taxels, and the other [columns](Contract::n_columns).
    pub tactile: &'a [f32],
    /// `[N, window, joints]`, row-major, rad; empty for a model without a pose input.
    pub pose: &'a [f32],
}

/// A sequence of frames that only grows: no frame changes or leaves its place. It equals only its clones.
#[derive(Debug, Clone, Default)]
pub struct FrameSequence(Arc<()>);

impl FrameSequence {
    /// The window that begins at a frame, counted from the first frame that the sequence ever had.
    pub fn window(&self, first_frame: usize) -> WindowId {
        WindowId { sequence: self.clone(), first_frame }
    }
}

impl PartialEq for FrameSequence {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Eq for FrameSequence {}

/// The place of a window in a sequence of frames, from which a model knows which of its frames are new.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WindowId {
    sequence: FrameSequence,
    first_frame: usize,
}

impl WindowId {
    /// True if this is `earlier`, moved on by one frame: its newest frame is new, all others are those of `earlier`.
    pub fn follows(&self, earlier: &WindowId) -> bool {
        self.sequence == earlier.sequence && self.first_frame == earlier.first_frame + 1
    }
}

/// Windows ready to be run, in the model's own layout, that have frames in common: each of those is there once.
#[derive(Debug, Clone, Copy)]
pub struct SharedWindows<'a> {
    /// `[N]`, rising: the first frame of each window.
    pub starts: &'a [usize],
    /// `[N]`: where each window belongs, or empty if that is not known. Then no window continues one of an earlier call.
    pub ids: &'a [WindowId],
    /// `[frames, columns]`, row-major: baseline-subtracted taxels, and the other [columns](Contract::n_columns).
    pub tactile: &'a [f32],
    /// `[frames, joints]`, row-major, rad; empty for a model without a pose input.
    pub pose: &'a [f32],
}

/// The forces of a batch, in the model's unit, and the touch. Buffers are reused from call to call.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Forces {
    /// `[N, axes]`, row-major, with the [axes](Contract::axes) of the model: the estimate, pose-corrected where the model
    /// knows pose.
    pub force: Vec<f32>,
    /// `[N, axes]` where the model gives its tactile branch, else empty.
    pub base: Vec<f32>,
    /// `[N]` where the model gives the probability of touch, else empty.
    pub touch: Vec<f32>,
}

impl Forces {
    /// Empties all of them.
    pub fn clear(&mut self) {
        let Forces { force, base, touch } = self;
        [force, base, touch].into_iter().for_each(Vec::clear);
    }
}

/// A model that failed to run. The text gives the model and its runtime's error.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct RegressError(pub String);

/// A force model behind any runtime.
pub trait Regressor: Debug + Send {
    /// Contract of the model.
    fn contract(&self) -> &Contract;

    /// Runs a batch and writes its forces to `out`, whatever they held before.
    ///
    /// # Errors
    /// [`RegressError`] when the runtime fails. Non-finite forces are no error here: the core flags them.
    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError>;
}
