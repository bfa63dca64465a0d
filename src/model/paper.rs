//! Recognizes the paper's network in an ONNX graph of any exporter, and reads its weights.
//!
//! Every node is followed from the inputs to the outputs (`walk`): its operator, its attributes, its constants, and the
//! meaning of each axis of its tensors. The search ends with an error at a node that the network doesn't have, or has
//! in another place. A network that is found therefore computes what the graph computes, except for rounding. Nodes
//! that no output depends on are ignored.

pub(super) mod attributes;
pub(super) mod flow;
pub(super) mod walk;

use super::contract::Terms;
use super::error::one_line;
use super::onnx::{GraphProto, ModelProto};
use flow::{Side, What};
use walk::{Found, Walk};

/// Dilations of the convolutions. The first convolution comes before the multi-scale block.
pub(super) const DILATIONS: [usize; 4] = [1, 1, 2, 4];

/// Taps of each convolution.
pub(super) const TAPS: usize = 3;

/// Weights of the paper's network.
///
/// # Source
/// Pose-aware tactile gloves, Sec. V.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Paper {
    pub(super) window: usize,
    /// Weights and biases, with batch normalization folded in.
    pub(super) convolutions: [Dense; 4],
    pub(super) pose: Option<Pose>,
    pub(super) head: Head,
}

/// Weights of a linear map or a convolution.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dense {
    /// `[outputs, inputs]`, or `[outputs, inputs, taps]` for a convolution. `weight` is row-major.
    pub(super) dims: Vec<usize>,
    pub(super) weight: Vec<f32>,
    /// `[outputs]`
    pub(super) bias: Vec<f32>,
}

/// Weights of the pose branch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pose {
    /// `[2 P]`, like `norm_shift`.
    pub(super) norm_gain: Vec<f32>,
    pub(super) norm_shift: Vec<f32>,
    pub(super) norm_epsilon: f32,
    /// `[2 P, F]`: inputs first, as for a MatMul.
    pub(super) embedding: Dense,
    /// Indexed by layer, then by direction: forward, backward.
    pub(super) lstm: [[Cells; 2]; 2],
}

/// Weights of one direction of an LSTM layer. Gates are in ONNX's order: input, output, forget, cell.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cells {
    pub(super) hidden: usize,
    /// `[4 H, F]`
    pub(super) input: Vec<f32>,
    /// `[4 H, H]`
    pub(super) recurrent: Vec<f32>,
    /// `[4 H]`, the sum of both biases.
    pub(super) bias: Vec<f32>,
}

/// The part of the network that computes the force.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Head {
    /// From touch alone.
    Touch(Decoder),
    /// From the features of touch and pose, concatenated.
    Fused(Decoder),
    /// Base force from touch alone, minus a residual from touch, pose and their product.
    Residual { base: Decoder, residual: Decoder },
}

/// Two fully connected layers with a ReLU between them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Decoder(pub(super) [Dense; 2]);

/// Versions of the operator set in which our operators have the same meaning. 13 is the first in which `Squeeze` reads
/// its axes from an input.
const OPSETS: std::ops::RangeInclusive<i64> = 13..=25;

/// Refuses other versions of the operator set, and models that define functions.
pub(super) fn check_operators(model: &ModelProto) -> Result<(), String> {
    let mut versions = model.opset_import.iter().filter(|opset| walk::is_standard(&opset.domain));
    let known = versions.next().is_some_and(|opset| OPSETS.contains(&opset.version)) && versions.next().is_none();
    if !known {
        return Err(format!("its operators are not of one of the versions {} to {}", OPSETS.start(), OPSETS.end()));
    }
    if !model.functions.is_empty() {
        // A function could have the name of any operator.
        return Err("it defines functions of its own".to_owned());
    }
    Ok(())
}

/// Looks for the network in a model with these tensors.
///
/// # Errors
/// The part of the model that the network doesn't have.
pub(super) fn find(model: &ModelProto, terms: &Terms) -> Result<Paper, String> {
    check_operators(model)?;
    let graph = model.graph.as_ref().ok_or("it holds no graph")?;
    let tensors = &terms.tensors;
    let ours = [Some(&tensors.force), tensors.base.as_ref(), tensors.residual.as_ref()];
    if let Some(other) = graph.output.iter().find(|output| !ours.contains(&Some(&output.name))) {
        return Err(format!("output {} is not one of the paper's network", one_line(&other.name)));
    }
    let walked = Walk::through(graph, terms)?;
    paper(walked, ours, terms).ok_or_else(|| "its nodes are the paper's network's, and not all of them".to_owned())
}

/// True if the outputs depend on every node of the graph.
pub(super) fn needs_every_node(graph: &GraphProto) -> bool {
    walk::needed(graph).is_some_and(|needed| needed.len() == graph.node.len())
}

fn paper(walked: Walk<'_>, outputs: [Option<&String>; 3], terms: &Terms) -> Option<Paper> {
    let [force, base, residual] = outputs.map(|name| name.map(|name| walked.force(name)));
    let gives = |output: Option<Option<What>>, what: What| output.is_none_or(|given| given == Some(what));
    let Found { convolutions, pose, mut decoders } = walked.found;
    let mut decoder = |side: Side| decoders.remove(&side).and_then(|[hidden, last]| Some(Decoder([hidden?, last?])));
    let head = match force?? {
        What::Force(Side::Touch) => Head::Touch(decoder(Side::Touch)?),
        What::Force(Side::Both) => Head::Fused(decoder(Side::Both)?),
        What::Difference => Head::Residual { base: decoder(Side::Touch)?, residual: decoder(Side::WithProduct)? },
        _ => return None,
    };
    let fits = match &head {
        Head::Touch(_) => terms.tensors.pose.is_none() && base.is_none() && residual.is_none(),
        Head::Fused(_) => base.is_none() && residual.is_none(),
        Head::Residual { .. } => {
            gives(base, What::Force(Side::Touch)) && gives(residual, What::Force(Side::WithProduct))
        }
    };
    let [a, b, c, d] = convolutions;
    let convolutions = [a?, b?, c?, d?];
    let n_features = convolutions[0].dims[0];
    let pose = match &terms.tensors.pose {
        Some(_) => Some(pose.whole(n_features)?),
        None => None,
    };
    fits.then_some(Paper { window: terms.contract.window.get(), convolutions, pose, head })
}
