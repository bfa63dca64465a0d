//! The paper's network (Sec. V): its weights, and its forward pass from windows to forces.

use std::array::from_fn;
use std::ops::Range;

use burn::tensor::activation::{gelu, relu};
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use super::architecture::{Architecture, Kind, LSTM_HIDDEN, N_FEATURES, Parameter};
use super::error::TrainError;
use super::random::{Random, Stream};
use crate::fusion::{Forces, Windows};

mod causal;
mod conv;
mod flex;
pub(super) mod lstm;
mod lstm_op;
mod tactile;
mod tactile_op;

pub(super) use flex::values;
use tactile::TactileShape;

/// Keeps normalizations from dividing by zero; PyTorch's default for both kinds.
pub(super) const NORM_EPSILON: f32 = 1e-5;

/// Number of windows per run without gradients.
const PREDICT_BATCH: usize = 256;

/// Statistics that batch normalization uses outside of training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BatchNormStatistics {
    /// `[64]`
    #[serde(with = "super::exact_floats")]
    pub mean: Vec<f32>,
    /// `[64]`, unbiased.
    #[serde(with = "super::exact_floats")]
    pub variance: Vec<f32>,
}

/// The network and all its learned values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Network {
    /// Its shape.
    pub architecture: Architecture,
    /// All parameters, one after the other in the order of [`Architecture::parameters`].
    #[serde(with = "super::exact_floats")]
    pub values: Vec<f32>,
    /// Statistics of the batch normalization.
    pub statistics: BatchNormStatistics,
}

impl Network {
    /// An untrained network. Weights start with PyTorch's default initialization, from the seed alone.
    ///
    /// # Errors
    /// [`TrainError::Architecture`].
    pub fn new(architecture: Architecture, seed: u64) -> Result<Self, TrainError> {
        architecture.check()?;
        let parameters = architecture.parameters();
        let mut random = Random::new(seed, Stream::Weights);
        let mut values = Vec::with_capacity(parameters.last().map_or(0, |last| last.range().end));
        for parameter in &parameters {
            let bound = 1.0 / (parameter.fan_in(&parameters) as f32).sqrt();
            let constant = parameter.constant_start();
            values.extend((0..parameter.n_values()).map(|_| constant.unwrap_or_else(|| random.symmetric(bound))));
        }
        let statistics = BatchNormStatistics { mean: vec![0.0; N_FEATURES], variance: vec![1.0; N_FEATURES] };
        Ok(Network { architecture, values, statistics })
    }

    /// Checks that a network read from a file is complete.
    ///
    /// # Errors
    /// [`TrainError::Architecture`].
    pub(super) fn check(&self) -> Result<(), TrainError> {
        self.architecture.check()?;
        let refuse = |what: String| Err(TrainError::Architecture { what });
        let expected = self.architecture.parameters().last().map_or(0, |last| last.range().end);
        if self.values.len() != expected {
            return refuse(format!("{} weights, expected {expected}", self.values.len()));
        }
        let statistics = [&self.statistics.mean, &self.statistics.variance];
        if let Some(wrong) = statistics.iter().find(|values| values.len() != N_FEATURES) {
            return refuse(format!("{} statistics, expected {N_FEATURES}", wrong.len()));
        }
        if !statistics.into_iter().chain([&self.values]).flatten().all(|value| value.is_finite()) {
            return refuse("a weight is not finite".to_string());
        }
        Ok(())
    }

    /// The values of one parameter, `None` if the network has none of that name.
    pub fn parameter(&self, name: &str) -> Option<&[f32]> {
        let parameter = self.architecture.parameters().into_iter().find(|parameter| parameter.name == name)?;
        self.values.get(parameter.range())
    }

    /// Replaces the values of one parameter.
    ///
    /// # Errors
    /// [`TrainError::Architecture`] when there is no parameter of that name and length.
    pub fn set_parameter(&mut self, name: &str, new: &[f32]) -> Result<(), TrainError> {
        let parameters = self.architecture.parameters();
        let found = parameters.iter().find(|parameter| parameter.name == name && parameter.n_values() == new.len());
        let found = found.ok_or_else(|| TrainError::Architecture {
            what: format!("the network has no parameter {name} of {} values", new.len()),
        })?;
        self.values[found.range()].copy_from_slice(new);
        Ok(())
    }

