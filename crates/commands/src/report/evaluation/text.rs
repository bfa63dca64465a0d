//! Results as a person reads them at a terminal.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use tactile_pose_fusion::eval::{
    Distribution, GroupBy, Improvement, Measure, Metric, PairedTest, ResultTable, Score, TangentialScore,
};
use tactile_pose_fusion::evaluate::{Evaluated, ModelScores, Pairing};
use tactile_pose_fusion::units::{GramForce, Newton};

use super::pose_quality;
use super::table::table;
use super::verdict::verdict;
use crate::report::checks;
use crate::report::terminal::{self, shown};

/// The meaning of the names of measures.
pub(super) const MEASURES_IN_WORDS: &str = "BA: balanced accuracy of touch. F1: harmonic mean of precision and recall of touch. \
     MDF: minimal detectable force. MAE: mean absolute error of the force. R2: coefficient of determination. gF: gram-force, 9.81 mN.";

/// The meaning of the signs in the table.
const SIGNS_IN_WORDS: &str = "(+): higher is better. (-): lower is better. *: best of the glove.";

/// The table, and what was gained.
pub fn short_text(result: &Evaluated) -> String {
    let mut text = String::new();
    heading(&mut text, result);
    improvements(&mut text, result);
    at_the_end(&mut text, result);
    text
}

/// The verdict: at the end, where a terminal stands then.
fn at_the_end(text: &mut String, result: &Evaluated) {
    if let Some(verdict) = verdict(result) {
        let _ = writeln!(text, "\n{}", verdict.line());
    }
}

fn heading(text: &mut String, result: &Evaluated) {
    let synthetic = if result.synthetic { "SYNTHETIC data: " } else { "" };
    let sessions = match result.sessions.len() {
        1 => "1 session".to_owned(),
        n => format!("{n} sessions"),
    };
    let scored = result.scored.to_string();
    let how = if scored.contains("test part") {
        ", so that models that were trained on the rest are judged fairly (--whole scores every frame)"
    } else {
        ""
    };
    let _ = writeln!(text, "{synthetic}{scored} of {sessions}{how}\n");
    for (lack, of) in result.missing() {
        let _ = writeln!(text, "{lack} ({})\n", short_list(&of, result.sessions.len()));
    }
    if result.has_scores() {
        let _ = writeln!(text, "{}\n{MEASURES_IN_WORDS} {SIGNS_IN_WORDS}", shown(&table(&result.table), 2));
        if result.models.iter().any(|model| model.name.ends_with(", base")) {
            let _ = writeln!(text, "base: the force before the pose correction.");
        }
        touch_by(result).into_iter().for_each(|line| {
            let _ = writeln!(text, "\n{line}");
        });
        tangential(text, result);
    }
}

/// The tangential force, where truth and some model have three axes.
fn tangential(text: &mut String, result: &Evaluated) {
    let scores = result.tangential();
    if scores.is_empty() {
        return;
    }
    let mut table = terminal::table(TANGENTIAL_HEADER);
    for (glove, model, score) in scores {
        let bias: Vec<String> = score.bias_gf.iter().map(|bias| number(*bias, 1)).collect();
        table.add_row([
            glove.to_owned(),
            model.to_owned(),
            tangential_mae(&score),
            number(score.angle_deg, 1),
            bias.join(", "),
            score.n_frames.to_string(),
        ]);
    }
    let _ = writeln!(text, "\n{TANGENTIAL}\n\n{}", shown(&table, 2));
}

/// The title of the table of the tangential force, and its columns.
pub(super) const TANGENTIAL: &str = "Tangential force: its mean error, the angle between true and estimated force over touch, and its mean error along x, y, z of the patch";
pub(super) const TANGENTIAL_HEADER: [&str; 6] =
    ["Glove", "Model", "Tangential MAE N (gF)", "Angle deg", "Bias x, y, z gF", "Frames"];

