//! Which series of estimates are made of every session, and how one session becomes frames that can be scored.

use std::path::Path;
use std::sync::atomic::AtomicU64;

use serde::{Deserialize, Serialize};

use super::held_out::all_folds;
use super::session::SessionSummary;
use super::{EvaluateError, JudgeTouch, Request, what_is_scored};
use crate::bag::shown;
use crate::config::Config;
use crate::eval::{Origin, ScoredFrames, Split, Timing};
use crate::fusion::{ContactBy, ContactThresholds, RegionConfig, Regressor};
use crate::glove::{Models, replace_model, take_joints_of_models};
use crate::msg::EstimateTopics;
use crate::observer::Observer;
use crate::recording::{EstimateTrack, PoseQuality};
use crate::sessions::{
    InAir, Labelled, ModelRun, Modelled, NeedsTruth, annotated, hold_estimates, read_estimates, run_models,
};
use crate::zero::Wanted;

/// Plan of an evaluation, the same for every session.
pub(super) struct Plan<'a> {
    pub(super) cfg: Config,
    pub(super) cores: Vec<PlannedCore>,
    /// Topic of the estimates in the bags, where those are scored.
    recorded: Option<String>,
    /// Baselines first, then what is judged, then that with its pose made worse.
    pub(super) series: Vec<Series>,
    pub(super) n_compared: usize,
    pub(super) split: Option<Split>,
    zero: Wanted<'a>,
    in_air: Option<&'a InAir>,
    pub(super) observer: &'a dyn Observer,
    needs_truth: NeedsTruth,
    known_touches: Option<usize>,
}

/// A model that every worker loads for itself.
pub(super) struct PlannedCore {
    cfg: Config,
    quality: PoseQuality,
    pub(super) path: String,
    pub(super) sha256: String,
}

