//! Ctrl-C and SIGTERM: work stops at the next message, so that what is half written is taken away.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{Failure, say};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// From now on an interrupt is noted instead of ending the process at once.
pub(super) fn listen() {
    static LISTENING: Once = Once::new();
    LISTENING.call_once(register);
}

fn register() {
    if let Err(error) = ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed)) {
        say(&format!("interrupts end this run at once, and may leave a hidden temporary file: {error}"));
    }
}

/// Whether there was an interrupt.
#[cfg(feature = "ros")]
pub(super) fn happened() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// Fails when there was an interrupt.
pub(super) fn check() -> Result<(), Failure> {
    match INTERRUPTED.load(Ordering::Relaxed) {
        true => Err(Failure("interrupted; nothing was written".to_owned())),
        false => Ok(()),
    }
}

/// Whether there was an interrupt, for work that asks by itself.
#[cfg(feature = "train")]
pub(super) fn flag() -> &'static AtomicBool {
    &INTERRUPTED
}
