//! Which topics can be tactile arrays.

use serde::Serialize;

use super::arrays::ArrayWatch;
use super::elements::{ElementWatch, Elements};
use super::grid::{Grid, GridFit};
use super::hints;
use super::likelihood::Likelihood;
use super::numbers::{count, number, range};
use super::parameters::{SourceLines, decimal, yaml_text};
use super::sides::{SideWatch, Sides};
use super::topic::Look;
use super::view::View;

const TAXEL_ARRAY: &str = "tactile_pose_fusion/msg/TaxelArray";
const FLOAT_MULTI_ARRAY: &str = "std_msgs/msg/Float32MultiArray";

/// Most taxels in a sample that the parameters take.
const MAX_TAXELS: u64 = 4096;

/// Fewer messages than this are no recording of a sensor.
const FEW: u64 = 5;

/// Frames a second of most models, and how far from it a source still counts as being at that rate.
const MODEL_RATE_HZ: f64 = 100.0;
const RATE_TOLERANCE: f64 = 0.2;

/// A count that explains the length of an array.
#[derive(Debug, Clone, Serialize)]
pub struct Count {
    /// Path of the field that says it; absent where it follows from others.
    pub field: Option<String>,
    /// Fewest and most.
    pub values: [u64; 2],
}

/// Statistics of the taxels one by one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TaxelStats {
    /// Indices of taxels that never change.
    pub constant: Vec<usize>,
    /// Indices of taxels that never have a value: NaN in every message.
    pub missing: Vec<usize>,
    /// Skewness of their mean over time: positive where it rises now and then, as under a press. None where it never changes.
    pub skew: Option<f64>,
}

/// A topic that can be a tactile array.
#[derive(Debug, Clone, Serialize)]
pub struct TactileCandidate {
    /// Its topic.
    pub topic: String,
    /// Its message type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Messages on the topic.
    pub n_messages: u64,
    /// Samples a second: messages times rows.
    pub sample_rate_hz: Option<f64>,
    /// Path of the numbers.
    pub field: String,
    /// Type of the numbers.
    pub element: String,
    /// Fewest and most values in a message.
    pub n_values: [u64; 2],
    /// Least and greatest value, of the finite ones.
    pub values: Option<[f32; 2]>,
    /// Consecutive samples in a message, where something says.
    pub rows: Option<Count>,
    /// Taxels in a sample, where something says.
    pub cols: Option<Count>,
    /// Taxels in a sample, where that is the same in all messages.
    pub n_taxels: Option<u64>,
    /// Statistics of the taxels one by one.
    #[serde(skip)]
    pub taxels: TaxelStats,
    /// The elements of an array of messages that the numbers are spread over.
    #[serde(skip)]
    pub elements: Option<Elements>,
    /// Which hand messages are of.
    #[serde(skip)]
    pub sides: Option<Sides>,
    /// How much speaks for it.
    pub likelihood: Likelihood,
    /// The reasons for it, and against it.
    pub reasons: Vec<String>,
    /// Lines for the parameter file, below `ros__parameters`.
    pub parameters: SourceLines,
}

impl TactileCandidate {
    /// Whether its taxels are those of so many elements, in their order.
    pub fn is_made_of(&self, n: u64) -> bool {
        self.n_taxels.is_some_and(|n_taxels| n > 1 && n_taxels > n && n_taxels.is_multiple_of(n))
    }
}

