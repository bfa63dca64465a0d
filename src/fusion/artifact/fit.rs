//! Gains and offsets of a donning, from the frames of its calibration.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::history::JointHistory;
use super::{ALIKE_BLOCKS, ArtifactError, ArtifactModel, block_frames};

/// Frames whose residuals are so alike that they count as one, where gains are taken for constant: what shapes don't explain changes as slowly as
/// the pose does.
pub(super) const ALIKE_FRAMES: f64 = 30.0;

/// Variance of an offset before anything is known of it, in that of the residual.
const OFFSET_VARIANCE: f64 = 1e6;

/// The artifact of a donning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArtifactFit {
    /// `[taxels, joints]`
    pub gains: Vec<f64>,
    /// `[taxels]`, taxel units above the baseline.
    pub offset: Vec<f64>,
    /// `[taxels, joints, joints]`: covariance of the gains of each taxel.
    pub covariance: Vec<f64>,
    /// `[taxels, joints + 1]`: covariance of the offset of each taxel with its gains, and the variance of the offset. None for a
    /// model without [`uncertain_offsets`](ArtifactModel::uncertain_offsets), or in a file of before: then offsets are taken for exact.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub offset_covariance: Vec<f64>,
}

impl ArtifactFit {
    /// Checks that it belongs to a model.
    ///
    /// # Errors
    /// [`ArtifactError`], whose text says what was expected.
    pub fn check(&self, model: &ArtifactModel) -> Result<(), ArtifactError> {
        for (name, values, expected) in [
            ("gains", &self.gains, model.n_gains()),
            ("offset", &self.offset, model.n_taxels),
            ("covariance", &self.covariance, model.n_gains() * model.n_joints),
            ("offset_covariance", &self.offset_covariance, model.n_taxels * (model.n_joints + 1)),
        ] {
            let is_optional = name == "offset_covariance";
            if values.len() != expected && !(is_optional && values.is_empty()) {
                return Err(ArtifactError(format!("{} numbers in {name}, expected {expected}", values.len())));
            }
            if values.iter().any(|value| !value.is_finite() || value.abs() > 1e12) {
                return Err(ArtifactError(format!("a number in {name} that is not finite, or beyond 1e12")));
            }
        }
        let joints = model.n_joints;
        let variances = (0..model.n_gains()).map(|gain| self.covariance[gain * joints + gain % joints]);
        if variances.into_iter().any(|variance| variance <= 0.0) {
            return Err(ArtifactError("a variance in covariance that is not positive".to_owned()));
        }
        if self.offset_covariance.chunks_exact(joints + 1).any(|of_taxel| of_taxel[joints] < 0.0) {
            return Err(ArtifactError("a variance in offset_covariance that is negative".to_owned()));
        }
        Ok(())
    }
}

/// Learns the gains and offsets of a donning from frames at zero load, each taxel by itself, by a Kalman filter. For a model with
/// [`uncertain_offsets`](ArtifactModel::uncertain_offsets) gains slip meanwhile; for any other one they are constant.
#[derive(Debug, Clone)]
pub struct ArtifactFitter {
    model: Arc<ArtifactModel>,
    history: JointHistory,
    frame_s: f64,
    /// `[taxels, joints]` of the frame.
    shapes: Vec<f64>,
    /// The frames of the measurement that is being collected, and sums over them: `[taxels, joints]`, `[taxels]`, and the variance of what noise of
    /// the joint angles puts into each taxel.
    block_frames: usize,
    n_block: usize,
    block_shapes: Vec<f64>,
    block_tactile: Vec<f64>,
    block_angles: Vec<f64>,
    taxels: Vec<Taxel>,
    /// Frames since the last measurement.
    n_since: u32,
    n_frames: u64,
}

/// What is known of a taxel: its gains and its offset, and their covariance.
#[derive(Debug, Clone)]
struct Taxel {
    state: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Variance by which each gain slips in a second.
    slip: Vec<f64>,
}

impl ArtifactFitter {
    /// Nothing collected. Gains start from `before`, where the donning was fitted before, else from those of the training donnings.
    pub fn new(model: Arc<ArtifactModel>, rate_hz: f64, before: Option<&ArtifactFit>) -> Self {
        let (n, joints) = (model.n_taxels, model.n_joints);
        let of_taxel = |taxel: usize| {
            let gains = taxel * joints..(taxel + 1) * joints;
            let mut state = DVector::zeros(joints + 1);
            let mut covariance = DMatrix::zeros(joints + 1, joints + 1);
            match before {
                Some(before) => {
                    state.rows_mut(0, joints).copy_from_slice(&before.gains[gains.clone()]);
                    let of_taxel = &before.covariance[gains.start * joints..gains.end * joints];
                    covariance.view_mut((0, 0), (joints, joints)).copy_from_slice(of_taxel);
                }
                None => {
                    state.rows_mut(0, joints).fill(1.0);
                    (0..joints).for_each(|row| covariance[(row, row)] = model.gain_variance[gains.start + row]);
                }
            }
            covariance[(joints, joints)] = model.residual[taxel] * OFFSET_VARIANCE;
            let slip_per_s = if model.uncertain_offsets { 2.0 * model.slip.powi(2) / model.slip_time_s } else { 0.0 };
            let slip = |gain: &f64| slip_per_s * gain.powi(2);
            Taxel { slip: state.iter().take(joints).map(slip).collect(), state, covariance }
        };
        ArtifactFitter {
            history: JointHistory::new(joints, rate_hz),
            frame_s: 1.0 / rate_hz,
            shapes: vec![0.0; model.n_gains()],
            block_frames: if model.uncertain_offsets { block_frames(rate_hz) } else { 1 },
            n_block: 0,
            block_shapes: vec![0.0; model.n_gains()],
            block_tactile: vec![0.0; n],
            block_angles: vec![0.0; n],
            taxels: (0..n).map(of_taxel).collect(),
            n_since: 0,
            n_frames: 0,
            model,
        }
    }

