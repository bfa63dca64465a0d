//! ROS 2 messages and services that only the live node uses. Fields are in the order of the `.msg` files.

use ros2_client::Message;
use serde::{Deserialize, Serialize};

use super::diagnostics::Status;
use super::lifecycle;
use crate::msg::{CalibrateFeedback, CalibrateGoal, CalibrateResult, Header, Time, WireType, from_cdr};
use crate::ros::wire::args::Severity;

/// A request without fields, which is one unused byte on the wire.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(in crate::ros) struct Empty {
    unused: u8,
}

/// `std_srvs/srv/Trigger`, the response.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(in crate::ros) struct TriggerResponse {
    pub(in crate::ros) success: bool,
    pub(in crate::ros) message: String,
}

/// `rcl_interfaces/msg/Log`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(in crate::ros) struct Log {
    pub(in crate::ros) stamp: Time,
    pub(in crate::ros) level: u8,
    pub(in crate::ros) name: String,
    pub(in crate::ros) msg: String,
    file: String,
    function: String,
    line: u32,
}

impl Log {
    /// A log line without a source location.
    pub(super) fn new(stamp: Time, severity: Severity, logger: &str, text: &str) -> Self {
        Log { stamp, level: severity as u8, name: logger.to_owned(), msg: text.to_owned(), ..Log::default() }
    }
}

impl WireType for Log {
    const TYPE_NAME: &'static str = "rcl_interfaces/msg/Log";
}

/// `diagnostic_msgs/msg/DiagnosticArray`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct DiagnosticArray {
    header: Header,
    status: Vec<DiagnosticStatus>,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct DiagnosticStatus {
    level: u8,
    name: String,
    message: String,
    hardware_id: String,
    values: Vec<KeyValue>,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct KeyValue {
    key: String,
    value: String,
}

impl DiagnosticArray {
    /// A message with these statuses.
    pub(super) fn new(stamp: Time, hardware_id: &str, statuses: Vec<Status>) -> Self {
        let value = |(key, value)| KeyValue { key, value };
        let status = |status: Status| DiagnosticStatus {
            level: status.level as u8,
            name: status.name,
            message: status.message,
            hardware_id: hardware_id.to_owned(),
            values: status.values.into_iter().map(value).collect(),
        };
        let header = Header { stamp, frame_id: String::new() };
        DiagnosticArray { header, status: statuses.into_iter().map(status).collect() }
    }
}

impl WireType for DiagnosticArray {
    const TYPE_NAME: &'static str = DIAGNOSTICS_TYPE;
}

/// The type of `/diagnostics`.
pub const DIAGNOSTICS_TYPE: &str = "diagnostic_msgs/msg/DiagnosticArray";

/// Status of a part of some node on `/diagnostics`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Health {
    /// OK, WARN, ERROR or STALE.
    pub level: &'static str,
    /// Name of the part; those of the live node begin with the node's name.
    pub name: String,
    /// Summary in a few words.
    pub message: String,
}

/// Reads a message of `/diagnostics`; `None` if the bytes are no such message.
pub fn read_diagnostics(cdr: &[u8]) -> Option<Vec<Health>> {
    let array: DiagnosticArray = from_cdr(cdr).ok()?;
    let level = |level: u8| *["OK", "WARN", "ERROR", "STALE"].get(usize::from(level)).unwrap_or(&"?");
    let health =
        |status: DiagnosticStatus| Health { level: level(status.level), name: status.name, message: status.message };
    Some(array.status.into_iter().map(health).collect())
}

/// `lifecycle_msgs/msg/State`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(in crate::ros) struct State {
    id: u8,
    pub(in crate::ros) label: String,
}

impl From<lifecycle::State> for State {
    fn from(state: lifecycle::State) -> Self {
        State { id: state.id(), label: state.label().to_owned() }
    }
}

/// `lifecycle_msgs/msg/Transition`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(in crate::ros) struct Transition {
    pub(in crate::ros) id: u8,
    pub(in crate::ros) label: String,
}

/// `lifecycle_msgs/msg/TransitionDescription`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct TransitionDescription {
    transition: Transition,
    start_state: State,
    goal_state: State,
}

impl From<&lifecycle::Transition> for TransitionDescription {
    fn from(step: &lifecycle::Transition) -> Self {
        TransitionDescription {
            transition: Transition { id: step.id, label: step.label.to_owned() },
            start_state: step.start.into(),
            goal_state: step.goal.into(),
        }
    }
}

/// `lifecycle_msgs/msg/TransitionEvent`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct TransitionEvent {
    timestamp: u64,
    description: TransitionDescription,
}

impl TransitionEvent {
    /// The event of a transition at a time in ns.
    pub(super) fn new(nanos: i64, step: &lifecycle::Transition) -> Self {
        TransitionEvent { timestamp: nanos.unsigned_abs(), description: step.into() }
    }
}

impl WireType for TransitionEvent {
    const TYPE_NAME: &'static str = "lifecycle_msgs/msg/TransitionEvent";
}

/// `lifecycle_msgs/srv/ChangeState`, the request.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(in crate::ros) struct ChangeStateRequest {
    pub(in crate::ros) transition: Transition,
}

/// `lifecycle_msgs/srv/ChangeState`, the response.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(in crate::ros) struct ChangeStateResponse {
    pub(in crate::ros) success: bool,
}

/// `lifecycle_msgs/srv/GetState`, the response.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(in crate::ros) struct GetStateResponse {
    pub(in crate::ros) current_state: State,
}

/// `lifecycle_msgs/srv/GetAvailableStates`, the response.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct GetAvailableStatesResponse {
    pub(super) available_states: Vec<State>,
}

/// `lifecycle_msgs/srv/GetAvailableTransitions`, the response: the transitions possible now, or all of them.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct GetAvailableTransitionsResponse {
    pub(super) available_transitions: Vec<TransitionDescription>,
}

/// The goal that an action client wants to cancel: `action_msgs/srv/CancelGoal`, the request.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct CancelGoal {
    pub(super) goal_id: [u8; 16],
    pub(super) stamp: Time,
}

impl Message for Empty {}
impl Message for TriggerResponse {}
impl Message for ChangeStateRequest {}
impl Message for ChangeStateResponse {}
impl Message for GetStateResponse {}
impl Message for GetAvailableStatesResponse {}
impl Message for GetAvailableTransitionsResponse {}
impl Message for CalibrateGoal {}
impl Message for CalibrateResult {}
impl Message for CalibrateFeedback {}
