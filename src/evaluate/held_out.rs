//! Models that were trained without a user or a donning, each scored on what it never saw.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::EvaluateError;
use crate::location;
use crate::model;
use crate::model::metadata::HELD_OUT;
use crate::sessions::session_name;

/// Separator between a model's name and that of the group that its fold was trained without.
const WITHOUT: &str = ".without-";

/// Bags, and the models that were trained without them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fold {
    pub(super) bags: Vec<PathBuf>,
    /// Where each stands among all bags.
    pub(super) places: Vec<usize>,
    /// Baselines first.
    pub(super) models: Vec<PathBuf>,
}

/// Where the fold of a model is written that is trained without a group: `MODEL.without-GROUP.onnx`.
pub fn fold_path(model: &Path, group: &str) -> PathBuf {
    let safe = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    fold_named(model, &group.chars().map(safe).collect::<String>())
}

/// All folds of a model, in words: `MODEL.without-*.onnx`.
pub fn all_folds(model: &Path) -> PathBuf {
    fold_named(model, "*")
}

fn fold_named(model: &Path, group: &str) -> PathBuf {
    let stem = model.file_stem().unwrap_or_default().to_string_lossy();
    model.with_file_name(format!("{stem}{WITHOUT}{group}.onnx"))
}

/// The bags of each combination of folds, by what the folds beside the models say.
///
/// # Errors
/// [`EvaluateError::NoFolds`] where a model has none, [`EvaluateError::InNoFold`] for a bag that every fold was trained with,
/// and what reading a model gives.
pub(super) fn folds(bags: &[PathBuf], models: &[&Path]) -> Result<Vec<Fold>, EvaluateError> {
    let by_model = models.iter().map(|model| by_session(model)).collect::<Result<Vec<_>, _>>()?;
    let mut folds: Vec<Fold> = Vec::new();
    for (place, bag) in bags.iter().enumerate() {
        let name = session_name(bag);
        let of_model = |(sessions, model): (&BTreeMap<String, PathBuf>, &&Path)| {
            let missing = || EvaluateError::InNoFold { bag: name.clone(), model: all_folds(model) };
            sessions.get(&name).cloned().ok_or_else(missing)
        };
        let models: Vec<PathBuf> = by_model.iter().zip(models).map(of_model).collect::<Result<_, _>>()?;
        match folds.iter_mut().find(|fold| fold.models == models) {
            Some(fold) => {
                fold.bags.push(bag.clone());
                fold.places.push(place);
            }
            None => folds.push(Fold { bags: vec![bag.clone()], places: vec![place], models }),
        }
    }
    Ok(folds)
}

/// The folds that lie beside a model, by their names.
///
/// # Errors
/// [`EvaluateError::File`] when its folder can't be listed.
pub fn folds_of(model: &Path) -> Result<Vec<PathBuf>, EvaluateError> {
    let folder = model.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let begin = format!("{}{WITHOUT}", model.file_stem().unwrap_or_default().to_string_lossy());
    let is_fold = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(&begin) && name.ends_with(".onnx")
    };
    let entries = match location::list(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
        entries => entries.map_err(|error| EvaluateError::File { path: folder.to_owned(), error })?,
    };
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path).filter(is_fold).collect();
    paths.sort();
    Ok(paths)
}

/// The fold of each session that one was trained without.
fn by_session(model: &Path) -> Result<BTreeMap<String, PathBuf>, EvaluateError> {
    let mut sessions = BTreeMap::new();
    for path in folds_of(model)? {
        let info = model::inspect(&path)?;
        let told = info.metadata.get(HELD_OUT).and_then(|text| serde_json::from_str::<Vec<String>>(text).ok());
        let told = told.ok_or_else(|| EvaluateError::NoFold { model: path.clone() })?;
        sessions.extend(told.into_iter().map(|session| (session, path.clone())));
    }
    if sessions.is_empty() {
        return Err(EvaluateError::NoFolds { model: all_folds(model) });
    }
    Ok(sessions)
}
