//! Writes a trained network as the ONNX model that the node runs.
//!
//! Opset 17, dynamic batch, batch normalization and scales folded into the weights, the auxiliary decoder left out.

use std::collections::BTreeMap;

use serde_json::Value;

use super::architecture::{Architecture, ContactAxes, DILATIONS, Kind, LSTM_HIDDEN, N_FEATURES, TAPS};
use super::error::TrainError;
use super::network::{NORM_EPSILON, Network};
use crate::fusion::{ArtifactModel, ForceUnit, PoseRange, RegionTerms, TouchOutput};
use crate::model::onnx::{Graph, Message, ModelProto};
use crate::model::unit_name;

mod causal;
mod graph;
mod pose;

/// Opset of the graphs: supported everywhere.
const OPSET: i64 = 17;

/// Form of the graph. Both forms compute the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GraphForm {
    /// The fastest: 1x3 Conv2d for Conv1d, and only the one step of layer 2's backward LSTM that is used.
    #[default]
    Fast,
    /// Layer by layer, as an exporter would write it.
    Plain,
}

/// Metadata of a model, beside its shape.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelCard {
    /// Model frames per second.
    pub rate_hz: f64,
    /// Joint names in the order of the pose input; not used without pose.
    pub joints: Vec<String>,
    /// Per joint, the span of the training data, rad; may be empty if unknown.
    pub pose_range: Vec<PoseRange>,
    /// The artifact model, for an adaptive network of one region.
    pub artifact: Option<ArtifactModel>,
    /// By the region's name, for an adaptive network of several: in place of `joints`, `pose_range` and `artifact`.
    pub regions: BTreeMap<String, RegionTerms>,
    /// Thresholds at which the touch output is contact, for a network with one.
    pub touch: Option<TouchOutput>,
    /// Names of the sessions held out from its training, if it is one of several models scored on held-out sessions.
    pub held_out: Vec<String>,
    /// The glove that it was made for.
    pub glove: String,
    /// Description of the training data.
    pub trained_on: String,
    /// Metrics on the test part, a JSON object; `mdf_gf` is read by the node.
    pub metrics: Value,
}

/// The bytes of an ONNX file.
///
/// # Errors
/// [`TrainError::Architecture`] for an incomplete network, [`TrainError::Card`] for a card that doesn't fit it.
pub fn onnx_model(network: &Network, card: &ModelCard, form: GraphForm) -> Result<Vec<u8>, TrainError> {
    network.check()?;
    check_card(network, card)?;
    let mut writer = Writer { network, form, graph: Graph::default() };
    writer.write()?;
    let mut model = ModelProto::with_graph(writer.graph.finish(&network.architecture), OPSET);
    for (key, value) in metadata(network, card) {
        model.push_metadata(key, &value);
    }
    Ok(model.encode_to_vec())
}

fn check_card(network: &Network, card: &ModelCard) -> Result<(), TrainError> {
    let refuse = |what: String| Err(TrainError::Card { what });
    let Architecture { kind, n_joints, .. } = network.architecture;
    if !card.rate_hz.is_finite() || card.rate_hz <= 0.0 {
        return refuse(format!("rate_hz is {}, expected a positive number of frames a second", card.rate_hz));
    }
    if !card.metrics.is_object() {
        return refuse("metrics must be a JSON object".to_string());
    }
    let mut artifacts = card.artifact.iter().chain(card.regions.values().map(|terms| &*terms.artifact));
    let is_of_other = |artifact: &&ArtifactModel| artifact.n_columns() != network.architecture.n_taxels;
    if let Some(artifact) = artifacts.find(is_of_other) {
        let (n_taxels, n_trust) = (artifact.n_taxels, artifact.n_trust_inputs());
        return refuse(format!(
            "the artifact model is of {n_taxels} taxels and {n_trust} columns of trust, the network of {} in all",
            network.architecture.n_taxels
        ));
    }
    let n_joints = match (&card.artifact, kind) {
        (artifact, _) if !card.regions.is_empty() => {
            let others = artifact.is_some() || !card.joints.is_empty() || !card.pose_range.is_empty();
            if others || kind != Kind::Adaptive {
                return refuse(
                    "regions are for an adaptive network, in place of joints, pose_range and artifact".into(),
                );
            }
            return Ok(());
        }
        (Some(artifact), Kind::Adaptive) => artifact.n_joints,
        (None, Kind::Adaptive) => return refuse("an adaptive network needs its artifact model".to_string()),
        _ => n_joints,
    };
    if !kind.needs_joints() {
        return Ok(());
    }
    let distinct: std::collections::BTreeSet<&String> = card.joints.iter().collect();
    if card.joints.len() != n_joints || distinct.len() != n_joints || card.joints.iter().any(String::is_empty) {
        return refuse(format!("joints are {:?}, expected {n_joints} distinct names", card.joints));
    }
    if !card.pose_range.is_empty() && card.pose_range.len() != n_joints {
        return refuse(format!("pose_range holds {} joints, expected {n_joints}", card.pose_range.len()));
    }
    Ok(())
}

