//! Which joints move which taxels.

use tactile_pose_fusion::characterization::RegionResult;

use super::header;
use crate::page::{Cell, Figure, Heat, Page, Style, Table};

/// Height of a row of the map and what is around it, px.
const ROW_PX: usize = 22;
const AROUND_PX: usize = 130;

pub(super) fn section(page: &mut Page, result: &RegionResult) {
    let RegionResult { region, taxels, report, .. } = result;
    let (correlation, selection) = (&report.correlation, &report.selection);
    let ranked = correlation.ranked();
    let names: Vec<String> = ranked.iter().map(|joint| report.joints[*joint].clone()).collect();
    let section = page.section(&format!("{region}-joints"), &format!("Region {region}: which joints move the taxels"));
    section.text(&format!(
        "Correlation of changes over {} s in the air, and the share of the held-out changes that joints explain. Joints \
         move together, so that one which correlates may only move along; one is chosen for what it adds to those before.",
        correlation.span_s
    ));
    let mut map = Figure::new(
        &format!("{region}-correlation"),
        "Correlation of each joint with each taxel, the joint that goes most with all taxels on top.",
        "taxel",
        "",
    );
    let row = |joint: &usize| correlation.by_taxel[*joint].iter().map(|r| r.unwrap_or(f64::NAN)).collect();
    map.heat(Heat {
        columns: taxels.iter().map(|taxel| format!("taxel {taxel}")).collect(),
        values: ranked.iter().map(row).collect(),
        rows: names.clone(),
        range: [-1.0, 1.0],
        unit: "correlation".to_owned(),
    });
    section.figure(&map.height(AROUND_PX + ROW_PX * names.len()));
    let mut bars = Figure::new(&format!("{region}-alone"), "What each joint explains alone.", "", "share explained");
    let alone = ranked.iter().map(|joint| selection.alone[*joint].map_or(f64::NAN, |share| share.max(0.0)));
    bars.bars("", names, alone.collect(), Style::of(0));
    section.figure(&bars.y_range(0.0, 1.0));
    let steps = selection.chosen.iter().chain(&selection.next).enumerate().map(|(idx, step)| {
        let range = report.pose_range.iter().find(|range| range.joint == step.joint);
        let is_chosen = if idx < selection.chosen.len() { "yes" } else { "no" };
        let share = |share: f64| Cell { text: format!("{:.1} %", 100.0 * share), value: Some(share) };
        let ends = [range.map(|range| range.min), range.map(|range| range.max)].map(|end| Cell::maybe(end, 2));
        let words = [step.joint.as_str().into(), is_chosen.into(), share(step.gain), share(step.explained)];
        words.into_iter().chain(ends).collect()
    });
    section.table(&Table {
        id: format!("{region}-chosen"),
        caption: "Joints in the order in which they are chosen".to_owned(),
        header: header(["Joint", "Chosen", "Adds", "Explained with it", "Least rad", "Greatest rad"]),
        rows: steps.collect(),
    });
}
