//! The fusion core: taxels and joint angles in, forces and contacts out. Pure: no clock, no I/O, no environment.

mod config;
mod event;
mod geometry;
mod regressor;

pub use config::{ContactThresholds, FrameClock, FusionConfig, JointSource, RegionConfig, TactileSource, Timing};
pub use event::{Event, JointSample, JointSourceIdx, TactileBlock, TactileSourceIdx};
pub use geometry::{Patch, Wrench};
pub use regressor::{Contract, ForceUnit, Forces, PoseRange, RegressError, Regressor, Windows};