    /// Forces of windows, in gF, in inference mode: batch normalization uses its running statistics. Those of three axes are
    /// x, y, z in the frame of the patch, as those of the exported model.
    ///
    /// # Errors
    /// [`TrainError::Architecture`] when the windows don't have the network's shape.
    pub fn predict(&self, windows: Windows<'_>) -> Result<Forces, TrainError> {
        let mut forces = self.predict_in_contact(windows)?;
        if let Some(axes) = &self.architecture.axes {
            let turn = |values: &mut Vec<f32>| {
                for force in values.as_chunks_mut::<3>().0 {
                    let [normal, first, second] = force.map(f64::from);
                    let across = axes.across([first, second]);
                    *force = std::array::from_fn(|axis| (axes.in_patch[0][axis] * normal + across[axis]) as f32);
                }
            };
            turn(&mut forces.force);
            turn(&mut forces.base);
        }
        Ok(forces)
    }

    /// The same in the axes of the contact: the normal force of each window, and of three axes its two tangential components.
    ///
    /// # Errors
    /// As [`Network::predict`].
    pub fn predict_in_contact(&self, windows: Windows<'_>) -> Result<Forces, TrainError> {
        let Architecture { window, n_taxels, n_joints, kind, .. } = self.architecture;
        let pose_len = if kind.uses_pose() { window * n_joints } else { 0 };
        let fits = |len: usize, of_one: usize| windows.n.checked_mul(of_one) == Some(len);
        if !fits(windows.tactile.len(), window * n_taxels) || (pose_len > 0 && !fits(windows.pose.len(), pose_len)) {
            return Err(TrainError::Architecture {
                what: format!(
                    "expected {} windows of {window} frames, {n_taxels} taxels, {n_joints} joints",
                    windows.n
                ),
            });
        }
        let weights = self.on(&Device::flex());
        let mut forces = Forces::default();
        for start in (0..windows.n).step_by(PREDICT_BATCH) {
            let range = start..(start + PREDICT_BATCH).min(windows.n);
            let part = |values: &[f32], len: usize| values[range.start * len..range.end * len].to_vec();
            let pose = if pose_len > 0 { part(windows.pose, pose_len) } else { Vec::new() };
            let input = weights.input(range.len(), part(windows.tactile, window * n_taxels), pose);
            let output = weights.forward(input, Normalize::ByStatistics(&self.statistics));
            forces.force.extend(values(output.force));
            forces.base.extend(output.base.map(values).unwrap_or_default());
            forces.touch.extend(output.touch.map(values).unwrap_or_default().into_iter().map(sigmoid));
        }
        Ok(forces)
    }

    /// Changes the touch output: the log odds become `gain` times the old ones plus `shift`.
    ///
    /// # Errors
    /// [`TrainError::Architecture`] for a network without such an output.
    pub(super) fn move_touch(&mut self, gain: f32, shift: f32) -> Result<(), TrainError> {
        for (name, shift) in [("touch.1.weight", 0.0), ("touch.1.bias", shift)] {
            let missing = || TrainError::Architecture { what: format!("the network has no parameter {name}") };
            let values = self.parameter(name).ok_or_else(missing)?;
            let moved: Vec<f32> = values.iter().map(|value| gain * value + shift).collect();
            self.set_parameter(name, &moved)?;
        }
        Ok(())
    }

    /// The weights as tensors of a device, with gradients if the device has autodiff.
    pub(super) fn on(&self, device: &Device) -> Weights<'_> {
        let parameters = self.architecture.parameters();
        let tensor = |parameter: &Parameter| {
            let data = TensorData::new(self.values[parameter.range()].to_vec(), [parameter.n_values()]);
            let tensor = Tensor::<1>::from_data(data, device);
            if tensor.is_autodiff() { tensor.require_grad() } else { tensor }
        };
        let tensors = parameters.iter().map(tensor).collect();
        Weights { architecture: &self.architecture, device: device.clone(), parameters, tensors }
    }
}

