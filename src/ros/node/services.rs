//! The services that other nodes call, except the calibrate action.

use std::rc::Rc;
use std::time::Duration;

use futures::StreamExt;
use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest, GetParameterTypesResponse,
    GetParametersRequest, GetParametersResponse, ListParametersRequest, ListParametersResponse, ListParametersResult,
    SetParametersAtomicallyResponse, SetParametersRequest, SetParametersResponse,
};

use super::calibrating::calibrate;
use super::calibration_file;
use super::calibrator::Purpose;
use super::engine::Command;
use super::interfaces::{
    ChangeStateRequest, ChangeStateResponse, Empty, GetAvailableStatesResponse, GetAvailableTransitionsResponse,
    GetStateResponse, TriggerResponse,
};
use super::lifecycle::{State, TRANSITIONS};
use super::managed;
use super::parameters::{self, ParameterEvent, Parameters, TooLarge};
use super::shared::Shared;
use crate::msg::to_cdr;
use crate::ros::wire::args::Severity;
use crate::ros::wire::entities::Graph;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::middleware::{Request, Requests};
use crate::ros::wire::threads::Vital;

/// Duration of a tare: enough for a window of the model and as much again to judge it.
const TARE: Duration = Duration::from_secs(2);

/// Offers the services. Must be called within a local set.
pub(super) fn start(graph: &mut Graph, shared: &Rc<Shared>) -> Result<(), NodeError> {
    lifecycle(graph, shared)?;
    parameters(graph, shared)?;
    let tare = graph.server::<Empty, TriggerResponse>("~/tare", "std_srvs/srv/Trigger")?;
    let of = Rc::clone(shared);
    serve(tare, shared, async move |_| {
        let result = calibrate(&of, Purpose::Tare, TARE, |_| {}, || false).await;
        TriggerResponse { success: result.success, message: result.message }
    });
    Ok(())
}

fn lifecycle(graph: &mut Graph, shared: &Rc<Shared>) -> Result<(), NodeError> {
    let change =
        graph.server::<ChangeStateRequest, ChangeStateResponse>("~/change_state", "lifecycle_msgs/srv/ChangeState")?;
    let of = Rc::clone(shared);
    serve(change, shared, async move |request: ChangeStateRequest| {
        let changed = managed::change(&of, request.transition.id, &request.transition.label).await;
        if let Err(reason) = &changed {
            of.outbox.log(Severity::Error, reason.as_str());
        }
        ChangeStateResponse { success: changed.is_ok() }
    });
    let state = graph.server::<Empty, GetStateResponse>("~/get_state", "lifecycle_msgs/srv/GetState")?;
    let of = Rc::clone(shared);
    serve(state, shared, async move |_| GetStateResponse { current_state: of.managed.state().into() });
    let states = graph.server::<Empty, GetAvailableStatesResponse>(
        "~/get_available_states",
        "lifecycle_msgs/srv/GetAvailableStates",
    )?;
    serve(states, shared, async |_| GetAvailableStatesResponse { available_states: State::ALL.map(Into::into).into() });
    let kind = "lifecycle_msgs/srv/GetAvailableTransitions";
    let possible = graph.server::<Empty, GetAvailableTransitionsResponse>("~/get_available_transitions", kind)?;
    let of = Rc::clone(shared);
    serve(possible, shared, async move |_| GetAvailableTransitionsResponse {
        available_transitions: of.managed.life.borrow().available().map(Into::into).collect(),
    });
    let all = graph.server::<Empty, GetAvailableTransitionsResponse>("~/get_transition_graph", kind)?;
    serve(all, shared, async |_| GetAvailableTransitionsResponse {
        available_transitions: TRANSITIONS.iter().map(Into::into).collect(),
    });
    Ok(())
}

fn parameters(graph: &mut Graph, shared: &Rc<Shared>) -> Result<(), NodeError> {
    let get = graph.server("~/get_parameters", "rcl_interfaces/srv/GetParameters")?;
    let of = Rc::clone(shared);
    serve(get, shared, async move |request: GetParametersRequest| GetParametersResponse {
        values: each(&of, &request.names, Parameters::get),
    });
    let types = graph.server("~/get_parameter_types", "rcl_interfaces/srv/GetParameterTypes")?;
    let of = Rc::clone(shared);
    serve(types, shared, async move |request: GetParameterTypesRequest| GetParameterTypesResponse {
        values: each(&of, &request.names, |parameters, name| parameters.get(name).ptype),
    });
    let list = graph.server("~/list_parameters", "rcl_interfaces/srv/ListParameters")?;
    let of = Rc::clone(shared);
    serve(list, shared, async move |request: ListParametersRequest| {
        let (names, prefixes) = match heeded(&of, parameters::check_names(&request.prefixes)) {
            true => of.parameters.borrow().list(&request.prefixes, request.depth),
            false => Default::default(),
        };
        ListParametersResponse { result: ListParametersResult { names, prefixes } }
    });
    let describe = graph.server("~/describe_parameters", "rcl_interfaces/srv/DescribeParameters")?;
    let of = Rc::clone(shared);
    serve(describe, shared, async move |request: DescribeParametersRequest| DescribeParametersResponse {
        values: each(&of, &request.names, Parameters::describe),
    });
    let separately = graph.server("~/set_parameters", "rcl_interfaces/srv/SetParameters")?;
    let of = Rc::clone(shared);
    serve(separately, shared, async move |request: SetParametersRequest| SetParametersResponse {
        results: set_each(&of, &request.parameter).await,
    });
    let together = graph.server("~/set_parameters_atomically", "rcl_interfaces/srv/SetParametersAtomically")?;
    let of = Rc::clone(shared);
    serve(together, shared, async move |request: SetParametersRequest| SetParametersAtomicallyResponse {
        result: refusals_logged(&of, vec![set(&of, &request.parameter).await]).remove(0),
    });
    Ok(())
}

