//! Points of a hand in messages: which fields hold them, how many they are, and whether they move.

use super::hints;
use crate::msg::binding::hand_paths;
use crate::msg::definition::{Primitive, TypeTree};
use crate::msg::dynamic::{ElementKind, FieldPlan, NumericPath, ReadAs, numeric_paths, text_paths};

/// Most such fields of one topic that are looked at.
const MAX_HANDS: usize = 8;

/// Words of what holds the points of a hand.
pub(super) const HAND: &[&str] = &["hand", "finger", "skeleton", "keypoint", "landmark", "manus", "glove"];

/// Words of vectors that are no points.
const NO_POINT: &[&str] =
    &["orientation", "rotation", "linear", "angular", "vel", "acc", "force", "torque", "taxel", "normal", "scale"];

/// Lengths of an array of coordinates, x y z of one point after another: 21, 25 and 26 points.
const FLAT: [u64; 3] = [63, 75, 78];

/// A field that may hold the points of a hand, message after message.
#[derive(Debug)]
pub(super) struct HandWatch {
    /// Path of the positions.
    pub(super) path: String,
    /// Path of the points' names, where there are any.
    pub(super) names: Option<String>,
    /// Path of whether each point is valid.
    pub(super) valid: Option<String>,
    plan: FieldPlan,
    is_flat: bool,
    /// Messages that it was read from.
    pub(super) n_seen: u64,
    /// Fewest and most points in a message.
    pub(super) n_points: [u64; 2],
    first: Vec<f64>,
    /// Whether any point moved.
    pub(super) moves: bool,
}

/// The fields of a type that may hold points.
pub(super) fn watches(tree: &TypeTree, topic: &str) -> Vec<HandWatch> {
    let type_name = tree.type_name();
    if hints::is_ours(type_name) || type_name.starts_with("tf2_msgs/") {
        return Vec::new();
    }
    let numeric = numeric_paths(tree);
    let known = hand_paths(type_name).map(|known| known.positions.to_owned());
    let of_points = numeric.iter().filter(|one| one.kind.many).filter_map(|one| one.path.strip_suffix(".x"));
    let is_point = |path: &&str| {
        let has = |axis: &str| numeric.iter().any(|one| one.path.strip_suffix(axis) == Some(*path));
        hints::found(path, NO_POINT).is_none() && has(".y") && has(".z") && !has(".w")
    };
    let is_named = |path: &str| hints::told(topic, type_name, path, HAND).is_some();
    let is_flat = |one: &&NumericPath| {
        let is_float = matches!(one.kind.element, ElementKind::Number(Primitive::Float32 | Primitive::Float64));
        one.kind.many && is_float && !one.path.ends_with(".x") && !one.path.contains('.') && is_named(&one.path)
    };
    let points = of_points.filter(is_point).map(str::to_owned);
    let mut paths: Vec<String> = known.into_iter().chain(points).collect();
    paths.dedup();
    let points = paths.into_iter().map(|path| (path, false));
    let flat = numeric.iter().filter(is_flat).map(|one| (one.path.clone(), true));
    points
        .chain(flat)
        .filter_map(|(path, is_flat)| HandWatch::new(tree, path, is_flat, &numeric))
        .take(MAX_HANDS)
        .collect()
}

impl HandWatch {
    fn new(tree: &TypeTree, path: String, is_flat: bool, numeric: &[NumericPath]) -> Option<Self> {
        let read = if is_flat { path.clone() } else { format!("{path}.x") };
        let plan = FieldPlan::compile(tree, &read, ReadAs::Numbers).ok()?;
        // Names and validities stand in the same elements as the points.
        let element = path.rfind("[]").map_or("", |end| &path[..end + 2]);
        let beside =
            |other: &str| other.strip_prefix(element).and_then(|rest| rest.strip_prefix('.')).map(str::to_owned);
        let is_named = |text: &&String| {
            beside(text)
                .is_some_and(|own| hints::found(&own, &["name", "joint", "label"]).is_some() && !own.contains('.'))
        };
        let is_valid = |one: &&NumericPath| {
            beside(&one.path).is_some_and(|own| hints::found(&own, &["valid", "is_valid", "tracked"]).is_some())
        };
        let names = if element.is_empty() { None } else { text_paths(tree).iter().find(is_named).cloned() };
        let valid = if element.is_empty() { None } else { numeric.iter().find(is_valid).map(|one| one.path.clone()) };
        Some(HandWatch { path, names, valid, plan, is_flat, n_seen: 0, n_points: [0, 0], first: vec![], moves: false })
    }

    /// Takes in a message; one that can't be read is counted elsewhere.
    pub(super) fn handle(&mut self, cdr: &[u8], numbers: &mut Vec<f64>) {
        numbers.clear();
        if self.plan.read_f64(cdr, numbers).is_err() {
            return;
        }
        let len = numbers.len() as u64;
        let n_points = match self.is_flat {
            false => len,
            true if FLAT.contains(&len) => len / 3,
            true => 0,
        };
        let [fewest, most] = if self.n_seen == 0 { [n_points, n_points] } else { self.n_points };
        self.n_points = [fewest.min(n_points), most.max(n_points)];
        if self.n_seen == 0 {
            self.first.clone_from(numbers);
        }
        self.moves |= self.first != *numbers;
        self.n_seen += 1;
    }
}
