//! The connection of a process to a ROS 2 graph, on DDS or Zenoh: arguments, environment, names, QoS, security, and the
//! participant with its publishers, subscriptions and services.

pub mod args;
pub mod environment;
pub mod graph;
pub mod qos;
pub mod remap;
pub mod security;

pub(super) mod clock;
pub(super) mod entities;
pub(super) mod error;
pub(super) mod middleware;
pub(super) mod threads;

mod stopwatch;
