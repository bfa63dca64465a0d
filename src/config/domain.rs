//! Converts the parameter tree to the configuration of the other modules. A [`Config`] that exists is valid.

mod check;
mod fields;
mod hand;
mod live;
mod reader;
mod region;
mod source;
mod visuals;

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

pub use live::LiveConfig;
use nalgebra::{Unit, Vector3};
use reader::Reader;
pub use visuals::{Publishing, TaxelLayout, VisualsConfig};

use super::error::ConfigError;
use super::keys::{KEYS, ParamKey};
use super::names::NodeName;
use super::param_file::{Origin, ParamTree};
use super::text::list;
use crate::fusion::{
    ContactThresholds, Following, ForceUnit, FusionConfig, Receipts, RegionConfig, RegionIdx, SetupError, Timing,
};
use crate::model::{BackendChoice, ModelSpec, TensorNames};
use crate::msg::Stage;
use crate::msg::binding::{ForceReading, JointFields, TaxelFields, Topic, TruthFields};
use crate::units::{GramForce, Newton, from_millis};

/// A model with its name. [`RegionConfig::model`](crate::fusion::RegionConfig::model) is its position among these.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelConfig {
    /// Name in the parameters.
    pub name: String,
    /// Its file and parameters.
    pub spec: ModelSpec,
}

/// A force sensor that measures the true force.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthSource {
    /// Name in the parameters.
    pub name: String,
    /// Added to every stamp of this source, ns.
    pub stamp_offset_ns: i64,
    /// True if a lower reading means more pressure.
    pub inverted: bool,
    /// Unit of its readings.
    pub unit: ForceUnit,
    /// Its axes, where it has three.
    pub axes: Option<TruthAxes>,
}

/// The axes of a force sensor that measures all three.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthAxes {
    /// Whether each axis is the other way: x, y, z of the patch.
    pub inverted: [bool; 3],
    /// The contact normal of the regions whose force it measures, in the frame of the patch.
    pub normal: Unit<Vector3<f64>>,
}

impl Default for TruthAxes {
    /// Axes as they are sent, pressed along z.
    fn default() -> Self {
        TruthAxes { inverted: [false; 3], normal: Vector3::z_axis() }
    }
}

impl TruthSource {
    /// A reading as a force: the normal force, positive under pressure; and where the reading has three axes, all of the
    /// force on the hand by the object, x y z in the frame of the patch.
    pub fn force(&self, reading: ForceReading) -> (GramForce, Option<[GramForce; 3]>) {
        let signed = |reading: f64, inverted: bool| self.in_gf(if inverted { -reading } else { reading });
        match reading {
            ForceReading::Normal(reading) => (signed(reading, self.inverted), None),
            ForceReading::Axes(reading) => {
                let TruthAxes { inverted, normal } = self.axes.unwrap_or_default();
                let force: [GramForce; 3] = std::array::from_fn(|axis| signed(reading[axis], inverted[axis]));
                (GramForce(normal.dot(&Vector3::from(force.map(|force| force.0)))), Some(force))
            }
        }
    }

    fn in_gf(&self, force: f64) -> GramForce {
        match self.unit {
            ForceUnit::GramForce => GramForce(force),
            other => other.to_newton(force).into(),
        }
    }
}

/// Parameters of a calibration in the air.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationConfig {
    /// File of the calibration, if there is one.
    pub file: Option<PathBuf>,
    /// File in which the node keeps the calibration in use, as it is followed.
    pub worn_file: Option<PathBuf>,
    /// Duration of a live calibration.
    pub duration: Duration,
    /// After a live calibration: how long to look for touches of the force sensors. Zero: not at all.
    pub touch_duration: Duration,
    /// Shortest unloaded data that is enough; at most `duration`.
    pub min_duration: Duration,
    /// An estimate above this means that the hand touches something.
    pub max_force: Newton,
    /// Largest share of the data that may be under load, 0 to 1.
    pub max_loaded_fraction: f64,
    /// How far at least one joint of each region must move in a live calibration, rad. 0 allows a still hand.
    pub min_joint_span: f64,
    /// True if a zero is used although the checks refuse it.
    pub insist: bool,
}