/// The answer for each name; empty, as in rclcpp, if there are too many.
fn each<T>(shared: &Shared, names: &[String], say: impl Fn(&Parameters, &str) -> T) -> Vec<T> {
    let parameters = shared.parameters.borrow();
    match heeded(shared, parameters::check_names(names)) {
        true => names.iter().map(|name| say(&parameters, name)).collect(),
        false => Vec::new(),
    }
}

/// True if a request is small enough to be answered; otherwise it is logged.
fn heeded(shared: &Shared, checked: Result<(), TooLarge>) -> bool {
    if let Err(error) = checked {
        shared.outbox.log(Severity::Warn, format!("a request for parameters was refused: {error}"));
    }
    checked.is_ok()
}

/// Sets parameters one by one, and handles other requests in between.
async fn set_each(shared: &Shared, changes: &[raw::Parameter]) -> Vec<raw::SetParametersResult> {
    if let Err(error) = parameters::check_values(changes) {
        // The client expects as many results as it set; the reason is in the first.
        let refusal = |reason: String| raw::SetParametersResult { successful: false, reason };
        let rest = (1..changes.len()).map(|_| refusal("as the first".to_owned()));
        let first = refusals_logged(shared, vec![refusal(error.to_string())]);
        return first.into_iter().chain(rest).collect();
    }
    let mut results = Vec::new();
    for change in changes {
        results.push(set(shared, std::slice::from_ref(change)).await);
        tokio::task::yield_now().await;
    }
    refusals_logged(shared, results)
}

/// Logs the refusals, in one line: a thousand lines would displace estimates that wait to be published.
fn refusals_logged(shared: &Shared, results: Vec<raw::SetParametersResult>) -> Vec<raw::SetParametersResult> {
    let mut refused = results.iter().filter(|result| !result.successful);
    if let Some(first) = refused.next() {
        let more = match refused.count() {
            0 => String::new(),
            n => format!(" (and {n} more)"),
        };
        shared.outbox.log(Severity::Warn, format!("parameter refused: {}{more}", first.reason));
    }
    results
}

/// Sets parameters together, and informs everyone who uses them.
async fn set(shared: &Shared, changes: &[raw::Parameter]) -> raw::SetParametersResult {
    let refused = |reason| raw::SetParametersResult { successful: false, reason };
    let changes = match parameters::check_values(changes) {
        Ok(()) => calibration_file::load(shared, changes).await,
        Err(error) => Err(error.to_string()),
    };
    let changes = match changes {
        Ok(changes) => changes,
        Err(reason) => return refused(reason),
    };
    let set = shared.parameters.borrow_mut().set(&changes);
    if let Err(reason) = set {
        return refused(reason);
    }
    let parameters = shared.parameters.borrow();
    let thresholds = parameters.config().fusion().regions().iter().map(|region| region.contact).collect();
    let _ = shared.commands.send(Command::Thresholds(thresholds)); // an engine that is gone has no thresholds
    let event = ParameterEvent::changed(shared.clock.now().into(), &shared.node_name, parameters.now(&changes));
    shared.outbox.send(shared.parameter_events, to_cdr(&event), None);
    raw::SetParametersResult { successful: true, reason: String::new() }
}

/// Answers the requests of a service, one after the other.
fn serve<Q, A>(mut requests: Requests<Q, A>, shared: &Rc<Shared>, mut reply: impl AsyncFnMut(Q) -> A + 'static)
where
    Q: 'static,
    A: 'static,
{
    let outbox = shared.outbox.clone();
    tokio::task::spawn_local(async move {
        let _vital = Vital::new("services");
        let mut n_unreadable = 0_u64;
        while let Some(request) = requests.next().await {
            match request {
                Ok(Request { question, answer }) => {
                    let response = reply(question).await;
                    if let Err(error) = answer(response).await {
                        outbox.log(Severity::Warn, format!("a service's response could not be sent: {error}"));
                    }
                }
                Err(error) => {
                    n_unreadable += 1;
                    // Only now and then: one line per request would displace estimates that wait to be published.
                    if n_unreadable.is_power_of_two() {
                        let text = format!("a service request could not be read, {n_unreadable} so far: {error}");
                        outbox.log(Severity::Warn, text);
                    }
                }
            }
        }
    });
}
