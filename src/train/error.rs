//! What can stand against training.

use std::path::PathBuf;

/// Why recordings can't be trained on. Every message names the session and what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DatasetError {
    /// Two columns of a session differ in length.
    #[error("session {session}: {column} holds {got} values, expected {expected} for {frames} frames")]
    Length {
        /// Name of the session.
        session: String,
        /// Which column.
        column: &'static str,
        /// Frames of the session, by its tactile column.
        frames: usize,
        /// Values that the column should hold.
        expected: usize,
        /// Values that it holds.
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
    /// A number that is none.
    #[error(
        "session {session}: {column} at frame {frame} is {value}, expected a finite number; leave such frames out and start a new stretch behind them"
    )]
    NonFinite {
        /// Name of the session.
        session: String,
        /// Which column.
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
    /// No pose where the network needs it.
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
        /// Frames in a window.
        window: usize,
        /// Which part of the split.
        part: &'static str,
    },
    /// Only touch, or only air.
    #[error(
        "every training window is {class} at {threshold_gf} gF, expected both; record presses and free movement, and look at the tare"
    )]
    OneClass {
        /// What all of them are.
        class: &'static str,
        /// The threshold of touch, gF.
        threshold_gf: f32,
    },
    /// A window or a stride of no frames, a split that leaves nothing.
    #[error("{key} is {got}, expected {expected}")]
    Setting {
        /// Which setting.
        key: &'static str,
        /// Its value.
        got: String,
        /// What it may be.
        expected: &'static str,
    },
}

/// Why a model could not be trained or written.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A network that can't be built, or that is given what it doesn't take.
    #[error("network: {what}")]
    Architecture {
        /// What is wrong.
        what: String,
    },
    /// A setting outside of its range.
    #[error("training setting {key} is {got}, expected {expected}")]
    Setting {
        /// Which setting.
        key: &'static str,
        /// Its value.
        got: String,
        /// What it may be.
        expected: &'static str,
    },
    /// The data.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error("no artifact model can be fitted: {what}")]
    #[allow(missing_docs)] // the text says it
    Artifact { what: String },
    /// The loss or a gradient is no number any more.
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
        /// Why not.
        reason: String,
    },
    /// A checkpoint that belongs to other data.
    #[error("the checkpoint was made on other {what}; give the same recordings and settings, or start anew")]
    OtherRun {
        /// What differs.
        what: &'static str,
    },
    /// A file that can't be read or written.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: std::io::Error,
    },
    /// A model that can't be described.
    #[error("model: {what}")]
    Card {
        /// What is wrong.
        what: String,
    },
}
