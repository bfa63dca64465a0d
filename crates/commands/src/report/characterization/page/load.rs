//! Response to force, and the artifact: readings of a pose that are no force.

use tactile_pose_fusion::characterization::RegionResult;
use tactile_pose_fusion::characterize::{ArtifactSize, LeftInAir, Spread};

use super::super::text::{advice, left_in_air};
use super::header;
use crate::page::{Cell, Figure, Page, Style, Table};

/// Steps of taking the artifact out, in the order of [`left_in_air`].
const LEFT: [&str; 6] = ["As read", "Fixed map", "With offset", "Own gains", "Calibrated", "Followed"];

/// Poses that the bars show.
const N_POSES: usize = 24;

pub(super) fn response(page: &mut Page, result: &RegionResult) {
    let RegionResult { region, taxels, report, .. } = result;
    let Some(response) = &report.response else { return };
    let section = page.section(&format!("{region}-response"), &format!("Region {region}: response to force by pose"));
    section.text(
        "Median readings by true force. The bend score is the mix of the chosen joints that moves the taxels most; its \
         thirds are the straight, the half bent and the bent hand.",
    );
    let mut sums = Figure::new(
        &format!("{region}-response-sum"),
        "All taxels together: the same reading stands for other forces when the hand is bent.",
        "true force, N",
        "reading, sensor's unit",
    );
    let mut rises = Figure::new(
        &format!("{region}-response-rise"),
        "What the touch adds to the reading that the pose alone has in the air.",
        "true force, N",
        "reading added, sensor's unit",
    );
    for (idx, class) in [&response.all].into_iter().chain(&response.by_bend).enumerate() {
        let name = if idx == 0 { "all poses".to_owned() } else { format!("bend score {}", class.class) };
        let name = format!("{name}, {} touches", class.n_touches);
        let style = || if idx == 0 { Style::truth() } else { Style::of(idx - 1).marked() };
        let forces = || class.points.iter().map(|point| point.force_n).collect();
        sums.line(&name, forces(), class.points.iter().map(|point| point.sum).collect(), style());
        rises.line(&name, forces(), class.points.iter().map(|point| point.rise).collect(), style());
    }
    section.figure(&sums).figure(&rises);
    let mut each = Figure::new(
        &format!("{region}-response-taxels"),
        "Each taxel, all poses.",
        "true force, N",
        "reading, sensor's unit",
    );
    for (taxel, name) in taxels.iter().enumerate() {
        let forces = response.all.points.iter().map(|point| point.force_n).collect();
        let readings = response.all.points.iter().map(|point| point.by_taxel[taxel]).collect();
        each.line(&format!("taxel {name}"), forces, readings, Style::of(taxel));
    }
    section.figure(&each);
    let gains = response.gain_by_session.iter().map(|gain| {
        let [straight, bent] = gain.n_touches.map(|n| Cell::count(n as u64));
        vec![
            gain.session.as_str().into(),
            Cell::maybe(gain.at_equal_force, 2),
            Cell::maybe(gain.of_slopes, 2),
            straight,
            bent,
        ]
    });
    section.table(&Table {
        id: format!("{region}-gain"),
        caption: "What a touch adds to the bent hand's reading over the straight hand's".to_owned(),
        header: header(["Session", "At equal force", "Ratio of slopes", "Touches, straight", "Touches, bent"]),
        rows: gains.collect(),
    });
}

/// The readings at the pose with the largest artifact, in a sentence; `None` without movement in the air.
pub(super) fn largest(result: &RegionResult) -> Option<String> {
    let artifact = &result.report.artifact;
    let by_pose = artifact.by_pose.iter().map(|pose| (format!("the pose or movement \"{}\"", pose.pose), &pose.size));
    let all = std::iter::once(("movement in the air".to_owned(), &artifact.movement));
    let force = |size: &ArtifactSize| median(size.p95_n).zip(median(size.p95_gf));
    let with_force = by_pose.clone().filter_map(|(what, size)| Some((what, force(size)?)));
    let with_force = with_force.max_by(|(_, a), (_, b)| a.0.total_cmp(&b.0));
    let of_all = || all.clone().find_map(|(what, size)| Some((what, force(size)?)));
    if let Some((what, (newtons, grams))) = with_force.or_else(of_all) {
        return Some(format!(
            "With nothing touching the glove, {what} reads like a tap of {newtons:.2} N ({grams:.0} gF; 95th percentile)."
        ));
    }
    let (what, reading) = by_pose.chain(all).find_map(|(what, size)| Some((what, median(size.p95)?)))?;
    Some(format!("With nothing touching the glove, {what} reads {reading:.0} units of the sensor (95th percentile)."))
}

