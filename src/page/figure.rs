//! Plots of a page, drawn in the browser by plotly.js, which stands in the page itself.

use maud::{Markup, PreEscaped, html};
use plotly::common::{
    Anchor, ColorBar, ColorScale, ColorScalePalette, DashType, Font, HoverInfo, Line, Marker, Mode, Orientation, Title,
};
use plotly::configuration::{DisplayModeBar, ModeBarButtonName};
use plotly::layout::{
    Annotation, Axis, AxisType, BarMode, HoverMode, Legend, Margin, RangeMode, Shape, ShapeLayer, ShapeLine, ShapeType,
};
use plotly::{Bar, Configuration, HeatMap, Layout, Plot, Scatter};

use super::style::{FONT, GRID, INK, Style};

/// Share of a plot's height that rows of states take, and of the space above them.
const ROWS_SHARE: f64 = 0.2;
const ROWS_GAP: f64 = 0.04;

/// A plot with its caption.
pub struct Figure {
    id: String,
    caption: String,
    height_px: usize,
    plot: Plot,
    x: Axis,
    y: Axis,
    shapes: Vec<Shape>,
    notes: Vec<Annotation>,
    rows: Vec<String>,
    n_named: usize,
}

/// What a heatmap shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Heat {
    /// `[columns]`
    pub columns: Vec<String>,
    /// `[rows]`, the first one on top.
    pub rows: Vec<String>,
    /// `[rows][columns]`; NaN is left white.
    pub values: Vec<Vec<f64>>,
    /// Values at the ends of the colours; one that is symmetric about zero gets two colours.
    pub range: [f64; 2],
    /// What stands beside the colours.
    pub unit: String,
}

impl Figure {
    /// A plot without series; `id` names it within its page.
    pub fn new(id: &str, caption: &str, x: &str, y: &str) -> Self {
        let axis = |title: &str| {
            let font = Font::new().size(13);
            let axis = Axis::new().title(Title::from(title).font(font)).auto_margin(true);
            axis.grid_color(GRID).line_color("#999").show_line(true).zero_line(false)
        };
        Figure {
            id: id.to_owned(),
            caption: caption.to_owned(),
            height_px: 400,
            plot: Plot::new(),
            x: axis(x),
            y: axis(y),
            shapes: Vec::new(),
            notes: Vec::new(),
            rows: Vec::new(),
            n_named: 0,
        }
    }

    /// Another height than 400 px.
    pub fn height(mut self, pixels: usize) -> Self {
        self.height_px = pixels;
        self
    }

    /// The y axis from one value to another, until someone zooms.
    pub fn y_range(mut self, from: f64, to: f64) -> Self {
        self.y = self.y.range(vec![from, to]);
        self
    }

    /// The x axis from one value to another, until someone zooms.
    pub fn x_range(mut self, from: f64, to: f64) -> Self {
        self.x = self.x.range(vec![from, to]);
        self
    }

    /// The y axis from zero on.
    pub fn y_from_zero(mut self) -> Self {
        self.y = self.y.range_mode(RangeMode::ToZero);
        self
    }

    /// The x axis logarithmic.
    pub fn x_log(mut self) -> Self {
        self.x = self.x.type_(AxisType::Log);
        self
    }

    /// Adds a line through points; NaN breaks it. An empty name keeps it out of the legend.
    ///
    /// # Shapes
    /// `x`, `y`: `[n]`.
    pub fn line(&mut self, name: &str, x: Vec<f64>, y: Vec<f64>, style: Style) {
        let mode = if style.markers { Mode::LinesMarkers } else { Mode::Lines };
        self.scatter(name, x, y, mode, &style);
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
        self.scatter(name, x, y, Mode::Markers, &style);
    }

    fn scatter(&mut self, name: &str, x: Vec<f64>, y: Vec<f64>, mode: Mode, style: &Style) {
        let line = Line::new().color(style.colour).dash(style.dash.clone()).width(style.width);
        let marker = Marker::new().color(style.colour).symbol(style.symbol.clone()).size(style.marker_px);
        let trace = Scatter::new(x, y).mode(mode).line(line).marker(marker).connect_gaps(false);
        self.n_named += usize::from(!name.is_empty());
        self.plot.add_trace(trace.name(name).show_legend(!name.is_empty()));
    }

    /// Adds points over names instead of numbers.
    ///
    /// # Shapes
    /// `names`, `y`: `[n]`.
    pub fn named_points(&mut self, name: &str, names: Vec<String>, y: Vec<f64>, style: Style) {
        self.n_named += usize::from(!name.is_empty());
        self.x = self.x.clone().type_(AxisType::Category);
        let marker = Marker::new().color(style.colour).symbol(style.symbol).size(9);
        let trace = Scatter::new(names, y).mode(Mode::Markers).marker(marker);
        self.plot.add_trace(trace.name(name).show_legend(!name.is_empty()));
    }

    /// Adds a thin line from one value over a name to another.
    pub fn link(&mut self, name: &str, from: f64, to: f64) {
        let trace = Scatter::new(vec![name.to_owned(), name.to_owned()], vec![from, to]).mode(Mode::Lines);
        self.plot
            .add_trace(trace.line(Line::new().color("#999").width(1.0)).show_legend(false).hover_info(HoverInfo::Skip));
    }

