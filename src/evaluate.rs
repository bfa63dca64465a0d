//! Evaluation of models, or of the estimates in bags, against the true force: bags in, [`Evaluated`] out.

mod error;
mod headline;
mod held_out;
mod partial;
mod plan;
mod results;
mod scored;
mod session;
mod stretches;
mod workers;

use std::num::NonZero;
use std::path::{Path, PathBuf};

pub use error::EvaluateError;
pub use headline::{Change, GloveHeadline, Headline};
pub use held_out::{all_folds, fold_path, folds_of};
pub use partial::{Expected, MergeError, Partial, PartialBag, PartialOut, command, merge, run_partial};
pub use plan::{Series, SessionToScore};
pub use results::{Evaluated, Evidence, FailedBag, Latencies, ModelScores, Pairing, PoseQualityScores};
pub use session::SessionSummary;
pub use stretches::Stretch;

use crate::config::Config;
use crate::eval::Split;
use crate::fusion::TouchLevels;
use crate::model::BackendChoice;
use crate::observer::{Observer, check};
use crate::recording::PoseQuality;
use crate::sessions::{InAir, ModelRun};
use crate::zero::Wanted;
use held_out::{Fold, folds};
use plan::Plan;
use results::Gathered;
use scored::{BagPart, Head};

/// The data to score, and how.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// One recording each, of one donning of the glove.
    pub bags: &'a [PathBuf],
    /// The model to judge; `None` for the estimates in the bags where they hold some, else the models of the parameters.
    pub model: Option<&'a Path>,
    /// Models to compare it with; the first is the baseline.
    pub compare: &'a [PathBuf],
    /// The runtime of the models; `None` for that of the parameters.
    pub backend: Option<BackendChoice>,
    /// Where sessions are cut: the test part is scored. `None` for every frame.
    pub split: Option<Split>,
    /// Where the zero of the forces is from.
    pub zero: Wanted<'a>,
    /// Source for the times at which nothing touches the glove; `None` for the annotations of the bags.
    pub in_air: Option<&'a InAir>,
    /// Whether a bag without the true force of the parameters is at fault, or only without scores.
    pub needs_truth: bool,
    /// How joint angles are made worse, one after the other.
    pub pose_levels: Vec<PoseQuality>,
    /// Touches at the begin of each session whose force the wearer knows: they fit the gain of its donning, and what follows
    /// them is scored.
    pub known_touches: Option<usize>,
    /// Score each bag by the models beside these ones that were trained without it, `MODEL.without-*.onnx`, and all of it.
    pub held_out: bool,
    /// The output by which touch is judged.
    pub touch: JudgeTouch,
    /// Bags that are read side by side; the result is the same for any number.
    pub jobs: usize,
}

/// The output by which the touch of a model's estimates is judged.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum JudgeTouch {
    /// The one by which the node decides contact: the touch output of a model that has one, at the levels of parameters
    /// or model, else the force, at 2.5 gF.
    #[default]
    AsTheNode,
    /// The force, as in the paper.
    Force,
    /// The touch output of models that have one, at these levels, else the force.
    Levels(TouchLevels),
}

impl<'a> Request<'a> {
    /// Every frame of these bags, by the estimates in them or by the models of the parameters, on all cores.
    pub fn new(bags: &'a [PathBuf]) -> Self {
        Request {
            bags,
            model: None,
            compare: &[],
            backend: None,
            split: None,
            zero: Wanted::Any,
            in_air: None,
            needs_truth: false,
            pose_levels: Vec::new(),
            known_touches: None,
            held_out: false,
            touch: JudgeTouch::AsTheNode,
            jobs: std::thread::available_parallelism().map_or(1, NonZero::get),
        }
    }
}

