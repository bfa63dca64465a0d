//! Loops over all elements of slices.

use std::hint::select_unpredictable;

use macerator::AutoArch;

use super::nonlinear;

/// Runs a loop compiled for the vector instructions of this machine.
#[inline(always)]
pub fn vectorized(run: impl FnOnce()) {
    AutoArch::new().dispatch(run);
}

/// ReLU that passes NaN through. `f32::max` would turn NaN into 0, and an `if` becomes a masked store, which is slow.
#[inline(always)]
pub fn rectified(value: f32) -> f32 {
    select_unpredictable(value < 0.0, 0.0, value)
}

/// Adds the elements of `part` to those of `sum`.
pub fn add(sum: &mut [f32], part: &[f32]) {
    vectorized(|| sum.iter_mut().zip(part).for_each(|(sum, value)| *sum += value));
}

/// Applies [`rectified`] to every element.
pub fn rectify(values: &mut [f32]) {
    vectorized(|| values.iter_mut().for_each(|value| *value = rectified(*value)));
}

/// Applies [`rectified`] to every element, and adds the elements of `kept`.
pub fn rectify_onto(values: &mut [f32], kept: &[f32]) {
    vectorized(|| values.iter_mut().zip(kept).for_each(|(value, kept)| *value = rectified(*value) + kept));
}

/// Applies [`nonlinear::gelu`] to every element.
pub fn gelu(values: &mut [f32]) {
    vectorized(|| values.iter_mut().for_each(|value| *value = nonlinear::gelu(*value)));
}

/// Elementwise maximum. NaN on either side stays NaN. An `if` would become a masked store, which is slow.
pub fn raise(highest: &mut [f32], values: &[f32]) {
    let of = |(highest, value): (&mut f32, &f32)| {
        *highest = select_unpredictable((*value > *highest) | value.is_nan(), *value, *highest);
    };
    vectorized(|| highest.iter_mut().zip(values).for_each(of));
}