    /// Takes a frame, `n_frames` after the last one; 0 where frames before it were lost. Only those at zero load are fitted,
    /// the others belong to the past of the joints.
    ///
    /// # Shapes
    /// `tactile`: `[taxels]`, above the baseline; `pose`: `[joints]`, rad.
    pub fn handle_frame(&mut self, tactile: &[f32], pose: &[f32], n_frames: i32, is_at_zero_load: bool) {
        if n_frames == 0 {
            self.history.clear();
        }
        self.n_since = self.n_since.saturating_add(n_frames.max(1).unsigned_abs());
        let takes = JointHistory::takes(pose);
        if takes {
            self.history.advance(pose, n_frames);
        }
        if !takes || !is_at_zero_load || n_frames == 0 {
            self.end_block();
        }
        if !takes || !is_at_zero_load {
            return;
        }
        self.model.write_shapes(self.history.basis(), self.model.n_joints, &mut self.shapes);
        self.n_frames += 1;
        self.n_block += 1;
        self.block_shapes.iter_mut().zip(&self.shapes).for_each(|(sum, shape)| *sum += shape);
        self.block_tactile.iter_mut().zip(tactile).for_each(|(sum, value)| *sum += f64::from(*value));
        for taxel in 0..self.taxels.len() {
            self.block_angles[taxel] += self.angle_variance(taxel);
        }
        if self.n_block == self.block_frames {
            self.end_block();
        }
    }

    /// Variance of what noise of the joint angles puts into a taxel.
    fn angle_variance(&self, taxel: usize) -> f64 {
        let of_joint = |joint: usize| {
            let slope = self.model.slope(taxel, joint, self.history.slopes());
            (self.taxels[taxel].state[joint] * slope * self.history.noise(joint)).powi(2)
        };
        (0..self.model.n_joints).map(of_joint).sum()
    }

    /// Learns from the frames of a block.
    fn end_block(&mut self) {
        if self.n_block == 0 {
            return;
        }
        let n_block = self.n_block as f64;
        let elapsed_s = f64::from(std::mem::take(&mut self.n_since)) * self.frame_s;
        let joints = self.model.n_joints;
        let mut row = DVector::from_element(joints + 1, 1.0);
        for (taxel, known) in self.taxels.iter_mut().enumerate() {
            for (joint, slip) in known.slip.iter().enumerate() {
                row[joint] = self.block_shapes[taxel * joints + joint] / n_block;
                known.covariance[(joint, joint)] += slip * elapsed_s;
            }
            let seen = &known.covariance * &row;
            let unexplained = if self.model.uncertain_offsets {
                let of_angles = self.block_angles[taxel] / n_block;
                self.model.unexplained(taxel, self.n_block) + ALIKE_BLOCKS * self.model.n_taxels as f64 * of_angles
            } else {
                ALIKE_FRAMES * self.model.residual[taxel] / n_block
            };
            let variance = row.dot(&seen) + unexplained;
            let innovation = self.block_tactile[taxel] / n_block - row.dot(&known.state);
            known.state.axpy(innovation / variance, &seen, 1.0);
            known.covariance.ger(-1.0 / variance, &seen, &seen, 1.0);
        }
        self.n_block = 0;
        self.block_shapes.fill(0.0);
        self.block_tactile.fill(0.0);
        self.block_angles.fill(0.0);
    }

    /// Frames at zero load so far.
    pub fn n_frames(&self) -> u64 {
        self.n_frames
    }

    /// The most likely gains and offsets.
    ///
    /// # Errors
    /// [`ArtifactError`] when frames hold numbers too large to work with.
    pub fn finish(mut self) -> Result<ArtifactFit, ArtifactError> {
        self.end_block();
        let joints = self.model.n_joints;
        let mut fit = ArtifactFit {
            gains: Vec::new(),
            offset: Vec::new(),
            covariance: Vec::new(),
            offset_covariance: Vec::new(),
        };
        for (taxel, Taxel { state, covariance, .. }) in self.taxels.iter().enumerate() {
            let is_sound = (0..=joints).all(|row| covariance[(row, row)] > 0.0);
            if !is_sound || state.iter().chain(covariance).any(|value| !value.is_finite()) {
                return Err(ArtifactError(format!("taxel {taxel}: readings that no artifact can be fitted to")));
            }
            fit.gains.extend(state.iter().take(joints));
            fit.offset.push(state[joints]);
            fit.covariance.extend(covariance.view((0, 0), (joints, joints)).iter());
            if self.model.uncertain_offsets {
                fit.offset_covariance.extend(covariance.column(joints).iter());
            }
        }
        Ok(fit)
    }
}
