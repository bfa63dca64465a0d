//! Training: from annotated recordings to a model that the node runs.
//!
//! The network and its losses are the paper's Sec. V. A [`Dataset`] holds sessions of model input (built by the same
//! [`features`](crate::fusion) as in the live node), a [`Trainer`] fits a [`Network`] to it, [`onnx_model`] writes it.
//! The same data, configuration and seed give the same bytes, on any number of threads.

mod architecture;
mod artifact;
mod dataset;
mod error;
mod exact_floats;
mod export;
mod held_touch;
mod light_touch;
mod loss;
mod network;
mod random;
#[cfg(test)]
mod reference_tests;
mod touch;
mod trainer;

pub use architecture::{Architecture, ContactAxes, Kind, N_FEATURES, Parameter};
pub use artifact::fit_artifact;
pub use dataset::{Batch, Dataset, Session, SessionFrames, TOUCH_GF, WindowSpec, pose_range, smoothed_change};
pub use error::{DatasetError, TrainError};
pub use export::{GraphForm, ModelCard, onnx_model};
pub use held_touch::TouchedSession;
pub use loss::{LossConfig, LossTerms};
pub use network::{BatchNormStatistics, Network};
pub use touch::{TouchCalibration, TriedLevel, calibrate_touch};
pub use trainer::{Checkpoint, Outcome, Progress, Schedule, TrainConfig, Trainer, Validation, validate};
