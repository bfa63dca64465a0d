//! Common parts of the tools beside the live node: names and the graph.

use std::time::Duration;

use tactile_pose_fusion::config::NodeName;
use tactile_pose_fusion::ros::args::RosArgs;
use tactile_pose_fusion::ros::environment::Environment;
use tactile_pose_fusion::ros::{Caller, Listening, remap};

use super::{Failure, interrupt, say};

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
    pub(super) node: NodeName,
}

impl RosArguments {
    /// Where a tool called `node` will be.
    pub(super) fn place(&self, node: &str) -> Result<Place, Failure> {
        interrupt::listen_live()?;
        let args = RosArgs::parse(&self.ros)?;
        let environment = Environment::from_vars(|name| std::env::var(name).ok(), &args.enclave)?;
        environment.notes.iter().for_each(|note| say(note));
        let node = remap::node_name(&args.remaps, &NodeName::parse(node)?)?;
        Ok(Place { args, environment, node })
    }
}

impl Place {
    /// The absolute name of a topic that is relative to the place's namespace.
    pub(super) fn topic(&self, relative: &str) -> Result<String, Failure> {
        Ok(self.node.resolve(relative)?)
    }

    /// Joins the graph to call a node, which must be found within `patience`.
    pub(super) fn call(&self, node: NodeName, patience: Duration) -> Result<Caller, Failure> {
        let caller = Caller::join(&self.node, &self.environment, &self.args.remaps, node, patience)?;
        caller.note().iter().for_each(|note| say(note));
        Ok(caller)
    }

    /// Joins the graph.
    pub(super) fn join(&self) -> Result<Listening, Failure> {
        let listening = Listening::join(&self.node, &self.environment, &self.args.remaps)?;
        listening.note().iter().for_each(|note| say(note));
        Ok(listening)
    }
}
