//! The calibration file: baselines of a glove on a hand, stored so that a session need not start in the air again.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::files;
use crate::fusion::{ArtifactFit, Baseline, ForceGain, TactileSource};
use crate::location;

const FORMAT: &str = "tactile_pose_fusion/calibration/1";

/// Largest file that is read. A glove with 4096 taxels needs a hundredth of it.
const MAX_BYTES: u64 = 16 << 20;

/// Contents of a calibration file. YAML on disk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    format: String,
    /// Serial number of the glove, as in the parameter `glove`. Empty if not given.
    pub glove: String,
    /// The person who wore it, as in the parameter `user`. Empty if not given.
    pub user: String,
    /// SHA-256 of each model in use, by the model's name in the parameters.
    pub models: BTreeMap<String, String>,
    /// The recording: bag or live, and its time at zero load.
    pub recorded: String,
    /// Baseline of each tactile source, by the source's name in the parameters.
    pub sources: BTreeMap<String, Baseline>,
    /// Artifact of each region whose model has an artifact model, by the region's name in the parameters.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub artifacts: BTreeMap<String, ArtifactFit>,
    /// Force gain of each region that was touched with known force, by the region's name in the parameters.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub force_gains: BTreeMap<String, ForceGain>,
}

/// A calibration file that can't be used. Each message is one line that names the file.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum CalibrationFileError {
    #[error("{path}: cannot read the calibration: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{path}: cannot write the calibration: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{path}: already exists; choose another name, or remove it first")]
    Exists { path: PathBuf },
    #[error("{path}: not a calibration file: {reason}; make one with `tpf calibrate`")]
    Malformed { path: PathBuf, reason: String },
    #[error("{path}: made for {what} {got:?}, the parameters say {expected:?}; calibrate again, or correct `{what}`")]
    Mismatch { path: PathBuf, what: &'static str, expected: String, got: String },
    #[error("{path}: has no baseline for tactile source {expected:?}, only for {got:?}; calibrate again")]
    MissingSource { path: PathBuf, expected: String, got: Vec<String> },
    #[error(
        "{path}: has {got} taxels for tactile source {source_name:?}, the parameters say {expected}; calibrate again"
    )]
    Taxels { path: PathBuf, source_name: String, expected: usize, got: usize },
}

impl Calibration {
    /// A calibration with these baselines.
    pub fn new(glove: &str, user: &str, recorded: String, sources: BTreeMap<String, Baseline>) -> Self {
        let (glove, user) = (glove.to_owned(), user.to_owned());
        Calibration {
            format: FORMAT.to_owned(),
            glove,
            user,
            models: BTreeMap::new(),
            recorded,
            sources,
            artifacts: BTreeMap::new(),
            force_gains: BTreeMap::new(),
        }
    }

    /// Reads a calibration and checks that it is for this glove, this user and these sources.
    ///
    /// If `glove` or `user` is empty on either side, it is not compared.
    ///
    /// # Errors
    /// [`CalibrationFileError`], which names the file and the difference.
    pub fn load(
        path: &Path,
        glove: &str,
        user: &str,
        sources: &[TactileSource],
    ) -> Result<Calibration, CalibrationFileError> {
        let path_buf = || path.to_path_buf();
        let mut text = String::new();
        let read = location::open(path).and_then(|file| file.take(MAX_BYTES + 1).read_to_string(&mut text));
        read.map_err(|source| CalibrationFileError::Read { path: path_buf(), source })?;
        let malformed = |reason: String| CalibrationFileError::Malformed { path: path_buf(), reason };
        if text.len() as u64 > MAX_BYTES {
            return Err(malformed(format!("it has more than {} MiB", MAX_BYTES >> 20)));
        }
        let one_line = |text: String| text.lines().next().unwrap_or_default().to_owned();
        let found: Calibration =
            serde_saphyr::from_str(&text).map_err(|error| malformed(one_line(error.to_string())))?;
        if found.format != FORMAT {
            return Err(malformed(format!("format is {:?}, expected {FORMAT:?}", found.format)));
        }
        for (what, expected, got) in [("glove", glove, &found.glove), ("user", user, &found.user)] {
            if !expected.is_empty() && !got.is_empty() && expected != got {
                let (expected, got) = (expected.to_owned(), got.clone());
                return Err(CalibrationFileError::Mismatch { path: path_buf(), what, expected, got });
            }
        }
        for (region, gain) in &found.force_gains {
            gain.check().map_err(|error| malformed(format!("force gain of region {region}: {error}")))?;
        }
        for source in sources {
            let Some(baseline) = found.sources.get(&source.name) else {
                let got = found.sources.keys().cloned().collect();
                return Err(CalibrationFileError::MissingSource {
                    path: path_buf(),
                    expected: source.name.clone(),
                    got,
                });
            };
            for got in [baseline.median.len(), baseline.noise.len(), baseline.faulty.len()] {
                if got != source.n_taxels {
                    let (source_name, expected) = (source.name.clone(), source.n_taxels);
                    return Err(CalibrationFileError::Taxels { path: path_buf(), source_name, expected, got });
                }
            }
            if let Some(taxel_idx) = baseline.median.iter().position(|median| !median.is_finite()) {
                return Err(malformed(format!("baseline of {:?} is not finite at taxel {taxel_idx}", source.name)));
            }
        }
        Ok(found)
    }

