//! Balanced accuracy over true force, and the minimal detectable force that is read from it.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use super::class::Class;
use super::metric::{Metric, Undefined};
use super::scoring::{MDF_BALANCED_ACCURACY, Scoring};

/// Frames whose true force is in one bin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ForceBin {
    /// Lower edge, gF, inclusive. Of the first bin this is the touch threshold.
    pub from_gf: f64,
    /// Upper edge, gF, exclusive.
    pub to_gf: f64,
    /// Middle between the edges, gF: 6.25 for the paper's first bin, then 15, 25, ...
    pub centre_gf: f64,
    /// Frames with an estimate.
    pub n: u64,
    /// Frames without one.
    pub n_without_estimate: u64,
    /// Share of the bin's frames in which touch was detected.
    pub tpr: Metric,
    /// Balanced accuracy: the bin's TPR with the TNR of all no-touch frames.
    pub ba: Metric,
    /// Mean absolute error, gF.
    pub mae_gf: Metric,
    /// Mean error, gF: positive where the estimate is too large.
    pub bias_gf: Metric,
}

/// Frames without true touch: what every bin is paired with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NoTouchFrames {
    /// Frames with an estimate.
    pub n: u64,
    /// Frames without one.
    pub n_without_estimate: u64,
    /// Share of them in which no touch was detected.
    pub tnr: Metric,
    /// Mean absolute error, gF.
    pub mae_gf: Metric,
    /// Mean error, gF: positive where the estimate is too large.
    pub bias_gf: Metric,
}

/// Balanced accuracy and error by true force.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ForceCurve {
    /// Frames below the touch threshold.
    pub no_touch: NoTouchFrames,
    /// Every bin from the touch threshold to the largest true force, the empty ones too. A bin whose `ba` is undefined
    /// is not on the curve.
    pub bins: Vec<ForceBin>,
    /// Touch frames whose true force lies past the last bin that is kept. They are in the other metrics.
    pub n_beyond_bins: u64,
}

impl ForceCurve {
    pub(super) fn of(scoring: &Scoring, no_touch: &Class, bins: &BTreeMap<u32, Class>, n_beyond_bins: u64) -> Self {
        let missing = scoring.missing();
        let n_negatives = no_touch.n_judged(missing);
        let tnr = Metric::ratio(n_negatives - no_touch.n_detected, n_negatives, Undefined::NoNoTouch);
        let n_bins = bins.last_key_value().map_or(0, |(&last, _)| last + 1);
        let bins = (0..n_bins).map(|bin| {
            let class = bins.get(&bin).copied().unwrap_or_default();
            let (from_gf, to_gf) = scoring.edges(bin);
            let n_judged = class.n_judged(missing);
            let tpr = if n_judged < scoring.min_bin_frames() {
                Metric::undefined(Undefined::TooFewFrames)
            } else {
                Metric::ratio(class.n_detected, n_judged, Undefined::TooFewFrames)
            };
            ForceBin {
                from_gf,
                to_gf,
                centre_gf: (from_gf + to_gf) / 2.0,
                n: class.n,
                n_without_estimate: class.n_missing,
                tpr,
                ba: Metric::average(tpr, tnr),
                mae_gf: Metric::mean(class.abs_error, class.n, Undefined::TooFewFrames),
                bias_gf: Metric::mean(class.estimate - class.truth, class.n, Undefined::TooFewFrames),
            }
        });
        ForceCurve {
            no_touch: NoTouchFrames {
                n: no_touch.n,
                n_without_estimate: no_touch.n_missing,
                tnr,
                mae_gf: Metric::mean(no_touch.abs_error, no_touch.n, Undefined::NoNoTouch),
                bias_gf: Metric::mean(no_touch.estimate - no_touch.truth, no_touch.n, Undefined::NoNoTouch),
            },
            bins: bins.collect(),
            n_beyond_bins,
        }
    }

    /// The points of the curve: centre in gF and balanced accuracy. Bins without one are left out.
    pub fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.bins.iter().filter_map(|bin| Some((bin.centre_gf, bin.ba.value()?)))
    }

    /// The minimal detectable force: where the curve first crosses 90 %, interpolated between bin centres.
    ///
    /// A bin that is not on the curve is stepped over: the line goes from the bin before it to the bin after it.
    pub fn mdf(&self) -> Mdf {
        let mut points = self.points();
        let Some(first) = points.next() else {
            let tnr_undefined = self.no_touch.tnr.value().is_none();
            let undefined = match (self.bins.is_empty(), tnr_undefined) {
                (true, _) => Undefined::NoTouch,
                (false, true) => Undefined::NoNoTouch,
                (false, false) => Undefined::TooFewFrames,
            };
            return Mdf::Undefined { undefined };
        };
        if first.1 >= MDF_BALANCED_ACCURACY {
            return Mdf::AlreadyAboveInFirstBin { centre_gf: first.0, ba: first.1 };
        }
        let (mut below, mut highest) = (first, first);
        for above in points {
            if above.1 >= MDF_BALANCED_ACCURACY {
                let share = (MDF_BALANCED_ACCURACY - below.1) / (above.1 - below.1);
                let force_gf = below.0 + share * (above.0 - below.0);
                return Mdf::Crossed { force_gf, below_gf: below.0, above_gf: above.0 };
            }
            if above.1 > highest.1 {
                highest = above;
            }
            below = above;
        }
        Mdf::NeverReached { highest_ba: highest.1, at_gf: highest.0 }
    }
}

/// Minimal detectable force.
///
/// # Source
/// Pose-aware tactile gloves, Sec. VI-A.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "mdf", rename_all = "snake_case")]
pub enum Mdf {
    /// The curve crosses 90 % between two bins.
    Crossed {
        /// The minimal detectable force, gF.
        force_gf: f64,
        /// Centre of the last bin below 90 %, gF.
        below_gf: f64,
        /// Centre of the first bin at or above it, gF.
        above_gf: f64,
    },
    /// The first bin of the curve is at or above 90 % already: the force lies at or below its centre, and how far is
    /// not known. It is no number: it isn't averaged, and in comparisons it has no value.
    AlreadyAboveInFirstBin {
        /// Centre of that bin, gF: an upper bound.
        centre_gf: f64,
        /// Its balanced accuracy.
        ba: f64,
    },
    /// No bin reaches 90 %.
    NeverReached {
        /// The best there is.
        highest_ba: f64,
        /// Centre of its bin, gF.
        at_gf: f64,
    },
    /// There is no curve.
    Undefined {
        /// Why.
        undefined: Undefined,
    },
}

impl Mdf {
    /// The force in gF, where the curve crosses 90 %.
    pub fn value(self) -> Option<f64> {
        match self {
            Mdf::Crossed { force_gf, .. } => Some(force_gf),
            _ => None,
        }
    }
}

impl fmt::Display for Mdf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Mdf::Crossed { force_gf, .. } => write!(f, "{force_gf:.2}"),
            Mdf::AlreadyAboveInFirstBin { centre_gf, .. } => write!(f, "<= {centre_gf:.2}"),
            Mdf::NeverReached { .. } => f.write_str("not reached"),
            Mdf::Undefined { undefined } => write!(f, "{undefined}"),
        }
    }
}
