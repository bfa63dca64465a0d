//! Which topics can be a measured force, to hold estimates against.

use serde::Serialize;

use super::force_run::{ForceRange, ForceWatch, MAX_FIELDS};
use super::hints;
use super::likelihood::Likelihood;
use super::taxel_means::Skin;
use super::view::View;
use crate::msg::definition::Primitive;
use crate::msg::dynamic::{ElementKind, NumericPath};

/// A topic that can be a measured force.
#[derive(Debug, Serialize)]
pub struct ForceCandidate {
    /// Its topic.
    pub topic: String,
    /// Its message type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Messages on the topic.
    pub n_messages: u64,
    /// Messages a second, by their stamps where there are any.
    pub rate_hz: Option<f64>,
    /// Paths of the numbers that can be forces.
    pub fields: Vec<String>,
    /// Ranges of those that are one number.
    pub ranges: Vec<ForceRange>,
    /// How much speaks for it.
    pub likelihood: Likelihood,
    /// The reasons for it, and against it.
    pub reasons: Vec<String>,
}

/// The force that a topic can be; `estimates_of` are the nodes whose contacts are in the bag.
pub(super) fn candidate(view: &View<'_>, estimates_of: &[&str], skins: &[Skin]) -> Option<ForceCandidate> {
    let View { topic, look, stats, stamps, .. } = *view;
    let (name, type_name) = (topic.name.as_str(), topic.type_name.as_str());
    if hints::is_ours(type_name) || type_name.contains("/srv/") || type_name.contains("/action/") {
        return None;
    }
    let of_topic = hints::found(name, hints::FORCE).or(hints::is_ft(name).then_some("ft"));
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
    // Axes that come as an array, where it is as short as those of a force sensor are.
    let is_short =
        |path: &str| look.arrays.iter().all(|array| array.path != path || array.n_values[1] <= hints::MOST_FORCES);
    let in_array = |watch: &&ForceWatch| watch.path.strip_suffix(']').and_then(|path| path.rsplit_once('[')).is_some();
    let of_arrays = look.forces.iter().filter(in_array).filter(|watch| watch.is_seen());
    let of_arrays = of_arrays.filter(|watch| is_short(watch.path.split('[').next().unwrap_or_default()));
    let of_arrays: Vec<String> = of_arrays.map(|watch| watch.path.clone()).collect();
    if fields.is_empty() {
        fields = named(hints::FORCE).cloned().collect();
        if let Some(path) = fields.first() {
            reasons.push(format!("its field {path} is named as a force is"));
        } else if of_topic.is_some() || of_type.is_some() {
            fields = numeric.iter().map(|numeric| numeric.path.clone()).collect();
        }
    }
    if !of_arrays.is_empty() {
        let arrays: Vec<&str> = of_arrays.iter().filter_map(|path| path.split('[').next()).collect();
        fields.retain(|path| !arrays.contains(&path.as_str()));
        fields.extend(of_arrays);
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
    let ranges = look.forces.iter().filter(|watch| fields.contains(&watch.path)).filter_map(|watch| watch.range(skins));
    let ranges = ranges.collect();
    Some(ForceCandidate {
        topic: name.to_owned(),
        type_name: type_name.to_owned(),
        n_messages: stats.map_or(0, |stats| stats.n_messages),
        rate_hz: stamps.and_then(|stamps| stamps.rate_hz).or(stats.and_then(|stats| stats.rate_hz)),
        fields,
        ranges,
        likelihood,
        reasons,
    })
}
