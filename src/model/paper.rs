//! The paper's network found again in a graph, whoever exported it: its weights, and what they are for.
//!
//! Every node between inputs and outputs is followed, from what it reads to what it gives (`walk`): its operator, its
//! settings, its constants, and which axis of a tensor is which. A node that the network doesn't have, or has elsewhere,
//! ends the search, so what is found computes what the graph computes, but for rounding. Nodes that no output depends on
//! don't count.

pub(super) mod attributes;
pub(super) mod flow;
pub(super) mod walk;

use super::contract::Terms;
use super::error::one_line;
use super::onnx::{GraphProto, ModelProto};
use flow::{Side, What};
use walk::{Found, Walk};

/// Dilations of the convolutions, the first one before the multi-scale block.
pub(super) const DILATIONS: [usize; 4] = [1, 1, 2, 4];

/// Taps of every convolution.
pub(super) const TAPS: usize = 3;

/// The weights of the paper's network.
///
/// # Source
/// Pose-aware tactile gloves, Sec. V.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Paper {
    pub(super) window: usize,
    /// With their biases, batch normalization folded in.
    pub(super) convolutions: [Dense; 4],
    pub(super) pose: Option<Pose>,
    pub(super) head: Head,
}

/// A linear map.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dense {
    /// Outputs, inputs, and taps for a convolution, row-major.
    pub(super) dims: Vec<usize>,
    pub(super) weight: Vec<f32>,
    /// `[outputs]`
    pub(super) bias: Vec<f32>,
}

/// The pose branch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pose {
    /// `[2 P]` each.
    pub(super) norm_gain: Vec<f32>,
    pub(super) norm_shift: Vec<f32>,
    pub(super) norm_epsilon: f32,
    /// Inputs first, as of a MatMul: `[2 P, F]`.
    pub(super) embedding: Dense,
    /// By layer, then forward and backward.
    pub(super) lstm: [[Cells; 2]; 2],
}

/// One direction of an LSTM layer, gates in ONNX's order: input, output, forget, cell.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cells {
    pub(super) hidden: usize,
    /// `[4 H, F]`
    pub(super) input: Vec<f32>,
    /// `[4 H, H]`
    pub(super) recurrent: Vec<f32>,
    /// `[4 H]`, both biases added.
    pub(super) bias: Vec<f32>,
}

/// What makes the force.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Head {
    /// Touch alone.
    Touch(Decoder),
    /// Touch and pose side by side.
    Fused(Decoder),
    /// A base of touch alone minus a residual of touch, pose and their product.
    Residual { base: Decoder, residual: Decoder },
}

/// Two fully connected layers with a ReLU between.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Decoder(pub(super) [Dense; 2]);

/// Operator sets whose operators are known to mean the same; 13 is the first in which `Squeeze` reads its axes.
const OPSETS: std::ops::RangeInclusive<i64> = 13..=25;

/// Refuses operators of other versions than those that are known, and functions of a model's own.
pub(super) fn check_operators(model: &ModelProto) -> Result<(), String> {
    let mut versions = model.opset_import.iter().filter(|opset| walk::is_standard(&opset.domain));
    let known = versions.next().is_some_and(|opset| OPSETS.contains(&opset.version)) && versions.next().is_none();
    if !known {
        return Err(format!("its operators are not of one of the versions {} to {}", OPSETS.start(), OPSETS.end()));
    }
    if !model.functions.is_empty() {
        // One of them could go by the name of any operator.
        return Err("it defines functions of its own".to_owned());
    }
    Ok(())
}

/// Looks for the network in a model with these tensors.
///
/// # Errors
/// What is in the model that the network doesn't have.
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

/// True if an output depends on every node of a graph.
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
    fits.then_some(Paper { window: terms.contract.window, convolutions, pose, head })
}
