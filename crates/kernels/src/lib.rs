//! Matrix products and nonlinearities on slices, with all vector instructions of the machine.
//!
//! A row of a result has the same bits for any number of other rows.

pub mod elementwise;
pub mod lstm;
pub mod matrix;
pub mod nonlinear;
pub mod packed;
pub mod product;

/// Runs a closure that is compiled for the vector instructions of this machine (`dispatch`).
pub use macerator::AutoArch;
use macerator::{Arch, Simd, Vector};

/// Name of the vector instructions of this machine that are used.
pub fn vectors() -> &'static str {
    match format!("{:?}", Arch::detect()).as_str() {
        "V4" | "V4FP16" => "AVX-512",
        "V3" => "AVX2",
        "V2" => "SSE4.2",
        "NeonFma" | "NeonF16" => "NEON",
        _ => "none",
    }
}

/// Numbers in a vector.
#[inline(always)]
fn lanes<S: Simd>() -> usize {
    size_of::<Vector<S, f32>>() / size_of::<f32>()
}

/// A vector of as many numbers.
#[inline(always)]
fn load<S: Simd>(values: &[f32]) -> Vector<S, f32> {
    bytemuck::pod_read_unaligned(bytemuck::cast_slice(values))
}
