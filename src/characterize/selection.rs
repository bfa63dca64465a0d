//! Selects joints that explain the artifact. Each is chosen by what it explains in addition to those before it.

use serde::Serialize;

use super::frames::Prepared;
use super::gram::Gram;

/// Averaging time for frames, s. No artifact is faster than a finger.
const SAMPLE_S: f64 = 0.05;
/// Changes are over this number of samples, 0.3 s, so that slow drift has no effect.
const SPAN: usize = 6;
/// Length of the blocks of time in the air that are fitted or held out, s. Shorter if there is little time.
const STRETCH_S: f64 = 10.0;
/// Number of folds; blocks are assigned to them in turn, and each fold is held out once.
const N_FOLDS: usize = 3;
/// Maximum number of chosen joints.
const MAX_JOINTS: usize = 16;

/// Joints in the order in which they were chosen, by how much they explain of the readings in the air.
///
/// Joints move together, so a joint that only moves with another one correlates as well as that one. Therefore a joint
/// counts only for what it adds. The changes of all taxels are fitted by ridge regression on the changes of the angles
/// and of their squares, for each session separately. The fit uses two of every three blocks of the time in the air and
/// is tested on the third, until each block has been held out once.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Selection {
    /// `[J]`: fraction of the variance of held-out changes that each joint explains alone, for all sessions together.
    pub alone: Vec<Option<f64>>,
    /// The chosen joints, in order.
    pub chosen: Vec<Step>,
    /// The best of the other joints, which adds too little.
    pub next: Option<Step>,
    /// Fraction that all joints together explain.
    pub all: Option<f64>,
    /// A joint is chosen as long as it adds this fraction.
    pub min_gain: f64,
}

/// A chosen joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Step {
    /// Index of the joint.
    #[serde(skip)]
    pub joint_idx: usize,
    /// Its name.
    pub joint: String,
    /// Fraction of the variance of held-out changes that this joint and those before it explain.
    pub explained: f64,
    /// The fraction that it adds.
    pub gain: f64,
}

/// Angles and readings at one moment in the air.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    /// `[J]`, rad.
    pub(super) angles: Vec<f64>,
    /// `[T]`
    pub(super) readings: Vec<f64>,
    run: usize,
    fold: usize,
}

/// Means over short pieces of the time in the air.
pub(super) fn samples(session: &Prepared<'_>) -> Vec<Sample> {
    let n_each = session.n_in(SAMPLE_S);
    let stretch_s = STRETCH_S.min(session.in_air_s() / (3 * N_FOLDS) as f64);
    let mut samples = Vec::new();
    for (run_idx, run) in session.in_air.iter().enumerate() {
        for start in run.clone().step_by(n_each).filter(|start| start + n_each <= run.end) {
            let frames = start..start + n_each;
            let mean = |value: &dyn Fn(usize) -> f64| frames.clone().map(value).sum::<f64>() / n_each as f64;
            let at_s = samples.len() as f64 * n_each as f64 * session.period_s;
            samples.push(Sample {
                angles: (0..session.n_joints).map(|joint| mean(&|idx| session.angle(idx, joint))).collect(),
                readings: (0..session.n_taxels).map(|taxel| mean(&|idx| session.reading(idx, taxel))).collect(),
                run: run_idx,
                fold: (at_s / stretch_s) as usize % N_FOLDS,
            });
        }
    }
    samples
}

/// Pairs of samples in one run in the air, one span apart.
pub(super) fn changes(samples: &[Sample]) -> impl Iterator<Item = (&Sample, &Sample)> {
    samples.iter().zip(samples.iter().skip(SPAN)).filter(|(from, to)| from.run == to.run)
}

/// Mean of each column of some rows; empty without rows.
pub(super) fn means<'r>(rows: impl Iterator<Item = &'r [f64]>) -> Vec<f64> {
    let (mut sums, mut n) = (Vec::new(), 0.0);
    for row in rows {
        sums.resize(row.len(), 0.0);
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
        n += 1.0;
    }
    sums.iter().map(|sum| sum / n).collect()
}

/// Angles and their squares, relative to the session's mean.
pub(super) fn features(angles: &[f64], centre: &[f64]) -> Vec<f64> {
    let around: Vec<f64> = angles.iter().zip(centre).map(|(angle, mean)| angle - mean).collect();
    around.iter().copied().chain(around.iter().map(|angle| angle * angle)).collect()
}

