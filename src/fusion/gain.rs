//! How much more, or less, the true force of a donning is than what a model says: from a few touches of a known force.

use serde::{Deserialize, Serialize};

use crate::units::Newton;

/// Touches that are needed at least.
pub const FEWEST_TOUCHES: usize = 3;

/// Gains that a donning may have; what lies outside is a force in another unit, or another finger.
const POSSIBLE: std::ops::RangeInclusive<f64> = 0.2..=5.0;

/// The interval of a gain may reach this factor from it at most: beyond, touches tell less than nothing was known before.
const WIDEST: f64 = 1.3;

/// A touch whose force is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownTouch {
    /// True force, N, mean over the touch.
    pub force: Newton,
    /// Model output without a gain, N, mean over the same frames.
    pub estimate: Newton,
}

/// Factor on the forces of a region in this donning.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForceGain {
    /// The gain.
    pub gain: f64,
    /// Lower end of its 95 % interval.
    pub low: f64,
    /// Upper end of its 95 % interval.
    pub high: f64,
    /// Touches that it comes from.
    pub touches: usize,
}

/// Touches that tell no gain. Each text is one line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum GainError {
    #[error("{got} touches of a known force, at least {FEWEST_TOUCHES} needed")]
    TooFew { got: usize },
    #[error("touch {number} has a known force of {} N and an estimate of {} N; both must be above 0", force.0, estimate.0)]
    NoForce { number: usize, force: Newton, estimate: Newton },
    #[error(
        "the touches disagree: each for itself asks for a gain from {least:.2} to {most:.2}, so that the gain of all could lie anywhere from {low:.2} to {high:.2}; press straight on the taxels and hold still, or leave out the odd one"
    )]
    Disagree { least: f64, most: f64, low: f64, high: f64 },
    #[error(
        "the touches ask for a gain of {gain:.3}, expected {} to {}; look at the unit of the known forces, and at which finger was pressed",
        POSSIBLE.start(),
        POSSIBLE.end()
    )]
    Impossible { gain: f64 },
    #[error("gain {gain} with the interval {low} to {high} is none, expected {} to {}", POSSIBLE.start(), POSSIBLE.end())]
    Malformed { gain: f64, low: f64, high: f64 },
}

