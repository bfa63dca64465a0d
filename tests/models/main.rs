//! Models: their contract, runtimes, the built-in code, and training.

#[path = "../common/mod.rs"]
mod common;
#[cfg(feature = "train")]
#[path = "../train_common/mod.rs"]
mod train_common;

mod model_contract;
mod model_hostile_bytes;
mod model_lanes;
mod model_recognition;
mod model_runtimes;
mod model_stretches;
#[cfg(feature = "train")]
mod train_dataset;
#[cfg(feature = "train")]
mod train_export;
#[cfg(feature = "train")]
mod train_run;
