//! Follows a graph node by node, from its inputs to its outputs.

mod layers;
mod shapes;

use std::collections::{BTreeMap, BTreeSet};

use self::layers::{next, rectified};
use self::shapes::{flatten, shape};
use super::attributes::Attributes;
use super::flow::{Axis, Flow, Gelu, Side, Sizes, Value, What};
use super::{Cells, DILATIONS, Dense, Pose};
use crate::model::contract::Terms;
use crate::model::error::one_line;
use crate::model::onnx::{GraphProto, NodeProto, TensorProto, data_type};

/// Maximum number of nodes that are followed. PyTorch's exporters write the network with fewer than 100.
const MAX_NODES: usize = 1024;

/// True if a domain is the one of the standard operators.
pub(in crate::model) fn is_standard(domain: &str) -> bool {
    ["", "ai.onnx"].contains(&domain)
}

/// A graph whose nodes were followed.
pub(super) struct Walk<'g> {
    window: usize,
    constants: BTreeMap<&'g str, &'g TensorProto>,
    values: BTreeMap<&'g str, Value<'g>>,
    pub(super) found: Found,
}

/// Weights found so far. Each layer must be found exactly once.
#[derive(Default)]
pub(super) struct Found {
    pub(super) convolutions: [Option<Dense>; DILATIONS.len()],
    pub(super) pose: FoundPose,
    pub(super) decoders: BTreeMap<Side, [Option<Dense>; 2]>,
}

/// Weights of the pose branch found so far.
#[derive(Default)]
pub(super) struct FoundPose {
    norm: Option<(Vec<f32>, Vec<f32>, f32)>,
    weight: Option<(Vec<usize>, Vec<f32>)>,
    bias: Option<Vec<f32>>,
    /// Indexed by layer, then by direction: forward, backward.
    lstm: [[Option<Cells>; 2]; 2],
}

impl FoundPose {
    /// The pose branch, if it is complete and as wide as the tactile branch.
    pub(super) fn whole(self, n_features: usize) -> Option<Pose> {
        let ((norm_gain, norm_shift, norm_epsilon), (dims, weight), bias) = (self.norm?, self.weight?, self.bias?);
        let [[a, b], [c, d]] = self.lstm;
        let lstm = [[a?, b?], [c?, d?]];
        let is_wide = lstm.iter().flatten().all(|cells| 2 * cells.hidden == n_features);
        let embedding = Dense { dims, weight, bias };
        (is_wide && embedding.bias.len() == n_features).then_some(Pose {
            norm_gain,
            norm_shift,
            norm_epsilon,
            embedding,
            lstm,
        })
    }
}

impl<'g> Walk<'g> {
    /// Follows every node that an output depends on.
    ///
    /// # Errors
    /// The first node that is not understood, or another reason why this is not the network.
    pub(super) fn through(graph: &'g GraphProto, terms: &'g Terms) -> Result<Self, String> {
        let contract = &terms.contract;
        let window = contract.window.get();
        let constants: BTreeMap<_, _> = graph.initializer.iter().map(|tensor| (tensor.name.as_str(), tensor)).collect();
        let mut walk = Walk { window, constants, values: BTreeMap::new(), found: Found::default() };
        let twice = "two of its tensors have the same name";
        if walk.constants.len() != graph.initializer.len() {
            return Err(twice.to_owned());
        }
        let input = |what, width| Flow::new(what, &[Axis::Windows, Axis::Frames(window), Axis::Features(width)]);
        let tactile = (Some(&terms.tensors.tactile), input(What::Tactile, contract.n_taxels));
        let pose = (terms.tensors.pose.as_ref(), input(What::Pose, contract.n_joints));
        for (name, flow) in [tactile, pose] {
            let Some(name) = name else { continue };
            walk.values.insert(name, Value::Flow(flow));
        }
        for input in &graph.input {
            if graph.input.iter().filter(|other| other.name == input.name).count() > 1 {
                return Err(twice.to_owned());
            }
        }
        let nodes = needed(graph).ok_or_else(|| format!("it has more than {MAX_NODES} nodes"))?;
        for node in nodes {
            walk.step(node).ok_or_else(|| {
                let (name, op) = (one_line(&node.name), one_line(&node.op_type));
                format!("node {name} ({op}) is not the paper's network's, or not there, or not so")
            })?;
        }
        Ok(walk)
    }

