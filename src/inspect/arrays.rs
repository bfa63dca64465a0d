//! Arrays of numbers in messages: how long they are and what they hold.

use super::angles::JointRun;
use super::grid::{GridFit, spanned, split};
use super::hints;
use super::moments::Moments;
use crate::msg::definition::{Primitive, TypeTree};
use crate::msg::dynamic::{
    ElementKind, FieldKind, FieldPlan, NumericPath, ReadAs, ReadError, numeric_paths, text_paths,
};

/// Most arrays of one topic that are looked at; five fingers of several sensors each have fewer.
const MAX_ARRAYS: usize = 32;

/// Places of an array that are followed one by one: a sample of the most taxels that the parameters take.
const MAX_PLACES: usize = 4096;

const POINT_CLOUD: &str = "sensor_msgs/msg/PointCloud2";

/// An array of numbers, and what has been seen of it.
#[derive(Debug)]
pub(super) struct ArrayWatch {
    pub(super) path: String,
    pub(super) kind: FieldKind,
    plan: FieldPlan,
    /// Whether topic, type or field are named as taxels are.
    pub(super) is_skin: bool,
    /// Mean of the newest values.
    pub(super) mean: f64,
    /// Mean of its values, message after message.
    pub(super) means: Moments,
    /// The values at each place, message after message.
    pub(super) places: Vec<Moments>,
    /// Messages that it was read from.
    pub(super) n_seen: u64,
    /// Fewest and most values in a message.
    pub(super) n_values: [u64; 2],
    /// Least and greatest value, of the finite ones.
    pub(super) values: Option<[f32; 2]>,
    /// One for each [`Grid`](super::grid::Grid) of the topic.
    pub(super) fits: Vec<GridFit>,
    /// Where its name suggests that it holds joint angles.
    pub(super) joints: Option<JointRun>,
    /// The strings that may name those.
    names: Option<FieldPlan>,
}

/// The arrays of a type that are worth a look, and how many there are beyond those.
pub(super) fn arrays(tree: &TypeTree, topic: &str, n_grids: usize) -> (Vec<ArrayWatch>, usize) {
    let wanted: Vec<NumericPath> =
        numeric_paths(tree).into_iter().filter(|numeric| is_wanted(tree.type_name(), topic, numeric)).collect();
    let n_more = wanted.len().saturating_sub(MAX_ARRAYS);
    let watch = |numeric: NumericPath| {
        let joints = JointRun::of(tree.type_name(), topic, &numeric.path);
        Some(ArrayWatch {
            plan: FieldPlan::compile(tree, &numeric.path, ReadAs::Numbers).ok()?,
            names: joints.as_ref().and_then(|_| names_plan(tree, &numeric.path)),
            joints,
            is_skin: hints::told(topic, tree.type_name(), &numeric.path, hints::TACTILE).is_some(),
            mean: f64::NAN,
            means: Moments::default(),
            places: Vec::new(),
            path: numeric.path,
            kind: numeric.kind,
            n_seen: 0,
            n_values: [0, 0],
            values: None,
            fits: vec![GridFit::default(); n_grids],
        })
    };
    (wanted.into_iter().take(MAX_ARRAYS).filter_map(watch).collect(), n_more)
}

/// The strings that may name the values of an array: those beside each value, else those of the message.
fn names_plan(tree: &TypeTree, path: &str) -> Option<FieldPlan> {
    let texts = text_paths(tree);
    let of = |parent: &str, hints: &[&str]| {
        let is_it = |text: &&String| split(text).0 == parent && hints::found(split(text).1, hints).is_some();
        texts.iter().find(is_it).and_then(|text| FieldPlan::compile(tree, text, ReadAs::Texts).ok())
    };
    let beside = split(path).0;
    let named = if beside.is_empty() { None } else { of(beside, &["name", "joint", "type", "label"]) };
    named.or_else(|| of("", &["name", "joint"])).or_else(|| {
        // Whatever it is called: the only array of strings that the message itself has.
        let arrays = texts.iter().filter(|text| split(text).0.is_empty());
        let mut arrays = arrays.filter_map(|text| FieldPlan::compile(tree, text, ReadAs::Texts).ok());
        let only = arrays.by_ref().find(|plan| plan.kind().many)?;
        arrays.all(|other| !other.kind().many).then_some(only)
    })
}

fn is_wanted(type_name: &str, topic: &str, numeric: &NumericPath) -> bool {
    let NumericPath { path, kind } = numeric;
    if !kind.many || matches!(kind.element, ElementKind::Number(Primitive::Bool)) {
        return false;
    }
    let is_part_of_ros = type_name.contains("/srv/") || type_name.contains("/action/");
    if is_part_of_ros || path.starts_with("layout.") || hints::found(path, &["covariance", "uuid"]).is_some() {
        return false;
    }
    match type_name {
        "sensor_msgs/msg/JointState" => path == "position",
        "tactile_pose_fusion/msg/TaxelArray" => path == "values",
        // Its points are read by the names of their fields, which messages say.
        POINT_CLOUD => false,
        _ if hints::is_ours(type_name) => false,
        _ if hints::is_standard(type_name) => hints::found(topic, hints::TACTILE).is_some(),
        _ => true,
    }
}

impl ArrayWatch {
    /// Path of the strings that may name the joints.
    pub(super) fn names_path(&self) -> Option<&str> {
        self.names.as_ref().map(FieldPlan::path)
    }

    /// Takes in the array of one message; `grids` are the counts that it states, `names` a buffer.
    pub(super) fn handle(
        &mut self,
        cdr: &[u8],
        grids: &[Option<(u64, Option<u64>)>],
        names: &mut Vec<String>,
        values: &mut Vec<f32>,
    ) -> Result<(), ReadError> {
        values.clear();
        let len = self.plan.read_f32(cdr, values)? as u64;
        self.n_values = spanned(self.n_seen, self.n_values, len);
        self.mean = values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64;
        let mut known = Moments::default(); // taxels that don't exist come as NaN
        values.iter().for_each(|value| known.handle(f64::from(*value)));
        if !known.is_empty() {
            self.means.handle(known.mean());
        }
        let n_places = values.len().min(MAX_PLACES);
        if self.places.len() < n_places {
            self.places.resize(n_places, Moments::default());
        }
        self.places.iter_mut().zip(values.iter()).for_each(|(place, value)| place.handle(f64::from(*value)));
        for value in values.iter().copied().filter(|value| value.is_finite()) {
            let [least, most] = self.values.get_or_insert([value, value]);
            (*least, *most) = (least.min(value), most.max(value));
        }
        for (fit, grid) in self.fits.iter_mut().zip(grids) {
            fit.handle(len, *grid);
        }
        self.n_seen += 1;
        if let Some(joints) = &mut self.joints {
            if let Some(plan) = &self.names {
                plan.read_texts(cdr, names)?;
            }
            joints.handle(self.names.is_some().then_some(names.as_slice()), values);
        }
        Ok(())
    }

    /// Whether its values are floating-point numbers.
    pub(super) fn is_float(&self) -> bool {
        matches!(self.kind.element, ElementKind::Number(Primitive::Float32 | Primitive::Float64))
    }

    /// The first of the topic's grids that explains the length of this array in every message.
    pub(super) fn grid(&self) -> Option<(usize, &GridFit)> {
        self.fits.iter().enumerate().find(|(_, fit)| fit.explains(self.n_seen))
    }
}
