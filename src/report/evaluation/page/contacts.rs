//! Touches: found, missed, how late, and those that were told in the air.

use super::scores::metric;
use super::{slug, style};
use crate::eval::Distribution;
use crate::evaluate::Evaluated;
use crate::page::{Cell, Figure, Page, Table};

/// What is shown of latencies before someone zooms out, ms: a window's blur before, a slow press after.
const SHOWN_MS: [f64; 2] = [-150.0, 350.0];

pub(super) fn contacts(page: &mut Page, result: &Evaluated) {
    let section = page.section("contact", "Contact");
    section.text("Contact as it is published: with hysteresis and debounce. Removed: a true touch that the base force told and the corrected force did not. Delayed: one that it told more than 50 ms later.");
    let header = [
        "Glove, model",
        "Touches",
        "Missed",
        "False/min",
        "Onset ms p50",
        "p95",
        "Offset ms p50",
        "p95",
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
    let section = page.section("in-air", "In the air");
    section
        .text("Where the annotations say that nothing touches: every force is an artifact, and every touch is false.");
    let header = ["Glove, model", "Minutes", "False touches", "False/min", "Force gF p50", "p95", "max"]
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
    for glove in gloves {
        let caption =
            format!("Glove {glove}: 95th percentile of the force told in the air, by the pose that was asked for.");
        let mut force = Figure::new(&format!("air-force-{}", slug(glove)), &caption, "", "force, gF").y_from_zero();
        let caption = format!("Glove {glove}: false touches a minute, by the pose that was asked for.");
        let mut touches = Figure::new(&format!("air-{}", slug(glove)), &caption, "", "false touches/min").y_from_zero();
        for (series, model) in result.models.iter().enumerate() {
            let Some(report) = model.contacts.get(glove).and_then(|contact| contact.in_air.as_ref()) else { continue };
            let poses: Vec<String> = report.by_pose.keys().cloned().collect();
            let rates = report.by_pose.values().map(|found| found.per_minute.value().unwrap_or(f64::NAN));
            touches.bars(&model.name, poses.clone(), rates.collect(), style(result, series));
            let sizes = report.by_pose.values().map(|found| found.abs_force_gf.map_or(f64::NAN, |size| size.p95));
            force.bars(&model.name, poses, sizes.collect(), style(result, series));
        }
        section.figure(&touches).figure(&force);
    }
}
