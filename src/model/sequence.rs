//! The paper's network over a stretch of frames: what overlapping windows share is computed once.
//!
//! A stretch of `S` frames holds `N = S - L + 1` windows of `L`. Both are fixed, because ONNX Runtime plans its memory in a
//! moment where shapes are known, and takes seconds where they are not. Everything that depends on a frame alone is computed a
//! frame: encoding of the pose, input projections of the first LSTM layer, taps of the convolutions, and the interior
//! of the convolutions, which is the same in every window that has it. What a window has of its own is computed a
//! window: the few frames of every convolution that see its zero padding, and the recurrences, which start anew in it.
//! Those run over all windows of the stretch at once: window `i` at its frame `k` reads row `i + k`.

use std::collections::BTreeSet;

use super::onnx::{AttributeProto, DimensionProto, Graph, GraphProto, Message, ModelProto, NodeProto, ValueInfoProto};
use super::paper::{Cells, DILATIONS, Decoder, Dense, Head, Paper, Pose, TAPS};

/// Operator set of the graph: loads everywhere.
const OPSET: i64 = 17;

/// Frames at each end of a window whose last convolution sees the padding: the sum of all dilations.
const REACH: usize = DILATIONS[0] + DILATIONS[1] + DILATIONS[2] + DILATIONS[3];

/// Names of the graph's tensors.
pub(super) const TACTILE: &str = "tactile";
pub(super) const POSE: &str = "pose";
pub(super) const FORCE: &str = "force";
pub(super) const BASE: &str = "force_base";

/// Whether windows are long enough to have an interior.
pub(super) fn fits(paper: &Paper) -> bool {
    paper.window > 2 * REACH
}

/// The bytes of an ONNX file that takes a stretch of `n_windows`, `[1, S, T]` and `[1, S, P]`, and gives their forces,
/// `[N, 1]`.
///
/// The caller has asked [`fits`].
pub(super) fn model(paper: &Paper, n_windows: usize, with_base: bool) -> Vec<u8> {
    let mut writer = Writer { window: paper.window, graph: Graph::default(), n_made: 0, lists: BTreeSet::new() };
    let tactile = writer.squeezed(TACTILE);
    let touch = writer.touch(&tactile, &paper.convolutions);
    let pose = paper.pose.as_ref().map(|pose| {
        let frames = writer.squeezed(POSE);
        let embedded = writer.embedded(&frames, pose);
        writer.recurrent(&embedded, &pose.lstm)
    });
    let mut outputs = vec![FORCE];
    match (&paper.head, pose) {
        (Head::Residual { base, residual }, Some(pose)) => {
            let base = writer.decoded(&touch, base);
            let product = writer.op("Mul", &[&touch, &pose]);
            let fused = writer.joined(&[&touch, &pose, &product]);
            let residual = writer.decoded(&fused, residual);
            writer.graph.node("Sub", &[&base, &residual], FORCE, vec![]);
            if with_base {
                writer.graph.node("Identity", &[&base], BASE, vec![]);
                outputs.push(BASE);
            }
        }
        (Head::Fused(decoder), Some(pose)) => {
            let fused = writer.joined(&[&touch, &pose]);
            let force = writer.decoded(&fused, decoder);
            writer.graph.node("Identity", &[&force], FORCE, vec![]);
        }
        (Head::Touch(decoder) | Head::Fused(decoder) | Head::Residual { base: decoder, .. }, _) => {
            let force = writer.decoded(&touch, decoder);
            writer.graph.node("Identity", &[&force], FORCE, vec![]);
        }
    }
    writer.finish(paper, n_windows, &outputs)
}

struct Writer {
    window: usize,
    graph: Graph,
    n_made: usize,
    /// Lists of integers that are there already.
    lists: BTreeSet<String>,
}

/// A layer of a convolution, ready to be read window by window.
struct Layer {
    /// `[S - 2 lead, C]`: the frames that no padding reaches.
    interior: String,
    /// Frames that are missing at each end of the stretch.
    lead: usize,
    /// `[N, C]` each: the frames at the ends of every window that its padding reaches, the first ones and the last ones.
    edges: [Vec<String>; 2],
}

impl Writer {
    fn name(&mut self) -> String {
        self.n_made += 1;
        format!("x{}", self.n_made)
    }

    fn op(&mut self, op: &str, inputs: &[&str]) -> String {
        let output = self.name();
        self.graph.node(op, inputs, &output, vec![])
    }

    fn weights(&mut self, dims: &[usize], values: &[f32]) -> String {
        let (name, dims) = (self.name(), dims.iter().map(|dim| *dim as i64).collect::<Vec<_>>());
        self.graph.weights(&name, &dims, values)
    }

