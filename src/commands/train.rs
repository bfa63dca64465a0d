//! `tpf train`: annotated bags in, a force model out.

mod held_out;
mod load;
mod report;

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::ValueEnum;

use self::load::Loader;
use self::report::Report;
use super::progress::Progress as Bar;
use super::sessions::find_bags;
use super::setup::ParamArgs;
use super::split::SplitArgs;
use super::{Failure, Outcome, counted, interrupt, print, say};
use crate::config::Config;
use crate::eval::{Part, Split};
use crate::files;
use crate::fusion::{ArtifactModel, PoseRange};
use crate::train::{
    Checkpoint, Dataset, GraphForm, Kind, LossConfig, ModelCard, Progress, Schedule, Session, TrainConfig, Trainer,
    WindowSpec, calibrate_touch, fit_artifact, onnx_model, pose_range as train_pose_range,
};

/// Frames in a window; the paper's.
const WINDOW: usize = 64;

/// Frames from one window to the next where the network is judged: neighbours say nearly the same. `tpf eval` takes all.
const EVAL_STRIDE: usize = 10;

/// A light touch, gF: up to about this the adaptive network sees taxels in full.
const LIGHT_TOUCH_GF: f64 = 10.0;

/// Share of the training windows in the air that get a light touch, for an adaptive model.
const LIGHT_TOUCHES: f32 = 0.2;

/// Steps of an adaptive model: its small network still improves where the paper's no longer does.
const ADAPTIVE_STEPS: u64 = 20_000;

/// Share of the time that picks the best step: taken from what the paper trains on, so that its test stays unseen.
const VALIDATION_SHARE: f64 = 0.08;

/// Trains a force model on annotated recordings and writes it as ONNX, with a report beside it.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Bags, or folders of bags: one recording each, of one donning of the glove
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    /// Which region of the parameters to train for, where they have several
    #[arg(long, value_name = "NAME")]
    region: Option<String>,
    /// Topic of the true force, instead of the one in the parameters
    #[arg(long, value_name = "TOPIC")]
    truth: Option<String>,
    /// What to train: adaptive follows the artifact of pose while the glove is worn; pose-aware is the paper's network, the
    /// others are what it is compared with
    #[arg(long, value_enum, default_value_t = KindArg::PoseAware)]
    kind: KindArg,
    /// Model to write
    #[arg(short, long, value_name = "MODEL.onnx")]
    output: PathBuf,
    #[command(flatten)]
    run: RunArgs,
    #[command(flatten)]
    loss: LossArgs,
    #[command(flatten)]
    split: SplitArgs,
    /// Share of the time, right before the test, by which the best step is picked; 0 keeps the last step
    #[arg(long, value_name = "SHARE", default_value_t = VALIDATION_SHARE)]
    validation_share: f64,
    /// Also train a model without each user, or without each donning (each bag), as OUTPUT.without-NAME.onnx, and score it on
    /// what it never saw: that is what a new user gets
    #[arg(long, value_enum, value_name = "users|donnings")]
    hold_out: Option<HoldOut>,
    /// Write the graph layer by layer instead of in the form that runs fastest
    #[arg(long)]
    plain_graph: bool,
    /// Go on from the checkpoint that an interrupted run of the same command left
    #[arg(long)]
    resume: bool,
    /// Replace a model that is already there, and begin anew where an interrupted run left a checkpoint
    #[arg(long)]
    overwrite: bool,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

/// How long and how fast.
#[derive(Debug, clap::Args)]
struct RunArgs {
    /// Passes over the training windows
    #[arg(long, value_name = "E", conflicts_with = "steps")]
    epochs: Option<f64>,
    /// Steps in all [default: 5000; 20000 for adaptive]
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Windows in a step
    #[arg(long, value_name = "N", default_value_t = TrainConfig::default().batch)]
    batch: usize,
    /// Largest learning rate: it rises to it, then falls as half a cosine
    #[arg(long, value_name = "RATE", default_value_t = Schedule::default().learning_rate)]
    learning_rate: f64,
    /// For adaptive: the share of training windows in the air to which a light touch is added, 0 to 1: a firm one, scaled
    /// down [default: 0.2]
    #[arg(long, value_name = "SHARE")]
    light_touches: Option<f32>,
    /// Frames from one training window to the next
    #[arg(long, value_name = "N", default_value_t = 1)]
    stride: usize,
    /// The same seed on the same data gives the same model
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Threads; they change how long it takes and not what comes out
    #[arg(long, value_name = "N")]
    threads: Option<NonZero<usize>>,
}

