//! Paths and URIs as Python gives them.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;
use tactile_pose_fusion::location;

/// A path or a URI as the library takes it: a `file://` URI becomes its path, and a password or a signature is taken out.
#[pyfunction]
pub(crate) fn place(given: OsString) -> OsString {
    location::in_word(given)
}

/// Whether something is not on this machine.
#[pyfunction]
pub(crate) fn is_remote(given: PathBuf) -> bool {
    location::is_remote(&given)
}