/// Configuration from all parameters.
///
/// What belongs together by position (sources and their topics, regions and their models) can't be changed one without the
/// other.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Name of the node.
    pub node: NodeName,
    fusion: FusionConfig,
    tactile: Vec<Topic<TaxelFields>>,
    joints: Vec<Topic<JointFields>>,
    truth_sources: Vec<TruthSource>,
    truth: Vec<Topic<TruthFields>>,
    truth_of_region: Vec<Option<usize>>,
    layouts: Vec<TaxelLayout>,
    models: Vec<ModelConfig>,
    /// Parameters of calibrations.
    pub calibration: CalibrationConfig,
    /// Serial number of the glove.
    pub glove: Option<String>,
    /// The person who wears the glove.
    pub user: Option<String>,
    /// Absolute name of the topic with a recording's annotations.
    pub stage_topic: String,
    /// Annotations for the recording from outside of it. They replace those on its stage topic.
    pub told_stages: Option<Arc<[Stage]>>,
    /// True if the node uses the time of `/clock`.
    pub use_sim_time: bool,
    /// Parameters of the live node only.
    pub live: LiveConfig,
    /// Unknown keys in sections for nodes of any name. They are assumed to be for other nodes and are ignored.
    pub of_others: Vec<String>,
}

impl Config {
    /// Configuration of the fusion core.
    pub fn fusion(&self) -> &FusionConfig {
        &self.fusion
    }

    /// Topics of the tactile sources, by source index.
    pub fn tactile(&self) -> &[Topic<TaxelFields>] {
        &self.tactile
    }

    /// Topics of the joint sources, by source index.
    pub fn joints(&self) -> &[Topic<JointFields>] {
        &self.joints
    }

    /// Force sensors that measure the true force.
    pub fn truth_sources(&self) -> &[TruthSource] {
        &self.truth_sources
    }

    /// Topics of the force sensors, by source index.
    pub fn truth(&self) -> &[Topic<TruthFields>] {
        &self.truth
    }

    /// `[regions]`: index of the force sensor that measures the region's true force, if there is one.
    pub fn truth_of_region(&self) -> &[Option<usize>] {
        &self.truth_of_region
    }

    /// `[regions]`: where the taxels of each region are, for pictures.
    pub fn layouts(&self) -> &[TaxelLayout] {
        &self.layouts
    }

    /// Models that regions use, in the order in which regions first name them.
    pub fn models(&self) -> &[ModelConfig] {
        &self.models
    }

    /// The same models, to change how they are run.
    pub fn models_mut(&mut self) -> &mut [ModelConfig] {
        &mut self.models
    }

    /// The same with a single region; `None` if it doesn't have that region. Sources and models stay, also those that no
    /// region uses any more.
    pub fn only(self, region: RegionIdx) -> Option<Self> {
        self.only_these(&[region])
    }

    /// The same with these regions, in this order; `None` if it doesn't have one of them, or none is given.
    pub fn only_these(self, regions: &[RegionIdx]) -> Option<Self> {
        let at = || regions.iter().map(|region| region.position());
        let truth_of_region = at().map(|region| self.truth_of_region.get(region).copied()).collect::<Option<_>>()?;
        let layouts = at().map(|region| self.layouts.get(region).cloned()).collect::<Option<_>>()?;
        let fusion = self.fusion.only_these(regions)?;
        Some(Config { fusion, truth_of_region, layouts, ..self })
    }

    /// The same without joint angles.
    pub fn without_pose(self) -> Self {
        Config { fusion: self.fusion.without_pose(), joints: Vec::new(), ..self }
    }

    /// Replaces the joints of the regions for which `joints` has others.
    pub fn take_joints(&mut self, joints: impl Fn(&RegionConfig) -> Option<Vec<String>>) {
        self.fusion = self.fusion.clone().with_joints_of(joints);
    }

    /// Sets the contact thresholds.
    ///
    /// # Shapes
    /// `thresholds`: `[regions]`.
    ///
    /// # Errors
    /// [`SetupError`] when they are not one for each region, or don't fit together. Then nothing changes.
    pub fn set_thresholds(&mut self, thresholds: &[ContactThresholds]) -> Result<(), SetupError> {
        self.fusion = self.fusion.clone().with_thresholds(thresholds)?;
        Ok(())
    }

    /// Sets the number of frames in one inference call.
    pub fn set_batch(&mut self, batch: NonZeroUsize) {
        self.fusion = self.fusion.clone().with_batch(batch);
    }

    /// Sets what the receipt times of events mean.
    pub fn set_receipts(&mut self, receipts: Receipts) {
        self.fusion = self.fusion.clone().with_receipts(receipts);
    }

