//! Ctrl-C and SIGTERM: work stops at the next message, so that what is half written is taken away.

use super::Failure;
use crate::leave;

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
#[cfg(feature = "ros")]
pub(super) fn happened() -> bool {
    leave::asked()
}

/// Fails when there was an interrupt.
pub(super) fn check() -> Result<(), Failure> {
    match leave::asked() {
        true => Err(Failure("interrupted; nothing was written".to_owned())),
        false => Ok(()),
    }
}

/// Whether there was an interrupt, for work that asks by itself.
#[cfg(feature = "train")]
pub(super) fn flag() -> &'static std::sync::atomic::AtomicBool {
    leave::flag()
}