impl ForceGain {
    /// The gain of touches: the geometric mean of what each asks for, because a model errs by a factor, with the interval
    /// that their spread leaves (Student's t).
    ///
    /// # Errors
    /// [`GainError`] when they are too few, have no force, disagree, or ask for what can't be.
    pub fn fit(touches: &[KnownTouch]) -> Result<Self, GainError> {
        let n = touches.len();
        if n < FEWEST_TOUCHES {
            return Err(GainError::TooFew { got: n });
        }
        let is_force = |force: Newton| force.0.is_finite() && force.0 > 0.0;
        if let Some(idx) = touches.iter().position(|touch| !is_force(touch.force) || !is_force(touch.estimate)) {
            let KnownTouch { force, estimate } = touches[idx];
            return Err(GainError::NoForce { number: idx + 1, force, estimate });
        }
        let logs = || touches.iter().map(|touch| (touch.force.0 / touch.estimate.0).ln());
        let mean = logs().sum::<f64>() / n as f64;
        let variance = logs().map(|log| (log - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
        let half = t_quantile(n - 1) * (variance / n as f64).sqrt();
        let (gain, low, high) = (mean.exp(), (mean - half).exp(), (mean + half).exp());
        if !POSSIBLE.contains(&gain) {
            return Err(GainError::Impossible { gain });
        }
        if half > WIDEST.ln() {
            let (least, most) =
                logs().fold((f64::INFINITY, 0.0_f64), |(least, most), log| (least.min(log.exp()), most.max(log.exp())));
            return Err(GainError::Disagree { least, most, low, high });
        }
        Ok(ForceGain { gain, low, high, touches: n })
    }

    /// Refuses what a file says and no touches can have told.
    ///
    /// # Errors
    /// [`GainError::Malformed`].
    pub fn check(&self) -> Result<(), GainError> {
        let ForceGain { gain, low, high, .. } = *self;
        let is_sound = POSSIBLE.contains(&gain) && 0.0 < low && low <= gain && gain <= high && high.is_finite();
        if is_sound { Ok(()) } else { Err(GainError::Malformed { gain, low, high }) }
    }
}

/// The 97.5 % quantile of Student's t.
fn t_quantile(freedom: usize) -> f64 {
    const TABLE: [f64; 10] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];
    match freedom {
        1..=10 => TABLE[freedom - 1],
        // Cornish and Fisher's expansion about the normal quantile; within 0.0002 from here on.
        _ => {
            let (z, n) = (1.959_964_f64, freedom as f64);
            let third = 3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z;
            let second = 5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z;
            z + (z.powi(3) + z) / (4.0 * n) + second / (96.0 * n * n) + third / (384.0 * n.powi(3))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touches(pairs: &[(f64, f64)]) -> Vec<KnownTouch> {
        pairs
            .iter()
            .map(|(force, estimate)| KnownTouch { force: Newton(*force), estimate: Newton(*estimate) })
            .collect()
    }

    #[test]
    fn the_gain_is_the_factor_between_truth_and_estimate_with_its_interval() {
        let exact = ForceGain::fit(&touches(&[(1.0, 0.8), (2.0, 1.6), (0.5, 0.4)])).unwrap();
        assert!((exact.gain - 1.25).abs() < 1e-12 && (exact.high - exact.low) < 1e-6 && exact.touches == 3);
        // Logarithms 0.1, 0.2 and 0.3: mean 0.2, standard error 0.1 / sqrt(3), t of 2 degrees 4.303.
        let spread = touches(&[(0.1_f64.exp(), 1.0), (0.2_f64.exp(), 1.0), (0.3_f64.exp(), 1.0)]);
        let spread = ForceGain::fit(&spread).unwrap();
        assert!((spread.gain - 0.2_f64.exp()).abs() < 1e-12);
        assert!((spread.high - (0.2_f64 + 4.303 * 0.1 / 3.0_f64.sqrt()).exp()).abs() < 1e-9);
        spread.check().unwrap();
    }

    #[test]
    fn touches_that_tell_no_gain_are_refused() {
        let refused = |pairs: &[(f64, f64)]| ForceGain::fit(&touches(pairs)).unwrap_err().to_string();
        assert!(refused(&[(1.0, 1.0); 2]).starts_with("2 touches of a known force, at least 3 needed"));
        assert!(refused(&[(1.0, 1.0), (1.0, 0.0), (1.0, 1.0)]).starts_with("touch 2 has a known force of 1 N"));
        assert!(refused(&[(1.0, 1.0), (f64::NAN, 1.0), (1.0, 1.0)]).starts_with("touch 2 has a known force of NaN"));
        assert!(refused(&[(1.0, 1.0), (2.0, 1.0), (1.0, 2.0)]).starts_with("the touches disagree"));
        assert!(refused(&[(100.0, 1.0); 3]).starts_with("the touches ask for a gain of 100.000, expected 0.2 to 5"));
        let malformed = ForceGain { gain: 1.0, low: 1.1, high: 1.2, touches: 3 };
        assert!(malformed.check().unwrap_err().to_string().starts_with("gain 1 with the interval 1.1 to 1.2"));
    }

    #[test]
    fn the_quantile_goes_on_where_the_table_ends() {
        assert!((t_quantile(10) - 2.228).abs() < 1e-9 && (t_quantile(11) - 2.201).abs() < 0.001);
        assert!((t_quantile(30) - 2.042).abs() < 0.001 && (t_quantile(100_000) - 1.96).abs() < 0.001);
    }
}
