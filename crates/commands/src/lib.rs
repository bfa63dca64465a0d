//! The programs `tpf` and `tactile_pose_fusion_node`: command line, tables, pages, plots and screens.
//!
//! This crate uses the library `tactile_pose_fusion` as any other program does. A program that contains `tpf` calls
//! [`main_with`]. [`report`] has the texts, tables and pages that the programs show.

mod commands;
pub mod page;
pub mod report;
pub mod view;

pub use commands::{Cli, Failure, Outcome, main, main_with, node_main, run};
