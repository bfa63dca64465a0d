//! Statistics of the stamps in messages, which are what fusion goes by.

use serde::Serialize;

use crate::bag::TopicStats;
use crate::units::Stamp;

/// How the stamps of one topic run, and how they stand to the times of receipt.
#[derive(Debug, Serialize)]
pub struct StampStats {
    /// Path of the stamp in the message.
    pub field: String,
    /// Stamps that were read and set.
    pub n_stamps: u64,
    /// Stamps that are zero, which drivers leave when they set none; all other figures leave them out.
    pub n_unset: u64,
    /// Messages a second, by their stamps where there are any.
    pub rate_hz: Option<f64>,
    /// Interval that half of all intervals stay within, ms.
    pub interval_p50_ms: Option<f64>,
    /// Interval that 99 % of all intervals stay within, ms.
    pub interval_p99_ms: Option<f64>,
    /// Longest interval, ms.
    pub interval_max_ms: Option<f64>,
    /// Standard deviation of the intervals, ms.
    pub jitter_ms: Option<f64>,
    /// Intervals of more than five medians.
    pub n_gaps: u64,
    /// Stamps before the one in front of them.
    pub n_backward: u64,
    /// The furthest of those.
    pub backward_max_ms: Option<f64>,
    /// Stamps equal to the one in front of them.
    pub n_repeated: u64,
    /// Mean of log time less stamp, ms.
    pub delay_mean_ms: Option<f64>,
    /// Least log time less stamp, ms.
    pub delay_min_ms: Option<f64>,
    /// Greatest log time less stamp, ms.
    pub delay_max_ms: Option<f64>,
}

/// Statistics of a topic's stamps that intervals alone don't tell. Takes the same memory for any number of them.
#[derive(Debug, Default)]
pub(super) struct StampRun {
    n_stamps: u64,
    n_unset: u64,
    last: Option<Stamp>,
    n_backward: u64,
    backward_max_ns: i64,
    n_repeated: u64,
    delay_mean_ns: f64,
    delay_ns: Option<(i64, i64)>,
}

impl StampRun {
    /// Takes in one stamp; whether it is set.
    pub(super) fn handle(&mut self, stamp: Stamp, log_time: Stamp) -> bool {
        if stamp == Stamp(0) {
            self.n_unset += 1;
            return false;
        }
        self.n_stamps += 1;
        if let Some(last) = self.last.replace(stamp) {
            let back = last.nanos_since(stamp);
            self.n_backward += u64::from(back > 0);
            self.n_repeated += u64::from(back == 0);
            self.backward_max_ns = self.backward_max_ns.max(back);
        }
        let delay = log_time.nanos_since(stamp);
        self.delay_mean_ns += (delay as f64 - self.delay_mean_ns) / self.n_stamps as f64;
        let (least, most) = self.delay_ns.get_or_insert((delay, delay));
        (*least, *most) = ((*least).min(delay), (*most).max(delay));
        true
    }

    /// Whether no stamp is set, or all are the same.
    pub(super) fn is_useless(&self) -> bool {
        match self.n_stamps {
            0 => self.n_unset > 0,
            n => n > 1 && self.n_repeated + 1 == n,
        }
    }

    /// The statistics; `intervals` are those of the stamps as if they were log times.
    pub(super) fn stats(&self, field: &str, intervals: Option<&TopicStats>) -> StampStats {
        let ms = |ns: i64| ns as f64 / 1e6;
        StampStats {
            field: field.to_owned(),
            n_stamps: self.n_stamps,
            n_unset: self.n_unset,
            rate_hz: intervals.and_then(|stats| stats.rate_hz),
            interval_p50_ms: intervals.and_then(|stats| stats.interval_p50_ms),
            interval_p99_ms: intervals.and_then(|stats| stats.interval_p99_ms),
            interval_max_ms: intervals.and_then(|stats| stats.interval_max_ms),
            jitter_ms: intervals.and_then(|stats| stats.jitter_ms),
            n_gaps: intervals.map_or(0, |stats| stats.n_gaps),
            n_backward: self.n_backward,
            backward_max_ms: (self.n_backward > 0).then(|| ms(self.backward_max_ns)),
            n_repeated: self.n_repeated,
            delay_mean_ms: self.delay_ns.map(|_| self.delay_mean_ns / 1e6),
            delay_min_ms: self.delay_ns.map(|(least, _)| ms(least)),
            delay_max_ms: self.delay_ns.map(|(_, most)| ms(most)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backward_repeated_and_unset_stamps_are_told_apart() {
        let mut run = StampRun::default();
        let stamps = [10, 20, 20, 0, 5, 30];
        let set = stamps.map(|ms| run.handle(Stamp(ms * 1_000_000), Stamp(40_000_000)));
        assert_eq!(set, [true, true, true, false, true, true]);
        let stats = run.stats("header.stamp", None);
        assert_eq!((stats.n_stamps, stats.n_unset, stats.n_backward, stats.n_repeated), (5, 1, 1, 1));
        assert_eq!(stats.backward_max_ms, Some(15.0));
        assert_eq!((stats.delay_min_ms, stats.delay_mean_ms, stats.delay_max_ms), (Some(10.0), Some(23.0), Some(35.0)));
    }
}
