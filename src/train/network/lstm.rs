//! One layer and direction of an LSTM over time, forward and backward, on plain slices.
//!
//! PyTorch's gate order (input, forget, cell, output) and semantics. All matrices are row-major and time-major:
//! `x [L, B, I]`, `h [L, B, H]`, gates `[L, B, 4H]`.

use tactile_pose_fusion_kernels::AutoArch;
use tactile_pose_fusion_kernels::matrix::Matrix;
use tactile_pose_fusion_kernels::nonlinear::{sigmoid, tanh_of};
use tactile_pose_fusion_kernels::product::{add_column_sums, add_product, multiply};

/// Sizes of one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::train) struct LstmShape {
    pub(in crate::train) frames: usize,
    pub(in crate::train) batch: usize,
    pub(in crate::train) input: usize,
    pub(in crate::train) hidden: usize,
    /// True if time runs from the last frame to the first.
    pub(in crate::train) reversed: bool,
}

/// Weights of a layer and direction; PyTorch's two biases are given as their sum.
#[derive(Debug, Clone, Copy)]
pub(in crate::train) struct LstmWeights<'a> {
    /// `[4H, I]`
    pub(in crate::train) input: &'a [f32],
    /// `[4H, H]`
    pub(in crate::train) hidden: &'a [f32],
    /// `[4H]`
    pub(in crate::train) bias: &'a [f32],
}

/// Values of the forward pass that the backward pass needs.
#[derive(Debug, Clone)]
pub(in crate::train) struct LstmTape {
    /// `[L, B, 4H]`: gates after their nonlinearities.
    gates: Vec<f32>,
    /// `[L, B, H]`: cells, and tanh of them.
    cells: Vec<f32>,
    tanh_cells: Vec<f32>,
    /// `[L, B, H]`: the output.
    pub(in crate::train) hidden: Vec<f32>,
}

/// Gradients of a scalar with respect to the inputs of a forward pass.
#[derive(Debug, Clone)]
pub(in crate::train) struct LstmGradients {
    pub(in crate::train) x: Vec<f32>,
    pub(in crate::train) weight_input: Vec<f32>,
    pub(in crate::train) weight_hidden: Vec<f32>,
    pub(in crate::train) bias: Vec<f32>,
}

impl LstmShape {
    /// The `step`-th frame in the direction of time.
    fn frame(&self, step: usize) -> usize {
        if self.reversed { self.frames - 1 - step } else { step }
    }
}

/// Runs the layer from a zero state.
pub(in crate::train) fn forward(shape: LstmShape, x: &[f32], weights: LstmWeights<'_>) -> LstmTape {
    let LstmShape { frames, batch, input, hidden, .. } = shape;
    let (n, n_gates) = (batch * hidden, 4 * batch * hidden);
    let from_input = Matrix::new(weights.input, 4 * hidden, input).transposed().to_rows();
    let from_input = Matrix::new(&from_input, input, 4 * hidden);
    let from_hidden = Matrix::new(weights.hidden, 4 * hidden, hidden).transposed().to_rows();
    let from_hidden = Matrix::new(&from_hidden, hidden, 4 * hidden);
    let mut tape = LstmTape {
        gates: weights.bias.repeat(frames * batch),
        cells: vec![0.0; frames * n],
        tanh_cells: vec![0.0; frames * n],
        hidden: vec![0.0; frames * n],
    };
    let mut cells = vec![0.0; n];
    let mut outputs = vec![0.0; n];
    for step in 0..frames {
        let frame = shape.frame(step);
        let gates = &mut tape.gates[frame * n_gates..(frame + 1) * n_gates];
        add_product(
            gates,
            Matrix::new(&x[frame * batch * input..(frame + 1) * batch * input], batch, input),
            from_input,
        );
        if step > 0 {
            add_product(gates, Matrix::new(&outputs, batch, hidden), from_hidden);
        }
        let at = frame * n..(frame + 1) * n;
        let tanh_cells = &mut tape.tanh_cells[at.clone()];
        // Uses all vector instructions of the machine: the exponentials take most of the time.
        AutoArch::new().dispatch(|| advance(hidden, gates, &mut cells, tanh_cells, &mut outputs));
        tape.cells[at.clone()].copy_from_slice(&cells);
        tape.hidden[at].copy_from_slice(&outputs);
    }
    tape
}

