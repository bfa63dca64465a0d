//! Two models on the same sessions: `cargo run --example compare_models -- params/glove3.yaml BASELINE.onnx MODEL.onnx BAG..`.

use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};

use tactile_pose_fusion::config::{self, DEFAULT_NODE};
use tactile_pose_fusion::evaluate::{self, Request};
use tactile_pose_fusion::observer::Unobserved;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [params, baseline, model, bags @ ..] = args.as_slice() else {
        return Err("compare_models PARAMS.yaml BASELINE.onnx MODEL.onnx BAG..".into());
    };
    let cfg = config::load(Path::new(params), DEFAULT_NODE)?;
    let compare = [baseline.clone()];
    let request = Request { model: Some(model), compare: &compare, ..Request::new(bags) };
    let found = evaluate::run(cfg, &request, &Unobserved)?;

    let mut stdout = std::io::stdout().lock();
    writeln!(
        stdout,
        "{}, {} sessions{}",
        found.scored,
        found.sessions.len(),
        if found.synthetic { ", SYNTHETIC" } else { "" }
    )?;
    for model in &found.models {
        for group in &model.by["glove"] {
            let score = &group.score;
            let number = |metric: Option<f64>| metric.map_or("undefined".to_owned(), |value| format!("{value:.3}"));
            let (ba, mae) = (number(score.ba.value()), number(score.mae_gf.value()));
            writeln!(stdout, "{} on glove {}: BA {ba}, MDF {} gF, MAE {mae} gF", model.name, group.group, score.mdf)?;
        }
    }
    for failed in &found.failed {
        writeln!(stdout, "not scored: {}", failed.error)?;
    }
    Ok(())
}
