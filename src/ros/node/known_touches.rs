//! Touches of the force sensors after a calibration, from which the gain of the donning is fitted.

use std::collections::BTreeSet;
use std::rc::Rc;

use futures::StreamExt;

use super::calibrator::Sample;
use super::loading;
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
use crate::sessions::{KnownForces, RegionTouches, TruthReading, live_force_gains};
use crate::zero::{Donning, Zero, ZeroFrom};

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
    cfg.truth.iter().zip(&names.truth).enumerate().map(of_sensor).collect()
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

/// Fits the gains of a donning. `samples` and `readings` begin with `cfg.calibration.duration` or more without load, of which
/// `rest_s` seconds are taken for the zero of the force sensors.
///
/// # Errors
/// Why there is no gain, on one line.
pub(super) fn gains(
    cfg: &Config,
    donning: &Donning,
    rest_s: f64,
    samples: &[Sample],
    readings: &[TruthReading],
) -> Result<Vec<RegionTouches>, String> {
    let (mut core, _) = loading::fusion(cfg)?;
    let seconds = vec![rest_s; cfg.fusion.tactile_sources().len()];
    let zero = Zero::new(ZeroFrom::First { seconds }, donning.clone());
    zero.install(&mut core).map_err(|error| error.to_string())?;
    live_force_gains(cfg, &zero, core, samples.iter().map(Sample::event), readings, &KnownForces::Sensor)
}
