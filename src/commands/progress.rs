//! How far a long piece of work is: a bar on a terminal, a plain line now and then elsewhere.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

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

    fn with_template(what: &'static str, total: u64, template: &str) -> Self {
        let bar = ProgressBar::new(total);
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
            super::say(&format!("{}: {:.0} %", self.what, 100.0 * done as f64 / self.total.max(1) as f64));
        }
    }
}

impl Progress {
    /// Says something above the bar.
    #[cfg(feature = "train")]
    pub(crate) fn line(&self, text: &str) {
        self.bar.suspend(|| super::say(text));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
