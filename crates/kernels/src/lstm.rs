//! Steps of an LSTM.

use macerator::{AutoArch, Scalar, Simd, VFma, WithSimd};

use super::nonlinear::{self, next_cell};

/// Runs one step of an LSTM: updates `cells`, and writes each new state to the start of a `stride` of `states`.
pub fn advance(hidden: usize, gates: &[f32], cells: &mut [f32], states: &mut [f32], stride: usize) {
    AutoArch::new().dispatch(Step { hidden, gates, cells, states, stride });
}

/// A struct, because a closure this large is not inlined and is then compiled without the machine's vector
/// instructions.
struct Step<'a> {
    hidden: usize,
    gates: &'a [f32],
    cells: &'a mut [f32],
    states: &'a mut [f32],
    stride: usize,
}

impl WithSimd for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self) {
        match (<f32 as Scalar>::lanes::<S>(), <f32 as VFma>::is_accelerated::<S>()) {
            (16, true) => self.run::<16, true>(),
            (8, true) => self.run::<8, true>(),
            (_, true) => self.run::<4, true>(),
            _ => self.run::<4, false>(),
        }
    }
}

impl Step<'_> {
    /// Computes `L` values at a time, as many as a vector has, and the last ones singly.
    ///
    /// All cells of a window come first, then all states: a state waits for its cell, and several cells can be computed
    /// meanwhile. Both in one loop is 7 % slower with AVX2.
    #[inline(always)]
    fn run<const L: usize, const FMA: bool>(self) {
        let Step { hidden, gates, cells, states, stride } = self;
        let of_windows = gates.chunks_exact(4 * hidden).zip(cells.chunks_exact_mut(hidden));
        let whole = hidden - hidden % L;
        for ((gates, cells), states) in of_windows.zip(states.chunks_mut(stride)) {
            (0..whole).step_by(L).for_each(|at| next_cells::<L, FMA>(at, hidden, gates, cells));
            (whole..hidden).for_each(|at| next_cells::<1, FMA>(at, hidden, gates, cells));
            (0..whole).step_by(L).for_each(|at| next_states::<L, FMA>(at, hidden, gates, cells, states));
            (whole..hidden).for_each(|at| next_states::<1, FMA>(at, hidden, gates, cells, states));
        }
    }
}

#[inline(always)]
fn next_cells<const L: usize, const FMA: bool>(at: usize, hidden: usize, gates: &[f32], cells: &mut [f32]) {
    let [input, _, forget, candidate] = std::array::from_fn(|gate| part::<L>(gates, gate * hidden + at));
    let mut cell = part::<L>(cells, at);
    for l in 0..L {
        cell[l] = next_cell::<FMA>(cell[l], forget[l], input[l], candidate[l]);
    }
    cells[at..at + L].copy_from_slice(&cell);
}

#[inline(always)]
fn next_states<const L: usize, const FMA: bool>(
    at: usize,
    hidden: usize,
    gates: &[f32],
    cells: &[f32],
    states: &mut [f32],
) {
    let (output, cell) = (part::<L>(gates, hidden + at), part::<L>(cells, at));
    let mut state = [0.0; L];
    for l in 0..L {
        state[l] = nonlinear::state::<FMA>(output[l], cell[l]);
    }
    states[at..at + L].copy_from_slice(&state);
}

#[inline(always)]
fn part<const L: usize>(values: &[f32], at: usize) -> [f32; L] {
    let mut part = [0.0; L];
    part.copy_from_slice(&values[at..at + L]);
    part
}
