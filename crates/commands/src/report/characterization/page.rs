//! Everything that was found on one page that people can look at.

mod joints;
mod load;
mod rest;

use tactile_pose_fusion::characterization::{Characterized, NamedTiming};

use crate::page::{Cell, Page, Table, VerdictKind};

/// The page.
pub fn page(result: &Characterized) -> Page {
    let mut page = Page::new("What a glove does when the hand moves", result.synthetic);
    verdict(&mut page, result);
    for region in &result.regions {
        load::artifact(&mut page, region);
        load::response(&mut page, region);
        joints::section(&mut page, region);
        load::following(&mut page, region);
        rest::lag(&mut page, region);
        rest::at_rest(&mut page, region);
    }
    let section = page.section("parameters", "Parameters");
    section.text("What follows from all of it for the parameter file, below ros__parameters.").code(&result.parameters);
    sessions(&mut page, result);
    page
}

/// How large the largest artifact of each region is, and what the recordings lack.
fn verdict(page: &mut Page, result: &Characterized) {
    let section = page.section("verdict", "In a line");
    let synthetic = if result.synthetic { " (SYNTHETIC data)" } else { "" };
    for region in &result.regions {
        if let Some(sentence) = load::largest(region) {
            section.verdict(VerdictKind::Neither, &format!("Region {}{synthetic}.", region.region), &sentence);
        }
    }
    for missing in &result.missing {
        section.text(&format!("Missing: {missing}."));
    }
    for joint in &result.joints_left_out {
        section.text(&format!("Joint left out: {joint}."));
    }
}

fn sessions(page: &mut Page, result: &Characterized) {
    let header =
        ["Session", "Glove", "User", "In the air by", "Tactile Hz", "Its jitter, ms", "Joints Hz", "Their jitter, ms"];
    let rows = result.sessions.iter().map(|session| {
        let data = if session.synthetic { " (synthetic)" } else { "" };
        let timing = |sources: &[NamedTiming]| {
            let timing = sources.first().and_then(|source| source.timing);
            [Cell::maybe(timing.map(|timing| timing.rate_hz), 1), Cell::maybe(timing.map(|timing| timing.jitter_ms), 2)]
        };
        let name = format!("{}{data}", session.name);
        let words =
            [name.into(), session.glove.clone().into(), session.user.clone().into(), session.in_air.clone().into()];
        words.into_iter().chain(timing(&session.tactile)).chain(timing(&session.joints)).collect()
    });
    let table = Table {
        id: "sessions-table".to_owned(),
        header: header.map(str::to_owned).to_vec(),
        rows: rows.collect(),
        ..Table::default()
    };
    page.section("sessions", "Sessions").table(&table);
}

/// A header of words.
fn header<const N: usize>(words: [&str; N]) -> Vec<String> {
    words.map(str::to_owned).to_vec()
}
