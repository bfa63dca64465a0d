//! Matrix products and nonlinearities on slices, with all vector instructions of the machine.
//!
//! A row of a result has the same bits for any number of other rows.

pub(crate) mod matrix;
pub(crate) mod nonlinear;
