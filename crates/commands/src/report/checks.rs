//! Results that something was held against.

use quick_junit::{NonSuccessKind, Report, SerializeError, TestCase, TestCaseStatus, TestSuite};
use tactile_pose_fusion::eval::{Check, Verdict};

/// Checks as JSON, one a line.
///
/// # Errors
/// Of the writer.
pub fn json_lines(checks: &[Check]) -> Result<String, serde_json::Error> {
    checks.iter().map(|check| Ok(serde_json::to_string(check)? + "\n")).collect()
}

/// Checks as JUnit XML, one test case each.
///
/// # Errors
/// Of the writer, when a text can't be XML.
pub fn junit(name: &str, checks: &[Check]) -> Result<String, SerializeError> {
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
    report.to_string()
}

/// The failed checks, a line each, and how many passed.
pub fn text(checks: &[Check]) -> String {
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
pub fn are_met(checks: &[Check]) -> bool {
    !checks.iter().any(|check| matches!(check.verdict, Verdict::Failed(_)))
}
