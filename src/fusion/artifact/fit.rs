//! Gains and offsets of a donning, from the frames of its calibration.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::history::JointHistory;
use super::{ArtifactError, ArtifactModel};

/// Frames whose residuals are so alike that they count as one: what shapes don't explain changes as slowly as the pose does.
pub(super) const ALIKE_FRAMES: f64 = 30.0;

/// Standard deviation of an offset before anything is known of it, in deviations of the residual.
const OFFSET_DEVIATIONS: f64 = 1e3;

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
        ] {
            if values.len() != expected {
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
        Ok(())
    }
}

/// Collects frames at zero load in bounded memory.
#[derive(Debug, Clone)]
pub struct ArtifactFitter {
    model: Arc<ArtifactModel>,
    history: JointHistory,
    shapes: Vec<f64>,
    /// A taxel each: sums of products of `[shapes, 1]`, and of those with its readings.
    squares: Vec<DMatrix<f64>>,
    products: Vec<DVector<f64>>,
    n_frames: u64,
}

impl ArtifactFitter {
    /// An empty collection.
    pub fn new(model: Arc<ArtifactModel>, rate_hz: f64) -> Self {
        let (n, width) = (model.n_taxels, model.n_joints + 1);
        ArtifactFitter {
            history: JointHistory::new(model.n_joints, rate_hz),
            shapes: vec![0.0; model.n_gains()],
            squares: vec![DMatrix::zeros(width, width); n],
            products: vec![DVector::zeros(width); n],
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
        let takes = JointHistory::takes(pose);
        if takes {
            self.history.advance(pose, n_frames);
        }
        if !takes || !is_at_zero_load {
            return;
        }
        self.model.write_shapes(self.history.basis(), self.model.n_joints, &mut self.shapes);
        self.n_frames += 1;
        let joints = self.model.n_joints;
        for (taxel, value) in tactile.iter().enumerate() {
            let shapes = &self.shapes[taxel * joints..(taxel + 1) * joints];
            let at = |idx: usize| shapes.get(idx).copied().unwrap_or(1.0);
            for column in 0..=joints {
                for row in 0..=joints {
                    self.squares[taxel][(row, column)] += at(row) * at(column);
                }
                self.products[taxel][column] += at(column) * f64::from(*value);
            }
        }
    }

    /// Frames at zero load so far.
    pub fn n_frames(&self) -> u64 {
        self.n_frames
    }

    /// The most likely gains and offsets. Gains start from `before`, where the donning was fitted before, else from those of
    /// the training donnings.
    ///
    /// # Errors
    /// [`ArtifactError`] when frames hold numbers too large to work with.
    pub fn finish(&self, before: Option<&ArtifactFit>) -> Result<ArtifactFit, ArtifactError> {
        let model = &self.model;
        let joints = model.n_joints;
        let mut fit = ArtifactFit { gains: Vec::new(), offset: Vec::new(), covariance: Vec::new() };
        for taxel in 0..model.n_taxels {
            let gains = taxel * joints..(taxel + 1) * joints;
            let mean = DVector::from_fn(joints + 1, |row, _| match before {
                _ if row == joints => 0.0,
                Some(before) => before.gains[gains.start + row],
                None => 1.0,
            });
            let mut known = DMatrix::zeros(joints + 1, joints + 1);
            match before {
                Some(before) => {
                    let of_taxel = &before.covariance[gains.start * joints..gains.end * joints];
                    known.view_mut((0, 0), (joints, joints)).copy_from_slice(of_taxel);
                }
                None => (0..joints).for_each(|row| known[(row, row)] = model.gain_variance[gains.start + row]),
            }
            known[(joints, joints)] = model.residual[taxel] * OFFSET_DEVIATIONS.powi(2);
            let weight = 1.0 / (model.residual[taxel] * ALIKE_FRAMES);
            let failed = || ArtifactError(format!("taxel {taxel}: readings that no artifact can be fitted to"));
            let known = known.cholesky().ok_or_else(failed)?.inverse();
            let right = &known * mean + &self.products[taxel] * weight;
            let left = (known + &self.squares[taxel] * weight).cholesky().ok_or_else(failed)?;
            let (found, covariance) = (left.solve(&right), left.inverse());
            if found.iter().chain(&covariance).any(|value| !value.is_finite()) {
                return Err(failed());
            }
            fit.gains.extend(found.iter().take(joints));
            fit.offset.push(found[joints]);
            fit.covariance.extend(covariance.view((0, 0), (joints, joints)).iter());
        }
        Ok(fit)
    }
}
