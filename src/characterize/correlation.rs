//! Correlation of each joint's motion with each taxel's change in the air.

use serde::Serialize;

use super::frames::{Prepared, changes, smoothed};

/// Time over which changes are taken, s: longer than noise, shorter than most movements.
const SPAN_S: f64 = 0.3;
/// Smoothing window before that, s.
const SMOOTH_S: f64 = 0.05;
/// Interval between the changes used, s. Neighbouring changes have the same information.
const EVERY_S: f64 = 0.02;

/// Correlation of the changes of joint angles with the changes of readings at zero load.
///
/// # Shapes
/// J joints of the recording, T taxels of the region, S sessions. `None` for a joint or taxel that never changes.
/// # Source
/// Pose-aware tactile gloves, Sec. III, Observation 3: "changes in tactile readings due to in-air pose changes".
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Correlation {
    /// Changes are over this time, s.
    pub span_s: f64,
    /// Angles and readings are centred means over this time, s.
    pub smoothing_s: f64,
    /// Number of changes used.
    pub n_changes: u64,
    /// `[J, T]`: each joint with each taxel, all sessions pooled.
    pub by_taxel: Vec<Vec<Option<f64>>>,
    /// `[J]`: each joint with the sum of all taxels.
    pub of_sum: Vec<Option<f64>>,
    /// `[J]`: absolute correlation, mean over all taxels.
    pub mean_abs: Vec<Option<f64>>,
    /// `[S, J]`: `mean_abs` of each session.
    pub mean_abs_by_session: Vec<Vec<Option<f64>>>,
}

impl Correlation {
    pub(super) fn of(sessions: &[Prepared<'_>]) -> Self {
        let tallies: Vec<Tally> = sessions.iter().map(Tally::of).collect();
        let mut pooled =
            tallies.first().map_or_else(Tally::default, |first| Tally::new(first.n_joints, first.n_taxels));
        tallies.iter().for_each(|tally| pooled.add(tally));
        let Tally { n_joints, n_taxels, .. } = pooled;
        Correlation {
            span_s: SPAN_S,
            smoothing_s: SMOOTH_S,
            n_changes: pooled.n as u64,
            by_taxel: (0..n_joints).map(|j| (0..n_taxels).map(|t| pooled.correlation(j, t)).collect()).collect(),
            of_sum: (0..n_joints).map(|j| pooled.correlation(j, n_taxels)).collect(),
            mean_abs: (0..n_joints).map(|j| pooled.mean_abs(j)).collect(),
            mean_abs_by_session: tallies
                .iter()
                .map(|tally| (0..n_joints).map(|j| tally.mean_abs(j)).collect())
                .collect(),
        }
    }

    /// Joints by absolute correlation, mean over all taxels, the largest first.
    pub fn ranked(&self) -> Vec<usize> {
        let mut ranked: Vec<usize> = (0..self.mean_abs.len()).collect();
        ranked.sort_by(|a, b| {
            let size = |joint: usize| self.mean_abs[joint].unwrap_or(-1.0);
            size(*b).total_cmp(&size(*a))
        });
        ranked
    }
}

/// Sums of products of joints with taxels; the last column is the sum of all taxels.
#[derive(Debug, Clone, Default)]
struct Tally {
    n_joints: usize,
    n_taxels: usize,
    n: f64,
    x: Vec<f64>,
    xx: Vec<f64>,
    y: Vec<f64>,
    yy: Vec<f64>,
    xy: Vec<f64>,
}

impl Tally {
    fn new(n_joints: usize, n_taxels: usize) -> Self {
        let (joints, taxels) = (vec![0.0; n_joints], vec![0.0; n_taxels + 1]);
        Tally {
            n_joints,
            n_taxels,
            n: 0.0,
            x: joints.clone(),
            xx: joints,
            y: taxels.clone(),
            yy: taxels,
            xy: vec![0.0; n_joints * (n_taxels + 1)],
        }
    }

