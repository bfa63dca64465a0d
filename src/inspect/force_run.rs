//! Numbers that can be a force, message after message, and the taxels that they go with.

use serde::Serialize;

use super::hints;
use super::taxel_means::Skin;
use crate::msg::definition::TypeTree;
use crate::msg::dynamic::{ElementKind, FieldPlan, NumericPath, ReadAs, numeric_paths};

/// Most fields of one topic that are listed.
pub(super) const MAX_FIELDS: usize = 12;

/// Statistics of a number that can be a force.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ForceRange {
    /// Path of the number.
    pub field: String,
    /// Least and greatest value, of the finite ones.
    pub values: [f64; 2],
    /// Correlation with the mean of the taxels that it goes with best; absent where there are none, or nothing changes.
    pub with_taxels: Option<f64>,
    /// Those taxels.
    pub taxels: Option<String>,
}

/// A number that can be a force, message after message.
#[derive(Debug)]
pub(super) struct ForceWatch {
    pub(super) path: String,
    plan: FieldPlan,
    values: Option<[f64; 2]>,
    /// By the order of skins: n, and the sums of x, y, xx, yy, xy.
    sums: Vec<[f64; 6]>,
}

/// The numbers of a type that can be forces, each by itself.
pub(super) fn watches(tree: &TypeTree, topic: &str) -> Vec<ForceWatch> {
    let type_name = tree.type_name();
    let is_named = hints::found(topic, hints::FORCE).or(hints::found(hints::short(type_name), hints::FORCE)).is_some()
        || hints::is_force_sensor(topic, type_name, 1);
    let is_one = |numeric: &NumericPath| {
        let is_number = matches!(numeric.kind.element, ElementKind::Number(primitive) if primitive.size() >= 2);
        let is_force = is_named || hints::found(&numeric.path, hints::FORCE).is_some();
        !hints::is_ours(type_name) && !numeric.kind.many && is_number && is_force
    };
    let watch = |path: String| {
        let plan = FieldPlan::compile(tree, &path, ReadAs::Numbers).ok()?;
        Some(ForceWatch { path, plan, values: None, sums: Vec::new() })
    };
    let numeric = numeric_paths(tree);
    let single = numeric.iter().filter(|one| is_one(one)).map(|one| one.path.clone());
    // A force sensor may send its axes as an array: each element by itself.
    let is_array = |one: &&NumericPath| {
        let is_flat = one.kind.many && !one.path.contains('.') && !hints::is_ours(type_name);
        is_flat && hints::is_force_sensor(topic, type_name, 1) && !one.kind.element.is_byte()
    };
    let elements =
        |one: &NumericPath| (0..hints::MOST_FORCES).map(|k| format!("{}[{k}]", one.path)).collect::<Vec<_>>();
    let of_arrays = numeric.iter().filter(is_array).flat_map(elements);
    single.chain(of_arrays).filter_map(watch).take(MAX_FIELDS).collect()
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

    /// Whether some message held the number.
    pub(super) fn is_seen(&self) -> bool {
        self.values.is_some()
    }

    /// Its statistics; none where no number came.
    pub(super) fn range(&self, skins: &[Skin]) -> Option<ForceRange> {
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
