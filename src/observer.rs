//! Who watches a long piece of work: it is told how far the work is and what a person should know, and can cancel it.

/// Watches a long piece of work. It may be asked and told from any thread.
pub trait Observer: Sync {
    /// Something that a person should know; one line.
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

    /// Whether the work is to end as soon as it can. Asked at every message.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Watches nothing and never cancels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {}

/// The work ended because it was cancelled; outputs that were not complete are gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted; nothing was written")]
pub struct Cancelled;

/// `Err` where the work is to end.
///
/// # Errors
/// [`Cancelled`] when the observer says so.
pub fn check(observer: &dyn Observer) -> Result<(), Cancelled> {
    if observer.is_cancelled() { Err(Cancelled) } else { Ok(()) }
}
