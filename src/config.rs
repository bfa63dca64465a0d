//! Parses a ROS 2 parameter file to the configuration of the other modules. The only place with defaults.

mod domain;
mod error;
pub mod keys;
mod names;
mod param_file;
mod scalar;
mod text;
mod yaml;

use std::io::Read;
use std::path::Path;

pub use domain::{
    CalibrationConfig, Config, LiveConfig, ModelConfig, Publishing, TaxelLayout, TruthAxes, TruthSource, VisualsConfig,
};
pub use error::{ConfigError, ParamError};
pub use names::{NameError, NodeName, resolve_name};
pub use param_file::{Origin, Param, ParamTree, parse_param_file, parse_param_files};
pub use scalar::ParamValue;

use crate::location;

/// Default for the node's full name.
pub const DEFAULT_NODE: &str = "/tactile_pose_fusion";

/// Prefix of QoS overrides: `qos_overrides.<topic>.<publisher|subscription>.<policy>`.
pub const QOS_OVERRIDES: &str = "qos_overrides.";

/// Reads the configuration of a node from a parameter file.
///
/// # Errors
/// [`ConfigError`] if the file can't be read, or if its content is refused.
pub fn load(path: &Path, node_fqn: &str) -> Result<Config, ConfigError> {
    Config::from_tree(&load_tree(&[path], node_fqn)?)
}

/// Reads the parameters of a node from files, without overrides. Later files win over earlier ones.
///
/// # Errors
/// [`ConfigError`] if a file can't be read or is not a parameter file.
pub fn load_tree<P: AsRef<Path>>(paths: &[P], node_fqn: &str) -> Result<ParamTree, ConfigError> {
    let files = paths.iter().map(|path| Ok((read(path.as_ref())?, path.as_ref().to_string_lossy())));
    let files = files.collect::<Result<Vec<_>, ConfigError>>()?;
    let files: Vec<(&str, &str)> = files.iter().map(|(text, label)| (text.as_str(), label.as_ref())).collect();
    Ok(parse_param_files(&files, node_fqn)?)
}

/// Reads the text of a file. Of a file that is too long, it reads only the beginning, which the parser then refuses.
fn read(path: &Path) -> Result<String, ConfigError> {
    let refuse = |reason: String| ConfigError::Read { file: text::printable(&path.to_string_lossy()), reason };
    let mut bytes = Vec::new();
    let file = location::open(path).map_err(|e| refuse(e.to_string()))?;
    file.take(yaml::MAX_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(|e| refuse(e.to_string()))?;
    if bytes.len() > yaml::MAX_BYTES {
        return Err(refuse(format!("it has more than {} bytes", yaml::MAX_BYTES)));
    }
    String::from_utf8(bytes).map_err(|_| refuse("it is not UTF-8 text".to_owned()))
}
