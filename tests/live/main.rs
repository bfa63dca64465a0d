//! The live node and its tools. They start participants, so they run inside of `tests/ros/isolated` only.

#[path = "../tpf_common/mod.rs"]
mod common;
#[cfg(feature = "ros")]
#[path = "../node_common/mod.rs"]
mod node_common;

#[cfg(feature = "ros")]
mod node;
#[cfg(feature = "ros")]
mod node_call;
#[cfg(feature = "ros")]
mod node_collect;
#[cfg(feature = "ros")]
mod node_devices;
#[cfg(feature = "ros")]
mod node_doctor;
#[cfg(feature = "ros")]
mod node_faults;
#[cfg(feature = "ros")]
mod node_hands;
#[cfg(feature = "ros")]
mod node_init;
#[cfg(feature = "ros")]
mod node_interfaces;
#[cfg(feature = "ros")]
mod node_play;
#[cfg(feature = "security")]
mod node_security;
#[cfg(feature = "ros")]
mod node_stop;
#[cfg(feature = "ros")]
mod node_view;
#[cfg(feature = "ros")]
mod node_visuals;
#[cfg(feature = "zenoh")]
mod node_zenoh;
