//! The paper's metrics, gathered frame by frame: tallies are small, merge across sessions, and don't care for order.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::class::Class;
use super::curve::{ForceCurve, Mdf};
use super::metric::{Metric, Undefined};
use super::scoring::Scoring;
use super::tangential::{TangentialScore, TangentialTally};

/// Arrays or tallies that don't belong together.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum MetricError {
    #[error("estimate has {estimate} frames and truth has {truth}; align them frame by frame, NaN where there is none")]
    Lengths { truth: usize, estimate: usize },
    #[error("{name} has {got} frames and truth has {truth}; align them frame by frame")]
    OtherLengths { name: &'static str, truth: usize, got: usize },
    #[error("tallies were scored by different rules, {ours:?} and {theirs:?}; score both by the same rules")]
    Scoring { ours: Box<Scoring>, theirs: Box<Scoring> },
}

/// The frames that a score was taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Coverage {
    /// Frames given.
    pub n_frames: u64,
    /// Frames with truth and estimate: those that MAE and R2 are taken over.
    pub n_scored: u64,
    /// Frames whose truth is NaN or infinite. They are in no metric.
    pub n_without_truth: u64,
    /// Frames with truth whose estimate is NaN or infinite.
    pub n_without_estimate: u64,
    /// Those of them that are touch.
    pub n_touch_without_estimate: u64,
}

/// Touch as it was and as it was detected, in frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Confusion {
    /// Touch that was detected.
    pub true_touch: u64,
    /// Touch that was not.
    pub missed_touch: u64,
    /// No touch, and touch was detected.
    pub false_touch: u64,
    /// No touch, and none was detected.
    pub true_no_touch: u64,
}

impl Confusion {
    /// True positive rate: the share of touch that was detected.
    pub fn tpr(&self) -> Metric {
        Metric::ratio(self.true_touch, self.true_touch + self.missed_touch, Undefined::NoTouch)
    }

    /// True negative rate: the share of no touch in which none was detected.
    pub fn tnr(&self) -> Metric {
        Metric::ratio(self.true_no_touch, self.true_no_touch + self.false_touch, Undefined::NoNoTouch)
    }

    /// Balanced accuracy: `(TPR + TNR) / 2`.
    pub fn ba(&self) -> Metric {
        Metric::average(self.tpr(), self.tnr())
    }

    /// F1 of the touch class. Undefined without true touch, where precision and recall speak of different things.
    pub fn f1(&self) -> Metric {
        if self.true_touch + self.missed_touch == 0 {
            return Metric::undefined(Undefined::NoTouch);
        }
        let twice = 2 * self.true_touch;
        Metric::ratio(twice, twice + self.false_touch + self.missed_touch, Undefined::NoTouch)
    }
}

/// One of the five metrics of the paper's Table I.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    /// Balanced accuracy of touch detection.
    Ba,
    /// F1 of the touch class.
    F1,
    /// Minimal detectable force.
    Mdf,
    /// Mean absolute error.
    Mae,
    /// Coefficient of determination.
    R2,
}

impl Measure {
    /// All, in the order of the paper's Table I.
    pub const ALL: [Measure; 5] = [Measure::Ba, Measure::F1, Measure::Mdf, Measure::Mae, Measure::R2];

    /// Whether more is better.
    pub fn higher_is_better(self) -> bool {
        matches!(self, Measure::Ba | Measure::F1 | Measure::R2)
    }

    /// The value of this measure, where the score has one.
    pub fn value(self, score: &Score) -> Option<f64> {
        match self {
            Measure::Ba => score.ba.value(),
            Measure::F1 => score.f1.value(),
            Measure::Mdf => score.mdf.value(),
            Measure::Mae => score.mae_gf.value(),
            Measure::R2 => score.r2.value(),
        }
    }
}