    /// Sets what becomes of artifacts after the calibration.
    pub fn set_following(&mut self, following: Following) {
        self.fusion = self.fusion.clone().with_following(following);
    }

    /// Sets whether the tick of a frame has its taxels.
    pub fn set_kept_taxels(&mut self, keeps_taxels: bool) {
        self.fusion = self.fusion.clone().with_kept_taxels(keeps_taxels);
    }

    /// Names of the joints that regions need.
    pub fn needed_joints(&self) -> BTreeSet<String> {
        self.fusion.regions().iter().flat_map(|region| region.joints.iter().cloned()).collect()
    }

    /// Reads the parameters of a node.
    ///
    /// # Errors
    /// [`ConfigError`] for the first parameter that is unknown, missing, of the wrong type, out of range, or in
    /// conflict with another one.
    pub fn from_tree(tree: &ParamTree) -> Result<Self, ConfigError> {
        let node = NodeName::parse(tree.node_fqn())?;
        let of_others = check::keys_and_values(tree)?;
        let reader = Reader { tree, node: &node };
        let tactile_names = reader.names("tactile_sources")?;
        reader.refuse_empty("tactile_sources", &tactile_names)?;
        let joint_names = reader.names("joint_sources")?;
        let truth_names = reader.names("truth_sources")?;
        let region_names = reader.names("regions")?;
        reader.refuse_empty("regions", &region_names)?;
        let models = region::model_names(&reader, &region_names)?;
        check::names(
            tree,
            &of_others,
            &[
                ("tactile", "tactile_sources", &tactile_names),
                ("joint", "joint_sources", &joint_names),
                ("truth", "truth_sources", &truth_names),
                ("region", "regions", &region_names),
                ("model", "the models that regions use", &models),
            ],
        )?;

        let (tactile_sources, tactile) = source::all(&reader, &tactile_names, source::tactile)?;
        let (joint_sources, joints) = source::all(&reader, &joint_names, source::joint)?;
        let (mut truth_sources, truth) = source::all(&reader, &truth_names, source::truth)?;
        source::one_type_a_topic(
            &reader,
            &[
                source::types("tactile", &tactile_names, &tactile),
                source::types("joint", &joint_names, &joints),
                source::types("truth", &truth_names, &truth),
            ]
            .concat(),
        )?;
        let truth_of_region = region::truths(&reader, &region_names, &truth_names)?;
        let regions = region::all(&reader, &region_names, &models, &tactile_sources, &joints)?;
        region::turn_truths(&reader, &regions, &truth_of_region, &mut truth_sources)?;
        let layouts = visuals::layouts(&reader, &regions)?;
        let calibration = calibration(&reader)?;
        if truth.is_empty() && !calibration.touch_duration.is_zero() {
            let problem =
                "s needs a force sensor that is touched: set truth_sources and truth.*.topic, or leave it out";
            return Err(reader.refused("calibration.touch_s", problem));
        }
        let following = match reader.text("adaptation")?.as_str() {
            "none" => Following::Off,
            "frozen" => Following::Frozen,
            _ => Following::On,
        };
        let fusion =
            FusionConfig::new(tactile_sources, joint_sources, regions, timing(&reader)?)?.with_following(following);
        Ok(Config {
            fusion,
            tactile,
            joints,
            truth_sources,
            truth,
            truth_of_region,
            layouts,
            models: models.iter().map(|name| model(&reader, name)).collect::<Result<_, _>>()?,
            calibration,
            glove: reader.non_empty("glove")?,
            user: reader.non_empty("user")?,
            stage_topic: reader.topic("stage_topic")?,
            told_stages: None,
            use_sim_time: reader.bool("use_sim_time")?,
            live: live::live(&reader)?,
            of_others: of_others.into_iter().map(str::to_owned).collect(),
            node,
        })
    }

    /// A note on ignored keys, on one line. `None` if there are none.
    pub fn note_on_others(&self) -> Option<String> {
        let keys = list(self.of_others.iter().map(String::as_str));
        let hint = check::EXPLAINED;
        (!keys.is_empty()).then(|| format!("not followed, because this node has no such parameters: {keys}; {hint}"))
    }

