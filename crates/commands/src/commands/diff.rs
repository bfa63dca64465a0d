//! `tpf diff`: the estimates of two bags, region by region and field by field.

use std::path::PathBuf;

use tactile_pose_fusion::eval::DiffConfig;
use tactile_pose_fusion::sessions::{Compared, compare};
use tactile_pose_fusion::units::Newton;

use super::checks::CheckArgs;
use super::{Failure, Outcome, interrupt, print, say};
use crate::report::comparison;
use crate::report::progress::Said;

/// Compares the estimates of two bags; leaves with 1 where they differ.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Bag with estimates: the golden run
    a: PathBuf,
    /// Bag with estimates: the run to judge
    b: PathBuf,
    /// Largest difference of a force, in N, that is none; 0 compares bit by bit
    #[arg(long, value_name = "N", default_value_t = 0.0)]
    tolerance_n: f64,
    #[command(flatten)]
    checks: CheckArgs,
    /// Print the comparison as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    args.checks.check()?;
    let default = DiffConfig::default();
    let cfg = default.with_tolerance(Newton(args.tolerance_n))?;
    let Compared { diff: found, losses } = compare(&args.a, &args.b, cfg, &Said)?;
    losses.iter().for_each(|loss| say(&format!("input lost: {loss}")));
    let names = [&args.a, &args.b].map(|path| path.display().to_string());
    let names = names.each_ref().map(String::as_str);
    if args.checks.are_wanted() {
        args.checks.write("tpf diff", &comparison::checks(&found, names, args.tolerance_n))?;
    }
    let text = match args.json {
        true => serde_json::to_string_pretty(&found)? + "\n",
        false => comparison::text(&found, names, args.tolerance_n),
    };
    print(&text)?;
    Ok(match (found.is_same(), losses.is_empty()) {
        (false, _) => Outcome::NotMet,
        (true, true) => Outcome::Done,
        (true, false) => Outcome::InputLost,
    })
}
