//! Metadata of a model file, from `metadata_props`. Every key is optional, and is checked if it is present.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::error::{ModelError, one_line};
use super::onnx::StringStringEntryProto;
use crate::fusion::{ArtifactModel, ForceUnit, PoseRange, RegionTerms, TouchLevels, TouchOutput};
use crate::units::{GramForce, Newton};

/// Version of the tensor contract that this build supports, as in `tpf.contract`.
pub const CONTRACT_VERSION: &str = "1";

/// Key for the sessions that were left out of the training of this model, when several models are scored on the
/// sessions that each has not seen. A JSON array of strings.
pub const HELD_OUT: &str = "held_out";

/// Highest accepted rate, as for the parameters. It is limited because gaps between samples are filled frame by frame.
const MAX_RATE_HZ: f64 = 10_000.0;

/// Parsed metadata of a model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Metadata {
    /// `unit`: unit of all force outputs.
    pub unit: Option<ForceUnit>,
    /// `rate_hz`: model frames per second.
    pub rate_hz: Option<f64>,
    /// `window`: frames in a window.
    pub window: Option<usize>,
    /// `taxels`: taxels in a frame.
    pub n_taxels: Option<usize>,
    /// `joints`: joint names in the order of the pose input.
    pub joints: Option<Vec<String>>,
    /// `pose_range`: range of each joint in the training data.
    pub pose_range: Option<Vec<PoseRange>>,
    /// `artifact`: model of the pose artifact in the taxels.
    pub artifact: Option<ArtifactModel>,
    /// `regions`: joints, their ranges and the artifact of each region, for a model of several.
    pub regions: BTreeMap<String, RegionTerms>,
    /// `touch`: levels of the touch output at which contact begins and ends.
    pub touch: Option<TouchOutput>,
    /// `metrics.mdf_gf`: minimum detectable force, measured after training.
    pub mdf: Option<Newton>,
    /// All entries of the file, unchanged, ours and others.
    pub entries: BTreeMap<String, String>,
}

impl Metadata {
    /// Parses the entries of a model file. Keys that are not ours are kept unchecked.
    ///
    /// # Errors
    /// [`ModelError::Metadata`] for a malformed key of ours, and for any key that occurs twice.
    pub fn parse(path: &Path, props: &[StringStringEntryProto]) -> Result<Self, ModelError> {
        let mut metadata = Metadata::default();
        for prop in props {
            let refuse = |expected: String| ModelError::Metadata {
                path: path.to_path_buf(),
                key: one_line(&prop.key),
                value: format!("\"{}\"", one_line(&prop.value)),
                expected,
            };
            metadata.read(&prop.key, &prop.value).map_err(&refuse)?;
            if metadata.entries.insert(prop.key.clone(), prop.value.clone()).is_some() {
                return Err(refuse("the key only once".to_string()));
            }
        }
        Ok(metadata)
    }

    fn read(&mut self, key: &str, value: &str) -> Result<(), String> {
        match key {
            "tpf.contract" if value != CONTRACT_VERSION => {
                return Err(format!("\"{CONTRACT_VERSION}\", the only contract that this version reads"));
            }
            "unit" => self.unit = Some(unit(value)?),
            "rate_hz" => self.rate_hz = Some(rate(value)?),
            "window" => self.window = Some(count(value)?),
            "taxels" => self.n_taxels = Some(count(value)?),
            "joints" => self.joints = Some(joint_names(value)?),
            "pose_range" => self.pose_range = Some(pose_range(value)?),
            "artifact" => self.artifact = Some(artifact(value)?),
            "regions" => self.regions = regions(value)?,
            "touch" => self.touch = Some(touch(value)?),
            "metrics" => self.mdf = mdf(value)?,
            // glove, trained_on and tool_version are free text. Keys of other tools are not ours to check.
            _ => {}
        }
        Ok(())
    }
}

fn unit(value: &str) -> Result<ForceUnit, String> {
    match value {
        "gF" => Ok(ForceUnit::GramForce),
        "N" => Ok(ForceUnit::Newton),
        _ => Err("gF or N".to_string()),
    }
}

fn rate(value: &str) -> Result<f64, String> {
    let rate = value.trim().parse::<f64>().ok().filter(|rate| *rate > 0.0 && *rate <= MAX_RATE_HZ);
    rate.ok_or_else(|| format!("a positive number of frames a second up to {MAX_RATE_HZ}, such as 100"))
}