    /// Stage of an output, if it has one number per window.
    pub(super) fn force(&self, name: &str) -> Option<What> {
        let flow = self.flow(name)?;
        matches!(flow.axes.as_slice(), [Axis::Windows] | [Axis::Windows, Axis::One]).then_some(flow.what)
    }

    fn value(&self, name: &str) -> Option<Value<'g>> {
        if let Some(tensor) = self.constants.get(name) {
            return constant(tensor);
        }
        self.values.get(name).cloned()
    }

    fn flow(&self, name: &str) -> Option<Flow> {
        match self.value(name)? {
            Value::Flow(flow) => Some(flow),
            _ => None,
        }
    }

    fn sizes(&self, name: &str) -> Option<Sizes> {
        match self.value(name)? {
            Value::Sizes(sizes) => Some(sizes),
            _ => None,
        }
    }

    /// Integer constants.
    fn numbers(&self, name: &str) -> Option<Vec<i64>> {
        self.sizes(name)?.constants()
    }

    /// Shape and values of a float constant that is not empty and is finite.
    fn weights(&self, name: &str) -> Option<(Vec<usize>, Vec<f32>)> {
        let Value::Weights(tensor) = self.value(name)? else { return None };
        floats(tensor)
    }

    /// Weights, if they have this shape.
    fn shaped(&self, name: &str, shape: &[usize]) -> Option<Vec<f32>> {
        let (dims, values) = self.weights(name)?;
        (dims == shape).then_some(values)
    }

    /// A single number that doesn't increase the rank of a tensor that it is combined with.
    fn number(&self, name: &str, rank: usize) -> Option<f32> {
        let (dims, values) = self.weights(name)?;
        (dims.len() <= rank && values.len() == 1).then(|| values[0])
    }

    fn step(&mut self, node: &'g NodeProto) -> Option<()> {
        if !is_standard(&node.domain) {
            return None;
        }
        let mut given = Attributes::of(node)?;
        let mut names: Vec<&str> = node.input.iter().map(String::as_str).collect();
        while names.last() == Some(&"") {
            names.pop();
        }
        let value = match (node.op_type.as_str(), names.as_slice()) {
            ("LSTM", [x, weights @ ..]) => {
                self.lstm(node, &mut given, self.flow(x)?, weights)?;
                return given.all_read().then_some(());
            }
            ("Identity", [x]) => self.value(x)?,
            ("Constant", []) => constant(given.tensor("value")?)?,
            ("Shape", [x]) => shape(&self.flow(x)?, &mut given)?,
            ("Concat", names) => self.concat(names, &mut given)?,
            ("Gather", [x, at]) => self.gather(x, at, &mut given)?,
            ("Slice", [x, bounds @ ..]) => self.slice(x, bounds)?,
            ("Squeeze", [x, axes]) => self.squeeze(x, &self.numbers(axes)?)?,
            ("Unsqueeze", [x, axes]) => self.unsqueeze(x, &self.numbers(axes)?)?,
            ("Reshape", [x, target]) => self.reshape(x, target, &mut given)?,
            ("ConstantOfShape", [shape]) => self.zeros_of_shape(shape, &mut given)?,
            ("Expand", [x, shape]) => self.expanded_zeros(x, shape)?,
            ("Mul", [a, b]) => self.product(a, b)?,
            (op, names) => Value::Flow(self.forward(op, names, &mut given)?),
        };
        (given.all_read()).then_some(())?;
        self.give(node, 0, value)
    }

    /// Operators that take a stage of the network to the next one.
    fn forward(&mut self, op: &str, names: &[&str], given: &mut Attributes<'g>) -> Option<Flow> {
        let flow = |name: &str| self.flow(name);
        match (op, names) {
            ("Transpose", [x]) => flow(x)?.transposed(given.ints("perm")??),
            ("Flatten", [x]) => flatten(flow(x)?, given),
            ("Conv", [x, weight, bias]) => self.convolution(flow(x)?, weight, bias, given),
            ("Relu", [x]) => rectified(flow(x)?),
            ("MaxPool", [x]) => self.max_pool(flow(x)?, given),
            ("ReduceMax", [x, axes @ ..]) => self.reduce_max(flow(x)?, axes, given),
            ("Sin", [x]) => next(flow(x)?, What::Pose, What::Sine),
            ("Cos", [x]) => next(flow(x)?, What::Pose, What::Cosine),
            ("LayerNormalization", [x, gain, shift]) => self.layer_norm(flow(x)?, gain, shift, given),
            ("MatMul", [x, weight]) => self.embedding(flow(x)?, weight),
            ("Add", [a, b]) => self.sum(a, b),
            ("Gelu", [x]) => {
                given.says("approximate", "none").then_some(())?;
                next(flow(x)?, What::Embedded, What::Activated)
            }
            ("Erf", [x]) => next(flow(x)?, What::Gelu(Gelu::Scaled), What::Gelu(Gelu::Erf)),
            ("Div", [x, by]) => {
                let x = flow(x)?;
                let is_root = self.number(by, x.axes.len())? == std::f32::consts::SQRT_2;
                next(x, What::Embedded, What::Gelu(Gelu::Scaled)).filter(|_| is_root)
            }
            ("Gemm", [x, weight, bias]) => self.linear(flow(x)?, weight, bias, given),
            ("Sub", [base, residual]) => {
                let (base, residual) = (flow(base)?, flow(residual)?);
                let fits = residual.what == What::Force(Side::WithProduct) && residual.axes == base.axes;
                next(base, What::Force(Side::Touch), What::Difference).filter(|_| fits)
            }
            _ => None,
        }
    }

    /// Stores the value of an output. `None` if the name is taken, because it would then mean two tensors.
    fn give(&mut self, node: &'g NodeProto, output: usize, value: Value<'g>) -> Option<()> {
        match node.output.get(output).map(String::as_str) {
            None | Some("") => Some(()),
            Some(name) if self.constants.contains_key(name) => None,
            Some(name) => self.values.insert(name, value).is_none().then_some(()),
        }
    }
}