/// The tactile array that an array can be.
pub(super) fn candidate(view: &View<'_>, array: &ArrayWatch) -> Option<TactileCandidate> {
    let View { topic, look, stats, stamps, .. } = *view;
    if array.n_values[1] < 2 || topic.type_name == "sensor_msgs/msg/JointState" {
        return None;
    }
    let grid = array.grid().map(|(idx, fit)| (&look.grids[idx], fit));
    let [fewest, most] = grid.map_or(array.n_values, |(_, fit)| fit.cols);
    let n_taxels = (fewest == most).then_some(most);
    let sides = look.side.as_ref().and_then(SideWatch::seen);
    let n_hands = sides.as_ref().map_or(1, |sides| sides.values.len());
    let stamped = stamps.filter(|_| look.stamp_path().is_some()).and_then(|stamps| stamps.rate_hz);
    let message_rate = stamped.or(stats.and_then(|stats| stats.rate_hz)).map(|rate| rate / n_hands as f64);
    let n_rows = grid.map_or(1, |(_, fit)| fit.rows[1]);
    let sample_rate_hz = message_rate.map(|rate| rate * n_rows as f64);
    let (likelihood, reasons) = judge(view, array, grid.map(|(_, fit)| fit), n_taxels);

    let mut lines = SourceLines::new("tactile", &topic.name, &topic.type_name);
    let is_ours = topic.type_name == TAXEL_ARRAY;
    let stated = !is_ours && n_rows > 1 && matches!(grid, Some((Grid::Fields { cols: Some(_), .. }, _)));
    if stated && fewest == most {
        lines.remark(&format!(
            "{n_rows} samples of {most} taxels. Where it is one grid of taxels instead: n_taxels: {}, rows: 1, no cols",
            array.n_values[1]
        ));
    }
    match n_taxels {
        Some(n) => lines.line("n_taxels", &n.to_string()),
        None => lines.noted("n_taxels", "0", &format!("came as {}: set it", range([fewest, most]))),
    }
    if !is_ours && topic.type_name != FLOAT_MULTI_ARRAY {
        lines.line("field", &yaml_text(&array.path));
    }
    lines.stamp(look);
    lines.only(sides.as_ref());
    if let (false, Some(path)) = (is_ours, &look.sequence) {
        lines.noted("sequence", &yaml_text(path), "counts messages, so that lost ones are known");
    }
    if let (false, Some((grid, fit))) = (is_ours, grid) {
        match grid {
            Grid::Fields { rows, cols } => {
                lines.line("rows", &yaml_text(rows.path()));
                if let Some(cols) = cols {
                    lines.line("cols", &yaml_text(cols.path()));
                }
            }
            Grid::Layout(_) if topic.type_name == FLOAT_MULTI_ARRAY => {}
            Grid::Layout(_) => lines.line("rows", &fit.rows[1].to_string()),
        }
        if n_rows > 1 {
            match (&look.row_period, message_rate) {
                (Some(path), _) => lines.line("row_period", &yaml_text(path)),
                (None, Some(rate)) => {
                    let ms = 1000.0 / (rate * n_rows as f64);
                    lines.noted("row_period_ms", &decimal(ms), "as measured: time between messages / rows");
                }
                (None, None) => lines.noted("row_period_ms", "1.0", "not known from this bag: set it"),
            }
        }
    }
    if let Some(rate) = sample_rate_hz.filter(|rate| (rate / MODEL_RATE_HZ - 1.0).abs() > RATE_TOLERANCE) {
        let rate = number(rate);
        lines.noted(
            "frame_clock",
            "grid",
            &format!("samples come at {rate} Hz; tactile where that is the model's rate"),
        );
    }
    let (rows, cols) = counts(grid);
    Some(TactileCandidate {
        topic: topic.name.clone(),
        type_name: topic.type_name.clone(),
        n_messages: stats.map_or(0, |stats| stats.n_messages),
        sample_rate_hz,
        field: array.path.clone(),
        element: array.kind.to_string(),
        n_values: array.n_values,
        values: array.values,
        rows,
        cols,
        n_taxels,
        taxels: taxel_stats(array, n_taxels),
        elements: elements(look, &array.path),
        sides,
        likelihood,
        reasons,
        parameters: lines,
    })
}

/// The elements that an array of numbers is spread over, where each holds as many.
fn elements(look: &Look, path: &str) -> Option<Elements> {
    let (array, _) = path.split_once("[].")?;
    look.elements.iter().find(|watch| watch.array == array).and_then(ElementWatch::seen)
}

/// The taxels of samples that follow one another in a message are the same ones.
fn taxel_stats(array: &ArrayWatch, n_taxels: Option<u64>) -> TaxelStats {
    let mut stats = TaxelStats { skew: array.means.skew(), ..TaxelStats::default() };
    let n_taxels = n_taxels.and_then(|n| usize::try_from(n).ok()).unwrap_or(array.places.len());
    for taxel_idx in 0..n_taxels.min(array.places.len()) {
        let places = || array.places[taxel_idx..].iter().step_by(n_taxels).filter(|place| !place.is_empty());
        let Some(first) = places().next() else {
            stats.missing.push(taxel_idx);
            continue;
        };
        if places().all(|place| place.is_constant() && place.mean() == first.mean()) {
            stats.constant.push(taxel_idx);
        }
    }
    stats
}

