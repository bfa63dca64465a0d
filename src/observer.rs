//! Observer of long work: it receives progress and notes for the user, and can cancel the work.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

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

/// Flag that cancels the work of a thread, for what waits without an observer: for the answer of a store.
pub type CancelFlag = Option<Arc<AtomicBool>>;

thread_local! {
    static CANCEL: RefCell<CancelFlag> = const { RefCell::new(None) };
}

/// Does work that `flag` cancels, too, also where it waits. A thread that the work starts is given [`cancel_flag`] in the
/// same way.
pub fn cancelled_by<T>(flag: CancelFlag, work: impl FnOnce() -> T) -> T {
    struct Restored(CancelFlag);
    impl Drop for Restored {
        fn drop(&mut self) {
            CANCEL.replace(self.0.take());
        }
    }
    let _restored = Restored(CANCEL.replace(flag));
    work()
}

/// The flag of this thread's work.
pub fn cancel_flag() -> CancelFlag {
    CANCEL.with_borrow(Clone::clone)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_is_that_of_its_work_alone() {
        let flag = Some(Arc::new(AtomicBool::new(false)));
        cancelled_by(flag.clone(), || {
            assert!(cancel_flag().is_some_and(|own| flag.as_ref().is_some_and(|flag| Arc::ptr_eq(&own, flag))));
            cancelled_by(None, || assert!(cancel_flag().is_none()));
            assert!(cancel_flag().is_some());
            std::thread::scope(|scope| scope.spawn(|| assert!(cancel_flag().is_none())).join().unwrap());
        });
        assert!(cancel_flag().is_none());
    }
}
