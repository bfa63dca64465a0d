//! The services that other nodes call, but for the calibrate action.

use std::rc::Rc;
use std::time::Duration;

use futures::StreamExt;
use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest, GetParameterTypesResponse,
    GetParametersRequest, GetParametersResponse, ListParametersRequest, ListParametersResponse, ListParametersResult,
    SetParametersAtomicallyResponse, SetParametersRequest, SetParametersResponse,
};

use super::args::Severity;
use super::calibrate_action::calibrate;
use super::calibrator::Purpose;
use super::engine::Command;
use super::entities::Graph;
use super::interfaces::{
    ChangeStateRequest, ChangeStateResponse, Empty, GetAvailableStatesResponse, GetAvailableTransitionsResponse,
    GetStateResponse, TriggerResponse,
};
use super::lifecycle::{State, TRANSITIONS};
use super::middleware::{Request, Requests};
use super::node::{NodeError, Shared};
use super::parameters::ParameterEvent;
use crate::msg::to_cdr;

/// How long a tare collects: enough for a window of the model and as much to judge it by.
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
        let changed = of.managed.change(&of, request.transition.id, &request.transition.label).await;
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
        values: request.names.iter().map(|name| of.parameters.borrow().get(name)).collect(),
    });
    let types = graph.server("~/get_parameter_types", "rcl_interfaces/srv/GetParameterTypes")?;
    let of = Rc::clone(shared);
    serve(types, shared, async move |request: GetParameterTypesRequest| GetParameterTypesResponse {
        values: request.names.iter().map(|name| of.parameters.borrow().get(name).ptype).collect(),
    });
    let list = graph.server("~/list_parameters", "rcl_interfaces/srv/ListParameters")?;
    let of = Rc::clone(shared);
    serve(list, shared, async move |request: ListParametersRequest| {
        let (names, prefixes) = of.parameters.borrow().list(&request.prefixes, request.depth);
        ListParametersResponse { result: ListParametersResult { names, prefixes } }
    });
    let describe = graph.server("~/describe_parameters", "rcl_interfaces/srv/DescribeParameters")?;
    let of = Rc::clone(shared);
    serve(describe, shared, async move |request: DescribeParametersRequest| DescribeParametersResponse {
        values: request.names.iter().map(|name| of.parameters.borrow().describe(name)).collect(),
    });
    let each = graph.server("~/set_parameters", "rcl_interfaces/srv/SetParameters")?;
    let of = Rc::clone(shared);
    serve(each, shared, async move |request: SetParametersRequest| SetParametersResponse {
        results: request.parameter.iter().map(|change| set(&of, std::slice::from_ref(change))).collect(),
    });
    let together = graph.server("~/set_parameters_atomically", "rcl_interfaces/srv/SetParametersAtomically")?;
    let of = Rc::clone(shared);
    serve(together, shared, async move |request: SetParametersRequest| SetParametersAtomicallyResponse {
        result: set(&of, &request.parameter),
    });
    Ok(())
}

/// Sets parameters together, and lets those who run by them know.
fn set(shared: &Shared, changes: &[raw::Parameter]) -> raw::SetParametersResult {
    let set = shared.parameters.borrow_mut().set(changes);
    match set {
        Ok(()) => {
            let regions = shared.parameters.borrow().config().fusion.regions.clone();
            let thresholds = regions.into_iter().map(|region| region.contact).collect();
            let _ = shared.commands.send(Command::Thresholds(thresholds)); // an engine that is gone has no thresholds
            let event = ParameterEvent::changed(shared.clock.now().into(), &shared.node_name, changes.to_vec());
            shared.outbox.send(shared.parameter_events, to_cdr(&event), None);
            raw::SetParametersResult { successful: true, reason: String::new() }
        }
        Err(reason) => {
            shared.outbox.log(Severity::Warn, format!("parameter refused: {reason}"));
            raw::SetParametersResult { successful: false, reason }
        }
    }
}

/// Answers the requests of a service, one after the other.
fn serve<Q, A>(mut requests: Requests<Q, A>, shared: &Rc<Shared>, mut reply: impl AsyncFnMut(Q) -> A + 'static)
where
    Q: 'static,
    A: 'static,
{
    let outbox = shared.outbox.clone();
    tokio::task::spawn_local(async move {
        while let Some(request) = requests.next().await {
            match request {
                Ok(Request { question, answer }) => {
                    let response = reply(question).await;
                    if let Err(error) = answer(response).await {
                        outbox.log(Severity::Warn, format!("a service's response could not be sent: {error}"));
                    }
                }
                Err(error) => outbox.log(Severity::Warn, format!("a service request could not be read: {error}")),
            }
        }
    });
}
