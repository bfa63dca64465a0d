//! Derives the tensor contract from a file's graph, its metadata and the parameters, or the first reason why there is
//! none.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::Arc;

use super::error::{ModelError, one_line};
use super::info::{Batch, Dim, Origin, TensorInfo, unit_name};
use super::metadata::Metadata;
use super::onnx::GraphProto;
use super::{ModelSpec, TensorNames};
use crate::fusion::{Contract, ForceAxes, ForceUnit, TouchLevels, TouchOutput};

/// Model frames per second if neither the model nor the parameters give it: the paper's rate.
const DEFAULT_RATE_HZ: f64 = 100.0;

/// Maximum size of an input window, in numbers. The paper's is 64 x 20. It limits the memory of a trial run.
const MAX_WINDOW_NUMBERS: usize = 1 << 22;

/// A contract, and what a runtime needs to follow it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Terms {
    pub(super) contract: Contract,
    pub(super) unit_from: Origin,
    pub(super) rate_from: Origin,
    pub(super) batch: Batch,
    pub(super) tensors: Tensors,
    pub(super) inputs: Vec<TensorInfo>,
    pub(super) outputs: Vec<TensorInfo>,
    pub(super) notes: Vec<String>,
}

/// Names in the file of the contract's tensors that exist.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Tensors {
    pub(super) tactile: String,
    pub(super) pose: Option<String>,
    pub(super) force: String,
    pub(super) touch: Option<String>,
    pub(super) base: Option<String>,
    pub(super) residual: Option<String>,
}

impl Tensors {
    /// Names of the outputs that exist, in the order force, touch, base, residual.
    pub(super) fn outputs(&self) -> Vec<String> {
        let all = [Some(&self.force), self.touch.as_ref(), self.base.as_ref(), self.residual.as_ref()];
        all.into_iter().flatten().cloned().collect()
    }

    /// Index of the touch among the outputs.
    pub(super) fn touch_idx(&self) -> Option<usize> {
        self.touch.as_ref().map(|_| 1)
    }

    /// Index of the base among the outputs.
    pub(super) fn base_idx(&self) -> Option<usize> {
        self.base.as_ref().map(|_| 1 + usize::from(self.touch.is_some()))
    }
}

/// Maximum number of frames in a window: almost three minutes at 100 Hz.
const MAX_WINDOW_FRAMES: usize = 1 << 14;

