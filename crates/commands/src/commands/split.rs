//! The split into training and test: shared by `tpf train`, which must not see the rest, and `tpf eval`, which
//! must not score what was seen.

use clap::ValueEnum;
use tactile_pose_fusion::eval::{Split, SplitBy};

use super::Failure;

/// Share of the time, the last of it, that is kept for the test; the paper's.
const TEST_SHARE: f64 = 0.2;

/// How a session is cut.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct SplitArgs {
    /// Where the chronological cut is made: within each stage of a session, or once a session as the paper words it
    #[arg(long, value_enum, default_value_t = SplitArg::Stage)]
    split: SplitArg,
    /// Share of the time, the last of it, that is kept for the test
    #[arg(long, value_name = "SHARE", default_value_t = TEST_SHARE)]
    test_share: f64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SplitArg {
    Stage,
    Session,
}

impl SplitArgs {
    /// The split, with a share for the validation right before the test.
    pub(super) fn split(&self, validation_share: f64) -> Result<Split, Failure> {
        let by = match self.split {
            SplitArg::Stage => SplitBy::Stage,
            SplitArg::Session => SplitBy::Session,
        };
        Ok(Split::new(by, validation_share, self.test_share)?)
    }
}