    fn of(session: &Prepared<'_>) -> Self {
        let mut tally = Tally::new(session.n_joints, session.n_taxels);
        let (span, window, every) = (session.n_in(SPAN_S), session.n_in(SMOOTH_S), session.n_in(EVERY_S));
        for run in session.in_air.iter().filter(|run| run.len() > span) {
            let changes_of = |value: &dyn Fn(usize) -> f64| {
                let values: Vec<f64> = run.clone().map(value).collect();
                changes(&smoothed(&values, window), span)
            };
            let joints: Vec<Vec<f64>> =
                (0..session.n_joints).map(|joint| changes_of(&|idx| session.angle(idx, joint))).collect();
            let mut taxels: Vec<Vec<f64>> =
                (0..session.n_taxels).map(|taxel| changes_of(&|idx| session.reading(idx, taxel))).collect();
            taxels.push(changes_of(&|idx| session.sum[idx]));
            for k in (0..run.len() - span).step_by(every) {
                tally.handle(joints.iter().map(|joint| joint[k]), taxels.iter().map(|taxel| taxel[k]));
            }
        }
        tally
    }

    fn handle(&mut self, joints: impl Iterator<Item = f64>, taxels: impl Iterator<Item = f64> + Clone) {
        self.n += 1.0;
        for (t, y) in taxels.clone().enumerate() {
            self.y[t] += y;
            self.yy[t] += y * y;
        }
        let width = self.n_taxels + 1;
        for (j, x) in joints.enumerate() {
            self.x[j] += x;
            self.xx[j] += x * x;
            self.xy[j * width..(j + 1) * width].iter_mut().zip(taxels.clone()).for_each(|(xy, y)| *xy += x * y);
        }
    }

    fn add(&mut self, other: &Tally) {
        self.n += other.n;
        let sums = [&mut self.x, &mut self.xx, &mut self.y, &mut self.yy, &mut self.xy];
        let others = [&other.x, &other.xx, &other.y, &other.yy, &other.xy];
        for (sums, others) in sums.into_iter().zip(others) {
            sums.iter_mut().zip(others).for_each(|(sum, other)| *sum += other);
        }
    }

    /// Pearson's correlation. `taxel` may be the index after the last, for the sum of all taxels.
    fn correlation(&self, joint: usize, taxel: usize) -> Option<f64> {
        let (x, y) = (self.x[joint], self.y[taxel]);
        let (xx, yy) = (self.n * self.xx[joint] - x * x, self.n * self.yy[taxel] - y * y);
        let xy = self.n * self.xy[joint * (self.n_taxels + 1) + taxel] - x * y;
        (xx > 0.0 && yy > 0.0).then(|| (xy / (xx * yy).sqrt()).clamp(-1.0, 1.0))
    }

    fn mean_abs(&self, joint: usize) -> Option<f64> {
        let sizes: Vec<f64> =
            (0..self.n_taxels).filter_map(|taxel| self.correlation(joint, taxel)).map(f64::abs).collect();
        (!sizes.is_empty()).then(|| sizes.iter().sum::<f64>() / sizes.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::super::frames::SessionFrames;
    use super::*;

    #[test]
    fn a_taxel_goes_with_the_joint_that_moves_it_and_not_with_one_that_rests() {
        let n = 1000;
        let time_s: Vec<f64> = (0..n).map(|k| f64::from(k) * 0.01).collect();
        let pose: Vec<f32> =
            time_s.iter().flat_map(|t| [(2.0 * t).sin() as f32, 0.5, (7.3 * t).cos() as f32]).collect();
        let tactile: Vec<f32> = pose.chunks_exact(3).flat_map(|pose| [-4.0 * pose[0], 3.0 * pose[2]]).collect();
        let (stretch, in_air) = (vec![0; n as usize], vec![true; n as usize]);
        let frames = SessionFrames { time_s, stretch, tactile, pose, in_air, ..SessionFrames::default() };
        let found = Correlation::of(&[Prepared::new(&frames, 2, 3), Prepared::new(&frames, 2, 3)]);
        assert!((found.by_taxel[0][0].unwrap() + 1.0).abs() < 1e-6, "{found:?}");
        assert!(found.by_taxel[0][1].unwrap().abs() < 0.1, "{found:?}");
        assert_eq!((found.by_taxel[1][0], found.mean_abs[1]), (None, None));
        assert_eq!(found.mean_abs, found.mean_abs_by_session[1]);
        assert_eq!(found.ranked()[2], 1);
    }
}
