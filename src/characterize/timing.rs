//! Timing of a stream's samples.

use serde::Serialize;

use super::spread::{median, quantile};
use crate::units::Stamp;

/// Intervals between a stream's samples, by their stamps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StreamTiming {
    /// Number of samples.
    pub n_samples: usize,
    /// Samples per second, from the median interval.
    pub rate_hz: f64,
    /// Standard deviation of the intervals shorter than twice the median, ms: jitter without loss.
    pub jitter_ms: f64,
    /// 99th percentile of the intervals, ms.
    pub interval_p99_ms: f64,
    /// Longest interval, ms.
    pub interval_max_ms: f64,
    /// Number of intervals of twice the median or more: samples that were lost, or never sent.
    pub n_gaps: usize,
}

impl StreamTiming {
    /// The timing of samples in order of arrival; `None` for fewer than three.
    pub fn of(stamps: &[Stamp]) -> Option<Self> {
        let mut intervals: Vec<f64> =
            stamps.windows(2).map(|pair| pair[1].nanos_since(pair[0]) as f64 * 1e-6).filter(|ms| *ms > 0.0).collect();
        let typical = median(&mut intervals).filter(|_| intervals.len() >= 2)?;
        let steady: Vec<f64> = intervals.iter().copied().filter(|ms| *ms < 2.0 * typical).collect();
        let mean = steady.iter().sum::<f64>() / steady.len() as f64;
        let variance = steady.iter().map(|ms| (ms - mean).powi(2)).sum::<f64>() / steady.len() as f64;
        Some(StreamTiming {
            n_samples: stamps.len(),
            rate_hz: 1e3 / typical,
            jitter_ms: variance.sqrt(),
            n_gaps: intervals.len() - steady.len(),
            interval_p99_ms: quantile(&mut intervals, 0.99)?,
            interval_max_ms: quantile(&mut intervals, 1.0)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_sample_is_a_gap_and_no_jitter() {
        let stamps: Vec<Stamp> = (0..100).filter(|k| *k != 50).map(|k| Stamp(k * 10_000_000)).collect();
        let timing = StreamTiming::of(&stamps).unwrap();
        assert!((timing.rate_hz - 100.0).abs() < 1e-9 && timing.jitter_ms < 1e-9, "{timing:?}");
        assert_eq!((timing.n_gaps, timing.n_samples, timing.interval_max_ms), (1, 99, 20.0));
        assert_eq!(StreamTiming::of(&stamps[..2]), None);
    }
}