/// What is minimized; each is an ablation of the paper.
#[derive(Debug, clap::Args)]
struct LossArgs {
    /// Weight of the auxiliary zero-load loss; it depends on the glove
    #[arg(long, value_name = "L", conflicts_with = "sweep_lambda")]
    lambda: Option<f32>,
    /// Train once with each of these weights and keep the model with the smallest validation loss
    #[arg(long, value_name = "L1,L2,..", value_delimiter = ',')]
    sweep_lambda: Vec<f32>,
    /// Weight of the base force loss; the paper's is 1
    #[arg(long, value_name = "W", default_value_t = LossConfig::default().base_weight)]
    base_weight: f32,
    /// What the relative force losses add to the true force in their denominator; the paper's 1, read as newtons
    #[arg(long, value_name = "GF", default_value_t = LossConfig::default().offset_gf)]
    offset_gf: f32,
    /// Leave the base force loss out
    #[arg(long, conflicts_with = "base_weight")]
    no_base_loss: bool,
    /// Leave the auxiliary zero-load loss out
    #[arg(long, conflicts_with_all = ["lambda", "sweep_lambda"])]
    no_auxiliary_loss: bool,
}

/// What a model is trained without, one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum HoldOut {
    Users,
    Donnings,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum KindArg {
    PoseAware,
    TactileOnly,
    EarlyFusion,
    Adaptive,
}

impl From<KindArg> for Kind {
    fn from(kind: KindArg) -> Self {
        match kind {
            KindArg::PoseAware => Kind::PoseAware,
            KindArg::TactileOnly => Kind::TactileOnly,
            KindArg::EarlyFusion => Kind::EarlyFusion,
            KindArg::Adaptive => Kind::Adaptive,
        }
    }
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let kind = Kind::from(args.kind);
    let files = Files::of(&args.output);
    files.check(args)?;
    held_out::check(args)?;
    if args.run.light_touches.is_some() && kind != Kind::Adaptive {
        let about = "is for --kind adaptive: the taxels of other models keep the artifact of pose, which a touch doesn't add to";
        return Err(Failure(format!("--light-touches {about}")));
    }
    let cfg = only_region(args.params.load_with_truth(args.truth.as_deref())?, args.region.as_deref(), kind)?;
    interrupt::listen();
    let bags = find_bags(&args.bags)?;
    let report = train(args, &cfg, kind, &bags, &files, &[])?;
    print(&if args.json { report.to_json()? } else { report.text(&files) })?;
    if let Some(hold_out) = args.hold_out {
        print(&held_out::run(args, &cfg, hold_out, &bags, report.sessions())?)?;
    }
    Ok(Outcome::Done)
}