/// Derives the contract of a graph.
pub(super) fn settle(graph: &GraphProto, metadata: &Metadata, spec: &ModelSpec) -> Result<Terms, ModelError> {
    let path = spec.path.as_path();
    let weights: BTreeSet<&str> = graph.initializer.iter().map(|tensor| tensor.name.as_str()).collect();
    let inputs: Vec<TensorInfo> =
        graph.input.iter().filter(|input| !weights.contains(input.name.as_str())).map(TensorInfo::read).collect();
    let outputs: Vec<TensorInfo> = graph.output.iter().map(TensorInfo::read).collect();

    let tensors = find_tensors(path, &spec.names, &inputs, &outputs)?;
    let named = |list: &[TensorInfo], name: &str| list.iter().find(|tensor| tensor.name == name).cloned();
    let n_trust_inputs = trust_inputs(path, metadata)?;
    let mut batch = Batch::Dynamic;
    let mut window_from_shape = None;
    let mut n_taxels = None;
    let mut n_joints = None;
    if let Some(tactile) = named(&inputs, &tensors.tactile) {
        let [frames, width] = input_shape(path, &tactile, "[N, window, taxels]", &mut batch)?;
        window_from_shape = agree(path, &tactile, "window", frames, metadata.window)?;
        let width = width.map(|width| without_trust(path, &tactile, width, n_trust_inputs)).transpose()?;
        n_taxels = agree(path, &tactile, "taxels", width, metadata.n_taxels)?;
    }
    if let Some(pose) = tensors.pose.as_ref().and_then(|name| named(&inputs, name)) {
        let [frames, width] = input_shape(path, &pose, "[N, window, joints]", &mut batch)?;
        if let (Some(frames), Some(window)) = (frames, window_from_shape)
            && frames != window
        {
            return Err(ModelError::Conflict {
                path: path.to_path_buf(),
                first: format!("input {} is {}", pose.name, pose.shape_text()),
                second: format!("the window of input {} has {window} frames", tensors.tactile),
                remedy: "both inputs take the same frames".into(),
            });
        }
        n_joints = agree(path, &pose, "joints", width, metadata.joints.as_ref().map(Vec::len))?;
    }
    let known = |size: Option<usize>, name: &str, axis: &str, key: &str| {
        size.ok_or_else(|| ModelError::Shape {
            path: path.to_path_buf(),
            kind: "input",
            name: one_line(name),
            got: named(&inputs, name).map_or_else(String::new, |tensor| tensor.shape_text()),
            expected: format!("a fixed number of {axis}; export it fixed, or say it in metadata {key}"),
        })
    };
    let window = known(window_from_shape, &tensors.tactile, "frames", "window")?;
    let n_taxels = known(n_taxels, &tensors.tactile, "taxels", "taxels")?;
    let n_joints = match &tensors.pose {
        Some(pose) => known(n_joints, pose, "joints", "joints")?,
        None => 0,
    };
    let window = checked_window(path, &tensors, window, n_taxels.saturating_add(n_trust_inputs).max(n_joints))?;
    check_artifact(path, metadata, n_taxels)?;
    check_regions(path, metadata, &tensors, n_taxels)?;
    check_joints(path, metadata, &tensors, n_joints)?;
    check_outputs(path, &spec.names)?;
    let axes = named(&outputs, &tensors.force).map_or(ForceAxes::Normal, |force| axes_of(&force));
    for (name, output) in tensors.outputs().iter().filter_map(|name| Some((name, named(&outputs, name)?))) {
        let expected = if tensors.touch.as_ref() == Some(name) {
            Expected::Probability
        } else if *name == tensors.force {
            Expected::Force
        } else {
            Expected::PartOf(axes)
        };
        check_output(path, name, &output, expected)?;
    }

    let (unit, unit_from) = settle_unit(path, metadata, spec)?;
    let (rate_hz, rate_from) = settle_rate(path, metadata, spec)?;
    let mut notes = Vec::new();
    notes.extend(check_glove(path, metadata, spec)?);
    if unit_from == Origin::Default {
        notes.push("neither the model nor the parameters tell the unit of its forces: gF is assumed".to_string());
    }
    if rate_from == Origin::Default {
        notes.push("neither the model nor the parameters tell its frame rate: 100 Hz is assumed".to_string());
    }
    if tensors.touch.is_some() && metadata.touch.is_none() {
        let TouchLevels { on, off } = TouchOutput::default().levels;
        notes.push(format!(
            "it doesn't tell from which probability of its touch output there is contact: {on} is assumed, and {off} for its end"
        ));
    }
    if batch == Batch::One {
        notes.push("its batch is fixed at 1: windows are run one by one, and large batches are no faster".to_string());
    }
    let contract = Contract {
        window,
        n_taxels,
        n_joints,
        rate_hz,
        unit,
        axes,
        has_base: tensors.base.is_some(),
        touch: tensors.touch.as_ref().map(|_| metadata.touch.unwrap_or_default()),
        artifact: metadata.artifact.clone().map(Arc::new),
        regions: metadata.regions.clone(),
        joints: metadata.joints.clone(),
        pose_range: metadata.pose_range.clone(),
        mdf: metadata.mdf,
    };
    Ok(Terms { contract, unit_from, rate_from, batch, tensors, inputs, outputs, notes })
}

