//! Errors in the specification of a session.

use super::super::glove::GLOVES;
use super::super::spec::Activity;

/// The reason why a session can't be created. Each text is one line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimError {
    /// There is no such glove.
    #[error("glove {got}: there is no such synthetic glove; choose one of 1 to {n}", n = GLOVES.len())]
    Glove {
        /// The requested glove.
        got: u8,
    },
    /// The activity doesn't fit into the duration.
    #[error(
        "minutes {got}: a session of {activity} takes {from} to {until} minutes",
        activity = match activity { Activity::Protocol => "the protocol", Activity::Manipulation => "free manipulation" },
        from = range.start(),
        until = range.end()
    )]
    Minutes {
        /// The requested duration.
        got: f64,
        /// The activity.
        activity: Activity,
        /// Possible durations.
        range: std::ops::RangeInclusive<f64>,
    },
    /// A value is out of range.
    #[error("{what}: expected {from} to {to} {unit}, got {got}")]
    #[allow(missing_docs)] // the text says it
    Quantity { what: &'static str, got: f64, unit: &'static str, from: f64, to: f64 },
    /// The protocol leaves no choice of this.
    #[error("{what}: the protocol says what is done; choose free manipulation for it (--activity manipulation)")]
    #[allow(missing_docs)]
    OnlyManipulation { what: &'static str },
    /// The finger that should touch has no taxels.
    #[error(
        "{finger} finger: this glove has taxels on the index fingertip alone; choose one of the hand (--glove hand1)"
    )]
    #[allow(missing_docs)]
    NoTaxels { finger: &'static str },
    /// A session can't begin with a touch when none is held.
    #[error("a start in contact needs an episode that is held from its beginning: light_hold, still_hold or grasp")]
    NothingHeld,
}
