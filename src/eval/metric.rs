//! A measure that may have no value, and then says why.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Why a measure has no value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Undefined {
    /// No frame has both truth and estimate.
    NoFrames,
    /// No scored frame is touch.
    NoTouch,
    /// Every scored frame is touch.
    NoNoTouch,
    /// The truth is the same at every scored frame.
    NoVariance,
    /// The bin has fewer frames than the scoring asks for.
    TooFewFrames,
    /// No time was spent in the air.
    NoAirTime,
    /// Nothing to take a distribution of.
    NoSamples,
    /// The forces are too large for the arithmetic.
    Overflow,
}

impl fmt::Display for Undefined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Undefined::NoFrames => "no frames",
            Undefined::NoTouch => "no touch",
            Undefined::NoNoTouch => "all touch",
            Undefined::NoVariance => "no variance",
            Undefined::TooFewFrames => "too few frames",
            Undefined::NoAirTime => "no time in air",
            Undefined::NoSamples => "no samples",
            Undefined::Overflow => "forces too large",
        })
    }
}

/// A measure: a finite number, or the reason why there is none. In JSON `0.98` or `{"undefined": "no_touch"}`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Metric {
    /// Finite.
    Value(f64),
    /// None, and why.
    Undefined {
        /// Why.
        undefined: Undefined,
    },
}

impl Metric {
    /// A measure without a value.
    pub fn undefined(undefined: Undefined) -> Self {
        Metric::Undefined { undefined }
    }

    /// The value, where there is one.
    pub fn value(self) -> Option<f64> {
        match self {
            Metric::Value(value) => Some(value),
            Metric::Undefined { .. } => None,
        }
    }

    pub(super) fn finite(value: f64) -> Self {
        if value.is_finite() { Metric::Value(value) } else { Metric::undefined(Undefined::Overflow) }
    }

    pub(super) fn ratio(part: u64, whole: u64, undefined: Undefined) -> Self {
        if whole == 0 { Metric::undefined(undefined) } else { Metric::Value(part as f64 / whole as f64) }
    }

    pub(super) fn mean(sum: f64, n: u64, undefined: Undefined) -> Self {
        if n == 0 { Metric::undefined(undefined) } else { Metric::finite(sum / n as f64) }
    }

    /// The mean of two measures; undefined for the reason of the first one that is.
    pub(super) fn average(a: Metric, b: Metric) -> Self {
        match (a, b) {
            (Metric::Value(a), Metric::Value(b)) => Metric::Value((a + b) / 2.0),
            (Metric::Value(_), undefined) | (undefined, _) => undefined,
        }
    }
}