/// The scores of a set of frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// The frames that it was taken from.
    pub coverage: Coverage,
    /// Touch detection in frames.
    pub confusion: Confusion,
    /// Balanced accuracy of touch detection, 0 to 1.
    pub ba: Metric,
    /// F1 of the touch class, 0 to 1.
    pub f1: Metric,
    /// Minimal detectable force.
    pub mdf: Mdf,
    /// Mean absolute error, gF.
    pub mae_gf: Metric,
    /// Coefficient of determination: 1 - residual sum of squares / total sum of squares of the truth.
    pub r2: Metric,
    /// Force gain: estimated force as a share of the true one, the sums over all frames of touch. By session it shows
    /// the gain of each donning.
    pub force_gain: Metric,
    /// The tangential force; absent where truth or model has one axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tangential: Option<TangentialScore>,
}

/// The frames of a stretch of data, as far as the metrics need them. A few kilobytes however many frames went in.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tally {
    scoring: Scoring,
    pub(super) n_without_truth: u64,
    pub(super) touch: Class,
    pub(super) no_touch: Class,
    pub(super) bins: BTreeMap<u32, Class>,
    pub(super) beyond_bins: u64,
    pub(super) truth_mean: f64,
    pub(super) truth_m2: f64,
    pub(super) squared_error: f64,
    pub(super) tangential: TangentialTally,
}

impl Tally {
    /// An empty tally.
    pub fn new(scoring: Scoring) -> Self {
        Tally { scoring, ..Tally::default() }
    }

    /// A tally of aligned frames.
    ///
    /// # Shapes
    /// `truth`, `estimate`: `[n_frames]`, gF; NaN or infinite where there is no truth or no estimate.
    /// # Errors
    /// [`MetricError::Lengths`] when they differ in length.
    pub fn of(scoring: Scoring, truth: &[f64], estimate: &[f64]) -> Result<Self, MetricError> {
        if truth.len() != estimate.len() {
            return Err(MetricError::Lengths { truth: truth.len(), estimate: estimate.len() });
        }
        let mut tally = Tally::new(scoring);
        for (&truth, &estimate) in truth.iter().zip(estimate) {
            tally.add(truth, Some(estimate));
        }
        Ok(tally)
    }

    /// Adds one frame, gF. NaN, infinite and `None` alike mean that there is no value; such frames are counted.
    pub fn add(&mut self, truth_gf: f64, estimate_gf: Option<f64>) {
        self.add_judged(truth_gf, estimate_gf, None);
    }

    /// Adds one frame, gF, whose touch was judged by other means than its force, where `touched` tells.
    pub fn add_judged(&mut self, truth_gf: f64, estimate_gf: Option<f64>, touched: Option<bool>) {
        if !truth_gf.is_finite() {
            self.n_without_truth += 1;
            return;
        }
        let estimate = estimate_gf.filter(|force| force.is_finite());
        let detected = estimate.is_some_and(|force| touched.unwrap_or_else(|| self.scoring.is_touch(force)));
        if self.scoring.is_touch(truth_gf) {
            self.touch.add(truth_gf, estimate, detected);
            match self.scoring.bin_of(truth_gf) {
                Some(bin) => self.bins.entry(bin).or_default().add(truth_gf, estimate, detected),
                None => self.beyond_bins += 1,
            }
        } else {
            self.no_touch.add(truth_gf, estimate, detected);
        }
        let Some(estimate) = estimate else { return };
        // Welford: the variance of forces far from zero keeps its digits.
        let delta = truth_gf - self.truth_mean;
        self.truth_mean += delta / self.n_scored() as f64;
        self.truth_m2 += delta * (truth_gf - self.truth_mean);
        self.squared_error += (estimate - truth_gf).powi(2);
    }

    /// Adds the tangential force of a frame, gF, x y z in the frame of the patch, beside its normal force. Frames that lack
    /// one of them are left out.
    pub fn add_tangential(
        &mut self,
        (truth_gf, true_tangential): (f64, Option<[f64; 3]>),
        (estimate_gf, tangential): (Option<f64>, Option<[f64; 3]>),
    ) {
        if let (Some(true_tangential), Some(estimate), Some(tangential)) = (true_tangential, estimate_gf, tangential) {
            let is_touch = self.scoring.is_touch(truth_gf);
            self.tangential.add(is_touch, (truth_gf, true_tangential), (estimate, tangential));
        }
    }

