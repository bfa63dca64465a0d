//! Reads and sets the parameters of a running node.

use ros2_client::parameters::raw;
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParametersRequest, GetParametersResponse,
    ListParametersRequest, ListParametersResponse, SetParametersRequest, SetParametersResponse,
};

use super::{ANSWER, CallError, Caller, WORK};
use crate::config::ParamValue;
use crate::ros::node::parameters::{from_raw, to_raw};

/// A parameter of a running node.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeParameter {
    /// Its name.
    pub name: String,
    /// Its value; `None` if it is not set.
    pub value: Option<ParamValue>,
    /// Its meaning and unit.
    pub about: String,
    /// The values that it takes, in words; empty if any.
    pub limits: String,
    /// True if it can be set while the node runs.
    pub at_run_time: bool,
}

impl Caller {
    /// The parameters of the node: these, or all.
    ///
    /// # Errors
    /// [`CallError`]; [`CallError::Unknown`] for a name that the node doesn't have.
    pub fn parameters(&mut self, names: &[String]) -> Result<Vec<NodeParameter>, CallError> {
        let list = ListParametersRequest { prefixes: Vec::new(), depth: 0 };
        let listed: ListParametersResponse =
            self.call("~/list_parameters", "rcl_interfaces/srv/ListParameters", list, ANSWER)?;
        if let Some(name) = names.iter().find(|name| !listed.result.names.contains(name)) {
            return Err(CallError::Unknown { node: self.node.to_string(), name: name.clone() });
        }
        let names = if names.is_empty() { listed.result.names } else { names.to_vec() };
        let get = GetParametersRequest { names: names.clone() };
        let values: GetParametersResponse =
            self.call("~/get_parameters", "rcl_interfaces/srv/GetParameters", get, ANSWER)?;
        let describe = DescribeParametersRequest { names: names.clone() };
        let described: DescribeParametersResponse =
            self.call("~/describe_parameters", "rcl_interfaces/srv/DescribeParameters", describe, ANSWER)?;
        if values.values.len() != names.len() || described.values.len() != names.len() {
            let reason = format!(
                "{} values and {} descriptions for {} names",
                values.values.len(),
                described.values.len(),
                names.len()
            );
            return Err(self.unread("~/get_parameters", reason));
        }
        let parameters = names.into_iter().zip(&values.values).zip(described.values);
        Ok(parameters.map(|((name, value), described)| known(name, value, &described)).collect())
    }

    /// Sets a parameter; gives it as it is then.
    ///
    /// # Errors
    /// [`CallError`]; [`CallError::Refused`] with the reason of the node.
    pub fn set_parameter(&mut self, name: &str, value: &ParamValue) -> Result<NodeParameter, CallError> {
        let parameter = raw::Parameter { name: name.to_owned(), value: to_raw(Some(value), None) };
        let request = SetParametersRequest { parameter: vec![parameter] };
        let set: SetParametersResponse =
            self.call("~/set_parameters", "rcl_interfaces/srv/SetParameters", request, WORK)?;
        match set.results.into_iter().next() {
            Some(result) if result.successful => {}
            Some(result) => return Err(CallError::Refused(result.reason)),
            None => return Err(self.unread("~/set_parameters", "it has no result".to_owned())),
        }
        let mut now = self.parameters(&[name.to_owned()])?;
        Ok(now.remove(0))
    }
}

fn known(name: String, value: &raw::ParameterValue, described: &raw::ParameterDescriptor) -> NodeParameter {
    let range = match (described.floating_point_range.first(), described.integer_range.first()) {
        (Some(range), _) => format!("{} to {}", range.from_value, range.to_value),
        (None, Some(range)) => format!("{} to {}", range.from_value, range.to_value),
        (None, None) => String::new(),
    };
    let limits: Vec<&str> = [range.as_str(), described.additional_constraints.as_str()]
        .into_iter()
        .filter(|part| !part.is_empty())
        .collect();
    NodeParameter {
        name,
        value: from_raw(value),
        about: described.description.clone(),
        limits: limits.join(", "),
        at_run_time: !described.read_only,
    }
}
