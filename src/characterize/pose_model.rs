//! Reading of a pose in the air: one score for the bend of the hand, and the reading expected for a pose.

use serde::Serialize;

use super::frames::Prepared;
use super::gram::Gram;
use super::selection::{Sample, changes, features, means};
use super::spread::quantile;

/// Quantiles over the time in the air at which the score is 0 and 1.
const SCORE_ENDS: [f64; 2] = [0.01, 0.99];

/// A session with its pose as a score, and as the expected reading in the air.
#[derive(Debug)]
pub(super) struct Posed<'a> {
    pub(super) session: Prepared<'a>,
    /// `[n]`: bend score, if there is one.
    pub(super) score: Option<Vec<f64>>,
    /// `[n]`: expected sum of all taxels in the air at the pose of the frame.
    pub(super) in_air: Vec<f64>,
}

impl<'a> Posed<'a> {
    pub(super) fn new(session: Prepared<'a>, samples: &[Sample], chosen: &[usize], score: Option<&BendScore>) -> Self {
        let air = AirReading::of(samples, chosen);
        let at = |idx| air.as_ref().map_or(0.0, |air| air.at(&session, idx));
        let in_air = (0..session.sum.len()).map(at).collect();
        Posed { score: score.map(|score| score.of_session(&session)), in_air, session }
    }

    /// Sum of all taxels minus the prediction from pose.
    pub(super) fn rise(&self, idx: usize) -> f64 {
        self.session.sum[idx] - self.in_air[idx]
    }
}

/// Bend of the hand as it affects the taxels: 0 and 1 at the ends of the range in the air.
///
/// The mix of the chosen joints whose changes correlate best with those of the sum of all taxels in the air, with the
/// sign that makes it grow with the first joint. If that joint's flexion is positive, as it should be, 0 is the
/// straight hand.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BendScore {
    /// Names of the joints in it.
    pub joints: Vec<String>,
    /// `[joints]`: change of the score per joint, 1/rad.
    pub per_rad: Vec<f64>,
    /// Score with all of them at 0 rad.
    pub at_zero: f64,
    #[serde(skip)]
    joint_idxs: Vec<usize>,
}

impl BendScore {
    /// The score by these joints; `None` if they explain nothing, or there are none.
    pub(super) fn of(sessions: &[Vec<Sample>], joints: &[String], chosen: &[usize]) -> Option<Self> {
        let mut gram = Gram::new(chosen.len(), 1);
        let pick = |sample: &Sample| -> Vec<f64> { chosen.iter().map(|joint| sample.angles[*joint]).collect() };
        let sum = |sample: &Sample| sample.readings.iter().sum::<f64>();
        for samples in sessions {
            // Each session has the same weight: a glove that is worn tighter reads more of the same.
            let size = changes(samples).map(|(from, to)| (sum(to) - sum(from)).powi(2)).sum::<f64>().sqrt();
            for (from, to) in changes(samples).filter(|_| size > 0.0) {
                let turned: Vec<f64> = pick(to).iter().zip(pick(from)).map(|(to, from)| to - from).collect();
                gram.handle(&turned, &[(sum(to) - sum(from)) / size]);
            }
        }
        let weights = gram.fit(&(0..chosen.len()).collect::<Vec<_>>());
        // The first joint's own weight may have either sign, because joints that move with it share its part.
        let along = chosen.first().map(|_| gram.along(&weights, 0)).filter(|along| *along != 0.0)?.signum();
        let weights: Vec<f64> = (0..chosen.len()).map(|k| weights.weight(k, 0) * along).collect();
        let mut mixes: Vec<f64> = sessions
            .iter()
            .flatten()
            .map(|sample| pick(sample).iter().zip(&weights).map(|(angle, weight)| angle * weight).sum())
            .collect();
        let [low, high] = SCORE_ENDS.map(|share| quantile(&mut mixes, share));
        let (low, range) = (low?, high? - low?);
        (range > 0.0).then(|| BendScore {
            joints: chosen.iter().map(|joint| joints[*joint].clone()).collect(),
            per_rad: weights.iter().map(|weight| weight / range).collect(),
            at_zero: -low / range,
            joint_idxs: chosen.to_vec(),
        })
    }

    /// The score at each frame of a session.
    fn of_session(&self, session: &Prepared<'_>) -> Vec<f64> {
        let of_frame = |idx| {
            let parts =
                self.joint_idxs.iter().zip(&self.per_rad).map(|(joint, weight)| session.angle(idx, *joint) * weight);
            self.at_zero + parts.sum::<f64>()
        };
        (0..session.sum.len()).map(of_frame).collect()
    }
}

/// Sum of all taxels of one session in the air by pose: linear and quadratic in the chosen joints.
#[derive(Debug)]
struct AirReading {
    chosen: Vec<usize>,
    centre: Vec<f64>,
    feature_means: Vec<f64>,
    weights: Vec<f64>,
    mean: f64,
}

impl AirReading {
    /// Fitted on a session's time in the air; `None` if it has none.
    fn of(samples: &[Sample], chosen: &[usize]) -> Option<Self> {
        let pick = |sample: &Sample| -> Vec<f64> { chosen.iter().map(|joint| sample.angles[*joint]).collect() };
        let rows: Vec<Vec<f64>> = samples.iter().map(pick).collect();
        let centre = means(rows.iter().map(Vec::as_slice));
        let rows: Vec<Vec<f64>> = rows.iter().map(|row| features(row, &centre)).collect();
        let feature_means = means(rows.iter().map(Vec::as_slice));
        let sums: Vec<f64> = samples.iter().map(|sample| sample.readings.iter().sum()).collect();
        if sums.is_empty() {
            return None;
        }
        let mean = sums.iter().sum::<f64>() / sums.len() as f64;
        let mut gram = Gram::new(2 * chosen.len(), 1);
        for (row, sum) in rows.iter().zip(&sums) {
            gram.handle(&row.iter().zip(&feature_means).map(|(x, m)| x - m).collect::<Vec<_>>(), &[sum - mean]);
        }
        let fitted = gram.fit(&(0..2 * chosen.len()).collect::<Vec<_>>());
        let weights = (0..2 * chosen.len()).map(|k| fitted.weight(k, 0)).collect();
        Some(AirReading { chosen: chosen.to_vec(), centre, feature_means, weights, mean })
    }

    /// Expected reading in the air at the pose of a frame.
    fn at(&self, session: &Prepared<'_>, idx: usize) -> f64 {
        let angles: Vec<f64> = self.chosen.iter().map(|joint| session.angle(idx, *joint)).collect();
        let parts = features(&angles, &self.centre);
        let parts = parts.iter().zip(&self.feature_means).zip(&self.weights).map(|((x, m), weight)| (x - m) * weight);
        self.mean + parts.sum::<f64>()
    }
}
