//! Statistics of paired differences and of latencies.

use serde::{Deserialize, Serialize};

use super::metric::{Metric, Undefined};

/// Pairs above which the exact distribution is refused: at 500 it takes about 10^8 additions.
const MAX_PAIRS: usize = 500;

/// Differences that no test can be made of.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum StatisticsError {
    #[error("difference {idx} is {value}, expected a finite number; leave out pairs without a value")]
    NotFinite { idx: usize, value: f64 },
    #[error("all {n} paired differences are zero or there are none; the signed-rank test needs one that isn't")]
    NoDifference { n: usize },
    #[error(
        "{n} paired differences are too many for the exact test, expected at most {MAX_PAIRS}; use an approximate one"
    )]
    TooMany { n: usize },
}

/// Result of a Wilcoxon signed-rank test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Wilcoxon {
    /// Differences that aren't zero.
    pub n: usize,
    /// Differences that are, and were dropped.
    pub n_zero: usize,
    /// Sum of the ranks of the positive differences.
    pub w_plus: f64,
    /// Probability, were signs a fair coin's, of a rank sum at least as large.
    pub p: f64,
}

/// The one-sided exact Wilcoxon signed-rank test: are the differences larger than zero?
///
/// Zeros are dropped (Wilcoxon's own rule, and scipy's `zero_method="wilcox"`). Ties share their mean rank, and the
/// distribution is that of the ranks there are, each sign being as likely: exact with ties too.
///
/// # Errors
/// [`StatisticsError`] for differences that aren't finite, are all zero, or are more than 500.
/// # Source
/// Pose-aware tactile gloves, Sec. VI-B: five users of whom all improve give p = 0.03125.
pub fn wilcoxon_greater(differences: &[f64]) -> Result<Wilcoxon, StatisticsError> {
    if let Some((idx, &value)) = differences.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        return Err(StatisticsError::NotFinite { idx, value });
    }
    let mut by_size: Vec<f64> = differences.iter().copied().filter(|&difference| difference != 0.0).collect();
    let n = by_size.len();
    if n == 0 {
        return Err(StatisticsError::NoDifference { n: differences.len() });
    }
    if n > MAX_PAIRS {
        return Err(StatisticsError::TooMany { n });
    }
    by_size.sort_by(|a, b| a.abs().total_cmp(&b.abs()));

    // Doubled ranks are whole numbers, ties included.
    let mut doubled_ranks = Vec::with_capacity(n);
    for tied in by_size.chunk_by(|a, b| a.abs() == b.abs()) {
        let first = doubled_ranks.len() + 1;
        doubled_ranks.extend(std::iter::repeat_n(2 * first + tied.len() - 1, tied.len()));
    }
    let observed: usize =
        by_size.iter().zip(&doubled_ranks).filter(|(value, _)| **value > 0.0).map(|(_, rank)| rank).sum();

    // probability[s]: that the doubled ranks of the positive differences sum to s.
    let total: usize = doubled_ranks.iter().sum();
    let mut probability = vec![0.0; total + 1];
    probability[0] = 1.0;
    let mut reach = 0;
    for &rank in &doubled_ranks {
        reach += rank;
        for sum in (0..=reach).rev() {
            let with = if sum >= rank { probability[sum - rank] } else { 0.0 };
            probability[sum] = 0.5 * (probability[sum] + with);
        }
    }
    Ok(Wilcoxon {
        n,
        n_zero: differences.len() - n,
        w_plus: observed as f64 / 2.0,
        // From the far end, so that small probabilities are summed before large ones.
        p: probability[observed..].iter().rev().sum::<f64>().min(1.0),
    })
}

/// Cohen's d_z: the mean of paired differences over their standard deviation (n - 1).
///
/// Undefined for less than two differences and for differences that are all the same.
pub fn cohens_dz(differences: &[f64]) -> Metric {
    let n = differences.len() as f64;
    if differences.len() < 2 {
        return Metric::undefined(Undefined::NoSamples);
    }
    if differences.windows(2).all(|pair| pair[0] == pair[1]) {
        return Metric::undefined(Undefined::NoVariance);
    }
    let mean = differences.iter().sum::<f64>() / n;
    let variance = differences.iter().map(|difference| (difference - mean).powi(2)).sum::<f64>() / (n - 1.0);
    Metric::finite(mean / variance.sqrt())
}

/// A distribution in a few numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Distribution {
    /// Samples.
    pub n: u64,
    /// Mean.
    pub mean: f64,
    /// 5th percentile. Percentiles are interpolated linearly between order statistics (numpy's default).
    pub p5: f64,
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

impl Distribution {
    /// The distribution of the finite samples; `None` when there is none.
    pub fn of(samples: &[f64]) -> Option<Self> {
        let mut sorted: Vec<f64> = samples.iter().copied().filter(|sample| sample.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        if sorted.is_empty() {
            return None;
        }
        let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
        Some(Self::by_order(sorted.len() as u64, mean, |idx| sorted[idx as usize]))
    }

    /// The distribution of `n` samples, at least one, of which `at` gives the one with an index among all, sorted.
    pub(super) fn by_order(n: u64, mean: f64, at: impl Fn(u64) -> f64) -> Self {
        let last = n.saturating_sub(1);
        let quantile = |share: f64| {
            let position = share * last as f64;
            let below = position.floor() as u64; // at most the last, as share is at most 1
            let (lower, upper) = (at(below), at((below + 1).min(last)));
            lower + (position - below as f64) * (upper - lower)
        };
        let (p5, p50, p95) = (quantile(0.05), quantile(0.5), quantile(0.95));
        Distribution { n, mean, p5, p50, p95, min: at(0), max: at(last) }
    }
}
