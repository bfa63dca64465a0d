//! Recognizes the causal network of adaptive models in an ONNX graph, and reads its weights and the frames that each
//! layer sees.
//!
//! The network is a chain of dilated convolutions over time without padding, each with a ReLU. After the first one,
//! each adds its own input to its output. Then one decoder gives the force, and one the probability of touch. The input
//! is the taxels twice: divided by a scale, and divided by a finer scale and squashed, `x / (1 + |x|)`. Every node is
//! followed from its inputs to its outputs. The search ends with an error at a node that the network doesn't have.
//!
//! # Source
//! `train::network::causal`, as `train::export` writes it.

use std::collections::BTreeMap;

use super::contract::Terms;
use super::error::one_line;
use super::onnx::{GraphProto, ModelProto, NodeProto, TensorProto};
use super::paper::attributes::Attributes;
use super::paper::flow::Sizes;
use super::paper::walk::{floats, is_standard, needed};
use super::paper::{Decoder, Dense, TAPS, check_operators};

/// Weights of the network.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Causal {
    pub(super) window: usize,
    pub(super) n_columns: usize,
    /// Divisors of the taxels: of the linear ones, and of those that are squashed.
    pub(super) scales: [f32; 2],
    pub(super) layers: Vec<Layer>,
    pub(super) force: Decoder,
    pub(super) touch: Decoder,
}

/// Weights of a convolution with a ReLU.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layer {
    /// `[outputs, inputs, taps]`
    pub(super) dense: Dense,
    pub(super) dilation: usize,
    /// True if the layer's input is added to its output.
    pub(super) adds_input: bool,
}

impl Causal {
    /// Number of frames that a force depends on.
    pub(super) fn n_seen(&self) -> usize {
        1 + self.layers.iter().map(|layer| (TAPS - 1) * layer.dilation).sum::<usize>()
    }
}

/// Stage of the network that a tensor is the output of. The first axis of all tensors is the window.
#[derive(Debug, Clone, Copy, PartialEq)]
enum What {
    /// `[N, frames, taxels]`
    Taxels,
    /// `[N, taxels, frames]`; the following stages, up to `Layer`, have the same axes.
    Channels,
    Scaled(f32),
    Size(f32),
    Bound(f32),
    Squashed(f32),
    /// `[N, 2 taxels, frames]`: linear and squashed taxels.
    Both([f32; 2]),
    /// Output of the convolution of a layer.
    Convolved(usize),
    Rectified(usize),
    /// Output of a layer.
    Layer(usize),
    /// Last frames of a layer's output.
    Kept(usize),
    /// `[N, channels]`
    Features,
    /// `[N, hidden]`, in the decoder whose first weight has this index.
    Hidden(usize),
    Active(usize),
    /// `[N, 1]`
    Decoded(usize),
    Probability(usize),
}

/// A tensor with its number of frames.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Value {
    what: What,
    frames: usize,
}

struct Walk<'g> {
    n_columns: usize,
    constants: BTreeMap<&'g str, &'g TensorProto>,
    values: BTreeMap<&'g str, Value>,
    scales: Option<[f32; 2]>,
    layers: Vec<Layer>,
    decoders: Vec<[Option<Dense>; 2]>,
}

/// Looks for the network in a model with these tensors.
///
/// # Errors
/// The part of the model that the network doesn't have.
pub(super) fn find(model: &ModelProto, terms: &Terms) -> Result<Causal, String> {
    check_operators(model)?;
    let graph = model.graph.as_ref().ok_or("it holds no graph")?;
    let tensors = &terms.tensors;
    let Some(touch) = &tensors.touch else { return Err("it has no output for touch".to_owned()) };
    if tensors.pose.is_some() || tensors.base.is_some() || tensors.residual.is_some() {
        return Err("it has tensors for pose".to_owned());
    }
    let walk = Walk::through(graph, terms)?;
    walk.network(&tensors.force, touch, terms.contract.window.get())
        .ok_or_else(|| "it is the causal network in part alone".to_owned())
}

