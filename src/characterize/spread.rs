//! Robust statistics of a few numbers: medians, quantiles, slopes, and spread over sessions.

use serde::Serialize;

/// Spread of a figure over sessions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Median of the sessions that have it.
    pub median: f64,
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
    /// Number of sessions that have it.
    pub n_sessions: usize,
}

impl Spread {
    /// The spread of the available figures; `None` if no session has one.
    pub fn of(figures: impl IntoIterator<Item = Option<f64>>) -> Option<Self> {
        let mut known: Vec<f64> = figures.into_iter().flatten().filter(|figure| figure.is_finite()).collect();
        let median = median(&mut known)?;
        Some(Spread {
            median,
            min: quantile(&mut known, 0.0)?,
            max: quantile(&mut known, 1.0)?,
            n_sessions: known.len(),
        })
    }
}

/// Median of finite numbers, which it reorders.
pub(super) fn median(numbers: &mut [f64]) -> Option<f64> {
    quantile(numbers, 0.5)
}

/// The quantile, interpolated between order statistics. Reorders the numbers, which are finite.
pub(super) fn quantile(numbers: &mut [f64], share: f64) -> Option<f64> {
    let last = numbers.len().checked_sub(1)?;
    let position = share.clamp(0.0, 1.0) * last as f64;
    let below = position.floor() as usize;
    let (_, &mut lower, rest) = numbers.select_nth_unstable_by(below, f64::total_cmp);
    let upper = rest.iter().copied().min_by(f64::total_cmp).unwrap_or(lower);
    Some(lower + (position - below as f64) * (upper - lower))
}

/// Slope of the line through points, robust to outliers: the median of the slopes of all pairs.
///
/// # Source
/// Theil (1950), Sen (1968).
pub(super) fn theil_sen(points: &[(f64, f64)]) -> Option<f64> {
    let pairs = points.iter().enumerate().flat_map(|(idx, a)| points[idx + 1..].iter().map(move |b| (a, b)));
    let mut slopes: Vec<f64> = pairs.filter(|(a, b)| a.0 != b.0).map(|(a, b)| (b.1 - a.1) / (b.0 - a.0)).collect();
    median(&mut slopes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_interpolated_and_nothing_has_none() {
        let mut numbers = [4.0, 1.0, 3.0, 2.0];
        assert_eq!([0.0, 0.5, 0.9, 1.0].map(|share| quantile(&mut numbers, share)), [1.0, 2.5, 3.7, 4.0].map(Some));
        assert_eq!(quantile(&mut [], 0.5), None);
        let spread = Spread::of([Some(3.0), None, Some(1.0), Some(f64::NAN)]).unwrap();
        assert_eq!(spread, Spread { median: 2.0, min: 1.0, max: 3.0, n_sessions: 2 });
    }

    #[test]
    fn outliers_do_not_tilt_a_line() {
        let mut points: Vec<(f64, f64)> = (0..20).map(|k| (f64::from(k), 3.0 * f64::from(k))).collect();
        (points[3].1, points[15].1) = (900.0, -900.0);
        assert!((theil_sen(&points).unwrap() - 3.0).abs() < 1e-12);
        assert_eq!(theil_sen(&points[..1]), None);
    }
}
