//! Which series of estimates are made of every session, and how one session becomes frames that can be scored.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;

use super::super::setup::{load_models, shown, without_unused_joints};
use super::super::zero::ZeroArgs;
use super::super::{Failure, say};
use super::columns::{Core, Modelled, hold_estimates, read_estimates, run_models};
use super::labels::{Labelled, NeedsTruth, SessionSummary};
use super::{Args, scored};
use crate::config::Config;
use crate::eval::{Origin, ScoredFrames, Split, Timing};
use crate::fusion::Regressor;
use crate::glove::{Models, replace_model};
use crate::msg::EstimateTopics;
use crate::recording::{EstimateTrack, PoseQuality};

/// What is done with every session.
pub(super) struct Plan<'a> {
    pub(super) cfg: Config,
    pub(super) cores: Vec<PlannedCore>,
    /// Topic of the estimates in the bags, where those are scored.
    recorded: Option<String>,
    /// Baselines first, then what is judged, then that with its pose made worse.
    pub(super) series: Vec<Series>,
    pub(super) n_compared: usize,
    pub(super) split: Option<Split>,
    zero: &'a ZeroArgs,
    needs_truth: NeedsTruth,
}

/// A model that every worker loads for itself.
pub(super) struct PlannedCore {
    cfg: Config,
    quality: PoseQuality,
    pub(super) path: String,
    pub(super) sha256: String,
}

/// One row of the table.
pub(super) struct Series {
    pub(super) name: String,
    pub(super) source: SeriesSource,
    pub(super) which: Which,
    /// How the joint angles were made worse; `None` for the rows of the table.
    pub(super) quality: Option<PoseQuality>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SeriesSource {
    Core(usize),
    Recorded,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Which {
    Corrected,
    Base,
}

/// One session, ready to be scored.
pub(super) struct Session {
    pub(super) summary: SessionSummary,
    /// `[series][regions]`
    pub(super) frames: Vec<Vec<ScoredFrames>>,
}

impl Session {
    /// Whether all of it can be scored: asked before any of it is.
    fn check(&self) -> Result<(), Failure> {
        let checked = self.frames.iter().flatten().try_for_each(ScoredFrames::check);
        checked.map_err(|error| Failure(format!("{}: {error}", self.summary.bag)))
    }
}

impl<'a> Plan<'a> {
    /// A plan by the command line, and the models of a first worker.
    pub(super) fn new(
        args: &'a Args,
        cfg: Config,
        split: Option<Split>,
        bags: &[PathBuf],
    ) -> Result<(Self, Vec<Core>), Failure> {
        let topic = EstimateTopics::of_node(&cfg.node.to_string(), &cfg.fusion).contacts;
        let recorded = (args.model.is_none() && hold_estimates(bags, &topic)).then_some(topic);
        let mut paths: Vec<Option<&PathBuf>> = args.compare.iter().map(Some).collect();
        match &recorded {
            Some(topic) => say(&format!("scoring the estimates in the bags, {topic}")),
            None => paths.push(args.model.as_ref()),
        }
        let (mut cores, mut planned, mut series) = (Vec::new(), Vec::new(), Vec::new());
        for path in paths {
            let mut cfg = cfg.clone();
            args.backend.apply(&mut cfg);
            if let Some(path) = path {
                replace_model(&mut cfg, path.clone())?;
            }
            let models = load_models(&cfg)?;
            cfg.fusion.batch = models.batch_hint();
            without_unused_joints(&mut cfg, &models.infos);
            let name = match (path, cfg.models.as_slice()) {
                (Some(path), _) => stem(path),
                (None, [only]) => stem(&only.spec.path),
                (None, _) => "models of the parameters".to_owned(),
            };
            let source = SeriesSource::Core(cores.len());
            let is_judged = recorded.is_none() && cores.len() == args.compare.len();
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
        for quality in args.pose_quality.levels()? {
            let takes_pose =
                |core: &&PlannedCore| core.cfg.fusion.regions.iter().any(|region| !region.joints.is_empty());
            let Some(judged) = planned.get(args.compare.len()).filter(takes_pose) else {
                let reason = "worse joint angles are tried on a model that takes pose; give one by --model";
                return Err(Failure(reason.to_owned()));
            };
            let models = Models::load(&judged.cfg)?;
            let core = PlannedCore::new(judged.cfg.clone(), quality, &models);
            let source = SeriesSource::Core(cores.len());
            series.push(Series { quality: Some(quality), ..Series::new(String::new(), source, Which::Corrected) });
            cores.push(core.core(models));
            planned.push(core);
        }
        let needs_truth = if args.truth.is_some() { NeedsTruth::All } else { NeedsTruth::None };
        let n_compared = args.compare.len();
        let plan = Plan { cfg, cores: planned, recorded, series, n_compared, split, zero: &args.zero, needs_truth };
        Ok((plan, cores))
    }

    /// Index of the series that is judged.
    pub(super) fn judged(&self) -> Option<usize> {
        self.series.iter().rposition(|one| one.which == Which::Corrected && one.quality.is_none())
    }

    /// The models of one more worker.
    pub(super) fn load(&self) -> Result<Vec<Core>, Failure> {
        self.cores.iter().map(|core| Ok(core.core(Models::load(&core.cfg)?))).collect()
    }

    /// Takes every series through one bag, by a worker's models; `done` grows by the bytes that were read.
    pub(super) fn session(
        &self,
        bag: &Path,
        cores: Vec<Core>,
        done: &AtomicU64,
    ) -> Result<(Session, Vec<Core>), Failure> {
        let labelled = Labelled::read(bag, &self.cfg, self.split, self.needs_truth)?;
        let mut summary = labelled.summary(bag, &self.cfg)?;
        let Modelled { columns, cores, counters, zero, verdict, losses } =
            run_models(bag, &labelled, cores, self.zero, done)?;
        // Here the models are on trial, and one that reads force at rest gets the scores of that: it is said, not refused.
        let said = verdict.unwrap_or_else(|error| Some(error.to_string()));
        said.iter().for_each(|said| say(&format!("{}: its zero is not reliable: {said}", bag.display())));
        (summary.losses, summary.zero) = (losses, zero);
        let recorded = match &self.recorded {
            Some(topic) => {
                let (columns, losses) = read_estimates(bag, &self.cfg, topic)?;
                summary.losses.extend(losses);
                columns
            }
            None => Vec::new(),
        };
        let several = self.cfg.fusion.regions.len() > 1;
        let max_gap = self.cfg.fusion.timing.max_gap;
        let mut frames = Vec::new();
        for (series_idx, series) in self.series.iter().enumerate() {
            let is_judged = Some(series_idx) == self.judged();
            let mut of_regions = Vec::new();
            for (region_idx, region) in self.cfg.fusion.regions.iter().enumerate() {
                let (column, window_ns) = match series.source {
                    SeriesSource::Core(core) => {
                        let regressors = &cores[core].regressors;
                        (&columns[core][region_idx], window_ns(regressors[region.model].as_ref()))
                    }
                    SeriesSource::Recorded => (&recorded[region_idx], 0),
                };
                let own;
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
                let truth_idx = self.cfg.truth_of_region[region_idx];
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
            let what = scored(self.split);
            summary.warnings.push(format!("{}: {what} holds no frame with an estimate", bag.display()));
        }
        let session = Session { summary, frames };
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

    fn core(&self, models: Models) -> Core {
        let Models { infos, regressors } = models;
        Core { cfg: self.cfg.clone(), infos, quality: self.quality, regressors }
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
    ((contract.window.saturating_sub(1)) as f64 / contract.rate_hz * 1e9).round() as i64
}
