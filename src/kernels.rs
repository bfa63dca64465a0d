//! Matrix products and nonlinearities on slices, with all vector instructions that the machine has.
//!
//! A row of a result is computed the same, bit by bit, whatever rows are beside it.

pub(crate) mod matrix;
pub(crate) mod nonlinear;
