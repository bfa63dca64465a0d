//! From annotated recordings to a model file with its report: what `tpf train` does.
//!
//! [`run`] reads the bags by the core that also runs live, trains with [`train`](crate::train), puts the model to the test on
//! the part of each session that is kept for it, and writes both files. [`hold_out`] does so without each user, or
//! without each donning, and scores every model on what it never saw.

mod data;
mod error;
mod folds;
mod load;
mod others;
mod report;

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

pub use error::TrainingError;
pub use folds::{HeldOutScores, HoldOut, check_folds, check_hold_out, hold_out};
pub use report::{Report, Run, SessionNotes, Test};

use self::data::Data;
use crate::config::Config;
use crate::eval::{Part, Split, SplitBy};
use crate::files;
use crate::fusion::{ForceAxes, RegionIdx};
use crate::location;
use crate::observer::Observer;
use crate::sessions::InAir;
use crate::train::{
    Checkpoint, ContactAxes, Dataset, GraphForm, Kind, LossConfig, ModelCard, Progress, Schedule, TrainConfig, Trainer,
    calibrate_touch, onnx_model,
};

/// Share of the time, the last of it, that is kept for the test; the paper's.
pub const TEST_SHARE: f64 = 0.2;

/// Share of the time that picks the best step: taken from what the paper trains on, so that its test stays unseen.
pub const VALIDATION_SHARE: f64 = 0.08;

/// Share of the training windows in the air that get a light touch, for an adaptive model.
const LIGHT_TOUCHES: f32 = 0.2;

/// Copies of each session with held touches, for an adaptive model (docs/validation/2026-11-26-trust.md).
const HELD_TOUCHES: usize = 4;

/// Most copies of a session: each takes as much memory as the session.
const MAX_HELD_TOUCHES: usize = 64;

/// Steps of an adaptive model: its small network still improves where the paper's no longer does.
const ADAPTIVE_STEPS: u64 = 12_000;

/// The model to train, and how.
#[derive(Debug, Clone)]
pub struct Request {
    /// The model to write, whose name ends with `.onnx`; the report goes beside it.
    pub output: PathBuf,
    /// Kind, seed, steps, losses: [`new`](Self::new) has the defaults of each kind.
    pub train: TrainConfig,
    /// Passes over the training windows, in place of the steps.
    pub epochs: Option<f64>,
    /// Weights of the auxiliary loss to try, one after the other: the model with the smallest validation loss is kept.
    /// Empty for that of [`train`](Self::train).
    pub lambdas: Vec<f32>,
    /// Copies of each session in whose air light touches are held, for an adaptive model: its network also gets how far corrected
    /// taxels can be trusted. 0 for one that gets the taxels alone.
    pub held_touches: usize,
    /// Frames from one training window to the next.
    pub stride: usize,
    /// Axes of the force: the normal force, or all three, for which the true force must have them.
    pub axes: ForceAxes,
    /// Source for the times at which nothing touches the glove; `None` for the annotations of the recordings.
    pub in_air: Option<InAir>,
    /// Where sessions are cut: the validation and test parts are kept apart from training.
    pub split: Split,
    /// Threads; they change how long it takes and not what comes out.
    pub threads: usize,
    /// How the graph is written.
    pub form: GraphForm,
    /// Whether to go on from the checkpoint of a run that was interrupted.
    pub resume: bool,
    /// Whether to replace a model that is already there.
    pub overwrite: bool,
    /// The command line, for the report; empty where there is none.
    pub command: Vec<String>,
}

impl Request {
    /// A model of a kind with the defaults.
    pub fn new(kind: Kind, output: PathBuf) -> Self {
        let is_adaptive = kind == Kind::Adaptive;
        let steps = if is_adaptive { ADAPTIVE_STEPS } else { Schedule::default().steps };
        Request {
            output,
            train: TrainConfig {
                kind,
                schedule: Schedule { steps, ..Schedule::default() },
                light_touches: if is_adaptive { LIGHT_TOUCHES } else { 0.0 },
                ..TrainConfig::default()
            },
            epochs: None,
            lambdas: Vec::new(),
            held_touches: if is_adaptive { HELD_TOUCHES } else { 0 },
            stride: 1,
            axes: ForceAxes::Normal,
            in_air: None,
            split: Split::new(SplitBy::Stage, VALIDATION_SHARE, TEST_SHARE).expect("these shares are less than all"),
            threads: std::thread::available_parallelism().map_or(1, NonZero::get),
            form: GraphForm::Fast,
            resume: false,
            overwrite: false,
            command: Vec::new(),
        }
    }

