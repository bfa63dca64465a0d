//! The parts of a picture that show one fingertip: force over time, and who said contact when.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use tactile_pose_fusion::eval::{ScoredFrames, Scoring};

use super::{LABELS_PX, Painted, Stretch};
use crate::page::longest_step;

/// A chart of force over time.
pub(super) type ForceChart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// A fingertip: its true force, and the estimates of each model.
pub(super) struct Panel<'a> {
    /// Frames with the true force.
    pub(super) truth: &'a ScoredFrames,
    /// Name, colour and frames of each model.
    pub(super) estimates: Vec<(&'static str, RGBColor, &'a ScoredFrames)>,
}

impl Panel<'_> {
    /// Draws a line for the true force and for each model.
    pub(super) fn draw_forces(&self, chart: &mut ForceChart<'_, '_>, stretch: &Stretch) -> Painted {
        let Stretch { lowest_gf, highest_gf, .. } = *stretch;
        let mut line = |name: &str, points: Vec<(f64, Option<f64>)>, colour: RGBColor, width: u32| -> Painted {
            chart
                .draw_series(
                    unbroken(&points).into_iter().map(|run| PathElement::new(run, colour.stroke_width(width))),
                )?
                .label(name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
            Ok(())
        };
        let truth =
            |idx: usize| Some(self.truth.truth_gf[idx]).filter(|gf| gf.is_finite()).map(|gf| gf.min(highest_gf));
        line("true force", stretch.points(self.truth, truth), BLACK, 2)?;
        for (name, colour, frames) in &self.estimates {
            let force =
                |idx: usize| frames.estimate_gf.get(idx).copied().flatten().map(|gf| gf.clamp(lowest_gf, highest_gf));
            line(name, stretch.points(frames, force), *colour, 1)?;
        }
        Ok(())
    }

    /// Draws a row for true contact and for the contact of each model.
    pub(super) fn draw_contacts(
        &self,
        area: &DrawingArea<SVGBackend<'_>, Shift>,
        stretch: &Stretch,
        letters_px: i32,
    ) -> Painted {
        let rows = self.estimates.len() as i32 + 1;
        let height_px = area.dim_in_pixel().1 as i32;
        let mut chart = ChartBuilder::on(area)
            .margin_left(10)
            .margin_right(10)
            .y_label_area_size(LABELS_PX)
            .build_cartesian_2d(0.0..stretch.span_s, 0..rows)?;
        let mut row = |idx: i32, name: &str, states: Vec<(f64, bool)>, colour: RGBColor| -> Painted {
            let y = rows - 1 - idx;
            for (from, to) in stretches(&states) {
                chart.draw_series([Rectangle::new([(from, y), (to, y + 1)], colour.mix(0.8).filled())])?;
            }
            let middle = (height_px * (2 * idx + 1)) / (2 * rows) - letters_px / 2 - 1;
            area.draw(&Text::new(format!("contact, {name}"), (8, middle), ("sans-serif", letters_px).into_font()))?;
            Ok(())
        };
        let scoring = Scoring::default();
        let is_touch = |idx: usize| scoring.is_touch(self.truth.truth_gf[idx]);
        row(0, "true", stretch.points(self.truth, is_touch), BLACK)?;
        for (idx, (name, colour, frames)) in (1..).zip(&self.estimates) {
            row(idx, name, stretch.points(frames, |idx| frames.contact[idx]), *colour)?;
        }
        Ok(())
    }
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
