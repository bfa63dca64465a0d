//! Touches: found, missed, how late, and those that were told in the air.

use std::collections::BTreeMap;

use tactile_pose_fusion::eval::{Distribution, InAir, InAirReport};
use tactile_pose_fusion::evaluate::Evaluated;

use super::scores::metric;
use super::{slug, style};
use crate::page::{Cell, Figure, Page, Section, Table};

/// Poses that a plot shows.
const N_POSES: usize = 20;

/// Latencies that are shown before someone zooms out, ms: a window's blur before, a slow press after.
const SHOWN_MS: [f64; 2] = [-150.0, 350.0];

pub(super) fn contacts(page: &mut Page, result: &Evaluated) {
    let section = page.section("contact", "Contact");
    section.text("Contact as it is published: with hysteresis and debounce. Removed: a true touch that the base force told and the corrected force did not. Delayed: one that it told more than 50 ms later.");
    let header = [
        "Glove, model",
        "Touches",
        "Missed",
        "False a minute",
        "Onset ms, median",
        "95th percentile",
        "Offset ms, median",
        "95th percentile",
        "Removed",
        "Delayed",
    ];
    let mut rows = Vec::new();
    for model in &result.models {
        for (glove, contact) in &model.contacts {
            let found = &contact.detection;
            let kept = contact.preservation.as_ref();
            let of =
                |latency: Option<Distribution>, at: fn(&Distribution) -> f64| Cell::maybe(latency.as_ref().map(at), 0);
            rows.push(vec![
                format!("{glove}, {}", model.name).into(),
                Cell::count(found.n_true),
                Cell::count(found.n_missed),
                metric(found.air.per_minute, 1.0, 2),
                of(found.onset_ms, |latency| latency.p50),
                of(found.onset_ms, |latency| latency.p95),
                of(found.offset_ms, |latency| latency.p50),
                of(found.offset_ms, |latency| latency.p95),
                kept.map_or_else(|| "-".into(), |kept| Cell::count(kept.n_removed)),
                kept.map_or_else(|| "-".into(), |kept| Cell::count(kept.n_delayed)),
            ]);
        }
    }
    let header = header.map(str::to_owned).to_vec();
    section.table(&Table { id: "table-contact".to_owned(), header, rows, ..Table::default() });
    for glove in &result.table.gloves {
        for (what, words) in [("onset", "Onset"), ("offset", "Offset")] {
            let caption = format!(
                "Glove {glove}: {words} of touches, detected minus true: the share that was detected so early. Negative is before the true force reached 2.5 gF, as the model's window and the noise allow."
            );
            let id = format!("{what}-{}", slug(glove));
            let mut figure =
                Figure::new(&id, &caption, &format!("{what} latency, ms"), "share of touches, %").height(320);
            for latencies in result.evidence.latencies.iter().filter(|latencies| latencies.glove == *glove) {
                let samples = if what == "onset" { &latencies.onset } else { &latencies.offset };
                let (x, y) = shares(samples);
                let series = latencies.series;
                figure.line(&result.models[series].name, x, y, style(result, series));
            }
            section.figure(&figure.x_range(SHOWN_MS[0], SHOWN_MS[1]).y_range(0.0, 101.0));
        }
    }
}

/// Samples in their order, and the share, in percent, of those that are no larger.
fn shares(samples: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut sorted = samples.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len() as f64;
    let y = (0..sorted.len()).map(|idx| 100.0 * (idx + 1) as f64 / n).collect();
    (sorted, y)
}

