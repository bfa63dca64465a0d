//! Force over time in a picture: truth, all models, and who said contact when.

mod panel;
mod stretch;

use plotters::coord::Shift;
use plotters::prelude::*;
use tactile_pose_fusion::eval::ScoredFrames;

use panel::Panel;
use stretch::Stretch;

/// Width of the picture, and of what stands left of the axes.
const WIDTH_PX: u32 = 1000;
const LABELS_PX: u32 = 175;

/// Height of the chart of one finger, and of its rows of contact.
const FORCES_PX: u32 = 370;
const CONTACTS_PX: u32 = 130;

/// Heights in a picture of several fingers: all above them, then of each finger, and the time axis below them.
const HEAD_PX: u32 = 74;
const HAND_FORCES_PX: u32 = 104;
const HAND_CONTACTS_PX: u32 = 39;
const TIME_PX: u32 = 50;

/// What people must know of a picture of several fingers.
const HAND_IN_WORDS: &str = "Only the finger above the load cell is touched. The others move in the air, so their contact is false. \
     Forces are cut at the edges.";

/// Okabe and Ito's colours, which people tell apart however they see them.
pub const ORANGE: RGBColor = RGBColor(230, 159, 0);
/// The second of them.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// The third.
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
/// For what is there for comparison.
pub const LIGHT_GRAY: RGBColor = RGBColor(170, 170, 170);
const GRAY: RGBColor = RGBColor(110, 110, 110);

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// No series has the name that was asked for.
    #[error("there is nothing to draw")]
    Empty,
    /// The drawing library refuses.
    #[error("picture: {0}")]
    Draw(String),
}

/// The estimates of a model.
#[derive(Debug)]
pub struct Series {
    /// Name of the model.
    pub name: &'static str,
    /// Its colour.
    pub colour: RGBColor,
    /// `[regions]`: its frames.
    pub regions: Vec<ScoredFrames>,
}

/// An SVG of the stretch that shows most: light touches, and movement in the air that the model `by` takes for touch, or
/// touches that it misses. Several regions are drawn one below the other.
///
/// # Shapes
/// `regions`: `[regions]`, their names.
/// # Errors
/// [`PictureError`] when no series has that name, or the drawing library refuses.
pub fn draw(series: &[Series], by: &str, glove: &str, regions: &[&str]) -> Result<String, PictureError> {
    let by = series.iter().find(|series| series.name == by).ok_or(PictureError::Empty)?;
    let stretch = Stretch::telling(&by.regions);
    let panels: Vec<Panel<'_>> = by.regions.iter().enumerate().map(|(idx, truth)| panel(series, idx, truth)).collect();
    let height_px = match panels.len() {
        0 => return Err(PictureError::Empty),
        1 => FORCES_PX + CONTACTS_PX,
        n => HEAD_PX + n as u32 * (HAND_FORCES_PX + HAND_CONTACTS_PX) + TIME_PX,
    };
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, (WIDTH_PX, height_px)).into_drawing_area();
    let painted = match panels.as_slice() {
        [only] => paint_one(&root, only, &stretch, glove),
        several => paint_hand(&root, several, &stretch, glove, regions),
    };
    painted.map_err(|error| PictureError::Draw(error.to_string()))?;
    drop(root);
    Ok(svg)
}

fn panel<'a>(series: &'a [Series], region_idx: usize, truth: &'a ScoredFrames) -> Panel<'a> {
    let of_region = |series: &'a Series| Some((series.name, series.colour, series.regions.get(region_idx)?));
    Panel { truth, estimates: series.iter().filter_map(of_region).collect() }
}

