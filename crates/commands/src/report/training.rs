//! Training as a person reads it at a terminal.

use std::fmt::Write as _;

use tactile_pose_fusion::eval::{Measure, Score};
use tactile_pose_fusion::evaluate::all_folds;
use tactile_pose_fusion::fusion::TouchOutput;
use tactile_pose_fusion::train::{Kind, Progress};
use tactile_pose_fusion::training::{HeldOutScores, Report, Request};

/// A look at the validation part, where a step has one.
pub fn of_step(progress: &Progress, kind: Kind) -> Option<String> {
    let validation = progress.validation.as_ref()?;
    let loss = &progress.loss;
    let percent = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:.2} %", 100.0 * share));
    let terms = match kind {
        Kind::Adaptive => format!("touch {:.4}", loss.touch),
        _ => format!("base {:.4}, artifact {:.4}", loss.base, loss.artifact),
    };
    let terms = match loss.tangential {
        0.0 => terms,
        tangential => format!("{terms}, tangential {tangential:.4}"),
    };
    let mut line = format!(
        "step {:>6}  loss {:.4} (force {:.4}, {terms})  validation {:.4}, BA {}, MAE {:.1} gF",
        progress.step,
        loss.total,
        loss.force,
        validation.loss,
        percent(validation.balanced_accuracy),
        validation.mae_gf
    );
    if let Some(base) = validation.base_mae_gf {
        line += &format!(" (base {}, {base:.1} gF)", percent(validation.base_balanced_accuracy));
    }
    if let Some(mae) = validation.tangential_mae_gf {
        line += &format!(", tangential {mae:.1} gF");
    }
    Some(line + if progress.is_best { "  best" } else { "" })
}

/// Summary of a training for a person, at its end.
pub fn of_report(report: &Report, request: &Request) -> String {
    let mut text = String::new();
    let synthetic = if report.is_synthetic() { " (synthetic data)" } else { "" };
    for (idx, run) in report.runs().iter().enumerate().filter(|_| report.runs().len() > 1) {
        let loss = run.best_validation.as_ref().map_or("-".to_owned(), |validation| format!("{:.4}", validation.loss));
        let chosen = if idx == report.chosen() { "  chosen" } else { "" };
        let _ = writeln!(text, "lambda {}: validation loss {loss} at step {}{chosen}", run.lambda, run.best_step);
    }
    if let Some(test) = report.test() {
        if let Some(TouchOutput { levels, false_per_min }) = report.touch() {
            let rate =
                false_per_min.map(|rate| format!(", {rate:.1} false touches/min in the air of the validation part"));
            let (on, off) = (levels.on, levels.off);
            let _ = writeln!(
                text,
                "contact from a probability of {on:.2}, ends below {off:.2}{}",
                rate.unwrap_or_default()
            );
        }
        let _ = writeln!(text, "held-out test, {} frames{synthetic}:", test.windows);
        let _ = writeln!(text, "  final {}", line(&test.corrected));
        if let Some(base) = &test.base {
            let _ = writeln!(text, "  base  {}", line(base));
            let _ = writeln!(text, "  base: the force before the pose correction");
        }
    }
    let _ = writeln!(text, "model   {}", request.output.display());
    let _ = writeln!(text, "report  {}", request.report().display());
    text
}

/// Scores of models on what each was trained without: mean and spread.
pub fn of_folds(scored: &HeldOutScores, request: &Request) -> String {
    let what = scored.hold_out.what();
    let mut text = format!(
        "{}each {what} by the model that was trained without it, every frame of {} {what}s:\n",
        if scored.synthetic { "SYNTHETIC data: " } else { "" },
        scored.n_groups
    );
    for measure in Measure::ALL {
        let values: Vec<f64> = scored.scores.iter().filter_map(|group| measure.value(&group.score)).collect();
        let _ = writeln!(text, "  {}", spread(measure, &values, scored.n_groups));
    }
    let _ = writeln!(text, "models  {}", all_folds(&request.output).display());
    text
}

/// A minimal detectable force with its unit, where it is a number.
fn mdf(mdf: &tactile_pose_fusion::eval::Mdf) -> String {
    let text = mdf.to_string();
    if text.ends_with(|last: char| last.is_ascii_digit()) { text + " gF" } else { text }
}

fn line(score: &Score) -> String {
    let number = |metric: tactile_pose_fusion::eval::Metric, scale: f64, digits: usize| {
        metric.value().map_or("-".to_owned(), |value| format!("{:.digits$}", value * scale))
    };
    let tangential = score.tangential.map_or(String::new(), |of| {
        format!("  tangential MAE {} gF  angle {} deg", number(of.mae_gf, 1.0, 2), number(of.angle_deg, 1.0, 1))
    });
    format!(
        "BA {} %  F1 {} %  MDF {}  MAE {} gF  R2 {}{tangential}",
        number(score.ba, 100.0, 2),
        number(score.f1, 100.0, 2),
        mdf(&score.mdf),
        number(score.mae_gf, 1.0, 2),
        number(score.r2, 1.0, 3)
    )
}

/// Mean and standard deviation over groups, as a person reads it.
fn spread(measure: Measure, values: &[f64], n_groups: usize) -> String {
    let (name, scale, unit) = match measure {
        Measure::Ba => ("BA", 100.0, " %"),
        Measure::F1 => ("F1", 100.0, " %"),
        Measure::Mdf => ("MDF", 1.0, " gF"),
        Measure::Mae => ("MAE", 1.0, " gF"),
        Measure::R2 => ("R2", 1.0, ""),
    };
    if values.is_empty() {
        return format!("{name:<4} -");
    }
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let deviation = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
    let missing = if values.len() < n_groups { format!(" ({} of {n_groups})", values.len()) } else { String::new() };
    format!("{name:<4} {:.2} \u{b1} {:.2}{unit}{missing}", scale * mean, scale * deviation)
}