impl<'g> Walk<'g> {
    fn through(graph: &'g GraphProto, terms: &'g Terms) -> Result<Self, String> {
        let constants: BTreeMap<_, _> = graph.initializer.iter().map(|tensor| (tensor.name.as_str(), tensor)).collect();
        if constants.len() != graph.initializer.len() {
            return Err("two of its tensors have the same name".to_owned());
        }
        let taxels = Value { what: What::Taxels, frames: terms.contract.window.get() };
        let mut walk = Walk {
            n_columns: terms.contract.n_columns(),
            constants,
            values: BTreeMap::from([(terms.tensors.tactile.as_str(), taxels)]),
            scales: None,
            layers: Vec::new(),
            decoders: Vec::new(),
        };
        for node in needed(graph).ok_or("it has too many nodes")? {
            walk.step(node).ok_or_else(|| {
                let (name, op) = (one_line(&node.name), one_line(&node.op_type));
                format!("node {name} ({op}) is not the causal network's, or not there, or not so")
            })?;
        }
        Ok(walk)
    }

    fn step(&mut self, node: &'g NodeProto) -> Option<()> {
        is_standard(&node.domain).then_some(())?;
        let mut given = Attributes::of(node)?;
        let names: Vec<&str> = node.input.iter().map(String::as_str).collect();
        let value = self.value_of(&node.op_type, &names, &mut given)?;
        let [output] = node.output.as_slice() else { return None };
        let is_new = !self.constants.contains_key(output.as_str()) && self.values.insert(output, value).is_none();
        (given.all_read() && is_new).then_some(())
    }

    fn value_of(&mut self, op: &str, names: &[&str], given: &mut Attributes<'g>) -> Option<Value> {
        let becomes = |value: Value, what: What| Some(Value { what, ..value });
        match (op, names) {
            ("Identity", [x]) => self.flow(x),
            ("Slice", [x, starts, ends, rest @ ..]) => self.slice(x, starts, ends, rest),
            ("Transpose", [x]) => {
                let x = self.flow(x)?;
                let turned = given.ints("perm")?? == [0, 2, 1] && x.what == What::Taxels;
                turned.then_some(Value { what: What::Channels, ..x })
            }
            ("Div", [x, by]) => {
                let x = self.flow(x)?;
                match (x.what, self.flow(by).map(|by| by.what)) {
                    (What::Channels, None) => becomes(x, What::Scaled(self.number(by).filter(|by| *by > 0.0)?)),
                    (What::Scaled(scale), Some(What::Bound(of))) if of == scale => becomes(x, What::Squashed(scale)),
                    _ => None,
                }
            }
            ("Abs", [x]) => match self.flow(x)? {
                value @ Value { what: What::Scaled(scale), .. } => becomes(value, What::Size(scale)),
                _ => None,
            },
            ("Softsign", [x]) => match self.flow(x)? {
                value @ Value { what: What::Scaled(scale), .. } => becomes(value, What::Squashed(scale)),
                _ => None,
            },
            ("Concat", [coarse, fine]) => {
                let (coarse, fine) = (self.flow(coarse)?, self.flow(fine)?);
                match (coarse.what, fine.what) {
                    (What::Scaled(scale), What::Squashed(squashed))
                        if given.is("axis", 1) && coarse.frames == fine.frames =>
                    {
                        becomes(coarse, What::Both([scale, squashed]))
                    }
                    _ => None,
                }
            }
            ("Conv", [x, weight, bias]) => self.convolution(x, weight, bias, given),
            ("Relu", [x]) => match self.flow(x)? {
                value @ Value { what: What::Convolved(layer), .. } => becomes(value, What::Rectified(layer)),
                value @ Value { what: What::Hidden(decoder), .. } => becomes(value, What::Active(decoder)),
                _ => None,
            },
            ("Add", [a, b]) => self.sum(a, b),
            ("Flatten", [x]) => {
                let x = self.newest(x)?;
                let is_last = x.frames == 1 && given.is("axis", 1);
                is_last.then_some(Value { what: What::Features, ..x })
            }
            ("Gemm", [x, weight, bias]) => self.linear(x, weight, bias, given),
            ("Sigmoid", [x]) => match self.flow(x)? {
                value @ Value { what: What::Decoded(decoder), .. } => becomes(value, What::Probability(decoder)),
                _ => None,
            },
            _ => None,
        }
    }

