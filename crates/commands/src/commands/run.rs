//! `tpf run`: the live node, and the recording of what it handles.

mod record;

use std::path::PathBuf;

use tactile_pose_fusion::config::{DEFAULT_NODE, NodeName, ParamTree, load_tree};
use tactile_pose_fusion::leave;
use tactile_pose_fusion::msg::definition::Definitions;
use tactile_pose_fusion::ros::args::RosArgs;
use tactile_pose_fusion::ros::environment::Environment;
use tactile_pose_fusion::ros::{self, Names, remap};

use super::setup::{ModelArgs, config};
use super::{Failure, Outcome, interrupt, say};

/// Runs as a ROS 2 node: taxels and joint angles in from the graph, wrench and contact out to it.
#[derive(Debug, clap::Args)]
#[command(after_help = "tpf run --ros-args --params-file glove.yaml -r __ns:=/left")]
pub(super) struct Args {
    /// ROS 2 parameter file, as --params-file of --ros-args
    #[arg(long, value_name = "FILE")]
    params_file: Vec<PathBuf>,
    /// Set one parameter over the files', as -p of --ros-args
    #[arg(short, long = "param", value_name = "KEY:=VALUE")]
    param: Vec<String>,
    #[command(flatten)]
    models: ModelArgs,
    /// Take the baseline from this file instead of calibration.file of the parameters
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Record what comes in, in the order in which it is handled, and what goes out; `tpf replay` gives the same again
    #[arg(long, value_name = "OUT")]
    record: Option<PathBuf>,
    /// --ros-args and what ROS 2 has after it: -p, -r, --params-file, --log-level, --enclave
    #[arg(value_name = "--ros-args ...", trailing_var_arg = true, allow_hyphen_values = true)]
    ros: Vec<String>,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let ros_args = RosArgs::parse(&args.ros)?;
    let environment = Environment::from_vars(|name| std::env::var(name).ok(), &ros_args.enclave)?;
    let node = remap::node_name(&ros_args.remaps, &NodeName::parse(DEFAULT_NODE)?)?;
    let tree = parameters(args, &ros_args, &node.to_string())?;
    let mut cfg = config(&tree)?;
    args.models.apply(&mut cfg)?;

    let definitions = Definitions::new(cfg.live.message_definitions.as_deref(), &environment.prefixes);
    let names = Names::new(&cfg, &ros_args.remaps)?;
    let recording = match &args.record {
        Some(out) => Some(record::start(out, &names, &definitions)?),
        None => None,
    };
    let (recorder, recording) = recording.unzip();
    interrupt::listen_live()?;
    let calibration = args.calibration.clone();
    let ran = ros::run(ros::Setup { cfg, tree, args: ros_args, environment, calibration, recorder });
    if let Some(recording) = recording {
        // What was handled before the node failed is worth keeping too, however long the disk takes.
        let kept = leave::keep();
        let finished = recording.finish()?;
        drop(kept);
        finished.notes.iter().for_each(|note| say(note));
        say(&format!("{}: {} messages", finished.path.display(), finished.n_messages));
    }
    ran?;
    Ok(Outcome::Done)
}

/// The parameters of a node: files in order, then what is set one by one.
fn parameters(args: &Args, ros_args: &RosArgs, node: &str) -> Result<ParamTree, Failure> {
    let files: Vec<&PathBuf> = args.params_file.iter().chain(&ros_args.params_files).collect();
    if files.is_empty() {
        return Err(Failure(
            "no parameters: give --ros-args --params-file FILE (params/example.yaml explains every key)".to_owned(),
        ));
    }
    let mut tree = load_tree(&files, node)?;
    for rule in args.param.iter().chain(&ros_args.params) {
        if !tree.set_override(rule)? {
            say(&format!("-p {rule} is for another node than {node}; left out"));
        }
    }
    Ok(tree)
}