fn counts(grid: Option<(&Grid, &GridFit)>) -> (Option<Count>, Option<Count>) {
    let Some((grid, fit)) = grid else { return (None, None) };
    let (rows, cols) = match grid {
        Grid::Fields { rows, cols } => (rows.path(), cols.as_ref().map(|cols| cols.path())),
        Grid::Layout(sizes) => (sizes.path(), Some(sizes.path())),
    };
    let counted = |field: Option<&str>, values| Some(Count { field: field.map(str::to_owned), values });
    (counted(Some(rows), fit.rows), counted(cols, fit.cols))
}

fn judge(
    view: &View<'_>,
    array: &ArrayWatch,
    fit: Option<&GridFit>,
    n_taxels: Option<u64>,
) -> (Likelihood, Vec<String>) {
    let topic = view.topic;
    let told = |hints| hints::told(&topic.name, &topic.type_name, &array.path, hints);
    let mut reasons = Vec::new();
    let mut likelihood = Likelihood::Unlikely;
    if topic.type_name == TAXEL_ARRAY {
        likelihood = Likelihood::Likely;
        reasons.push("its type is made for taxels".to_owned());
    } else if let Some(hint) = told(hints::TACTILE) {
        likelihood = Likelihood::Likely;
        reasons.push(hint);
    }
    if topic.type_name != TAXEL_ARRAY && hints::is_force_sensor(&topic.name, &topic.type_name, array.n_values[1]) {
        let n = range(array.n_values);
        return (Likelihood::Unlikely, vec![format!("its {n} numbers are named as those of a force sensor are")]);
    }
    let other = told(hints::JOINT).or(told(hints::FORCE));
    // A glove's message may hold more than taxels: the name of a field knows better than that of its topic.
    let field_says = |hints| hints::found(&array.path, hints);
    if let (Likelihood::Likely, None, Some(hint)) =
        (likelihood, field_says(hints::TACTILE), field_says(hints::JOINT).filter(|_| topic.type_name != TAXEL_ARRAY))
    {
        likelihood = Likelihood::Possible;
        reasons.push(format!("but its field says '{hint}'"));
    }
    if likelihood == Likelihood::Unlikely {
        if topic.type_name.ends_with("MultiArray") && other.is_none() {
            likelihood = Likelihood::Possible;
            reasons.push(format!("many drivers send taxels as {}", hints::short(&topic.type_name)));
        }
        if let Some(fit) = fit {
            likelihood = Likelihood::Possible;
            let (rows, cols) = (range(fit.rows), range(fit.cols));
            reasons.push(format!("its {} values are {rows} rows x {cols}", range(array.n_values)));
        }
        if reasons.is_empty() {
            reasons.push(format!("it is an array of {} numbers", range(array.n_values)));
        }
        reasons.extend(other.map(|hint| format!("but {hint}")));
    }
    let mut against = Vec::new();
    if topic.type_name.ends_with("MultiArray") && array.kind.element.is_byte() {
        against.push("its elements are single bytes, and a reading may take several of them".to_owned());
    }
    if n_taxels.is_none() {
        against.push("its length varies".to_owned());
    }
    if array.values.is_some_and(|[least, most]| least == most) && array.n_seen > 1 {
        against.push("its values never change".to_owned());
    }
    if array.n_seen < FEW {
        against.push(format!("there are only {} messages", array.n_seen));
    }
    if n_taxels.is_some_and(|n| n > MAX_TAXELS) {
        against.push(format!("a sample has at most {} taxels", count(MAX_TAXELS)));
        likelihood = Likelihood::Unlikely;
    } else if !against.is_empty() {
        likelihood = likelihood.less();
    }
    reasons.extend(against.into_iter().map(|reason| format!("but {reason}")));
    (likelihood, reasons)
}
