//! Scores: the table in the paper's shape, over force, by user, with a worse pose, and against gates.

use std::collections::BTreeSet;

use tactile_pose_fusion::eval::{ForceCurve, Measure, Metric, PairedTest, ResultTable, TangentialScore, Verdict};
use tactile_pose_fusion::evaluate::{Evaluated, ModelScores};

use super::super::pose_quality::words;
use super::super::text::{
    CHANGES_IN_WORDS, MEASURES_IN_WORDS, TANGENTIAL, improvement, is_of_several, measure_name, number, short_list,
    tangential_mae, touch_by,
};
use super::super::verdict::Said;
use super::{slug, style};
use crate::page::{Cell, Figure, Page, Section, Style, Table};
use crate::report::checks;

const BA_AT_MDF: f64 = 100.0 * tactile_pose_fusion::eval::MDF_BALANCED_ACCURACY;

pub(super) fn verdict(page: &mut Page, result: &Evaluated) {
    let users: BTreeSet<_> = result.sessions.iter().map(|session| (&session.glove, &session.user)).collect();
    let gloves: BTreeSet<_> = result.sessions.iter().map(|session| &session.glove).collect();
    let section = page.section("verdict", "Verdict");
    if let Some(Said { kind, word, sentence }) = super::super::verdict::verdict(result) {
        section.verdict(kind, &word, &sentence);
    }
    section.text(&format!(
        "Scored: {} of {}, {}, {}. Touch is a true force of 2.5 gF (0.0245 N) or more.",
        result.scored,
        counted(result.sessions.len(), "session"),
        counted(users.len(), "user"),
        counted(gloves.len(), "glove")
    ));
    for (lack, of) in result.missing() {
        section.text(&format!("Missing: {lack} ({}).", short_list(&of, result.sessions.len())));
    }
    for failed in &result.failed {
        section.text(&format!("Not scored: {}", failed.error));
    }
}

pub(super) fn table_of_all(page: &mut Page, result: &Evaluated) {
    let section = page.section("scores", "Scores");
    section.text(MEASURES_IN_WORDS);
    section.table(&table("table-scores", "All scored frames", &result.table));
    touch_by(result).iter().for_each(|line| {
        section.text(line);
    });
    result.improvements.iter().for_each(|change| {
        section.text(&improvement(change));
    });
    if !result.improvements.is_empty() {
        section.text(CHANGES_IN_WORDS);
    }
    let tangential = result.tangential();
    if !tangential.is_empty() {
        section.table(&tangential_table(&tangential));
    }
    if result.free_movement_table.rows.iter().any(|row| row.cells.iter().any(Option::is_some)) {
        let caption = "Free movement alone: poses that nobody asked for";
        section.table(&table("table-free", caption, &result.free_movement_table));
    }
}

fn table(id: &str, caption: &str, of: &ResultTable) -> Table {
    let header = ["Glove, model", "BA %", "F1 %", "MDF gF", "MAE gF", "R2", "Frames"].map(str::to_owned).to_vec();
    let mut rows = Vec::new();
    for (glove_idx, glove) in of.gloves.iter().enumerate() {
        for row in &of.rows {
            let Some(cell) = row.cells.get(glove_idx).copied().flatten() else { continue };
            let mut cells: Vec<Cell> = vec![format!("{glove}, {}", row.model).into()];
            cells.extend(Measure::ALL.map(|measure| Cell { text: cell.text(measure), value: cell.value(measure) }));
            cells.push(Cell::count(cell.coverage.n_scored));
            rows.push(cells);
        }
    }
    Table { id: id.to_owned(), caption: caption.to_owned(), header, rows }
}

fn tangential_table(scores: &[(&str, &str, TangentialScore)]) -> Table {
    let header = ["Glove, model", "MAE N (gF)", "Angle deg", "Bias x gF", "Bias y gF", "Bias z gF", "Frames"];
    let row = |(glove, model, score): &(&str, &str, TangentialScore)| {
        let mae = Cell { text: tangential_mae(score), value: score.mae_gf.value() };
        let cell = |metric: Metric| Cell { text: number(metric, 1), value: metric.value() };
        let mut cells: Vec<Cell> = vec![format!("{glove}, {model}").into(), mae, cell(score.angle_deg)];
        cells.extend(score.bias_gf.map(cell));
        cells.push(Cell::count(score.n_frames));
        cells
    };
    Table {
        id: "table-tangential".to_owned(),
        caption: TANGENTIAL.to_owned(),
        header: header.map(str::to_owned).to_vec(),
        rows: scores.iter().map(row).collect(),
    }
}

