//! An ONNX graph that grows node by node.

use super::super::architecture::{Architecture, LSTM_HIDDEN, N_FEATURES};
use super::super::network::NORM_EPSILON;
use crate::model::onnx::{AttributeProto, DimensionProto, GraphProto, NodeProto, TensorProto, ValueInfoProto};

/// Nodes and weights so far. Methods that add a node return the name of what it makes.
#[derive(Debug, Default)]
pub(super) struct Graph {
    nodes: Vec<NodeProto>,
    weights: Vec<TensorProto>,
}

impl Graph {
    pub(super) fn node(&mut self, op: &str, inputs: &[&str], output: &str, attributes: Vec<AttributeProto>) -> String {
        self.nodes.push(NodeProto::standard(op, inputs, &[output], attributes));
        output.to_string()
    }

    pub(super) fn weights(&mut self, name: &str, dims: &[i64], values: &[f32]) -> String {
        self.weights.push(TensorProto::float32(name, dims, values));
        name.to_string()
    }

    fn integers(&mut self, name: &str, values: &[i64]) -> String {
        self.weights.push(TensorProto::int64(name, &[values.len() as i64], values));
        name.to_string()
    }

    fn scalar(&mut self, name: &str, value: f32) -> String {
        self.weights(name, &[], &[value])
    }

    pub(super) fn transpose(&mut self, x: &str, output: &str, order: &[i64]) -> String {
        self.node("Transpose", &[x], output, vec![AttributeProto::ints("perm", order)])
    }

    pub(super) fn concat(&mut self, output: &str, inputs: &[&str], axis: i64) -> String {
        self.node("Concat", inputs, output, vec![AttributeProto::int("axis", axis)])
    }

    pub(super) fn unsqueeze(&mut self, x: &str, output: &str, axis: i64) -> String {
        let axes = self.integers(&format!("{output}.axes"), &[axis]);
        self.node("Unsqueeze", &[x, &axes], output, vec![])
    }

    pub(super) fn squeeze(&mut self, x: &str, output: &str, axis: i64) -> String {
        let axes = self.integers(&format!("{output}.axes"), &[axis]);
        self.node("Squeeze", &[x, &axes], output, vec![])
    }

    pub(super) fn flatten(&mut self, x: &str, output: &str) -> String {
        self.node("Flatten", &[x], output, vec![AttributeProto::int("axis", 1)])
    }

    pub(super) fn reshape(&mut self, x: &str, output: &str, shape: &[i64]) -> String {
        let shape = self.integers(&format!("{output}.shape"), shape);
        self.node("Reshape", &[x, &shape], output, vec![])
    }

    /// One frame of a time-major tensor, its axis kept.
    pub(super) fn slice_frame(&mut self, x: &str, output: &str, frame: i64) -> String {
        let bounds = [("starts", frame), ("ends", frame + 1), ("axes", 0)];
        let [starts, ends, axes] = bounds.map(|(what, value)| self.integers(&format!("{output}.{what}"), &[value]));
        self.node("Slice", &[x, &starts, &ends, &axes], output, vec![])
    }

    /// One frame of a time-major tensor, its axis gone.
    pub(super) fn gather_frame(&mut self, x: &str, output: &str, frame: i64) -> String {
        let slice = self.slice_frame(x, &format!("{output}.frame"), frame);
        self.squeeze(&slice, output, 0)
    }

    /// A convolution with three taps over the last axis that keeps its length, over `[N, C, L]` or `[N, C, 1, L]`.
    pub(super) fn conv(
        &mut self,
        x: &str,
        weight: &str,
        bias: &str,
        output: &str,
        dilation: i64,
        two_dimensional: bool,
    ) -> String {
        let axes = |last: i64, other: i64| if two_dimensional { vec![other, last] } else { vec![last] };
        let pads = axes(dilation, 0).repeat(2);
        let attributes = vec![
            AttributeProto::ints("dilations", &axes(dilation, 1)),
            AttributeProto::int("group", 1),
            AttributeProto::ints("kernel_shape", &axes(3, 1)),
            AttributeProto::ints("pads", &pads),
            AttributeProto::ints("strides", &axes(1, 1)),
        ];
        self.node("Conv", &[x, weight, bias], output, attributes)
    }