/// In both units.
pub(super) fn tangential_mae(score: &TangentialScore) -> String {
    match score.mae_gf.value() {
        Some(mae) => format!("{:.3} ({mae:.1})", Newton::from(GramForce(mae)).0),
        None => number(score.mae_gf, 1),
    }
}

/// With so many digits, or in words.
pub(super) fn number(metric: Metric, digits: usize) -> String {
    match metric {
        Metric::Value(value) => format!("{value:.digits$}"),
        Metric::Undefined { undefined } => undefined.to_string(),
    }
}

/// Which rows judge touch by another means than the paper.
pub(super) fn touch_by(result: &Evaluated) -> Option<String> {
    let names = result.judged_by_touch();
    (!names.is_empty()).then(|| {
        let others = if names.len() < result.models.len() { ", that of the others by a force of 2.5 gF" } else { "" };
        format!("Touch of {} is judged by the probability of touch that it gives{others}.", names.join(", "))
    })
}

/// Which sessions, in few words.
pub(super) fn short_list(names: &[&str], n_all: usize) -> String {
    match names {
        [only] => (*only).to_owned(),
        _ if names.len() == n_all => format!("all {n_all} sessions"),
        [first, second, rest @ ..] => match rest.len() {
            0 => format!("{first}, {second}"),
            n => format!("{first}, {second} and {n} more of {n_all} sessions"),
        },
        [] => String::new(),
    }
}

/// The tables, and a few sentences around them.
pub fn text(result: &Evaluated, by: &[GroupBy]) -> String {
    let mut text = String::new();
    heading(&mut text, result);
    if result.free_movement_table.rows.iter().any(|row| row.cells.iter().any(Option::is_some)) {
        let _ = writeln!(text, "\nFree movement alone (poses that nobody asked for)\n");
        let _ = writeln!(text, "{}", shown(&table(&result.free_movement_table), 2));
    }
    for by in by.iter().filter(|_| result.has_scores()) {
        let key = by.name();
        let rows: Vec<(&str, BTreeMap<String, Score>)> =
            result.models.iter().map(|model| (model.name.as_str(), by_group(model, key))).collect();
        let of_key = ResultTable::new(rows.iter().map(|(name, scores)| (*name, scores)));
        let _ = writeln!(text, "\nBy {key}\n\n{}", shown(&table(&of_key), 2));
        if *by == GroupBy::Session {
            force_gains(&mut text, &rows);
        }
    }
    improvements(&mut text, result);
    if result.has_scores() {
        let of_several = result.paired.iter().filter(|pairing| pairing.tests.iter().any(is_of_several));
        of_several.for_each(|pairing| paired(&mut text, pairing));
        contacts(&mut text, result);
    }
    held(&mut text, result);
    in_air(&mut text, result);
    timing(&mut text, result);
    if !result.pose_quality.is_empty() {
        text.push_str(&pose_quality::text(result));
    }
    if !result.checks.is_empty() {
        let _ = write!(text, "\nGates\n\n{}", checks::text(&result.checks));
    }
    at_the_end(&mut text, result);
    text
}

/// The force gain of each donning: its spread is what nothing in the air tells.
fn force_gains(text: &mut String, rows: &[(&str, BTreeMap<String, Score>)]) {
    let mut table = terminal::table(["Session", "Model", "Force gain"]);
    for (model, scores) in rows {
        for (session, score) in scores {
            let gain = score.force_gain.value().map_or("-".to_owned(), |gain| format!("{gain:.2}"));
            table.add_row([session.clone(), (*model).to_owned(), gain]);
        }
    }
    let _ = writeln!(
        text,
        "\nForce gain by donning: estimated force as a share of the true one, over all touch\n\n{}",
        shown(&table, 2)
    );
}

fn by_group(model: &ModelScores, key: &str) -> BTreeMap<String, Score> {
    let scores = model.by.get(key).into_iter().flatten();
    scores.map(|scored| (scored.group.to_string(), scored.score.clone())).collect()
}

