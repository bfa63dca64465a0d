//! Results of all sessions.

use std::collections::BTreeMap;

use serde::Serialize;

use super::headline::Headline;
use super::plan::{Series, SeriesSource, Which};
use super::scored::{BagPart, Head, ScoredBag};
use super::session::SessionSummary;
use super::stretches::{Stretch, Stretches};
use super::{EvaluateError, what_is_scored};
use crate::eval::{
    Check, ContactReport, Evaluation, ForceCurve, ForceDensity, GroupBy, GroupScore, Improvement, MetricError,
    PairedTest, ResultTable, Score, Scoring, Split, TangentialScore, group_scores, paired_by_user,
};
use crate::recording::PoseQuality;

/// Everything that was found.
#[derive(Debug, Serialize)]
pub struct Evaluated {
    /// Whether any session is no recording but made by a simulator.
    pub synthetic: bool,
    /// Of this package.
    pub tool_version: &'static str,
    /// The command line of this process.
    pub command: Vec<String>,
    /// Thresholds and bins.
    pub scoring: Scoring,
    /// The scored part of each session, in words.
    pub scored: &'static str,
    /// Where sessions are cut.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split: Option<Split>,
    /// The headline; absent where nothing was judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub headline: Option<Headline>,
    /// In the order of the bags.
    pub sessions: Vec<SessionSummary>,
    /// Bags that could not be scored.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<FailedBag>,
    /// Baselines first, then what is judged.
    pub models: Vec<ModelScores>,
    /// By glove, as the paper has it.
    pub table: ResultTable,
    /// The same for frames in which nothing was asked to be touched.
    pub free_movement_table: ResultTable,
    /// Of what is judged over each of the others.
    pub improvements: Vec<Improvement>,
    /// The same, tested by user.
    pub paired: Vec<Pairing>,
    /// The judged model again, with joint angles made worse.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pose_quality: Vec<PoseQualityScores>,
    /// How the gates went.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub checks: Vec<Check>,
    /// Evidence for a report, which the JSON does not hold.
    #[serde(skip)]
    pub evidence: Evidence,
}

/// A bag that could not be scored, and why.
#[derive(Debug, Serialize)]
pub struct FailedBag {
    /// As it was given.
    pub bag: String,
    /// Why, in one line.
    pub error: String,
}

/// The scores of one series.
#[derive(Debug, Serialize)]
pub struct ModelScores {
    /// Its name.
    pub name: String,
    /// The model file, where a model made it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<String>,
    /// Of that file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// The output by which touch was judged: `force` or `touch output`.
    pub touch_by: &'static str,
    /// By kind of group.
    pub by: BTreeMap<&'static str, Vec<GroupScore>>,
    /// The same, for free movement.
    pub free_movement: BTreeMap<&'static str, Vec<GroupScore>>,
    /// By glove.
    pub contacts: BTreeMap<String, ContactReport>,
    /// By glove: detection and error over true force.
    pub curves: BTreeMap<String, ForceCurve>,
    /// By glove: frames by true and by estimated force.
    pub densities: BTreeMap<String, ForceDensity>,
}

/// Whether one series is better than another, by user.
#[derive(Debug, Serialize)]
pub struct Pairing {
    /// The baseline.
    pub from: String,
    /// The judged series.
    pub to: String,
    /// One a measure.
    pub tests: Vec<PairedTest>,
    /// The same, for free movement.
    pub free_movement_tests: Vec<PairedTest>,
}

/// The judged model again, with joint angles made worse by one amount.
#[derive(Debug, Serialize)]
pub struct PoseQualityScores {
    /// How they were made worse.
    #[serde(flatten)]
    pub quality: PoseQuality,
    /// Of the corrected force, by glove.
    pub scores: Vec<GroupScore>,
}

/// Evidence that a report shows and the JSON doesn't hold.
#[derive(Debug, Default)]
pub struct Evidence {
    /// The best, the median and the worst stretch of the series that is judged.
    pub stretches: Vec<Stretch>,
    /// By series and glove: latencies of onsets and of offsets, ms.
    pub latencies: Vec<Latencies>,
}

/// Latencies of one series on one glove, ms.
#[derive(Debug)]
pub struct Latencies {
    /// Index of the series.
    pub series: usize,
    /// The glove.
    pub glove: String,
    /// From the true onset to the detected one.
    pub onset: Vec<f64>,
    /// From the true end of a touch to the detected one.
    pub offset: Vec<f64>,
}