/// Trains on these bags, and writes the model and its report; `held_out` names the sessions that are left out.
fn train(
    args: &Args,
    cfg: &Config,
    kind: Kind,
    bags: &[PathBuf],
    files: &Files,
    held_out: &[String],
) -> Result<Report, Failure> {
    let lambdas = args.lambdas();
    let data = Data::load(args, cfg, kind, bags)?;
    let threads = args.run.threads.or_else(|| std::thread::available_parallelism().ok()).map_or(1, NonZero::get);

    let started = Instant::now();
    let mut report = Report::new(kind, &data.dataset, data.split, &data.notes, threads);
    for (idx, lambda) in lambdas.iter().enumerate() {
        let mut train_cfg = args.train_config(kind, *lambda, data.dataset.n_windows(Part::Train));
        train_cfg.touch_scale = data.touch_scale();
        if lambdas.len() > 1 {
            say(&format!("lambda {lambda}, {} of {}", idx + 1, lambdas.len()));
        }
        let checkpoint = files.checkpoint(&lambdas, *lambda);
        let mut trainer = trainer(args, train_cfg, &data.dataset, &checkpoint, threads)?;
        let mut progress = Shown::new(trainer.steps(), kind);
        let mut outcome = trainer.run(interrupt::flag(), Some(&checkpoint), &mut |step| {
            progress.show(step);
            report.handle_step(*lambda, step);
        })?;
        drop(progress);
        if outcome.stopped {
            return Err(Failure(format!(
                "interrupted at step {} of {}; nothing is lost: give the same command with --resume to go on from {}",
                outcome.steps,
                trainer.steps(),
                checkpoint.display()
            )));
        }
        let touch = calibrate_touch(&mut outcome.best, &data.dataset, data.rate_hz, threads)?;
        report.handle_outcome(*lambda, trainer.config(), outcome, touch);
    }
    report.finish(&data.dataset, started.elapsed())?;

    let best = report.best()?;
    let card = ModelCard {
        rate_hz: data.rate_hz,
        joints: cfg.fusion.regions[0].joints.clone(),
        pose_range: data.pose_range.clone(),
        artifact: data.artifact.as_deref().cloned(),
        touch: report.touch(),
        held_out: held_out.to_vec(),
        glove: data.glove.clone(),
        trained_on: data.trained_on(),
        metrics: report.metrics()?,
    };
    let form = if args.plain_graph { GraphForm::Plain } else { GraphForm::Fast };
    write(&files.model, &onnx_model(best, &card, form)?)?;
    write(&files.report, report.to_json()?.as_bytes())?;
    for lambda in &lambdas {
        let checkpoint = files.checkpoint(&lambdas, *lambda);
        std::fs::remove_file(&checkpoint).map_err(|error| Failure(format!("{}: {error}", checkpoint.display())))?;
    }
    Ok(report)
}

impl Args {
    /// The weights to train with, one after the other.
    fn lambdas(&self) -> Vec<f32> {
        match self.loss.sweep_lambda.as_slice() {
            [] => vec![self.loss.lambda.unwrap_or(LossConfig::default().lambda)],
            sweep => sweep.to_vec(),
        }
    }

    fn light_touches(&self, kind: Kind) -> f32 {
        let default = if kind == Kind::Adaptive { LIGHT_TOUCHES } else { 0.0 };
        self.run.light_touches.unwrap_or(default)
    }

    fn train_config(&self, kind: Kind, lambda: f32, n_windows: usize) -> TrainConfig {
        let default_steps = if kind == Kind::Adaptive { ADAPTIVE_STEPS } else { Schedule::default().steps };
        let steps = match self.run.epochs {
            Some(epochs) => (epochs * (n_windows / self.run.batch.clamp(1, n_windows.max(1))) as f64).ceil() as u64,
            None => self.run.steps.unwrap_or(default_steps),
        };
        let schedule = Schedule { steps, learning_rate: self.run.learning_rate, ..Schedule::default() };
        TrainConfig {
            kind,
            seed: self.run.seed,
            batch: self.run.batch,
            schedule,
            light_touches: self.light_touches(kind),
            loss: LossConfig {
                base_weight: if self.loss.no_base_loss { 0.0 } else { self.loss.base_weight },
                lambda: if self.loss.no_auxiliary_loss { 0.0 } else { lambda },
                offset_gf: self.loss.offset_gf,
                ..LossConfig::default()
            },
            ..TrainConfig::default()
        }
    }
}

/// The configuration of one region, without joints where the network takes none.
fn only_region(mut cfg: Config, name: Option<&str>, kind: Kind) -> Result<Config, Failure> {
    let names = || cfg.fusion.regions.iter().map(|region| region.name.as_str()).collect::<Vec<_>>().join(", ");
    let idx = match (name, cfg.fusion.regions.len()) {
        (None, 1) => 0,
        (None, n) => {
            return Err(Failure(format!(
                "the parameters have {n} regions, a model is trained for one: give --region {}",
                names()
            )));
        }
        (Some(name), _) => {
            let found = cfg.fusion.regions.iter().position(|region| region.name == name);
            found.ok_or_else(|| Failure(format!("--region {name}: the parameters have {}", names())))?
        }
    };
    if kind.needs_joints() && cfg.fusion.regions[idx].joints.is_empty() {
        return Err(Failure(format!(
            "region.{0}.joints is empty and --kind {1} needs joint angles; name the joints, or train --kind tactile-only",
            cfg.fusion.regions[idx].name,
            kind_name(kind)
        )));
    }
    cfg.fusion.regions = vec![cfg.fusion.regions.swap_remove(idx)];
    cfg.truth_of_region = vec![cfg.truth_of_region.swap_remove(idx)];
    if !kind.needs_joints() {
        cfg.fusion.regions[0].joints.clear();
        cfg.fusion.joint_sources.clear();
        cfg.joints.clear();
    }
    Ok(cfg)
}

fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::PoseAware => "pose-aware",
        Kind::TactileOnly => "tactile-only",
        Kind::EarlyFusion => "early-fusion",
        Kind::Adaptive => "adaptive",
    }
}

/// Sessions, ready to be trained on.
struct Data {
    dataset: Dataset,
    notes: Vec<SessionNotes>,
    split: Split,
    rate_hz: f64,
    glove: String,
    synthetic: bool,
    /// Of the joints that a region needs; empty where it needs none.
    pose_range: Vec<PoseRange>,
    artifact: Option<Arc<ArtifactModel>>,
}

/// What the report says of a session.
#[derive(Debug, Clone, serde::Serialize)]
struct SessionNotes {
    name: String,
    user: Option<String>,
    glove: Option<String>,
    synthetic: bool,
    frames: usize,
    frames_without_truth: usize,
}

impl Data {
    fn load(args: &Args, cfg: &Config, kind: Kind, bags: &[PathBuf]) -> Result<Self, Failure> {
        let split = args.split.split(args.validation_share)?;
        let mut loader = Loader::new(cfg, WINDOW, split)?;
        let (mut artifact, mut pose_range) = (None, Vec::new());
        if kind == Kind::Adaptive {
            // Once to learn what pose makes of the taxels, and once more by the core that takes it out.
            let mut raw = Vec::new();
            let mut bar = Bar::steps("artifact", bags.len() as u64);
            for (idx, bag) in bags.iter().enumerate() {
                raw.push(loader.load(bag)?.session);
                bar.set(idx as u64 + 1);
            }
            drop(bar);
            let found = Arc::new(fit_artifact(&raw, loader.rate_hz())?);
            artifact = Some(Arc::clone(&found));
            pose_range = train_pose_range(&raw);
            loader = loader.with_artifact(found);
        }
        let (mut sessions, mut notes): (Vec<Session>, Vec<SessionNotes>) = (Vec::new(), Vec::new());
        let mut bar = Bar::steps("read", bags.len() as u64);
        for (idx, bag) in bags.iter().enumerate() {
            let loaded = loader.load(bag)?;
            bar.set(idx as u64 + 1);
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
        drop(bar);
        let synthetic = notes.iter().any(|notes| notes.synthetic);
        let glove =
            cfg.glove.clone().or_else(|| notes.iter().find_map(|notes| notes.glove.clone())).unwrap_or_default();
        let spec = WindowSpec {
            window: WINDOW,
            stride: args.run.stride,
            eval_stride: EVAL_STRIDE,
            outputs: 1,
            needs_pose: kind.uses_pose(),
        };
        let dataset = Dataset::new(sessions, spec)?;
        if kind.uses_pose() {
            pose_range = dataset.pose_range();
        }
        say(&format!(
            "{}{}: {} windows to train on, {} to pick the best step, {} kept for the test",
            counted(notes.len() as u64, "session"),
            if synthetic { " (synthetic)" } else { "" },
            dataset.n_windows(Part::Train),
            dataset.n_windows(Part::Validation),
            dataset.n_windows(Part::Test)
        ));
        Ok(Data { dataset, notes, split, rate_hz: loader.rate_hz(), glove, synthetic, pose_range, artifact })
    }

    /// What a taxel reads of a light touch, on average.
    fn touch_scale(&self) -> f32 {
        let of = |artifact: &Arc<ArtifactModel>| {
            let sum: f64 = artifact.touch.iter().map(|touch| touch.abs()).sum();
            (LIGHT_TOUCH_GF * sum / artifact.n_taxels as f64) as f32
        };
        self.artifact.as_ref().map_or(1.0, of)
    }

    /// In words, for the model's own metadata.
    fn trained_on(&self) -> String {
        let fingerprint = self.dataset.fingerprint();
        let what = if self.synthetic { "synthetic sessions" } else { "sessions" };
        format!("{} {what}, data {}", self.notes.len(), &fingerprint[..16.min(fingerprint.len())])
    }
}

fn trainer<'d>(
    args: &Args,
    cfg: TrainConfig,
    dataset: &'d Dataset,
    checkpoint: &Path,
    threads: usize,
) -> Result<Trainer<'d>, Failure> {
    if !args.resume || !checkpoint.exists() {
        return Ok(Trainer::new(cfg, dataset, threads)?);
    }
    let saved = Checkpoint::load(checkpoint)?;
    if *saved.config() != cfg {
        return Err(Failure(format!(
            "{}: was made with other settings than this command's; give the same ones, or leave --resume out",
            checkpoint.display()
        )));
    }
    say(&format!("going on from step {} of {}", saved.step(), cfg.schedule.steps));
    Ok(Trainer::resume(saved, dataset, threads)?)
}

