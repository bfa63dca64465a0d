//! Which topics can be a measured force, to hold estimates against.

use serde::Serialize;

use super::candidates::{Likelihood, View};
use super::hints;
use crate::msg::definition::Primitive;
use crate::msg::dynamic::{ElementKind, NumericPath};

/// Most fields of one topic that are listed.
const MAX_FIELDS: usize = 12;

/// A topic that can be a measured force.
#[derive(Debug, Serialize)]
pub(super) struct ForceCandidate {
    pub(super) topic: String,
    #[serde(rename = "type")]
    pub(super) type_name: String,
    pub(super) n_messages: u64,
    pub(super) rate_hz: Option<f64>,
    /// Paths of the numbers that can be forces.
    pub(super) fields: Vec<String>,
    pub(super) likelihood: Likelihood,
    pub(super) reasons: Vec<String>,
}

/// The force that a topic can be; `estimates_of` are the nodes whose contacts are in the bag.
pub(super) fn candidate(view: &View<'_>, estimates_of: &[&str]) -> Option<ForceCandidate> {
    let View { topic, look, stats, stamps, .. } = *view;
    let (name, type_name) = (topic.name.as_str(), topic.type_name.as_str());
    if hints::is_ours(type_name) || type_name.contains("/srv/") || type_name.contains("/action/") {
        return None;
    }
    let of_topic = hints::found(name, hints::FORCE);
    let of_type = hints::found(hints::short(type_name), hints::FORCE);
    let is_number = |numeric: &&NumericPath| {
        matches!(
            numeric.kind.element,
            ElementKind::Number(Primitive::Float32 | Primitive::Float64 | Primitive::Int32 | Primitive::Int16)
        ) && !numeric.path.starts_with("layout.")
    };
    let numeric: Vec<&NumericPath> = look.numeric.iter().filter(is_number).collect();
    let named = |hints: &'static [&'static str]| {
        numeric.iter().filter(move |numeric| hints::found(&numeric.path, hints).is_some()).map(|numeric| &numeric.path)
    };
    let carries_anything = matches!(type_name, "geometry_msgs/msg/Vector3" | "geometry_msgs/msg/Vector3Stamped");
    let is_wrench = matches!(type_name, "geometry_msgs/msg/Wrench" | "geometry_msgs/msg/WrenchStamped");
    let mut fields: Vec<String> = named(&["force"]).cloned().collect();
    let mut reasons = Vec::new();
    if is_wrench {
        reasons.push("its type is made for forces".to_owned());
    } else if hints::is_standard(type_name) && !(carries_anything && of_topic.is_some()) {
        return None;
    } else if let Some(path) = fields.first() {
        reasons.push(format!("its field {path} says 'force'"));
    }
    if fields.is_empty() {
        fields = named(hints::FORCE).cloned().collect();
        if let Some(path) = fields.first() {
            reasons.push(format!("its field {path} is named as a force is"));
        } else if of_topic.is_some() || of_type.is_some() {
            fields = numeric.iter().map(|numeric| numeric.path.clone()).collect();
        }
    }
    if fields.is_empty() {
        return None;
    }
    reasons.extend(of_type.filter(|_| !is_wrench).map(|hint| format!("its type says '{hint}'")));
    reasons.extend(of_topic.map(|hint| format!("its topic says '{hint}'")));
    let mut likelihood =
        if is_wrench || (of_topic.is_some() && of_type.is_some()) { Likelihood::Likely } else { Likelihood::Possible };
    let is_estimate = |node: &&str| name.strip_prefix(*node).is_some_and(|rest| rest.ends_with("/wrench"));
    if is_wrench && estimates_of.iter().any(is_estimate) {
        likelihood = Likelihood::Unlikely;
        reasons.push("but it looks like an estimate of this package, which is no measured force".to_owned());
    }
    fields.truncate(MAX_FIELDS);
    Some(ForceCandidate {
        topic: name.to_owned(),
        type_name: type_name.to_owned(),
        n_messages: stats.map_or(0, |stats| stats.n_messages),
        rate_hz: stamps.and_then(|stamps| stamps.rate_hz).or(stats.and_then(|stats| stats.rate_hz)),
        fields,
        likelihood,
        reasons,
    })
}