/// Applies the nonlinearities to the gates of a frame, and computes the next cells and outputs.
#[inline(always)]
fn advance(hidden: usize, gates: &mut [f32], cells: &mut [f32], tanh_cells: &mut [f32], outputs: &mut [f32]) {
    for (row, gates) in gates.chunks_exact_mut(4 * hidden).enumerate() {
        let at = row * hidden..(row + 1) * hidden;
        let (cells, tanh_cells, outputs) = (&mut cells[at.clone()], &mut tanh_cells[at.clone()], &mut outputs[at]);
        gates[..2 * hidden].iter_mut().for_each(|gate| *gate = sigmoid(*gate));
        gates[2 * hidden..3 * hidden].iter_mut().for_each(|gate| *gate = tanh_of(*gate));
        gates[3 * hidden..].iter_mut().for_each(|gate| *gate = sigmoid(*gate));
        let (input_gates, rest) = gates.split_at(hidden);
        let (forget_gates, rest) = rest.split_at(hidden);
        let (candidates, output_gates) = rest.split_at(hidden);
        for (((cell, i), f), g) in cells.iter_mut().zip(input_gates).zip(forget_gates).zip(candidates) {
            *cell = f * *cell + i * g;
        }
        tanh_cells.iter_mut().zip(&*cells).for_each(|(tanh, cell)| *tanh = tanh_of(*cell));
        for ((output, gate), tanh) in outputs.iter_mut().zip(output_gates).zip(&*tanh_cells) {
            *output = gate * tanh;
        }
    }
}

/// Propagates the gradient of the output back through time.
///
/// # Shapes
/// `grad`: `[L, B, H]`.
pub(in crate::train) fn backward(
    shape: LstmShape,
    x: &[f32],
    weights: LstmWeights<'_>,
    tape: &LstmTape,
    grad: &[f32],
) -> LstmGradients {
    let LstmShape { frames, batch, input, hidden, .. } = shape;
    let (n, n_gates, n_input) = (batch * hidden, 4 * batch * hidden, batch * input);
    let from_input = Matrix::new(weights.input, 4 * hidden, input);
    let from_hidden = Matrix::new(weights.hidden, 4 * hidden, hidden);
    let mut back = LstmGradients {
        x: vec![0.0; frames * n_input],
        weight_input: vec![0.0; 4 * hidden * input],
        weight_hidden: vec![0.0; 4 * hidden * hidden],
        bias: vec![0.0; 4 * hidden],
    };
    let mut grad_gates = vec![0.0; n_gates];
    let mut grad_hidden = vec![0.0; n];
    let mut grad_cells = vec![0.0; n];
    let zeros = vec![0.0; n];
    for step in (0..frames).rev() {
        let frame = shape.frame(step);
        let before = step.checked_sub(1).map(|step| shape.frame(step) * n..(shape.frame(step) + 1) * n);
        let at = frame * n..(frame + 1) * n;
        grad_hidden.iter_mut().zip(&grad[at.clone()]).for_each(|(carried, given)| *carried += given);
        let cells_before = before.clone().map_or(&zeros[..], |before| &tape.cells[before]);
        let gates = &tape.gates[frame * n_gates..(frame + 1) * n_gates];
        let tanh_cells = &tape.tanh_cells[at];
        AutoArch::new().dispatch(|| {
            for row in 0..batch {
                let (at, of_gates) = (row * hidden..(row + 1) * hidden, 4 * row * hidden..4 * (row + 1) * hidden);
                back_through_row(
                    &gates[of_gates.clone()],
                    &tanh_cells[at.clone()],
                    &cells_before[at.clone()],
                    &grad_hidden[at.clone()],
                    &mut grad_cells[at],
                    &mut grad_gates[of_gates],
                );
            }
        });
        let of_frame = Matrix::new(&grad_gates, batch, 4 * hidden);
        multiply(&mut grad_hidden, of_frame, from_hidden);
        let x_at = frame * n_input..(frame + 1) * n_input;
        add_product(&mut back.x[x_at.clone()], of_frame, from_input);
        add_product(&mut back.weight_input, of_frame.transposed(), Matrix::new(&x[x_at], batch, input));
        if let Some(before) = before {
            let outputs_before = Matrix::new(&tape.hidden[before], batch, hidden);
            add_product(&mut back.weight_hidden, of_frame.transposed(), outputs_before);
        }
        add_column_sums(&mut back.bias, &grad_gates);
    }
    back
}

