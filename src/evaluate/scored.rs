//! Statistics of one bag. A run over many bags folds these, and so does a merge: they give the same numbers.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::EvaluateError;
use super::plan::{Plan, PlannedCore, Series, SessionToScore};
use super::session::SessionSummary;
use super::stretches::BestAndWorst;
use crate::eval::{Evaluation, Scoring, Split};

/// Head of an evaluation: series, models and split, the same for all bags.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Head {
    /// Baselines first, then what is judged, then that with its pose made worse.
    pub(super) series: Vec<Series>,
    /// The models that series name.
    pub(super) models: Vec<ModelFile>,
    pub(super) n_compared: usize,
    pub(super) split: Option<Split>,
}

/// A model as results name it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct ModelFile {
    pub(super) path: String,
    /// Empty where the scores are of several models.
    pub(super) sha256: String,
}

/// The result of one bag.
#[derive(Debug)]
pub(super) struct BagPart {
    /// As it was given.
    pub(super) bag: String,
    /// SHA-256 of its files, where they were read whole.
    pub(super) sha256: Option<String>,
    /// Its statistics, or why there are none.
    pub(super) outcome: Result<ScoredBag, String>,
}

/// The statistics of one bag.
#[derive(Debug)]
pub(super) struct ScoredBag {
    pub(super) summary: SessionSummary,
    /// `[series]`
    pub(super) evaluations: Vec<Evaluation>,
    /// `[regions]` of what is judged, those with a stretch.
    pub(super) stretches: Vec<BestAndWorst>,
}

impl Head {
    pub(super) fn of(plan: &Plan<'_>) -> Self {
        let model = |core: &PlannedCore| ModelFile { path: core.path.clone(), sha256: core.sha256.clone() };
        Head {
            series: plan.series.clone(),
            models: plan.cores.iter().map(model).collect(),
            n_compared: plan.n_compared,
            split: plan.split,
        }
    }
}

impl BagPart {
    /// The statistics of a session.
    pub(super) fn scored(session: SessionToScore, judged: Option<usize>) -> Result<Self, EvaluateError> {
        let SessionToScore { summary, frames } = session;
        let mut evaluations = Vec::new();
        for of_regions in &frames {
            let mut evaluation = Evaluation::new(Scoring::default());
            for frames in of_regions {
                evaluation.handle_session(frames).map_err(|error| EvaluateError::in_bag(&summary.bag, &error))?;
            }
            evaluations.push(evaluation);
        }
        let judged = judged.and_then(|judged| frames.get(judged));
        let stretches = judged.into_iter().flatten().filter_map(BestAndWorst::of).collect();
        Ok(BagPart {
            bag: summary.bag.clone(),
            sha256: Some(summary.sha256.clone()),
            outcome: Ok(ScoredBag { summary, evaluations, stretches }),
        })
    }

    /// A bag that could not be scored.
    pub(super) fn failed(bag: &Path, failure: &EvaluateError) -> Self {
        BagPart { bag: bag.display().to_string(), sha256: None, outcome: Err(failure.to_string()) }
    }
}