/// Scores bags. Those that can't be scored are in [`Evaluated::failed`], as long as one can.
///
/// # Errors
/// [`EvaluateError`] when a model can't be loaded, no bag can be scored, or the observer cancels.
pub fn run(cfg: Config, request: &Request<'_>, observer: &dyn Observer) -> Result<Evaluated, EvaluateError> {
    run_with(cfg, request, observer, |_, _| Ok(()))
}

/// As [`run`], and gives the frames of each session, in the order of the bags.
///
/// # Errors
/// As of [`run`], and [`EvaluateError::OfCaller`] with what `each` says.
pub fn run_with(
    cfg: Config,
    request: &Request<'_>,
    observer: &dyn Observer,
    mut each: impl FnMut(&[Series], &SessionToScore) -> Result<(), Box<dyn std::error::Error + Send + Sync>>,
) -> Result<Evaluated, EvaluateError> {
    let mut gathered = Gathered::default();
    let head = parts(cfg, request, observer, &mut each, &mut |idx, part| gathered.handle(idx, part))?;
    gathered.finish(&head)
}

type Each<'e> = dyn FnMut(&[Series], &SessionToScore) -> Result<(), Box<dyn std::error::Error + Send + Sync>> + 'e;
type Take<'t> = dyn FnMut(usize, BagPart) -> Result<(), EvaluateError> + 't;

/// Takes every bag of a request, and hands on what it gives, with its place among the bags. Gives what all have in common.
fn parts(
    cfg: Config,
    request: &Request<'_>,
    observer: &dyn Observer,
    each: &mut Each<'_>,
    take: &mut Take<'_>,
) -> Result<Head, EvaluateError> {
    if request.held_out {
        return parts_held_out(cfg, request, observer, each, take);
    }
    let (plan, cores) = Plan::new(cfg, request, observer)?;
    parts_of_plan(&plan, cores, request, each, take)?;
    check(observer)?;
    Ok(Head::of(&plan))
}

/// Takes every bag of a request through a plan.
fn parts_of_plan(
    plan: &Plan<'_>,
    cores: Vec<ModelRun>,
    request: &Request<'_>,
    each: &mut Each<'_>,
    take: &mut Take<'_>,
) -> Result<(), EvaluateError> {
    workers::run(plan, cores, request.bags, request.jobs, |idx, session| {
        let part = match session {
            Ok(session) => {
                each(&plan.series, &session).map_err(EvaluateError::OfCaller)?;
                BagPart::scored(session, plan.judged())?
            }
            Err(failure) => BagPart::failed(&request.bags[idx], &failure),
        };
        take(idx, part)
    })
}

/// Scores each bag by the models that were trained without it. Rows have the names of the models that the folds belong to.
fn parts_held_out(
    cfg: Config,
    request: &Request<'_>,
    observer: &dyn Observer,
    each: &mut Each<'_>,
    take: &mut Take<'_>,
) -> Result<Head, EvaluateError> {
    let model = request.model.ok_or(EvaluateError::NoModel)?;
    let models: Vec<&Path> = request.compare.iter().map(PathBuf::as_path).chain([model]).collect();
    let folds = folds(request.bags, &models)?;
    let mut head = None;
    for Fold { bags, places, models: of_fold } in &folds {
        let Some((judged, compared)) = of_fold.split_last() else { continue };
        let of_fold = Request { bags, model: Some(judged), compare: compared, split: None, ..request.clone() };
        let (mut plan, cores) = Plan::new(cfg.clone(), &of_fold, observer)?;
        plan.name_held_out(&models);
        parts_of_plan(&plan, cores, &of_fold, each, &mut |idx, part| take(places[idx], part))?;
        // The names are the same in all of them, and the files of the first are no more right than those of the last.
        plan.forget_files(&models);
        head.get_or_insert_with(|| Head::of(&plan));
        check(observer)?;
    }
    head.ok_or(EvaluateError::NoModel)
}

/// The scored part of each session, in words.
fn what_is_scored(split: Option<Split>) -> &'static str {
    match split {
        None => "every frame",
        Some(_) => "the held-out test part",
    }
}