    /// Checks that nothing is in the way of the output: before hours of work, not after.
    ///
    /// # Errors
    /// [`TrainingError`] where the name is not that of a model, or something is there already.
    pub fn check(&self) -> Result<(), TrainingError> {
        let path = self.output.clone();
        if path.extension().is_none_or(|extension| extension != "onnx") {
            return Err(TrainingError::NotOnnx { path });
        }
        let is_of_adaptive = self.train.light_touches > 0.0 || self.held_touches > 0;
        if is_of_adaptive && self.train.kind != Kind::Adaptive {
            return Err(TrainingError::LightTouches);
        }
        if self.held_touches > MAX_HELD_TOUCHES {
            return Err(TrainingError::HeldTouches { got: self.held_touches, most: MAX_HELD_TOUCHES });
        }
        location::only_here(&path).map_err(|error| TrainingError::at(&path, &error))?;
        if self.axes == ForceAxes::Patch && self.train.kind == Kind::Adaptive {
            return Err(TrainingError::AdaptiveAxes);
        }
        if self.overwrite {
            return Ok(());
        }
        if let Some(path) = [path, self.report()].into_iter().find(|file| file.exists()) {
            return Err(TrainingError::Exists { path });
        }
        let mut checkpoints = self.lambdas().into_iter().map(|lambda| self.checkpoint(lambda));
        match checkpoints.find(|checkpoint| checkpoint.exists()).filter(|_| !self.resume) {
            Some(path) => Err(TrainingError::Unfinished { path }),
            None => Ok(()),
        }
    }

    /// The report beside the model.
    pub fn report(&self) -> PathBuf {
        self.output.with_extension("report.json")
    }

    fn lambdas(&self) -> Vec<f32> {
        if self.lambdas.is_empty() { vec![self.train.loss.lambda] } else { self.lambdas.clone() }
    }

    fn checkpoint(&self, lambda: f32) -> PathBuf {
        match self.lambdas.len() {
            0 | 1 => self.output.with_extension("checkpoint.json"),
            _ => self.output.with_extension(format!("lambda-{lambda}.checkpoint.json")),
        }
    }

    /// The settings of a run, for so many training windows.
    fn settings(&self, lambda: f32, n_windows: usize, touch_scale: f32, axes: Option<ContactAxes>) -> TrainConfig {
        let steps = match self.epochs {
            Some(epochs) => (epochs * (n_windows / self.train.batch.clamp(1, n_windows.max(1))) as f64).ceil() as u64,
            None => self.train.schedule.steps,
        };
        TrainConfig {
            schedule: Schedule { steps, ..self.train.schedule },
            loss: LossConfig { lambda, ..self.train.loss },
            touch_scale,
            axes,
            ..self.train.clone()
        }
    }
}

/// The configuration of the named regions, or of the only one, without joints where the network takes none.
///
/// # Errors
/// [`TrainingError`] where the parameters have several regions and none is named, none of that name, one twice, or no joints
/// that the network needs.
pub fn for_regions(cfg: Config, named: &[String], kind: Kind) -> Result<Config, TrainingError> {
    let names = cfg.fusion().regions().iter().map(|region| region.name.as_str()).collect::<Vec<_>>().join(", ");
    let mut found = Vec::new();
    for name in named {
        let no_such = || TrainingError::NoSuchRegion { name: name.clone(), names: names.clone() };
        let idx = cfg.fusion().region_named(name).ok_or_else(no_such)?;
        if found.contains(&idx) {
            return Err(TrainingError::RegionTwice { name: name.clone() });
        }
        found.push(idx);
    }
    match (found.len(), cfg.fusion().regions().len()) {
        (0, 1) => found.push(RegionIdx::at(0)),
        (0, n) => return Err(TrainingError::SeveralRegions { n, names }),
        _ => {}
    }
    let Some(only) = cfg.only_these(&found) else {
        return Err(TrainingError::NoSuchRegion { name: named.join(","), names });
    };
    if !kind.needs_joints() {
        return Ok(only.without_pose());
    }
    match only.fusion().regions().iter().find(|region| region.joints.is_empty()) {
        Some(region) => Err(TrainingError::NoJoints { region: region.name.clone(), kind: kind.name() }),
        None => Ok(only),
    }
}

