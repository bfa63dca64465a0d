//! What the tools beside the live node have in common: parameters, names and the graph.

use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use super::{Failure, say};
use crate::config::{Config, DEFAULT_NODE, NodeName, ParamTree, load_tree};
use crate::ros::args::RosArgs;
use crate::ros::environment::Environment;
use crate::ros::{Listening, remap};
use crate::units::Stamp;

/// The arguments that ROS 2 programs take.
#[derive(Debug, clap::Args)]
pub(super) struct RosArguments {
    /// --ros-args and what ROS 2 has after it: -r, --enclave
    #[arg(value_name = "--ros-args ...", last = true)]
    ros: Vec<String>,
}

/// A place in the graph.
pub(super) struct Place {
    pub(super) args: RosArgs,
    pub(super) environment: Environment,
    node: NodeName,
}

impl RosArguments {
    /// Where a tool called `node` will be.
    pub(super) fn place(&self, node: &str) -> Result<Place, Failure> {
        let args = RosArgs::parse(&self.ros)?;
        let environment = Environment::from_vars(|name| std::env::var(name).ok(), &args.enclave)?;
        environment.notes.iter().for_each(|note| say(note));
        let node = remap::node_name(&args.remaps, &NodeName::parse(node)?)?;
        Ok(Place { args, environment, node })
    }
}

impl Place {
    /// Joins the graph.
    pub(super) fn join(&self) -> Result<Listening, Failure> {
        let listening = Listening::join(&self.node, &self.environment, &self.args.remaps)?;
        listening.note().iter().for_each(|note| say(note));
        Ok(listening)
    }
}

/// The parameters of the live node, for a tool that listens to what it listens to.
#[derive(Debug, clap::Args)]
pub(super) struct LiveParams {
    /// ROS 2 parameter file: topics, taxels, joints, force sensors (params/example.yaml explains every key)
    #[arg(long, value_name = "FILE", required = true)]
    params_file: Vec<PathBuf>,
    /// Set one parameter over the file's, as in --ros-args -p
    #[arg(short, long = "param", value_name = "KEY:=VALUE")]
    param: Vec<String>,
    /// Full name of the node whose parameters are meant
    #[arg(long, value_name = "NAME", default_value = DEFAULT_NODE)]
    node: String,
}

impl LiveParams {
    /// The configuration that they make, and they themselves.
    pub(super) fn load(&self) -> Result<(Config, ParamTree), Failure> {
        let mut tree = load_tree(&self.params_file, &self.node)?;
        for rule in &self.param {
            if !tree.set_override(rule)? {
                return Err(Failure(format!("-p {rule} is for another node than {}; correct it or --node", self.node)));
            }
        }
        Ok((Config::from_tree(&tree)?, tree))
    }
}

/// The system's time.
pub(super) fn now() -> Stamp {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Stamp(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}
