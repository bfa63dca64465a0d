//! Divides an artifact into parts: the part common to all donnings, the part specific to one donning, and the part that
//! would remain if the artifact were followed while the glove is worn. This needs no trained model.

use std::sync::Arc;

use serde::Serialize;

use super::frames::Prepared;
use crate::fusion::{
    ArtifactError, ArtifactFilter, ArtifactFit, ArtifactFitter, ArtifactModel, DonningFrames, Following, learn_artifact,
};

/// Time in the air used for a calibration, s.
const CALIBRATION_S: f64 = 10.0;

/// Maximum number of joints that are followed; each costs a gain for every taxel.
const MOST_JOINTS: usize = 6;

/// Remaining artifact of each donning, with shapes that were fitted to the others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FollowingReport {
    /// Joints that the shapes depend on.
    pub joints: Vec<String>,
    /// Over all donnings; absent if it can't be computed.
    pub all: Option<LeftInAir>,
    /// Each donning.
    pub by_session: Vec<(String, LeftInAir)>,
    /// The reason why it can't be computed.
    pub missing: Option<String>,
}

/// Root mean square of the taxels in the air, after a calibration of 10 s, units of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LeftInAir {
    /// Readings above the zero, uncorrected.
    pub as_read: f64,
    /// After subtracting a fixed map from pose, the same for every donning.
    pub fixed_map: f64,
    /// The same, with the donning's mean also subtracted: an offset.
    pub with_offset: f64,
    /// After subtracting a map whose gains and offsets are fitted to all frames of the donning.
    pub with_gains: f64,
    /// After subtracting a map whose gains and offsets come from a calibration of 10 s, kept for the rest of the
    /// session.
    pub calibrated: f64,
    /// The same, but the gains are followed while the glove is worn, as in an adaptive model.
    pub followed: f64,
}

impl LeftInAir {
    /// The fraction of the uncorrected variance that is removed if `left` remains.
    pub fn explained(&self, left: f64) -> f64 {
        1.0 - (left / self.as_read).powi(2)
    }

    fn over(donnings: &[(String, LeftInAir)]) -> Self {
        let n = donnings.len() as f64;
        let mean =
            |of: fn(&LeftInAir) -> f64| (donnings.iter().map(|(_, left)| of(left).powi(2)).sum::<f64>() / n).sqrt();
        LeftInAir {
            as_read: mean(|left| left.as_read),
            fixed_map: mean(|left| left.fixed_map),
            with_offset: mean(|left| left.with_offset),
            with_gains: mean(|left| left.with_gains),
            calibrated: mean(|left| left.calibrated),
            followed: mean(|left| left.followed),
        }
    }
}

/// A session with the followed joints.
struct Donning<'a> {
    session: &'a Prepared<'a>,
    pose: Vec<f32>,
    truth_gf: Vec<f32>,
    learned: Vec<bool>,
    in_air: Vec<bool>,
}

impl<'a> Donning<'a> {
    fn new(session: &'a Prepared<'a>, joints: &[usize]) -> Self {
        let n = session.sum.len();
        let pose = (0..n).flat_map(|idx| joints.iter().map(move |joint| session.angle(idx, *joint) as f32)).collect();
        let mut in_air = vec![false; n];
        session.in_air.iter().cloned().flatten().for_each(|idx| in_air[idx] = true);
        // In the air the force is zero, whatever an unloaded load cell reads. Elsewhere an unknown force counts as a
        // force.
        let truth = |idx: usize| if in_air[idx] { 0.0 } else { session.truth_gf(idx).unwrap_or(f64::NAN) as f32 };
        Donning { session, pose, truth_gf: (0..n).map(truth).collect(), learned: vec![true; n], in_air }
    }

    fn frames(&self) -> DonningFrames<'_> {
        DonningFrames {
            tactile: &self.session.frames.tactile,
            pose: &self.pose,
            truth_gf: &self.truth_gf,
            epoch: &self.session.frames.stretch,
            learned: &self.learned,
        }
    }

    /// Calls `take` for every frame: its index, taxels and joints, its distance from the previous frame in frames, and
    /// true if it is in the air.
    fn each(&self, mut take: impl FnMut(usize, &[f32], &[f32], i32, bool)) {
        let (n_taxels, stretch) = (self.session.n_taxels, &self.session.frames.stretch);
        let n_joints = self.pose.len() / self.in_air.len().max(1);
        for idx in 0..self.in_air.len() {
            let tactile = &self.session.frames.tactile[idx * n_taxels..(idx + 1) * n_taxels];
            let pose = &self.pose[idx * n_joints..(idx + 1) * n_joints];
            let follows = idx > 0 && stretch[idx] == stretch[idx - 1];
            take(idx, tactile, pose, i32::from(follows), self.in_air[idx]);
        }
    }

    /// Gains and offsets from the first `most` frames in the air, and the frame after which they are known.
    fn fit(&self, model: &Arc<ArtifactModel>, most: u64) -> Result<(ArtifactFit, usize), ArtifactError> {
        let mut fitter = ArtifactFitter::new(Arc::clone(model), 1.0 / self.session.period_s, None);
        let mut last = 0;
        self.each(|idx, tactile, pose, n_frames, is_air| {
            if fitter.n_frames() < most {
                fitter.handle_frame(tactile, pose, n_frames, is_air);
                last = idx;
            }
        });
        Ok((fitter.finish()?, last))
    }

    /// Sums over the frames in the air after `from`: of the taxels and of their squares, `[taxels]`, and number of
    /// frames.
    fn left(&self, mut filter: ArtifactFilter, from: usize) -> (Vec<f64>, Vec<f64>, usize) {
        let n_taxels = self.session.n_taxels;
        let (mut sums, mut squares, mut n) = (vec![0.0; n_taxels], vec![0.0; n_taxels], 0);
        let mut tactile = vec![0.0; n_taxels];
        self.each(|idx, frame, pose, n_frames, is_air| {
            if n_frames == 0 {
                filter.restart();
            }
            tactile.copy_from_slice(frame);
            filter.correct(&mut tactile, Some(pose), n_frames.max(1), true);
            if is_air && idx > from {
                n += 1;
                for (value, (sum, square)) in tactile.iter().zip(sums.iter_mut().zip(&mut squares)) {
                    (*sum, *square) = (*sum + f64::from(*value), *square + f64::from(*value).powi(2));
                }
            }
        });
        (sums, squares, n)
    }
}