    fn flow(&self, name: &str) -> Option<Value> {
        self.values.get(name).copied()
    }

    /// Index and value of a tensor that is the output of a layer.
    fn layer(&self, name: &str) -> Option<(usize, Value)> {
        let value = self.flow(name)?;
        let layer = match value.what {
            What::Rectified(layer) if !self.layers.get(layer)?.adds_input => layer,
            What::Layer(layer) => layer,
            _ => return None,
        };
        Some((layer, Value { what: What::Layer(layer), ..value }))
    }

    /// The tensor, if it is the output of the newest layer.
    fn newest(&self, name: &str) -> Option<Value> {
        let (layer, value) = self.layer(name)?;
        (layer + 1 == self.layers.len()).then_some(value)
    }

    fn weights(&self, name: &str) -> Option<(Vec<usize>, Vec<f32>)> {
        floats(self.constants.get(name)?)
    }

    /// A single float constant.
    fn number(&self, name: &str) -> Option<f32> {
        let (dims, values) = self.weights(name)?;
        (dims.len() <= 1 && values.len() == 1).then(|| values[0])
    }

    /// A single integer constant.
    fn integer(&self, name: &str) -> Option<i64> {
        match Sizes::of(self.constants.get(name)?)?.constants()?.as_slice() {
            [value] => Some(*value),
            _ => None,
        }
    }

    /// The last frames of a tensor.
    fn slice(&self, x: &str, starts: &str, ends: &str, rest: &[&str]) -> Option<Value> {
        let (start, end) = (self.integer(starts)?, self.integer(ends)?);
        let (axis, step) = match rest {
            [axis] => (self.integer(axis)?, 1),
            [axis, step] => (self.integer(axis)?, self.integer(step)?),
            _ => return None,
        };
        let value = self.layer(x).map(|(_, value)| value).or_else(|| self.flow(x))?;
        let frames_axis = if value.what == What::Taxels { 1 } else { 2 };
        let frames = i64::try_from(value.frames).ok()?;
        let start = if start < 0 { start + frames } else { start };
        let is_last = (0..frames).contains(&start) && end >= frames;
        let what = match value.what {
            What::Taxels => What::Taxels,
            What::Channels => What::Channels,
            What::Layer(layer) => What::Kept(layer),
            _ => return None,
        };
        let is_whole = [frames_axis, frames_axis - 3].contains(&axis) && step == 1 && is_last;
        is_whole.then_some(Value { what, frames: usize::try_from(frames - start).ok()? })
    }

    fn convolution(&mut self, x: &str, weight: &str, bias: &str, given: &mut Attributes<'g>) -> Option<Value> {
        let x = self.newest(x).or_else(|| self.flow(x))?;
        let n_in = match x.what {
            What::Both(scales) if self.layers.is_empty() => {
                self.scales = Some(scales);
                2 * self.n_columns
            }
            What::Layer(_) => self.layers.last()?.dense.dims[0],
            _ => return None,
        };
        let ((dims, weight), (bias_dims, bias)) = (self.weights(weight)?, self.weights(bias)?);
        let n_out = *dims.first()?;
        (dims == [n_out, n_in, TAPS] && bias_dims == [n_out]).then_some(())?;
        let is_plain = given.is("group", 1)
            && given.are("kernel_shape", &[TAPS as i64])
            && given.are("pads", &[0, 0])
            && given.are("strides", &[1])
            && [&b"NOTSET"[..], b"VALID"].contains(&given.text("auto_pad", "NOTSET")?);
        let dilation = match given.ints("dilations")? {
            None => 1,
            Some([dilation]) => usize::try_from(*dilation).ok()?,
            Some(_) => return None,
        };
        let reach = (TAPS - 1).checked_mul(dilation)?;
        (is_plain && dilation > 0).then_some(())?;
        let frames = x.frames.checked_sub(reach).filter(|frames| *frames > 0)?;
        self.layers.push(Layer { dense: Dense { dims, weight, bias }, dilation, adds_input: false });
        Some(Value { what: What::Convolved(self.layers.len() - 1), frames })
    }

