//! Force over time in a picture: truth, both models, and who said contact when.

use plotters::prelude::*;
use tactile_pose_fusion::eval::{ScoredFrames, Scoring};

use crate::page::longest_step;

/// Length of the part of the session that is shown, s.
const SPAN_S: f64 = 25.0;

/// Upper limit of the force axis, gF: a firm press must not make light touches invisible.
const CUT_GF: f64 = 100.0;

const SIZE: (u32, u32) = (1000, 500);

/// Height of the rows of contact, and width of what stands left of the axes.
const CONTACTS_PX: u32 = 130;
const LABELS_PX: u32 = 175;

/// Okabe and Ito's colours, which people tell apart however they see them.
const ORANGE: RGBColor = RGBColor(230, 159, 0);
const BLUE: RGBColor = RGBColor(0, 114, 178);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const GRAY: RGBColor = RGBColor(110, 110, 110);
const LIGHT_GRAY: RGBColor = RGBColor(170, 170, 170);

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

/// An SVG of the stretch that shows most: light touches, and movement in the air that the model `by` takes for touch, or
/// touches that it misses.
///
/// # Errors
/// [`PictureError`] when no series has that name, or the drawing library refuses.
pub fn draw(series: &[(&str, ScoredFrames)], by: &str, glove: u8) -> Result<String, PictureError> {
    let (_, first) = series.iter().find(|(name, _)| *name == by).ok_or(PictureError::Empty)?;
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
    paint(&root, series, first, glove).map_err(|error| PictureError::Draw(error.to_string()))?;
    drop(root);
    Ok(svg)
}

type Painted = Result<(), Box<dyn std::error::Error>>;

