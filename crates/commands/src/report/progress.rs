//! How far a long piece of work is: a bar on a terminal, a plain line now and then elsewhere.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use tactile_pose_fusion::leave;
use tactile_pose_fusion::observer::Observer;

use super::said::{say, tell};
use super::terminal::{Voice, voice};

const PLAIN_EVERY: Duration = Duration::from_secs(10);

/// Progress through a known number of bytes or steps.
#[derive(Debug)]
pub(crate) struct Progress {
    bar: ProgressBar,
    what: &'static str,
    total: u64,
    last_plain: Instant,
}

impl Progress {
    /// Progress of `what`, such as "replay", through `total` bytes.
    pub(crate) fn bytes(what: &'static str, total: u64) -> Self {
        Self::with_template(what, total, "{prefix} {wide_bar} {bytes}/{total_bytes}, {eta} left")
    }

    /// Progress of `what` through `total` steps.
    pub(crate) fn steps(what: &'static str, total: u64) -> Self {
        Self::with_template(what, total, "{prefix} {wide_bar} {pos}/{len}, {eta} left")
    }

    /// Progress of `what` that takes a time known before.
    #[cfg(feature = "ros")]
    pub(crate) fn time(what: &'static str, total: Duration) -> Self {
        Self::with_template(what, total.as_millis() as u64, "{prefix} {wide_bar} {msg}")
    }

    /// Tells how much of the time is over.
    #[cfg(feature = "ros")]
    pub(crate) fn set_time(&mut self, done: Duration) {
        let left = Duration::from_millis(self.total).saturating_sub(done);
        self.bar.set_message(format!("{:.0} s left", left.as_secs_f64().ceil()));
        self.set(done.as_millis() as u64);
    }

    fn with_template(what: &'static str, total: u64, template: &str) -> Self {
        let bar = if voice() == Voice::Quiet { ProgressBar::hidden() } else { ProgressBar::new(total) };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_prefix(what);
        Progress { bar, what, total, last_plain: Instant::now() }
    }

    /// Tells how many are done.
    pub(crate) fn set(&mut self, done: u64) {
        self.bar.set_position(done.min(self.total));
        if self.bar.is_hidden() && self.last_plain.elapsed() >= PLAIN_EVERY {
            self.last_plain = Instant::now();
            tell(&format!("{}: {:.0} %", self.what, 100.0 * done as f64 / self.total.max(1) as f64));
        }
    }
}

impl Progress {
    /// Lets something be said above the bar.
    #[cfg(feature = "train")]
    pub(crate) fn above(&self, say: impl FnOnce()) {
        self.bar.suspend(say);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Says the notes of a piece of work, and cancels it at an interrupt.
pub(crate) struct Said;

impl Observer for Said {
    fn note(&self, text: &str) {
        tell(text);
    }

    fn warn(&self, text: &str) {
        say(text);
    }

    fn detail(&self, text: &str) {
        if voice() == Voice::Verbose {
            say(text);
        }
    }

    fn is_cancelled(&self) -> bool {
        leave::asked()
    }
}

/// The same, and shows how far the work is.
pub(crate) struct Shown {
    what: &'static str,
    new_bar: fn(&'static str, u64) -> Progress,
    bar: Mutex<Option<Progress>>,
}

impl Shown {
    /// Work that counts bytes.
    pub(crate) fn bytes(what: &'static str) -> Self {
        Shown { what, new_bar: Progress::bytes, bar: Mutex::new(None) }
    }

    /// Work that counts steps.
    pub(crate) fn steps(what: &'static str) -> Self {
        Shown { what, new_bar: Progress::steps, bar: Mutex::new(None) }
    }
}

impl Observer for Shown {
    fn note(&self, text: &str) {
        Said.note(text);
    }

    fn warn(&self, text: &str) {
        Said.warn(text);
    }

    fn detail(&self, text: &str) {
        Said.detail(text);
    }

    fn progress(&self, done: u64, total: u64) {
        let mut bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        // Another total is another piece of the work, such as the next bag.
        if bar.as_ref().is_some_and(|bar| bar.total != total) {
            *bar = None;
        }
        bar.get_or_insert_with(|| (self.new_bar)(self.what, total)).set(done);
    }

    fn is_cancelled(&self) -> bool {
        Said.is_cancelled()
    }
}
