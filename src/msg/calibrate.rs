//! The three parts of our `Calibrate` action. They match `action/Calibrate.action`.

use serde::{Deserialize, Serialize};

use super::{Duration, WireType};

/// Goal of `Calibrate`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CalibrateGoal {
    /// Duration of the calibration; 0 takes the duration from the parameters.
    pub duration: Duration,
}

/// Result of a calibration.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CalibrateResult {
    /// True if the new baseline is in use.
    pub success: bool,
    /// Summary of the calibration, or the reason for a failure with its remedy.
    pub message: String,
    /// File of the calibration; empty if it was not saved.
    pub file: String,
    /// Number of tactile frames from which the baseline was computed.
    pub frames: u32,
    /// `[joints]`, names of the joints that had angles.
    pub joints: Vec<String>,
    /// `[joints]`, rad, largest minus smallest angle.
    pub joint_span: Vec<f64>,
    /// `[sources]`.
    pub sources: Vec<String>,
    /// `[sources]`, number of taxels of each source.
    pub source_taxels: Vec<u32>,
    /// `[taxels of all sources]`, standard deviation in the sensor's own unit.
    pub noise: Vec<f32>,
    /// Indices into `noise` of taxels that never changed or were not finite.
    pub faulty_taxels: Vec<u32>,
}

/// Progress of a calibration.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct CalibrateFeedback {
    /// What the wearer should do now.
    pub instruction: String,
    /// Time until the instruction ends.
    pub time_left: Duration,
    /// `[joints]`, names of the joints that had angles so far.
    pub joints: Vec<String>,
    /// `[joints]`, rad, largest minus smallest angle.
    pub joint_span: Vec<f64>,
    /// `[sources]`.
    pub sources: Vec<String>,
    /// `[sources]`, number of taxels of each source.
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
