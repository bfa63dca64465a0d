//! Notices that a tactile stream has stopped. Pure: time is an argument.

use std::time::Duration;

/// Watches the tactile sources: a controller must never go on with the last force of one that has stopped.
#[derive(Debug, Clone)]
pub struct Watchdog {
    timeout: Duration,
    sources: Vec<Source>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Source {
    /// When it was last heard, or said to be stale.
    last: Option<Duration>,
    stale: bool,
}

impl Watchdog {
    /// A watchdog over `n_sources` that barks after `timeout` of silence, and again each time as much passes.
    pub fn new(n_sources: usize, timeout: Duration) -> Self {
        Watchdog { timeout, sources: vec![Source::default(); n_sources] }
    }

    /// Takes note that a source was heard, at a time since any fixed moment; whether it was stale until now.
    pub fn handle_sample(&mut self, source_idx: usize, now: Duration) -> bool {
        let source = &mut self.sources[source_idx];
        source.last = Some(now);
        std::mem::take(&mut source.stale)
    }

    /// The next source to be said stale, and whether it is the first time since it stopped.
    ///
    /// A source that was never heard is not stale: nobody holds a force of it.
    pub fn poll(&mut self, now: Duration) -> Option<(usize, bool)> {
        let timeout = self.timeout;
        let silent = |source: &Source| source.last.is_some_and(|last| now.saturating_sub(last) >= timeout);
        let idx = self.sources.iter().position(silent)?;
        let source = &mut self.sources[idx];
        source.last = Some(now);
        Some((idx, !std::mem::replace(&mut source.stale, true)))
    }

    /// Whether a source has stopped.
    pub fn is_stale(&self, source_idx: usize) -> bool {
        self.sources[source_idx].stale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> Duration = Duration::from_millis;

    #[test]
    fn a_source_is_stale_within_its_limit_and_until_it_is_heard_again() {
        let mut dog = Watchdog::new(2, MS(100));
        assert_eq!(dog.poll(MS(1000)), None, "never heard");
        assert!(!dog.handle_sample(1, MS(1000)));
        assert_eq!(dog.poll(MS(1099)), None);
        assert_eq!(dog.poll(MS(1100)), Some((1, true)));
        assert!(dog.is_stale(1) && !dog.is_stale(0));
        assert_eq!(dog.poll(MS(1150)), None, "said once a timeout");
        assert_eq!(dog.poll(MS(1200)), Some((1, false)));
        assert!(dog.handle_sample(1, MS(1210)));
        assert!(!dog.is_stale(1));
        assert_eq!(dog.poll(MS(1300)), None);
        assert_eq!(dog.poll(MS(1310)), Some((1, true)));
    }

    #[test]
    fn each_source_is_told_of() {
        let mut dog = Watchdog::new(2, MS(10));
        dog.handle_sample(0, MS(0));
        dog.handle_sample(1, MS(0));
        assert_eq!(dog.poll(MS(20)), Some((0, true)));
        assert_eq!(dog.poll(MS(20)), Some((1, true)));
        assert_eq!(dog.poll(MS(20)), None);
    }
}
