//! How well the tangential force is estimated, where truth and model have three axes.

use serde::{Deserialize, Serialize};

use super::metric::{Metric, Undefined};

/// The scores of a set of frames for the tangential force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TangentialScore {
    /// Frames with a tangential force in truth and estimate.
    pub n_frames: u64,
    /// Mean length of the error of the tangential force, gF, over these frames.
    pub mae_gf: Metric,
    /// Mean error of the tangential force along x, y and z of the patch, gF.
    pub bias_gf: [Metric; 3],
    /// Frames of touch that have an angle: those whose estimated force is not zero.
    pub n_angles: u64,
    /// Mean angle between the true and the estimated force, all axes of both, degrees, over these frames.
    pub angle_deg: Metric,
}

/// Sums over frames.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct TangentialTally {
    pub(super) n: u64,
    /// Sum of the lengths of the errors, gF.
    pub(super) abs_error: f64,
    /// Sums of the errors along x, y and z, gF.
    pub(super) error: [f64; 3],
    pub(super) n_angles: u64,
    /// Sum of the angles, degrees.
    pub(super) angle_deg: f64,
}

impl TangentialTally {
    /// Adds a frame, gF: normal and tangential force, true and estimated. Frames that lack one of them are left out.
    pub(super) fn add(&mut self, is_touch: bool, truth: (f64, [f64; 3]), estimate: (f64, [f64; 3])) {
        let all = |(normal, tangential): (f64, [f64; 3])| [normal, tangential[0], tangential[1], tangential[2]];
        let (truth, estimate) = (all(truth), all(estimate));
        if truth.iter().chain(&estimate).any(|force| !force.is_finite()) {
            return;
        }
        let error: [f64; 3] = std::array::from_fn(|axis| estimate[axis + 1] - truth[axis + 1]);
        self.n += 1;
        self.abs_error += length(&error);
        self.error.iter_mut().zip(error).for_each(|(sum, error)| *sum += error);
        if let Some(angle) = angle_deg(&truth, &estimate).filter(|_| is_touch) {
            self.n_angles += 1;
            self.angle_deg += angle;
        }
    }

    pub(super) fn merge(&mut self, other: &TangentialTally) {
        self.n += other.n;
        self.abs_error += other.abs_error;
        self.error.iter_mut().zip(other.error).for_each(|(sum, error)| *sum += error);
        self.n_angles += other.n_angles;
        self.angle_deg += other.angle_deg;
    }

    /// The score; `None` where no frame has a tangential force in truth and estimate.
    pub(super) fn score(&self) -> Option<TangentialScore> {
        (self.n > 0).then(|| TangentialScore {
            n_frames: self.n,
            mae_gf: Metric::mean(self.abs_error, self.n, Undefined::NoFrames),
            bias_gf: self.error.map(|sum| Metric::mean(sum, self.n, Undefined::NoFrames)),
            n_angles: self.n_angles,
            angle_deg: Metric::mean(self.angle_deg, self.n_angles, Undefined::NoTouch),
        })
    }
}

fn length(vector: &[f64]) -> f64 {
    vector.iter().map(|value| value * value).sum::<f64>().sqrt()
}

/// The angle between two forces, each as its normal force and its tangential force, which is perpendicular to it. `None`
/// where one of them is zero.
///
/// # Source
/// W. Kahan: "How Futile are Mindless Assessments of Roundoff", sec. 12: exact also for small angles.
fn angle_deg(a: &[f64; 4], b: &[f64; 4]) -> Option<f64> {
    let (a_length, b_length) = (length(a), length(b));
    if !(a_length > 0.0 && b_length > 0.0) {
        return None;
    }
    let along = |sign: f64| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a / a_length + sign * b / b_length).collect() };
    Some(2.0 * length(&along(-1.0)).atan2(length(&along(1.0))).to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_biases_and_angles_are_those_of_the_geometry() {
        let mut tally = TangentialTally::default();
        assert_eq!(tally.score(), None);
        tally.add(true, (100.0, [0.0; 3]), (100.0, [100.0, 0.0, 0.0])); // 45 degrees off
        tally.add(true, (30.0, [0.0, 40.0, 0.0]), (60.0, [0.0, 80.0, 0.0])); // twice as strong, and no angle
        tally.add(false, (0.0, [0.0; 3]), (0.0, [-4.0, 3.0, 0.0])); // in the air
        tally.add(true, (f64::NAN, [0.0; 3]), (0.0, [0.0; 3])); // no truth
        tally.add(true, (10.0, [0.0; 3]), (0.0, [0.0; 3])); // an estimate without direction
        let score = tally.score().unwrap();
        assert_eq!((score.n_frames, score.n_angles), (4, 2));
        assert!((score.mae_gf.value().unwrap() - (100.0 + 40.0 + 5.0) / 4.0).abs() < 1e-12);
        assert!((score.angle_deg.value().unwrap() - 22.5).abs() < 1e-9);
        let expected = [96.0 / 4.0, 43.0 / 4.0, 0.0];
        assert!(
            score.bias_gf.iter().zip(expected).all(|(got, expected)| (got.value().unwrap() - expected).abs() < 1e-12)
        );
        let mut twice = tally;
        twice.merge(&tally);
        assert_eq!(twice.score().unwrap().mae_gf, score.mae_gf);
    }

    #[test]
    fn small_and_large_angles_keep_their_digits() {
        let angle = |b: [f64; 4]| angle_deg(&[1.0, 0.0, 0.0, 0.0], &b).unwrap();
        assert!((angle([1.0, 1e-9, 0.0, 0.0]) - 1e-9_f64.to_degrees()).abs() < 1e-20);
        assert!((angle([-1.0, 0.0, 0.0, 0.0]) - 180.0).abs() < 1e-12);
        assert!((angle([0.0, 0.0, 0.0, 7.0]) - 90.0).abs() < 1e-12);
    }
}
