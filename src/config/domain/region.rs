//! Regions: their taxels, joints, geometry and contact thresholds.

use std::collections::BTreeSet;
use std::num::NonZeroU32;

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};

use super::super::error::ConfigError;
use super::super::scalar::ParamValue;
use super::super::text::{list, one_line};
use super::TruthSource;
use super::reader::Reader;
use crate::fusion::{
    ContactBy, ContactThresholds, ModelIdx, Patch, RegionConfig, TactileSource, TactileSourceIdx, TouchLevels,
};
use crate::msg::binding::{JointFields, NamesFrom, Topic};
use crate::units::Newton;

/// Tolerance for the norm of a rotation, because people write quaternions with 3 decimals.
const ROTATION_NORM_TOLERANCE: f64 = 1e-3;

/// The models of all regions, each once, in the order in which regions first name them.
pub(super) fn model_names(reader: &Reader<'_>, regions: &[String]) -> Result<Vec<String>, ConfigError> {
    let mut models = Vec::new();
    for region in regions {
        let model = reader.name(&format!("region.{region}.model"))?;
        if !models.contains(&model) {
            models.push(model);
        }
    }
    Ok(models)
}

/// Reads each region.
pub(super) fn all(
    reader: &Reader<'_>,
    names: &[String],
    models: &[String],
    sources: &[TactileSource],
    joints: &[Topic<JointFields>],
) -> Result<Vec<RegionConfig>, ConfigError> {
    contact(reader, None)?; // so that an invalid pair is refused even if every region overrides it
    let one = |name: &String| {
        let key = |tail: &str| format!("region.{name}.{tail}");
        let model = reader.text(&key("model"))?;
        let model_idx = models.iter().position(|known| *known == model);
        let source_idx = tactile_source(reader, &key("tactile_source"), sources)?;
        let frame_id = reader.required_text(&key("frame_id"))?;
        let patch = Patch {
            frame_id,
            normal_in_patch: normal(reader, &key("normal"))?,
            frame_from_patch: mount(reader, &key("mount.translation"), &key("mount.rotation"))?,
        };
        Ok(RegionConfig {
            name: name.clone(),
            source: TactileSourceIdx::at(source_idx),
            taxels: taxels(reader, &key("taxels"), &sources[source_idx])?,
            joints: region_joints(reader, &key("joints"), joints)?,
            model_joints: model_joints(reader, &key("model_joints"), &key("joints"))?,
            model: model_idx.map(ModelIdx::at).ok_or_else(|| reader.missing(&key("model")))?,
            patch,
            contact: contact(reader, Some(name))?,
        })
    };
    names.iter().map(one).collect()
}

/// Index of the force sensor for the true force of each region. `None` if no sensor is named and there isn't exactly
/// one.
pub(super) fn truths(
    reader: &Reader<'_>,
    regions: &[String],
    sources: &[String],
) -> Result<Vec<Option<usize>>, ConfigError> {
    let one = |region: &String| {
        let key = format!("region.{region}.truth");
        if !reader.is_set(&key) {
            return Ok((sources.len() == 1).then_some(0));
        }
        let name = reader.text(&key)?;
        let found = sources.iter().position(|source| *source == name);
        let known = || list(sources.iter().map(String::as_str));
        found.map(Some).ok_or_else(|| reader.refused(&key, format!("is not among truth_sources = [{}]", known())))
    };
    regions.iter().map(one).collect()
}

/// Tells each force sensor of three axes which of the force is the normal force: the contact normal of its regions.
pub(super) fn turn_truths(
    reader: &Reader<'_>,
    regions: &[RegionConfig],
    truth_of_region: &[Option<usize>],
    sources: &mut [TruthSource],
) -> Result<(), ConfigError> {
    for (idx, source) in sources.iter_mut().enumerate() {
        let TruthSource { name, axes: Some(axes), .. } = source else { continue };
        let mut of_it = regions.iter().zip(truth_of_region).filter(|(_, truth)| **truth == Some(idx));
        let Some((first, _)) = of_it.next() else { continue };
        axes.normal = first.patch.normal_in_patch;
        if let Some((other, _)) = of_it.find(|(region, _)| region.patch.normal_in_patch != axes.normal) {
            let (key, first_key) = (format!("region.{}.normal", other.name), format!("region.{}.normal", first.name));
            let problem = format!(
                "must be that of {first_key}: both are measured by the axes truth.{name}.fields; name a source for each"
            );
            return Err(reader.refused_either(&key, &first_key, &problem));
        }
    }
    Ok(())
}

fn tactile_source(reader: &Reader<'_>, key: &str, sources: &[TactileSource]) -> Result<usize, ConfigError> {
    let known = || list(sources.iter().map(|source| source.name.as_str()));
    if !reader.is_set(key) {
        return match sources {
            [_] => Ok(0),
            _ => Err(reader.missing_because(key, &format!("there are several tactile sources: {}", known()))),
        };
    }
    let name = reader.text(key)?;
    let found = sources.iter().position(|source| source.name == name);
    found.ok_or_else(|| reader.refused(key, format!("is not among tactile_sources = [{}]", known())))
}

