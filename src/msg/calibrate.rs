//! The three parts of our `Calibrate` action. They mirror `action/Calibrate.action`.

use serde::{Deserialize, Serialize};

use super::{Duration, WireType};

/// What a client of `Calibrate` asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CalibrateGoal {
    /// How long to collect; 0 takes the duration from the parameters.
    pub duration: Duration,
}

/// How a calibration ended.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CalibrateResult {
    /// Whether the new baseline is in use.
    pub success: bool,
    /// What was done, or why not and what to do.
    pub message: String,
    /// Where it was saved; empty when it was not.
    pub file: String,
    /// Tactile frames that the baseline was taken from.
    pub frames: u32,
    /// `[joints]`, those that were seen.
    pub joints: Vec<String>,
    /// `[joints]`, rad, largest minus smallest angle.
    pub joint_span: Vec<f64>,
    /// `[sources]`.
    pub sources: Vec<String>,
    /// `[sources]`, the taxels of each.
    pub source_taxels: Vec<u32>,
    /// `[taxels of all sources]`, standard deviation in the sensor's own unit.
    pub noise: Vec<f32>,
    /// Indices into `noise` of taxels that never changed or were not finite.
    pub faulty_taxels: Vec<u32>,
}

/// How far a calibration has come.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CalibrateFeedback {
    /// Until the goal's duration has passed.
    pub time_left: Duration,
    /// `[joints]`, those that were seen so far.
    pub joints: Vec<String>,
    /// `[joints]`, rad, largest minus smallest angle.
    pub joint_span: Vec<f64>,
    /// `[sources]`.
    pub sources: Vec<String>,
    /// `[sources]`, the taxels of each.
    pub source_taxels: Vec<u32>,
    /// `[taxels of all sources]`, standard deviation in the sensor's own unit.
    pub noise: Vec<f32>,
}

impl WireType for CalibrateGoal {
    const TYPE_NAME: &'static str = "tactile_pose_fusion/action/Calibrate_Goal";
}

impl WireType for CalibrateResult {
    const TYPE_NAME: &'static str = "tactile_pose_fusion/action/Calibrate_Result";
}

impl WireType for CalibrateFeedback {
    const TYPE_NAME: &'static str = "tactile_pose_fusion/action/Calibrate_Feedback";
}
