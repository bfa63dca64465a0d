//! What is wrong with a session that is asked for.

use super::super::glove::GLOVES;
use super::Activity;

/// Why there is no such session. Each text is one line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimError {
    /// There is no such glove.
    #[error("glove {got}: there is no such synthetic glove; choose one of 1 to {n}", n = GLOVES.len())]
    Glove {
        /// What was asked for.
        got: u8,
    },
    /// The activity doesn't fit.
    #[error(
        "minutes {got}: a session of {activity} takes {from} to {until} minutes",
        activity = match activity { Activity::Protocol => "the protocol", Activity::Manipulation => "free manipulation" },
        from = activity.minutes().start(),
        until = activity.minutes().end()
    )]
    Minutes {
        /// What was asked for.
        got: f64,
        /// In a session of what.
        activity: Activity,
    },
    /// Something is asked for by a number that it can't be.
    #[error("{what}: expected {from} to {to} {unit}, got {got}")]
    #[allow(missing_docs)] // the text says it
    Quantity { what: &'static str, got: f64, unit: &'static str, from: f64, to: f64 },
    /// The protocol leaves no choice of this.
    #[error("{what}: the protocol says what is done; choose free manipulation for it (--activity manipulation)")]
    #[allow(missing_docs)]
    OnlyManipulation { what: &'static str },
    /// The finger that is to touch feels nothing.
    #[error(
        "{finger} finger: this glove has taxels on the index fingertip alone; choose one of the hand (--glove hand1)"
    )]
    #[allow(missing_docs)]
    NoTaxels { finger: &'static str },
    /// A session can't begin with a touch when none is held.
    #[error("a start in contact needs an episode that is held from its beginning: light_hold, still_hold or grasp")]
    NothingHeld,
}