fn count(value: &str) -> Result<usize, String> {
    let count = value.trim().parse::<usize>().ok().filter(|count| *count > 0);
    count.ok_or_else(|| "a positive whole number".to_string())
}

fn joint_names(value: &str) -> Result<Vec<String>, String> {
    let expected = || "distinct joint names, as a JSON array of texts or separated by commas".to_string();
    let names: Vec<String> = if value.trim_start().starts_with('[') {
        serde_json::from_str(value).map_err(|_| expected())?
    } else {
        value.split(',').map(|name| name.trim().to_string()).collect()
    };
    distinct_names(names).ok_or_else(expected)
}

/// Names, if there are some, none of them empty or there twice.
fn distinct_names(names: Vec<String>) -> Option<Vec<String>> {
    let distinct: BTreeSet<&String> = names.iter().collect();
    let is_sound = !names.is_empty() && distinct.len() == names.len() && !names.iter().any(String::is_empty);
    is_sound.then_some(names)
}

fn pose_range(value: &str) -> Result<Vec<PoseRange>, String> {
    let expected = || "a JSON array with [min, max] in rad for each joint, min not above max".to_string();
    let pairs: Vec<[f64; 2]> = serde_json::from_str(value).map_err(|_| expected())?;
    ranges(pairs).filter(|ranges| !ranges.is_empty()).ok_or_else(expected)
}

/// Ranges from pairs of min and max, if these are so.
fn ranges(pairs: Vec<[f64; 2]>) -> Option<Vec<PoseRange>> {
    let ranges = pairs.into_iter().map(|[min, max]| PoseRange { min, max }).collect::<Vec<_>>();
    let sound = |range: &PoseRange| range.min.is_finite() && range.max.is_finite() && range.min <= range.max;
    ranges.iter().all(sound).then_some(ranges)
}

fn artifact(value: &str) -> Result<ArtifactModel, String> {
    let expected = |error: String| format!("an artifact model as `tpf train` writes it ({})", one_line(&error));
    let artifact: ArtifactModel = serde_json::from_str(value).map_err(|error| expected(error.to_string()))?;
    artifact.check().map_err(|error| expected(error.to_string()))?;
    Ok(artifact)
}

/// A region of a model of several, as metadata has it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RegionEntry {
    joints: Vec<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pose_range: Vec<[f64; 2]>,
    artifact: ArtifactModel,
}

fn regions(value: &str) -> Result<BTreeMap<String, RegionTerms>, String> {
    let expected = |error: &str| {
        format!(
            "a JSON object with joints, pose_range and artifact for the name of each region, as `tpf train` writes it ({})",
            one_line(error)
        )
    };
    let entries: BTreeMap<String, RegionEntry> =
        serde_json::from_str(value).map_err(|error| expected(&error.to_string()))?;
    if entries.is_empty() {
        return Err(expected("it names no region"));
    }
    let terms = |(name, entry): (String, RegionEntry)| -> Result<(String, RegionTerms), String> {
        let of = |error: String| expected(&format!("{name}: {error}"));
        let joints = distinct_names(entry.joints).ok_or_else(|| of("joints are not distinct names".to_owned()))?;
        let pose_range = ranges(entry.pose_range).ok_or_else(|| of("a pose_range without min and max".to_owned()))?;
        entry.artifact.check().map_err(|error| of(error.to_string()))?;
        let n_joints = joints.len();
        if entry.artifact.n_joints != n_joints || ![0, n_joints].contains(&pose_range.len()) {
            return Err(of(format!(
                "{n_joints} joints, {} in its pose_range, {} in its artifact",
                pose_range.len(),
                entry.artifact.n_joints
            )));
        }
        Ok((name.clone(), RegionTerms { joints, pose_range, artifact: Arc::new(entry.artifact) }))
    };
    entries.into_iter().map(terms).collect()
}

/// Metadata `regions` of a model of several.
pub fn regions_text(regions: &BTreeMap<String, RegionTerms>) -> String {
    let entry = |terms: &RegionTerms| RegionEntry {
        joints: terms.joints.clone(),
        pose_range: terms.pose_range.iter().map(|range| [range.min, range.max]).collect(),
        artifact: terms.artifact.as_ref().clone(),
    };
    let entries: BTreeMap<&String, RegionEntry> = regions.iter().map(|(name, terms)| (name, entry(terms))).collect();
    serde_json::to_string(&entries).unwrap_or_default() // texts and numbers always are JSON
}

