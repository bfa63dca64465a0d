//! A ROS 2 parameter file, parsed into what the other modules are told. The only place with defaults.

mod names;
pub mod param_file;
mod scalar;
pub mod specs;
mod text;
mod yaml;

pub use names::{NameError, NodeName, resolve_name};
pub use param_file::{Origin, Param, ParamError, ParamTree, parse_param_file, parse_param_files};
pub use scalar::ParamValue;