fn improvements(text: &mut String, result: &Evaluated) {
    if !result.improvements.is_empty() {
        let _ = writeln!(text);
    }
    for change in &result.improvements {
        let _ = writeln!(text, "{}", improvement(change));
    }
    if !result.improvements.is_empty() {
        let _ = writeln!(text, "{CHANGES_IN_WORDS}");
    }
}

/// The meaning of [`improvement`].
pub(super) const CHANGES_IN_WORDS: &str = "A minus sign is better. Touch error: 100 % minus BA.";

/// The gain of one model over another, in a line.
pub(super) fn improvement(change: &Improvement) -> String {
    let share =
        |share: Option<f64>| share.map_or("not comparable".to_owned(), |share| format!("{:+.1} %", -100.0 * share));
    format!(
        "glove {}, {} to {}: MDF {}, touch error {}, MAE {}",
        change.glove,
        change.from,
        change.to,
        share(change.mdf_reduction),
        share(change.touch_error_reduction),
        share(change.mae_reduction)
    )
}

/// Whether it tells more than one user does: of one there are no statistics.
pub(super) fn is_of_several(test: &PairedTest) -> bool {
    test.pairs.len() > 1
}

fn paired(text: &mut String, pairing: &Pairing) {
    let _ = writeln!(
        text,
        "\nPaired by user, {} to {} (one-sided exact Wilcoxon, Cohen's d_z)\n",
        pairing.from, pairing.to
    );
    let mut table = terminal::table(["Glove", "Measure", "Better for", "p", "d_z", "Left out"]);
    for test in pairing.tests.iter().filter(|test| is_of_several(test)) {
        let p = test.wilcoxon.as_ref().map_or("-".to_owned(), |wilcoxon| format!("{:.4}", wilcoxon.p));
        let d_z = match test.d_z {
            Metric::Value(value) => format!("{value:.2}"),
            Metric::Undefined { undefined } => undefined.to_string(),
        };
        let better = format!("{} of {}", test.n_improved, test.pairs.len());
        table.add_row([
            test.glove.clone(),
            measure_name(test.measure).to_owned(),
            better,
            p,
            d_z,
            test.left_out.join(", "),
        ]);
    }
    let _ = writeln!(text, "{}", shown(&table, 2));
}

/// The name of a measure.
pub(super) fn measure_name(measure: Measure) -> &'static str {
    match measure {
        Measure::Ba => "BA",
        Measure::F1 => "F1",
        Measure::Mdf => "MDF",
        Measure::Mae => "MAE",
        Measure::R2 => "R2",
    }
}

/// The meaning of two columns of the table of contacts.
const REMOVED_IN_WORDS: &str = "Removed: true touches that the base force tells and the corrected force does not. \
     Delayed: those that the corrected force tells more than 50 ms later.";

fn contacts(text: &mut String, result: &Evaluated) {
    let _ = writeln!(text, "\nContact\n");
    let mut table = terminal::table([
        "Glove",
        "Model",
        "Touches",
        "Missed",
        "False/min",
        "Onset ms p50 (p95)",
        "Offset ms p50 (p95)",
        "Removed",
        "Delayed",
    ]);
    for model in &result.models {
        for (glove, contact) in &model.contacts {
            let found = &contact.detection;
            let per_minute = found.air.per_minute.value().map_or("-".to_owned(), |rate| format!("{rate:.2}"));
            let kept = contact.preservation.as_ref();
            table.add_row([
                glove.clone(),
                model.name.clone(),
                found.n_true.to_string(),
                found.n_missed.to_string(),
                per_minute,
                latency(found.onset_ms.as_ref()),
                latency(found.offset_ms.as_ref()),
                kept.map_or("-".to_owned(), |kept| kept.n_removed.to_string()),
                kept.map_or("-".to_owned(), |kept| kept.n_delayed.to_string()),
            ]);
        }
    }
    let _ = writeln!(text, "{}", shown(&table, 2));
    let of_models = || result.models.iter().flat_map(|model| model.contacts.values());
    match of_models().any(|contact| contact.preservation.is_some()) {
        true => {
            let _ = writeln!(text, "{REMOVED_IN_WORDS}");
        }
        false => {
            let _ = writeln!(text, "Removed, Delayed: of models with a base force alone.");
        }
    }
}

