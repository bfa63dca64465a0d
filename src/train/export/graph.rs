//! The building blocks of the network, as nodes of an ONNX graph.

use super::super::architecture::{Architecture, LSTM_HIDDEN, N_FEATURES};
use crate::model::onnx::{AttributeProto, DimensionProto, Graph, GraphProto, NodeProto, ValueInfoProto};

impl Graph {
    /// One frame of a time-major tensor, keeping its axis.
    pub(super) fn slice_frame(&mut self, x: &str, output: &str, frame: i64) -> String {
        let bounds = [("starts", frame), ("ends", frame + 1), ("axes", 0)];
        let [starts, ends, axes] = bounds.map(|(what, value)| self.integers(&format!("{output}.{what}"), &[value]));
        self.node("Slice", &[x, &starts, &ends, &axes], output, vec![])
    }

    /// One frame of a time-major tensor, without its axis.
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
        let outputs = ["force", "force_base", "force_residual", "touch"].into_iter().filter(|name| made(name));
        let output = outputs.map(|name| {
            let width = if name == "touch" { 1 } else { architecture.n_axes() };
            ValueInfoProto::float32(name, vec![DimensionProto::named("N"), DimensionProto::fixed(width as i64)])
        });
        let output = output.collect();
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