fn touch(value: &str) -> Result<TouchOutput, String> {
    let expected = || {
        "a JSON object with on and off, probabilities with 0 < off < on < 1, and false_per_min from 0 on or null"
            .to_string()
    };
    let Ok(Value::Object(entries)) = serde_json::from_str(value) else { return Err(expected()) };
    let number = |key: &str| entries.get(key).and_then(Value::as_f64);
    let (Some(on), Some(off)) = (number("on"), number("off")) else { return Err(expected()) };
    let false_per_min = match entries.get("false_per_min") {
        None | Some(Value::Null) => None,
        Some(rate) => Some(rate.as_f64().filter(|rate| *rate >= 0.0).ok_or_else(expected)?),
    };
    if !(0.0 < off && off < on && on < 1.0) {
        return Err(expected());
    }
    Ok(TouchOutput { levels: TouchLevels { on, off }, false_per_min })
}

/// MDF among the metrics. `null` means that detection never reached 90 %, so there is no MDF.
fn mdf(value: &str) -> Result<Option<Newton>, String> {
    let expected = || "a JSON object, in which mdf_gf is a positive number of gF or null".to_string();
    let Ok(Value::Object(metrics)) = serde_json::from_str(value) else { return Err(expected()) };
    match metrics.get("mdf_gf") {
        None | Some(Value::Null) => Ok(None),
        Some(mdf) => {
            let mdf = mdf.as_f64().filter(|mdf| mdf.is_finite() && *mdf > 0.0).ok_or_else(expected)?;
            Ok(Some(GramForce(mdf).into()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(entries: &[(&str, &str)]) -> Result<Metadata, String> {
        let props: Vec<_> = entries
            .iter()
            .map(|(key, value)| StringStringEntryProto { key: key.to_string(), value: value.to_string() })
            .collect();
        Metadata::parse(Path::new("m.onnx"), &props).map_err(|e| e.to_string())
    }

    #[test]
    fn every_key_is_read() {
        let metadata = parse(&[
            ("tpf.contract", "1"),
            ("unit", "N"),
            ("rate_hz", "100"),
            ("window", "64"),
            ("taxels", "16"),
            ("joints", r#"["mcp", "pip"]"#),
            ("pose_range", "[[-0.1, 1.5], [0, 1.9]]"),
            ("touch", r#"{"on": 0.8, "off": 0.5, "false_per_min": 2.5}"#),
            ("metrics", r#"{"mdf_gf": 10, "ba": 0.97}"#),
            ("glove", "A"),
        ])
        .unwrap();
        assert_eq!(metadata.unit, Some(ForceUnit::Newton));
        assert_eq!((metadata.rate_hz, metadata.window, metadata.n_taxels), (Some(100.0), Some(64), Some(16)));
        assert_eq!(metadata.joints.unwrap(), ["mcp", "pip"]);
        assert_eq!(metadata.pose_range.unwrap()[0], PoseRange { min: -0.1, max: 1.5 });
        assert!((metadata.mdf.unwrap().0 - 0.0980665).abs() < 1e-12); // 10 gF, exact to f64
        let levels = TouchLevels { on: 0.8, off: 0.5 };
        assert_eq!(metadata.touch, Some(TouchOutput { levels, false_per_min: Some(2.5) }));
        assert_eq!(metadata.entries["glove"], "A");
    }

    /// Metadata of a region with one taxel and one joint.
    fn of_region(joints: &str) -> String {
        let artifact = r#"{"n_taxels":1,"n_joints":1,"shapes":[1,2,3,4],"gain_variance":[1],"slip":0.3,"slip_common":0.3,"slip_time_s":90,"touch":[1],"residual":[1]}"#;
        format!(r#"{{"thumb": {{{joints}, "artifact": {artifact}}}}}"#)
    }

    #[test]
    fn what_is_written_of_regions_is_read_again() {
        let text = of_region(r#""joints": ["ip"], "pose_range": [[-0.1, 1.5]]"#);
        let regions = parse(&[("regions", &text)]).unwrap().regions;
        assert_eq!(regions["thumb"].joints, ["ip"]);
        assert_eq!(regions["thumb"].pose_range, [PoseRange { min: -0.1, max: 1.5 }]);
        assert_eq!(regions["thumb"].artifact.shapes, [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(parse(&[("regions", &regions_text(&regions))]).unwrap().regions, regions);
    }

    #[test]
    fn joints_may_be_separated_by_commas() {
        assert_eq!(parse(&[("joints", "mcp, pip ,dip")]).unwrap().joints.unwrap(), ["mcp", "pip", "dip"]);
    }

    #[test]
    fn an_mdf_that_was_not_reached_is_no_mdf() {
        assert_eq!(parse(&[("metrics", r#"{"mdf_gf": null}"#)]).unwrap().mdf, None);
    }

    #[test]
    fn each_malformed_value_is_refused_with_its_key_and_what_was_expected() {
        for (key, value, expected) in [
            ("tpf.contract", "2", "expected \"1\""),
            ("unit", "lbf", "expected gF or N"),
            ("unit", "gf", "expected gF or N"),
            ("rate_hz", "0", "a positive number of frames a second"),
            ("rate_hz", "inf", "a positive number of frames a second"),
            ("rate_hz", "10001", "up to 10000"),
            ("rate_hz", "fast", "a positive number of frames a second"),
            ("window", "-1", "a positive whole number"),
            ("taxels", "4.5", "a positive whole number"),
            ("taxels", "99999999999999999999999", "a positive whole number"),
            ("joints", "", "distinct joint names"),
            ("joints", "mcp,,dip", "distinct joint names"),
            ("joints", r#"["mcp", "mcp"]"#, "distinct joint names"),
            ("joints", r#"["mcp", 3]"#, "distinct joint names"),
            ("pose_range", "[[1, 0]]", "[min, max] in rad"),
            ("pose_range", "[[1]]", "[min, max] in rad"),
            ("pose_range", "[]", "[min, max] in rad"),
            ("artifact", "{}", "an artifact model as `tpf train` writes it"),
            ("artifact", "[1", "an artifact model as `tpf train` writes it"),
            (
                "artifact",
                r#"{"n_taxels":1,"n_joints":1,"shapes":[1,2,3],"gain_variance":[1],"slip":0.3,"slip_common":0.3,"slip_time_s":90,"touch":[1],"residual":[1]}"#,
                "3 numbers in shapes, expected 4",
            ),
            ("regions", "{}", "it names no region"),
            ("regions", "[]", "joints, pose_range and artifact for the name of each region"),
            ("regions", r#"{"thumb": {"joints": ["ip"]}}"#, "missing field `artifact`"),
            ("regions", &of_region(r#""joints": ["ip", "ip"]"#), "thumb: joints are not distinct names"),
            (
                "regions",
                &of_region(r#""joints": ["ip", "mcp"]"#),
                "thumb: 2 joints, 0 in its pose_range, 1 in its artifact",
            ),
            (
                "regions",
                &of_region(r#""joints": ["ip"], "pose_range": [[1, 0]]"#),
                "thumb: a pose_range without min and max",
            ),
            ("regions", &of_region(r#""joints": ["ip"]"#).replace("[1,2,3,4]", "[1]"), "thumb: 1 numbers in shapes"),
            ("touch", "0.5", "a JSON object with on and off"),
            ("touch", r#"{"on": 0.5}"#, "a JSON object with on and off"),
            ("touch", r#"{"on": 0.5, "off": 0.5}"#, "0 < off < on < 1"),
            ("touch", r#"{"on": 1.0, "off": 0.5}"#, "0 < off < on < 1"),
            ("touch", r#"{"on": 0.8, "off": 0.5, "false_per_min": -1}"#, "false_per_min from 0 on"),
            ("metrics", "[1]", "a JSON object"),
            ("metrics", r#"{"mdf_gf": -3}"#, "mdf_gf is a positive number"),
            ("metrics", r#"{"mdf_gf": "5"}"#, "mdf_gf is a positive number"),
        ] {
            let refused = parse(&[(key, value)]).unwrap_err();
            assert!(refused.starts_with(&format!("m.onnx: metadata {key} is \"{value}\", expected ")), "{refused}");
            assert!(refused.contains(expected), "{refused}");
            assert_eq!(refused.lines().count(), 1);
        }
    }

    #[test]
    fn a_key_that_is_there_twice_is_refused() {
        let refused = parse(&[("glove", "A"), ("glove", "B")]).unwrap_err();
        assert!(refused.contains("metadata glove is \"B\", expected the key only once"), "{refused}");
    }
}