    fn integers(&mut self, values: &[i64]) -> String {
        let name = format!("i{}", values.iter().map(|value| format!("_{value}")).collect::<String>());
        match self.lists.insert(name.clone()) {
            true => self.graph.integers(&name, values),
            false => name,
        }
    }

    /// `[1, S, C]` to `[S, C]`.
    fn squeezed(&mut self, input: &str) -> String {
        let axis = self.integers(&[0]);
        self.op("Squeeze", &[input, &axis])
    }

    /// Rows from `from` on, but for the last `left_out`.
    fn rows(&mut self, x: &str, from: usize, left_out: usize) -> String {
        let end = if left_out == 0 { i64::from(i32::MAX) } else { -(left_out as i64) };
        let [from, end, axis] = [from as i64, end, 0].map(|value| self.integers(&[value]));
        self.op("Slice", &[x, &from, &end, &axis])
    }

    /// Columns one after the other, so many each.
    fn columns(&mut self, x: &str, widths: &[usize]) -> Vec<String> {
        let sizes = self.integers(&widths.iter().map(|width| *width as i64).collect::<Vec<_>>());
        let outputs: Vec<String> = widths.iter().map(|_| self.name()).collect();
        let names: Vec<&str> = outputs.iter().map(String::as_str).collect();
        let axis = vec![AttributeProto::int("axis", 1)];
        self.graph.nodes.push(NodeProto::standard("Split", &[x, &sizes], &names, axis));
        outputs
    }

    fn joined(&mut self, parts: &[&str]) -> String {
        let output = self.name();
        self.graph.concat(&output, parts, 1)
    }

    fn sum(&mut self, parts: &[String]) -> String {
        let (first, rest) = parts.split_first().expect("a sum has parts");
        rest.iter().fold(first.clone(), |sum, part| self.op("Add", &[&sum, part]))
    }

    fn dense(&mut self, x: &str, layer: &Dense) -> String {
        let weight = self.weights(&layer.dims, &layer.weight);
        let bias = self.weights(&[layer.bias.len()], &layer.bias);
        let output = self.name();
        self.graph.gemm(x, &weight, &bias, &output)
    }

    fn decoded(&mut self, x: &str, decoder: &Decoder) -> String {
        let hidden = self.dense(x, &decoder.0[0]);
        let hidden = self.op("Relu", &[&hidden]);
        self.dense(&hidden, &decoder.0[1])
    }

    /// `[N, C]`: frame `at` of every window, out of rows that miss `lead` frames at each end of the stretch.
    fn frame(&mut self, rows: &str, at: usize, lead: usize) -> String {
        self.rows(rows, at - lead, self.window - 1 - lead - at)
    }

    /// The convolutions and the maximum over every window: `[N, C]`.
    fn touch(&mut self, tactile: &str, convolutions: &[Dense; 4]) -> String {
        let mut layer = Layer { interior: tactile.to_owned(), lead: 0, edges: [Vec::new(), Vec::new()] };
        for (convolution, dilation) in convolutions.iter().zip(DILATIONS) {
            layer = self.convolved(&layer, convolution, dilation);
        }
        let mut highest = self.largest_in(&layer.interior, self.window - 2 * layer.lead);
        for edge in layer.edges.iter().flatten() {
            highest = self.op("Max", &[&highest, edge]);
        }
        highest
    }

    /// The maximum over `span` rows from each row on, by doubling.
    fn largest_in(&mut self, rows: &str, span: usize) -> String {
        let (mut highest, mut covered) = (rows.to_owned(), 1);
        while 2 * covered <= span {
            let [earlier, later] = [self.rows(&highest, 0, covered), self.rows(&highest, covered, 0)];
            highest = self.op("Max", &[&earlier, &later]);
            covered *= 2;
        }
        match span - covered {
            0 => highest,
            rest => {
                let [earlier, later] = [self.rows(&highest, 0, rest), self.rows(&highest, rest, 0)];
                self.op("Max", &[&earlier, &later])
            }
        }
    }

