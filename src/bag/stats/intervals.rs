//! Intervals between messages, summed up in bounded memory with the same result on every machine.

use std::collections::BTreeMap;

/// Bins of one octave: 32, so a bin is at most 1/32 of its lower edge wide, and its middle within 1.6 % of all in it.
const BINS_PER_OCTAVE_LOG2: u32 = 5;

/// Count, mean and spread of intervals, and a histogram with log-spaced bins for their quantiles.
///
/// Bins that stay empty take no memory, and there are no more than 1,920 of them over all of `u64`.
#[derive(Debug, Default)]
pub(super) struct Intervals {
    bins: BTreeMap<u32, u64>,
    n: u64,
    max: u64,
    mean: f64,
    /// Sum of squared distances from the mean, by Welford's update.
    squares: f64,
}

impl Intervals {
    pub(super) fn handle(&mut self, interval_ns: u64) {
        *self.bins.entry(bin(interval_ns)).or_default() += 1;
        self.n += 1;
        self.max = self.max.max(interval_ns);
        let distance = interval_ns as f64 - self.mean;
        self.mean += distance / self.n as f64;
        self.squares += distance * (interval_ns as f64 - self.mean);
    }

    pub(super) fn max(&self) -> Option<u64> {
        (self.n > 0).then_some(self.max)
    }

    /// Spread about the mean, ns, of at least two intervals.
    pub(super) fn standard_deviation(&self) -> Option<f64> {
        (self.n > 1).then(|| (self.squares / (self.n - 1) as f64).sqrt())
    }

    /// The middle of the bin that holds quantile `q`, ns.
    pub(super) fn quantile(&self, q: f64) -> Option<f64> {
        let rank = ((self.n as f64 * q).ceil() as u64).max(1);
        let mut n_below = 0;
        for (&bin, &count) in &self.bins {
            n_below += count;
            if n_below >= rank {
                let (from, to) = edges(bin);
                return Some(((from as f64 + (to - 1) as f64) / 2.0).min(self.max as f64));
            }
        }
        None
    }

    /// How many intervals lie in bins above the one that holds `limit_ns`.
    pub(super) fn n_above(&self, limit_ns: f64) -> u64 {
        let limit_bin = bin(limit_ns as u64);
        self.bins.range(limit_bin + 1..).map(|(_, count)| count).sum()
    }
}

/// Values below 2^5 have bins of their own; above, the bin is the octave and the next 5 bits.
fn bin(value: u64) -> u32 {
    let octave = value.checked_ilog2().unwrap_or(0);
    if octave < BINS_PER_OCTAVE_LOG2 {
        return value as u32;
    }
    let shift = octave - BINS_PER_OCTAVE_LOG2;
    ((shift + 1) << BINS_PER_OCTAVE_LOG2) + ((value >> shift) as u32 & ((1 << BINS_PER_OCTAVE_LOG2) - 1))
}

/// The first value of a bin, and the first value behind it.
fn edges(bin: u32) -> (u64, u128) {
    let octave = bin >> BINS_PER_OCTAVE_LOG2;
    if octave == 0 {
        return (u64::from(bin), u128::from(bin) + 1);
    }
    let shift = octave - 1;
    let lead = u64::from((bin & ((1 << BINS_PER_OCTAVE_LOG2) - 1)) | (1 << BINS_PER_OCTAVE_LOG2));
    (lead << shift, u128::from(lead + 1) << shift)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_lies_within_the_edges_of_its_bin() {
        let mut values = vec![0, 1, 31, 32, 33, 63, 64, 9_999_999, 10_000_000, u64::MAX];
        values.extend((0..64).map(|octave| 1 << octave));
        for value in values {
            let (from, to) = edges(bin(value));
            assert!(from <= value && u128::from(value) < to, "{value}: {from}..{to}");
        }
    }

    #[test]
    fn quantiles_are_within_a_bin() {
        let mut intervals = Intervals::default();
        (1..=1000).for_each(|ms| intervals.handle(ms * 1_000_000));
        for (q, exact) in [(0.5, 500e6), (0.99, 990e6)] {
            // Half a bin: 1/64.
            assert!((intervals.quantile(q).unwrap() / exact - 1.0).abs() < 1.0 / 64.0);
        }
        assert_eq!(intervals.max(), Some(1_000_000_000));
        assert_eq!(intervals.n_above(2e9), 0);
    }
}
