//! Sessions, ready to be trained on.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

use super::load::TrainingLoader;
use super::report::SessionNotes;
use super::{Request, TrainingError};
use crate::config::Config;
use crate::eval::Part;
use crate::fusion::{ArtifactModel, ForceAxes, PoseRange};
use crate::observer::Observer;
use crate::train::{ContactAxes, Dataset, Kind, Session, WindowSpec, fit_artifact, pose_range};

/// Frames in a window; the paper's.
const WINDOW: NonZeroUsize = NonZeroUsize::new(64).expect("it is above 0");

/// Frames from one window to the next where the network is judged: neighbours say nearly the same. `tpf eval` takes all.
const EVAL_STRIDE: usize = 10;

/// A light touch, gF: up to about this the adaptive network sees taxels in full.
const LIGHT_TOUCH_GF: f64 = 10.0;

pub(super) struct Data {
    pub(super) dataset: Dataset,
    pub(super) notes: Vec<SessionNotes>,
    pub(super) rate_hz: f64,
    pub(super) glove: String,
    /// Of the joints that a region needs; empty where it needs none.
    pub(super) pose_range: Vec<PoseRange>,
    pub(super) artifact: Option<Arc<ArtifactModel>>,
    /// The axes of a force that has three.
    pub(super) axes: Option<ContactAxes>,
}

impl Data {
    pub(super) fn load(
        cfg: &Config,
        bags: &[PathBuf],
        request: &Request,
        observer: &dyn Observer,
    ) -> Result<Self, TrainingError> {
        let kind = request.train.kind;
        let mut loader = TrainingLoader::new(cfg, WINDOW, request.split, request.in_air.as_ref(), request.axes)?;
        note_on_axes(cfg, request, observer);
        let n_passes = if kind == Kind::Adaptive { 2 } else { 1 };
        let total = (n_passes * bags.len()) as u64;
        let (mut artifact, mut ranges) = (None, Vec::new());
        if kind == Kind::Adaptive {
            // Once to learn what pose makes of the taxels, and once more by the core that takes it out.
            let mut raw = Vec::new();
            for (idx, bag) in bags.iter().enumerate() {
                raw.push(loader.load(bag, observer)?.session);
                observer.progress(idx as u64 + 1, total);
            }
            let found = Arc::new(fit_artifact(&raw, loader.rate_hz())?);
            artifact = Some(Arc::clone(&found));
            ranges = pose_range(&raw);
            loader = loader.with_artifact(found);
        }
        let n_read = total - bags.len() as u64;
        let (mut sessions, mut notes): (Vec<Session>, Vec<SessionNotes>) = (Vec::new(), Vec::new());
        for (idx, bag) in bags.iter().enumerate() {
            let loaded = loader.load(bag, observer)?;
            observer.progress(n_read + idx as u64 + 1, total);
            notes.push(SessionNotes {
                name: loaded.session.name().to_owned(),
                user: loaded.notes.user,
                glove: loaded.notes.glove,
                synthetic: loaded.notes.synthetic,
                frames: loaded.session.n_frames(),
                frames_without_truth: loaded.n_without_truth,
            });
            sessions.push(loaded.session);
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
        let dataset = Dataset::new(sessions, spec)?;
        if kind.uses_pose() {
            ranges = dataset.pose_range();
        }
        let (rate_hz, axes) = (loader.rate_hz(), loader.axes());
        let data = Data { dataset, notes, rate_hz, glove, pose_range: ranges, artifact, axes };
        observer.note(&data.summary());
        Ok(data)
    }

    fn is_synthetic(&self) -> bool {
        self.notes.iter().any(|notes| notes.synthetic)
    }

    fn summary(&self) -> String {
        let n = self.notes.len();
        format!(
            "{n} session{}{}: {} windows to train on; {} to pick the best step and {} kept for the test, which are every {EVAL_STRIDE}th of their parts",
            if n == 1 { "" } else { "s" },
            if self.is_synthetic() { " (synthetic)" } else { "" },
            self.dataset.n_windows(Part::Train),
            self.dataset.n_windows(Part::Validation),
            self.dataset.n_windows(Part::Test)
        )
    }

    /// The reading of a taxel under a light touch, on average.
    pub(super) fn touch_scale(&self) -> f32 {
        let of = |artifact: &Arc<ArtifactModel>| {
            let sum: f64 = artifact.touch.iter().map(|touch| touch.abs()).sum();
            (LIGHT_TOUCH_GF * sum / artifact.n_taxels as f64) as f32
        };
        self.artifact.as_ref().map_or(1.0, of)
    }

    /// In words, for the model's own metadata.
    pub(super) fn trained_on(&self) -> String {
        let fingerprint = self.dataset.fingerprint();
        let what = if self.is_synthetic() { "synthetic sessions" } else { "sessions" };
        format!("{} {what}, data {}", self.notes.len(), &fingerprint[..16.min(fingerprint.len())])
    }
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