const GROUPS: [GroupBy; 6] =
    [GroupBy::All, GroupBy::Glove, GroupBy::User, GroupBy::Session, GroupBy::Stage, GroupBy::Substage];

impl Evaluated {
    /// Whether some frame had a true force to be scored against.
    pub fn has_scores(&self) -> bool {
        !self.table.gloves.is_empty()
    }

    /// Names of the series whose touch was judged by the probability that a model gives.
    pub fn judged_by_touch(&self) -> Vec<&str> {
        self.models.iter().filter(|model| model.is_by_touch()).map(|model| model.name.as_str()).collect()
    }

    /// Glove, series and score of the tangential force, where truth and model have three axes.
    pub fn tangential(&self) -> Vec<(&str, &str, TangentialScore)> {
        let mut found = Vec::new();
        for model in &self.models {
            for group in model.by.get(GroupBy::Glove.name()).into_iter().flatten() {
                let glove = group.group.glove.as_deref().unwrap_or_default();
                found.extend(group.score.tangential.map(|score| (glove, model.name.as_str(), score)));
            }
        }
        found.sort_by_key(|(glove, _, _)| *glove); // stable: models stay in their order
        found
    }

    /// Missing data of sessions, each with the names of the sessions that lack it.
    pub fn missing(&self) -> BTreeMap<&str, Vec<&str>> {
        let mut missing: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for session in &self.sessions {
            session.missing.iter().for_each(|lack| missing.entry(lack).or_default().push(&session.name));
        }
        missing
    }
}

/// Touch was judged by the probability that a model gives.
const TOUCH_OUTPUT: &str = "touch output";

impl ModelScores {
    /// Whether touch was judged by the probability that the model gives, and not by its force.
    pub fn is_by_touch(&self) -> bool {
        self.touch_by == TOUCH_OUTPUT
    }
}

/// Results gathered bag by bag, in the order of the bags: sums of numbers depend on it.
#[derive(Default)]
pub(super) struct Gathered {
    /// `[series]`
    evaluations: Vec<Evaluation>,
    sessions: Vec<SessionSummary>,
    failed: Vec<FailedBag>,
    stretches: Stretches,
    /// Bags whose turn has not come.
    early: BTreeMap<usize, BagPart>,
    turn: usize,
}

impl Gathered {
    /// Takes a bag, of which `idx` tells the turn.
    pub(super) fn handle(&mut self, idx: usize, part: BagPart) -> Result<(), EvaluateError> {
        self.early.insert(idx, part);
        while let Some(part) = self.early.remove(&self.turn) {
            self.turn += 1;
            let BagPart { bag, outcome, .. } = part;
            match outcome {
                Ok(scored) => self.handle_scored(scored)?,
                Err(error) => self.failed.push(FailedBag { bag, error }),
            }
        }
        Ok(())
    }

    fn handle_scored(&mut self, scored: ScoredBag) -> Result<(), EvaluateError> {
        let ScoredBag { summary, evaluations, stretches } = scored;
        let new = || Evaluation::new(Scoring::default());
        self.evaluations.resize_with(evaluations.len().max(self.evaluations.len()), new);
        self.evaluations.iter_mut().zip(&evaluations).try_for_each(|(ours, of_bag)| ours.merge(of_bag))?;
        stretches.into_iter().for_each(|found| self.stretches.handle(found));
        self.sessions.push(summary);
        Ok(())
    }