fn metadata(network: &Network, card: &ModelCard) -> Vec<(&'static str, String)> {
    let Architecture { kind, window, n_taxels, .. } = network.architecture;
    let of_several = || card.regions.values().next().map(|terms| &*terms.artifact);
    let n_trust_inputs = card.artifact.as_ref().or_else(of_several).map_or(0, ArtifactModel::n_trust_inputs);
    let mut entries = vec![
        ("tpf.contract", crate::model::metadata::CONTRACT_VERSION.to_string()),
        ("unit", unit_name(ForceUnit::GramForce).to_string()),
        ("rate_hz", card.rate_hz.to_string()),
        ("window", window.to_string()),
        ("taxels", n_taxels.saturating_sub(n_trust_inputs).to_string()),
    ];
    if !card.regions.is_empty() {
        entries.push(("regions", crate::model::metadata::regions_text(&card.regions)));
    } else if kind.needs_joints() {
        entries.push(("joints", Value::from(card.joints.clone()).to_string()));
        if !card.pose_range.is_empty() {
            let ranges = card.pose_range.iter().map(|range| Value::from(vec![range.min, range.max]));
            entries.push(("pose_range", Value::Array(ranges.collect()).to_string()));
        }
    }
    if let Some(artifact) = card.artifact.as_ref().filter(|_| kind == Kind::Adaptive) {
        entries.push(("artifact", serde_json::to_string(artifact).unwrap_or_default()));
    }
    if let Some(touch) = card.touch.filter(|_| kind == Kind::Adaptive) {
        entries.push(("touch", serde_json::to_string(&touch).unwrap_or_default()));
    }
    if !card.held_out.is_empty() {
        entries.push((crate::model::metadata::HELD_OUT, Value::from(card.held_out.clone()).to_string()));
    }
    entries.push(("glove", card.glove.clone()));
    entries.push(("trained_on", card.trained_on.clone()));
    entries.push(("metrics", card.metrics.to_string()));
    entries.push(("tool_version", env!("CARGO_PKG_VERSION").to_string()));
    entries
}

/// The graph under construction.
struct Writer<'a> {
    network: &'a Network,
    form: GraphForm,
    graph: Graph,
}

