//! Sessions, ready to be trained on.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::load::TrainingLoader;
use super::others::{artifacts_of_others, by_others};
use super::report::SessionNotes;
use super::{Request, TrainingError};
use crate::config::Config;
use crate::eval::Part;
use crate::fusion::{ArtifactModel, ForceAxes, PoseRange, RegionTerms};
use crate::observer::{self, Observer};
use crate::train::{
    ContactAxes, Dataset, Kind, Session, TouchedSession, TrainError, WindowSpec, fit_artifact, pose_range,
};

/// Frames in a window; the paper's.
const WINDOW: NonZeroUsize = NonZeroUsize::new(64).expect("it is above 0");

/// Frames from one window to the next where the network is judged: neighbours say nearly the same. `tpf eval` takes all.
const EVAL_STRIDE: usize = 10;

/// A light touch, gF: up to about this the adaptive network sees taxels in full.
const LIGHT_TOUCH_GF: f64 = 10.0;

pub(super) struct Data {
    pub(super) dataset: Dataset,
    pub(super) notes: Vec<SessionNotes>,
    /// Copies of the sessions with held touches.
    n_copies: usize,
    pub(super) rate_hz: f64,
    pub(super) glove: String,
    /// Of the joints that a region needs; empty where it needs none, or where there are several regions.
    pub(super) pose_range: Vec<PoseRange>,
    /// Of the region, where there is one.
    pub(super) artifact: Option<Arc<ArtifactModel>>,
    /// By their names, where there are several.
    pub(super) regions: BTreeMap<String, RegionTerms>,
    /// The axes of a force that has three.
    pub(super) axes: Option<ContactAxes>,
}

/// Which bags a region is trained on: those that have its true force.
struct OfRegion<'c> {
    loader: TrainingLoader<'c>,
    bags: Vec<usize>,
}

