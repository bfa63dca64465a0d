//! Detects that a tactile stream has stopped. Pure: time is an argument.

use std::time::Duration;

/// Watches the tactile sources: a controller must never go on with the last force of one that has stopped.
#[derive(Debug, Clone)]
pub struct Watchdog {
    timeout: Duration,
    /// Maximum time that a frame waits for its joint angles.
    slack: Duration,
    sources: Vec<Source>,
}

/// The data that is missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Silence {
    /// No messages.
    Messages,
    /// Messages arrive, but produce no frame.
    Frames,
}

#[derive(Debug, Clone, Copy, Default)]
struct Source {
    /// Time of the last message, or of the report that there was none; `None` before the start.
    message: Option<Duration>,
    /// The same for frames.
    frame: Option<Duration>,
    stale: bool,
}

impl Watchdog {
    /// A watchdog over `n_sources` that reports after `timeout` of silence, and again after each further `timeout`. If
    /// messages arrive but produce no frame, it waits `slack` longer: the time that a frame may wait for joint angles.
    pub fn new(n_sources: usize, timeout: Duration, slack: Duration) -> Self {
        Watchdog { timeout, slack, sources: vec![Source::default(); n_sources] }
    }

    /// Starts watching, at a time since any fixed moment: a source that never sends is as silent as one that stops.
    pub fn begin(&mut self, now: Duration) {
        for source in &mut self.sources {
            *source = Source { message: Some(now), frame: Some(now), stale: source.stale };
        }
    }

    /// Records a message of a source.
    pub fn handle_message(&mut self, source_idx: usize, now: Duration) {
        self.sources[source_idx].message = Some(now);
    }

    /// Records a frame of a source; true if the source was stale until now.
    pub fn handle_frame(&mut self, source_idx: usize, now: Duration) -> bool {
        let source = &mut self.sources[source_idx];
        (source.message, source.frame) = (Some(now), Some(now));
        std::mem::take(&mut source.stale)
    }

    /// The next source to report as stale, what is missing, and true if it is the first report since it stopped.
    pub fn poll(&mut self, now: Duration) -> Option<(usize, Silence, bool)> {
        let (timeout, slack) = (self.timeout, self.slack);
        let is_over =
            |last: Option<Duration>, limit: Duration| last.is_some_and(|last| now.saturating_sub(last) >= limit);
        let silence = |source: &Source| {
            // Once a source is stale, no frame is waiting.
            let limit = if source.stale { timeout } else { timeout + slack };
            match (is_over(source.message, timeout), is_over(source.frame, limit)) {
                (true, _) => Some(Silence::Messages),
                (false, true) => Some(Silence::Frames),
                (false, false) => None,
            }
        };
        let (idx, silence) =
            self.sources.iter().map(silence).enumerate().find_map(|(idx, silence)| Some((idx, silence?)))?;
        let source = &mut self.sources[idx];
        source.frame = Some(now);
        if silence == Silence::Messages {
            source.message = Some(now);
        }
        Some((idx, silence, !std::mem::replace(&mut source.stale, true)))
    }

    /// True if a source has stopped.
    pub fn is_stale(&self, source_idx: usize) -> bool {
        self.sources[source_idx].stale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> Duration = Duration::from_millis;

    fn dog(n_sources: usize) -> Watchdog {
        Watchdog::new(n_sources, MS(100), MS(10))
    }

    #[test]
    fn a_source_is_stale_within_its_limit_and_until_it_is_heard_again() {
        let mut dog = dog(2);
        assert_eq!(dog.poll(MS(1000)), None, "it has not begun");
        assert!(!dog.handle_frame(1, MS(1000)));
        assert_eq!(dog.poll(MS(1099)), None);
        assert_eq!(dog.poll(MS(1100)), Some((1, Silence::Messages, true)));
        assert!(dog.is_stale(1) && !dog.is_stale(0));
        assert_eq!(dog.poll(MS(1150)), None, "said once a timeout");
        assert_eq!(dog.poll(MS(1200)), Some((1, Silence::Messages, false)));
        assert!(dog.handle_frame(1, MS(1210)));
        assert!(!dog.is_stale(1));
        assert_eq!(dog.poll(MS(1300)), None);
        assert_eq!(dog.poll(MS(1310)), Some((1, Silence::Messages, true)));
    }

    #[test]
    fn a_source_that_never_comes_is_stale_from_the_beginning_on() {
        let mut dog = dog(2);
        dog.begin(MS(0));
        dog.handle_frame(0, MS(90));
        assert_eq!(dog.poll(MS(99)), None);
        assert_eq!(dog.poll(MS(100)), Some((1, Silence::Messages, true)));
        assert_eq!(dog.poll(MS(100)), None);
    }

    #[test]
    fn messages_that_give_no_frame_are_as_silent_as_none() {
        let mut dog = dog(1);
        dog.begin(MS(0));
        let said: Vec<(u64, bool)> = (0..400)
            .filter_map(|at| {
                dog.handle_message(0, MS(at));
                dog.poll(MS(at)).map(|(_, silence, first)| {
                    assert_eq!(silence, Silence::Frames);
                    (at, first)
                })
            })
            .collect();
        assert_eq!(said, [(110, true), (210, false), (310, false)]);
    }

    #[test]
    fn each_source_is_told_of() {
        let mut dog = Watchdog::new(2, MS(10), MS(0));
        dog.handle_frame(0, MS(0));
        dog.handle_frame(1, MS(0));
        assert_eq!(dog.poll(MS(20)).map(|(idx, ..)| idx), Some(0));
        assert_eq!(dog.poll(MS(20)).map(|(idx, ..)| idx), Some(1));
        assert_eq!(dog.poll(MS(20)), None);
    }
}
