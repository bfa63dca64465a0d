//! What comes out of all sessions.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::super::Failure;
use super::labels::SessionSummary;
use super::plan::{Plan, Series, SeriesSource, Session, Which};
use super::pose_quality::PoseQualityScores;
use super::scored;
use crate::eval::{
    Check, ContactReport, Evaluation, GroupBy, GroupScore, Improvement, MetricError, PairedTest, ResultTable, Score,
    Scoring, Split, group_scores, paired_by_user,
};

/// Everything that was found.
#[derive(Debug, Serialize)]
pub(in crate::commands) struct Evaluated {
    /// Whether any session is no recording but made by a simulator.
    pub(super) synthetic: bool,
    pub(super) tool_version: &'static str,
    pub(super) command: Vec<String>,
    pub(super) scoring: Scoring,
    /// What was scored, in words.
    pub(super) scored: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    split: Option<Split>,
    pub(super) sessions: Vec<SessionSummary>,
    /// Bags that could not be scored.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) failed: Vec<FailedBag>,
    pub(super) models: Vec<ModelScores>,
    pub(super) table: ResultTable,
    pub(super) free_movement_table: ResultTable,
    pub(super) improvements: Vec<Improvement>,
    pub(super) paired: Vec<Pairing>,
    /// The judged model again, with joint angles made worse.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) pose_quality: Vec<PoseQualityScores>,
    /// How the gates went.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) checks: Vec<Check>,
}

/// A bag that could not be scored, and why.
#[derive(Debug, Serialize)]
pub(super) struct FailedBag {
    pub(super) bag: String,
    pub(super) error: String,
}

/// The scores of one series.
#[derive(Debug, Serialize)]
pub(super) struct ModelScores {
    pub(super) name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) path: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) sha256: Option<String>,
    pub(super) by: BTreeMap<&'static str, Vec<GroupScore>>,
    pub(super) free_movement: BTreeMap<&'static str, Vec<GroupScore>>,
    pub(super) contacts: BTreeMap<String, ContactReport>,
}

/// Whether one series is better than another, by user.
#[derive(Debug, Serialize)]
pub(super) struct Pairing {
    pub(super) from: String,
    pub(super) to: String,
    pub(super) tests: Vec<PairedTest>,
    free_movement_tests: Vec<PairedTest>,
}

const GROUPS: [GroupBy; 6] =
    [GroupBy::All, GroupBy::Glove, GroupBy::User, GroupBy::Session, GroupBy::Stage, GroupBy::Substage];

impl Evaluated {
    /// Whether some frame had a true force to be scored against.
    pub(super) fn has_scores(&self) -> bool {
        !self.table.gloves.is_empty()
    }

    /// What sessions lack, and which of them.
    pub(super) fn missing(&self) -> BTreeMap<&str, Vec<&str>> {
        let mut missing: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for session in &self.sessions {
            session.missing.iter().for_each(|lack| missing.entry(lack).or_default().push(&session.name));
        }
        missing
    }
}

/// What is gathered session by session.
pub(super) struct Gathered {
    /// `[series]`
    evaluations: Vec<Evaluation>,
    sessions: Vec<SessionSummary>,
    failed: Vec<FailedBag>,
}

impl Gathered {
    /// Nothing yet.
    pub(super) fn new(plan: &Plan<'_>) -> Self {
        let evaluations = plan.series.iter().map(|_| Evaluation::new(Scoring::default())).collect();
        Gathered { evaluations, sessions: Vec::new(), failed: Vec::new() }
    }

    /// Takes a session.
    pub(super) fn handle_session(&mut self, session: Session) -> Result<(), Failure> {
        let Session { summary, frames } = session;
        let checked = frames.iter().flatten().try_for_each(|frames| frames.check());
        checked.map_err(|error| Failure(format!("{}: {error}", summary.bag)))?;
        for (evaluation, of_regions) in self.evaluations.iter_mut().zip(&frames) {
            for frames in of_regions {
                evaluation.handle_session(frames).map_err(|error| Failure(format!("{}: {error}", summary.bag)))?;
            }
        }
        self.sessions.push(summary);
        Ok(())
    }

    /// Takes a bag that could not be scored.
    pub(super) fn handle_failure(&mut self, bag: &Path, failure: &Failure) {
        self.failed.push(FailedBag { bag: bag.display().to_string(), error: failure.to_string() });
    }