impl Data {
    pub(super) fn load(
        cfg: &Config,
        bags: &[PathBuf],
        request: &Request,
        observer: &dyn Observer,
    ) -> Result<Self, TrainingError> {
        let kind = request.train.kind;
        let cfgs: Vec<Config> = cfg.fusion().region_idxs().filter_map(|region| cfg.clone().only(region)).collect();
        let mut loaded = of_regions(&cfgs, bags, request)?;
        note_on_axes(cfg, request, observer);
        let is_one = loaded.len() == 1;
        let n_reads = loaded.iter().map(|region| region.bags.len()).sum::<usize>() as u64;
        let total = match (kind, request.held_touches as u64) {
            (Kind::Adaptive, 0) => 2 * n_reads,
            (Kind::Adaptive, n_copies) => n_reads * (3 + n_copies),
            _ => n_reads,
        };
        let mut n_read = 0;
        let mut count = || {
            n_read += 1;
            observer.progress(n_read, total);
        };
        let mut terms: BTreeMap<String, RegionTerms> = BTreeMap::new();
        // By region, for copies: sessions, and the artifact models of others than their users. Empty where there are to be none.
        let mut raws: Vec<(Vec<Session>, Vec<Arc<ArtifactModel>>)> = Vec::new();
        if kind == Kind::Adaptive {
            // Once to learn what pose makes of the taxels, and once more by the core that takes it out.
            for OfRegion { loader, bags: of_region } in &mut loaded {
                let (mut raw, mut users) = (Vec::new(), Vec::new());
                for bag in &*of_region {
                    let loaded = loader.load(&bags[*bag], observer)?;
                    raw.push(loaded.session);
                    users.push(loaded.notes.user);
                    count();
                }
                let of_region = |error: TrainError| match is_one {
                    true => TrainingError::Train(error),
                    false => TrainingError::at(Path::new(&format!("region {}", loader.region())), &error),
                };
                let sessions: Vec<&Session> = raw.iter().collect();
                let mut artifact = fit_artifact(&sessions, loader.rate_hz()).map_err(of_region)?;
                artifact.trust_inputs = request.held_touches > 0;
                let artifact = Arc::new(artifact);
                let (joints, name) = (loader.joints().to_vec(), loader.region().to_owned());
                terms.insert(
                    name,
                    RegionTerms { joints, pose_range: pose_range(&raw), artifact: Arc::clone(&artifact) },
                );
                if request.held_touches > 0 {
                    let of_others = artifacts_of_others(&raw, &users, &artifact, loader.rate_hz());
                    raws.push((raw, of_others));
                }
                loader.take_out(artifact);
            }
        }
        let (mut sessions, mut notes): (Vec<Session>, Vec<SessionNotes>) = (Vec::new(), Vec::new());
        let mut copies = Vec::new();
        for (region_idx, OfRegion { loader, bags: of_region }) in loaded.iter_mut().enumerate() {
            for (idx, &bag_idx) in of_region.iter().enumerate() {
                let mut loaded = loader.load(&bags[bag_idx], observer)?;
                count();
                let of_others = raws.get(region_idx).map(|(raw, of_others)| (&raw[idx], &of_others[idx]));
                if let Some((raw, artifact)) = of_others {
                    loaded = by_others(loader, &bags[bag_idx], loaded, artifact, observer)?;
                    count();
                    if let Some(fit) = &loaded.fit {
                        let touched = TouchedSession { raw, artifact, fit, rate_hz: loader.rate_hz() };
                        let first = sessions.len() * request.held_touches;
                        let numbers = first..first + request.held_touches;
                        let of_session = touched.copies(request.train.seed, numbers, || {
                            count();
                            Ok::<(), TrainingError>(observer::check(observer)?)
                        });
                        copies.extend(of_session?);
                    }
                }
                notes.push(SessionNotes {
                    name: loaded.session.name().to_owned(),
                    bag_idx,
                    region: (!is_one).then(|| loader.region().to_owned()),
                    user: loaded.notes.user,
                    glove: loaded.notes.glove,
                    synthetic: loaded.notes.synthetic,
                    frames: loaded.session.n_frames(),
                    frames_without_truth: loaded.n_without_truth,
                });
                sessions.push(loaded.session);
            }
        }
        let glove =
            cfg.glove.clone().or_else(|| notes.iter().find_map(|notes| notes.glove.clone())).unwrap_or_default();
        let spec = WindowSpec {
            window: WINDOW.get(),
            stride: request.stride,
            eval_stride: EVAL_STRIDE,
            outputs: 1,
            needs_pose: kind.uses_pose(),
        };
        let n_copies = copies.len();
        sessions.extend(copies);
        let dataset = Dataset::new(sessions, spec)?;
        let (mut artifact, mut ranges) = (None, Vec::new());
        if kind.uses_pose() {
            ranges = dataset.pose_range();
        } else if is_one && let Some((_, only)) = terms.pop_first() {
            (artifact, ranges) = (Some(only.artifact), only.pose_range);
        }
        let (rate_hz, axes) = (loaded[0].loader.rate_hz(), loaded[0].loader.axes());
        let data =
            Data { dataset, notes, n_copies, rate_hz, glove, pose_range: ranges, artifact, regions: terms, axes };
        observer.note(&data.summary());
        Ok(data)
    }

    fn is_synthetic(&self) -> bool {
        self.notes.iter().any(|notes| notes.synthetic)
    }

    fn summary(&self) -> String {
        let n = self.notes.len();
        let of_regions = match self.regions.len() {
            0 => String::new(),
            n => format!(" of {n} regions"),
        };
        let copies = match self.n_copies {
            0 => String::new(),
            n => format!(", and {n} copies with held light touches"),
        };
        format!(
            "{n} session{}{}{of_regions}{copies}: {} windows to train on, {} to pick the best step and {} for the test (every {EVAL_STRIDE}th window of these two parts)",
            if n == 1 { "" } else { "s" },
            if self.is_synthetic() { " (synthetic)" } else { "" },
            self.dataset.n_windows(Part::Train),
            self.dataset.n_windows(Part::Validation),
            self.dataset.n_windows(Part::Test)
        )
    }

