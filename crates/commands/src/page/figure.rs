//! Plots of a page, drawn in the browser by plotly.js, which stands in the page itself.
//!
//! A plot is written as plotly.js describes one, in JSON. Its colours are names of the style sheet (`--ink`), which the page
//! resolves when it draws: light, dark or on paper.

use maud::{Markup, PreEscaped, html};
use serde_json::{Map, Value, json};

use super::style::{FONT, Style};

/// The library that draws: `scripts/plotly` fetches it.
const LIBRARY: &str = include_str!("../../third_party/plotly/plotly-cartesian.min.js");

/// Share of a plot's height that rows of states take, and of the space above them.
const ROWS_SHARE: f64 = 0.2;
const ROWS_GAP: f64 = 0.04;

/// Share at which a density has its full colour, %: more is nearly all there is, as in the air.
const MOST_PERCENT: f64 = 40.0;

/// A plot with its caption.
#[derive(Debug, Clone)]
pub struct Figure {
    id: String,
    caption: String,
    height_px: usize,
    traces: Vec<Value>,
    x: Map<String, Value>,
    y: Map<String, Value>,
    shapes: Vec<Value>,
    notes: Vec<Value>,
    rows: Vec<String>,
    n_named: usize,
}

/// Contents of a heatmap.
#[derive(Debug, Clone, PartialEq)]
pub struct Heat {
    /// `[columns]`
    pub columns: Vec<String>,
    /// `[rows]`, the first one on top.
    pub rows: Vec<String>,
    /// `[rows][columns]`; NaN is left empty.
    pub values: Vec<Vec<f64>>,
    /// Values at the ends of the colours; one that is symmetric about zero gets two colours.
    pub range: [f64; 2],
    /// The unit, beside the colours.
    pub unit: String,
}

/// How often one quantity has a value where another has one: both axes are logarithmic.
#[derive(Debug, Clone, PartialEq)]
pub struct Density {
    /// `[bins + 1]`, rising: the edges of the bins of both axes.
    pub edges: Vec<f64>,
    /// `[bins of x][bins of y]`, percent; NaN is left empty.
    pub shares: Vec<Vec<f64>>,
    /// Where the axes have numbers, and which.
    pub ticks: Vec<(f64, String)>,
}

impl Figure {
    /// A plot without series; `id` names it within its page.
    pub fn new(id: &str, caption: &str, x: &str, y: &str) -> Self {
        Figure {
            id: id.to_owned(),
            caption: caption.to_owned(),
            height_px: 400,
            traces: Vec::new(),
            x: axis(x),
            y: axis(y),
            shapes: Vec::new(),
            notes: Vec::new(),
            rows: Vec::new(),
            n_named: 0,
        }
    }

    /// Whether nothing would be drawn: no series has a point.
    pub fn is_empty(&self) -> bool {
        let has_points = |trace: &Value| {
            let values = |key: &str| trace[key].as_array().is_some_and(|values| values.iter().any(is_drawn));
            values("z") || (values("x") && values("y"))
        };
        !self.traces.iter().any(has_points)
    }

    /// Another height than 400 px.
    pub fn height(mut self, pixels: usize) -> Self {
        self.height_px = pixels;
        self
    }

    /// The y axis from one value to another, until someone zooms.
    pub fn y_range(mut self, from: f64, to: f64) -> Self {
        set(&mut self.y, "range", json!([from, to]));
        self
    }

    /// The x axis from one value to another, until someone zooms.
    pub fn x_range(mut self, from: f64, to: f64) -> Self {
        set(&mut self.x, "range", json!([from, to]));
        self
    }

    /// The y axis from zero on.
    pub fn y_from_zero(mut self) -> Self {
        set(&mut self.y, "rangemode", json!("tozero"));
        self
    }

    /// The x axis logarithmic.
    pub fn x_log(mut self) -> Self {
        set(&mut self.x, "type", json!("log"));
        self
    }

    /// Adds a line through points; NaN breaks it. An empty name keeps it out of the legend.
    ///
    /// # Shapes
    /// `x`, `y`: `[n]`.
    pub fn line(&mut self, name: &str, x: Vec<f64>, y: Vec<f64>, style: Style) {
        let mode = if style.markers { "lines+markers" } else { "lines" };
        self.scatter(name, &numbers(&x), &numbers(&y), mode, &style);
    }

    /// Adds a line over time: NaN breaks it, and so does time without samples.
    ///
    /// # Shapes
    /// `x`, `y`: `[n]`, x rising.
    pub fn time_line(&mut self, name: &str, x: &[f64], y: &[f64], style: Style) {
        let (x, y) = broken(x, y);
        self.line(name, x, y, style);
    }