    pub(super) fn max_pool(&mut self, x: &str, output: &str, kernel: &[i64]) -> String {
        let attributes = vec![AttributeProto::ints("kernel_shape", kernel), AttributeProto::ints("strides", kernel)];
        self.node("MaxPool", &[x], output, attributes)
    }

    pub(super) fn gemm(&mut self, x: &str, weight: &str, bias: &str, output: &str) -> String {
        self.node("Gemm", &[x, weight, bias], output, vec![AttributeProto::int("transB", 1)])
    }

    pub(super) fn layer_norm(&mut self, x: &str, gain: &str, shift: &str, output: &str) -> String {
        let attributes = vec![AttributeProto::int("axis", -1), AttributeProto::float("epsilon", NORM_EPSILON)];
        self.node("LayerNormalization", &[x, gain, shift], output, attributes)
    }

    /// x / 2 * (1 + erf(x / sqrt 2)).
    pub(super) fn gelu(&mut self, x: &str, output: &str) -> String {
        let [root, one, half] = [("root", std::f32::consts::FRAC_1_SQRT_2), ("one", 1.0), ("half", 0.5)]
            .map(|(what, value)| self.scalar(&format!("{output}.{what}"), value));
        let scaled = self.node("Mul", &[x, &root], &format!("{output}.scaled"), vec![]);
        let erf = self.node("Erf", &[&scaled], &format!("{output}.erf"), vec![]);
        let gate = self.node("Add", &[&erf, &one], &format!("{output}.gate"), vec![]);
        let gated = self.node("Mul", &[x, &gate], &format!("{output}.gated"), vec![]);
        self.node("Mul", &[&gated, &half], output, vec![])
    }

    /// Weights, recurrent weights and biases of an LSTM, each with its directions one after the other.
    pub(super) fn lstm_weights(&mut self, name: &str, directions: i64, values: [&[f32]; 3]) -> [String; 3] {
        let (gates, hidden) = (4 * LSTM_HIDDEN as i64, LSTM_HIDDEN as i64);
        let [input, recurrent, bias] = values;
        [
            self.weights(&format!("{name}.W"), &[directions, gates, N_FEATURES as i64], input),
            self.weights(&format!("{name}.R"), &[directions, gates, hidden], recurrent),
            self.weights(&format!("{name}.B"), &[directions, 2 * gates], bias),
        ]
    }

    /// An LSTM from a zero state over a time-major tensor. `outputs`: all states, and the last one; either may be empty.
    pub(super) fn lstm(&mut self, x: &str, weights: &[String; 3], direction: &str, outputs: [&str; 2]) {
        let [input, recurrent, bias] = weights.each_ref().map(String::as_str);
        let attributes = vec![
            AttributeProto::string("direction", direction),
            AttributeProto::int("hidden_size", LSTM_HIDDEN as i64),
        ];
        let used = if outputs[1].is_empty() { &outputs[..1] } else { &outputs[..] };
        let mut node = NodeProto::standard("LSTM", &[x, input, recurrent, bias], used, attributes);
        node.name = format!("LSTM_{}", if outputs[0].is_empty() { outputs[1] } else { outputs[0] });
        self.nodes.push(node);
    }

    /// The graph with the contract's inputs and outputs.
    pub(super) fn finish(self, architecture: &Architecture) -> GraphProto {
        let Architecture { kind, window, n_taxels, n_joints, .. } = *architecture;
        let input = |name: &str, width: usize| {
            let dims =
                [DimensionProto::named("N"), DimensionProto::fixed(window as i64), DimensionProto::fixed(width as i64)];
            ValueInfoProto::float32(name, dims.to_vec())
        };
        let made = |name: &str| self.nodes.iter().any(|node| node.output.iter().any(|output| output == name));
        let outputs = ["force", "force_base", "force_residual"].into_iter().filter(|name| made(name));
        let dims = vec![DimensionProto::named("N"), DimensionProto::fixed(1)];
        let output = outputs.map(|name| ValueInfoProto::float32(name, dims.clone())).collect();
        let mut inputs = vec![input("tactile", n_taxels)];
        if kind.uses_pose() {
            inputs.push(input("pose", n_joints));
        }
        GraphProto {
            name: "pose_aware_force".to_string(),
            input: inputs,
            output,
            node: self.nodes,
            initializer: self.weights,
            ..Default::default()
        }
    }
}
