//! The `~/calibrate` action, and the calibration that it shares with `~/tare`.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use byteorder::LittleEndian;
use futures::StreamExt;
use ros2_client::action::{
    CancelGoalRequest, CancelGoalResponse, FeedbackMessage, GetResultRequest, GetResultResponse, GoalId, GoalInfo,
    GoalStatusEnum, SendGoalRequest, SendGoalResponse,
};
use ros2_client::action_msgs::{CancelGoalResponseEnum, GoalStatus, GoalStatusArray};
use ros2_client::builtin_interfaces::Time as WireTime;
use tokio::sync::{mpsc, oneshot};

use super::calibrator::{Calibrator, Purpose, Sample};
use super::engine::Command;
use super::interfaces::CancelGoal;
use super::known_touches;
use super::loading;
use super::shared::Shared;
use crate::config::Config;
use crate::msg::{CalibrateFeedback, CalibrateGoal, CalibrateResult, Duration as WireDuration};
use crate::ros::wire::args::Severity;
use crate::ros::wire::entities::Graph;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::middleware::{Action, Answer, Request, Sender};
use crate::ros::wire::threads::Vital;
use crate::sessions::{RegionTouches, TruthReading};
use crate::units::nanos;
use crate::zero::{Donning, Zero, ZeroFrom};

/// How often the progress of a calibration is checked; a calibration takes seconds.
const POLL: Duration = Duration::from_millis(20);

/// How often feedback is sent.
const FEEDBACK: Duration = Duration::from_millis(500);

/// Number of results kept for clients that ask late.
const KEPT_RESULTS: usize = 16;

/// Number of clients that may wait for the result of a goal; any further client gets "unknown".
const MAX_ASKED: usize = 64;

/// Longest calibration that a goal may ask for, as in the table of parameters.
const MAX_DURATION: Duration = Duration::from_secs(600);

/// What the wearer should do while the zero is measured, and while known touches are looked for.
const IN_AIR: &str =
    "in the air: open and close the hand, spread the fingers, go through the poses that you use; touch nothing";
const TOUCH: &str = "touch the force sensor: each region at least three times with 30 gF or more, half a second each";

/// What came during a calibration, and how it is told to go on.
struct Collected<'a> {
    samples: mpsc::UnboundedReceiver<Sample>,
    readings: mpsc::UnboundedReceiver<TruthReading>,
    calibrator: Calibrator,
    cancelled: &'a dyn Fn() -> bool,
}

/// Why a calibration is not in use.
type Refused = String;

impl Collected<'_> {
    /// Takes samples for a while. `feedback` is given what is left of it.
    async fn collect(
        &mut self,
        duration: Duration,
        feedback: &mut dyn FnMut(&Calibrator, Duration),
    ) -> Result<(), Refused> {
        let started = tokio::time::Instant::now();
        let mut next_feedback = started + FEEDBACK;
        while started.elapsed() < duration {
            if (self.cancelled)() {
                return Err("cancelled; the baseline is what it was".to_owned());
            }
            match tokio::time::timeout(POLL, self.samples.recv()).await {
                Ok(Some(sample)) => self.calibrator.handle(sample),
                Ok(None) => break,
                Err(_elapsed) => {}
            }
            if tokio::time::Instant::now() >= next_feedback {
                feedback(&self.calibrator, duration.saturating_sub(started.elapsed()));
                next_feedback += FEEDBACK;
            }
        }
        match (self.cancelled)() {
            true => Err("cancelled; the baseline is what it was".to_owned()),
            false => Ok(()),
        }
    }
}

/// Collects samples for a while, judges them, and applies the calibration in the engine. The result reports the
/// outcome.
pub(super) async fn calibrate(
    shared: &Shared,
    purpose: Purpose,
    duration: Duration,
    feedback: impl FnMut(CalibrateFeedback),
    cancelled: impl Fn() -> bool,
) -> CalibrateResult {
    let refused = |message: String| CalibrateResult { message, ..CalibrateResult::default() };
    if shared.calibrating.replace(true) {
        return refused("a calibration is under way already; wait until it is over".to_owned());
    }
    let result = collect_and_apply(shared, purpose, duration, feedback, &cancelled).await.unwrap_or_else(refused);
    shared.truth_tap.replace(None);
    shared.calibrating.set(false);
    let severity = if result.success { Severity::Info } else { Severity::Warn };
    shared.outbox.log(severity, result.message.as_str());
    result
}

