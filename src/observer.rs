//! Observer of long work: it receives progress and notes for the user, and can cancel the work.

/// Observes long work. It may be called from any thread.
pub trait Observer: Sync {
    /// Receives a note for the user, on one line.
    fn note(&self, text: &str) {
        let _ = text;
    }

    /// A note that is never left out: input that was lost, or a result that is in doubt; one line.
    fn warn(&self, text: &str) {
        self.note(text);
    }

    /// How the work is done, for those who ask; one line.
    fn detail(&self, text: &str) {
        let _ = text;
    }

    /// How many of `total` bytes or steps are done.
    fn progress(&self, done: u64, total: u64) {
        let _ = (done, total);
    }

    /// True if the work should end as soon as it can. It is called at every message.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Ignores everything and never cancels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {}

/// Error: the work was cancelled. Incomplete outputs are removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted; nothing was written")]
pub struct Cancelled;

/// Returns an error if the work should end.
///
/// # Errors
/// [`Cancelled`] if the observer cancels.
pub fn check(observer: &dyn Observer) -> Result<(), Cancelled> {
    if observer.is_cancelled() { Err(Cancelled) } else { Ok(()) }
}