    /// Adds points without a line.
    ///
    /// # Shapes
    /// `x`, `y`: `[n]`.
    pub fn points(&mut self, name: &str, x: Vec<f64>, y: Vec<f64>, style: Style) {
        self.scatter(name, &numbers(&x), &numbers(&y), "markers", &style);
    }

    /// Adds points over names instead of numbers.
    ///
    /// # Shapes
    /// `names`, `y`: `[n]`.
    pub fn named_points(&mut self, name: &str, names: Vec<String>, y: Vec<f64>, style: Style) {
        set(&mut self.x, "type", json!("category"));
        self.scatter(name, &json!(names), &numbers(&y), "markers", &Style { marker_px: 9, ..style });
    }

    fn scatter(&mut self, name: &str, x: &Value, y: &Value, mode: &str, style: &Style) {
        self.add(
            name,
            json!({
                "type": "scatter", "mode": mode, "x": x, "y": y, "connectgaps": false,
                "line": {"color": style.colour, "dash": style.dash, "width": style.width},
                "marker": {"color": style.colour, "symbol": style.symbol, "size": style.marker_px},
            }),
        );
    }

    fn add(&mut self, name: &str, mut trace: Value) {
        self.n_named += usize::from(!name.is_empty());
        trace["name"] = json!(name);
        trace["showlegend"] = json!(!name.is_empty());
        self.traces.push(trace);
    }

    /// Adds a thin line from one value over a name to another.
    pub fn link(&mut self, name: &str, from: f64, to: f64) {
        self.traces.push(json!({
            "type": "scatter", "mode": "lines", "x": [name, name], "y": [from, to], "showlegend": false,
            "hoverinfo": "skip", "line": {"color": "--faint", "width": 1},
        }));
    }

    /// Adds a bar to each of several groups.
    ///
    /// # Shapes
    /// `groups`, `values`: `[n]`; NaN is no bar.
    pub fn bars(&mut self, name: &str, groups: Vec<String>, values: Vec<f64>, style: Style) {
        let marker = json!({"color": style.colour});
        self.add(name, json!({"type": "bar", "x": groups, "y": numbers(&values), "marker": marker}));
    }

    /// Adds a lying bar to each of several groups, the first one on top: names of any length stand beside them.
    ///
    /// # Shapes
    /// `groups`, `values`: `[n]`; NaN is no bar.
    pub fn lying_bars(&mut self, name: &str, groups: Vec<String>, values: Vec<f64>, style: Style) {
        set(&mut self.y, "autorange", json!("reversed"));
        set(&mut self.y, "showgrid", json!(false));
        let marker = json!({"color": style.colour});
        let trace = json!({"type": "bar", "orientation": "h", "y": groups, "x": numbers(&values), "marker": marker});
        self.add(name, trace);
    }

    /// Adds points beside names, the first one on top.
    ///
    /// # Shapes
    /// `names`, `x`: `[n]`.
    pub fn lying_points(&mut self, name: &str, names: Vec<String>, x: Vec<f64>, style: Style) {
        set(&mut self.y, "autorange", json!("reversed"));
        set(&mut self.y, "type", json!("category"));
        self.scatter(name, &numbers(&x), &json!(names), "markers", &Style { marker_px: 9, ..style });
    }

    /// Adds a row of its own below the plot, dark where a state holds.
    ///
    /// # Shapes
    /// `x`, `states`: `[n]`.
    pub fn states(&mut self, name: &str, x: &[f64], states: &[bool], style: Style) {
        let row = -(self.rows.len() as f64);
        self.rows.push(name.to_owned());
        let y: Vec<f64> = states.iter().map(|state| if *state { row } else { f64::NAN }).collect();
        let (x, y) = broken(x, &y);
        self.traces.push(json!({
            "type": "scatter", "mode": "lines", "x": numbers(&x), "y": numbers(&y), "connectgaps": false, "yaxis": "y2",
            "name": name, "showlegend": false, "line": {"color": style.colour, "width": 9},
        }));
    }

    /// Adds a map of values by row and column.
    pub fn heat(&mut self, heat: Heat) {
        let [from, to] = heat.range;
        let colours = if from < 0.0 { json!([[0, "--c5"], [0.5, "--paper"], [1, "--c0"]]) } else { one_colour() };
        // The axis begins at the bottom.
        let rows: Vec<String> = heat.rows.into_iter().rev().collect();
        let values: Vec<Value> = heat.values.iter().rev().map(|row| numbers(row)).collect();
        self.traces.push(json!({
            "type": "heatmap", "x": heat.columns, "y": rows, "z": values, "zmin": from, "zmax": to,
            "colorscale": colours, "hoverongaps": false, "colorbar": colour_bar(&heat.unit),
        }));
    }

