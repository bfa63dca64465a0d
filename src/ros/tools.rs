//! Clients of a graph for the commands: what listens to topics, what calls a running node,
//! what examines a graph, and what plays a bag.

mod caller;
mod doctor;
mod inputs;
mod listener;
mod monitored;
mod player;

pub use caller::{CallError, Caller, NodeParameter, instead};
pub use doctor::{Examination, Finding, Level, Request, Topic, examine};
pub use inputs::Inputs;
pub use listener::{Delivery, Incoming, Listener, Listening, PublishedTopic, SubscribedTopic};
pub use monitored::{Monitored, MonitoredRegion};
pub use player::{NotPlayed, PlayedTopic, Player};
