//! The paper's losses (Sec. V, Training Objective).

use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use super::dataset::{Batch, TOUCH_GF};
use super::error::TrainError;
use super::network::{Output, values};

/// Weights of the terms of the loss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LossConfig {
    /// Weight of the base force term; the paper's is 1, and 0 disables it.
    pub base_weight: f32,
    /// The paper's lambda, weight of the zero-load tactile term; it depends on the glove, and 0 disables it.
    pub lambda: f32,
    /// Weight of the cross-entropy of touch; 0 disables it. Only the causal network has an output for touch.
    pub touch_weight: f32,
    /// Weight of the tangential terms beside those of the normal force, of the final force and of the base alike; 0 disables
    /// them. Only a force of three axes has them.
    pub tangential_weight: f32,
    /// Added to the true force in the denominator of the relative losses, gF. The paper's is 1, without a unit; read as
    /// 1 N it is 102 gF, read as 1 gF the network avoids reporting light touches (docs/validation).
    pub offset_gf: f32,
}

impl Default for LossConfig {
    fn default() -> Self {
        // The paper selects lambda by a sweep; with taxels scaled to about 1, both kinds of term start at about 1.
        LossConfig { base_weight: 1.0, lambda: 1.0, touch_weight: 0.3, tangential_weight: 1.0, offset_gf: 102.0 }
    }
}

impl LossConfig {
    /// Refuses weights out of range.
    ///
    /// # Errors
    /// [`TrainError::Setting`].
    pub fn check(&self) -> Result<(), TrainError> {
        if !(self.offset_gf.is_finite() && self.offset_gf > 0.0) {
            let got = self.offset_gf.to_string();
            return Err(TrainError::Setting { key: "offset_gf", got, expected: "a positive number" });
        }
        for (key, weight) in [
            ("base_weight", self.base_weight),
            ("lambda", self.lambda),
            ("touch_weight", self.touch_weight),
            ("tangential_weight", self.tangential_weight),
        ] {
            if !weight.is_finite() || weight < 0.0 {
                return Err(TrainError::Setting { key, got: weight.to_string(), expected: "0 or a positive number" });
            }
        }
        Ok(())
    }
}

/// The terms of a loss, before their weights.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct LossTerms {
    /// Modified MAPE of the final force.
    pub force: f32,
    /// Modified MAPE of the base force; 0 if the network has none or the term is disabled.
    pub base: f32,
    /// MAE of the decoded zero-load change, in units of the tactile scale; 0 if the term is disabled.
    pub artifact: f32,
    /// Cross-entropy of touch; 0 if the network has no such output.
    #[serde(default)]
    pub touch: f32,
    /// Relative error of the tangential force; 0 for a force of one axis.
    #[serde(default)]
    pub tangential: f32,
    /// Their weighted sum.
    pub total: f32,
}

impl LossTerms {
    /// Adds the loss of another part of the same batch.
    pub(super) fn add(&mut self, part: LossTerms) {
        self.force += part.force;
        self.base += part.base;
        self.artifact += part.artifact;
        self.touch += part.touch;
        self.tangential += part.tangential;
        self.total += part.total;
    }
}

/// Normalization of the terms for a whole batch, over all of its parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measure {
    /// Number of true forces in the batch: one per window, or more if a window gives several forces.
    pub(super) truths: usize,
    /// Number of them that are free of load.
    pub(super) zero_load: usize,
    /// The network's scale of taxels, in which the auxiliary decoder works.
    pub(super) tactile_scale: f32,
}