    /// Adds how often y has a value where x has one, and the line on which both are equal.
    pub fn density(&mut self, density: &Density) {
        let n = density.edges.len().saturating_sub(1);
        let rows = (0..n).map(|y| {
            let row = density.shares.iter().map(|of_x| of_x.get(y).copied().unwrap_or(f64::NAN));
            numbers(&row.collect::<Vec<f64>>())
        });
        self.traces.push(json!({
            "type": "heatmap", "x": density.edges, "y": density.edges, "z": rows.collect::<Vec<Value>>(), "zmin": 0, "zmax": MOST_PERCENT,
            "colorscale": one_colour(), "hoverongaps": false, "colorbar": colour_bar("%"),
            "hovertemplate": "true %{x:.3g} gF, estimated %{y:.3g} gF: %{z:.1f} %<extra></extra>",
        }));
        let ends = [density.edges.first().copied().unwrap_or(1.0), density.edges.last().copied().unwrap_or(1.0)];
        self.traces.push(json!({
            "type": "scatter", "mode": "lines", "x": ends, "y": ends, "showlegend": false, "hoverinfo": "skip",
            "line": {"color": "--ink", "width": 1, "dash": "dash"},
        }));
        let range = json!(ends.map(f64::log10));
        let (at, words): (Vec<f64>, Vec<&String>) = density.ticks.iter().map(|(at, words)| (*at, words)).unzip();
        for axis in [&mut self.x, &mut self.y] {
            set(axis, "type", json!("log"));
            set(axis, "range", range.clone());
            set(axis, "tickvals", json!(at));
            set(axis, "ticktext", json!(words));
            set(axis, "tickangle", json!(0));
            set(axis, "showgrid", json!(false));
        }
    }

    /// Adds a dashed level across the plot, with a few words on it, or none.
    pub fn level(&mut self, y: f64, words: &str) {
        self.shapes.push(json!({
            "type": "line", "xref": "paper", "yref": "y", "layer": "below", "x0": 0, "x1": 1, "y0": y, "y1": y,
            "line": {"color": "--muted", "width": 1, "dash": "dash"},
        }));
        if words.is_empty() {
            return;
        }
        self.notes.push(json!({
            "text": words, "showarrow": false, "xref": "paper", "yref": "y", "x": 1, "y": y, "xanchor": "right",
            "yanchor": "bottom", "font": {"size": 12, "color": "--muted"},
        }));
    }

    /// Adds a dashed line up the plot.
    pub fn upright_level(&mut self, x: f64) {
        self.shapes.push(json!({
            "type": "line", "xref": "x", "yref": "paper", "layer": "below", "x0": x, "x1": x, "y0": 0, "y1": 1,
            "line": {"color": "--muted", "width": 1, "dash": "dash"},
        }));
    }

    pub(super) fn markup(&self, is_synthetic: bool) -> Markup {
        let plot = json!({"data": self.traces, "layout": self.layout(is_synthetic)});
        // Whatever a name holds, it ends no element.
        let plot = plot.to_string().replace('<', "\\u003c");
        html! {
            figure {
                figcaption { (self.caption) }
                div.plot style={ "height:" (self.height_px) "px" } {
                    div id=(self.id) {}
                    script type="application/json" { (PreEscaped(plot)) }
                }
            }
        }
    }

    fn layout(&self, is_synthetic: bool) -> Value {
        let (mut x, mut y) = (self.x.clone(), self.y.clone());
        let mut layout = json!({
            "autosize": true, "height": self.height_px, "font": {"family": FONT, "color": "--ink", "size": 13},
            "margin": {"l": 60, "r": 12, "t": 12, "b": 66, "autoexpand": true},
            "paper_bgcolor": "--paper", "plot_bgcolor": "--paper", "hovermode": "closest", "barmode": "group",
            "hoverlabel": {"bgcolor": "--paper", "bordercolor": "--faint", "font": {"color": "--ink"}},
            "showlegend": self.n_named > 1, "shapes": self.shapes,
            "annotations": self.notes,
            "legend": {"orientation": "h", "x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom"},
        });
        if is_synthetic {
            // The lowest line of the picture, below the names of the ticks however long they are.
            layout["title"] = json!({
                "text": "synthetic data", "font": {"size": 11, "color": "--synthetic"}, "automargin": false,
                "xref": "container", "x": 1, "xanchor": "right", "yref": "container", "y": 0, "yanchor": "bottom",
                "pad": {"r": 12, "b": 2},
            });
        }
        if !self.rows.is_empty() {
            set(&mut y, "domain", json!([ROWS_SHARE + ROWS_GAP, 1.0]));
            set(&mut x, "anchor", json!("y2"));
            let places: Vec<f64> = (0..self.rows.len()).map(|row| -(row as f64)).collect();
            let lowest = -(self.rows.len() as f64) + 0.4;
            layout["yaxis2"] = json!({
                "domain": [0.0, ROWS_SHARE], "tickvals": places, "ticktext": self.rows, "range": [lowest, 0.6],
                "fixedrange": true, "showgrid": false, "zeroline": false, "automargin": true,
            });
        }
        (layout["xaxis"], layout["yaxis"]) = (Value::Object(x), Value::Object(y));
        layout
    }
}