fn find_tensors(
    path: &Path,
    names: &TensorNames,
    inputs: &[TensorInfo],
    outputs: &[TensorInfo],
) -> Result<Tensors, ModelError> {
    let has = |list: &[TensorInfo], name: &str| list.iter().any(|tensor| tensor.name == name);
    let missing = |kind, name: &str, list: &[TensorInfo], parameter| {
        let present: Vec<String> = list.iter().map(ToString::to_string).collect();
        let present = if present.is_empty() { format!("no {kind}s") } else { present.join(", ") };
        let (name, present) = (one_line(name), one_line(&present));
        Err(ModelError::MissingTensor { path: path.to_path_buf(), kind, name, present, parameter })
    };
    if !has(inputs, &names.tactile) {
        return missing("input", &names.tactile, inputs, "inputs.tactile");
    }
    if !has(outputs, &names.force) {
        return missing("output", &names.force, outputs, "outputs.force");
    }
    if names.tactile == names.pose {
        return Err(ModelError::Conflict {
            path: path.to_path_buf(),
            first: format!("parameter model.NAME.inputs.tactile is {}", one_line(&names.tactile)),
            second: "model.NAME.inputs.pose is the same input".into(),
            remedy: "name two inputs, or leave out the pose of a model that has none".into(),
        });
    }
    if let Some(unknown) = inputs.iter().find(|input| input.name != names.tactile && input.name != names.pose) {
        return Err(ModelError::UnknownInput { path: path.to_path_buf(), input: one_line(&unknown.to_string()) });
    }
    let optional = |list: &[TensorInfo], name: &String| has(list, name).then(|| name.clone());
    Ok(Tensors {
        tactile: names.tactile.clone(),
        pose: optional(inputs, &names.pose),
        force: names.force.clone(),
        base: optional(outputs, &names.force_base),
        residual: optional(outputs, &names.force_residual),
        touch: optional(outputs, &names.touch),
    })
}

/// Frames and width of an input of rank 3. `None` for a dynamic size.
fn input_shape(
    path: &Path,
    tensor: &TensorInfo,
    expected: &str,
    batch: &mut Batch,
) -> Result<[Option<usize>; 2], ModelError> {
    check_float32(path, "input", tensor)?;
    let refuse = || ModelError::Shape {
        path: path.to_path_buf(),
        kind: "input",
        name: one_line(&tensor.name),
        got: one_line(&tensor.shape_text()),
        expected: expected.to_string(),
    };
    let Some([n, frames, width]) = tensor.shape.as_deref() else { return Err(refuse()) };
    match n {
        Dim::Dynamic(_) => {}
        Dim::Fixed(1) => *batch = Batch::One,
        Dim::Fixed(fixed) => {
            return Err(ModelError::FixedBatch {
                path: path.to_path_buf(),
                name: one_line(&tensor.name),
                got: one_line(&tensor.shape_text()),
                batch: *fixed,
            });
        }
    }
    let size = |dim: &Dim| match dim {
        Dim::Fixed(0) => Err(refuse()),
        Dim::Fixed(size) => usize::try_from(*size).map(Some).map_err(|_| refuse()),
        Dim::Dynamic(_) => Ok(None),
    };
    Ok([size(frames)?, size(width)?])
}

/// A size, from the shape and the metadata, which must agree.
fn agree(
    path: &Path,
    tensor: &TensorInfo,
    key: &str,
    shape: Option<usize>,
    metadata: Option<usize>,
) -> Result<Option<usize>, ModelError> {
    match (shape, metadata) {
        (Some(shape), Some(metadata)) if shape != metadata => Err(ModelError::Conflict {
            path: path.to_path_buf(),
            first: match key {
                "joints" => format!("metadata joints names {metadata} joints"),
                _ => format!("metadata {key} is {metadata}"),
            },
            second: format!("input {} is {}", one_line(&tensor.name), one_line(&tensor.shape_text())),
            remedy: "export it with metadata of its own".into(),
        }),
        (shape, metadata) => Ok(shape.or(metadata)),
    }
}

