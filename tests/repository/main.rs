//! The repository itself: its rules, documentation and examples.

#[path = "../tpf_common/mod.rs"]
mod common;

mod architecture;
mod builds;
mod docs;
mod examples;
