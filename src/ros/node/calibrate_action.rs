//! The `~/calibrate` action.

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

use super::calibrating::{POLL, calibrate};
use super::calibrator::Purpose;
use super::interfaces::CancelGoal;
use super::shared::Shared;
use crate::msg::{CalibrateFeedback, CalibrateGoal, CalibrateResult};
use crate::ros::wire::args::Severity;
use crate::ros::wire::entities::Graph;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::middleware::{Action, Answer, Request, Sender};
use crate::ros::wire::threads::Vital;

/// Number of results kept for clients that ask late.
const KEPT_RESULTS: usize = 16;

/// Number of clients that may wait for the result of a goal; any further client gets "unknown".
const MAX_ASKED: usize = 64;

/// Longest calibration that a goal may ask for, as in the table of parameters.
const MAX_DURATION: Duration = Duration::from_secs(600);

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
