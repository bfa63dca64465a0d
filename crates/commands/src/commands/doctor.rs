//! `tpf doctor`: what is wrong with a graph, this machine, or what a node needs.

use std::path::PathBuf;
use std::time::Duration;

use tactile_pose_fusion::config::{DEFAULT_NODE, load_tree};
use tactile_pose_fusion::ros::{Level, Request, examine};

use super::live::RosArguments;
use super::setup::config;
use super::zero::seconds;
use super::{Failure, Outcome, print, tell};
use crate::report;

/// The node that examines.
const NODE: &str = "/tpf_doctor";

/// Examines the graph, this machine, and what a node with these parameters would lack.
#[derive(Debug, clap::Args)]
#[command(after_help = "tpf doctor\ntpf doctor --params-file glove.yaml -- --ros-args -r __ns:=/left")]
pub(super) struct Args {
    /// ROS 2 parameter file of the node that would run: its models, calibration and inputs are examined, too
    #[arg(long, value_name = "FILE")]
    params_file: Vec<PathBuf>,
    /// Set one parameter over the file's, as in --ros-args -p
    #[arg(short, long = "param", value_name = "KEY:=VALUE", requires = "params_file")]
    param: Vec<String>,
    /// Calibration file of the node instead of calibration.file of the parameters
    #[arg(long, value_name = "FILE", requires = "params_file")]
    calibration: Option<PathBuf>,
    /// Listen to the graph for so long
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = seconds)]
    seconds: f64,
    /// Show every topic, too, with its types and the QoS of its publishers and subscriptions
    #[arg(long)]
    topics: bool,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    ros: RosArguments,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let place = args.ros.place(DEFAULT_NODE)?;
    let node = match args.params_file.is_empty() {
        true => None,
        false => {
            let mut tree = load_tree(&args.params_file, &place.node.to_string())?;
            for rule in &args.param {
                tree.set_override(rule)?;
            }
            Some((config(&tree)?, tree, args.calibration.clone()))
        }
    };
    tell(&format!("listening to the graph for {:.0} s", args.seconds));
    let found = examine(Request {
        name: &tactile_pose_fusion::config::NodeName::parse(NODE)?,
        args: &place.args,
        environment: &place.environment,
        var: &|name| std::env::var(name).ok(),
        node,
        duration: Duration::from_secs_f64(args.seconds),
    })?;
    print(&match args.json {
        true => serde_json::to_string_pretty(&found)? + "\n",
        false => report::doctor::text(&found, args.topics),
    })?;
    Ok(if found.worst() == Level::Problem { Outcome::NotMet } else { Outcome::Done })
}