async fn collect_and_apply(
    shared: &Shared,
    purpose: Purpose,
    duration: Duration,
    mut feedback: impl FnMut(CalibrateFeedback),
    cancelled: &dyn Fn() -> bool,
) -> Result<CalibrateResult, Refused> {
    let cfg = shared.parameters.borrow().config().clone();
    let (tap, samples) = mpsc::unbounded_channel();
    let (truth_tap, readings) = mpsc::unbounded_channel();
    let touch_duration = if purpose == Purpose::Calibrate { cfg.calibration.touch_duration } else { Duration::ZERO };
    if !touch_duration.is_zero() {
        shared.truth_tap.replace(Some(truth_tap));
    }
    let calibrator = Calibrator::new(&cfg, purpose, duration);
    let mut collected = Collected { samples, readings, calibrator, cancelled };
    let gone = || "the thread that estimates has ended; restart the node".to_owned();
    shared.commands.send(Command::Tap(tap)).map_err(|_| gone())?;
    collected
        .collect(duration, &mut |calibrator, left| {
            feedback(CalibrateFeedback { instruction: IN_AIR.to_owned(), ..calibrator.feedback(left) });
        })
        .await?;
    let (donning, mut result) = judge(shared, &mut collected, cfg.clone(), purpose).await?;
    let Some(mut donning) = donning else { return Ok(result) };
    let what = if purpose == Purpose::Tare { "tared" } else { "calibrated" };
    let mut from = format!("{what} live from {} frames", result.frames);
    let mut warned = None;
    if !touch_duration.is_zero() {
        shared.outbox.log(Severity::Info, format!("now {TOUCH}; {:.0} s", touch_duration.as_secs_f64()));
        let instruct = |left| CalibrateFeedback {
            instruction: TOUCH.to_owned(),
            time_left: WireDuration::from_nanos(nanos(left)),
            ..CalibrateFeedback::default()
        };
        feedback(instruct(touch_duration));
        collected.collect(touch_duration, &mut |_, left| feedback(instruct(left))).await?;
        match fit_gains(&mut collected, &cfg, &donning, duration).await {
            Ok(found) => {
                donning.force_gains = vec![None; cfg.fusion.regions().len()];
                for found in &found {
                    donning.force_gains[found.region] = Some(found.gain);
                    from.push_str(&format!("; {}", found.text(&cfg)));
                }
            }
            Err(reason) => warned = Some(format!("the forces of this donning are not corrected: {reason}")),
        }
    }
    let (reply, installed) = oneshot::channel();
    let told = shared.commands.send(Command::Calibrated(Box::new(donning.clone()), from.clone(), reply));
    let installed = if told.is_ok() { installed.await.unwrap_or_else(|_| Err(gone())) } else { Err(gone()) };
    if let Err(message) = installed {
        return Ok(CalibrateResult { success: false, message, ..result });
    }
    if let Some(warned) = &warned {
        shared.outbox.log(Severity::Warn, warned.as_str());
    }
    let noted = [Some(std::mem::take(&mut result.message)).filter(|noted| !noted.is_empty()), warned];
    let parts: Vec<String> = [from.clone()].into_iter().chain(noted.into_iter().flatten()).collect();
    result.message = parts.join("; ");
    if purpose == Purpose::Calibrate {
        save(shared, &cfg, donning, from, &mut result);
    }
    Ok(result)
}

/// Judges what was collected in the air. The result has the reason if there is no donning.
async fn judge(
    shared: &Shared,
    collected: &mut Collected<'_>,
    cfg: Config,
    purpose: Purpose,
) -> Result<(Option<Donning>, CalibrateResult), Refused> {
    // A tare keeps the known gains: in a few seconds the hand may not have moved.
    let mut before = Donning::default();
    if purpose == Purpose::Tare {
        let (reply, known) = oneshot::channel();
        if shared.commands.send(Command::Known(reply)).is_ok() {
            (before, _) = known.await.unwrap_or_default();
        }
    }
    let calibrator = std::mem::replace(&mut collected.calibrator, Calibrator::new(&cfg, purpose, Duration::ZERO));
    let judging = tokio::task::spawn_blocking(move || {
        let judged = loading::fusion(&cfg).map(|(judge, _)| calibrator.finish(judge, &before));
        (judged, calibrator)
    });
    let (judged, calibrator) = judging.await.map_err(|error| error.to_string())?;
    collected.calibrator = calibrator;
    judged
}

/// Fits the gains of a donning to touches of the force sensors.
async fn fit_gains(
    collected: &mut Collected<'_>,
    cfg: &Config,
    donning: &Donning,
    rest: Duration,
) -> Result<Vec<RegionTouches>, String> {
    let readings: Vec<TruthReading> = std::iter::from_fn(|| collected.readings.try_recv().ok()).collect();
    let calibrator = std::mem::replace(&mut collected.calibrator, Calibrator::new(cfg, Purpose::Tare, Duration::ZERO));
    let (cfg, donning) = (cfg.clone(), donning.clone());
    let fitting = tokio::task::spawn_blocking(move || {
        known_touches::gains(&cfg, &donning, rest.as_secs_f64(), calibrator.samples(), &readings)
    });
    fitting.await.map_err(|error| error.to_string())?
}

