//! The paper's network found again in a graph, whoever exported it: its weights, and what they are for.
//!
//! Only the order and the shapes of nodes are looked at. Whether what was found computes the same is not decided here:
//! it is tried (`direct`).

use std::collections::BTreeMap;

use super::contract::Terms;
use super::onnx::{AttributeProto, GraphProto, NodeProto, TensorProto, data_type};

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

/// Looks for the network in a graph with these tensors.
pub(super) fn find(graph: &GraphProto, terms: &Terms) -> Option<Paper> {
    let view = View::of(graph);
    let (contract, tensors) = (&terms.contract, &terms.tensors);
    let convolutions: [Dense; 4] = view
        .all("Conv")
        .zip(DILATIONS)
        .map(|(node, dilation)| view.convolution(node, dilation))
        .collect::<Option<Vec<_>>>()?
        .try_into()
        .ok()?;
    let n_features = convolutions[0].dims[0];
    let inputs = [contract.n_taxels, n_features, n_features, n_features];
    let chained = convolutions.iter().zip(inputs).all(|(layer, n_in)| layer.dims == [n_features, n_in, TAPS]);
    let pose = match tensors.pose {
        Some(_) => Some(view.pose(contract.n_joints, n_features)?),
        None => None,
    };
    let head = view.head(&tensors.force, pose.is_some(), n_features)?;
    let counts = [("Conv", 4), ("MaxPool", 1), ("LayerNormalization", usize::from(pose.is_some()))];
    let as_expected = counts.iter().all(|(op, n)| view.all(op).count() == *n);
    (chained && as_expected).then_some(Paper { window: contract.window, convolutions, pose, head })
}

/// A graph by its names.
struct View<'a> {
    nodes: &'a [NodeProto],
    makers: BTreeMap<&'a str, &'a NodeProto>,
    constants: BTreeMap<&'a str, &'a TensorProto>,
}

impl<'a> View<'a> {
    fn of(graph: &'a GraphProto) -> Self {
        let mut constants: BTreeMap<&str, &TensorProto> =
            graph.initializer.iter().map(|tensor| (tensor.name.as_str(), tensor)).collect();
        let mut makers = BTreeMap::new();
        for node in &graph.node {
            let value = attribute(node, "value").and_then(|value| value.t.as_ref());
            for output in &node.output {
                makers.insert(output.as_str(), node);
                constants.extend(value.filter(|_| node.op_type == "Constant").map(|value| (output.as_str(), value)));
            }
        }
        View { nodes: &graph.node, makers, constants }
    }