    /// All parameters that this configuration has, set or not, with their entries in the table.
    pub fn keys(&self) -> BTreeMap<String, &'static ParamKey> {
        let mut keys = BTreeMap::new();
        for key in KEYS {
            let names: Vec<&str> = match key.pattern.split('.').next() {
                Some("tactile") => self.fusion.tactile_sources().iter().map(|source| source.name.as_str()).collect(),
                Some("joint") => self.fusion.joint_sources().iter().map(|source| source.name.as_str()).collect(),
                Some("truth") => self.truth_sources.iter().map(|source| source.name.as_str()).collect(),
                Some("model") => self.models.iter().map(|model| model.name.as_str()).collect(),
                Some("region") => self.fusion.regions().iter().map(|region| region.name.as_str()).collect(),
                _ => vec![""],
            };
            keys.extend(names.into_iter().map(|name| (key.with_name(name), key)));
        }
        keys
    }
}

fn timing(reader: &Reader<'_>) -> Result<Timing, ConfigError> {
    Ok(Timing {
        max_gap: from_millis(reader.double("timing.max_gap_ms")?),
        joint_slack: from_millis(reader.double("timing.joint_slack_ms")?),
        max_pose_age: match reader.is_set("timing.max_pose_age_ms") {
            true => Some(from_millis(reader.double("timing.max_pose_age_ms")?)),
            false => None,
        },
        time_jump: from_millis(reader.double("timing.time_jump_ms")?),
        max_age: Some(reader.double("timing.max_age_ms")?).filter(|max_ms| *max_ms > 0.0).map(from_millis),
    })
}

fn calibration(reader: &Reader<'_>) -> Result<CalibrationConfig, ConfigError> {
    let (duration_s, min_s) = (reader.double("calibration.duration_s")?, reader.double("calibration.min_s")?);
    if min_s > duration_s {
        let problem = format!("s must be at most calibration.duration_s = {duration_s:?} s");
        return Err(reader.refused_either("calibration.min_s", "calibration.duration_s", &problem));
    }
    let (file, worn_file) = (reader.path("calibration.file")?, reader.path_here("calibration.worn_file")?);
    if worn_file.is_some() && worn_file == file {
        let problem = "is the file of the calibration, which would be lost; choose another name";
        return Err(reader.refused("calibration.worn_file", problem));
    }
    Ok(CalibrationConfig {
        file,
        worn_file,
        duration: Duration::from_secs_f64(duration_s),
        touch_duration: Duration::from_secs_f64(reader.double("calibration.touch_s")?),
        min_duration: Duration::from_secs_f64(min_s),
        max_force: Newton(reader.double("calibration.max_force")?),
        max_loaded_fraction: reader.double("calibration.max_loaded_fraction")?,
        min_joint_span: reader.double("calibration.min_joint_span")?,
        insist: reader.bool("calibration.insist")?,
    })
}

fn model(reader: &Reader<'_>, name: &str) -> Result<ModelConfig, ConfigError> {
    let key = |tail: &str| format!("model.{name}.{tail}");
    let tensor = |tail: &str| reader.required_text(&key(tail));
    let path_key = key("path");
    reader.required_text(&path_key)?;
    let path = reader.path(&path_key)?.ok_or_else(|| reader.missing(&path_key))?;
    let backend = match reader.text(&key("backend"))?.as_str() {
        "builtin" => BackendChoice::Builtin,
        "onnxruntime" => BackendChoice::OnnxRuntime,
        "rten" => BackendChoice::Rten,
        _ => BackendChoice::Auto,
    };
    let unit = match reader.text(&key("unit"))?.as_str() {
        "gF" => Some(ForceUnit::GramForce),
        "N" => Some(ForceUnit::Newton),
        _ => None,
    };
    let rate_hz = Some(reader.double(&key("rate_hz"))?).filter(|rate_hz| *rate_hz > 0.0);
    let (glove, of_glove) = (reader.non_empty("glove")?, reader.non_empty(&key("glove"))?);
    let names = TensorNames {
        tactile: tensor("inputs.tactile")?,
        pose: tensor("inputs.pose")?,
        force: tensor("outputs.force")?,
        force_base: tensor("outputs.force_base")?,
        force_residual: tensor("outputs.force_residual")?,
        touch: tensor("outputs.touch")?,
    };
    let spec = ModelSpec { backend, unit, rate_hz, glove, of_glove, names, ..ModelSpec::new(path) };
    Ok(ModelConfig { name: name.to_owned(), spec })
}

/// Folder that a relative path refers to. `None` if the path was not set in a file.
fn folder(origin: &Origin) -> Option<PathBuf> {
    match origin {
        Origin::File { file, .. } => std::path::Path::new(file.as_ref()).parent().map(PathBuf::from),
        Origin::CommandLine | Origin::Request => None,
    }
}