/// Keeps a calibration that is in use in its file.
fn save(shared: &Shared, cfg: &Config, donning: Donning, from: String, result: &mut CalibrateResult) {
    let zero = Zero::new(ZeroFrom::Live { frames: result.frames }, donning);
    let mut calibration = zero.to_calibration(cfg, &shared.known.borrow().hashes);
    calibration.recorded = from;
    match &cfg.calibration.file {
        None => result.message.push_str("; it is lost when the node ends: calibration.file is not set"),
        Some(path) => match calibration.replace(path) {
            Ok(()) => {
                result.file = path.display().to_string();
                result.message.push_str(&format!("; kept in {}", result.file));
            }
            Err(error) => result.message.push_str(&format!("; in use, but not kept: {error}")),
        },
    }
}

/// A goal in progress.
struct Active {
    goal: GoalId,
    cancelled: Rc<Cell<bool>>,
    feedback: mpsc::UnboundedReceiver<CalibrateFeedback>,
    result: oneshot::Receiver<CalibrateResult>,
}

/// The known goals.
struct Goals {
    feedback: Sender<FeedbackMessage<CalibrateFeedback>>,
    status: Sender<GoalStatusArray>,
    active: Option<Active>,
    accepted: BTreeMap<GoalId, (WireTime, GoalStatusEnum)>,
    finished: VecDeque<(GoalId, GoalStatusEnum, CalibrateResult)>,
    asked: Vec<(GoalId, Answer<GetResultResponse<CalibrateResult>>)>,
}

/// Offers the action. Must be called within a local set.
pub(super) fn start(graph: &mut Graph, shared: &Rc<Shared>) -> Result<(), NodeError> {
    let Action { mut goals, mut cancels, mut results, feedback, status } = graph.action("~/calibrate")?;
    let (accepted, finished) = (BTreeMap::new(), VecDeque::new());
    let mut known = Goals { feedback, status, active: None, accepted, finished, asked: Vec::new() };
    let shared = Rc::clone(shared);
    tokio::task::spawn_local(async move {
        let _vital = Vital::new("calibrate");
        let mut poll = tokio::time::interval(POLL);
        poll.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                Some(Ok(request)) = goals.next() => known.handle_goal(request, &shared).await,
                Some(Ok(request)) = cancels.next() => known.handle_cancel(request, &shared).await,
                Some(Ok(request)) = results.next() => known.handle_result_request(request).await,
                _ = poll.tick() => known.go_on(),
            }
            known.answer_results().await;
        }
    });
    Ok(())
}

impl Goals {
    async fn handle_goal(
        &mut self,
        request: Request<SendGoalRequest<CalibrateGoal>, SendGoalResponse>,
        shared: &Rc<Shared>,
    ) {
        let Request { question: SendGoalRequest { goal_id, goal }, answer } = request;
        let stamp = WireTime::from_nanos(shared.clock.now().0);
        let default = shared.parameters.borrow().config().calibration.duration;
        let asked = u64::try_from(goal.duration.nanos()).map(Duration::from_nanos);
        let duration = match asked {
            Ok(Duration::ZERO) => Ok(default),
            Ok(duration) if duration <= MAX_DURATION => Ok(duration),
            _ => Err("a calibration takes 0 to 600 s"),
        };
        let accepted = match (&self.active, duration) {
            (Some(_), _) => Err("a calibration is under way already"),
            (None, duration) => duration,
        };
        if let Err(reason) = accepted {
            shared.outbox.log(Severity::Warn, format!("goal of ~/calibrate rejected: {reason}"));
        }
        if answer(SendGoalResponse { accepted: accepted.is_ok(), stamp }).await.is_err() {
            return;
        }
        if let Ok(duration) = accepted {
            self.accepted.insert(goal_id, (stamp, GoalStatusEnum::Executing));
            self.begin(shared, goal_id, duration);
            self.publish_status();
        }
    }