    /// Writes a new calibration file. It appears complete or not at all.
    ///
    /// # Errors
    /// [`CalibrationFileError::Exists`] if the file exists, [`CalibrationFileError::Write`].
    pub fn save(&self, path: &Path) -> Result<(), CalibrationFileError> {
        self.write(path, false)
    }

    /// Checks that a new calibration file can be written: before somebody calibrates, not after.
    ///
    /// # Errors
    /// As [`save`](Self::save).
    pub fn check_new(path: &Path) -> Result<(), CalibrationFileError> {
        location::check_output(path, false).map_err(|error| new_error(path, error))
    }

    /// Writes a calibration file and replaces an existing one. The new file appears complete or not at all.
    ///
    /// # Errors
    /// [`CalibrationFileError::Write`].
    pub fn replace(&self, path: &Path) -> Result<(), CalibrationFileError> {
        self.write(path, true)
    }

    fn write(&self, path: &Path, overwrite: bool) -> Result<(), CalibrationFileError> {
        let text = serde_saphyr::to_string(self).map_err(|error| new_error(path, std::io::Error::other(error)))?;
        files::write(path, text.as_bytes(), overwrite).map_err(|error| new_error(path, error))
    }
}

fn new_error(path: &Path, source: std::io::Error) -> CalibrationFileError {
    match source.kind() {
        std::io::ErrorKind::AlreadyExists => CalibrationFileError::Exists { path: path.to_path_buf() },
        _ => CalibrationFileError::Write { path: path.to_path_buf(), source },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fusion::FrameClock;

    fn source(n_taxels: usize) -> TactileSource {
        let frame_clock = FrameClock::Tactile;
        TactileSource { name: "glove".into(), n_taxels, stamp_offset_ns: 0, inverted: false, frame_clock }
    }

    fn calibration() -> Calibration {
        let baseline = Baseline { median: vec![0.1, 1.0 / 3.0], noise: vec![1e-7, 2.5e8], faulty: vec![false, true] };
        let sources = BTreeMap::from([("glove".to_owned(), baseline)]);
        let mut calibration = Calibration::new("SN: 1", "", "bag, 10.00 s".into(), sources);
        calibration.models.insert("fingertip".into(), "00ff".into());
        calibration
    }

    #[test]
    fn a_calibration_comes_back_as_it_was_saved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("calibration.yaml");
        calibration().save(&path).unwrap();
        assert_eq!(Calibration::load(&path, "SN: 1", "anyone", &[source(2)]).unwrap(), calibration());
        let again = calibration().save(&path).unwrap_err().to_string();
        assert!(again.ends_with("already exists; choose another name, or remove it first"), "{again}");
    }

    #[test]
    fn a_calibration_of_something_else_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("calibration.yaml");
        calibration().save(&path).unwrap();
        let refused = |glove, sources: &[TactileSource]| {
            Calibration::load(&path, glove, "", sources).unwrap_err().to_string().replace(path.to_str().unwrap(), "F")
        };
        let text = refused("SN: 2", &[source(2)]);
        assert_eq!(
            text,
            "F: made for glove \"SN: 1\", the parameters say \"SN: 2\"; calibrate again, or correct `glove`"
        );
        let text = refused("", &[source(3)]);
        assert_eq!(text, "F: has 2 taxels for tactile source \"glove\", the parameters say 3; calibrate again");
        let mut other = source(2);
        other.name = "palm".into();
        assert!(
            refused("", &[other]).starts_with("F: has no baseline for tactile source \"palm\", only for [\"glove\"]")
        );
    }

    #[test]
    fn what_is_no_calibration_is_refused_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("calibration.yaml");
        for text in ["", "[1, 2", "format: x", "a: 1\nb: 2", "\u{0}", "format: 1\nglove: {}\n"] {
            std::fs::write(&path, text).unwrap();
            let error = Calibration::load(&path, "", "", &[source(2)]).unwrap_err().to_string();
            assert!(error.contains("not a calibration file") && error.lines().count() == 1, "{error}");
        }
    }
}