impl Writer<'_> {
    fn write(&mut self) -> Result<(), TrainError> {
        let scale = self.network.architecture.force_scale;
        if self.network.architecture.kind == Kind::Adaptive {
            return self.causal();
        }
        let touch = self.tactile_branch()?;
        match self.network.architecture.kind {
            Kind::TactileOnly | Kind::Adaptive => self.decoder("base", &touch, scale, "force")?,
            Kind::EarlyFusion => {
                let pose = self.pose_branch()?;
                let fused = self.graph.concat("fused", &[&touch, &pose], 1);
                self.decoder("fused", &fused, scale, "force")?;
            }
            Kind::PoseAware => {
                let pose = self.pose_branch()?;
                self.decoder("base", &touch, scale, "force_base")?;
                let product = self.graph.node("Mul", &[&touch, &pose], "product", vec![]);
                let fused = self.graph.concat("fused", &[&touch, &pose, &product], 1);
                self.decoder("residual", &fused, scale, "force_residual")?;
                self.graph.node("Sub", &["force_base", "force_residual"], "force", vec![]);
            }
        }
        Ok(())
    }

    /// A parameter's values.
    fn values(&self, name: &str) -> Result<&[f32], TrainError> {
        let missing = || TrainError::Architecture { what: format!("the network has no parameter {name}") };
        self.network.parameter(name).ok_or_else(missing)
    }

    /// Taxels to `[N, 64]`.
    fn tactile_branch(&mut self) -> Result<String, TrainError> {
        let window = self.network.architecture.window as i64;
        let mut x = self.graph.transpose("tactile", "tactile_channels", &[0, 2, 1]);
        let fast = self.form == GraphForm::Fast;
        if fast {
            x = self.graph.unsqueeze(&x, "tactile_rows", 2);
        }
        let (weight, bias) = self.first_convolution()?;
        let n_taxels = self.network.architecture.n_taxels;
        x = self.convolution("tactile.conv0", &x, n_taxels, 1, (&weight, &bias));
        for (idx, dilation) in DILATIONS.into_iter().enumerate() {
            let name = format!("tactile.conv{}", idx + 1);
            let weight = self.values(&format!("{name}.weight"))?.to_vec();
            let bias = self.values(&format!("{name}.bias"))?.to_vec();
            x = self.convolution(&name, &x, N_FEATURES, dilation, (&weight, &bias));
        }
        let kernel = if fast { vec![1, window] } else { vec![window] };
        let pooled = self.graph.max_pool(&x, "tactile_pooled", &kernel);
        Ok(self.graph.flatten(&pooled, "tactile_features"))
    }

    /// The first convolution, including the batch normalization after it and the scale of the taxels before it.
    fn first_convolution(&self) -> Result<(Vec<f32>, Vec<f32>), TrainError> {
        let gain = self.values("tactile.norm.weight")?;
        let shift = self.values("tactile.norm.bias")?;
        let statistics = &self.network.statistics;
        let (mut weight, mut bias) =
            (self.values("tactile.conv0.weight")?.to_vec(), self.values("tactile.conv0.bias")?.to_vec());
        let per_channel = self.network.architecture.n_taxels * TAPS;
        for (channel, rows) in weight.chunks_exact_mut(per_channel).enumerate() {
            // Folded in f64: the quotient of two learned numbers would otherwise round twice.
            let deviation = (f64::from(statistics.variance[channel]) + f64::from(NORM_EPSILON)).sqrt();
            let factor = f64::from(gain[channel]) / deviation;
            let input_factor = factor / f64::from(self.network.architecture.tactile_scale);
            rows.iter_mut().for_each(|value| *value = (f64::from(*value) * input_factor) as f32);
            let centered = f64::from(bias[channel]) - f64::from(statistics.mean[channel]);
            bias[channel] = (centered * factor + f64::from(shift[channel])) as f32;
        }
        Ok((weight, bias))
    }

    /// A convolution over time that keeps its length, followed by a ReLU.
    fn convolution(&mut self, name: &str, x: &str, n_in: usize, dilation: usize, values: (&[f32], &[f32])) -> String {
        let (rows, taps) = (N_FEATURES as i64, TAPS as i64);
        let fast = self.form == GraphForm::Fast;
        let dims = if fast { vec![rows, n_in as i64, 1, taps] } else { vec![rows, n_in as i64, taps] };
        let weight = self.graph.weights(&format!("{name}.weight"), &dims, values.0);
        let bias = self.graph.weights(&format!("{name}.bias"), &[rows], values.1);
        let convolved = self.graph.conv(x, &weight, &bias, name, dilation as i64, fast);
        self.graph.node("Relu", &[&convolved], &format!("{name}.relu"), vec![])
    }

    /// Two fully connected layers with a ReLU between; the second outputs gF.
    fn decoder(&mut self, name: &str, x: &str, scale: f32, output: &str) -> Result<(), TrainError> {
        let hidden = self.linear(&format!("{name}.0"), x, 1.0, &format!("{name}.hidden"))?;
        let hidden = self.graph.node("Relu", &[&hidden], &format!("{name}.relu"), vec![]);
        let name = format!("{name}.1");
        let (weight, bias) = (self.values(&format!("{name}.weight"))?, self.values(&format!("{name}.bias"))?);
        let (weight, bias) = match &self.network.architecture.axes {
            Some(axes) => (in_patch(axes, weight), in_patch(axes, bias)),
            None => (weight.to_vec(), bias.to_vec()),
        };
        self.linear_of(&name, &hidden, scale, (&weight, &bias), output).map(drop)
    }

    fn linear(&mut self, name: &str, x: &str, scale: f32, output: &str) -> Result<String, TrainError> {
        let weight = self.values(&format!("{name}.weight"))?.to_vec();
        let bias = self.values(&format!("{name}.bias"))?.to_vec();
        self.linear_of(name, x, scale, (&weight, &bias), output)
    }

    fn linear_of(
        &mut self,
        name: &str,
        x: &str,
        scale: f32,
        (weight, bias): (&[f32], &[f32]),
        output: &str,
    ) -> Result<String, TrainError> {
        let scaled = |values: &[f32]| values.iter().map(|value| value * scale).collect::<Vec<f32>>();
        let (weight, bias) = (scaled(weight), scaled(bias));
        let rows = bias.len();
        let weight_dims = [rows as i64, (weight.len() / rows) as i64];
        let weight = self.graph.weights(&format!("{name}.weight"), &weight_dims, &weight);
        let bias = self.graph.weights(&format!("{name}.bias"), &[rows as i64], &bias);
        Ok(self.graph.gemm(x, &weight, &bias, output))
    }
}

/// Rows along the axes of the contact, turned to rows along x, y, z of the patch.
fn in_patch(axes: &ContactAxes, rows: &[f32]) -> Vec<f32> {
    let width = rows.len() / axes.in_patch.len();
    let turned = |axis: usize, column: usize| {
        let along = axes.in_patch.iter().zip(rows.chunks(width));
        along.map(|(of, row)| of[axis] * f64::from(row[column])).sum::<f64>() as f32
    };
    (0..3).flat_map(|axis| (0..width).map(move |column| turned(axis, column))).collect()
}