pub(super) fn in_air(page: &mut Page, result: &Evaluated) {
    let gloves: std::collections::BTreeSet<&String> = result
        .models
        .iter()
        .flat_map(|model| model.contacts.iter().filter(|(_, contact)| contact.in_air.is_some()).map(|(glove, _)| glove))
        .collect();
    if gloves.is_empty() {
        return;
    }
    let section = page.section("in-air", "False touches in the air, by pose");
    section
        .text("Where the annotations say that nothing touches: every force is an artifact, and every touch is false.");
    for glove in gloves {
        in_air_of(section, result, glove);
    }
    let header = [
        "Glove, model",
        "Minutes",
        "False touches",
        "False a minute",
        "Force gF, median",
        "95th percentile",
        "Largest",
    ]
    .map(str::to_owned)
    .to_vec();
    let mut rows = Vec::new();
    for model in &result.models {
        for (glove, contact) in &model.contacts {
            let Some(report) = &contact.in_air else { continue };
            let size = |at: fn(&Distribution) -> f64| Cell::maybe(report.total.abs_force_gf.as_ref().map(at), 1);
            rows.push(vec![
                format!("{glove}, {}", model.name).into(),
                Cell::number(report.total.minutes, 1),
                Cell::count(report.total.n_false_touches),
                metric(report.total.per_minute, 1.0, 2),
                size(|force| force.p50),
                size(|force| force.p95),
                size(|force| force.max),
            ]);
        }
    }
    section.table(&Table { id: "table-in-air".to_owned(), header, rows, ..Table::default() });
}

/// False touches and forces by pose, those poses first that have most of them.
fn in_air_of(section: &mut Section, result: &Evaluated, glove: &str) {
    let reports: Vec<(usize, &InAirReport)> = result
        .models
        .iter()
        .enumerate()
        .filter_map(|(series, model)| Some((series, model.contacts.get(glove)?.in_air.as_ref()?)))
        .collect();
    let rate = |found: &InAir| found.per_minute.value();
    let force = |found: &InAir| found.abs_force_gf.map(|size| size.p95);
    let has_false = reports.iter().any(|(_, report)| report.total.n_false_touches > 0);
    if has_false {
        let what = "false touches a minute";
        section.figure(&by_pose(result, glove, &reports, ("air", what, what), rate));
    } else {
        section.text(&format!("Glove {glove}: no false touch."));
    }
    let what = "95th percentile of the force that is estimated in the air";
    section.figure(&by_pose(result, glove, &reports, ("air-force", what, "force, gF"), force));
}

/// Bars of a figure by pose, the largest of all series first.
fn by_pose(
    result: &Evaluated,
    glove: &str,
    reports: &[(usize, &InAirReport)],
    (id, what, axis): (&str, &str, &str),
    of: fn(&InAir) -> Option<f64>,
) -> Figure {
    let mut largest: BTreeMap<&String, f64> = BTreeMap::new();
    for (pose, found) in reports.iter().flat_map(|(_, report)| &report.by_pose) {
        let highest = largest.entry(pose).or_default();
        *highest = highest.max(of(found).unwrap_or(0.0));
    }
    let mut poses: Vec<(&String, f64)> = largest.into_iter().collect();
    poses.sort_by(|a, b| b.1.total_cmp(&a.1));
    let n_all = poses.len();
    poses.retain(|(_, largest)| *largest > 0.0);
    let n_none = n_all - poses.len();
    let none = if n_none > 0 { format!(" {n_none} of {n_all} poses have none.") } else { String::new() };
    let more = if poses.len() > N_POSES { format!(" The {N_POSES} poses with most.") } else { String::new() };
    poses.truncate(N_POSES);
    let caption = format!("Glove {glove}: {what}, by the pose that was asked for.{more}{none}");
    let height = 110 + poses.len() * (10 + 9 * reports.len());
    let mut figure = Figure::new(&format!("{id}-{}", slug(glove)), &caption, axis, "").height(height);
    for (series, report) in reports {
        let values = poses.iter().map(|(pose, _)| report.by_pose.get(*pose).and_then(of).unwrap_or(f64::NAN));
        let names = poses.iter().map(|(pose, _)| (*pose).clone()).collect();
        figure.lying_bars(&result.models[*series].name, names, values.collect(), style(result, *series));
    }
    figure
}
