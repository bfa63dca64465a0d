//! Counts of whole numbers in log-spaced bins that never move: quantiles in bounded memory, and the same whatever order numbers
//! and histograms are added in.

use std::collections::BTreeMap;

/// Counts in bins of which each octave has `2^LOG2`, so a bin is at most `2^-LOG2` of its lower edge wide, and its middle within
/// half of that of all in it. Numbers below `2^LOG2` have bins of their own.
///
/// Bins that stay empty take no memory, and there are fewer than `2^LOG2 * (65 - LOG2)` of them over all of `u64`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Histogram<const LOG2: u32> {
    bins: BTreeMap<u32, u64>,
}

impl<const LOG2: u32> Histogram<LOG2> {
    /// Bins there are.
    pub const N_BINS: u32 = (65 - LOG2) << LOG2;

    /// Counts a number.
    pub fn handle(&mut self, value: u64) {
        self.add(Self::bin(value), 1);
    }

    /// Counts `n` numbers of a bin.
    pub fn add(&mut self, bin: u32, n: u64) {
        let total = self.bins.entry(bin).or_default();
        *total = total.saturating_add(n);
    }

    /// Adds what another one counted.
    pub fn merge(&mut self, other: &Self) {
        other.bins.iter().for_each(|(bin, n)| self.add(*bin, *n));
    }

    /// Numbers that were counted.
    pub fn n(&self) -> u64 {
        self.bins.values().fold(0, |total, n| total.saturating_add(*n))
    }

    /// How many numbers lie in each bin that is not empty, in order.
    pub fn bins(&self) -> impl Iterator<Item = (u32, u64)> {
        self.bins.iter().map(|(bin, n)| (*bin, *n))
    }

    /// How many numbers lie in bins above that of `value`.
    pub fn n_above(&self, value: u64) -> u64 {
        self.bins.range(Self::bin(value) + 1..).map(|(_, n)| n).sum()
    }

    /// The middle of the bin in which the number with this index among all, sorted, lies; `None` where there are fewer.
    pub fn at(&self, idx: u64) -> Option<f64> {
        let mut n_below = 0;
        for (&bin, &n) in &self.bins {
            n_below = n.saturating_add(n_below);
            if idx < n_below {
                let (from, to) = Self::edges(bin);
                return Some((from as f64 + (to - 1) as f64) / 2.0);
            }
        }
        None
    }

    /// Behind the numbers that have bins of their own, a bin is the octave and the next `LOG2` bits.
    fn bin(value: u64) -> u32 {
        let octave = value.checked_ilog2().unwrap_or(0);
        if octave < LOG2 {
            return value as u32;
        }
        let shift = octave - LOG2;
        ((shift + 1) << LOG2) + ((value >> shift) as u32 & ((1 << LOG2) - 1))
    }

    /// The first number of a bin, and the first one behind it.
    fn edges(bin: u32) -> (u64, u128) {
        let octave = bin >> LOG2;
        if octave == 0 {
            return (u64::from(bin), u128::from(bin) + 1);
        }
        let shift = octave - 1;
        let lead = u64::from((bin & ((1 << LOG2) - 1)) | (1 << LOG2));
        (lead << shift, u128::from(lead + 1) << shift)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn every_value_lies_within_the_edges_of_its_bin<const LOG2: u32>() {
        let mut values = vec![0, 1, 31, 32, 33, 63, 64, 9_999_999, 10_000_000, u64::MAX];
        values.extend((0..64).map(|octave| 1 << octave));
        for value in values {
            let bin = Histogram::<LOG2>::bin(value);
            let (from, to) = Histogram::<LOG2>::edges(bin);
            assert!(from <= value && u128::from(value) < to, "{value}: {from}..{to}");
            assert!((to - u128::from(from)) << LOG2 <= u128::from(from).max(1 << LOG2), "{value}: {from}..{to}");
            assert!(bin < Histogram::<LOG2>::N_BINS);
        }
    }

    #[test]
    fn values_lie_in_narrow_bins() {
        every_value_lies_within_the_edges_of_its_bin::<5>();
        every_value_lies_within_the_edges_of_its_bin::<8>();
    }

    #[test]
    fn parts_add_up_to_the_whole_and_hold_its_order() {
        let values: Vec<u64> = (0..5000_u64).map(|idx| idx * idx % 7919 * 13).collect();
        let (mut whole, mut parts) = (Histogram::<8>::default(), [Histogram::<8>::default(), Histogram::default()]);
        for (idx, value) in values.iter().enumerate() {
            whole.handle(*value);
            parts[idx % 2].handle(*value);
        }
        let [mut one, other] = parts;
        one.merge(&other);
        assert_eq!(one, whole);
        let mut again = Histogram::<8>::default();
        whole.bins().for_each(|(bin, n)| again.add(bin, n));
        assert_eq!(again, whole);
        let mut sorted = values;
        sorted.sort_unstable();
        for idx in [0, 1, 2500, 4998, 4999] {
            let (got, exact) = (whole.at(idx).unwrap(), sorted[idx as usize] as f64);
            assert!((got - exact).abs() <= exact / 512.0, "{idx}: {got}, expected {exact}");
        }
        assert_eq!((whole.at(5000), whole.n()), (None, 5000));
    }
}