    fn begin(&mut self, shared: &Rc<Shared>, goal: GoalId, duration: Duration) {
        let cancelled = Rc::new(Cell::new(false));
        let (feedback_sender, feedback) = mpsc::unbounded_channel();
        let (result_sender, result) = oneshot::channel();
        let (shared, cancel) = (Rc::clone(shared), Rc::clone(&cancelled));
        tokio::task::spawn_local(async move {
            let _vital = Vital::new("calibrate");
            let give = |feedback| {
                let _ = feedback_sender.send(feedback); // the action server lives as long as the node
            };
            let result = calibrate(&shared, Purpose::Calibrate, duration, give, || cancel.get()).await;
            let _ = result_sender.send(result);
        });
        self.active = Some(Active { goal, cancelled, feedback, result });
    }

    async fn handle_cancel(&mut self, request: Request<CancelGoalRequest, CancelGoalResponse>, shared: &Shared) {
        let wanted = wanted(&request.question);
        let zero = CancelGoal::default().goal_id;
        let active = self.active.as_ref().filter(|active| wanted == zero || *active.goal.uuid.as_bytes() == wanted);
        let (return_code, goals_canceling) = match active {
            Some(active) => {
                active.cancelled.set(true);
                let stamp = self.accepted.get(&active.goal).map_or(WireTime::ZERO, |(stamp, _)| *stamp);
                (CancelGoalResponseEnum::None, vec![GoalInfo { goal_id: active.goal, stamp }])
            }
            None => (CancelGoalResponseEnum::UnknownGoal, Vec::new()),
        };
        if (request.answer)(CancelGoalResponse { return_code, goals_canceling }).await.is_err() {
            shared.outbox.log(Severity::Warn, "a cancel response of ~/calibrate could not be sent");
        }
    }

    async fn handle_result_request(&mut self, request: Request<GetResultRequest, GetResultResponse<CalibrateResult>>) {
        let Request { question, answer } = request;
        if self.asked.len() < MAX_ASKED {
            self.asked.push((question.goal_id, answer));
            return;
        }
        let (status, result) = (GoalStatusEnum::Unknown, CalibrateResult::default());
        let _ = answer(GetResultResponse { status, result }).await; // the client may ask again
    }

    /// Answers requests for the result of a goal that is not in progress.
    async fn answer_results(&mut self) {
        let at_work = |goal: &GoalId| self.active.as_ref().is_some_and(|active| active.goal == *goal);
        let (waiting, due): (Vec<_>, Vec<_>) = self.asked.drain(..).partition(|(goal, _)| at_work(goal));
        self.asked = waiting;
        for (goal, answer) in due {
            let found = self.finished.iter().find(|(finished, ..)| *finished == goal);
            let (status, result) = found.map_or_else(
                || (GoalStatusEnum::Unknown, CalibrateResult::default()),
                |(_, status, result)| (*status, result.clone()),
            );
            let _ = answer(GetResultResponse { status, result }).await; // the client may ask again
        }
    }

    fn go_on(&mut self) {
        let Some(active) = &mut self.active else { return };
        while let Ok(feedback) = active.feedback.try_recv() {
            let message = FeedbackMessage { goal_id: active.goal, feedback };
            let _ = (self.feedback)(message); // the next one says as much
        }
        let result = match active.result.try_recv() {
            Err(oneshot::error::TryRecvError::Empty) => return,
            Ok(result) => result,
            Err(oneshot::error::TryRecvError::Closed) => CalibrateResult::default(),
        };
        let status = match (result.success, active.cancelled.get()) {
            (true, _) => GoalStatusEnum::Succeeded,
            (false, true) => GoalStatusEnum::Canceled,
            (false, false) => GoalStatusEnum::Aborted,
        };
        let goal = active.goal;
        self.active = None;
        if let Some((_, known)) = self.accepted.get_mut(&goal) {
            *known = status;
        }
        self.finished.push_back((goal, status, result));
        if self.finished.len() > KEPT_RESULTS
            && let Some((forgotten, ..)) = self.finished.pop_front()
        {
            self.accepted.remove(&forgotten);
        }
        self.publish_status();
    }

    fn publish_status(&self) {
        let status = |(goal_id, (stamp, status)): (&GoalId, &(WireTime, GoalStatusEnum))| GoalStatus {
            goal_info: GoalInfo { goal_id: *goal_id, stamp: *stamp },
            status: *status,
        };
        let array = GoalStatusArray { status_list: self.accepted.iter().map(status).collect() };
        let _ = (self.status)(array); // clients have the result besides
    }
}

/// The goal that a cancel request names. ros2-client keeps that field to itself, so it is read from the bytes.
fn wanted(request: &CancelGoalRequest) -> [u8; 16] {
    let bytes = cdr_encoding::to_vec::<_, LittleEndian>(request).unwrap_or_default();
    cdr_encoding::from_bytes::<CancelGoal, LittleEndian>(&bytes).map_or([0; 16], |(goal, _)| goal.goal_id)
}
