//! Counts and error of the frames of one true class: touch, no touch, or a bin of force.

use super::scoring::MissingEstimate;

/// Frames of one true class.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Class {
    /// With an estimate.
    pub n: u64,
    /// Of these, those whose estimate is touch.
    pub n_detected: u64,
    /// Without an estimate.
    pub n_missing: u64,
    /// Sum over `n`, gF.
    pub abs_error: f64,
    /// Sum of the true forces over `n`, gF.
    pub truth: f64,
    /// Sum of the estimated forces over `n`, gF.
    pub estimate: f64,
}

impl Class {
    pub(super) fn add(&mut self, truth: f64, estimate: Option<f64>, detected: bool) {
        let Some(estimate) = estimate else {
            self.n_missing += 1;
            return;
        };
        self.n += 1;
        self.n_detected += u64::from(detected);
        self.abs_error += (estimate - truth).abs();
        self.truth += truth;
        self.estimate += estimate;
    }

    pub(super) fn merge(&mut self, other: &Class) {
        self.n += other.n;
        self.n_detected += other.n_detected;
        self.n_missing += other.n_missing;
        self.abs_error += other.abs_error;
        self.truth += other.truth;
        self.estimate += other.estimate;
    }

    /// Frames whose touch is judged.
    pub(super) fn n_judged(&self, missing: MissingEstimate) -> u64 {
        match missing {
            MissingEstimate::Excluded => self.n,
            MissingEstimate::NoTouch => self.n + self.n_missing,
        }
    }
}
