//! Which topics can be tactile arrays.

use serde::Serialize;

use super::candidates::{Likelihood, View};
use super::fields::{ArrayWatch, Grid, GridFit};
use super::format::{count, number, range};
use super::hints;
use super::parameters::{Block, decimal, text};

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
#[derive(Debug, Serialize)]
pub(super) struct Count {
    /// Path of the field that says it; absent where it follows from others.
    pub(super) field: Option<String>,
    /// Fewest and most.
    pub(super) values: [u64; 2],
}

/// A topic that can be a tactile array.
#[derive(Debug, Serialize)]
pub(super) struct TactileCandidate {
    pub(super) topic: String,
    #[serde(rename = "type")]
    pub(super) type_name: String,
    pub(super) n_messages: u64,
    /// Samples a second: messages times rows.
    pub(super) sample_rate_hz: Option<f64>,
    /// Path of the numbers.
    pub(super) field: String,
    pub(super) element: String,
    /// Fewest and most values in a message.
    pub(super) n_values: [u64; 2],
    /// Least and greatest value, of the finite ones.
    pub(super) values: Option<[f32; 2]>,
    pub(super) rows: Option<Count>,
    pub(super) cols: Option<Count>,
    /// Taxels in a sample, where that is the same in all messages.
    pub(super) n_taxels: Option<u64>,
    pub(super) likelihood: Likelihood,
    pub(super) reasons: Vec<String>,
    /// Lines for the parameter file, below `ros__parameters`.
    pub(super) parameters: String,
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
    let message_rate = stamps.and_then(|stamps| stamps.rate_hz).or(stats.and_then(|stats| stats.rate_hz));
    let n_rows = grid.map_or(1, |(_, fit)| fit.rows[1]);
    let sample_rate_hz = message_rate.map(|rate| rate * n_rows as f64);
    let (likelihood, reasons) = judge(view, array, grid.map(|(_, fit)| fit), n_taxels);

    let mut block = Block::new("tactile", &topic.name, &topic.type_name);
    let is_ours = topic.type_name == TAXEL_ARRAY;
    let stated = !is_ours && n_rows > 1 && matches!(grid, Some((Grid::Fields { cols: Some(_), .. }, _)));
    if stated && fewest == most {
        block.remark(&format!(
            "{n_rows} samples of {most} taxels. Where it is one grid of taxels instead: n_taxels: {}, rows: 1, no cols",
            array.n_values[1]
        ));
    }
    match n_taxels {
        Some(n) => block.line("n_taxels", &n.to_string()),
        None => block.noted("n_taxels", "0", &format!("came as {}: set it", range([fewest, most]))),
    }
    if !is_ours && topic.type_name != FLOAT_MULTI_ARRAY {
        block.line("field", &text(&array.path));
    }
    block.stamp(look.stamp_path());
    if let (false, Some((grid, fit))) = (is_ours, grid) {
        match grid {
            Grid::Fields { rows, cols } => {
                block.line("rows", &text(rows.path()));
                if let Some(cols) = cols {
                    block.line("cols", &text(cols.path()));
                }
            }
            Grid::Layout(_) if topic.type_name == FLOAT_MULTI_ARRAY => {}
            Grid::Layout(_) => block.line("rows", &fit.rows[1].to_string()),
        }
        if n_rows > 1 {
            match (&look.row_period, message_rate) {
                (Some(path), _) => block.line("row_period", &text(path)),
                (None, Some(rate)) => {
                    let ms = 1000.0 / (rate * n_rows as f64);
                    block.noted("row_period_ms", &decimal(ms), "as measured: time between messages / rows");
                }
                (None, None) => block.noted("row_period_ms", "1.0", "not known from this bag: set it"),
            }
        }
    }
    if let Some(rate) = sample_rate_hz.filter(|rate| (rate / MODEL_RATE_HZ - 1.0).abs() > RATE_TOLERANCE) {
        let rate = number(rate);
        block.noted(
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
        likelihood,
        reasons,
        parameters: block.finish(),
    })
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
        against.push("its elements are single bytes: where a reading takes several, they are no readings".to_owned());
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