/// One window's gates at one frame.
#[inline(always)]
fn back_through_row(
    gates: &[f32],
    tanh_cells: &[f32],
    cells_before: &[f32],
    grad_hidden: &[f32],
    grad_cells: &mut [f32],
    grad_gates: &mut [f32],
) {
    let hidden = tanh_cells.len();
    let (gates, grad_gates) = (&gates[..4 * hidden], &mut grad_gates[..4 * hidden]);
    let (cells_before, grad_hidden) = (&cells_before[..hidden], &grad_hidden[..hidden]);
    let grad_cells = &mut grad_cells[..hidden];
    for unit in 0..hidden {
        let [i, f, g, o] = [0, 1, 2, 3].map(|gate| gates[gate * hidden + unit]);
        let tanh = tanh_cells[unit];
        let grad_cell = grad_hidden[unit] * o * (1.0 - tanh * tanh) + grad_cells[unit];
        grad_gates[unit] = grad_cell * g * i * (1.0 - i);
        grad_gates[hidden + unit] = grad_cell * cells_before[unit] * f * (1.0 - f);
        grad_gates[2 * hidden + unit] = grad_cell * i * (1.0 - g * g);
        grad_gates[3 * hidden + unit] = grad_hidden[unit] * tanh * o * (1.0 - o);
        grad_cells[unit] = grad_cell * f;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pseudo-random numbers around zero.
    fn numbers(n: usize, seed: u32) -> Vec<f32> {
        let hash = |idx: usize| (idx as u32 + seed).wrapping_mul(2_654_435_761) >> 8;
        (0..n).map(|idx| hash(idx) as f32 / (1u32 << 23) as f32 - 1.0).collect()
    }

    #[test]
    fn the_gradient_of_every_input_is_the_slope_of_the_output() {
        for reversed in [false, true] {
            let shape = LstmShape { frames: 5, batch: 2, input: 3, hidden: 4, reversed };
            let inputs = [numbers(30, 1), numbers(48, 2), numbers(64, 3), numbers(16, 4)];
            let probe = numbers(40, 5);
            let run = |inputs: &[Vec<f32>; 4]| {
                let weights = LstmWeights { input: &inputs[1], hidden: &inputs[2], bias: &inputs[3] };
                forward(shape, &inputs[0], weights)
            };
            let project = |tape: &LstmTape| -> f64 {
                tape.hidden.iter().zip(&probe).map(|(h, p)| f64::from(*h) * f64::from(*p)).sum()
            };
            let weights = LstmWeights { input: &inputs[1], hidden: &inputs[2], bias: &inputs[3] };
            let back = backward(shape, &inputs[0], weights, &run(&inputs), &probe);
            let back = [back.x, back.weight_input, back.weight_hidden, back.bias];
            for (which, gradient) in back.iter().enumerate() {
                for (idx, gradient) in gradient.iter().enumerate() {
                    let at = |step: f32| {
                        let mut moved = inputs.clone();
                        moved[which][idx] += step;
                        project(&run(&moved))
                    };
                    let measured = (at(0.01) - at(-0.01)) / 0.02;
                    // A step of 0.01 changes the slope by about 1e-4, and float32 rounds it by 1e-4.
                    assert!((measured - f64::from(*gradient)).abs() < 1e-3, "{reversed} {which} {idx}");
                }
            }
        }
    }

    #[test]
    fn time_reversed_is_the_forward_pass_over_reversed_frames() {
        let shape = LstmShape { frames: 4, batch: 2, input: 3, hidden: 4, reversed: true };
        let x = numbers(24, 1);
        let (input, hidden, bias) = (numbers(48, 2), numbers(64, 3), numbers(16, 4));
        let weights = LstmWeights { input: &input, hidden: &hidden, bias: &bias };
        let turned: Vec<f32> = x.chunks_exact(6).rev().flatten().copied().collect();
        let backward = forward(shape, &x, weights).hidden;
        let straight = forward(LstmShape { reversed: false, ..shape }, &turned, weights).hidden;
        let straight: Vec<f32> = straight.chunks_exact(8).rev().flatten().copied().collect();
        assert_eq!(backward, straight);
    }
}
