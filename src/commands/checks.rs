//! Results that something was held against, in the forms that continuous integration reads.

use std::path::PathBuf;

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use super::Failure;
use crate::eval::{Check, Verdict};
use crate::files;

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

    /// Writes the checks to each file that is asked for. What lies there from a run before is replaced.
    pub(super) fn write(&self, suite: &str, checks: &[Check]) -> Result<(), Failure> {
        let write = |path: &PathBuf, text: String| {
            files::replace(path, text.as_bytes()).map_err(|error| Failure(format!("{}: {error}", path.display())))
        };
        if let Some(path) = &self.junit {
            write(path, junit(suite, checks)?)?;
        }
        if let Some(path) = &self.jsonl {
            let lines = checks.iter().map(|check| Ok(serde_json::to_string(check)? + "\n"));
            write(path, lines.collect::<Result<String, Failure>>()?)?;
        }
        Ok(())
    }
}

fn junit(name: &str, checks: &[Check]) -> Result<String, Failure> {
    let mut suite = TestSuite::new(name);
    for check in checks {
        let status = match &check.verdict {
            Verdict::Passed => TestCaseStatus::success(),
            Verdict::Failed(reason) => {
                let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
                status.set_message(reason.as_str());
                status
            }
            Verdict::Skipped(reason) => {
                let mut status = TestCaseStatus::skipped();
                status.set_message(reason.as_str());
                status
            }
        };
        let mut case = TestCase::new(check.name.as_str(), status);
        case.set_classname(name);
        suite.add_test_case(case);
    }
    let mut report = Report::new("tpf");
    report.add_test_suite(suite);
    Ok(report.to_string()?)
}

/// What failed, a line each, and how many passed.
pub(super) fn text(checks: &[Check]) -> String {
    let mut text = String::new();
    for check in checks {
        match &check.verdict {
            Verdict::Failed(reason) => text.push_str(&format!("FAILED  {}: {reason}\n", check.name)),
            Verdict::Skipped(reason) => text.push_str(&format!("skipped {}: {reason}\n", check.name)),
            Verdict::Passed => {}
        }
    }
    let n_passed = checks.iter().filter(|check| check.verdict == Verdict::Passed).count();
    let n_failed = checks.iter().filter(|check| matches!(check.verdict, Verdict::Failed(_))).count();
    text + &format!("{n_passed} passed, {n_failed} failed, {} skipped\n", checks.len() - n_passed - n_failed)
}

/// Whether nothing failed.
pub(super) fn are_met(checks: &[Check]) -> bool {
    !checks.iter().any(|check| matches!(check.verdict, Verdict::Failed(_)))
}
