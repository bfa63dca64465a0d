//! All series of estimates over all sessions, and what comes out of it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::super::setup::{load_models, replace_model, shown, without_unused_joints};
use super::super::zero::ZeroArgs;
use super::super::{Failure, say};
use super::pose_quality::PoseQualityScores;
use super::session::{Core, Labelled, Modelled, SessionSummary, hold_estimates, read_estimates, run_models};
use super::{Args, scored};
use crate::config::Config;
use crate::eval::{
    Check, ContactReport, Evaluation, GroupBy, GroupScore, Improvement, Origin, PairedTest, ResultTable, Score,
    Scoring, Split, group_scores, paired_by_user,
};
use crate::fusion::Regressor;
use crate::msg::EstimateTopics;
use crate::recording::PoseQuality;

/// Frames in one inference call.
const BATCH: usize = 32;

/// Every series of estimates, session after session.
pub(super) struct Runs {
    cfg: Config,
    cores: Vec<Core>,
    /// Topic of the estimates in the bags, where those are scored.
    recorded: Option<String>,
    /// Baselines first, then what is judged.
    series: Vec<Series>,
    sessions: Vec<SessionSummary>,
}

/// One row of the table.
struct Series {
    name: String,
    source: SeriesSource,
    which: Which,
    /// How the joint angles were made worse; `None` for the rows of the table.
    quality: Option<PoseQuality>,
    evaluation: Evaluation,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum SeriesSource {
    Core(usize),
    Recorded,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Which {
    Corrected,
    Base,
}

/// Everything that was found.
#[derive(Debug, Serialize)]
pub(in crate::commands) struct Evaluated {
    /// Whether any session is no recording but made by a simulator.
    pub(super) synthetic: bool,
    tool_version: &'static str,
    command: Vec<String>,
    scoring: Scoring,
    /// What was scored, in words.
    pub(super) scored: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    split: Option<Split>,
    pub(super) sessions: Vec<SessionSummary>,
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

/// The scores of one series.
#[derive(Debug, Serialize)]
pub(super) struct ModelScores {
    pub(super) name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    path: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sha256: Option<String>,
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

impl Runs {
    pub(super) fn new(args: &Args, cfg: Config, bags: &[PathBuf]) -> Result<Self, Failure> {
        let topic = EstimateTopics::of_node(&cfg.node.to_string(), &cfg.fusion).contacts;
        let recorded = (args.model.is_none() && hold_estimates(bags, &topic)?).then_some(topic);
        let mut paths: Vec<Option<&PathBuf>> = args.compare.iter().map(Some).collect();
        match &recorded {
            Some(topic) => say(&format!("scoring the estimates in the bags, {topic}")),
            None => paths.push(args.model.as_ref()),
        }
        let (mut cores, mut series) = (Vec::new(), Vec::new());
        for path in paths {
            let mut cfg = cfg.clone();
            cfg.fusion.batch = BATCH;
            args.backend.apply(&mut cfg);
            if let Some(path) = path {
                replace_model(&mut cfg, path)?;
            }
            let models = load_models(&cfg)?;
            without_unused_joints(&mut cfg, &models.infos);
            let name = match (path, cfg.models.as_slice()) {
                (Some(path), _) => stem(path),
                (None, [only]) => stem(&only.spec.path),
                (None, _) => "models of the parameters".to_owned(),
            };
            let source = SeriesSource::Core(cores.len());
            let is_judged = recorded.is_none() && cores.len() == args.compare.len();
            if is_judged && models.infos.iter().any(|info| info.contract.has_base) {
                series.push(Series::new(format!("{name}, base"), source.clone(), Which::Base));
            }
            series.push(Series::new(name, source, Which::Corrected));
            let quality = PoseQuality::default();
            cores.push(Core { cfg, infos: models.infos, quality, regressors: models.regressors });
        }
        for quality in args.pose_quality.levels()? {
            let takes_pose = |core: &&Core| core.cfg.fusion.regions.iter().any(|region| !region.joints.is_empty());
            let judged = cores.get(args.compare.len()).filter(takes_pose);
            let Some(judged) = judged else {
                let reason = "worse joint angles are tried on a model that takes pose; give one by --model";
                return Err(Failure(reason.to_owned()));
            };
            let cfg = judged.cfg.clone();
            let models = load_models(&cfg)?;
            let source = SeriesSource::Core(cores.len());
            series.push(Series { quality: Some(quality), ..Series::new(String::new(), source, Which::Corrected) });
            cores.push(Core { cfg, infos: models.infos, quality, regressors: models.regressors });
        }
        if recorded.is_some() {
            series.push(Series::new("recorded, base".to_owned(), SeriesSource::Recorded, Which::Base));
            series.push(Series::new("recorded".to_owned(), SeriesSource::Recorded, Which::Corrected));
        }
        Ok(Runs { cfg, cores, recorded, series, sessions: Vec::new() })
    }

    /// Scores one bag with every series.
    pub(super) fn handle_session(&mut self, bag: &Path, split: Option<Split>, zero: &ZeroArgs) -> Result<(), Failure> {
        let labelled = Labelled::read(bag, &self.cfg, split)?;
        let mut summary = labelled.summary(bag, &self.cfg);
        let Modelled { columns, cores, losses } = run_models(bag, &labelled, std::mem::take(&mut self.cores), zero)?;
        self.cores = cores;
        summary.losses = losses;
        let recorded = match &self.recorded {
            Some(topic) => {
                let (columns, losses) = read_estimates(bag, &self.cfg, topic)?;
                summary.losses.extend(losses);
                columns
            }
            None => Vec::new(),
        };
        let several = self.cfg.truth_of_region.iter().flatten().count() > 1;
        for series in &mut self.series {
            for (region_idx, region) in self.cfg.fusion.regions.iter().enumerate() {
                let Some(truth_idx) = self.cfg.truth_of_region[region_idx] else { continue };
                let (column, window_ns) = match &series.source {
                    SeriesSource::Core(core) => {
                        let regressors = &self.cores[*core].regressors;
                        (&columns[*core][region_idx], window_ns(regressors[region.model].as_ref()))
                    }
                    SeriesSource::Recorded => (&recorded[region_idx], 0),
                };
                let own;
                let column = match series.which {
                    Which::Corrected => column,
                    Which::Base => {
                        own = column.base_alone(region.contact);
                        &own
                    }
                };
                let glove = if several { format!("{}/{}", summary.glove, region.name) } else { summary.glove.clone() };
                let origin =
                    Origin { glove, user: summary.user.clone(), session: summary.name.clone(), ..Origin::default() };
                let max_gap = self.cfg.fusion.timing.max_gap;
                let frames = labelled.frames(column, truth_idx, window_ns, max_gap, region.contact, &origin);
                summary.frames_scored = summary.frames_scored.max(frames.stamp.len());
                summary.frames_without_truth = frames.truth_gf.iter().filter(|truth| !truth.is_finite()).count();
                let scored = series.evaluation.handle_session(&frames);
                scored.map_err(|error| Failure(format!("{}: {error}", bag.display())))?;
            }
        }
        if summary.frames_scored == 0 {
            let what = scored(split);
            summary.warnings.push(format!("{}: {what} holds no frame with an estimate", bag.display()));
        }
        self.sessions.push(summary);
        Ok(())
    }

    /// Everything that was found.
    pub(super) fn finish(self, args: &Args, split: Option<Split>) -> Result<Evaluated, Failure> {
        let Runs { cores, series, sessions, .. } = self;
        let (degraded, series): (Vec<_>, Vec<_>) = series.into_iter().partition(|one| one.quality.is_some());
        let mut models = Vec::new();
        for one in &series {
            let core = match one.source {
                SeriesSource::Core(idx) => cores.get(idx),
                SeriesSource::Recorded => None,
            };
            let info = core.and_then(|core| core.infos.first());
            models.push(ModelScores {
                name: one.name.clone(),
                sha256: info.map(|info| info.sha256.clone()),
                path: info.map(|info| shown(&info.path)),
                by: scores(|by| one.evaluation.scores(by))?,
                free_movement: scores(|by| group_scores(&one.evaluation.free_movement, by))?,
                contacts: one.evaluation.contacts(),
            });
        }
        let table = table(&series, |evaluation| evaluation.scores(GroupBy::Glove))?;
        let free = table_of_free(&series)?;
        Ok(Evaluated {
            synthetic: sessions.iter().any(|session| session.synthetic),
            tool_version: env!("CARGO_PKG_VERSION"),
            command: std::env::args().collect(),
            scoring: Scoring::default(),
            scored: scored(split),
            split,
            models,
            improvements: table.improvements(),
            table,
            free_movement_table: free,
            paired: pairings(&series, args.compare.len())?,
            sessions,
            pose_quality: pose_quality(&degraded)?,
            checks: Vec::new(),
        })
    }
}

impl Series {
    fn new(name: String, source: SeriesSource, which: Which) -> Self {
        Series { name, source, which, quality: None, evaluation: Evaluation::new(Scoring::default()) }
    }
}

fn pose_quality(degraded: &[Series]) -> Result<Vec<PoseQualityScores>, Failure> {
    let scores = degraded.iter().filter_map(|one| {
        let quality = one.quality?;
        Some(one.evaluation.scores(GroupBy::Glove).map(|scores| PoseQualityScores { quality, scores }))
    });
    Ok(scores.collect::<Result<_, _>>()?)
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| path.display().to_string(), |stem| stem.to_string_lossy().into_owned())
}

/// From the first frame of a model's window to its last.
fn window_ns(regressor: &dyn Regressor) -> i64 {
    let contract = regressor.contract();
    ((contract.window.saturating_sub(1)) as f64 / contract.rate_hz * 1e9).round() as i64
}

fn scores<E: std::error::Error>(
    of: impl Fn(GroupBy) -> Result<Vec<GroupScore>, E>,
) -> Result<BTreeMap<&'static str, Vec<GroupScore>>, Failure> {
    GROUPS.iter().map(|by| Ok((by.name(), of(*by)?))).collect()
}

type MetricResult<T> = Result<T, crate::eval::MetricError>;

fn table(series: &[Series], of: impl Fn(&Evaluation) -> MetricResult<Vec<GroupScore>>) -> Result<ResultTable, Failure> {
    let mut rows: Vec<(&str, BTreeMap<String, Score>)> = Vec::new();
    for one in series {
        let scores = of(&one.evaluation)?;
        let by_group = scores.into_iter().map(|GroupScore { group, score }| (group.to_string(), score)).collect();
        rows.push((&one.name, by_group));
    }
    Ok(ResultTable::new(rows.iter().map(|(name, scores)| (*name, scores))))
}

fn table_of_free(series: &[Series]) -> Result<ResultTable, Failure> {
    table(series, |evaluation| group_scores(&evaluation.free_movement, GroupBy::Glove))
}

/// What is judged against each baseline, and the corrected force against the base of the same model.
fn pairings(series: &[Series], n_compared: usize) -> Result<Vec<Pairing>, Failure> {
    let Some(judged) = series.iter().rfind(|one| one.which == Which::Corrected) else { return Ok(Vec::new()) };
    let is_baseline = |one: &&Series| match one.source {
        SeriesSource::Core(core) => core < n_compared && one.which == Which::Corrected,
        SeriesSource::Recorded => false,
    };
    let own_base = series.iter().filter(|one| one.which == Which::Base && one.source == judged.source);
    let mut pairings = Vec::new();
    for from in series.iter().filter(is_baseline).chain(own_base) {
        pairings.push(Pairing {
            from: from.name.clone(),
            to: judged.name.clone(),
            tests: paired_by_user(&from.evaluation.all, &judged.evaluation.all)?,
            free_movement_tests: paired_by_user(&from.evaluation.free_movement, &judged.evaluation.free_movement)?,
        });
    }
    Ok(pairings)
}
