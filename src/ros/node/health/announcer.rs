//! Reports a problem once when it lasts, and once when it is over.

use std::collections::BTreeMap;
use std::time::Duration;

/// How long a problem must last before it is reported.
const LASTING: Duration = Duration::from_millis(1500);

/// How long a problem must be gone before that is reported; one in every second or third report still counts as
/// lasting.
const GONE: Duration = Duration::from_secs(3);

/// Minimum time between two reports of the same problem: a problem that comes and goes must not fill a log.
const PAUSE: Duration = Duration::from_secs(30);

/// A message for the user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Announcement {
    /// A problem, in the words of its report.
    Began(String),
    /// A reported problem is over: the words of its report, without the remedy.
    Ended(String),
}

/// Remembers the reported problems.
#[derive(Debug, Clone, Default)]
pub struct Announcer {
    entries: BTreeMap<String, Entry>,
}

#[derive(Debug, Clone)]
struct Entry {
    since: Duration,
    seen: Duration,
    /// Time of the last report.
    said: Option<Duration>,
    /// True if it was reported since it began.
    is_told: bool,
    /// The words in which it was reported last.
    text: String,
}

impl Announcer {
    /// A problem goes on, but is not reported now.
    pub fn hold(&mut self, now: Duration, name: &str) {
        if let Some(entry) = self.entries.get_mut(name) {
            entry.seen = now;
        }
    }

    /// Takes the current problems, each with its name; returns the messages to log.
    pub fn handle(&mut self, now: Duration, problems: &[(String, String)]) -> Vec<Announcement> {
        let mut said = Vec::new();
        for (name, text) in problems {
            let new = Entry { since: now, seen: now, said: None, is_told: false, text: String::new() };
            let entry = self.entries.entry(name.clone()).or_insert(new);
            if now.saturating_sub(entry.seen) > GONE {
                (entry.since, entry.is_told) = (now, false);
            }
            entry.seen = now;
            let paused = entry.said.is_some_and(|said| now.saturating_sub(said) < PAUSE);
            if !entry.is_told && !paused && now.saturating_sub(entry.since) >= LASTING {
                (entry.said, entry.is_told) = (Some(now), true);
                entry.text.clone_from(text);
                said.push(Announcement::Began(text.clone()));
            }
        }
        for entry in self.entries.values_mut() {
            if entry.is_told && now.saturating_sub(entry.seen) > GONE {
                entry.is_told = false;
                said.push(Announcement::Ended(without_remedy(&entry.text).to_owned()));
            }
        }
        said
    }
}

/// A problem and its remedy stand on one line: `problem; remedy`.
fn without_remedy(text: &str) -> &str {
    text.split_once("; ").map_or(text, |(problem, _)| problem)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The messages at each half second, for a problem that is there or not at that time.
    fn said(there: &[bool]) -> Vec<(usize, Announcement)> {
        let mut announcer = Announcer::default();
        let problem = [("taxels".to_owned(), "taxels: nothing; start the driver".to_owned())];
        let at = |(idx, &there): (usize, &bool)| {
            let problems = if there { &problem[..] } else { &[] };
            let said = announcer.handle(Duration::from_millis(500 * idx as u64), problems);
            said.into_iter().map(move |said| (idx, said)).collect::<Vec<_>>()
        };
        there.iter().enumerate().flat_map(at).collect()
    }

    #[test]
    fn a_problem_is_said_once_when_it_lasts_and_once_when_it_is_over() {
        let mut there = vec![true; 20];
        there.extend([false; 10]);
        let (began, ended) = ("taxels: nothing; start the driver".to_owned(), "taxels: nothing".to_owned());
        assert_eq!(said(&there), [(3, Announcement::Began(began)), (26, Announcement::Ended(ended))]);
    }

    #[test]
    fn one_that_comes_and_goes_is_said_and_fills_no_log() {
        let twice: Vec<bool> = (0..20).map(|idx| idx == 0 || idx == 9).collect();
        assert_eq!(said(&twice), []);
        let blinking: Vec<bool> = (0..100).map(|idx| idx % 2 == 0).collect();
        assert_eq!(said(&blinking).len(), 1, "it never was gone for long");
        let slow: Vec<bool> = (0..120).map(|idx| idx % 12 < 6).collect(); // 3 s there, 3 s not, for a minute
        assert!(said(&slow).len() <= 4, "{:?}", said(&slow));
    }

    #[test]
    fn a_problem_that_is_held_is_not_said_to_be_over() {
        let mut announcer = Announcer::default();
        let problem = [("estimates".to_owned(), "0 %".to_owned())];
        let at = |half_seconds: u32| Duration::from_millis(500) * half_seconds;
        let said: Vec<_> = (0..6).flat_map(|time| announcer.handle(at(time), &problem)).collect();
        assert_eq!(said, [Announcement::Began("0 %".to_owned())]);
        for time in 6..40 {
            announcer.hold(at(time), "estimates");
            assert_eq!(announcer.handle(at(time), &[]), [], "its cause is reported instead");
        }
        let said: Vec<_> = (40..60).flat_map(|time| announcer.handle(at(time), &[])).collect();
        assert_eq!(said, [Announcement::Ended("0 %".to_owned())]);
    }
}