/// Where everything goes.
struct Files {
    model: PathBuf,
    report: PathBuf,
}

impl Files {
    fn of(model: &Path) -> Self {
        Files { model: model.to_path_buf(), report: model.with_extension("report.json") }
    }

    fn checkpoint(&self, lambdas: &[f32], lambda: f32) -> PathBuf {
        match lambdas {
            [_] => self.model.with_extension("checkpoint.json"),
            _ => self.model.with_extension(format!("lambda-{lambda}.checkpoint.json")),
        }
    }

    fn check(&self, args: &Args) -> Result<(), Failure> {
        if self.model.extension().is_none_or(|extension| extension != "onnx") {
            return Err(Failure(format!("{}: expected a name that ends with .onnx", self.model.display())));
        }
        if args.overwrite {
            return Ok(());
        }
        if let Some(file) = [&self.model, &self.report].into_iter().find(|file| file.exists()) {
            let file = file.display();
            return Err(Failure(format!("{file}: is already there; choose another name, or give --overwrite")));
        }
        let lambdas = args.lambdas();
        let mut checkpoints = lambdas.iter().map(|lambda| self.checkpoint(&lambdas, *lambda));
        match checkpoints.find(|checkpoint| checkpoint.exists()).filter(|_| !args.resume) {
            Some(checkpoint) => Err(Failure(format!(
                "{}: an interrupted run left it; give --resume to go on from there, or --overwrite to begin anew",
                checkpoint.display()
            ))),
            None => Ok(()),
        }
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    files::replace(path, bytes).map_err(|error| Failure(format!("{}: {error}", path.display())))
}

/// The run as a person sees it: a bar, and a line with every look at the validation part.
struct Shown {
    bar: Bar,
    kind: Kind,
}

impl Shown {
    fn new(steps: u64, kind: Kind) -> Self {
        Shown { bar: Bar::steps("train", steps), kind }
    }

    fn show(&mut self, progress: &Progress) {
        self.bar.set(progress.step);
        let Some(validation) = &progress.validation else { return };
        let loss = &progress.loss;
        let percent = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:.2} %", 100.0 * share));
        let terms = match self.kind {
            Kind::Adaptive => format!("touch {:.4}", loss.touch),
            _ => format!("base {:.4}, artifact {:.4}", loss.base, loss.artifact),
        };
        let mut line = format!(
            "step {:>6}  loss {:.4} (force {:.4}, {terms})  validation {:.4}, BA {}, MAE {:.1} gF",
            progress.step,
            loss.total,
            loss.force,
            validation.loss,
            percent(validation.balanced_accuracy),
            validation.mae_gf
        );
        if let Some(base) = validation.base_mae_gf {
            line += &format!(" (base {}, {base:.1} gF)", percent(validation.base_balanced_accuracy));
        }
        self.bar.line(&(line + if progress.is_best { "  best" } else { "" }));
    }
}