pub(super) fn over_force(page: &mut Page, result: &Evaluated) {
    let section = page.section("force", "By true force");
    for glove in &result.table.gloves {
        let caption = format!(
            "Glove {glove}: balanced accuracy of touch by true force, in bins of 10 gF, each paired with all frames without touch. The minimal detectable force is where the curve first crosses {BA_AT_MDF} %. Stronger forces are to the right: double-click shows them."
        );
        let mut ba = Figure::new(&format!("ba-{}", slug(glove)), &caption, "true force, gF", "balanced accuracy, %");
        let caption = format!("Glove {glove}: mean absolute error by true force. The first point is the air.");
        let mut mae =
            Figure::new(&format!("mae-{}", slug(glove)), &caption, "true force, gF", "mean absolute error, gF")
                .y_from_zero();
        let mut highest_mdf = 0.0_f64;
        for (series, model) in result.models.iter().enumerate() {
            let Some(curve) = model.curves.get(glove) else { continue };
            let points = curve.points().filter(|(force, _)| *force <= reach(curve));
            let (x, y): (Vec<f64>, Vec<f64>) = points.map(|(force, ba)| (force, 100.0 * ba)).unzip();
            let mdf = curve.mdf();
            let name = match mdf.value() {
                Some(force) => format!("{}: MDF {force:.1} gF", model.name),
                None => format!("{}: MDF {mdf}", model.name),
            };
            ba.line(&name, x, y, style(result, series).marked());
            if let Some(force) = mdf.value() {
                highest_mdf = highest_mdf.max(force);
                ba.points("", vec![force], vec![BA_AT_MDF], style(result, series).large());
            }
            let air = curve.no_touch.mae_gf.value().map(|mae| (0.0, mae));
            let bins = curve.bins.iter().filter(|bin| bin.centre_gf <= reach(curve));
            let bins = bins.filter_map(|bin| Some((bin.centre_gf, bin.mae_gf.value()?)));
            let (x, y) = air.into_iter().chain(bins).unzip();
            mae.line(&model.name, x, y, style(result, series).marked());
        }
        ba.level(BA_AT_MDF, &format!("{BA_AT_MDF} %"));
        let shown = (4.0 * highest_mdf).max(120.0);
        section.figure(&ba.y_range(45.0, 101.0).x_range(0.0, shown)).figure(&mae);
    }
}

