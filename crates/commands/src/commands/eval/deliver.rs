//! Delivery of an evaluation, of one process or merged: it is held against gates, written, printed.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use tactile_pose_fusion::eval::GroupBy;
use tactile_pose_fusion::evaluate::Evaluated;
use tactile_pose_fusion::files;

use super::super::checks::CheckArgs;
use super::super::{Failure, Outcome, check_output, print, say, tell};
use super::gates::GateFile;
use crate::report::{checks, evaluation};

/// Where results go, and what they are held against.
pub(in crate::commands) struct Delivery<'a> {
    pub(in crate::commands) command: &'static str,
    pub(in crate::commands) gate: Option<&'a Path>,
    pub(in crate::commands) update_refs: bool,
    pub(in crate::commands) checks: &'a CheckArgs,
    pub(in crate::commands) report: Option<&'a Path>,
    pub(in crate::commands) parquet: Option<&'a Path>,
    pub(in crate::commands) overwrite: bool,
    pub(in crate::commands) by: &'a [ByArg],
    pub(in crate::commands) json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::commands) enum ByArg {
    User,
    Session,
    Stage,
    Substage,
}

impl From<ByArg> for GroupBy {
    fn from(by: ByArg) -> Self {
        match by {
            ByArg::User => GroupBy::User,
            ByArg::Session => GroupBy::Session,
            ByArg::Stage => GroupBy::Stage,
            ByArg::Substage => GroupBy::Substage,
        }
    }
}

impl Delivery<'_> {
    /// Refuses what can't be delivered, before any work is done.
    pub(in crate::commands) fn check(&self, others: &[&Option<PathBuf>]) -> Result<(), Failure> {
        if self.gate.is_none() && self.checks.are_wanted() {
            return Err(Failure("--junit and --jsonl write how gates went; give --gate GATES.yaml".to_owned()));
        }
        self.checks.check()?;
        let others = others.iter().filter_map(|path| path.as_deref());
        for path in [self.report, self.parquet].into_iter().flatten().chain(others) {
            check_output(path, self.overwrite)?;
        }
        self.gate.map(GateFile::read).transpose().map(|_| ())
    }

    /// Delivers.
    pub(in crate::commands) fn deliver(&self, mut result: Evaluated) -> Result<Outcome, Failure> {
        if let Some(gates) = self.gate.map(GateFile::read).transpose()? {
            result.checks = gates.judge(&result, self.update_refs)?;
            self.checks.write(self.command, &result.checks)?;
        }
        result.sessions.iter().flat_map(|session| &session.warnings).for_each(|warning| say(warning));
        result.failed.iter().for_each(|failed| say(&format!("not scored: {}", failed.error)));
        if let Some(path) = self.report {
            let written = files::write(path, evaluation::page(&result).html().as_bytes(), self.overwrite);
            written.map_err(|error| Failure(format!("{}: {error}", path.display())))?;
            tell(&format!("report: {}", path.display()));
        }
        if let Some(path) = self.parquet {
            evaluation::write_scores(path, &result, self.overwrite)?;
        }
        print(&if self.json {
            serde_json::to_string_pretty(&result)? + "\n"
        } else {
            evaluation::text(&result, &self.by.iter().map(|by| GroupBy::from(*by)).collect::<Vec<_>>())
        })?;
        let lost = !result.failed.is_empty() || result.sessions.iter().any(|session| !session.losses.is_empty());
        Ok(match (checks::are_met(&result.checks), lost) {
            (false, _) => Outcome::NotMet,
            (true, true) => Outcome::InputLost,
            (true, false) => Outcome::Done,
        })
    }
}
