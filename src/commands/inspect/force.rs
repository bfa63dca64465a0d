//! Which topics can be a measured force, to hold estimates against.

use serde::Serialize;

use super::candidates::{Likelihood, View};
use super::hints;
use crate::msg::definition::{Primitive, TypeTree};
use crate::msg::dynamic::{ElementKind, FieldPlan, NumericPath, ReadAs, numeric_paths};

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
    /// What was seen of those that are one number.
    pub(super) ranges: Vec<ForceRange>,
    pub(super) likelihood: Likelihood,
    pub(super) reasons: Vec<String>,
}

/// What was seen of a number that can be a force.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct ForceRange {
    pub(super) field: String,
    /// Least and greatest value, of the finite ones.
    pub(super) values: [f64; 2],
    /// Correlation with the mean of the taxels that it goes with best; absent where there are none, or nothing changes.
    pub(super) with_taxels: Option<f64>,
    /// Those taxels.
    pub(super) taxels: Option<String>,
}

/// The newest mean of an array that is named as taxels are: by topic and array, and what people call it.
#[derive(Debug)]
pub(super) struct Skin {
    pub(super) key: (usize, usize),
    pub(super) name: String,
    pub(super) mean: f64,
}

/// Most arrays of taxels that forces are held against.
pub(super) const MAX_SKINS: usize = 4;

/// A number that can be a force, message after message.
#[derive(Debug)]
pub(super) struct ForceWatch {
    path: String,
    plan: FieldPlan,
    values: Option<[f64; 2]>,
    /// By the order of skins: n, and the sums of x, y, xx, yy, xy.
    sums: Vec<[f64; 6]>,
}

/// The numbers of a type that can be forces, each by itself.
pub(super) fn watches(tree: &TypeTree, topic: &str) -> Vec<ForceWatch> {
    let type_name = tree.type_name();
    let is_named = hints::found(topic, hints::FORCE).or(hints::found(hints::short(type_name), hints::FORCE)).is_some();
    let is_one = |numeric: &NumericPath| {
        let is_number = matches!(numeric.kind.element, ElementKind::Number(primitive) if primitive.size() >= 2);
        let is_force = is_named || hints::found(&numeric.path, hints::FORCE).is_some();
        !hints::is_ours(type_name) && !numeric.kind.many && is_number && is_force
    };
    let watch = |numeric: NumericPath| {
        let plan = FieldPlan::compile(tree, &numeric.path, ReadAs::Numbers).ok()?;
        Some(ForceWatch { path: numeric.path, plan, values: None, sums: Vec::new() })
    };
    numeric_paths(tree).into_iter().filter(is_one).filter_map(watch).take(MAX_FIELDS).collect()
}

impl ForceWatch {
    /// Takes the number of a message; one that can't be read is counted elsewhere.
    pub(super) fn handle(&mut self, cdr: &[u8], skins: &[Skin], numbers: &mut Vec<f64>) {
        numbers.clear();
        let read = self.plan.read_f64(cdr, numbers);
        let (Ok(1), Some(&force)) = (read, numbers.first().filter(|force| force.is_finite())) else { return };
        let [least, most] = self.values.get_or_insert([force, force]);
        (*least, *most) = (least.min(force), most.max(force));
        self.sums.resize(skins.len().max(self.sums.len()), [0.0; 6]);
        for (sums, skin) in self.sums.iter_mut().zip(skins).filter(|(_, skin)| skin.mean.is_finite()) {
            let (x, y) = (skin.mean, force);
            sums.iter_mut().zip([1.0, x, y, x * x, y * y, x * y]).for_each(|(sum, part)| *sum += part);
        }
    }

    fn range(&self, skins: &[Skin]) -> Option<ForceRange> {
        let correlation = |sums: &[f64; 6]| {
            let [n, x, y, xx, yy, xy] = *sums;
            let (xx, yy, xy) = (n * xx - x * x, n * yy - y * y, n * xy - x * y);
            (xx > 0.0 && yy > 0.0).then(|| xy / (xx * yy).sqrt())
        };
        let all = self.sums.iter().zip(skins).filter_map(|(sums, skin)| Some((correlation(sums)?, skin)));
        let best = all.max_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()));
        Some(ForceRange {
            field: self.path.clone(),
            values: self.values?,
            with_taxels: best.map(|(correlation, _)| correlation),
            taxels: best.map(|(_, skin)| skin.name.clone()),
        })
    }
}

/// The force that a topic can be; `estimates_of` are the nodes whose contacts are in the bag.
pub(super) fn candidate(view: &View<'_>, estimates_of: &[&str], skins: &[Skin]) -> Option<ForceCandidate> {
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
