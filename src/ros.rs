//! The live node: the core that replay uses, connected to the topics of a ROS 2 graph.
//!
//! Four threads share the work. One reads inputs and runs the core (`engine`), one publishes (`outbox`), one answers
//! services (`serving`). The thread that calls [`run`] waits for the end and leaves the graph in time (`node`). Pure
//! parts: arguments, environment, QoS, lifecycle, diagnostics, health, graph, watchdog and calibration take their data
//! as arguments and are tested without a network.

pub mod args;
pub mod diagnostics;
pub mod environment;
pub mod graph;
pub mod health;
pub mod lifecycle;
pub mod qos;
pub mod remap;
pub mod security;
pub mod watchdog;

mod calibrate_action;
mod calibrator;
mod clock;
mod engine;
mod entities;
mod interfaces;
mod listener;
mod loading;
mod managed;
mod middleware;
mod node;
mod order;
mod outbox;
mod parameters;
mod player;
mod services;
mod serving;
mod stopwatch;
mod threads;
mod watched;

pub use calibrator::{Calibrator, Purpose, Sample};
pub use clock::system_now;
pub use engine::Record;
pub use entities::{InputName, Names};
pub use interfaces::{DIAGNOSTICS_TYPE, Health, read_diagnostics};
pub use listener::{Delivery, Heard, HeardTopic, Listener, Listening, SpokenTopic};
pub use middleware::TopicType;
pub use node::{NodeError, Setup, input_bindings, run, wanted};
pub use watched::Watched;

pub use player::{NotPlayed, PlayedTopic, Player};