fn counted(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// Up to which force bins are shown: the last one that holds more than a handful of frames.
pub(super) fn reach(curve: &ForceCurve) -> f64 {
    let well_filled = curve.bins.iter().rev().find(|bin| bin.n >= 50);
    well_filled.map_or(f64::INFINITY, |bin| bin.centre_gf)
}

pub(super) fn users(page: &mut Page, result: &Evaluated) {
    if !result.paired.iter().any(|pairing| pairing.tests.iter().any(is_of_several)) {
        return;
    }
    let section = page.section("users", "By user");
    section.text("Each user with both models. p: one-sided exact Wilcoxon signed-rank test that the change improves the measure. d_z: Cohen's effect size, the mean of the changes over their standard deviation. A user whose measure has no value is left out and named.");
    for (idx, pairing) in result.paired.iter().enumerate() {
        let header = ["Glove, measure", "Better for", "p", "d_z", "Left out"].map(str::to_owned).to_vec();
        let rows = pairing.tests.iter().filter(|test| is_of_several(test)).map(|test| {
            let p = test.wilcoxon.as_ref().map(|wilcoxon| wilcoxon.p);
            vec![
                format!("{}, {}", test.glove, measure_name(test.measure)).into(),
                Cell {
                    text: format!("{} of {}", test.n_improved, test.pairs.len()),
                    value: Some(test.n_improved as f64),
                },
                Cell::maybe(p, 4),
                metric(test.d_z, 1.0, 2),
                test.left_out.join(", ").into(),
            ]
        });
        let caption = format!("{} to {}", pairing.from, pairing.to);
        section.table(&Table { id: format!("table-paired-{idx}"), caption, header, rows: rows.collect() });
        for measure in [Measure::Ba, Measure::Mdf, Measure::Mae] {
            let tests: Vec<&PairedTest> =
                pairing.tests.iter().filter(|test| test.measure == measure && is_of_several(test)).collect();
            if !tests.is_empty() {
                section.figure(&pairs(
                    &format!("pairs-{idx}-{}", slug(measure_name(measure))),
                    measure,
                    &tests,
                    pairing_names(result, idx),
                ));
            }
        }
    }
}

fn pairing_names(result: &Evaluated, idx: usize) -> (&str, &str) {
    (&result.paired[idx].from, &result.paired[idx].to)
}

fn pairs(id: &str, measure: Measure, tests: &[&PairedTest], (from, to): (&str, &str)) -> Figure {
    let (unit, scale) = match measure {
        Measure::Ba | Measure::F1 => ("%", 100.0),
        Measure::Mdf | Measure::Mae => ("gF", 1.0),
        Measure::R2 => ("", 1.0),
    };
    let better = if measure.higher_is_better() { "higher" } else { "lower" };
    let name = measure_name(measure);
    let caption = format!("{name} of every user, {better} is better.");
    let mut figure = Figure::new(id, &caption, "user", &format!("{name}, {unit}")).height(300);
    let users: Vec<String> = tests
        .iter()
        .flat_map(|test| test.pairs.iter().map(|pair| format!("glove {}, user {}", test.glove, pair.user)))
        .collect();
    let of = |value: fn(&tactile_pose_fusion::eval::UserPair) -> f64| {
        tests.iter().flat_map(|test| test.pairs.iter().map(move |pair| scale * value(pair))).collect::<Vec<f64>>()
    };
    for (user, (base, changed)) in users.iter().zip(of(|pair| pair.base).into_iter().zip(of(|pair| pair.changed))) {
        figure.link(user, base, changed);
    }
    figure.named_points(from, users.clone(), of(|pair| pair.base), Style::of(1));
    figure.named_points(to, users, of(|pair| pair.changed), Style::of(0));
    figure
}

pub(super) fn pose_quality(page: &mut Page, result: &Evaluated) {
    let Some(judged) = result.models.last().filter(|_| !result.pose_quality.is_empty()) else { return };
    let section = page.section("pose-quality", "With a worse pose");
    section.text("The judged model again, with its joint angles made worse on purpose, one way at a time.");
    let base = result.models.iter().find(|model| model.name == format!("{}, base", judged.name));
    for glove in &result.table.gloves {
        let caption = format!("Glove {glove}: force error of {} by what was done to the joint angles.", judged.name);
        let mut figure = Figure::new(&format!("pose-{}", slug(glove)), &caption, "", "mean absolute error, gF")
            .height(340)
            .y_from_zero();
        let (mut names, mut errors) = (vec!["as recorded".to_owned()], Vec::new());
        let mae = |model: &ModelScores| {
            let of_glove = model.by.get("glove")?.iter().find(|one| &one.group.to_string() == glove)?;
            of_glove.score.mae_gf.value()
        };
        errors.push(mae(judged).unwrap_or(f64::NAN));
        for level in &result.pose_quality {
            let Some(found) = level.scores.iter().find(|one| &one.group.to_string() == glove) else { continue };
            names.push(words(&level.quality).1);
            errors.push(found.score.mae_gf.value().unwrap_or(f64::NAN));
        }
        figure.bars("", names, errors, Style::of(0));
        if let Some(level) = base.and_then(mae) {
            figure.level(level, "base: no pose");
        }
        section.figure(&figure);
    }
}

pub(super) fn gates(page: &mut Page, result: &Evaluated) {
    if result.checks.is_empty() {
        return;
    }
    let section: &mut Section = page.section("gates", "Gates");
    section.text(checks::text(&result.checks).lines().last().unwrap_or_default());
    let header = ["Gate", "Value", "Wanted", "Verdict"].map(str::to_owned).to_vec();
    let rows = result.checks.iter().map(|check| {
        let verdict = match &check.verdict {
            Verdict::Passed => "passed".to_owned(),
            Verdict::Failed(reason) => format!("FAILED: {reason}"),
            Verdict::Skipped(reason) => format!("skipped: {reason}"),
        };
        vec![check.name.clone().into(), Cell::maybe(check.value, 4), check.expected.clone().into(), verdict.into()]
    });
    section.table(&Table { id: "table-gates".to_owned(), header, rows: rows.collect(), ..Table::default() });
}

/// A measure scaled for a person to read, or why there is none; the value in full is as it was.
pub(super) fn metric(metric: Metric, scale: f64, digits: usize) -> Cell {
    match metric {
        Metric::Value(value) => Cell { text: format!("{:.digits$}", scale * value), value: Some(value) },
        Metric::Undefined { undefined } => undefined.to_string().into(),
    }
}