/// Columns of trust after the taxels, by the metadata.
fn trust_inputs(path: &Path, metadata: &Metadata) -> Result<usize, ModelError> {
    let of_regions = metadata.regions.iter().map(|(name, terms)| (name.as_str(), &*terms.artifact));
    let mut artifacts = metadata.artifact.iter().map(|artifact| ("", artifact)).chain(of_regions);
    let Some((first, artifact)) = artifacts.next() else { return Ok(0) };
    let n = artifact.n_trust_inputs();
    match artifacts.find(|(_, other)| other.n_trust_inputs() != n) {
        None => Ok(n),
        Some((other, _)) => Err(ModelError::Conflict {
            path: path.to_path_buf(),
            first: format!("metadata regions has {n} columns of trust for {}", one_line(first)),
            second: format!("another number for {}", one_line(other)),
            remedy: "all regions get the same columns: give trust_inputs to all or to none".into(),
        }),
    }
}

/// Taxels of an input of so many columns, the last of which are of trust.
fn without_trust(path: &Path, tactile: &TensorInfo, width: usize, n_trust_inputs: usize) -> Result<usize, ModelError> {
    width.checked_sub(n_trust_inputs).filter(|n_taxels| n_trust_inputs == 0 || *n_taxels > 0).ok_or_else(|| {
        ModelError::Conflict {
            path: path.to_path_buf(),
            first: format!("metadata artifact has trust_inputs, which are {n_trust_inputs} columns after the taxels"),
            second: format!("input {} is {}", one_line(&tactile.name), one_line(&tactile.shape_text())),
            remedy: "export it with metadata of its own".into(),
        }
    })
}

/// A number of frames in a window, within the limits.
fn checked_window(path: &Path, tensors: &Tensors, window: usize, width: usize) -> Result<NonZeroUsize, ModelError> {
    let refuse = |got: String, expected: String| {
        let (path, name) = (path.to_path_buf(), one_line(&tensors.tactile));
        Err(ModelError::Shape { path, kind: "input", name, got, expected })
    };
    if window > MAX_WINDOW_FRAMES {
        return refuse(format!("{window} frames"), format!("at most {MAX_WINDOW_FRAMES} frames in a window"));
    }
    match (NonZeroUsize::new(window), window.checked_mul(width)) {
        (Some(window), Some(numbers)) if numbers <= MAX_WINDOW_NUMBERS => Ok(window),
        (None, _) => refuse("0 frames".to_owned(), "at least 1 frame in a window".to_owned()),
        _ => refuse(format!("{window} frames of {width}"), format!("at most {MAX_WINDOW_NUMBERS} numbers in a window")),
    }
}

/// The artifact model must have the model's number of taxels, and joints that the model names.
fn check_artifact(path: &Path, metadata: &Metadata, n_taxels: usize) -> Result<(), ModelError> {
    let Some(artifact) = &metadata.artifact else { return Ok(()) };
    let conflict = |first: String, second: String| {
        let (path, remedy) = (path.to_path_buf(), "export it with metadata of its own".into());
        Err(ModelError::Conflict { path, first, second, remedy })
    };
    if artifact.n_taxels != n_taxels {
        let first = format!("metadata artifact is of {} taxels", artifact.n_taxels);
        return conflict(first, format!("the model takes {n_taxels}"));
    }
    match &metadata.joints {
        Some(joints) if joints.len() == artifact.n_joints => Ok(()),
        joints => conflict(
            format!("metadata artifact is of {} joints", artifact.n_joints),
            format!("metadata joints names {}", joints.as_ref().map_or(0, Vec::len)),
        ),
    }
}

