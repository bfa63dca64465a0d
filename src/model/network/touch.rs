//! Tactile branch: four convolutions over time, then the maximum over each window.

use tactile_pose_fusion_kernels::elementwise::{add, raise, rectify};
use tactile_pose_fusion_kernels::matrix::Matrix;
use tactile_pose_fusion_kernels::packed::{Onto, Packed};

use super::dense::repeat;
use super::frames::Frames;
use super::sized;
use crate::model::paper::{self, DILATIONS, TAPS};

/// Weights of the convolutions. Each tap is a matrix `[inputs, outputs]`.
#[derive(Debug)]
pub(super) struct Touch {
    layers: Vec<Convolution>,
}

#[derive(Debug)]
struct Convolution {
    taps: [Packed; TAPS],
    bias: Vec<f32>,
    dilation: usize,
}

/// Values per frame, kept for the most recent frames.
#[derive(Debug, Default)]
pub(super) struct Known {
    /// Per layer and tap: products for the frames that no padding reaches.
    products: [[Frames; TAPS]; DILATIONS.len()],
    /// Output of the last layer where no padding reaches.
    interior: Frames,
}

/// Buffers for values per window, and the output.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// New frames, and the layer's outputs for them.
    rows: Vec<f32>,
    /// Frames at both ends of every window that its padding reaches, start and end: `[frames, N, C]`.
    edges: [Vec<f32>; 2],
    /// Those of the next layer.
    next_edges: [Vec<f32>; 2],
    /// Per end: products of the middle tap, and of the tap that reads frames that the padding had reached.
    edge_products: [[Vec<f32>; 2]; 2],
    /// Output, `[N, C]`.
    pub(super) highest: Vec<f32>,
}

impl Touch {
    pub(super) fn new(convolutions: &[paper::Dense; 4]) -> Self {
        let layers = convolutions.iter().zip(DILATIONS).map(|(convolution, dilation)| Convolution {
            taps: std::array::from_fn(|tap| {
                let of_tap: Vec<f32> = convolution.weight.iter().skip(tap).step_by(TAPS).copied().collect();
                Packed::new(Matrix::new(&of_tap, convolution.dims[0], convolution.dims[1]).transposed())
            }),
            bias: convolution.bias.clone(),
            dilation,
        });
        Touch { layers: layers.collect() }
    }

    /// Forgets all frames. The next call of `run` brings `n_frames` frames of `n_lanes` lanes.
    pub(super) fn begin(&self, known: &mut Known, n_lanes: usize, n_frames: usize) {
        let (mut lead, mut width) = (0, 0);
        for (layer, products) in self.layers.iter().zip(&mut known.products) {
            width = n_lanes * layer.bias.len();
            products.iter_mut().for_each(|product| product.reset(width, n_frames - 2 * lead));
            lead += layer.dilation;
        }
        known.interior.reset(width, n_frames - 2 * lead);
    }

    /// Adds new frames `[frames, lanes, taxels]` and runs the first `n` windows.
    pub(super) fn run(&self, known: &mut Known, new: &[f32], window: usize, n: usize, scratch: &mut Scratch) {
        scratch.rows.clear();
        scratch.rows.extend_from_slice(new);
        scratch.edges.iter_mut().for_each(Vec::clear);
        let (mut lead, mut block) = (0, 0);
        for (layer, products) in self.layers.iter().zip(&mut known.products) {
            block = n * layer.bias.len();
            layer.take_in(products, &scratch.rows);
            layer.edges(products, lead, window, n, scratch);
            layer.newest_interior(products, &mut scratch.rows);
            lead += layer.dilation;
        }
        let width = known.interior.width();
        known.interior.push(scratch.rows.len() / width).copy_from_slice(&scratch.rows);
        let highest = sized(&mut scratch.highest, block);
        highest.copy_from_slice(known.interior.from(0, block));
        (1..window - 2 * lead).for_each(|frame| raise(highest, known.interior.from(frame, block)));
        let edges = scratch.edges.iter().flat_map(|edges| edges.chunks_exact(block.max(1)));
        edges.for_each(|edge| raise(highest, edge));
    }
}

impl Convolution {
    /// Adds new frames of the layer below.
    fn take_in(&self, products: &mut [Frames; TAPS], rows: &[f32]) {
        for (product, tap) in products.iter_mut().zip(&self.taps) {
            let n_frames = rows.len() / self.n_in() * self.bias.len() / product.width();
            self.product(rows, tap, product.push(n_frames));
        }
    }

    /// Output of the layer's interior for the newest frames.
    fn newest_interior(&self, products: &[Frames; TAPS], rows: &mut Vec<f32>) {
        let [first, ..] = products;
        let n_new = rows.len() / self.n_in() * self.bias.len() / first.width();
        let n_whole = first.len() - 2 * self.dilation;
        let n_new = n_new.min(n_whole);
        let sums = sized(rows, n_new * first.width());
        repeat(&self.bias, sums);
        for (tap, product) in products.iter().enumerate() {
            add(sums, product.from(n_whole - n_new + tap * self.dilation, sums.len()));
        }
        rectify(sums);
    }

    /// Computes the frames at both ends of `n` windows that this layer's padding reaches. Its input has `lead` such
    /// frames at each end, from the padding of the layers below.
    fn edges(&self, products: &[Frames; TAPS], lead: usize, window: usize, n: usize, scratch: &mut Scratch) {
        let Scratch { edges, next_edges, edge_products, .. } = scratch;
        let (block, dilation) = (n * self.bias.len(), self.dilation);
        // At the start of a window, only the middle and the first tap read frames that the padding had reached; at its
        // end, the middle and the last tap.
        for ((edge, of_edge), other) in edges.iter().zip(edge_products.iter_mut()).zip([0, 2]) {
            for (product, tap) in of_edge.iter_mut().zip([1, other]) {
                self.product(edge, &self.taps[tap], sized(product, lead * block));
            }
        }
        let reached = lead + dilation;
        for (sums, first) in next_edges.iter_mut().zip([0, window - reached]) {
            let sums = sized(sums, reached * block);
            repeat(&self.bias, sums);
            for (sum, at) in sums.chunks_exact_mut(block.max(1)).zip(first..) {
                for (tap, product) in products.iter().enumerate() {
                    let Some(from) = (at + tap * dilation).checked_sub(dilation).filter(|from| *from < window) else {
                        continue; // the padding itself: zero
                    };
                    let of_edge = |side: usize, frame: usize| {
                        &edge_products[side][usize::from(tap != 1)][frame * block..(frame + 1) * block]
                    };
                    let part = if from < lead {
                        of_edge(0, from)
                    } else if from >= window - lead {
                        of_edge(1, from - (window - lead))
                    } else {
                        product.from(from - lead, block)
                    };
                    add(sum, part);
                }
            }
            rectify(sums);
        }
        std::mem::swap(edges, next_edges);
    }

    fn n_in(&self) -> usize {
        self.taps[0].rows()
    }

    fn product(&self, rows: &[f32], tap: &Packed, out: &mut [f32]) {
        tap.product(Matrix::new(rows, rows.len() / self.n_in(), self.n_in()), Onto::Zero, out);
    }
}