    /// Everything that was found.
    pub(super) fn finish(self, plan: &Plan<'_>) -> Result<Evaluated, Failure> {
        let Gathered { evaluations, sessions, failed } = self;
        if let (true, [first, rest @ ..]) = (sessions.is_empty(), failed.as_slice()) {
            return Err(Failure(match rest.len() {
                0 => first.error.clone(),
                n => format!("none of {} bags could be scored; the first: {}", n + 1, first.error),
            }));
        }
        let all: Vec<(&Series, Evaluation)> = plan.series.iter().zip(evaluations).collect();
        let (degraded, series): (Vec<_>, Vec<_>) = all.into_iter().partition(|(one, _)| one.quality.is_some());
        let mut models = Vec::new();
        for (one, evaluation) in &series {
            let core = match one.source {
                SeriesSource::Core(idx) => plan.cores.get(idx),
                SeriesSource::Recorded => None,
            };
            models.push(ModelScores {
                name: one.name.clone(),
                sha256: core.map(|core| core.sha256.clone()),
                path: core.map(|core| core.path.clone()),
                by: scores(|by| evaluation.scores(by))?,
                free_movement: scores(|by| group_scores(&evaluation.free_movement, by))?,
                contacts: evaluation.contacts(),
            });
        }
        let table = table(&series, |evaluation| evaluation.scores(GroupBy::Glove))?;
        let free = table_of_free(&series)?;
        Ok(Evaluated {
            synthetic: sessions.iter().any(|session| session.synthetic),
            tool_version: env!("CARGO_PKG_VERSION"),
            command: std::env::args().collect(),
            scoring: Scoring::default(),
            scored: scored(plan.split),
            split: plan.split,
            models,
            improvements: table.improvements(),
            table,
            free_movement_table: free,
            paired: pairings(&series, plan.n_compared)?,
            sessions,
            failed,
            pose_quality: pose_quality(&degraded)?,
            checks: Vec::new(),
        })
    }
}

type Scored<'a> = (&'a Series, Evaluation);

fn pose_quality(degraded: &[Scored<'_>]) -> Result<Vec<PoseQualityScores>, Failure> {
    let scores = degraded.iter().filter_map(|(one, evaluation)| {
        let quality = one.quality?;
        Some(evaluation.scores(GroupBy::Glove).map(|scores| PoseQualityScores { quality, scores }))
    });
    Ok(scores.collect::<Result<_, _>>()?)
}

fn scores<E: std::error::Error>(
    of: impl Fn(GroupBy) -> Result<Vec<GroupScore>, E>,
) -> Result<BTreeMap<&'static str, Vec<GroupScore>>, Failure> {
    GROUPS.iter().map(|by| Ok((by.name(), of(*by)?))).collect()
}

type MetricResult<T> = Result<T, MetricError>;

fn table(
    series: &[Scored<'_>],
    of: impl Fn(&Evaluation) -> MetricResult<Vec<GroupScore>>,
) -> Result<ResultTable, Failure> {
    let mut rows: Vec<(&str, BTreeMap<String, Score>)> = Vec::new();
    for (one, evaluation) in series {
        let scores = of(evaluation)?;
        let by_group = scores.into_iter().map(|GroupScore { group, score }| (group.to_string(), score)).collect();
        rows.push((&one.name, by_group));
    }
    Ok(ResultTable::new(rows.iter().map(|(name, scores)| (*name, scores))))
}

fn table_of_free(series: &[Scored<'_>]) -> Result<ResultTable, Failure> {
    table(series, |evaluation| group_scores(&evaluation.free_movement, GroupBy::Glove))
}

/// What is judged against each baseline, and the corrected force against the base of the same model.
fn pairings(series: &[Scored<'_>], n_compared: usize) -> Result<Vec<Pairing>, Failure> {
    let Some((judged, judged_as)) = series.iter().rfind(|(one, _)| one.which == Which::Corrected) else {
        return Ok(Vec::new());
    };
    let is_baseline = |one: &Series| match one.source {
        SeriesSource::Core(core) => core < n_compared && one.which == Which::Corrected,
        SeriesSource::Recorded => false,
    };
    let is_own_base = |one: &Series| one.which == Which::Base && one.source == judged.source;
    let baselines = series.iter().filter(|(one, _)| is_baseline(one));
    let mut pairings = Vec::new();
    for (from, from_as) in baselines.chain(series.iter().filter(|(one, _)| is_own_base(one))) {
        pairings.push(Pairing {
            from: from.name.clone(),
            to: judged.name.clone(),
            tests: paired_by_user(&from_as.all, &judged_as.all)?,
            free_movement_tests: paired_by_user(&from_as.free_movement, &judged_as.free_movement)?,
        });
    }
    Ok(pairings)
}