fn axis(title: &str) -> Map<String, Value> {
    let axis = json!({
        "title": {"text": title, "font": {"size": 13}, "standoff": 4}, "automargin": true, "gridcolor": "--grid", "linecolor": "--faint",
        "showline": true, "zeroline": false,
    });
    axis.as_object().cloned().unwrap_or_default()
}

fn set(of: &mut Map<String, Value>, key: &str, value: Value) {
    of.insert(key.to_owned(), value);
}

/// Numbers as JSON has them; what is not finite is no point.
fn numbers(values: &[f64]) -> Value {
    values.iter().map(|value| if value.is_finite() { json!(value) } else { Value::Null }).collect()
}

/// Whether a value of a series is drawn, or a row of values holds one that is.
fn is_drawn(value: &Value) -> bool {
    value.as_array().map_or(!value.is_null(), |row| row.iter().any(is_drawn))
}

/// From nothing to much in one colour.
fn one_colour() -> Value {
    json!([[0, "--paper"], [0.02, "--low"], [1, "--c0"]])
}

fn colour_bar(unit: &str) -> Value {
    json!({"title": {"text": unit}, "thickness": 14, "outlinewidth": 0})
}

/// Steps of a line over time, in median ones, from which on samples are missing between two.
const GAP_STEPS: f64 = 2.5;

/// The longest step over which a line over time is drawn.
pub fn longest_step(x: &[f64]) -> f64 {
    let mut steps: Vec<f64> = x.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0).collect();
    let middle = steps.len() / 2;
    match steps.is_empty() {
        true => f64::INFINITY,
        false => GAP_STEPS * *steps.select_nth_unstable_by(middle, f64::total_cmp).1,
    }
}

/// The points of a line over time, with NaN where samples are missing.
fn broken(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let longest = longest_step(x);
    let (mut with, mut values) = (Vec::with_capacity(x.len()), Vec::with_capacity(x.len()));
    for (idx, (at, value)) in x.iter().zip(y).enumerate() {
        if let Some(before) = idx.checked_sub(1).map(|before| x[before])
            && at - before > longest
        {
            with.push((before + at) / 2.0);
            values.push(f64::NAN);
        }
        with.push(*at);
        values.push(*value);
    }
    (with, values)
}

/// The library that draws, as a script element.
pub(super) fn script() -> Markup {
    html! { script { (PreEscaped(LIBRARY)) } }
}

#[cfg(test)]
mod tests {
    use sha2::{Digest, Sha256};

    use super::*;

    #[test]
    fn time_without_samples_breaks_a_line_and_uneven_steps_do_not() {
        let (x, y) = broken(&[0.0, 1.0, 2.2, 3.0, 9.0, 10.0], &[1.0, 2.0, f64::NAN, 4.0, 5.0, 6.0]);
        assert_eq!(x, [0.0, 1.0, 2.2, 3.0, 6.0, 9.0, 10.0]);
        assert!(y[4].is_nan() && y[2].is_nan() && y[5] == 5.0, "{y:?}");
        assert_eq!(broken(&[], &[]), (vec![], vec![]));
        assert_eq!(broken(&[3.0], &[1.0]).0, [3.0]);
    }

    #[test]
    fn the_library_is_the_one_whose_hash_is_noted_and_ends_no_element() {
        let sums = include_str!("../../third_party/plotly/SHA256SUMS");
        let hash: String = Sha256::digest(LIBRARY).iter().map(|byte| format!("{byte:02x}")).collect();
        assert!(sums.contains(&format!("{hash}  plotly-cartesian.min.js")), "{hash}; scripts/plotly fetches it");
        assert!(!LIBRARY.contains("</script"));
    }

    #[test]
    fn a_plot_without_a_point_is_empty() {
        let mut figure = Figure::new("id", "caption", "x", "y");
        assert!(figure.is_empty());
        figure.line("a", vec![0.0, 1.0], vec![f64::NAN; 2], Style::of(0));
        figure.bars("b", vec![], vec![], Style::of(1));
        assert!(figure.is_empty());
        figure.points("c", vec![0.0], vec![1.0], Style::of(2));
        assert!(!figure.is_empty());
    }
}
