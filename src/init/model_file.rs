//! The model that a parameter file is made for.

use std::path::{Component, Path, PathBuf};

use super::error::InitFileError;
use super::plan::ModelFile;
use crate::bag::{printable, shown};
use crate::hand::JOINTS;
use crate::inspect::{BagReport, Likelihood};
use crate::location::{self, Entry, Found};
use crate::model;

/// Most files in a folder that are tried.
const MAX_FILES: usize = 64;

/// Models that are named where several fit.
const MOST_NAMED: usize = 3;

/// The model that is named; else the only one in the folder of the parameter file, or in `models` there, that fits.
pub(super) fn of(
    named: Option<&Path>,
    folder: &Path,
    bags: &[BagReport],
    notes: &mut Vec<String>,
) -> Result<Option<ModelFile>, InitFileError> {
    if let Some(path) = named {
        return described(path, folder, String::new()).map(Some);
    }
    let mut fitting: Vec<PathBuf> = Vec::new();
    for path in onnx_files(folder).into_iter().chain(onnx_files(&folder.join("models"))) {
        let fits = |info: model::ModelInfo| fits(&info, bags);
        if model::inspect(&path).is_ok_and(fits) {
            fitting.push(path);
        }
    }
    match fitting.as_slice() {
        [] => Ok(None),
        [only] => {
            let why = "CHECK: the only model here that takes as many taxels, and joints that are there".to_owned();
            notes.push(format!(
                "guessed: the model is {}, the only one here that takes as many taxels, and joints that are there",
                only.display()
            ));
            described(only, folder, why).map(Some)
        }
        several => {
            let names = several.iter().take(MOST_NAMED).map(|path| shown(path)).collect::<Vec<_>>().join(", ");
            let more = several.len().saturating_sub(MOST_NAMED);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            notes
                .push(format!("no model was taken, because {} fit: {names}{more}; give one by --model", several.len()));
            Ok(None)
        }
    }
}

/// Whether the bags have as many taxels, and the joints that the model names.
fn fits(info: &model::ModelInfo, bags: &[BagReport]) -> bool {
    let contract = &info.contract;
    let n_taxels = contract.n_taxels;
    let of_regions = contract.regions.values().map(|terms| &terms.joints);
    let mut joints = contract.joints.iter().chain(of_regions).flatten();
    let taxels = bags.iter().flat_map(|bag| &bag.candidates.tactile);
    let mut taxels = taxels.filter(|one| one.likelihood == Likelihood::Likely);
    let has_taxels = taxels.any(|one| one.n_taxels == Some(n_taxels as u64));
    let mut hands = bags.iter().flat_map(|bag| &bag.candidates.hands);
    let has_points = hands.any(|one| one.likelihood == Likelihood::Likely);
    let angles = || bags.iter().flat_map(|bag| &bag.candidates.joints).flat_map(|one| &one.angles);
    let is_there = |joint: &String| {
        has_points && JOINTS.contains(&joint.as_str()) || angles().any(|angle| angle.name.as_ref() == Some(joint))
    };
    has_taxels && joints.all(is_there)
}

fn onnx_files(folder: &Path) -> Vec<PathBuf> {
    // A folder that can't be listed has none to propose.
    let entries = location::list(folder).into_iter().flatten();
    let is_onnx = |entry: &Entry| {
        entry.path.extension().is_some_and(|extension| extension == "onnx") && matches!(entry.found, Found::File(_))
    };
    let mut paths: Vec<PathBuf> = entries.filter(is_onnx).map(|entry| entry.path).take(MAX_FILES).collect();
    paths.sort();
    paths
}

fn described(path: &Path, folder: &Path, why: String) -> Result<ModelFile, InitFileError> {
    let info = model::inspect(path)?;
    let trained_on = info.noted("glove").map(|glove| {
        let glove = printable(glove);
        format!(
            "trained on glove {glove}: readings of another glove, or in another unit, give wrong forces without a flag"
        )
    });
    let why = match (why.is_empty(), trained_on) {
        (true, Some(trained_on)) => format!("CHECK: {trained_on}"),
        (false, Some(trained_on)) => format!("{why}; {trained_on}"),
        (_, None) => why,
    };
    let contract = info.contract;
    Ok(ModelFile {
        path: relative(path, folder)?,
        n_taxels: contract.n_taxels,
        n_joints: contract.n_region_joints(),
        joints: contract.joints,
        regions: contract.regions.into_iter().map(|(name, terms)| (name, terms.joints)).collect(),
        rate_hz: contract.rate_hz,
        n_force_axes: contract.axes.n(),
        why,
    })
}

/// A path as a file in `folder` has it.
pub(super) fn relative(path: &Path, folder: &Path) -> Result<String, InitFileError> {
    let refuse = |path: &Path, reason: String| InitFileError::Path { path: path.to_path_buf(), reason };
    let full = |path: &Path| path.canonicalize().map_err(|error| refuse(path, error.to_string()));
    let utf8 = |path: &Path| path.to_str().map(str::to_owned);
    let no_text = || refuse(path, "a parameter file can't hold this path: it is not UTF-8".to_owned());
    // From a URI no way leads to a file of this machine, nor the other way round.
    if location::is_remote(folder) || location::is_remote(path) {
        let whole = if location::is_remote(path) { path.to_path_buf() } else { full(path)? };
        return utf8(&whole).ok_or_else(no_text);
    }
    if path.is_absolute() {
        return utf8(path).ok_or_else(no_text); // whoever gives a whole path may move the parameter file
    }
    let (path, folder) = (full(path)?, full(folder)?);
    let shared = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    let relative: PathBuf = up.chain(path.components().skip(shared)).collect();
    utf8(&relative).ok_or_else(no_text)
}