/// The probability from log odds.
fn sigmoid(odds: f32) -> f32 {
    1.0 / (1.0 + (-odds).exp())
}

/// Statistics that a pass uses for batch normalization.
#[derive(Debug, Clone, Copy)]
pub(super) enum Normalize<'a> {
    /// Those of the batch itself, as in training.
    ByBatch,
    /// The running statistics from training.
    ByStatistics(&'a BatchNormStatistics),
}

/// Windows, time-major.
pub(super) struct NetworkInput {
    n: usize,
    /// `[L, N, T]`, in units of the tactile scale.
    tactile: Vec<f32>,
    /// `[L, N, P]`, rad.
    pose: Option<Tensor<3>>,
}

/// Outputs of a pass.
pub(super) struct Output {
    /// `[N, 1]`, gF; of the causal network `[outputs * N, 1]`, time first. Of three axes `[N, 3]`: normal, and two tangents.
    pub(super) force: Tensor<2>,
    /// As the force: from the tactile branch alone.
    pub(super) base: Option<Tensor<2>>,
    /// `[N, 1]`: log odds of touch.
    pub(super) touch: Option<Tensor<2>>,
    /// `[L, N, T]`: the zero-load tactile change predicted from pose, in units of the tactile scale.
    pub(super) artifact: Option<Tensor<3>>,
    /// Mean and unbiased variance of the batch, if it was normalized by itself.
    pub(super) statistics: Option<BatchNormStatistics>,
}

/// The weights of one pass.
pub(super) struct Weights<'a> {
    architecture: &'a Architecture,
    device: Device,
    parameters: Vec<Parameter>,
    /// One flat tensor per parameter.
    pub(super) tensors: Vec<Tensor<1>>,
}

