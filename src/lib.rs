//! Pose-aware tactile force for ROS 2: taxels and joint angles in, wrench and contact out.
//!
//! Soft tactile gloves read force when the wearer only bends a finger. This crate removes that error in software: a
//! tactile-only force estimate minus a residual that a network predicts from pose and touch together.
//!
//! [`fusion`] is the pure core; everything else brings it events, models and parameters, or takes its estimates away.

pub mod bag;
pub mod calibration;
pub mod characterize;
pub mod collect;
pub mod columns;
pub mod commands;
pub mod config;
pub mod eval;
pub mod export;
pub mod files;
pub mod fusion;
pub mod glove;
mod kernels;
pub mod leave;
pub mod model;
pub mod msg;
pub mod observer;
pub mod page;
pub mod protocol;
mod random;
pub mod recording;
pub mod replay;
#[cfg(feature = "ros")]
pub mod ros;
pub mod sim;
pub mod synthetic;
#[cfg(feature = "train")]
pub mod train;
pub mod units;
pub mod zero;