impl FollowingReport {
    /// `chosen`: the joints that explain the artifact, those that explain most first.
    pub(super) fn of<'a>(
        sessions: impl Iterator<Item = &'a Prepared<'a>>,
        joints: &[String],
        n_taxels: usize,
        chosen: &[usize],
    ) -> Self {
        let chosen = &chosen[..chosen.len().min(MOST_JOINTS)];
        let donnings: Vec<Donning<'_>> = sessions.map(|session| Donning::new(session, chosen)).collect();
        let mut report = FollowingReport {
            joints: chosen.iter().map(|joint| joints[*joint].clone()).collect(),
            all: None,
            by_session: Vec::new(),
            missing: None,
        };
        if chosen.is_empty() || donnings.len() < 2 {
            let lack = if chosen.is_empty() { "a joint that tells the artifact" } else { "a second donning" };
            report.missing = Some(format!("what following the artifact would leave can't be told without {lack}"));
            return report;
        }
        for left_out in 0..donnings.len() {
            match judge(&donnings, left_out, (n_taxels, chosen.len())) {
                Ok(Some(left)) => report.by_session.push((donnings[left_out].session.frames.name.clone(), left)),
                Ok(None) => {} // too short for a result after its calibration
                Err(error) => {
                    report.missing = Some(format!("what following the artifact would leave can't be told: {error}"));
                    return report;
                }
            }
        }
        match report.by_session.is_empty() {
            true => report.missing = Some("no session has 10 s in the air, and some after them".to_owned()),
            false => report.all = Some(LeftInAir::over(&report.by_session)),
        }
        report
    }
}

/// Remaining artifact of a donning with shapes of the others; `None` if too little time is left after its calibration.
fn judge(donnings: &[Donning<'_>], left_out: usize, sizes: (usize, usize)) -> Result<Option<LeftInAir>, ArtifactError> {
    let donning = &donnings[left_out];
    let rate_hz = 1.0 / donning.session.period_s;
    let others = donnings.iter().enumerate().filter(|(idx, _)| *idx != left_out);
    let others: Vec<DonningFrames<'_>> = others.map(|(_, other)| other.frames()).collect();
    let model = Arc::new(learn_artifact(&others, sizes, rate_hz)?);
    let wanted = (CALIBRATION_S * rate_hz) as u64;
    let (calibration, from) = donning.fit(&model, wanted)?;
    let (whole, _) = donning.fit(&model, u64::MAX)?;
    let run = |following: Following, fit: Option<&ArtifactFit>| {
        let mut filter = ArtifactFilter::new(Arc::clone(&model), rate_hz, following);
        fit.map_or(Ok(()), |fit| filter.handle_fit(fit.clone()))?;
        Ok(donning.left(filter, from))
    };
    let rms = |(_, squares, n): &(Vec<f64>, Vec<f64>, usize)| {
        (squares.iter().sum::<f64>() / (*n * squares.len()).max(1) as f64).sqrt()
    };
    let as_read = run(Following::Off, None)?;
    if (as_read.2 as u64) < wanted {
        return Ok(None);
    }
    let fixed = run(Following::Frozen, None)?;
    let about_mean = |(sums, squares, n): &(Vec<f64>, Vec<f64>, usize)| {
        let each = sums.iter().zip(squares).map(|(sum, square)| square / *n as f64 - (sum / *n as f64).powi(2));
        (each.sum::<f64>() / sums.len() as f64).max(0.0).sqrt()
    };
    Ok(Some(LeftInAir {
        as_read: rms(&as_read),
        fixed_map: rms(&fixed),
        with_offset: about_mean(&fixed),
        with_gains: rms(&run(Following::Frozen, Some(&whole))?),
        calibrated: rms(&run(Following::Frozen, Some(&calibration))?),
        followed: rms(&run(Following::On, Some(&calibration))?),
    }))
}
