//! Where checks are written to.

use std::path::PathBuf;

use tactile_pose_fusion::eval::Check;
use tactile_pose_fusion::files;

use super::{Failure, check_output};
use crate::report::checks::{json_lines, junit};

/// Where checks are written to, beside the terminal.
#[derive(Debug, clap::Args)]
pub(super) struct CheckArgs {
    /// Also write the checks as JUnit XML, one test case each
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Also write the checks as JSON, one a line
    #[arg(long, value_name = "FILE")]
    jsonl: Option<PathBuf>,
}

impl CheckArgs {
    /// Whether checks are asked for at all.
    pub(super) fn are_wanted(&self) -> bool {
        self.junit.is_some() || self.jsonl.is_some()
    }

    /// Refuses files that can't be written, before any work is done.
    pub(super) fn check(&self) -> Result<(), Failure> {
        [&self.junit, &self.jsonl].into_iter().flatten().try_for_each(|path| check_output(path, true))
    }

    /// Writes the checks to each file that is asked for. What lies there from a run before is replaced.
    pub(super) fn write(&self, suite: &str, checks: &[Check]) -> Result<(), Failure> {
        let write = |path: &PathBuf, text: String| {
            files::replace(path, text.as_bytes()).map_err(|error| Failure(format!("{}: {error}", path.display())))
        };
        if let Some(path) = &self.junit {
            write(path, junit(suite, checks)?)?;
        }
        if let Some(path) = &self.jsonl {
            write(path, json_lines(checks)?)?;
        }
        Ok(())
    }
}