    fn convolved(&mut self, x: &Layer, convolution: &Dense, dilation: usize) -> Layer {
        let &[n_out, n_in, _] = convolution.dims.as_slice() else { unreachable!("a convolution has three dimensions") };
        let bias = self.weights(&[n_out], &convolution.bias);
        // Inputs first: `[n_in, n_out]` a tap.
        let of_tap =
            |tap: usize| move |idx: usize| convolution.weight[((idx % n_out) * n_in + idx / n_out) * TAPS + tap];
        let taps: [Vec<f32>; TAPS] = std::array::from_fn(|tap| (0..n_in * n_out).map(of_tap(tap)).collect());
        let side_by_side = |order: &[usize]| -> Vec<f32> {
            (0..n_in)
                .flat_map(|row| order.iter().flat_map(move |tap| (0..n_out).map(move |c| (*tap, row * n_out + c))))
                .map(|(tap, idx)| taps[tap][idx])
                .collect()
        };
        let weight = self.weights(&[n_in, TAPS * n_out], &side_by_side(&[0, 1, 2]));
        let product = self.op("MatMul", &[&x.interior, &weight]);
        let products = self.columns(&product, &[n_out; TAPS]);

        // What the taps make of frames that the padding had reached: at the begin of a window only the middle and the
        // first tap ever look back at them, at its end the middle and the last.
        let mut of_edges: [Vec<[String; 2]>; 2] = [Vec::new(), Vec::new()];
        for (side, other_tap) in [(0, 0), (1, 2)] {
            if x.edges[side].is_empty() {
                continue;
            }
            let weight = self.weights(&[n_in, 2 * n_out], &side_by_side(&[1, other_tap]));
            for edge in &x.edges[side] {
                let product = self.op("MatMul", &[edge, &weight]);
                let parts = self.columns(&product, &[n_out; 2]);
                of_edges[side].extend(<[String; 2]>::try_from(parts));
            }
        }
        let (known, window) = (x.edges[0].len(), self.window);
        let reached = known + dilation;
        let mut edges = [Vec::new(), Vec::new()];
        for (side, frames) in [(0, 0..reached), (1, window - reached..window)] {
            for at in frames {
                let mut parts = Vec::new();
                for (tap, product) in products.iter().enumerate() {
                    let Some(from) = (at + tap * dilation).checked_sub(dilation).filter(|from| *from < window) else {
                        continue; // the padding itself: zero
                    };
                    let edge = match () {
                        () if from < known => Some(&of_edges[0][from]),
                        () if from >= window - known => Some(&of_edges[1][from - (window - known)]),
                        () => None,
                    };
                    parts.push(match edge {
                        Some([middle, other]) => if tap == 1 { middle } else { other }.clone(),
                        None => self.frame(product, from, x.lead),
                    });
                }
                parts.push(bias.clone());
                let sum = self.sum(&parts);
                edges[side].push(self.op("Relu", &[&sum]));
            }
        }
        let shifted: Vec<String> = (0..TAPS)
            .map(|tap| self.rows(&products[tap], tap * dilation, (TAPS - 1 - tap) * dilation))
            .chain([bias])
            .collect();
        let sum = self.sum(&shifted);
        Layer { interior: self.op("Relu", &[&sum]), lead: x.lead + dilation, edges }
    }

    /// Joint angles of every frame, encoded: `[S, F]`.
    fn embedded(&mut self, pose: &str, weights: &Pose) -> String {
        let [sin, cos] = ["Sin", "Cos"].map(|op| self.op(op, &[pose]));
        let encoded = self.joined(&[&sin, &cos]);
        let width = weights.norm_gain.len();
        let gain = self.weights(&[width], &weights.norm_gain);
        let shift = self.weights(&[width], &weights.norm_shift);
        let normed = self.name();
        self.graph.layer_norm(&encoded, &gain, &shift, weights.norm_epsilon, &normed);
        let weight = self.weights(&weights.embedding.dims, &weights.embedding.weight);
        let bias = self.weights(&[weights.embedding.bias.len()], &weights.embedding.bias);
        let product = self.op("MatMul", &[&normed, &weight]);
        let sum = self.op("Add", &[&product, &bias]);
        let output = self.name();
        self.graph.gelu(&sum, &output)
    }

