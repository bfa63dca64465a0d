//! Intervals between messages, summed up in bounded memory with the same result on every machine.

use crate::histogram::Histogram;

/// Count, mean and spread of intervals, and a histogram for their quantiles: the middle of a bin is within 1.6 % of all in it.
#[derive(Debug, Default)]
pub(super) struct Intervals {
    histogram: Histogram<5>,
    n: u64,
    max: u64,
    mean: f64,
    /// Sum of squared distances from the mean, by Welford's update.
    squares: f64,
}

impl Intervals {
    pub(super) fn handle(&mut self, interval_ns: u64) {
        self.histogram.handle(interval_ns);
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
        self.histogram.at(rank - 1).map(|middle| middle.min(self.max as f64))
    }

    /// How many intervals lie in bins above the one that holds `limit_ns`.
    pub(super) fn n_above(&self, limit_ns: f64) -> u64 {
        self.histogram.n_above(limit_ns as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
