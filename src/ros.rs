//! The live node: the core that replay uses, connected to the topics of a ROS 2 graph.
//!
//! Three parts, each of which uses only those before it: `wire` connects a process to the graph, `node` is the node, and
//! `tools` listen and play for the commands.
//!
//! Four threads share the work of a node. One reads inputs and runs the core (`node::engine`), one publishes
//! (`node::outbox`), one answers services (`node::serving`). The thread that calls [`run`] waits for the end and leaves
//! the graph in time. Pure parts (arguments, environment, QoS, lifecycle, diagnostics, health, graph, watchdog and
//! calibration) take their data as arguments and are tested without a network.

pub mod node;
pub mod tools;
pub mod wire;

pub use node::{
    Calibrator, DIAGNOSTICS_TYPE, Health, IN_AIR, Purpose, Record, Sample, Setup, TOUCH, Watched, input_bindings,
    read_diagnostics, run, wanted,
};
pub use tools::{
    CallError, Caller, Delivery, Examination, Finding, Incoming, Inputs, Level, Listener, Listening, Monitored,
    MonitoredRegion, NodeParameter, NotPlayed, PlayedTopic, Player, PublishedTopic, Request, SubscribedTopic, Topic,
    examine, instead,
};
pub use wire::clock::system_now;
pub use wire::entities::{InputName, Names};
pub use wire::error::NodeError;
pub use wire::graph::Endpoint;
pub use wire::middleware::TopicType;
pub use wire::{args, environment, remap, security};
