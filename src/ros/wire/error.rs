//! Why a node can't start or go on.

use super::qos::QosError;
use super::security::SecurityError;
use crate::config::NameError;
use crate::msg::binding::BindingError;
use crate::msg::definition::LookupError;

/// Why a node can't start or go on. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum NodeError {
    #[error(transparent)]
    Name(#[from] NameError),
    #[error(transparent)]
    Qos(#[from] QosError),
    #[error("ROS_SECURITY_STRATEGY=Enforce: {0}")]
    Security(#[from] SecurityError),
    #[error(transparent)]
    Lookup(#[from] LookupError),
    #[error("topic {topic}: {error}")]
    Binding { topic: String, error: Box<BindingError> },
    #[error("{what}: can't be created: {reason}")]
    Create { what: String, reason: String },
    #[error("{what}: {source}")]
    System { what: &'static str, source: std::io::Error },
    #[error("{0}")]
    Configure(String),
    #[error("{0}")]
    Ended(String),
}

/// The middleware refuses an entity, such as a topic.
pub(in crate::ros) fn create(what: &str, error: &dyn std::fmt::Display) -> NodeError {
    NodeError::Create { what: what.to_owned(), reason: error.to_string() }
}