    fn all(&self, op: &str) -> impl Iterator<Item = &'a NodeProto> {
        self.nodes.iter().filter(move |node| node.op_type == op)
    }

    /// Shape and values of a node's input, if it is a constant.
    fn constant(&self, node: &NodeProto, input: usize) -> Option<(Vec<usize>, Vec<f32>)> {
        let tensor = self.constants.get(node.input.get(input)?.as_str())?;
        let dims = tensor.dims.iter().map(|dim| usize::try_from(*dim).ok()).collect::<Option<_>>()?;
        Some((dims, floats(tensor)?))
    }

    fn convolution(&self, node: &NodeProto, dilation: usize) -> Option<Dense> {
        let last = |name: &str| attribute(node, name)?.ints.last().copied();
        let is_plain = attribute(node, "group").is_none_or(|group| group.i.unwrap_or(1) == 1)
            && last("strides").is_none_or(|stride| stride == 1)
            && last("dilations").unwrap_or(1) == dilation as i64
            && last("pads") == Some(dilation as i64);
        let (mut dims, weight) = self.constant(node, 1)?;
        if dims.len() == 4 && dims[2] == 1 {
            dims.remove(2);
        }
        let (_, bias) = self.constant(node, 2)?;
        (is_plain && dims.len() == 3 && bias.len() == dims[0]).then_some(Dense { dims, weight, bias })
    }

    fn pose(&self, n_joints: usize, n_features: usize) -> Option<Pose> {
        let norm = self.all("LayerNormalization").next()?;
        let (_, norm_gain) = self.constant(norm, 1)?;
        let (_, norm_shift) = self.constant(norm, 2)?;
        let norm_epsilon = attribute(norm, "epsilon").and_then(|epsilon| epsilon.f).unwrap_or(1e-5); // ONNX's default
        let product = self.all("MatMul").next()?;
        let (dims, weight) = self.constant(product, 1)?;
        let sum = self.nodes.iter().find(|node| node.op_type == "Add" && node.input.contains(&product.output[0]))?;
        let (_, bias) = (0..2).find_map(|input| self.constant(sum, input))?;
        let width = 2 * n_joints;
        let fits = norm_gain.len() == width
            && norm_shift.len() == width
            && dims == [width, n_features]
            && bias.len() == n_features;
        let mut layers = Vec::new();
        for node in self.all("LSTM") {
            layers.extend(self.cells(node)?);
        }
        let [a, b, c, d]: [Cells; 4] = layers.try_into().ok()?;
        let embedding = Dense { dims, weight, bias };
        let whole = [&a, &b, &c, &d].iter().all(|cells| {
            cells.hidden == a.hidden && cells.input.len() == 4 * cells.hidden * n_features && 2 * a.hidden == n_features
        });
        let lstm = [[a, b], [c, d]];
        (fits && whole).then_some(Pose { norm_gain, norm_shift, norm_epsilon, embedding, lstm })
    }

    /// The directions of an LSTM node, one after the other.
    fn cells(&self, node: &NodeProto) -> Option<Vec<Cells>> {
        let (dims, input) = self.constant(node, 1)?;
        let (recurrent_dims, recurrent) = self.constant(node, 2)?;
        let (_, bias) = self.constant(node, 3)?;
        let (&[directions, gates, width], &[_, _, hidden]) = (dims.as_slice(), recurrent_dims.as_slice()) else {
            return None;
        };
        let whole = gates == 4 * hidden
            && input.len() == directions * gates * width
            && recurrent.len() == directions * gates * hidden
            && bias.len() == directions * 2 * gates;
        let of = |direction: usize| {
            let part = |values: &[f32], n: usize| values[direction * n..(direction + 1) * n].to_vec();
            let both = part(&bias, 2 * gates);
            let bias = both[..gates].iter().zip(&both[gates..]).map(|(input, recurrent)| input + recurrent).collect();
            Cells { hidden, input: part(&input, gates * width), recurrent: part(&recurrent, gates * hidden), bias }
        };
        whole.then(|| (0..directions).map(of).collect())
    }

    fn head(&self, force: &str, has_pose: bool, n_features: usize) -> Option<Head> {
        let maker = self.maker(force)?;
        if maker.op_type == "Sub" && has_pose {
            let [base, residual] = [0, 1].map(|input| self.decoder(maker.input.get(input)?));
            let (base, residual) = (base?, residual?);
            let fits = base.n_in() == n_features && residual.n_in() == 3 * n_features;
            return fits.then_some(Head::Residual { base, residual });
        }
        let decoder = self.decoder(force)?;
        match (has_pose, decoder.n_in() == n_features, decoder.n_in() == 2 * n_features) {
            (false, true, _) => Some(Head::Touch(decoder)),
            (true, _, true) => Some(Head::Fused(decoder)),
            _ => None,
        }
    }

    /// What makes a tensor, changes of shape left out.
    fn maker(&self, name: &str) -> Option<&'a NodeProto> {
        let mut node = *self.makers.get(name)?;
        while ["Squeeze", "Reshape", "Flatten", "Identity"].contains(&node.op_type.as_str()) {
            node = self.makers.get(node.input.first()?.as_str())?;
        }
        Some(node)
    }

    fn decoder(&self, output: &str) -> Option<Decoder> {
        let last = self.maker(output)?;
        let relu = self.maker(last.input.first()?).filter(|node| node.op_type == "Relu")?;
        let first = self.maker(relu.input.first()?)?;
        Some(Decoder([self.linear(first)?, self.linear(last)?]))
    }

    fn linear(&self, node: &NodeProto) -> Option<Dense> {
        let one = |name: &str| attribute(node, name).and_then(|factor| factor.f).unwrap_or(1.0) == 1.0;
        let flag = |name: &str| attribute(node, name).and_then(|flag| flag.i).unwrap_or(0);
        let (dims, weight) = self.constant(node, 1)?;
        let (_, bias) = self.constant(node, 2)?;
        let is_plain =
            node.op_type == "Gemm" && one("alpha") && one("beta") && flag("transA") == 0 && flag("transB") == 1;
        (is_plain && dims.len() == 2 && bias.len() == dims[0]).then_some(Dense { dims, weight, bias })
    }
}

impl Decoder {
    fn n_in(&self) -> usize {
        self.0[0].dims[1]
    }
}

fn attribute<'n>(node: &'n NodeProto, name: &str) -> Option<&'n AttributeProto> {
    node.attribute.iter().find(|attribute| attribute.name == name)
}

/// The values of a float32 tensor; `weights::check` has seen to it that they fill its shape.
fn floats(tensor: &TensorProto) -> Option<Vec<f32>> {
    if tensor.data_type != data_type::FLOAT {
        return None;
    }
    Some(match &tensor.raw_data {
        Some(raw) => raw.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect(),
        None => tensor.float_data.clone(),
    })
}
