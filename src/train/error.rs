//! Errors of training.

use std::path::PathBuf;

/// The reason why recordings can't be used for training. Every message names the session and what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DatasetError {
    /// Two columns of a session differ in length.
    #[error("session {session}: {column} holds {got} values, expected {expected} for {frames} frames")]
    Length {
        /// Name of the session.
        session: String,
        /// The column.
        column: &'static str,
        /// Frames of the session, by its tactile column.
        frames: usize,
        /// Expected number of values.
        expected: usize,
        /// Actual number of values.
        got: usize,
    },
    /// A session without force truth.
    #[error(
        "session {session}: no force truth, expected one value in gF for each frame; record the force sensor's topic too"
    )]
    NoTruth {
        /// Name of the session.
        session: String,
    },
    /// A session in which no frame is marked as free of load.
    #[error(
        "session {session}: no frame is annotated as zero-load; the truth is tared on such stretches and the auxiliary loss needs them"
    )]
    NoZeroLoad {
        /// Name of the session.
        session: String,
    },
    /// A value that is not finite.
    #[error(
        "session {session}: {column} at frame {frame} is {value}, expected a finite number; leave such frames out and start a new stretch behind them"
    )]
    NonFinite {
        /// Name of the session.
        session: String,
        /// The column.
        column: &'static str,
        /// Frame within the session.
        frame: usize,
        /// The value.
        value: f32,
    },
    /// Sessions whose frames differ in width.
    #[error("session {session}: {got} {what}, expected {expected} as in session {first}")]
    Width {
        /// Name of the session.
        session: String,
        /// Name of the first session.
        first: String,
        /// `taxels` or `joints`.
        what: &'static str,
        /// Width in the first session.
        expected: usize,
        /// Width in this one.
        got: usize,
    },
    /// No pose, though the network needs it.
    #[error("session {session}: no joint angles, expected at least one joint; train kind tactile-only without them")]
    NoJoints {
        /// Name of the session.
        session: String,
    },
    /// A session without a taxel.
    #[error("session {session}: no taxels, expected at least one")]
    NoTaxels {
        /// Name of the session.
        session: String,
    },
    /// No session at all.
    #[error("no sessions, expected at least one recording")]
    NoSessions,
    /// No window fits.
    #[error(
        "no window of {window} frames fits into the {part} part of the sessions; record longer stretches without gaps, or train a shorter window"
    )]
    NoWindows {
        /// Frames per window.
        window: usize,
        /// The part of the split.
        part: &'static str,
    },
    /// Only touch, or only air.
    #[error(
        "every training window is {class} at {threshold_gf} gF, expected both; record presses and free movement, and look at the tare"
    )]
    OneClass {
        /// The only class: touch or air.
        class: &'static str,
        /// The threshold of touch, gF.
        threshold_gf: f32,
    },
    /// No press in the training windows.
    #[error(
        "the true force rises to {largest_gf:.1} gF at most in what is trained on, expected presses of {least_gf} gF or more; look at the axis (field), sign and unit of the force sensor"
    )]
    NoPress {
        /// The largest true force, gF.
        largest_gf: f32,
        /// The least that the largest must be, gF.
        least_gf: f32,
    },
    /// A window or a stride of no frames, or a split that leaves nothing.
    #[error("{key} is {got}, expected {expected}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// Its value.
        got: String,
        /// Its allowed values.
        expected: &'static str,
    },
}

/// The reason why a model can't be trained or written.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A network that can't be built, or input that it doesn't accept.
    #[error("network: {what}")]
    Architecture {
        /// The problem.
        what: String,
    },
    /// A setting outside of its range.
    #[error("training setting {key} is {got}, expected {expected}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// Its value.
        got: String,
        /// Its allowed values.
        expected: &'static str,
    },
    /// A problem with the data.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error("no artifact model can be fitted: {what}")]
    #[allow(missing_docs)] // the text says it
    Artifact { what: String },
    /// The loss or a gradient is no longer finite.
    #[error("the loss became {loss} at step {step}; lower the learning rate, and look for outliers in the recordings")]
    Diverged {
        /// The step, from 1.
        step: u64,
        /// The loss.
        loss: f32,
    },
    /// A checkpoint that can't be read.
    #[error("{}: expected a checkpoint of this program, got {reason}; start anew without it", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// A checkpoint that belongs to other data.
    #[error("the checkpoint was made on other {what}; give the same recordings and settings, or start anew")]
    OtherRun {
        /// The difference.
        what: &'static str,
    },
    /// A file that can't be read or written.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        reason: std::io::Error,
    },
    /// A model card that does not fit the model.
    #[error("model: {what}")]
    Card {
        /// The problem.
        what: String,
    },
}
