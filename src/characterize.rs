//! Analyses the effect of hand motion on a glove's taxels: the paper's characterization for any glove. Pure: no I/O.
//!
//! [`characterize`] takes every frame of one region from every session. It finds which joints affect which taxels, how
//! pose changes the response to force, how large the artifacts are compared with a tap, how much of them lags, and how
//! the sensor behaves at rest. Readings are the model's input: baseline subtracted, in the sensor's own unit. `sum` is
//! the sum over all taxels of the region.
//!
//! All frames of all sessions are in memory, because the relevant joints are known only after all frames were read. A
//! frame takes 4 bytes for each taxel and joint: 20 MB for 28 minutes of 6 taxels and 20 joints at 100 Hz.
//!
//! # Source
//! Pose-aware tactile gloves, Sec. III, Observations 1 to 3.

mod artifact;
mod correlation;
mod curve;
mod drift;
mod following;
mod frames;
mod gram;
mod hysteresis;
mod noise;
mod offset;
mod pose_model;
mod report;
mod response;
mod selection;
mod spread;
mod timing;

pub use artifact::{ArtifactReport, ArtifactSize, PoseArtifact};
pub use correlation::Correlation;
pub use drift::{DriftReport, SessionDrift};
pub use following::{FollowingReport, LeftInAir};
pub use frames::SessionFrames;
pub use hysteresis::{HysteresisReport, SessionHysteresis};
pub use noise::{NoiseReport, TaxelNoise};
pub use offset::{LagPoint, OWN_LAG_MS, OffsetReport, SessionOffset, Untold};
pub use pose_model::BendScore;
pub use report::{JointRange, RegionReport, RegionSession, characterize};
pub use response::{ClassCurve, CurvePoint, ResponseReport, SessionGain};
pub use selection::{Selection, Step};
pub use spread::Spread;
pub use timing::StreamTiming;
