//! Builds a graph node by node.

use super::{AttributeProto, NodeProto, TensorProto};

/// Nodes and weights so far. Methods that add a node return the name of its output.
#[derive(Debug, Default)]
pub struct Graph {
    /// The nodes, in an order in which they can be run.
    pub nodes: Vec<NodeProto>,
    /// The weights and other constants.
    pub weights: Vec<TensorProto>,
}

impl Graph {
    /// Adds a node with one output.
    pub fn node(&mut self, op: &str, inputs: &[&str], output: &str, attributes: Vec<AttributeProto>) -> String {
        self.nodes.push(NodeProto::standard(op, inputs, &[output], attributes));
        output.to_string()
    }

    /// Adds float weights, row-major.
    pub fn weights(&mut self, name: &str, dims: &[i64], values: &[f32]) -> String {
        self.weights.push(TensorProto::float32(name, dims, values));
        name.to_string()
    }

    /// Adds a list of integers.
    pub fn integers(&mut self, name: &str, values: &[i64]) -> String {
        self.weights.push(TensorProto::int64(name, &[values.len() as i64], values));
        name.to_string()
    }

    /// Adds a float scalar.
    pub fn scalar(&mut self, name: &str, value: f32) -> String {
        self.weights(name, &[], &[value])
    }

    /// Adds a transpose.
    pub fn transpose(&mut self, x: &str, output: &str, order: &[i64]) -> String {
        self.node("Transpose", &[x], output, vec![AttributeProto::ints("perm", order)])
    }

    /// Adds a concatenation along an axis.
    pub fn concat(&mut self, output: &str, inputs: &[&str], axis: i64) -> String {
        self.node("Concat", inputs, output, vec![AttributeProto::int("axis", axis)])
    }

    /// Adds an axis of length one.
    pub fn unsqueeze(&mut self, x: &str, output: &str, axis: i64) -> String {
        let axes = self.integers(&format!("{output}.axes"), &[axis]);
        self.node("Unsqueeze", &[x, &axes], output, vec![])
    }

    /// Removes an axis of length one.
    pub fn squeeze(&mut self, x: &str, output: &str, axis: i64) -> String {
        let axes = self.integers(&format!("{output}.axes"), &[axis]);
        self.node("Squeeze", &[x, &axes], output, vec![])
    }

    /// Merges all axes after the first one.
    pub fn flatten(&mut self, x: &str, output: &str) -> String {
        self.node("Flatten", &[x], output, vec![AttributeProto::int("axis", 1)])
    }

    /// Adds a reshape. A 0 in `shape` keeps that size.
    pub fn reshape(&mut self, x: &str, output: &str, shape: &[i64]) -> String {
        let shape = self.integers(&format!("{output}.shape"), shape);
        self.node("Reshape", &[x, &shape], output, vec![])
    }

    /// Adds `x` times the transpose of `weight`, plus `bias`.
    pub fn gemm(&mut self, x: &str, weight: &str, bias: &str, output: &str) -> String {
        self.node("Gemm", &[x, weight, bias], output, vec![AttributeProto::int("transB", 1)])
    }

    /// Adds a layer normalization over the last axis.
    pub fn layer_norm(&mut self, x: &str, gain: &str, shift: &str, epsilon: f32, output: &str) -> String {
        let attributes = vec![AttributeProto::int("axis", -1), AttributeProto::float("epsilon", epsilon)];
        self.node("LayerNormalization", &[x, gain, shift], output, attributes)
    }

    /// Adds a GELU: x / 2 * (1 + erf(x / sqrt 2)).
    pub fn gelu(&mut self, x: &str, output: &str) -> String {
        let [root, one, half] = [("root", std::f32::consts::FRAC_1_SQRT_2), ("one", 1.0), ("half", 0.5)]
            .map(|(what, value)| self.scalar(&format!("{output}.{what}"), value));
        let scaled = self.node("Mul", &[x, &root], &format!("{output}.scaled"), vec![]);
        let erf = self.node("Erf", &[&scaled], &format!("{output}.erf"), vec![]);
        let gate = self.node("Add", &[&erf, &one], &format!("{output}.gate"), vec![]);
        let gated = self.node("Mul", &[x, &gate], &format!("{output}.gated"), vec![]);
        self.node("Mul", &[&gated, &half], output, vec![])
    }
}