/// Products of changes within one session, for the fitted rows and the held-out rows of each fold.
fn of_changes(samples: &[Sample], n_joints: usize, n_taxels: usize) -> [[Gram; 2]; N_FOLDS] {
    let mut folds = [(); N_FOLDS].map(|()| Gram::new(2 * n_joints, n_taxels));
    let centre = means(samples.iter().map(|sample| sample.angles.as_slice()));
    let growth = |from: &[f64], to: &[f64]| -> Vec<f64> { to.iter().zip(from).map(|(to, from)| to - from).collect() };
    for (from, to) in changes(samples).filter(|(from, to)| from.fold == to.fold) {
        let row = growth(&features(&from.angles, &centre), &features(&to.angles, &centre));
        folds[to.fold].handle(&row, &growth(&from.readings, &to.readings));
    }
    std::array::from_fn(|held_out| {
        let mut fitted = Gram::new(2 * n_joints, n_taxels);
        folds.iter().enumerate().filter(|(fold, _)| *fold != held_out).for_each(|(_, fold)| fitted.add(fold));
        [fitted, folds[held_out].clone()]
    })
}

impl Selection {
    /// Chooses among these joints as long as one adds `min_gain`.
    pub(super) fn of(sessions: &[Vec<Sample>], joints: &[String], n_taxels: usize, min_gain: f64) -> Self {
        let n = joints.len();
        let folds: Vec<[Gram; 2]> = sessions.iter().flat_map(|samples| of_changes(samples, n, n_taxels)).collect();
        let explained = |joints: &[usize]| {
            let squares: Vec<usize> = joints.iter().map(|joint| joint + n).collect();
            let features = [joints, &squares].concat();
            let of_fold = |[fitted, held_out]: &[Gram; 2]| held_out.squares(&fitted.fit(&features));
            let [total, left] = folds
                .iter()
                .filter(|[fitted, _]| !fitted.is_empty())
                .map(of_fold)
                .fold([0.0; 2], |sums, of_fold| [sums[0] + of_fold[0], sums[1] + of_fold[1]]);
            (total > 0.0).then(|| 1.0 - left / total)
        };
        let (mut chosen, mut next): (Vec<Step>, Option<Step>) = (Vec::new(), None);
        while chosen.len() < n.min(MAX_JOINTS) {
            let before: Vec<usize> = chosen.iter().map(|step| step.joint_idx).collect();
            let so_far = chosen.last().map_or(0.0, |step| step.explained);
            let others = (0..n).filter(|joint| !before.contains(joint));
            let judged = others.filter_map(|joint| Some((joint, explained(&[&before[..], &[joint]].concat())?)));
            let Some((joint_idx, with)) = judged.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            let step = Step { joint_idx, joint: joints[joint_idx].clone(), explained: with, gain: with - so_far };
            if step.gain < min_gain {
                next = Some(step);
                break;
            }
            chosen.push(step);
        }
        Selection {
            alone: (0..n).map(|joint| explained(&[joint])).collect(),
            chosen,
            next,
            all: explained(&(0..n).collect::<Vec<_>>()),
            min_gain,
        }
    }

    /// Indices of the chosen joints, in order.
    pub fn chosen_idxs(&self) -> Vec<usize> {
        self.chosen.iter().map(|step| step.joint_idx).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::frames::SessionFrames;
    use super::*;

    #[test]
    fn a_joint_that_only_moves_along_is_not_chosen() {
        let n = 6000;
        let time_s: Vec<f64> = (0..n).map(|k| f64::from(k) * 0.01).collect();
        // The second joint follows the first one; the third one moves by itself.
        let pose: Vec<f32> = time_s
            .iter()
            .flat_map(|t| {
                let (first, third) = ((1.3 * t).sin(), (0.37 * t).cos());
                [first, 0.9 * first + 0.05 * (5.0 * t).sin(), third].map(|angle| angle as f32)
            })
            .collect();
        let tactile: Vec<f32> =
            pose.chunks_exact(3).map(|pose| 5.0 * pose[0] + 2.0 * pose[0] * pose[0] + 2.0 * pose[2]).collect();
        let (stretch, in_air) = (vec![0; n as usize], vec![true; n as usize]);
        let frames = SessionFrames { time_s, stretch, tactile, pose, in_air, ..SessionFrames::default() };
        let session = Prepared::new(&frames, 1, 3);
        let joints = ["dip", "pip", "mcp"].map(str::to_owned);
        let found = Selection::of(&[samples(&session)], &joints, 1, 0.01);
        assert_eq!(found.chosen_idxs(), [0, 2], "{found:#?}");
        assert!(found.alone[1].unwrap() > 0.5, "it does move along: {found:#?}");
        assert!(found.chosen[1].explained > 0.999 && found.next.unwrap().gain < 1e-3);
    }

    #[test]
    fn without_time_in_the_air_nothing_is_chosen() {
        let found = Selection::of(&[Vec::new()], &["dip".to_owned()], 1, 0.01);
        assert_eq!((found.chosen.len(), found.alone[0], found.all), (0, None, None));
    }
}
