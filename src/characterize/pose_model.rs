//! Models of the pose in the air: a score for the bend of the hand, and the expected reading at a pose.

use serde::Serialize;

use super::frames::Prepared;
use super::gram::Gram;
use super::selection::{Sample, changes, features, means};
use super::spread::quantile;

/// Quantiles over the time in the air at which the score is 0 and 1.
const SCORE_ENDS: [f64; 2] = [0.01, 0.99];

/// A session with the bend score and the expected reading in the air of each frame.
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

    /// Sum of all taxels minus the expected reading in the air at this pose.
    pub(super) fn rise(&self, idx: usize) -> f64 {
        self.session.sum[idx] - self.in_air[idx]
    }
}

/// Bend of the hand by its effect on the taxels. The score is 0 and 1 at the ends of the range in the air.
///
/// It is a weighted sum of the chosen joints. Its changes correlate best with the changes of the sum of all taxels in
/// the air. Its sign is chosen so that it increases with the first joint. If flexion of that joint is positive, as it
/// should be, 0 is the straight hand.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BendScore {
    /// Names of the joints in it.
    pub joints: Vec<String>,
    /// `[joints]`: change of the score per joint, 1/rad.
    pub per_rad: Vec<f64>,
    /// Score if all these joints are at 0 rad.
    pub at_zero: f64,
    #[serde(skip)]
    joint_idxs: Vec<usize>,
}

impl BendScore {
    /// The score from these joints; `None` if there are none, or if they explain nothing.
    pub(super) fn of(sessions: &[Vec<Sample>], joints: &[String], chosen: &[usize]) -> Option<Self> {
        let mut gram = Gram::new(chosen.len(), 1);
        let pick = |sample: &Sample| -> Vec<f64> { chosen.iter().map(|joint| sample.angles[*joint]).collect() };
        let sum = |sample: &Sample| sample.readings.iter().sum::<f64>();
        for samples in sessions {
            // Each session has the same weight, because the readings of a glove that is worn tighter are larger.
            let size = changes(samples).map(|(from, to)| (sum(to) - sum(from)).powi(2)).sum::<f64>().sqrt();
            for (from, to) in changes(samples).filter(|_| size > 0.0) {
                let turned: Vec<f64> = pick(to).iter().zip(pick(from)).map(|(to, from)| to - from).collect();
                gram.handle(&turned, &[(sum(to) - sum(from)) / size]);
            }
        }
        let weights = gram.fit(&(0..chosen.len()).collect::<Vec<_>>());
        // The weight of the first joint may have either sign, because joints that move with it share its effect.
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

/// Sum of all taxels of one session in the air by pose: a quadratic function of the chosen joints.
#[derive(Debug)]
struct AirReading {
    chosen: Vec<usize>,
    centre: Vec<f64>,
    feature_means: Vec<f64>,
    weights: Vec<f64>,
    mean: f64,
}

impl AirReading {
    /// Fits it to a session's time in the air; `None` if there is none.
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