/// A model of several regions has what differs between them in metadata `regions` alone, and takes no angles itself.
fn check_regions(path: &Path, metadata: &Metadata, tensors: &Tensors, n_taxels: usize) -> Result<(), ModelError> {
    if metadata.regions.is_empty() {
        return Ok(());
    }
    let conflict = |first: String, second: &str| {
        let (path, remedy) = (path.to_path_buf(), "export it with metadata of its own".into());
        Err(ModelError::Conflict { path, first, second: second.to_owned(), remedy })
    };
    if let Some((name, terms)) = metadata.regions.iter().find(|(_, terms)| terms.artifact.n_taxels != n_taxels) {
        let first = format!("metadata regions is of {} taxels for {}", terms.artifact.n_taxels, one_line(name));
        return conflict(first, &format!("the model takes {n_taxels}"));
    }
    let also = [
        ("artifact", metadata.artifact.is_some()),
        ("joints", metadata.joints.is_some()),
        ("pose_range", metadata.pose_range.is_some()),
    ];
    if let Some((key, _)) = also.into_iter().find(|(_, is_there)| *is_there) {
        return conflict(format!("metadata has {key}"), "metadata regions has it for each region");
    }
    match &tensors.pose {
        Some(pose) => conflict(
            format!("the model has the pose input {}", one_line(pose)),
            "metadata regions is for models that take no angles themselves",
        ),
        None => Ok(()),
    }
}

fn check_joints(path: &Path, metadata: &Metadata, tensors: &Tensors, n_joints: usize) -> Result<(), ModelError> {
    let n_joints = match &metadata.artifact {
        Some(artifact) if tensors.pose.is_none() => artifact.n_joints,
        _ => n_joints,
    };
    let counted = [
        ("joints names", metadata.joints.as_ref().map(Vec::len)),
        ("pose_range holds", metadata.pose_range.as_ref().map(Vec::len)),
    ];
    for (key, count) in counted {
        if let Some(count) = count.filter(|count| *count != n_joints) {
            return Err(ModelError::Conflict {
                path: path.to_path_buf(),
                first: format!("metadata {key} {count} joints"),
                second: match &tensors.pose {
                    Some(pose) => format!("input {} takes {n_joints}", one_line(pose)),
                    None => "the model has no pose input".to_string(),
                },
                remedy: "export it with metadata of its own".into(),
            });
        }
    }
    Ok(())
}

/// All outputs must have different names: the touch of a model is not a force.
fn check_outputs(path: &Path, names: &TensorNames) -> Result<(), ModelError> {
    let forces =
        [("force", &names.force), ("force_base", &names.force_base), ("force_residual", &names.force_residual)];
    match forces.iter().find(|(_, name)| **name == names.touch) {
        None => Ok(()),
        Some((key, name)) => Err(ModelError::Conflict {
            path: path.to_path_buf(),
            first: format!("parameter model.NAME.outputs.touch is {}", one_line(name)),
            second: format!("model.NAME.outputs.{key} is the same output"),
            remedy: "name two outputs, or leave out the touch of a model that has none".into(),
        }),
    }
}

/// The requirement on an output.
#[derive(Debug, Clone, Copy)]
enum Expected {
    Probability,
    /// The force.
    Force,
    /// The force of a branch: it has the axes of the force.
    PartOf(ForceAxes),
}

/// The axes of a force: three where the file says so.
fn axes_of(force: &TensorInfo) -> ForceAxes {
    match force.shape.as_deref() {
        Some([_, Dim::Fixed(3)]) => ForceAxes::Patch,
        _ => ForceAxes::Normal,
    }
}

