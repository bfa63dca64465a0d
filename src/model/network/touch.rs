//! The tactile branch: four convolutions over time and the maximum over each window.

use super::vectorized;
use crate::kernels::matrix::{Matrix, add_product};
use crate::model::paper::{self, DILATIONS, TAPS};

/// The convolutions, each tap a matrix `[inputs, outputs]`.
#[derive(Debug)]
pub(super) struct Touch {
    layers: Vec<Convolution>,
}

#[derive(Debug)]
struct Convolution {
    taps: [Vec<f32>; TAPS],
    bias: Vec<f32>,
    dilation: usize,
}

/// A layer of all windows.
struct Layer {
    /// `[frames - 2 lead, C]`: the frames that no padding reaches.
    interior: Vec<f32>,
    /// Frames that are missing at each end.
    lead: usize,
    /// `[N, C]` each: the frames at both ends of every window that its padding reaches, the first ones and the last ones.
    edges: [Vec<Vec<f32>>; 2],
}

impl Touch {
    pub(super) fn new(convolutions: &[paper::Dense; 4]) -> Self {
        let layers = convolutions.iter().zip(DILATIONS).map(|(convolution, dilation)| Convolution {
            taps: std::array::from_fn(|tap| {
                let of_tap: Vec<f32> = convolution.weight.iter().skip(tap).step_by(TAPS).copied().collect();
                Matrix::new(&of_tap, convolution.dims[0], convolution.dims[1]).transposed().to_rows()
            }),
            bias: convolution.bias.clone(),
            dilation,
        });
        Touch { layers: layers.collect() }
    }

    /// `[frames, taxels]` to `[N, C]`.
    pub(super) fn run(&self, tactile: &[f32], window: usize, n_windows: usize) -> Vec<f32> {
        let mut layer = Layer { interior: tactile.to_vec(), lead: 0, edges: [Vec::new(), Vec::new()] };
        for convolution in &self.layers {
            layer = convolution.run(&layer, window, n_windows);
        }
        let width = self.layers.last().map_or(1, |layer| layer.bias.len());
        let mut highest = largest_in(layer.interior, width, window - 2 * layer.lead);
        for edge in layer.edges.iter().flatten() {
            raise(&mut highest, edge);
        }
        highest
    }
}

impl Convolution {
    fn run(&self, x: &Layer, window: usize, n_windows: usize) -> Layer {
        let (n_out, dilation) = (self.bias.len(), self.dilation);
        let products: [Vec<f32>; TAPS] = std::array::from_fn(|tap| self.product(&x.interior, tap));
        let (known, reached) = (x.edges[0].len(), x.edges[0].len() + dilation);
        // At the begin of a window only the middle and the first tap ever look back at frames that the padding had
        // reached, at its end the middle and the last.
        let of_edges = [(0, 0), (1, 2)].map(|(side, other): (usize, usize)| {
            let both = |edge: &Vec<f32>| [self.product(edge, 1), self.product(edge, other)];
            x.edges[side].iter().map(both).collect::<Vec<_>>()
        });
        let mut edges = [Vec::new(), Vec::new()];
        for (side, frames) in [(0, 0..reached), (1, window - reached..window)] {
            for at in frames {
                let mut sum = self.bias.repeat(n_windows);
                for (tap, product) in products.iter().enumerate() {
                    let Some(from) = (at + tap * dilation).checked_sub(dilation).filter(|from| *from < window) else {
                        continue; // the padding itself: zero
                    };
                    let part: &[f32] = if from < known {
                        &of_edges[0][from][usize::from(tap != 1)]
                    } else if from >= window - known {
                        &of_edges[1][from - (window - known)][usize::from(tap != 1)]
                    } else {
                        &product[(from - x.lead) * n_out..(from - x.lead + n_windows) * n_out]
                    };
                    add(&mut sum, part);
                }
                rectify(&mut sum);
                edges[side].push(sum);
            }
        }
        let n_frames = x.interior.len() / self.n_in() - 2 * dilation;
        let mut interior = self.bias.repeat(n_frames);
        for (tap, product) in products.iter().enumerate() {
            add(&mut interior, &product[tap * dilation * n_out..(tap * dilation + n_frames) * n_out]);
        }
        rectify(&mut interior);
        Layer { interior, lead: x.lead + dilation, edges }
    }

    fn n_in(&self) -> usize {
        self.taps[0].len() / self.bias.len()
    }

    fn product(&self, rows: &[f32], tap: usize) -> Vec<f32> {
        let (n_in, n_out) = (self.n_in(), self.bias.len());
        let n = rows.len() / n_in;
        let mut product = vec![0.0; n * n_out];
        add_product(&mut product, Matrix::new(rows, n, n_in), Matrix::new(&self.taps[tap], n_in, n_out));
        product
    }
}

fn add(sum: &mut [f32], part: &[f32]) {
    vectorized(|| sum.iter_mut().zip(part).for_each(|(sum, value)| *sum += value));
}

/// What is not a number stays so: `f32::max` would hide it.
fn rectify(values: &mut [f32]) {
    vectorized(|| values.iter_mut().for_each(|value| *value = if *value < 0.0 { 0.0 } else { *value }));
}

fn raise(highest: &mut [f32], values: &[f32]) {
    let of = |(highest, value): (&mut f32, &f32)| *highest = if *value < *highest { *highest } else { *value };
    vectorized(|| highest.iter_mut().zip(values).for_each(of));
}

/// The maximum over `span` rows from each row on, by doubling.
fn largest_in(mut rows: Vec<f32>, width: usize, span: usize) -> Vec<f32> {
    let mut covered = 1;
    while covered < span {
        let by = covered.min(span - covered);
        let mut wider = rows[..rows.len() - by * width].to_vec();
        raise(&mut wider, &rows[by * width..]);
        (rows, covered) = (wider, covered + by);
    }
    rows
}