/// The contribution of a part of a batch to its loss; contributions of all parts add up to it, and so do the gradients.
pub(super) fn share(
    cfg: &LossConfig,
    output: Output,
    part: &Batch,
    measure: Measure,
    device: &Device,
) -> (Tensor<1>, LossTerms) {
    let column = |values: Vec<f32>| {
        let n = values.len();
        Tensor::<2>::from_data(TensorData::new(values, [n, 1]), device)
    };
    let truth = column(part.truth_gf.clone());
    let sides = (!part.tangential_gf.is_empty() && cfg.tangential_weight > 0.0).then(|| {
        let values = part.tangential_gf.clone();
        let n = values.len() / 2;
        Tensor::<2>::from_data(TensorData::new(values, [n, 2]), device)
    });
    let (force, sideways) = along_and_across(output.force);
    let force = relative_error(force, truth.clone(), cfg.offset_gf).sum() / measure.truths as f32;
    let mut terms = LossTerms { force: scalar(&force), ..LossTerms::default() };
    let mut total = force;
    if let Some((sideways, sides)) = sideways.zip(sides.clone()) {
        let tangential = tangential_error(sideways, sides, cfg.offset_gf).sum() / measure.truths as f32;
        terms.tangential = scalar(&tangential);
        total = total + tangential * cfg.tangential_weight;
    }
    if let Some(base) = output.base.filter(|_| cfg.base_weight > 0.0) {
        let (base, sideways) = along_and_across(base);
        let base = relative_error(base, truth, cfg.offset_gf).sum() / measure.truths as f32;
        terms.base = scalar(&base);
        total = total + base * cfg.base_weight;
        if let Some((sideways, sides)) = sideways.zip(sides) {
            let tangential = tangential_error(sideways, sides, cfg.offset_gf).sum() / measure.truths as f32;
            total = total + tangential * (cfg.base_weight * cfg.tangential_weight);
        }
    }
    if let Some(artifact) = output.artifact.filter(|_| cfg.lambda > 0.0 && part.zero_load.contains(&true)) {
        let [frames, n, n_taxels] = artifact.dims();
        let target = Tensor::<3>::from_data(TensorData::new(part.artifact.clone(), [frames, n, n_taxels]), device);
        let target = target / measure.tactile_scale;
        let mask: Vec<f32> = part.zero_load.iter().map(|zero_load| f32::from(u8::from(*zero_load))).collect();
        let mask = Tensor::<3>::from_data(TensorData::new(mask, [1, n, 1]), device);
        let n_values = (measure.zero_load * frames * n_taxels) as f32;
        let artifact = ((artifact - target).abs() * mask).sum() / n_values;
        terms.artifact = scalar(&artifact);
        total = total + artifact * cfg.lambda;
    }
    if let Some(odds) = output.touch.filter(|_| cfg.touch_weight > 0.0) {
        let target = column(part.truth_gf.iter().map(|truth| f32::from(u8::from(*truth >= TOUCH_GF))).collect());
        let weight = column(part.truth_gf.iter().map(|truth| touch_weight(*truth)).collect());
        // -log p of the true class, in a form that does not overflow for large numbers.
        let entropy = relu(odds.clone()) - odds.clone() * target + (odds.abs().neg().exp() + 1.0).log();
        let touch = (entropy * weight).sum() / measure.truths as f32;
        terms.touch = scalar(&touch);
        total = total + touch * cfg.touch_weight;
    }
    terms.total = scalar(&total);
    (total, terms)
}

/// Weight of a frame in the cross-entropy of touch: light touches matter most, and a truth between no touch and touch
/// belongs to neither class.
fn touch_weight(truth_gf: f32) -> f32 {
    match truth_gf {
        faint if (0.2 * TOUCH_GF..TOUCH_GF).contains(&faint) => 0.0,
        light if (TOUCH_GF..8.0 * TOUCH_GF).contains(&light) => 3.0,
        _ => 1.0,
    }
}

/// |F^ - F| / (offset + F) of each window. A truth below zero is a residue of taring, so it counts as no load.
fn relative_error(force: Tensor<2>, truth: Tensor<2>, offset_gf: f32) -> Tensor<2> {
    (force - truth.clone()).abs() / (truth.clamp_min(0.0) + offset_gf)
}

/// The normal force of each window, and where there are three axes its two tangential components.
fn along_and_across(force: Tensor<2>) -> (Tensor<2>, Option<Tensor<2>>) {
    let [n, axes] = force.dims();
    match axes {
        3 => (force.clone().slice([0..n, 0..1]), Some(force.slice([0..n, 1..3]))),
        _ => (force, None),
    }
}

/// Keeps the length of an error from having no gradient where it is zero, gF^2.
const LENGTH_EPSILON: f32 = 1e-4;

/// |T^ - T| / (offset + |T|) of each window, where T has two components: it doesn't depend on which tangents they are along.
fn tangential_error(force: Tensor<2>, truth: Tensor<2>, offset_gf: f32) -> Tensor<2> {
    let length = |vector: Tensor<2>| (vector.square().sum_dim(1) + LENGTH_EPSILON).sqrt();
    length(force - truth.clone()) / (length(truth) + offset_gf)
}

fn scalar(tensor: &Tensor<1>) -> f32 {
    values(tensor.clone().detach()).first().copied().unwrap_or(f32::NAN)
}