    /// The last state of both LSTM layers in every window: `[N, 2 H]`.
    fn recurrent(&mut self, embedded: &str, layers: &[[Cells; 2]; 2]) -> String {
        let [first, second] = layers;
        let last = self.window - 1;
        let mut hidden: [Vec<String>; 2] = [Vec::new(), Vec::new()];
        for (direction, cells) in first.iter().enumerate() {
            let dims = vec![4 * cells.hidden, cells.input.len() / (4 * cells.hidden)];
            let projection = Dense { dims, weight: cells.input.clone(), bias: cells.bias.clone() };
            let projected = self.dense(embedded, &projection);
            let weight = self.transposed(&cells.recurrent, cells.hidden);
            let mut state: Option<[String; 2]> = None;
            for step in 0..self.window {
                let at = if direction == 0 { step } else { last - step };
                let mut gates = self.frame(&projected, at, 0);
                if let Some([hidden, _]) = &state {
                    let recurrent = self.op("MatMul", &[hidden, &weight]);
                    gates = self.op("Add", &[&gates, &recurrent]);
                }
                state = Some(self.cell(&gates, state.map(|[_, cell]| cell), cells.hidden));
                hidden[direction].extend(state.iter().map(|[hidden, _]| hidden.clone()));
            }
        }
        hidden[1].reverse();

        let [forward, backward] = second;
        let mut state: Option<[String; 2]> = None;
        // From frame to frame: both states of the layer below, and its own of the frame before.
        let both = [&forward.input[..], &forward.recurrent[..]];
        let weight = self.stacked(&both, forward.hidden);
        let first_weight = self.transposed(&forward.input, forward.input.len() / (4 * forward.hidden));
        let bias = self.weights(&[forward.bias.len()], &forward.bias);
        for (ahead, back) in hidden[0].iter().zip(&hidden[1]) {
            let (input, weight) = match &state {
                Some([own, _]) => (self.joined(&[ahead, back, own]), &weight),
                None => (self.joined(&[ahead, back]), &first_weight),
            };
            let product = self.op("MatMul", &[&input, weight]);
            let gates = self.op("Add", &[&product, &bias]);
            state = Some(self.cell(&gates, state.map(|[_, cell]| cell), forward.hidden));
        }
        // Backward, the last frame is the first one.
        let input = self.joined(&[&hidden[0][last].clone(), &hidden[1][last].clone()]);
        let dims = vec![4 * backward.hidden, backward.input.len() / (4 * backward.hidden)];
        let gates = self.dense(&input, &Dense { dims, weight: backward.input.clone(), bias: backward.bias.clone() });
        let [back, _] = self.cell(&gates, None, backward.hidden);
        let own = state.map(|[hidden, _]| hidden).unwrap_or_default();
        self.joined(&[&own, &back])
    }

    /// One step of an LSTM: its new hidden and cell states, `[N, H]` each.
    fn cell(&mut self, gates: &str, before: Option<String>, hidden: usize) -> [String; 2] {
        let parts = self.columns(gates, &[3 * hidden, hidden]);
        let open = self.op("Sigmoid", &[&parts[0]]);
        let new = self.op("Tanh", &[&parts[1]]);
        let gates = self.columns(&open, &[hidden; 3]);
        let [input, output, forget] = [&gates[0], &gates[1], &gates[2]];
        let added = self.op("Mul", &[input, &new]);
        let cell = match before {
            Some(before) => {
                let kept = self.op("Mul", &[forget, &before]);
                self.op("Add", &[&kept, &added])
            }
            None => added,
        };
        let shown = self.op("Tanh", &[&cell]);
        [self.op("Mul", &[output, &shown]), cell]
    }

    /// The transpose of a row-major matrix of so many columns.
    fn transposed(&mut self, values: &[f32], columns: usize) -> String {
        let rows = values.len() / columns;
        let turned: Vec<f32> =
            (0..columns).flat_map(|column| (0..rows).map(move |row| values[row * columns + column])).collect();
        self.weights(&[columns, rows], &turned)
    }

    /// Transposes of matrices with the same rows, one below the other.
    fn stacked(&mut self, parts: &[&[f32]], hidden: usize) -> String {
        let rows = 4 * hidden;
        let turned: Vec<f32> = parts
            .iter()
            .flat_map(|values| {
                let columns = values.len() / rows;
                (0..columns).flat_map(move |column| (0..rows).map(move |row| values[row * columns + column]))
            })
            .collect();
        self.weights(&[turned.len() / rows, rows], &turned)
    }

    fn finish(self, paper: &Paper, n_windows: usize, outputs: &[&str]) -> Vec<u8> {
        let n_frames = n_windows + self.window - 1;
        let input = |name: &str, width: usize| {
            let dims = [1, n_frames as i64, width as i64].map(DimensionProto::fixed);
            ValueInfoProto::float32(name, dims.to_vec())
        };
        let mut graph = GraphProto { name: "pose_aware_force_of_a_stretch".to_owned(), ..Default::default() };
        graph.input.push(input(TACTILE, paper.convolutions[0].dims[1]));
        graph.input.extend(paper.pose.as_ref().map(|pose| input(POSE, pose.norm_gain.len() / 2)));
        let dims = || vec![DimensionProto::fixed(n_windows as i64), DimensionProto::fixed(1)];
        graph.output = outputs.iter().map(|name| ValueInfoProto::float32(name, dims())).collect();
        (graph.node, graph.initializer) = (self.graph.nodes, self.graph.weights);
        ModelProto::with_graph(graph, OPSET).encode_to_vec()
    }
}
