//! Estimates against the true force: how they spread, how far they are off, and what gain each donning has.

use tactile_pose_fusion::eval::ForceDensity;
use tactile_pose_fusion::evaluate::{Evaluated, ModelScores};

use super::scores::reach;
use super::{slug, style};
use crate::page::{Density, Figure, Page};

/// Where the axes of a density have numbers, gF.
const TICKS_GF: [f64; 6] = [2.5, 10.0, 50.0, 200.0, 500.0, 2000.0];

pub(super) fn section(page: &mut Page, result: &Evaluated) {
    let section = page.section("truth", "Estimate against truth");
    section.text(
        "Forces are in grams-force (1 gF = 9.81 mN). Each column of the first picture holds the frames of one true force, and \
         its colours tell where their estimates are; on the dashed line they are right. The lowest row and column are all \
         forces below 1 gF.",
    );
    let judged = result.models.last();
    let first = result.models.first().filter(|_| result.models.len() > 1);
    for glove in &result.table.gloves {
        let figures: Vec<Figure> =
            judged.into_iter().chain(first).filter_map(|model| density(model, glove, result)).collect();
        section.figures(&figures);
        section.figure(&bias(result, glove));
    }
    gains(section, result);
}

fn density(model: &ModelScores, glove: &str, result: &Evaluated) -> Option<Figure> {
    let found = model.densities.get(glove)?;
    let caption = format!("Glove {glove}, {}: share of the frames of each true force.", model.name);
    let is_judged = result.models.last().is_some_and(|judged| judged.name == model.name);
    let id = format!("density-{}-{}", slug(glove), if is_judged { "judged" } else { "first" });
    let mut figure = Figure::new(&id, &caption, "true force, gF", "estimated force, gF").height(420);
    figure.density(&shown(found));
    Some(figure)
}

/// As it is drawn: up to the last bin that holds frames, with edges for the bins that have none.
fn shown(found: &ForceDensity) -> Density {
    let (Some(first), Some(last)) = (found.edges_gf.first(), found.edges_gf.last()) else {
        return Density { edges: Vec::new(), shares: Vec::new(), ticks: Vec::new() };
    };
    let edges = [0.8 * first].into_iter().chain(found.edges_gf.iter().copied()).chain([1.25 * last]);
    let has_frames =
        |bin: usize| found.frames[bin].iter().any(|n| *n > 0) || found.frames.iter().any(|of_truth| of_truth[bin] > 0);
    let n = (0..found.frames.len()).rposition(has_frames).map_or(0, |bin| bin + 1);
    let edges: Vec<f64> = edges.take(n + 1).collect();
    let percent = |share: f64| if share > 0.0 { 100.0 * share } else { f64::NAN };
    let shares = (0..n).map(|truth| match found.shares(truth) {
        Some(shares) => shares.into_iter().take(n).map(percent).collect(),
        None => vec![f64::NAN; n],
    });
    let reached = edges.last().copied().unwrap_or(*first);
    let ticks = TICKS_GF.iter().filter(|at| **at <= reached).map(|at| (*at, at.to_string()));
    Density {
        shares: shares.collect(),
        ticks: [(0.9 * first, format!("<{first}"))].into_iter().chain(ticks).collect(),
        edges,
    }
}

fn bias(result: &Evaluated, glove: &str) -> Figure {
    let caption =
        format!("Glove {glove}: bias by true force, the mean of estimate minus truth. The first point is the air.");
    let mut figure = Figure::new(&format!("bias-{}", slug(glove)), &caption, "true force, gF", "bias, gF").height(320);
    for (series, model) in result.models.iter().enumerate() {
        let Some(curve) = model.curves.get(glove) else { continue };
        let air = curve.no_touch.bias_gf.value().map(|bias| (0.0, bias));
        let bins = curve.bins.iter().filter(|bin| bin.centre_gf <= reach(curve));
        let bins = bins.filter_map(|bin| Some((bin.centre_gf, bin.bias_gf.value()?)));
        let (x, y) = air.into_iter().chain(bins).unzip();
        figure.line(&model.name, x, y, style(result, series).marked());
    }
    figure.level(0.0, "");
    figure
}

/// The force gain of each donning, where there are several.
fn gains(section: &mut crate::page::Section, result: &Evaluated) {
    let caption = "Force gain by donning: the estimated force as a share of the true one, over all touch of a session. Donnings \
                   differ by it, and nothing in the air tells it.";
    let mut figure = Figure::new("gain", caption, "force gain", "");
    let mut sessions: Vec<String> = Vec::new();
    for (series, model) in result.models.iter().enumerate() {
        let of_sessions = model.by.get("session").into_iter().flatten();
        let gains = of_sessions.filter_map(|one| Some((one.group.session.clone()?, one.score.force_gain.value()?)));
        let (names, values): (Vec<String>, Vec<f64>) = gains.unzip();
        for name in &names {
            if !sessions.contains(name) {
                sessions.push(name.clone());
            }
        }
        figure.lying_points(&model.name, names, values, style(result, series));
    }
    figure.upright_level(1.0);
    if sessions.len() > 1 {
        section.figure(&figure.height(120 + 22 * sessions.len()));
    }
}