fn paint(
    root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    series: &[(&str, ScoredFrames)],
    first: &ScoredFrames,
    glove: u8,
) -> Painted {
    root.fill(&WHITE)?;
    let range = telling_stretch(first);
    let start = first.stamp.get(range.start).copied().unwrap_or_default();
    let seconds = |frames: &ScoredFrames, idx: usize| frames.stamp[idx].nanos_since(start) as f64 * 1e-9;
    let colours = [LIGHT_GRAY, ORANGE, BLUE, GREEN];
    let truth = range.clone().map(|idx| first.truth_gf[idx]).filter(|force| force.is_finite());
    let highest = (1.3 * truth.fold(30.0_f64, f64::max)).min(CUT_GF); // forces beyond it are drawn at the edge
    let lowest = -0.2 * highest;

    let (upper, lower) = root.split_vertically(SIZE.1 - CONTACTS_PX);
    let title = format!("Synthetic glove {glove}: force on a fingertip while the hand moves and touches");
    let mut chart = ChartBuilder::on(&upper)
        .caption(title, ("sans-serif", 18))
        .margin(10)
        .x_label_area_size(34)
        .y_label_area_size(LABELS_PX)
        .build_cartesian_2d(0.0..SPAN_S, lowest..highest)?;
    chart.configure_mesh().x_desc("time, s").y_desc("force, gF (cut at the edges)").light_line_style(WHITE).draw()?;
    let mut line = |name: &str, points: Vec<(f64, Option<f64>)>, colour: RGBColor, width: u32| -> Painted {
        chart
            .draw_series(unbroken(&points).into_iter().map(|run| PathElement::new(run, colour.stroke_width(width))))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
        Ok(())
    };
    let truth = range.clone().map(|idx| (seconds(first, idx), Some(first.truth_gf[idx].min(highest))));
    line("true force", truth.collect(), BLACK, 2)?;
    for ((name, frames), colour) in series.iter().zip(colours) {
        let known = range.clone().filter(|idx| *idx < frames.stamp.len());
        let force = |idx: usize| frames.estimate_gf.get(idx).copied().flatten().map(|gf| gf.clamp(lowest, highest));
        let points = known.map(|idx| (seconds(frames, idx), force(idx)));
        line(name, points.collect(), colour, 1)?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(GRAY)
        .label_font(("sans-serif", 13))
        .draw()?;

    let rows = series.len() as i32 + 1;
    let mut contacts = ChartBuilder::on(&lower)
        .margin_left(10)
        .margin_right(10)
        .y_label_area_size(LABELS_PX)
        .build_cartesian_2d(0.0..SPAN_S, 0..rows)?;
    let scoring = Scoring::default();
    let mut row = |idx: i32, name: &str, states: Vec<(f64, bool)>, colour: RGBColor| -> Painted {
        let y = rows - 1 - idx;
        for (from, to) in stretches(&states) {
            contacts.draw_series([Rectangle::new([(from, y), (to, y + 1)], colour.mix(0.8).filled())])?;
        }
        let middle = (CONTACTS_PX as i32 * (2 * idx + 1)) / (2 * rows) - 7; // half the height of the letters
        lower.draw(&Text::new(format!("contact, {name}"), (8, middle), ("sans-serif", 12).into_font()))?;
        Ok(())
    };
    let states = |frames: &ScoredFrames, state: &dyn Fn(usize) -> bool| -> Vec<(f64, bool)> {
        range.clone().filter(|idx| *idx < frames.stamp.len()).map(|idx| (seconds(frames, idx), state(idx))).collect()
    };
    row(0, "true", states(first, &|idx| scoring.is_touch(first.truth_gf[idx])), BLACK)?;
    for (idx, ((name, frames), colour)) in series.iter().zip(colours).enumerate() {
        row(idx as i32 + 1, name, states(frames, &|idx| frames.contact[idx]), colour)?;
    }
    root.present()?;
    Ok(())
}

/// The runs of points that a line goes through: it ends where a force is unknown, and where frames are missing.
fn unbroken(points: &[(f64, Option<f64>)]) -> Vec<Vec<(f64, f64)>> {
    let longest = longest_step(&points.iter().map(|(at, _)| *at).collect::<Vec<_>>());
    let (mut runs, mut open): (Vec<Vec<(f64, f64)>>, Option<f64>) = (Vec::new(), None);
    for (at, force) in points {
        let Some(force) = force.filter(|force| force.is_finite()) else {
            open = None;
            continue;
        };
        match runs.last_mut() {
            Some(run) if open.is_some_and(|before| at - before <= longest) => run.push((*at, force)),
            _ => runs.push(vec![(*at, force)]),
        }
        open = Some(*at);
    }
    runs
}

/// From when to when a state held; not over time without frames.
fn stretches(states: &[(f64, bool)]) -> Vec<(f64, f64)> {
    let longest = longest_step(&states.iter().map(|(at, _)| *at).collect::<Vec<_>>());
    let mut found: Vec<(f64, f64)> = Vec::new();
    let mut open = false;
    for pair in states.windows(2) {
        let ((from, state), (next, _)) = (pair[0], pair[1]);
        let is_gap = next - from > longest;
        let to = if is_gap { from } else { next };
        match found.last_mut() {
            Some(last) if state && open => last.1 = to,
            _ if state => found.push((from, to)),
            _ => {}
        }
        open = state && !is_gap;
    }
    found
}

/// The stretch in which the first series is most often wrong about touch, among those that hold touch and air.
fn telling_stretch(frames: &ScoredFrames) -> std::ops::Range<usize> {
    let n = frames.stamp.len();
    let scoring = Scoring::default();
    let is_touch: Vec<bool> = frames.truth_gf.iter().map(|truth| scoring.is_touch(*truth)).collect();
    let span_ns = (SPAN_S * 1e9) as i64;
    let mut best = (0..n.min(1), 0);
    for start in (0..n).step_by(100) {
        let end =
            start + frames.stamp[start..].partition_point(|stamp| stamp.nanos_since(frames.stamp[start]) < span_ns);
        let n_touch = is_touch[start..end].iter().filter(|touch| **touch).count();
        let wrong = (start..end).filter(|&idx| frames.contact[idx] != is_touch[idx]).count();
        let mixed = (end - start) / 5..=(end - start) * 4 / 5;
        if mixed.contains(&n_touch) && wrong >= best.1 {
            best = (start..end, wrong);
        }
    }
    if best.1 > 0 { best.0 } else { 0..frames.stamp.partition_point(|at| at.nanos_since(frames.stamp[0]) < span_ns) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_states_end_where_frames_or_forces_are_missing() {
        let at = |k: usize| k as f64 + if k >= 5 { 20.0 } else { 0.0 };
        let points: Vec<(f64, Option<f64>)> = (0..10).map(|k| (at(k), (k != 2).then_some(k as f64))).collect();
        let runs: Vec<usize> = unbroken(&points).iter().map(Vec::len).collect();
        assert_eq!(runs, [2, 2, 5], "without a force at 2 s, without frames from 4 s to 25 s");
        let nan: Vec<(f64, Option<f64>)> = vec![(0.0, Some(f64::NAN)), (1.0, Some(1.0)), (2.0, None)];
        assert_eq!(unbroken(&nan), [vec![(1.0, 1.0)]]);
        let states: Vec<(f64, bool)> = (0..10).map(|k| (at(k), true)).collect();
        assert_eq!(stretches(&states), [(0.0, 4.0), (25.0, 29.0)]);
    }
}
