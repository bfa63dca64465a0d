//! `tpf train`: annotated bags in, a force model out.

use std::num::NonZero;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use clap::ValueEnum;
use tactile_pose_fusion::fusion::ForceAxes;
use tactile_pose_fusion::observer::Observer;
use tactile_pose_fusion::train::{GraphForm, Kind, LossConfig, Progress, Schedule, TrainConfig};
use tactile_pose_fusion::training::{self, HoldOut, Request, VALIDATION_SHARE};

use super::in_air::InAirArgs;
use super::sessions::find_bags;
use super::setup::ParamArgs;
use super::split::SplitArgs;
use super::{Failure, Outcome, interrupt, print};
use crate::report;
use crate::report::progress::{Progress as Bar, Said};

/// Trains a force model on annotated recordings and writes it as ONNX, with a report beside it.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Bags, or folders of bags: one recording each, of one donning of the glove
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    #[command(flatten)]
    in_air: InAirArgs,
    /// Which region of the parameters to train for, where they have several. For adaptive also several of them, which the model
    /// then serves: what pose makes of the taxels is learned for each
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    region: Vec<String>,
    /// Topic of the true force, instead of the one in the parameters
    #[arg(long, value_name = "TOPIC")]
    truth: Option<String>,
    /// What to train: adaptive follows the artifact of pose while the glove is worn; pose-aware is the paper's network, the
    /// others are what it is compared with
    #[arg(long, value_enum, default_value_t = KindArg::PoseAware)]
    kind: KindArg,
    /// Axes of the model's force: 1 is the normal force; 3 is all of it, for a true force of three axes (truth.*.fields in the
    /// parameters). Not for adaptive
    #[arg(long, value_name = "N", default_value = "1", value_parser = ["1", "3"])]
    axes: String,
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
    hold_out: Option<HoldOutArg>,
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
    /// Steps in all [default: 5000; 12000 for adaptive]
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
    /// For adaptive: copies of each session with light touches held in its air and other hand trackers, for a network that also gets
    /// how far the taxels can be trusted; 0 for one that gets the taxels alone [default: 4]
    #[arg(long, value_name = "N")]
    held_touches: Option<usize>,
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
enum HoldOutArg {
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

impl From<HoldOutArg> for HoldOut {
    fn from(hold_out: HoldOutArg) -> Self {
        match hold_out {
            HoldOutArg::Users => HoldOut::Users,
            HoldOutArg::Donnings => HoldOut::Donnings,
        }
    }
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
    let request = args.request()?;
    request.check()?;
    if args.hold_out.is_some() {
        training::check_folds(&request)?;
    }
    let kind = request.train.kind;
    let cfg = args.params.load_with_truth(args.truth.as_deref())?;
    let cfg = training::for_regions(cfg, &args.region, kind)?;
    if args.hold_out.is_some() {
        training::check_hold_out(&cfg)?;
    }
    interrupt::listen();
    let bags = find_bags(&args.bags)?;
    let shown = Shown { bar: Mutex::new(None), kind };
    let report = training::run(&cfg, &bags, &request, &shown, &mut |step| shown.show(step))?;
    shown.clear();
    print(&if args.json { report.to_json()? } else { report::training::of_report(&report, &request) })?;
    if let Some(hold_out) = args.hold_out {
        let sessions = report.sessions();
        let scores = training::hold_out(&cfg, &bags, sessions, hold_out.into(), &request, &shown, &mut |step| {
            shown.show(step);
        })?;
        shown.clear();
        print(&report::training::of_folds(&scores, &request))?;
    }
    Ok(Outcome::Done)
}

impl Args {
    fn request(&self) -> Result<Request, Failure> {
        let of_kind = Request::new(self.kind.into(), self.output.clone());
        let lambda = match self.loss.sweep_lambda.as_slice() {
            [] => self.loss.lambda.unwrap_or(LossConfig::default().lambda),
            [first, ..] => *first,
        };
        let schedule = Schedule {
            steps: self.run.steps.unwrap_or(of_kind.train.schedule.steps),
            learning_rate: self.run.learning_rate,
            ..of_kind.train.schedule
        };
        let train = TrainConfig {
            seed: self.run.seed,
            batch: self.run.batch,
            schedule,
            light_touches: self.run.light_touches.unwrap_or(of_kind.train.light_touches),
            loss: LossConfig {
                base_weight: if self.loss.no_base_loss { 0.0 } else { self.loss.base_weight },
                lambda: if self.loss.no_auxiliary_loss { 0.0 } else { lambda },
                offset_gf: self.loss.offset_gf,
                ..of_kind.train.loss
            },
            ..of_kind.train.clone()
        };
        Ok(Request {
            train,
            epochs: self.run.epochs,
            lambdas: self.loss.sweep_lambda.clone(),
            held_touches: self.run.held_touches.unwrap_or(of_kind.held_touches),
            stride: self.run.stride,
            axes: if self.axes == "3" { ForceAxes::Patch } else { ForceAxes::Normal },
            in_air: self.in_air.told().cloned(),
            split: self.split.split(self.validation_share)?,
            threads: self.run.threads.map_or(of_kind.threads, NonZero::get),
            form: if self.plain_graph { GraphForm::Plain } else { GraphForm::Fast },
            resume: self.resume,
            overwrite: self.overwrite,
            command: std::env::args().collect(),
            ..of_kind
        })
    }
}

/// The run as a person sees it: bars for reading and for training, and a line with every look at the validation part.
struct Shown {
    bar: Mutex<Option<(&'static str, Bar)>>,
    kind: Kind,
}

impl Observer for Shown {
    fn note(&self, text: &str) {
        self.above_the_bar(|| Said.note(text));
    }

    fn warn(&self, text: &str) {
        self.above_the_bar(|| Said.warn(text));
    }

    fn detail(&self, text: &str) {
        self.above_the_bar(|| Said.detail(text));
    }

    fn progress(&self, done: u64, total: u64) {
        self.set("read", done, total);
    }

    fn is_cancelled(&self) -> bool {
        Said.is_cancelled()
    }
}

impl Shown {
    fn above_the_bar(&self, say: impl FnOnce()) {
        match &*self.bar.lock().unwrap_or_else(PoisonError::into_inner) {
            Some((_, bar)) => bar.above(say),
            None => say(),
        }
    }

    fn set(&self, what: &'static str, done: u64, total: u64) {
        let mut shown = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        if shown.as_ref().is_none_or(|(of, _)| *of != what) {
            *shown = None; // clears the one before
            *shown = Some((what, Bar::steps(what, total)));
        }
        if let Some((_, bar)) = shown.as_mut() {
            bar.set(done);
        }
        if done >= total {
            *shown = None;
        }
    }

    fn clear(&self) {
        *self.bar.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn show(&self, progress: &Progress) {
        if let Some(line) = report::training::of_step(progress, self.kind) {
            self.note(&line);
        }
        self.set("train", progress.step, progress.steps);
    }
}
