//! The program `tpf`, and the processes in which models are tried.

use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;

use pyo3::prelude::*;
use tactile_pose_fusion::model::first_run;

/// Runs the command line of `tpf`, whose first word is the program's name; returns its exit code.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, args: Vec<OsString>) -> u8 {
    py.detach(|| tactile_pose_fusion_commands::main_with(args))
}

/// Tries models in processes of this program from now on. With these arguments, `--try-model` and a text it passes the text
/// to [`answer_trial`] and leaves with what that returns.
#[pyfunction]
pub(crate) fn try_models_with(program: PathBuf, args: Vec<OsString>) {
    first_run::call(program, args);
}

/// Tries a model as the process that was started for it: says on stdout why it can't be used; returns the exit code.
#[pyfunction]
pub(crate) fn answer_trial(py: Python<'_>, request: &str) -> u8 {
    let Err(line) = py.detach(|| first_run::answer(request)) else { return 0 };
    let _ = writeln!(std::io::stdout(), "{line}"); // whoever asked may have gone
    1
}
