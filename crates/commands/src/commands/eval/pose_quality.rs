//! How good the pose must be: the judged model again, with joint angles made worse.

use tactile_pose_fusion::recording::PoseQuality;

use super::super::Failure;

/// What is made worse, one amount a run; each is tried alone.
#[derive(Debug, clap::Args)]
pub(super) struct PoseQualityArgs {
    /// Score --model again with white noise of these standard deviations on every joint angle
    #[arg(long, value_name = "DEG,..", value_delimiter = ',')]
    pose_noise_deg: Vec<f64>,
    /// The same with an error of this standard deviation that each joint keeps for a session
    #[arg(long, value_name = "DEG,..", value_delimiter = ',')]
    pose_bias_deg: Vec<f64>,
    /// The same with angles that are older than their stamps say
    #[arg(long, value_name = "MS,..", value_delimiter = ',')]
    pose_delay_ms: Vec<f64>,
    /// The same with this share of the joint messages lost
    #[arg(long, value_name = "SHARE,..", value_delimiter = ',')]
    pose_dropout: Vec<f64>,
    /// The same with joint messages at this rate, at times as uneven as a camera's
    #[arg(long, value_name = "HZ,..", value_delimiter = ',')]
    pose_rate_hz: Vec<f64>,
}

impl PoseQualityArgs {
    /// Every amount that is asked for.
    pub(super) fn levels(&self) -> Result<Vec<PoseQuality>, Failure> {
        let perfect = PoseQuality::default;
        let mut levels = Vec::new();
        levels.extend(self.pose_noise_deg.iter().map(|amount| PoseQuality { noise_deg: *amount, ..perfect() }));
        levels.extend(self.pose_bias_deg.iter().map(|amount| PoseQuality { bias_deg: *amount, ..perfect() }));
        levels.extend(self.pose_delay_ms.iter().map(|amount| PoseQuality { delay_ms: *amount, ..perfect() }));
        levels.extend(self.pose_dropout.iter().map(|amount| PoseQuality { dropout: *amount, ..perfect() }));
        levels.extend(self.pose_rate_hz.iter().map(|amount| PoseQuality { rate_hz: Some(*amount), ..perfect() }));
        levels.iter().try_for_each(PoseQuality::check)?;
        Ok(levels)
    }
}
