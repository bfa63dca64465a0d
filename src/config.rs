//! A ROS 2 parameter file, parsed into what the other modules are told. The only place with defaults.

mod domain;
mod error;
pub mod keys;
mod names;
mod param_file;
mod scalar;
mod text;
mod yaml;

use std::fs::File;
use std::io::Read;
use std::path::Path;

pub use domain::{CalibrationConfig, Config, LiveConfig, ModelConfig, TruthAxes, TruthSource};
pub use error::{ConfigError, ParamError};
pub use names::{NameError, NodeName, resolve_name};
pub use param_file::{Origin, Param, ParamTree, parse_param_file, parse_param_files};
pub use scalar::ParamValue;

/// The node's full name unless it is given another one.
pub const DEFAULT_NODE: &str = "/tactile_pose_fusion";

/// What the keys of QoS overrides begin with: `qos_overrides.<topic>.<publisher|subscription>.<policy>`.
pub const QOS_OVERRIDES: &str = "qos_overrides.";

/// Reads the configuration of a node from a parameter file.
///
/// # Errors
/// [`ConfigError`] when the file can't be read, or what it says is refused.
pub fn load(path: &Path, node_fqn: &str) -> Result<Config, ConfigError> {
    Config::from_tree(&load_tree(&[path], node_fqn)?)
}

/// Reads the parameters of a node from files, the later ones over the earlier ones, before any override.
///
/// # Errors
/// [`ConfigError`] when a file can't be read or is no parameter file.
pub fn load_tree<P: AsRef<Path>>(paths: &[P], node_fqn: &str) -> Result<ParamTree, ConfigError> {
    let files = paths.iter().map(|path| Ok((read(path.as_ref())?, path.as_ref().to_string_lossy())));
    let files = files.collect::<Result<Vec<_>, ConfigError>>()?;
    let files: Vec<(&str, &str)> = files.iter().map(|(text, label)| (text.as_str(), label.as_ref())).collect();
    Ok(parse_param_files(&files, node_fqn)?)
}

/// The text of a file, or the beginning of one that is too long, which the parser then refuses.
fn read(path: &Path) -> Result<String, ConfigError> {
    let refuse = |reason: String| ConfigError::Read { file: text::printable(&path.to_string_lossy()), reason };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|e| refuse(e.to_string()))?;
    file.take(yaml::MAX_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(|e| refuse(e.to_string()))?;
    if bytes.len() > yaml::MAX_BYTES {
        return Err(refuse(format!("it has more than {} bytes", yaml::MAX_BYTES)));
    }
    String::from_utf8(bytes).map_err(|_| refuse("it is not UTF-8 text".to_owned()))
}