/// The nodes that an output depends on, in the graph's order. `None` if there are too many.
pub(in crate::model) fn needed(graph: &GraphProto) -> Option<Vec<&NodeProto>> {
    let mut wanted: BTreeSet<&str> = graph.output.iter().map(|output| output.name.as_str()).collect();
    let mut nodes = Vec::new();
    for node in graph.node.iter().rev() {
        if node.output.iter().any(|output| !output.is_empty() && wanted.contains(output.as_str())) {
            wanted.extend(node.input.iter().map(String::as_str));
            nodes.push(node);
            if nodes.len() > MAX_NODES {
                return None;
            }
        }
    }
    nodes.reverse();
    Some(nodes)
}

/// Shape and values of a float tensor that is not empty and is finite.
pub(in crate::model) fn floats(tensor: &TensorProto) -> Option<(Vec<usize>, Vec<f32>)> {
    (tensor.data_type == data_type::FLOAT).then_some(())?;
    let dims = tensor.dims.iter().map(|dim| usize::try_from(*dim).ok()).collect::<Option<Vec<_>>>()?;
    let values: Vec<f32> = match &tensor.raw_data {
        Some(raw) => raw.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
        None => tensor.float_data.clone(),
    };
    // `weights::check` guarantees that the number of values fits the shape.
    (!values.is_empty() && values.iter().all(|value| value.is_finite())).then_some((dims, values))
}

/// The value of a constant, if its type is supported.
fn constant(tensor: &TensorProto) -> Option<Value<'_>> {
    match tensor.data_type {
        data_type::FLOAT => Some(Value::Weights(tensor)),
        data_type::INT64 => Sizes::of(tensor).map(Value::Sizes),
        _ => None,
    }
}
