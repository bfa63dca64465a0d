//! What models, or the estimates in bags, are worth against the true force: bags in, [`Evaluated`] out.

mod error;
mod plan;
mod results;
mod session;
mod stretches;
mod workers;

use std::num::NonZero;
use std::path::{Path, PathBuf};

pub use error::EvaluateError;
pub use plan::{Series, Session};
pub use results::{Evaluated, Evidence, FailedBag, Latencies, ModelScores, Pairing, PoseQualityScores};
pub use session::SessionSummary;
pub use stretches::Stretch;

use crate::config::Config;
use crate::eval::Split;
use crate::fusion::TouchLevels;
use crate::model::BackendChoice;
use crate::observer::{Observer, check};
use crate::recording::PoseQuality;
use crate::zero::Wanted;
use plan::Plan;
use results::Gathered;

/// What is scored, and how.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// One recording each, of one donning of the glove.
    pub bags: &'a [PathBuf],
    /// The model to judge; `None` for the estimates in the bags where they hold some, else the models of the parameters.
    pub model: Option<&'a Path>,
    /// Models to compare it with; the first is the baseline.
    pub compare: &'a [PathBuf],
    /// What runs the models; `None` for what the parameters say.
    pub backend: Option<BackendChoice>,
    /// Where sessions are cut: the test part is scored. `None` for every frame.
    pub split: Option<Split>,
    /// Where the zero of the forces is from.
    pub zero: Wanted<'a>,
    /// Whether a bag without the true force of the parameters is at fault, or only without scores.
    pub needs_truth: bool,
    /// How joint angles are made worse, one after the other.
    pub pose_levels: Vec<PoseQuality>,
    /// Touches at the begin of each session whose force the wearer knows: they fit the gain of its donning, and what follows
    /// them is scored.
    pub known_touches: Option<usize>,
    /// What touch is judged by.
    pub touch: JudgeTouch,
    /// Bags that are read side by side; the result is the same for any number.
    pub jobs: usize,
}

/// What the touch of a model's estimates is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum JudgeTouch {
    /// What the node decides contact on: the touch output of a model that has one, at the levels of parameters or model,
    /// else the force, at 2.5 gF.
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
            needs_truth: false,
            pose_levels: Vec::new(),
            known_touches: None,
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
    mut each: impl FnMut(&[Series], &Session) -> Result<(), Box<dyn std::error::Error + Send + Sync>>,
) -> Result<Evaluated, EvaluateError> {
    let (plan, cores) = Plan::new(cfg, request, observer)?;
    let mut gathered = Gathered::new(&plan);
    workers::run(&plan, cores, request.bags, request.jobs, |idx, session| {
        match session {
            Ok(session) => {
                each(&plan.series, &session).map_err(EvaluateError::OfCaller)?;
                gathered.handle_session(session)?;
            }
            Err(failure) => gathered.handle_failure(&request.bags[idx], &failure),
        }
        Ok(())
    })?;
    check(observer)?;
    gathered.finish(&plan)
}

/// What was scored of each session, in words.
fn scored(split: Option<Split>) -> &'static str {
    match split {
        None => "every frame",
        Some(_) => "the held-out test part",
    }
}
