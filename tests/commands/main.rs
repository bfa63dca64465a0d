//! Commands of `tpf` as processes.

#[path = "../tpf_common/mod.rs"]
mod common;

#[cfg(feature = "train")]
mod adaptive;
mod characterize;
mod db3_bags;
mod db3_replay;
mod demo;
mod devices;
mod diff;
mod eval_command;
mod eval_merge;
mod eval_report;
mod eval_tables;
mod export;
mod first_tries;
mod help;
mod hostile_models;
mod init;
mod inspect;
mod output_faults;
mod python_readers;
mod replay;
mod replay_failures;
mod replay_jobs;
mod replay_memory;
mod shards;
mod simulate;
mod three_axes;
#[cfg(feature = "train")]
mod train_command;
#[cfg(feature = "train")]
mod unannotated;
mod uris;
mod view;