    /// Adds a bar to each of several groups.
    ///
    /// # Shapes
    /// `groups`, `values`: `[n]`; NaN is no bar.
    pub fn bars(&mut self, name: &str, groups: Vec<String>, values: Vec<f64>, style: Style) {
        self.n_named += usize::from(!name.is_empty());
        let trace = Bar::new(groups, values).marker(Marker::new().color(style.colour));
        self.plot.add_trace(trace.name(name).show_legend(!name.is_empty()));
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
        let line = Line::new().color(style.colour).width(9.0).dash(DashType::Solid);
        let trace = Scatter::new(x, y).mode(Mode::Lines).line(line).connect_gaps(false);
        self.plot.add_trace(trace.name(name).show_legend(false).y_axis("y2"));
    }

    /// Adds a map of values by row and column.
    pub fn heat(&mut self, heat: Heat) {
        let [from, to] = heat.range;
        let palette = if from < 0.0 { ColorScalePalette::RdBu } else { ColorScalePalette::Cividis };
        let bar = ColorBar::new().title(Title::from(heat.unit.as_str())).thickness(14);
        // The axis begins at the bottom.
        let (rows, values) = (heat.rows.into_iter().rev().collect(), heat.values.into_iter().rev().collect());
        let trace = HeatMap::new(heat.columns, rows, values);
        let trace = trace.zmin(from).zmax(to).zmid((from + to) / 2.0).color_scale(ColorScale::Palette(palette));
        self.plot.add_trace(trace.color_bar(bar).hover_on_gaps(false));
    }

    /// Adds a dashed level across the plot, with a few words on it.
    pub fn level(&mut self, y: f64, words: &str) {
        let line = ShapeLine::new().color("#666").width(1.0).dash(DashType::Dash);
        let shape = Shape::new().shape_type(ShapeType::Line).x_ref("paper").y_ref("y").layer(ShapeLayer::Below);
        self.shapes.push(shape.x0(0).x1(1).y0(y).y1(y).line(line));
        let note = Annotation::new().text(words).show_arrow(false).x_ref("paper").y_ref("y").x(1.0).y(y);
        self.notes.push(note.x_anchor(Anchor::Right).y_anchor(Anchor::Bottom).font(Font::new().size(12).color("#444")));
    }

    pub(super) fn markup(&self, is_synthetic: bool) -> Markup {
        let mut plot = self.plot.clone();
        let mut notes = self.notes.clone();
        if is_synthetic {
            let note = Annotation::new().text("synthetic data").show_arrow(false).x_ref("paper").y_ref("paper");
            let note = note.x(1.0).y(1.0).x_anchor(Anchor::Right).y_anchor(Anchor::Top);
            notes.push(note.background_color("#fff").font(Font::new().size(11).color("#7a5f00")));
        }
        let mut layout = Layout::new()
            .auto_size(true)
            .height(self.height_px)
            .font(Font::new().family(FONT).color(INK).size(13))
            .margin(Margin::new().left(60).right(12).top(12).bottom(48).auto_expand(true))
            .paper_background_color("#fff")
            .plot_background_color("#fff")
            .hover_mode(HoverMode::Closest)
            .bar_mode(BarMode::Group)
            .show_legend(self.n_named > 1)
            .shapes(self.shapes.clone())
            .annotations(notes)
            .legend(
                Legend::new()
                    .orientation(Orientation::Horizontal)
                    .x(0.0)
                    .y(1.0)
                    .y_anchor(Anchor::Bottom)
                    .x_anchor(Anchor::Left),
            );
        let mut y = self.y.clone();
        if !self.rows.is_empty() {
            y = y.domain(&[ROWS_SHARE + ROWS_GAP, 1.0]);
            let places = (0..self.rows.len()).map(|row| -(row as f64)).collect();
            let rows = Axis::new().domain(&[0.0, ROWS_SHARE]).tick_values(places).tick_text(self.rows.clone());
            let lowest = -(self.rows.len() as f64) + 0.4;
            layout = layout.y_axis2(
                rows.range(vec![lowest, 0.6]).fixed_range(true).show_grid(false).zero_line(false).auto_margin(true),
            );
        }
        let mut x = self.x.clone();
        if !self.rows.is_empty() {
            x = x.anchor("y2");
        }
        plot.set_layout(layout.x_axis(x).y_axis(y));
        plot.set_configuration(
            Configuration::new()
                .responsive(true)
                .display_logo(false)
                .display_mode_bar(DisplayModeBar::Hover)
                .mode_bar_buttons_to_remove(vec![ModeBarButtonName::Select2d, ModeBarButtonName::Lasso2d]),
        );
        html! {
            figure {
                div.plot style={ "height:" (self.height_px) "px" } {
                    (PreEscaped(plot.to_inline_html(Some(&self.id))))
                }
                figcaption { (self.caption) }
            }
        }
    }
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

/// The library that draws, as a script element. What comes with it for formulas is left out.
pub(super) fn script() -> String {
    const END: &str = "</script>";
    let sources = Plot::offline_js_sources();
    let end = sources.find(END).map_or(sources.len(), |at| at + END.len());
    sources[..end].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_without_samples_breaks_a_line_and_uneven_steps_do_not() {
        let (x, y) = broken(&[0.0, 1.0, 2.2, 3.0, 9.0, 10.0], &[1.0, 2.0, f64::NAN, 4.0, 5.0, 6.0]);
        assert_eq!(x, [0.0, 1.0, 2.2, 3.0, 6.0, 9.0, 10.0]);
        assert!(y[4].is_nan() && y[2].is_nan() && y[5] == 5.0, "{y:?}");
        assert_eq!(broken(&[], &[]), (vec![], vec![]));
        assert_eq!(broken(&[3.0], &[1.0]).0, [3.0]);
    }
}