    /// Everything that was found.
    pub(super) fn finish(self, head: &Head) -> Result<Evaluated, EvaluateError> {
        let Gathered { mut evaluations, sessions, failed, stretches, .. } = self;
        evaluations.resize_with(head.series.len(), || Evaluation::new(Scoring::default()));
        if let (true, [first, rest @ ..]) = (sessions.is_empty(), failed.as_slice()) {
            let first = first.error.clone();
            return Err(match rest.len() {
                0 => EvaluateError::OneFailed { first },
                n => EvaluateError::AllFailed { n: n + 1, first },
            });
        }
        let all: Vec<(&Series, Evaluation)> = head.series.iter().zip(evaluations).collect();
        let (degraded, mut series): (Vec<_>, Vec<_>) = all.into_iter().partition(|(one, _)| one.quality.is_some());
        // Estimates of a model without a tactile-only branch have no base.
        series.retain(|(one, evaluation)| {
            one.which != Which::Base || one.source != SeriesSource::Recorded || has_frames(evaluation)
        });
        let mut models = Vec::new();
        let mut evidence = Evidence { stretches: stretches.finish(), latencies: Vec::new() };
        for (idx, (one, evaluation)) in series.iter().enumerate() {
            evidence.latencies.extend(evaluation.detections().map(|(glove, detection)| Latencies {
                series: idx,
                glove: glove.to_owned(),
                onset: detection.onsets_ms().to_vec(),
                offset: detection.offsets_ms().to_vec(),
            }));
            let core = match one.source {
                SeriesSource::Core(idx) => head.models.get(idx),
                SeriesSource::Recorded => None,
            };
            models.push(ModelScores {
                name: one.name.clone(),
                sha256: core.map(|core| core.sha256.clone()).filter(|sha256| !sha256.is_empty()),
                path: core.map(|core| core.path.clone()),
                touch_by: if evaluation.is_by_touch() { TOUCH_OUTPUT } else { "force" },
                by: scores(|by| evaluation.scores(by))?,
                free_movement: scores(|by| group_scores(&evaluation.free_movement, by))?,
                contacts: evaluation.contacts(),
                curves: evaluation.curves()?,
                densities: evaluation.densities(),
            });
        }
        let table = table(&series, |evaluation| evaluation.scores(GroupBy::Glove))?;
        let free = table_of_free(&series)?;
        let named: Vec<_> = models.iter().map(|model| (model.name.as_str(), &model.contacts)).collect();
        let headline = Headline::of(&named, &table);
        Ok(Evaluated {
            synthetic: sessions.iter().any(|session| session.synthetic),
            tool_version: env!("CARGO_PKG_VERSION"),
            command: std::env::args().collect(),
            scoring: Scoring::default(),
            scored: what_is_scored(head.split),
            split: head.split,
            headline,
            models,
            improvements: table.improvements(),
            table,
            free_movement_table: free,
            paired: pairings(&series, head.n_compared)?,
            sessions,
            failed,
            pose_quality: pose_quality(&degraded)?,
            checks: Vec::new(),
            evidence,
        })
    }
}

type Scored<'a> = (&'a Series, Evaluation);

/// True if some frame has an estimate.
fn has_frames(evaluation: &Evaluation) -> bool {
    let scores = evaluation.scores(GroupBy::All);
    scores.is_ok_and(|scores| scores.iter().any(|one| one.score.mae_gf.value().is_some()))
}

fn pose_quality(degraded: &[Scored<'_>]) -> Result<Vec<PoseQualityScores>, EvaluateError> {
    let scores = degraded.iter().filter_map(|(one, evaluation)| {
        let quality = one.quality?;
        Some(evaluation.scores(GroupBy::Glove).map(|scores| PoseQualityScores { quality, scores }))
    });
    Ok(scores.collect::<Result<_, _>>()?)
}

fn scores(
    of: impl Fn(GroupBy) -> Result<Vec<GroupScore>, MetricError>,
) -> Result<BTreeMap<&'static str, Vec<GroupScore>>, EvaluateError> {
    GROUPS.iter().map(|by| Ok((by.name(), of(*by)?))).collect()
}

type MetricResult<T> = Result<T, MetricError>;

fn table(
    series: &[Scored<'_>],
    of: impl Fn(&Evaluation) -> MetricResult<Vec<GroupScore>>,
) -> Result<ResultTable, EvaluateError> {
    let mut rows: Vec<(&str, BTreeMap<String, Score>)> = Vec::new();
    for (one, evaluation) in series {
        let scores = of(evaluation)?;
        let by_group = scores.into_iter().map(|GroupScore { group, score }| (group.to_string(), score)).collect();
        rows.push((&one.name, by_group));
    }
    Ok(ResultTable::new(rows.iter().map(|(name, scores)| (*name, scores))))
}

fn table_of_free(series: &[Scored<'_>]) -> Result<ResultTable, EvaluateError> {
    table(series, |evaluation| group_scores(&evaluation.free_movement, GroupBy::Glove))
}

/// Tests of the judged series against each baseline, and of the corrected force against the base of the same model.
fn pairings(series: &[Scored<'_>], n_compared: usize) -> Result<Vec<Pairing>, EvaluateError> {
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