    /// Adds the frames of another tally, as if they had been added here.
    ///
    /// # Errors
    /// [`MetricError::Scoring`] when it was scored by other rules.
    pub fn merge(&mut self, other: &Tally) -> Result<(), MetricError> {
        if self.scoring != other.scoring {
            let (ours, theirs) = (Box::new(self.scoring), Box::new(other.scoring));
            return Err(MetricError::Scoring { ours, theirs });
        }
        let (n_ours, n_theirs) = (self.n_scored() as f64, other.n_scored() as f64);
        if n_theirs > 0.0 {
            // Chan, Golub, LeVeque 1979: variances of two sets from their means.
            let delta = other.truth_mean - self.truth_mean;
            let share = n_theirs / (n_ours + n_theirs);
            self.truth_mean += delta * share;
            self.truth_m2 += other.truth_m2 + delta * delta * n_ours * share;
            self.squared_error += other.squared_error;
        }
        self.n_without_truth += other.n_without_truth;
        self.touch.merge(&other.touch);
        self.no_touch.merge(&other.no_touch);
        for (&bin, class) in &other.bins {
            self.bins.entry(bin).or_default().merge(class);
        }
        self.beyond_bins += other.beyond_bins;
        self.tangential.merge(&other.tangential);
        Ok(())
    }

    /// The rules frames are scored by.
    pub fn scoring(&self) -> &Scoring {
        &self.scoring
    }

    /// The frames that went in.
    pub fn coverage(&self) -> Coverage {
        let n_without_estimate = self.touch.n_missing + self.no_touch.n_missing;
        Coverage {
            n_frames: self.n_scored() + n_without_estimate + self.n_without_truth,
            n_scored: self.n_scored(),
            n_without_truth: self.n_without_truth,
            n_without_estimate,
            n_touch_without_estimate: self.touch.n_missing,
        }
    }

    /// Touch as it was and as it was detected.
    pub fn confusion(&self) -> Confusion {
        let missing = self.scoring.missing();
        Confusion {
            true_touch: self.touch.n_detected,
            missed_touch: self.touch.n_judged(missing) - self.touch.n_detected,
            false_touch: self.no_touch.n_detected,
            true_no_touch: self.no_touch.n_judged(missing) - self.no_touch.n_detected,
        }
    }

    /// Balanced accuracy and error by true force.
    pub fn curve(&self) -> ForceCurve {
        ForceCurve::of(&self.scoring, &self.no_touch, &self.bins, self.beyond_bins)
    }

    /// The metrics.
    pub fn score(&self) -> Score {
        let confusion = self.confusion();
        Score {
            coverage: self.coverage(),
            confusion,
            ba: confusion.ba(),
            f1: confusion.f1(),
            mdf: self.curve().mdf(),
            mae_gf: Metric::mean(self.touch.abs_error + self.no_touch.abs_error, self.n_scored(), Undefined::NoFrames),
            r2: self.r2(),
            force_gain: self.force_gain(),
            tangential: self.tangential.score(),
        }
    }

    fn r2(&self) -> Metric {
        if self.n_scored() == 0 {
            return Metric::undefined(Undefined::NoFrames);
        }
        if self.truth_m2 == 0.0 {
            return Metric::undefined(Undefined::NoVariance);
        }
        Metric::finite(1.0 - self.squared_error / self.truth_m2)
    }

    fn force_gain(&self) -> Metric {
        match self.touch.truth > 0.0 {
            true => Metric::finite(self.touch.estimate / self.touch.truth),
            false => Metric::undefined(Undefined::NoTouch),
        }
    }

    fn n_scored(&self) -> u64 {
        self.touch.n + self.no_touch.n
    }
}