impl Weights<'_> {
    fn flat(&self, name: &str) -> Tensor<1> {
        let idx = self.parameters.iter().position(|parameter| parameter.name == name);
        self.tensors[idx.expect("the pass asks for parameters that its architecture lists")].clone()
    }

    /// Index range of each parameter's gradient.
    pub(super) fn ranges(&self) -> impl Iterator<Item = Range<usize>> {
        self.parameters.iter().map(Parameter::range)
    }

    /// Windows made time-major. `tactile`: `[N, L, T]`, `pose`: `[N, L, P]`, both row-major.
    pub(super) fn input(&self, n: usize, tactile: Vec<f32>, pose: Vec<f32>) -> NetworkInput {
        let Architecture { window, n_taxels, n_joints, tactile_scale, kind, .. } = *self.architecture;
        let frames = if kind == Kind::Adaptive { tactile.len() / (n * n_taxels).max(1) } else { window };
        let mut tactile = time_first(&tactile, [n, frames, n_taxels]);
        tactile.iter_mut().for_each(|value| *value /= tactile_scale);
        let pose = kind.uses_pose().then(|| {
            let pose = time_first(&pose, [n, window, n_joints]);
            Tensor::<3>::from_data(TensorData::new(pose, [window, n, n_joints]), &self.device)
        });
        NetworkInput { n, tactile, pose }
    }

    /// The paper's pass: base force from touch, residual from pose and touch, force as their difference.
    pub(super) fn forward(&self, input: NetworkInput, normalize: Normalize<'_>) -> Output {
        let scale = self.architecture.force_scale;
        if self.architecture.kind == Kind::Adaptive {
            return self.causal(input);
        }
        let (touch, statistics) = self.tactile_features(input.n, input.tactile, normalize);
        let hidden = input.pose.map(|pose| self.pose_hidden(pose));
        let last = |hidden: &Tensor<3>| {
            let [frames, n, width] = hidden.dims();
            hidden.clone().slice([frames - 1..frames, 0..n, 0..width]).reshape([n, width])
        };
        match (self.architecture.kind, hidden) {
            (Kind::PoseAware, Some(hidden)) => {
                let pose = last(&hidden);
                let base = self.decode("base", touch.clone()) * scale;
                let fused = Tensor::cat(vec![touch.clone(), pose.clone(), touch * pose], 1);
                let residual = self.decode("residual", fused) * scale;
                let [frames, n, width] = hidden.dims();
                let artifact = self.decode("auxiliary", hidden.reshape([frames * n, width]));
                let artifact = artifact.reshape([frames, n, self.architecture.n_taxels]);
                Output {
                    force: base.clone() - residual,
                    base: Some(base),
                    touch: None,
                    artifact: Some(artifact),
                    statistics,
                }
            }
            (Kind::EarlyFusion, Some(hidden)) => {
                let force = self.decode("fused", Tensor::cat(vec![touch, last(&hidden)], 1)) * scale;
                Output { force, base: None, touch: None, artifact: None, statistics }
            }
            (_, _) => {
                let force = self.decode("base", touch) * scale;
                Output { force, base: None, touch: None, artifact: None, statistics }
            }
        }
    }

    /// Tactile branch: `[L, N, T]` to `[N, 64]`.
    fn tactile_features(
        &self,
        n: usize,
        tactile: Vec<f32>,
        normalize: Normalize<'_>,
    ) -> (Tensor<2>, Option<BatchNormStatistics>) {
        let Architecture { window, n_taxels, .. } = *self.architecture;
        let shape = TactileShape { frames: window, batch: n, n_taxels };
        let layers = ["conv0", "norm", "conv1", "conv2", "conv3"];
        let parameters = from_fn(|idx| {
            let part = ["weight", "bias"][idx % 2];
            self.flat(&format!("tactile.{}.{part}", layers[idx / 2]))
        });
        tactile_op::features(shape, tactile, parameters, normalize, &self.device)
    }

    /// Pose branch: `[L, N, P]` to hidden states `[L, N, 64]`.
    fn pose_hidden(&self, pose: Tensor<3>) -> Tensor<3> {
        let [frames, n, n_joints] = pose.dims();
        let encoded = Tensor::cat(vec![pose.clone().sin(), pose.cos()], 2);
        let encoded = self.layer_norm(encoded.reshape([frames * n, 2 * n_joints]));
        let mut x = gelu(self.linear("pose.embed", encoded)).reshape([frames, n, N_FEATURES]);
        for layer in 0..2 {
            let [forward, backward] = [("forward", false), ("backward", true)].map(|(direction, reversed)| {
                let tensor = |part: &str| self.flat(&format!("pose.lstm{layer}.{direction}.{part}"));
                let bias = tensor("bias_ih") + tensor("bias_hh");
                lstm_op::lstm(x.clone(), [tensor("weight_ih"), tensor("weight_hh"), bias], LSTM_HIDDEN, reversed)
            });
            x = Tensor::cat(vec![forward, backward], 2);
        }
        x
    }

    fn layer_norm(&self, x: Tensor<2>) -> Tensor<2> {
        let width = x.dims()[1];
        let centered = x.clone() - x.mean_dim(1);
        let variance = centered.clone().square().mean_dim(1);
        let weight = self.flat("pose.norm.weight").reshape([1, width]);
        centered / (variance + NORM_EPSILON).sqrt() * weight + self.flat("pose.norm.bias").reshape([1, width])
    }

    fn linear(&self, name: &str, x: Tensor<2>) -> Tensor<2> {
        let bias = self.flat(&format!("{name}.bias"));
        let (n_in, n_out) = (x.dims()[1], bias.dims()[0]);
        let weight = self.flat(&format!("{name}.weight")).reshape([n_out, n_in]);
        x.matmul(weight.transpose()) + bias.reshape([1, n_out])
    }

    /// Two fully connected layers with a ReLU between.
    fn decode(&self, name: &str, x: Tensor<2>) -> Tensor<2> {
        self.linear(&format!("{name}.1"), relu(self.linear(&format!("{name}.0"), x)))
    }
}

/// `[N, L, C]` to `[L, N, C]`.
fn time_first(values: &[f32], [n, frames, width]: [usize; 3]) -> Vec<f32> {
    let row = |frame: usize, window: usize| &values[(window * frames + frame) * width..][..width];
    (0..frames).flat_map(|frame| (0..n).flat_map(move |window| row(frame, window))).copied().collect()
}