/// Estimates of one model or recording, corrected or not: one row of the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// Its name in results.
    pub name: String,
    pub(super) source: SeriesSource,
    pub(super) which: Which,
    /// How the joint angles were made worse; `None` for the rows of the table.
    pub quality: Option<PoseQuality>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum SeriesSource {
    Core(usize),
    Recorded,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Which {
    Corrected,
    Base,
}

/// One session, ready to be scored.
#[derive(Debug)]
pub struct SessionToScore {
    /// Its summary in results.
    pub summary: SessionSummary,
    /// `[series][regions]`, in the order of [`Series`].
    pub frames: Vec<Vec<ScoredFrames>>,
}

impl SessionToScore {
    /// Whether all of it can be scored: asked before any of it is.
    fn check(&self) -> Result<(), EvaluateError> {
        let checked = self.frames.iter().flatten().try_for_each(ScoredFrames::check);
        checked.map_err(|error| EvaluateError::in_bag(&self.summary.bag, &error))
    }
}

impl<'a> Plan<'a> {
    /// A plan, and the models of a first worker.
    pub(super) fn new(
        cfg: Config,
        request: &Request<'a>,
        observer: &'a dyn Observer,
    ) -> Result<(Self, Vec<ModelRun>), EvaluateError> {
        let topic = EstimateTopics::of_node(&cfg.node.to_string(), cfg.fusion()).contacts;
        let recorded = (request.model.is_none() && hold_estimates(request.bags, &topic)).then_some(topic);
        if recorded.is_some() && request.touch != JudgeTouch::AsTheNode {
            return Err(EvaluateError::DecidedBefore);
        }
        let mut paths: Vec<Option<&Path>> = request.compare.iter().map(|path| Some(path.as_path())).collect();
        match &recorded {
            Some(topic) => observer.note(&format!("scoring the estimates in the bags, {topic}")),
            None => paths.push(request.model),
        }
        let (mut cores, mut planned, mut series) = (Vec::new(), Vec::new(), Vec::new());
        for path in paths {
            let mut cfg = cfg.clone();
            let judged_by = |region: &RegionConfig| match request.touch {
                JudgeTouch::AsTheNode => region.contact,
                JudgeTouch::Force => ContactThresholds { by: ContactBy::Force, ..region.contact },
                JudgeTouch::Levels(levels) => {
                    ContactThresholds { by: ContactBy::Model, touch: Some(levels), ..region.contact }
                }
            };
            let thresholds: Vec<_> = cfg.fusion().regions().iter().map(judged_by).collect();
            cfg.set_thresholds(&thresholds)?;
            cfg.models_mut()
                .iter_mut()
                .for_each(|model| model.spec.backend = request.backend.unwrap_or(model.spec.backend));
            if let Some(path) = path {
                replace_model(&mut cfg, path.to_path_buf())?.iter().for_each(|note| observer.detail(note));
            }
            let models = Models::load(&cfg)?;
            models.tell(&cfg, observer);
            cfg.set_batch(models.batch_hint());
            if path.is_none() {
                take_joints_of_models(&mut cfg, &models.infos).iter().for_each(|note| observer.detail(note));
            }
            let name = match (path, cfg.models()) {
                (Some(path), _) => stem(path),
                (None, [only]) => stem(&only.spec.path),
                (None, _) => "models of the parameters".to_owned(),
            };
            let source = SeriesSource::Core(cores.len());
            let is_judged = recorded.is_none() && cores.len() == request.compare.len();
            if is_judged && models.infos.iter().any(|info| info.contract.has_base) {
                series.push(Series::new(format!("{name}, base"), source, Which::Base));
            }
            series.push(Series::new(name, source, Which::Corrected));
            planned.push(PlannedCore::new(cfg, PoseQuality::default(), &models));
            cores.extend(planned.last().map(|core| core.core(models)));
        }
        if recorded.is_some() {
            series.push(Series::new("recorded, base".to_owned(), SeriesSource::Recorded, Which::Base));
            series.push(Series::new("recorded".to_owned(), SeriesSource::Recorded, Which::Corrected));
        }
        for quality in request.pose_levels.iter().copied() {
            let takes_pose =
                |core: &&PlannedCore| core.cfg.fusion().regions().iter().any(|region| !region.joints.is_empty());
            let Some(judged) = planned.get(request.compare.len()).filter(takes_pose) else {
                return Err(EvaluateError::NoPose);
            };
            let models = Models::load(&judged.cfg)?;
            let core = PlannedCore::new(judged.cfg.clone(), quality, &models);
            let source = SeriesSource::Core(cores.len());
            series.push(Series { quality: Some(quality), ..Series::new(String::new(), source, Which::Corrected) });
            cores.push(core.core(models));
            planned.push(core);
        }
        let needs_truth = if request.needs_truth { NeedsTruth::All } else { NeedsTruth::None };
        let n_compared = request.compare.len();
        let (split, zero, in_air) = (request.split, request.zero, request.in_air);
        let known_touches = request.known_touches;
        let plan = Plan {
            cfg,
            cores: planned,
            recorded,
            series,
            n_compared,
            split,
            zero,
            in_air,
            observer,
            needs_truth,
            known_touches,
        };
        Ok((plan, cores))
    }

    /// Calls the series of a fold by the names of the models that the folds belong to.
    pub(super) fn name_held_out(&mut self, models: &[&Path]) {
        for series in &mut self.series {
            let SeriesSource::Core(core) = series.source else { continue };
            // Cores beyond are the judged one with its pose made worse.
            let of = models.get(core).or(models.last()).map(|path| stem(path)).unwrap_or_default();
            series.name = match (series.which, series.quality) {
                (_, Some(_)) => String::new(),
                (Which::Base, None) => format!("{of}, held out, base"),
                (Which::Corrected, None) => format!("{of}, held out"),
            };
        }
    }

    /// Names the folds of models, of which no one made all scores.
    pub(super) fn forget_files(&mut self, models: &[&Path]) {
        for (core, model) in self.cores.iter_mut().zip(models) {
            core.path = shown(&all_folds(model));
            core.sha256 = String::new();
        }
    }

    /// Index of the series that is judged.
    pub(super) fn judged(&self) -> Option<usize> {
        self.series.iter().rposition(|one| one.which == Which::Corrected && one.quality.is_none())
    }

    /// The models of one more worker.
    pub(super) fn load(&self) -> Result<Vec<ModelRun>, EvaluateError> {
        self.cores.iter().map(|core| Ok(core.core(Models::load(&core.cfg)?))).collect()
    }

    /// Takes every series through one bag, by a worker's models; `done` grows by the bytes that were read.
    pub(super) fn session(
        &self,
        bag: &Path,
        cores: Vec<ModelRun>,
        done: &AtomicU64,
    ) -> Result<(SessionToScore, Vec<ModelRun>), EvaluateError> {
        let cfg = annotated(&self.cfg, &[bag.to_path_buf()], self.in_air, self.observer)?;
        let mut labelled = Labelled::read(bag, &cfg, self.split, self.needs_truth, self.observer)?;
        if let Some(n) = self.known_touches {
            labelled = labelled.with_known_touches(bag, n)?;
        }
        let mut summary = SessionSummary::new(&labelled, bag, &self.cfg)?;
        let Modelled { columns, cores, counters, zero, verdict, losses } =
            run_models(bag, &labelled, cores, self.zero, done, self.observer)?;
        // Here the models are on trial, and one that reads force at rest gets the scores of that: it is said, not refused.
        let said = verdict.unwrap_or_else(|error| Some(error.to_string()));
        if let Some(said) = said {
            self.observer.warn(&format!("{}: its zero is not reliable: {said}", bag.display()));
        }
        (summary.losses, summary.zero) = (losses, zero);
        let recorded = match &self.recorded {
            Some(topic) => {
                let (columns, losses) = read_estimates(bag, &self.cfg, topic, self.observer)?;
                summary.losses.extend(losses);
                columns
            }
            None => Vec::new(),
        };
        let several = self.cfg.fusion().regions().len() > 1;
        let max_gap = self.cfg.fusion().timing().max_gap;
        let mut frames = Vec::new();
        for (series_idx, series) in self.series.iter().enumerate() {
            let is_judged = Some(series_idx) == self.judged();
            let mut of_regions = Vec::new();
            for (region_idx, region) in self.cfg.fusion().regions().iter().enumerate() {
                let (column, window_ns) = match series.source {
                    SeriesSource::Core(core) => {
                        let regressors = &cores[core].regressors;
                        (&columns[core][region_idx], window_ns(regressors[region.model.position()].as_ref()))
                    }
                    SeriesSource::Recorded => (&recorded[region_idx], 0),
                };
                let truth_idx = self.cfg.truth_of_region()[region_idx];
                let (own, scaled);
                let column = match labelled.known_gain(column, truth_idx, max_gap) {
                    Ok(None) => column,
                    Ok(Some(gain)) => {
                        scaled = column.with_gain(&gain, region.contact);
                        &scaled
                    }
                    Err(error) => {
                        let told = format!("{}: {}, region {}: {error}", bag.display(), series.name, region.name);
                        summary.warnings.push(told + "; its forces are scored as the model gives them");
                        column
                    }
                };
                let column: &EstimateTrack = match series.which {
                    Which::Corrected => column,
                    Which::Base => {
                        own = column.base_alone(region.contact);
                        &own
                    }
                };
                let glove = if several { format!("{}/{}", summary.glove, region.name) } else { summary.glove.clone() };
                let origin =
                    Origin { glove, user: summary.user.clone(), session: summary.name.clone(), ..Origin::default() };
                let frames = labelled.frames(column, truth_idx, window_ns, max_gap, region.contact, &origin);
                if is_judged {
                    let without = frames.truth_gf.iter().filter(|truth| !truth.is_finite()).count();
                    summary.frames_scored = summary.frames_scored.max(frames.stamp.len());
                    summary.frames_without_truth = summary.frames_without_truth.max(without);
                    summary.timing.insert(region.name.clone(), Timing::of(&frames, max_gap));
                }
                of_regions.push(frames);
            }
            if let SeriesSource::Core(core) = series.source
                && is_judged
            {
                summary.counters = counters.get(core).cloned();
            }
            frames.push(of_regions);
        }
        if summary.frames_scored == 0 {
            let what = what_is_scored(self.split);
            summary.warnings.push(format!("{}: {what} holds no frame with an estimate", bag.display()));
        }
        let session = SessionToScore { summary, frames };
        session.check()?;
        Ok((session, cores))
    }
}

impl PlannedCore {
    fn new(cfg: Config, quality: PoseQuality, models: &Models) -> Self {
        let first = models.infos.first();
        let path = first.map(|info| shown(&info.path)).unwrap_or_default();
        let sha256 = first.map(|info| info.sha256.clone()).unwrap_or_default();
        PlannedCore { cfg, quality, path, sha256 }
    }

    fn core(&self, models: Models) -> ModelRun {
        let Models { infos, regressors } = models;
        ModelRun { cfg: self.cfg.clone(), infos, quality: self.quality, regressors }
    }
}

impl Series {
    fn new(name: String, source: SeriesSource, which: Which) -> Self {
        Series { name, source, which, quality: None }
    }
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| path.display().to_string(), |stem| stem.to_string_lossy().into_owned())
}

/// From the first frame of a model's window to its last.
fn window_ns(regressor: &dyn Regressor) -> i64 {
    let contract = regressor.contract();
    ((contract.window.get() - 1) as f64 / contract.rate_hz * 1e9).round() as i64
}