fn median(spread: Option<Spread>) -> Option<f64> {
    spread.map(|spread| spread.median)
}

pub(super) fn artifact(page: &mut Page, result: &RegionResult) {
    let RegionResult { region, report, .. } = result;
    let section = page.section(&format!("{region}-artifact"), &format!("Region {region}: size of artifacts"));
    section.text(
        "How far readings in the air are from the straight hand's, and the force of a tap of the straight hand that reads \
         as much. Figures of several sessions are medians of the sessions'.",
    );
    let by_pose = &report.artifact.by_pose;
    let has_forces = by_pose.iter().any(|pose| pose.size.p95_n.is_some());
    let mut bars = Figure::new(
        &format!("{region}-artifact-poses"),
        "What each pose or movement in the air reads like, though nothing touches: 95th percentile.",
        if has_forces { "tap that reads the same, N" } else { "reading, sensor's unit" },
        "",
    );
    let size = |size: &ArtifactSize| median(if has_forces { size.p95_n } else { size.p95 }).unwrap_or(f64::NAN);
    let mut poses: Vec<_> = by_pose.iter().filter(|pose| size(&pose.size).is_finite()).collect();
    poses.sort_by(|a, b| size(&b.size).total_cmp(&size(&a.size)));
    let shown = || poses.iter().take(N_POSES);
    bars.lying_bars(
        "",
        shown().map(|pose| pose.pose.clone()).collect(),
        shown().map(|pose| size(&pose.size)).collect(),
        Style::of(0),
    );
    section.figure(&bars.height(90 + 20 * poses.len().min(N_POSES)));
    let row = |name: &str, size: &ArtifactSize| {
        let figures = [(size.median, 0), (size.p95, 0), (size.median_n, 2), (size.p95_n, 2), (size.p95_gf, 0)];
        let cells = figures.map(|(spread, digits)| Cell::maybe(median(spread), digits));
        [Cell::from(name)].into_iter().chain(cells).collect()
    };
    let mut rows = vec![row("all movement in the air", &report.artifact.movement)];
    let sessions = report.sessions.iter().zip(&report.artifact.by_session);
    rows.extend(sessions.map(|(session, size)| row(&session.session, size)));
    rows.extend(by_pose.iter().map(|pose| row(&pose.pose, &pose.size)));
    section.table(&Table {
        id: format!("{region}-artifact-table"),
        caption: "All sessions, each session, each instructed pose or movement".to_owned(),
        header: header([
            "",
            "Median reading",
            "95th percentile",
            "Median as a tap, N",
            "95th percentile, N",
            "The same, gF",
        ]),
        rows,
    });
}

/// The artifact that is left where more and more is known of the donning.
pub(super) fn following(page: &mut Page, result: &RegionResult) {
    let RegionResult { region, report, .. } = result;
    let following = &report.following;
    let section = page.section(&format!("{region}-following"), &format!("Region {region}: following artifacts"));
    let Some(all) = &following.all else {
        following.missing.iter().for_each(|missing| {
            section.text(&format!("Not told: {missing}."));
        });
        return;
    };
    section.text(&format!(
        "Root mean square of the taxels in the air after a calibration of 10 s, in units of the sensor. Each donning is judged by \
         shapes that were learned on the others, of {}.",
        following.joints.join(", ")
    ));
    let mut bars = Figure::new(
        &format!("{region}-following-left"),
        "What is left of the artifact, all donnings together.",
        "",
        "root mean square, sensor's unit",
    );
    let steps = left_in_air(all);
    let names = LEFT.map(str::to_owned).to_vec();
    bars.bars("", names, steps.iter().map(|(_, left)| *left).collect(), Style::of(0));
    section.figure(&bars.y_from_zero());
    let rows = [("all donnings", all)]
        .into_iter()
        .chain(following.by_session.iter().map(|(name, left)| (name.as_str(), left)));
    let row = |(name, left): (&str, &LeftInAir)| {
        let cells = left_in_air(left).map(|(_, left)| Cell::maybe(Some(left), 1));
        let explained = Cell::maybe(Some(100.0 * left.explained(left.followed)), 1);
        [Cell::from(name)].into_iter().chain(cells).chain([explained]).collect()
    };
    section.table(&Table {
        id: format!("{region}-following-table"),
        caption: "All donnings, and each of them".to_owned(),
        header: [""].into_iter().chain(LEFT).chain(["Explained %"]).map(str::to_owned).collect(),
        rows: rows.map(row).collect(),
    });
    section.text(advice(all));
}