/// Trains a model on recordings, each of one donning, and writes it with its report. `cfg` has the regions that it is
/// to serve ([`for_regions`]); `on_step` is told of every step.
///
/// # Errors
/// [`TrainingError`] when a bag can't be trained on, the disk refuses, or the observer cancels: then the run can go on
/// from its checkpoint.
pub fn run(
    cfg: &Config,
    bags: &[PathBuf],
    request: &Request,
    observer: &dyn Observer,
    on_step: &mut dyn FnMut(&Progress),
) -> Result<Report, TrainingError> {
    request.check()?;
    train_without(cfg, bags, request, &[], observer, on_step)
}

/// Trains on these bags; `held_out` names the sessions that are left out.
fn train_without(
    cfg: &Config,
    bags: &[PathBuf],
    request: &Request,
    held_out: &[String],
    observer: &dyn Observer,
    on_step: &mut dyn FnMut(&Progress),
) -> Result<Report, TrainingError> {
    let data = Data::load(cfg, bags, request, observer)?;
    let lambdas = request.lambdas();
    let started = Instant::now();
    let mut report = Report::new(request, &data.dataset, &data.notes);
    let mut n_steps = 0;
    for (idx, lambda) in lambdas.iter().enumerate() {
        let settings = request.settings(*lambda, data.dataset.n_windows(Part::Train), data.touch_scale(), data.axes);
        if lambdas.len() > 1 {
            observer.note(&format!("lambda {lambda}, {} of {}", idx + 1, lambdas.len()));
        }
        let checkpoint = request.checkpoint(*lambda);
        let mut trainer = trainer(request, settings, &data.dataset, &checkpoint, observer)?;
        let stop = AtomicBool::new(observer.is_cancelled());
        let mut outcome = trainer.run(&stop, Some(&checkpoint), &mut |step| {
            on_step(step);
            report.handle_step(*lambda, step);
            stop.store(observer.is_cancelled(), Ordering::Relaxed);
        })?;
        if outcome.stopped {
            let (step, steps) = (outcome.steps, trainer.steps());
            return Err(TrainingError::Interrupted { step, steps, checkpoint });
        }
        n_steps = outcome.steps;
        let touch = calibrate_touch(&mut outcome.best, &data.dataset, data.rate_hz, request.threads)?;
        report.handle_outcome(*lambda, trainer.config(), outcome, touch);
    }
    report.finish(&data.dataset, started.elapsed(), observer).map_err(|error| match error {
        // Every step is in the checkpoint of the last run.
        TrainingError::Cancelled(_) => {
            let checkpoint = request.checkpoint(lambdas[lambdas.len() - 1]);
            TrainingError::Interrupted { step: n_steps, steps: n_steps, checkpoint }
        }
        error => error,
    })?;
    let card = ModelCard {
        rate_hz: data.rate_hz,
        joints: if data.regions.is_empty() { cfg.fusion().regions()[0].joints.clone() } else { Vec::new() },
        pose_range: data.pose_range.clone(),
        artifact: data.artifact.as_deref().cloned(),
        regions: data.regions.clone(),
        touch: report.touch(),
        held_out: held_out.to_vec(),
        glove: data.glove.clone(),
        trained_on: data.trained_on(),
        metrics: report.metrics(),
    };
    write(&request.output, &onnx_model(report.best()?, &card, request.form)?)?;
    write(&request.report(), report.to_json()?.as_bytes())?;
    for lambda in &lambdas {
        let checkpoint = request.checkpoint(*lambda);
        std::fs::remove_file(&checkpoint).map_err(|error| TrainingError::at(&checkpoint, &error))?;
    }
    Ok(report)
}

fn trainer<'d>(
    request: &Request,
    settings: TrainConfig,
    dataset: &'d Dataset,
    checkpoint: &Path,
    observer: &dyn Observer,
) -> Result<Trainer<'d>, TrainingError> {
    if !request.resume || !checkpoint.exists() {
        return Ok(Trainer::new(settings, dataset, request.threads)?);
    }
    let saved = Checkpoint::load(checkpoint)?;
    if *saved.config() != settings {
        return Err(TrainingError::OtherSettings { path: checkpoint.to_path_buf() });
    }
    observer.note(&format!("going on from step {} of {}", saved.step(), settings.schedule.steps));
    Ok(Trainer::resume(saved, dataset, request.threads)?)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), TrainingError> {
    files::replace(path, bytes).map_err(|error| TrainingError::at(path, &error))
}
