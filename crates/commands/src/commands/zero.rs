//! Options for the zero of the forces. Their effect is decided by [`tactile_pose_fusion::zero`].

use std::path::PathBuf;

use tactile_pose_fusion::zero::Wanted;

/// What the command line says about it.
#[derive(Debug, clap::Args)]
pub(super) struct ZeroArgs {
    /// Take the baseline from this file, made by `tpf calibrate`
    #[arg(long, value_name = "FILE", conflicts_with = "calibrate_first")]
    calibration: Option<PathBuf>,
    /// Take the baseline from the first seconds, in which nothing may touch the glove
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    calibrate_first: Option<f64>,
}

impl ZeroArgs {
    /// The zero that the command line asks for.
    pub(super) fn wanted(&self) -> Wanted<'_> {
        match (&self.calibration, self.calibrate_first) {
            (Some(file), _) => Wanted::File(file),
            (None, Some(seconds)) => Wanted::First(seconds),
            (None, None) => Wanted::Any,
        }
    }
}

/// A span in seconds, from the command line.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("expected seconds, got {text:?}"))?;
    if seconds > 0.0 && seconds <= 3600.0 { Ok(seconds) } else { Err(format!("{seconds} s is outside of (0, 3600]")) }
}