fn taxels(reader: &Reader<'_>, key: &str, source: &TactileSource) -> Result<Vec<usize>, ConfigError> {
    let indices = match reader.value(key) {
        Some(ParamValue::IntArray(indices)) => indices,
        _ => return Ok((0..source.n_taxels).collect()),
    };
    let mut seen = BTreeSet::new();
    let mut taxels = Vec::with_capacity(indices.len());
    for index in indices {
        let taxel_idx = usize::try_from(index).ok().filter(|taxel_idx| *taxel_idx < source.n_taxels);
        let Some(taxel_idx) = taxel_idx else {
            let (name, last) = (&source.name, source.n_taxels - 1);
            let problem = format!("has {index}, but taxels of the source {name} are 0 to {last}");
            return Err(reader.refused(key, problem));
        };
        if !seen.insert(taxel_idx) {
            return Err(reader.refused(key, format!("has {index} twice")));
        }
        taxels.push(taxel_idx);
    }
    Ok(taxels)
}

fn region_joints(reader: &Reader<'_>, key: &str, topics: &[Topic<JointFields>]) -> Result<Vec<String>, ConfigError> {
    let joints = reader.unique_texts(key)?;
    if !joints.is_empty() && topics.is_empty() {
        return Err(reader.refused(key, "needs a source of joint angles, but joint_sources is empty"));
    }
    // Names can be checked only if the parameters name the joints of all sources.
    let mut known = Vec::new();
    for topic in topics {
        match &topic.fields.names {
            NamesFrom::Constant(names) => known.extend(names.iter().map(String::as_str)),
            NamesFrom::Hand(hand) => known.extend(hand.joints.iter().map(String::as_str)),
            NamesFrom::Field(_) => return Ok(joints),
        }
    }
    match joints.iter().find(|joint| !known.contains(&joint.as_str())) {
        Some(joint) => {
            let problem = format!("has \"{}\", but the joint sources send {}", one_line(joint), list(known));
            Err(reader.refused(key, problem))
        }
        None => Ok(joints),
    }
}

fn normal(reader: &Reader<'_>, key: &str) -> Result<Unit<Vector3<f64>>, ConfigError> {
    let normal = Vector3::from(reader.doubles::<3>(key)?);
    // Scaled first, so that the squared length neither vanishes nor overflows.
    let largest = normal.amax();
    let scaled = if largest > 0.0 { normal / largest } else { normal };
    Unit::try_new(scaled, 0.5).ok_or_else(|| reader.refused(key, "must not be zero: it is a direction"))
}

fn mount(reader: &Reader<'_>, translation: &str, rotation: &str) -> Result<Isometry3<f64>, ConfigError> {
    let [x, y, z, w] = reader.doubles::<4>(rotation)?;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    if !norm.is_finite() || (norm - 1.0).abs() > ROTATION_NORM_TOLERANCE {
        let problem =
            format!("has the norm {norm}: it must be a unit quaternion x, y, z, w, within {ROTATION_NORM_TOLERANCE}");
        return Err(reader.refused(rotation, problem));
    }
    let translation = Translation3::from(Vector3::from(reader.doubles::<3>(translation)?));
    Ok(Isometry3::from_parts(translation, UnitQuaternion::new_normalize(quaternion)))
}

/// The model's names for the joints of a region. Empty if they are the same.
fn model_joints(reader: &Reader<'_>, key: &str, joints_key: &str) -> Result<Vec<String>, ConfigError> {
    let names = |key: &str| match reader.value(key) {
        Some(ParamValue::StrArray(names)) => names,
        _ => Vec::new(),
    };
    let (known, own) = (names(key), names(joints_key));
    if !known.is_empty() && known.len() != own.len() {
        let problem = format!("names {} joints and {joints_key} {}; name one for each", known.len(), own.len());
        return Err(reader.refused(key, problem));
    }
    Ok(known)
}

/// The thresholds of a region, or the thresholds for all regions.
fn contact(reader: &Reader<'_>, region: Option<&str>) -> Result<ContactThresholds, ConfigError> {
    let key = |tail: &str| match region {
        Some(region) if reader.is_set(&format!("region.{region}.contact.{tail}")) => {
            format!("region.{region}.contact.{tail}")
        }
        _ => format!("contact.{tail}"),
    };
    let (on_key, off_key) = (key("force_on"), key("force_off"));
    let (force_on, force_off) = (reader.double(&on_key)?, reader.double(&off_key)?);
    if force_off >= force_on {
        let problem = format!("N must be below {on_key} = {force_on} N");
        return Err(reader.refused_either(&off_key, &on_key, &problem));
    }
    let by = match reader.text(&key("by"))?.as_str() {
        "force" => ContactBy::Force,
        _ => ContactBy::Model,
    };
    let (touch_on_key, touch_off_key) = (key("touch_on"), key("touch_off"));
    let touch = match (reader.is_set(&touch_on_key), reader.is_set(&touch_off_key)) {
        (false, false) => None,
        (false, true) => {
            let problem = format!("is set without {touch_on_key}; set both, or neither for the model's own");
            return Err(reader.refused(&touch_off_key, problem));
        }
        (true, is_off_set) => {
            let on = reader.double(&touch_on_key)?;
            let usual = TouchLevels::from_on(on);
            let off = if is_off_set { reader.double(&touch_off_key)? } else { usual.off };
            if off >= on {
                return Err(reader.refused(&touch_off_key, format!("must be below {touch_on_key} = {on}")));
            }
            Some(TouchLevels { on, off })
        }
    };
    let frames = |key: &str| -> Result<NonZeroU32, ConfigError> {
        let frames = u32::try_from(reader.int(key)?).ok().and_then(NonZeroU32::new);
        frames.ok_or_else(|| reader.refused(key, "must be at least 1"))
    };
    Ok(ContactThresholds {
        by,
        touch,
        touch_evidence: reader.double(&key("touch_evidence"))?,
        force_on: Newton(force_on),
        force_off: Newton(force_off),
        on_frames: frames(&key("on_frames"))?,
        off_frames: frames(&key("off_frames"))?,
    })
}
