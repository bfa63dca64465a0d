//! How good the pose must be: the judged model again, with joint angles made worse.

use std::fmt::Write as _;

use tactile_pose_fusion::eval::{GroupScore, Metric, Score};
use tactile_pose_fusion::evaluate::{Evaluated, ModelScores};
use tactile_pose_fusion::recording::PoseQuality;

use crate::report::terminal;

/// An amount in words, and what kind it is of.
pub(super) fn words(quality: &PoseQuality) -> (&'static str, String) {
    let PoseQuality { noise_deg, bias_deg, delay_ms, dropout, rate_hz } = *quality;
    if let Some(rate_hz) = rate_hz {
        ("rate", format!("rate {rate_hz} Hz"))
    } else if bias_deg > 0.0 {
        ("bias", format!("bias {bias_deg} deg"))
    } else if delay_ms != 0.0 {
        ("delay", format!("delay {delay_ms} ms"))
    } else if dropout > 0.0 {
        ("dropout", format!("dropout {} %", 100.0 * dropout))
    } else if noise_deg > 0.0 {
        ("noise", format!("noise {noise_deg} deg"))
    } else {
        ("nothing", "as recorded".to_owned())
    }
}

/// The table, and from where on pose is of no help.
pub(super) fn text(result: &Evaluated) -> String {
    let Some(judged) = result.models.last() else { return String::new() };
    let base = result.models.iter().rev().nth(1).filter(|base| base.name == format!("{}, base", judged.name));
    let mut table = terminal::table(["Glove", "Pose", "BA %", "MDF gF", "MAE gF", "R2"]);
    let mut sentences = String::new();
    for as_it_is in judged.by.get("glove").into_iter().flatten() {
        let glove = as_it_is.group.to_string();
        let of_glove = |scores: &[GroupScore]| scores.iter().find(|one| one.group.to_string() == glove).cloned();
        let base = base.and_then(|base: &ModelScores| of_glove(base.by.get("glove")?));
        if let Some(base) = &base {
            table.add_row(row(&glove, "not used (base)", &base.score));
        }
        table.add_row(row(&glove, "as recorded", &as_it_is.score));
        let mut ended = Vec::new();
        for level in &result.pose_quality {
            let Some(found) = of_glove(&level.scores) else { continue };
            let (kind, words) = words(&level.quality);
            table.add_row(row(&glove, &words, &found.score));
            let mae = |score: &Score| score.mae_gf.value();
            let limit = base.as_ref().and_then(|base| mae(&base.score));
            if let (Some(limit), Some(got)) = (limit, mae(&found.score))
                && got >= limit
                && !ended.contains(&kind)
            {
                ended.push(kind);
                let _ = writeln!(
                    sentences,
                    "glove {glove}, {words}: the force error is {got:.2} gF, no smaller than the base's {limit:.2} gF: pose is of no help any more"
                );
            }
        }
    }
    format!("\nPose made worse, {}\n\n{}\n{sentences}", judged.name, terminal::shown(&table, 2))
}

fn row(glove: &str, pose: &str, score: &Score) -> [String; 6] {
    let number = |metric: Metric, scale: f64, digits: usize| match metric {
        Metric::Value(value) => format!("{:.digits$}", scale * value),
        Metric::Undefined { undefined } => undefined.to_string(),
    };
    [
        glove.to_owned(),
        pose.to_owned(),
        number(score.ba, 100.0, 2),
        score.mdf.to_string(),
        number(score.mae_gf, 1.0, 2),
        number(score.r2, 1.0, 3),
    ]
}
