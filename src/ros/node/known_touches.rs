//! The force sensors, whose touches after a calibration give the gain of the donning.

use std::collections::BTreeSet;
use std::rc::Rc;

use futures::StreamExt;

use super::shared::Shared;
use crate::config::{Config, ParamTree};
use crate::msg::binding::{Topic, TruthBinding, TruthFields};
use crate::msg::definition::Definitions;
use crate::ros::wire::args::Severity;
use crate::ros::wire::entities::{Graph, Names};
use crate::ros::wire::error::NodeError;
use crate::ros::wire::middleware::{Subscription, TopicType};
use crate::ros::wire::qos::{self, Side};
use crate::ros::wire::threads::Vital;
use crate::sessions::TruthReading;

/// A force sensor that is subscribed to.
pub(super) struct TruthInput {
    sensor: usize,
    topic: String,
    subscription: Subscription,
    binding: TruthBinding,
}

/// Subscribes to the force sensors, if calibrations look for touches of them.
pub(super) fn subscribe(
    graph: &mut Graph,
    cfg: &Config,
    tree: &ParamTree,
    names: &Names,
    definitions: &Definitions,
) -> Result<Vec<TruthInput>, NodeError> {
    if cfg.calibration.touch_duration.is_zero() {
        return Ok(Vec::new());
    }
    let of_sensor = |(sensor, (truth, topic)): (usize, (&Topic<TruthFields>, &String))| {
        let ty = definitions.tree(&truth.type_name)?;
        let refused = |error| NodeError::Binding { topic: topic.clone(), error: Box::new(error) };
        let binding = TruthBinding::compile(&truth.fields, &ty).map_err(refused)?;
        let qos = qos::with_overrides(qos::input_default(), tree, topic, Side::Subscription)?;
        let subscription = graph.subscription(topic, TopicType::Defined(&ty), &qos)?;
        Ok(TruthInput { sensor, topic: topic.clone(), subscription, binding })
    };
    cfg.truth().iter().zip(&names.truth).enumerate().map(of_sensor).collect()
}

/// Reads a force sensor, and hands its readings over while a calibration collects them. Must be called within a local set.
pub(super) fn follow(input: TruthInput, shared: Rc<Shared>) {
    tokio::task::spawn_local(async move {
        let _vital = Vital::new("force sensor");
        let TruthInput { sensor, topic, subscription, mut binding } = input;
        let mut arrivals = subscription.arrivals();
        let mut said = BTreeSet::new();
        while let Some(arrival) = arrivals.next().await {
            let read = match arrival {
                Ok(arrival) => match binding.decode(&arrival.cdr, arrival.received) {
                    Ok((stamp, force)) => {
                        if let Some(tap) = &*shared.truth_tap.borrow() {
                            let _ = tap.send(TruthReading { sensor, stamp, force }); // the calibration has ended
                        }
                        Ok(())
                    }
                    Err(error) if error.is_for_another() => Ok(()),
                    Err(error) => Err(error.to_string()),
                },
                Err(fault) => Err(fault.text),
            };
            if let Err(text) = read
                && said.len() < 10
                && said.insert(text.clone())
            {
                shared.outbox.log(Severity::Warn, format!("topic {topic}: a message could not be read: {text}"));
            }
        }
    });
}