    /// Output of a convolution plus the matching frames of its input, or a size plus 1.
    fn sum(&mut self, a: &str, b: &str) -> Option<Value> {
        let (a, b) = match (self.flow(a), self.flow(b)) {
            (Some(a), Some(b)) => (a, b),
            (Some(value), None) => return self.bound(value, b),
            (None, Some(value)) => return self.bound(value, a),
            (None, None) => return None,
        };
        let (layer, input) = match (a.what, b.what) {
            (What::Rectified(layer), What::Kept(input)) | (What::Kept(input), What::Rectified(layer)) => (layer, input),
            _ => return None,
        };
        let is_own = input + 1 == layer && layer + 1 == self.layers.len() && a.frames == b.frames;
        let width = |layer: &Layer| layer.dense.dims[0];
        let same_width = width(self.layers.get(input)?) == width(self.layers.get(layer)?);
        (is_own && same_width).then_some(())?;
        self.layers.get_mut(layer)?.adds_input = true;
        Some(Value { what: What::Layer(layer), ..a })
    }

    fn bound(&self, value: Value, one: &str) -> Option<Value> {
        match value.what {
            What::Size(scale) if self.number(one)? == 1.0 => Some(Value { what: What::Bound(scale), ..value }),
            _ => None,
        }
    }

    fn linear(&mut self, x: &str, weight: &str, bias: &str, given: &mut Attributes<'g>) -> Option<Value> {
        let x = self.flow(x)?;
        let is_plain = given.float("alpha", 1.0)? == 1.0
            && given.float("beta", 1.0)? == 1.0
            && given.is("transA", 0)
            && given.int("transB", 0)? == 1;
        let ((dims, weight), (bias_dims, bias)) = (self.weights(weight)?, self.weights(bias)?);
        let [n_out, n_in] = dims.as_slice() else { return None };
        (is_plain && bias_dims == [*n_out]).then_some(())?;
        let dense = Dense { dims: dims.clone(), weight, bias };
        match x.what {
            What::Features if *n_in == self.layers.last()?.dense.dims[0] => {
                self.decoders.push([Some(dense), None]);
                Some(Value { what: What::Hidden(self.decoders.len() - 1), ..x })
            }
            What::Active(decoder) => {
                let [hidden, last] = self.decoders.get_mut(decoder)?;
                let fits = hidden.as_ref().is_some_and(|hidden| hidden.dims[0] == *n_in) && *n_out == 1;
                (fits && last.is_none()).then_some(())?;
                *last = Some(dense);
                Some(Value { what: What::Decoded(decoder), ..x })
            }
            _ => None,
        }
    }

    fn network(mut self, force: &str, touch: &str, window: usize) -> Option<Causal> {
        let (What::Decoded(force), What::Probability(touch)) = (self.flow(force)?.what, self.flow(touch)?.what) else {
            return None;
        };
        (force != touch && self.decoders.len() == 2).then_some(())?;
        let mut decoder = |idx: usize| {
            let [hidden, last] = self.decoders.get_mut(idx)?;
            Some(Decoder([hidden.take()?, last.take()?]))
        };
        let (force, touch) = (decoder(force)?, decoder(touch)?);
        let causal =
            Causal { window, n_columns: self.n_columns, scales: self.scales?, layers: self.layers, force, touch };
        (causal.n_seen() <= window).then_some(causal)
    }
}
