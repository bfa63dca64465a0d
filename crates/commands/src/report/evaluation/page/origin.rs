//! Timing, and where everything on the page comes from.

use tactile_pose_fusion::bag::quoted;
use tactile_pose_fusion::eval::Distribution;
use tactile_pose_fusion::evaluate::Evaluated;

use super::scores::metric;
use crate::page::{Cell, Page, Table};

pub(super) fn timing(page: &mut Page, result: &Evaluated) {
    let section = page.section("timing", "Timing");
    section.text("Frames as they were scored. A gap is longer than may be bridged by interpolation; pose age is that of the oldest joint angle of a frame.");
    let header = [
        "Session, region",
        "Frames",
        "No estimate",
        "Rate Hz",
        "Interval ms p50",
        "max",
        "Gaps",
        "Pose age ms p50",
        "p95",
        "max",
        "Unknown",
    ];
    let mut rows = Vec::new();
    for session in &result.sessions {
        for (region, timing) in &session.timing {
            let of = |found: Option<Distribution>, at: fn(&Distribution) -> f64| Cell::maybe(found.as_ref().map(at), 1);
            rows.push(vec![
                format!("{}, {region}", session.name).into(),
                Cell::count(timing.n_frames),
                Cell::count(timing.n_without_estimate),
                metric(timing.rate_hz, 1.0, 1),
                of(timing.interval_ms, |interval| interval.p50),
                of(timing.interval_ms, |interval| interval.max),
                Cell::count(timing.n_gaps),
                of(timing.pose_age_ms, |age| age.p50),
                of(timing.pose_age_ms, |age| age.p95),
                of(timing.pose_age_ms, |age| age.max),
                Cell::count(timing.n_pose_unknown),
            ]);
        }
    }
    let header = header.map(str::to_owned).to_vec();
    section.table(&Table { id: "table-timing".to_owned(), header, rows, ..Table::default() });
}

pub(super) fn provenance(page: &mut Page, result: &Evaluated) {
    let section = page.section("origin", "Where this comes from");
    section.text(&format!("Made by tactile_pose_fusion {} with", result.tool_version));
    section.code(&command_line(&result.command));
    let header = ["Model", "File", "SHA-256"].map(str::to_owned).to_vec();
    let rows = result.models.iter().map(|model| {
        let text = |text: &Option<String>| Cell::from(text.clone().unwrap_or_else(|| "-".to_owned()));
        vec![model.name.clone().into(), text(&model.path), text(&model.sha256)]
    });
    section.table(&Table { id: "table-models".to_owned(), header, rows: rows.collect(), ..Table::default() });
    let header = [
        "Session",
        "Glove",
        "User",
        "Frames",
        "Without truth",
        "Zero of the force",
        "Input lost",
        "SHA-256 of the bag",
    ];
    let rows = result.sessions.iter().map(|session| {
        let synthetic = if session.synthetic { " (synthetic)" } else { "" };
        vec![
            format!("{}{synthetic}", session.name).into(),
            session.glove.clone().into(),
            session.user.clone().into(),
            Cell::count(session.frames_scored as u64),
            Cell::count(session.frames_without_truth as u64),
            session.zero.as_ref().map_or_else(|| "recorded".to_owned(), ToString::to_string).into(),
            if session.losses.is_empty() { "nothing".to_owned() } else { session.losses.join("; ") }.into(),
            session.sha256.clone().into(),
        ]
    });
    let (header, rows) = (header.map(str::to_owned).to_vec(), rows.collect());
    section.table(&Table { id: "table-sessions".to_owned(), header, rows, ..Table::default() });
}

/// The command as it can be given again to a shell.
fn command_line(words: &[String]) -> String {
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_can_be_given_again() {
        let words = ["tpf", "eval", "my bags", "-p", "a:=b", "it's"].map(str::to_owned);
        assert_eq!(command_line(&words), r"tpf eval 'my bags' -p a:=b 'it'\''s'");
    }
}
