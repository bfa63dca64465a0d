//! The library in this process: fusion, parameters, metrics, hands and the simulator.

#[path = "../common/mod.rs"]
mod common;
#[path = "../msg_common/mod.rs"]
mod msg_common;

mod adaptive_touch;
mod config_example;
mod config_param_file;
mod config_refusals;
mod eval_compare;
mod eval_diff;
mod eval_metrics;
mod eval_reference;
mod eval_time;
mod fusion;
mod fusion_config;
mod fusion_windows;
mod hand;
mod sim_glove;
mod sim_session;
mod worn;
