//! The settings of a run.

use serde::{Deserialize, Serialize};

use super::super::architecture::{ContactAxes, Kind};
use super::super::error::TrainError;
use super::super::loss::LossConfig;

/// Learning rate over the run: a linear rise, then half a cosine.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Schedule {
    /// Total number of steps.
    pub steps: u64,
    /// Steps until the peak.
    pub warmup_steps: u64,
    /// The peak.
    pub learning_rate: f64,
    /// The final rate of the cosine.
    pub final_learning_rate: f64,
}

impl Default for Schedule {
    fn default() -> Self {
        Schedule { steps: 5_000, warmup_steps: 200, learning_rate: 1e-3, final_learning_rate: 1e-5 }
    }
}

impl Schedule {
    /// The rate of a step, counted from 0.
    pub fn learning_rate(&self, step: u64) -> f64 {
        if step < self.warmup_steps {
            return self.learning_rate * (step + 1) as f64 / self.warmup_steps as f64;
        }
        let left = self.steps.saturating_sub(self.warmup_steps).max(1) as f64;
        let done = ((step - self.warmup_steps) as f64 / left).min(1.0);
        let cosine = 0.5 * (1.0 + (std::f64::consts::PI * done).cos());
        self.final_learning_rate + (self.learning_rate - self.final_learning_rate) * cosine
    }
}

/// The settings of a run. Together with the data they determine its result, to the last bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainConfig {
    /// Kind of network.
    pub kind: Kind,
    /// Seed of the initial weights and the order of the windows.
    pub seed: u64,
    /// Windows per step.
    pub batch: usize,
    /// Number of parts of a batch that run separately, and the number of threads that can be used. It affects the
    /// result, as batch normalization uses one shard at a time.
    pub shards: usize,
    /// Learning rate over the run.
    pub schedule: Schedule,
    /// Decoupled weight decay of the weight matrices (AdamW); 0 is Adam.
    pub weight_decay: f64,
    /// Gradient clipping: maximum norm over all parameters.
    pub clip_norm: f64,
    /// Weights of the losses.
    pub loss: LossConfig,
    /// Sigma of the Gaussian over the auxiliary target, in frames.
    pub smoothing_frames: f32,
    /// See [`Architecture::force_scale`](super::super::Architecture::force_scale), gF.
    pub force_scale: f32,
    /// See [`Architecture::tactile_scale`](super::super::Architecture::tactile_scale); by default that of the data.
    pub tactile_scale: Option<f32>,
    /// Fraction of the training windows in the air that get a light touch; only for a network whose taxels have their
    /// artifact removed.
    pub light_touches: f32,
    /// A taxel's reading of a light touch, for the causal network.
    pub touch_scale: f32,
    /// The axes of a force that has three; `None` for the normal force alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axes: Option<ContactAxes>,
    /// Steps between validations.
    pub validate_every: u64,
    /// Steps between checkpoints.
    pub checkpoint_every: u64,
}

impl Default for TrainConfig {
    fn default() -> Self {
        TrainConfig {
            kind: Kind::PoseAware,
            seed: 0,
            batch: 64,
            shards: 2,
            schedule: Schedule::default(),
            weight_decay: 0.01,
            clip_norm: 20.0,
            loss: LossConfig::default(),
            smoothing_frames: 2.0,
            force_scale: 100.0,
            tactile_scale: None,
            light_touches: 0.0,
            touch_scale: 1.0,
            axes: None,
            validate_every: 250,
            checkpoint_every: 250,
        }
    }
}

/// Maximum number of windows per step.
const MAX_BATCH: usize = 4096;

impl TrainConfig {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// [`TrainError::Setting`].
    pub fn check(&self) -> Result<(), TrainError> {
        let refuse = |key, got: String, expected| Err(TrainError::Setting { key, got, expected });
        let counts = [
            ("batch", self.batch as u64),
            ("shards", self.shards as u64),
            ("steps", self.schedule.steps),
            ("validate_every", self.validate_every),
            ("checkpoint_every", self.checkpoint_every),
        ];
        if let Some((key, got)) = counts.into_iter().find(|(_, count)| *count == 0) {
            return refuse(key, got.to_string(), "at least 1");
        }
        if self.batch > MAX_BATCH {
            return refuse("batch", self.batch.to_string(), "at most 4096 windows, which take some gigabytes");
        }
        if self.shards > self.batch {
            return refuse("shards", self.shards.to_string(), "at most the batch");
        }
        let rates = [
            ("learning_rate", self.schedule.learning_rate),
            ("final_learning_rate", self.schedule.final_learning_rate),
            ("weight_decay", self.weight_decay),
            ("smoothing_frames", f64::from(self.smoothing_frames)),
        ];
        if let Some((key, got)) = rates.into_iter().find(|(_, rate)| !rate.is_finite() || *rate < 0.0) {
            return refuse(key, got.to_string(), "0 or a positive number");
        }
        if self.smoothing_frames > 1000.0 {
            return refuse("smoothing_frames", self.smoothing_frames.to_string(), "at most 1000 frames");
        }
        if !(0.0..=1.0).contains(&self.light_touches) {
            return refuse("light_touches", self.light_touches.to_string(), "0 to 1");
        }
        if self.clip_norm.is_nan() || self.clip_norm <= 0.0 {
            return refuse("clip_norm", self.clip_norm.to_string(), "a positive number");
        }
        self.loss.check()
    }
}
