//! Which frames of several tactile sources one message of contacts is made of. Pure: stamps are the only time.

use crate::units::Stamp;

/// Steps of a slower source that are waited for: one that takes longer is late, and its regions are told without it.
const STEPS_AWAITED: i64 = 2;

/// How much longer than its model's period a source's steps are taken to be, at most.
const LONGEST_STEP: i64 = 10;

/// Gathers a frame of each tactile source, at the pace of the slowest that comes.
///
/// A source that never came is not waited for, nor one that let two of its steps pass by the stamps of the others. So whatever
/// one source does, the others' contacts go out, at most two steps later.
#[derive(Debug, Clone)]
pub struct Gathering {
    sources: Vec<Source>,
    /// Stamp of the last message.
    told: Option<Stamp>,
}

#[derive(Debug, Clone)]
struct Source {
    /// Between two frames of its model, ns.
    period_ns: i64,
    /// Between its last two frames, ns.
    step_ns: i64,
    newest: Option<Stamp>,
    /// Stamp of the first of its frames that no message has told yet.
    untold: Option<Stamp>,
    /// Whether a message waits for it.
    is_awaited: bool,
}

impl Gathering {
    /// # Shapes
    /// `periods_ns`: `[tactile sources]`, between two frames; `None` for a source that no region uses.
    pub fn new(periods_ns: &[Option<i64>]) -> Self {
        let source = |period_ns: &Option<i64>| Source {
            period_ns: period_ns.unwrap_or_default().max(1),
            step_ns: period_ns.unwrap_or_default().max(1),
            newest: None,
            untold: None,
            is_awaited: false,
        };
        Gathering { sources: periods_ns.iter().map(source).collect(), told: None }
    }

    /// Takes a frame of a source; whether a message is complete with it. A source that is not among these is ignored.
    pub fn handle_frame(&mut self, source_idx: usize, stamp: Stamp) -> bool {
        let Some(source) = self.sources.get_mut(source_idx) else { return false };
        if let Some(newest) = source.newest {
            let step_ns = stamp.nanos_since(newest);
            if step_ns > 0 {
                source.step_ns = step_ns.clamp(source.period_ns, source.period_ns.saturating_mul(LONGEST_STEP));
            } else {
                source.untold = None; // time jumped back, and what is waited for is counted from here
            }
        }
        source.newest = Some(stamp);
        // One that starts as the others' frames have just been told waits for the next ones with them: told with the next
        // ones of others, each of its frames would be late by most of a step, for ever.
        let is_just_told = |told: Stamp| stamp.nanos_since(told).saturating_abs() < source.period_ns / 2;
        if !std::mem::replace(&mut source.is_awaited, true) && self.told.is_some_and(is_just_told) {
            return false;
        }
        let waited_ns = stamp.nanos_since(*source.untold.get_or_insert(stamp));
        for other in &mut self.sources {
            if other.untold.is_none() && waited_ns >= other.step_ns.saturating_mul(STEPS_AWAITED) {
                other.is_awaited = false;
            }
        }
        self.sources.iter().all(|source| source.untold.is_some() || !source.is_awaited)
    }

    /// Whether a source has a frame that no message has told yet.
    pub fn is_fresh(&self, source_idx: usize) -> bool {
        self.sources.get(source_idx).is_some_and(|source| source.untold.is_some())
    }

    /// The newest stamp of the frames that no message has told yet; `None` where there are none.
    pub fn stamp(&self) -> Option<Stamp> {
        self.sources.iter().filter(|source| source.untold.is_some()).filter_map(|source| source.newest).max()
    }

    /// Takes note that a message told all of them.
    pub fn handle_told(&mut self) {
        self.told = self.stamp().or(self.told);
        self.sources.iter_mut().for_each(|source| source.untold = None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Which sources each message holds fresh, for frames of (source, ms).
    fn told(n_sources: usize, frames: &[(usize, i64)]) -> Vec<(i64, Vec<usize>)> {
        let mut gathering = Gathering::new(&vec![Some(10 * MS); n_sources]);
        let mut told = Vec::new();
        for &(source, at) in frames {
            if gathering.handle_frame(source, Stamp(at * MS)) {
                let fresh = (0..n_sources).filter(|&idx| gathering.is_fresh(idx)).collect();
                told.push((gathering.stamp().unwrap().0 / MS, fresh));
                gathering.handle_told();
            }
        }
        told
    }

    #[test]
    fn one_source_is_told_frame_by_frame() {
        assert_eq!(told(1, &[(0, 0), (0, 10), (0, 20)]), [(0, vec![0]), (10, vec![0]), (20, vec![0])]);
    }

    #[test]
    fn two_of_one_rate_are_told_together_once_both_have_come() {
        let frames = [(0, 0), (1, 1), (0, 10), (1, 11), (0, 20), (1, 21)];
        assert_eq!(told(2, &frames), [(0, vec![0]), (11, vec![0, 1]), (21, vec![0, 1])]);
    }

    #[test]
    fn the_slower_one_sets_the_pace() {
        let frames: Vec<(usize, i64)> =
            (0..40).flat_map(|k| [Some((0, k)), (k % 10 == 5).then_some((1, k))]).flatten().collect();
        let told = told(2, &frames);
        let both = told.iter().filter(|(_, fresh)| fresh.len() == 2).count();
        assert_eq!(both, 3);
        assert!(told.iter().all(|(at, fresh)| fresh.len() == 2 || *at <= 5), "{told:?}");
    }

    #[test]
    fn one_that_stops_is_waited_for_for_two_steps_and_then_no_more() {
        let mut frames = vec![(0, 0), (1, 0), (0, 10), (1, 10)];
        frames.extend((2..8).map(|k| (0, 10 * k)));
        frames.extend([(1, 80), (0, 80), (1, 90), (0, 90)]);
        let told = told(2, &frames);
        let alone: Vec<i64> = told.iter().filter(|(_, fresh)| *fresh == [0]).map(|(at, _)| *at).collect();
        assert_eq!(alone, [0, 40, 50, 60, 70]);
        assert_eq!(told.last(), Some(&(90, vec![0, 1])));
    }

    #[test]
    fn one_that_never_starts_is_not_waited_for() {
        assert_eq!(told(2, &[(0, 0), (0, 10)]), [(0, vec![0]), (10, vec![0])]);
    }

    #[test]
    fn time_that_jumps_back_holds_nobody_up() {
        let frames = [(0, 1000), (1, 1000), (0, 1010), (1, 1010), (0, 5), (0, 15), (0, 25), (0, 35)];
        let told = told(2, &frames);
        assert_eq!(told.last().map(|(at, _)| *at), Some(35), "{told:?}");
    }
}