type Painted = Result<(), Box<dyn std::error::Error>>;
type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// One finger: its forces, and the rows of contact below them.
fn paint_one(root: &Area<'_>, panel: &Panel<'_>, stretch: &Stretch, glove: &str) -> Painted {
    root.fill(&WHITE)?;
    let (upper, lower) = root.split_vertically(FORCES_PX);
    let title = format!("Synthetic glove {glove}: force on a fingertip while the hand moves and touches");
    let mut chart = ChartBuilder::on(&upper)
        .caption(title, ("sans-serif", 18))
        .margin(10)
        .x_label_area_size(34)
        .y_label_area_size(LABELS_PX)
        .build_cartesian_2d(0.0..stretch.span_s, stretch.lowest_gf..stretch.highest_gf)?;
    chart.configure_mesh().x_desc("time, s").y_desc("force, gF (cut at the edges)").light_line_style(WHITE).draw()?;
    panel.draw_forces(&mut chart, stretch)?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(GRAY)
        .label_font(("sans-serif", 13))
        .draw()?;
    panel.draw_contacts(&lower, stretch, 12)?;
    root.present()?;
    Ok(())
}

/// Fingers one below the other, over the same time.
fn paint_hand(root: &Area<'_>, panels: &[Panel<'_>], stretch: &Stretch, glove: &str, names: &[&str]) -> Painted {
    root.fill(&WHITE)?;
    let (head, mut rest) = root.split_vertically(HEAD_PX);
    paint_head(&head, &panels[0], glove)?;
    for (panel, name) in panels.iter().zip(names) {
        let (forces, below) = rest.split_vertically(HAND_FORCES_PX);
        let (contacts, below) = below.split_vertically(HAND_CONTACTS_PX);
        rest = below;
        let mut chart = ChartBuilder::on(&forces)
            .margin_left(10)
            .margin_right(10)
            .margin_top(12)
            .y_label_area_size(LABELS_PX)
            .build_cartesian_2d(0.0..stretch.span_s, stretch.lowest_gf..stretch.highest_gf)?;
        chart.configure_mesh().y_desc("force, gF").y_labels(4).light_line_style(WHITE).draw()?;
        panel.draw_forces(&mut chart, stretch)?;
        let style = ("sans-serif", 16).into_font().style(FontStyle::Bold);
        forces.draw(&Text::new((*name).to_owned(), (8, 10), style))?;
        panel.draw_contacts(&contacts, stretch, 11)?;
    }
    paint_time(&rest, stretch)?;
    root.present()?;
    Ok(())
}

/// The title, what the lines are, and what people must know of them.
fn paint_head(area: &Area<'_>, panel: &Panel<'_>, glove: &str) -> Painted {
    let title = format!("Synthetic glove {glove}: force on all fingertips while the hand moves and touches");
    let below_title = area.margin(6, 0, 0, 0).titled(&title, ("sans-serif", 18))?;
    let left = LABELS_PX as i32 + 10;
    let truth = ("true force, while the load cell is under the finger", BLACK);
    let estimates = panel.estimates.iter().map(|(name, colour, _)| (*name, *colour));
    let style = ("sans-serif", 13).into_text_style(area);
    let mut x = left;
    for (name, colour) in std::iter::once(truth).chain(estimates) {
        below_title.draw(&PathElement::new([(x, 9), (x + 24, 9)], colour.stroke_width(2)))?;
        below_title.draw(&Text::new(name, (x + 30, 2), style.clone()))?;
        x += 60 + below_title.estimate_text_size(name, &style)?.0 as i32;
    }
    below_title.draw(&Text::new(HAND_IN_WORDS, (left, 20), style))?;
    Ok(())
}

/// The time axis that all fingers share.
fn paint_time(area: &Area<'_>, stretch: &Stretch) -> Painted {
    let mut chart = ChartBuilder::on(area)
        .margin_left(10)
        .margin_right(10)
        .margin_top(4)
        .margin_bottom(10)
        .x_label_area_size(34)
        .y_label_area_size(LABELS_PX)
        .build_cartesian_2d(0.0..stretch.span_s, 0.0..1.0)?;
    let letters = ("sans-serif", 12); // by itself they are as high as a part of the chart, which has no height here
    chart.configure_mesh().disable_mesh().disable_y_axis().label_style(letters).x_desc("time, s").draw()?;
    Ok(())
}