/// A force is `[N]`, `[N, 1]` or `[N, 3]`; what the file leaves open is one number, and settled by the trial runs.
fn check_output(path: &Path, name: &str, tensor: &TensorInfo, expected: Expected) -> Result<(), ModelError> {
    check_float32(path, "output", tensor)?;
    let n = match expected {
        Expected::Probability => 1,
        Expected::Force => axes_of(tensor).n(),
        Expected::PartOf(axes) => axes.n(),
    };
    let fits = match tensor.shape.as_deref() {
        None => true,
        Some([Dim::Dynamic(_) | Dim::Fixed(1)]) => n == 1,
        Some([Dim::Dynamic(_) | Dim::Fixed(1), Dim::Fixed(second)]) => *second == n as u64,
        Some([Dim::Dynamic(_) | Dim::Fixed(1), Dim::Dynamic(_)]) => true,
        Some(_) => false,
    };
    if fits {
        return Ok(());
    }
    let expected = match expected {
        Expected::Probability => "[N] or [N, 1], one probability a window",
        Expected::Force => "[N] or [N, 1], one force a window, or [N, 3], its x, y and z in the frame of the patch",
        Expected::PartOf(ForceAxes::Normal) => "[N] or [N, 1], one force a window, as the force of the model",
        Expected::PartOf(ForceAxes::Patch) => "[N, 3], as the force of the model",
    };
    Err(ModelError::Shape {
        path: path.to_path_buf(),
        kind: "output",
        name: one_line(name),
        got: one_line(&tensor.shape_text()),
        expected: expected.to_owned(),
    })
}

fn check_float32(path: &Path, kind: &'static str, tensor: &TensorInfo) -> Result<(), ModelError> {
    if tensor.dtype == "float32" {
        return Ok(());
    }
    let name = one_line(&tensor.name);
    Err(ModelError::ElementType { path: path.to_path_buf(), kind, name, got: tensor.dtype.clone() })
}

fn settle_unit(path: &Path, metadata: &Metadata, spec: &ModelSpec) -> Result<(ForceUnit, Origin), ModelError> {
    match (metadata.unit, spec.unit) {
        (Some(model), Some(parameter)) if model != parameter => Err(ModelError::Conflict {
            path: path.to_path_buf(),
            first: format!("metadata unit is {}", unit_name(model)),
            second: format!("the parameters say {}", unit_name(parameter)),
            remedy: "remove model.NAME.unit from the parameters, or load the model that it was written for".into(),
        }),
        (Some(unit), _) => Ok((unit, Origin::Metadata)),
        (None, Some(unit)) => Ok((unit, Origin::Parameters)),
        (None, None) => Ok((ForceUnit::GramForce, Origin::Default)),
    }
}

/// Refuses the model of another glove, if both sides name their glove. Returns a note if such a model is used on
/// purpose.
fn check_glove(path: &Path, metadata: &Metadata, spec: &ModelSpec) -> Result<Option<String>, ModelError> {
    let trained = metadata.entries.get("glove").map(|glove| glove.trim()).filter(|glove| !glove.is_empty());
    let (Some(trained), Some(wanted)) = (trained, spec.of_glove.as_ref().or(spec.glove.as_ref())) else {
        return Ok(None);
    };
    if trained != wanted.trim() {
        let (path, trained, wanted) = (path.to_path_buf(), one_line(trained), one_line(wanted));
        let key = if spec.of_glove.is_some() { "model.NAME.glove" } else { "glove" };
        return Err(ModelError::OtherGlove { path, trained, key, wanted });
    }
    let worn = spec.glove.as_deref().filter(|worn| worn.trim() != trained);
    Ok(worn.map(|worn| {
        let (trained, worn) = (one_line(trained), one_line(worn));
        format!("it was trained on glove {trained} and is used on glove {worn}, as model.NAME.glove says")
    }))
}

fn settle_rate(path: &Path, metadata: &Metadata, spec: &ModelSpec) -> Result<(f64, Origin), ModelError> {
    match (metadata.rate_hz, spec.rate_hz) {
        (Some(model), Some(parameter)) if model != parameter => Err(ModelError::Conflict {
            path: path.to_path_buf(),
            first: format!("metadata rate_hz is {model}"),
            second: format!("the parameters say {parameter}"),
            remedy: "remove model.NAME.rate_hz from the parameters, or load the model that it was written for".into(),
        }),
        (Some(rate), _) => Ok((rate, Origin::Metadata)),
        (None, Some(rate)) => Ok((rate, Origin::Parameters)),
        (None, None) => Ok((DEFAULT_RATE_HZ, Origin::Default)),
    }
}