fn held(text: &mut String, result: &Evaluated) {
    let mut table = terminal::table([
        "Glove",
        "Model",
        "Mean true gF",
        "Touches",
        "Found at 1 s",
        "Found later",
        "Force gain at 1 s",
        "Force kept later",
    ]);
    let share = |metric: Metric| metric.value().map_or("-".to_owned(), |share| format!("{:.0} %", 100.0 * share));
    for model in &result.models {
        for (glove, contact) in &model.contacts {
            for held in &contact.held {
                let bounds = held.to_gf.map_or_else(
                    || format!("from {:.1}", held.from_gf),
                    |to| format!("{:.1} to {to:.1}", held.from_gf),
                );
                let gain = held.gain_at_1_s.value().map_or("-".to_owned(), |gain| format!("{gain:.2}"));
                table.add_row([
                    glove.clone(),
                    model.name.clone(),
                    bounds,
                    held.n.to_string(),
                    share(held.found_at_1_s),
                    share(held.found_later),
                    gain,
                    share(held.force_kept()),
                ]);
            }
        }
    }
    if table.row_count() > 0 {
        let _ = writeln!(
            text,
            "\nTouches held for 5 s and longer: contact and force, later compared with 1 s after the onset\n\n{}",
            shown(&table, 2)
        );
    }
}

fn in_air(text: &mut String, result: &Evaluated) {
    let mut table = terminal::table(["Glove", "Model", "Minutes", "False touches", "False/min", "Force gF p50 (p95)"]);
    for model in &result.models {
        for (glove, contact) in &model.contacts {
            let Some(found) = contact.in_air.as_ref().map(|report| &report.total) else { continue };
            let size = found.abs_force_gf.map(|size| format!("{:.1} ({:.1})", size.p50, size.p95));
            table.add_row([
                glove.clone(),
                model.name.clone(),
                format!("{:.1}", found.minutes),
                found.n_false_touches.to_string(),
                found.per_minute.value().map_or("-".to_owned(), |rate| format!("{rate:.2}")),
                size.unwrap_or_else(|| "-".to_owned()),
            ]);
        }
    }
    if table.row_count() > 0 {
        let _ =
            writeln!(text, "\nIn the air: nothing touches, so no force and no touch is true\n\n{}", shown(&table, 2));
    }
}

fn timing(text: &mut String, result: &Evaluated) {
    let mut table = terminal::table([
        "Session",
        "Region",
        "Frames",
        "Hz",
        "Interval ms p50 (max)",
        "Gaps",
        "No estimate",
        "Pose age ms p50 (max)",
    ]);
    for session in &result.sessions {
        for (region, timing) in &session.timing {
            let of = |distribution: Option<Distribution>| {
                distribution.map_or("-".to_owned(), |found| format!("{:.1} ({:.1})", found.p50, found.max))
            };
            table.add_row([
                session.name.clone(),
                region.clone(),
                timing.n_frames.to_string(),
                timing.rate_hz.value().map_or("-".to_owned(), |rate| format!("{rate:.1}")),
                of(timing.interval_ms),
                timing.n_gaps.to_string(),
                timing.n_without_estimate.to_string(),
                of(timing.pose_age_ms),
            ]);
        }
    }
    if table.row_count() > 0 {
        let _ = writeln!(text, "\nTiming\n\n{}", shown(&table, 2));
    }
}

fn latency(latency: Option<&Distribution>) -> String {
    latency.map_or("-".to_owned(), |latency| format!("{:.0} ({:.0})", latency.p50, latency.p95))
}
