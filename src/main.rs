//! `tpf`: pose-aware tactile force from bags and, as a ROS 2 node, live.

use std::process::ExitCode;

use clap::Parser;
use tactile_pose_fusion::commands::{Cli, Outcome, run};

fn main() -> ExitCode {
    // clap prints usage errors itself and leaves with 2.
    match run(Cli::parse()) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::NotMet) => ExitCode::from(1),
        Ok(Outcome::InputLost) => ExitCode::from(3),
        Err(failure) => {
            use std::io::Write;
            let _ = writeln!(std::io::stderr(), "tpf: {failure}");
            ExitCode::from(1)
        }
    }
}
