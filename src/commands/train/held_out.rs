//! A model without each user, or without each donning, scored on what it never saw.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use super::super::progress::Shown;
use super::{Args, Files, HoldOut, SessionNotes, only_region, say, train};
use crate::commands::Failure;
use crate::config::Config;
use crate::eval::{GroupBy, Measure};
use crate::evaluate::{self, Request, all_folds, fold_path};
use crate::train::Kind;

/// Trains the folds and scores them; the text for people.
pub(super) fn run(
    args: &Args,
    cfg: &Config,
    hold_out: HoldOut,
    bags: &[PathBuf],
    sessions: &[SessionNotes],
) -> Result<String, Failure> {
    let mut groups: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (idx, session) in sessions.iter().enumerate() {
        let group = match hold_out {
            HoldOut::Donnings => session.name.clone(),
            HoldOut::Users => session.user.clone().ok_or_else(|| {
                Failure(format!(
                    "{}: does not say who wore the glove, so no model can be trained without its user; --hold-out donnings needs no users",
                    session.name
                ))
            })?,
        };
        groups.entry(group).or_default().push(idx);
    }
    let what = if hold_out == HoldOut::Users { "user" } else { "donning" };
    if groups.len() < 2 {
        return Err(Failure(format!(
            "all bags are of one {what}, so nothing is left to train on without it; give bags of two or more"
        )));
    }
    for (group, left_out) in &groups {
        let files = Files::of(&fold_path(&args.output, group));
        files.check(args)?;
        say(&format!("without {what} {group}"));
        let kept: Vec<PathBuf> =
            (0..bags.len()).filter(|idx| !left_out.contains(idx)).map(|idx| bags[idx].clone()).collect();
        let names: Vec<String> = left_out.iter().map(|idx| sessions[*idx].name.clone()).collect();
        train(args, cfg, Kind::from(args.kind), &kept, &files, &names)?;
    }
    // As recorded, with the joints that a network without pose doesn't take.
    let cfg = only_region(
        args.params.load_with_truth(args.truth.as_deref())?,
        args.region.as_deref(),
        Kind::from(args.kind),
    )?;
    let request = Request { model: Some(&args.output), held_out: true, ..Request::new(bags) };
    let scored = evaluate::run(cfg, &request, &Shown::bytes("score"))?;
    let by = if hold_out == HoldOut::Users { GroupBy::User } else { GroupBy::Session };
    let scores = scored.models.last().and_then(|model| model.by.get(by.name()));
    let mut text = format!(
        "{}each {what} by the model that was trained without it, every frame of {} {what}s:\n",
        if scored.synthetic { "SYNTHETIC data: " } else { "" },
        groups.len()
    );
    for measure in Measure::ALL {
        let values: Vec<f64> = scores.into_iter().flatten().filter_map(|group| measure.value(&group.score)).collect();
        let _ = writeln!(text, "  {}", spread(measure, &values, groups.len()));
    }
    let _ = writeln!(text, "models  {}", all_folds(&args.output).display());
    Ok(text)
}

/// Refuses to begin where a fold of the model is there already.
pub(super) fn check(args: &Args) -> Result<(), Failure> {
    let folds = if args.hold_out.is_some() && !args.overwrite { evaluate::folds_of(&args.output) } else { Vec::new() };
    match folds.first() {
        None => Ok(()),
        Some(fold) => {
            let fold = fold.display();
            Err(Failure(format!("{fold}: is already there; choose another name of the model, or give --overwrite")))
        }
    }
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
