//! A model without each user, or without each donning, scored on what it never saw.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use serde::Serialize;

use super::{Request, SessionNotes, TrainingError, train_without};
use crate::config::Config;
use crate::eval::{GroupBy, GroupScore};
use crate::evaluate::{self, fold_path};
use crate::observer::Observer;
use crate::train::Progress;

/// The groups that models are trained without, one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HoldOut {
    /// All sessions of a user.
    Users,
    /// One session: a donning.
    Donnings,
}

impl HoldOut {
    /// The word for one group.
    pub fn what(self) -> &'static str {
        match self {
            HoldOut::Users => "user",
            HoldOut::Donnings => "donning",
        }
    }
}

/// Each user or donning by the model that was trained without it, every frame scored.
#[derive(Debug, Clone, Serialize)]
pub struct HeldOutScores {
    /// The kind of group that was left out.
    pub hold_out: HoldOut,
    /// How many there were.
    pub n_groups: usize,
    /// Whether some of the data is no recording but made by a simulator.
    pub synthetic: bool,
    /// Scores of each.
    pub scores: Vec<GroupScore>,
}

/// Trains a model without each user or donning, beside the one of the request, and scores each on what it never saw.
///
/// `sessions` are those of the [`Report`](super::Report) on the same bags.
///
/// # Errors
/// [`TrainingError`] where a session doesn't name its user, all are of one, or as [`run`](super::run).
pub fn hold_out(
    cfg: &Config,
    bags: &[PathBuf],
    sessions: &[SessionNotes],
    hold_out: HoldOut,
    request: &Request,
    observer: &dyn Observer,
    on_step: &mut dyn FnMut(&Progress),
) -> Result<HeldOutScores, TrainingError> {
    let mut groups: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (idx, session) in sessions.iter().enumerate() {
        let no_user = || TrainingError::NoUser { session: session.name.clone() };
        let group = match hold_out {
            HoldOut::Donnings => session.name.clone(),
            HoldOut::Users => session.user.clone().ok_or_else(no_user)?,
        };
        groups.entry(group).or_default().push(idx);
    }
    let what = hold_out.what();
    if groups.len() < 2 {
        return Err(TrainingError::OneGroup { what });
    }
    for (group, left_out) in &groups {
        let fold = Request { output: fold_path(&request.output, group), ..request.clone() };
        fold.check()?;
        observer.note(&format!("without {what} {group}"));
        let bags_out: BTreeSet<usize> = left_out.iter().map(|idx| sessions[*idx].bag_idx).collect();
        let kept: Vec<PathBuf> =
            (0..bags.len()).filter(|bag| !bags_out.contains(bag)).map(|bag| bags[bag].clone()).collect();
        // A bag with several regions is there once for each.
        let names: BTreeSet<String> = left_out.iter().map(|idx| sessions[*idx].name.clone()).collect();
        let names: Vec<String> = names.into_iter().collect();
        train_without(cfg, &kept, &fold, &names, observer, on_step)?;
    }
    let scoring = evaluate::Request {
        model: Some(&request.output),
        held_out: true,
        in_air: request.in_air.as_ref(),
        ..evaluate::Request::new(bags)
    };
    let scored = evaluate::run(cfg.clone(), &scoring, observer)?;
    let by = if hold_out == HoldOut::Users { GroupBy::User } else { GroupBy::Session };
    let scores = scored.models.last().and_then(|model| model.by.get(by.name())).cloned().unwrap_or_default();
    Ok(HeldOutScores { hold_out, n_groups: groups.len(), synthetic: scored.synthetic, scores })
}

/// Refuses to begin where the regions have models of their own in the parameters: [`hold_out`] scores them by one.
///
/// # Errors
/// [`TrainingError::HoldOutModels`].
pub fn check_hold_out(cfg: &Config) -> Result<(), TrainingError> {
    let models: BTreeSet<_> = cfg.fusion().regions().iter().map(|region| region.model).collect();
    if models.len() > 1 { Err(TrainingError::HoldOutModels { n: models.len() }) } else { Ok(()) }
}

/// Refuses to begin where a fold of the model is there already.
///
/// # Errors
/// [`TrainingError::FoldExists`].
pub fn check_folds(request: &Request) -> Result<(), TrainingError> {
    let folds = if request.overwrite { Vec::new() } else { evaluate::folds_of(&request.output)? };
    match folds.into_iter().next() {
        None => Ok(()),
        Some(path) => Err(TrainingError::FoldExists { path }),
    }
}
