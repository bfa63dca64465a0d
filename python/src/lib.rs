//! `tactile_pose_fusion._core`: the crate for Python. What people import is `python/tactile_pose_fusion`, which wraps this.

mod cli;
mod error;
mod estimates;
mod parameters;
mod places;
mod prepare;
mod streaming;
mod work;
mod works;

use pyo3::prelude::*;

/// The native half of `tactile_pose_fusion`; import that instead.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::cli::{answer_trial, main, try_models_with};
    #[pymodule_export]
    use super::estimates::{Column, Estimates};
    #[pymodule_export]
    use super::parameters::Parameters;
    #[pymodule_export]
    use super::places::{is_remote, place};
    #[pymodule_export]
    use super::prepare::{init, inspect, train};
    #[pymodule_export]
    use super::streaming::{Core, Glove};
    #[pymodule_export]
    use super::works::{calibrate, characterize, evaluate, export, replay, replay_to, simulate};

    use super::*;

    #[pymodule_init]
    fn add_errors(module: &Bound<'_, PyModule>) -> PyResult<()> {
        super::error::register(module)?;
        module.add("VERSION", env!("CARGO_PKG_VERSION"))
    }
}