    /// The reading of a taxel under a light touch, on average.
    pub(super) fn touch_scale(&self) -> f32 {
        let artifacts = || self.artifact.iter().chain(self.regions.values().map(|terms| &terms.artifact));
        let sum: f64 = artifacts().flat_map(|artifact| &artifact.touch).map(|touch| touch.abs()).sum();
        let n_taxels: usize = artifacts().map(|artifact| artifact.n_taxels).sum();
        if n_taxels == 0 { 1.0 } else { (LIGHT_TOUCH_GF * sum / n_taxels as f64) as f32 }
    }

    /// In words, for the model's own metadata.
    pub(super) fn trained_on(&self) -> String {
        let fingerprint = self.dataset.fingerprint();
        let what = if self.is_synthetic() { "synthetic sessions" } else { "sessions" };
        format!("{} {what}, data {}", self.notes.len(), &fingerprint[..16.min(fingerprint.len())])
    }
}

/// Each region with the bags that have its true force. A single region is trained on all bags, and refuses one without.
fn of_regions<'c>(
    cfgs: &'c [Config],
    bags: &[PathBuf],
    request: &'c Request,
) -> Result<Vec<OfRegion<'c>>, TrainingError> {
    let loader = |cfg| TrainingLoader::new(cfg, WINDOW, request.split, request.in_air.as_ref(), request.axes);
    let loaders = cfgs.iter().map(loader).collect::<Result<Vec<_>, _>>()?;
    let (first, others) = loaders.split_first().ok_or(TrainingError::SeveralRegions { n: 0, names: String::new() })?;
    if let Some(other) = others.iter().find(|other| other.rate_hz() != first.rate_hz()) {
        let [of_first, of_other] = [first, other].map(|loader| loader.region().to_owned());
        let (first_hz, other_hz) = (first.rate_hz(), other.rate_hz());
        return Err(TrainingError::Rates { first: of_first, other: of_other, first_hz, other_hz });
    }
    if others.is_empty() {
        let every = |loader| OfRegion { loader, bags: (0..bags.len()).collect() };
        return Ok(loaders.into_iter().map(every).collect());
    }
    if request.train.kind != Kind::Adaptive {
        return Err(TrainingError::OneRegion { kind: request.train.kind.name() });
    }
    let topics = bags.iter().map(|bag| TrainingLoader::topics(bag)).collect::<Result<Vec<_>, _>>()?;
    let has = |bag: usize, loader: &TrainingLoader<'_>| topics[bag].contains(loader.truth_topic());
    if let Some(bag) = (0..bags.len()).find(|bag| !loaders.iter().any(|loader| has(*bag, loader))) {
        let topics = loaders.iter().map(TrainingLoader::truth_topic).collect::<Vec<_>>().join(", ");
        return Err(TrainingError::NoTruthOfAny { path: bags[bag].display().to_string(), topics });
    }
    let of_region = |loader: TrainingLoader<'c>| {
        let bags: Vec<usize> = (0..bags.len()).filter(|bag| has(*bag, &loader)).collect();
        if bags.is_empty() {
            let (region, topic) = (loader.region().to_owned(), loader.truth_topic().to_owned());
            return Err(TrainingError::NoBag { region, topic });
        }
        Ok(OfRegion { loader, bags })
    };
    loaders.into_iter().map(of_region).collect()
}

/// Says that a true force of three axes is trained on for one only, where that is so.
fn note_on_axes(cfg: &Config, request: &Request, observer: &dyn Observer) {
    let truth = cfg.truth_of_region().first().copied().flatten().and_then(|idx| cfg.truth_sources().get(idx));
    let has_three = truth.is_some_and(|truth| truth.axes.is_some());
    if has_three && request.axes == ForceAxes::Normal && request.train.kind != Kind::Adaptive {
        observer.note(
            "the true force has three axes, and the model learns the normal force only; --axes 3 trains all three",
        );
    }
}
