//! Ctrl-C and SIGTERM: work stops at the next message, so that what is half written is taken away.

use tactile_pose_fusion::leave;

#[cfg(any(feature = "ros", feature = "train"))]
use super::Failure;

/// From now on an interrupt is noted instead of ending the process at once; a second one ends it.
pub(super) fn listen() {
    leave::listen();
}

/// As [`listen`], for what talks to a graph: it ends within two seconds, whatever the graph does.
///
/// # Errors
/// [`Failure`] when there is no thread to be had.
#[cfg(feature = "ros")]
pub(super) fn listen_live() -> Result<(), Failure> {
    leave::listen();
    leave::in_time().map_err(|error| Failure(format!("thread: {error}")))
}

/// Whether there was an interrupt.
pub(super) fn happened() -> bool {
    leave::asked()
}
