//! The screen of a monitor.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout};
use ratatui::style::Stylize;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Cell, Paragraph, Row, Table, Wrap};
use tactile_pose_fusion::ros::Monitored;
use tactile_pose_fusion::units::Stamp;

use super::{flags, number};

/// Cells of a force bar.
const BAR: usize = 12;

/// Draws the node as it is at this time.
pub(crate) fn draw(frame: &mut Frame<'_>, watched: &Monitored, now: Stamp) {
    let n_regions = watched.regions.len() as u16;
    let [head, table, notes, keys] = Layout::vertical([
        Constraint::Length(2),
        Constraint::Length(n_regions + 2),
        Constraint::Min(1),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    let title = Line::from(vec![Span::from("tpf monitor  ").bold(), Span::from(watched.headline(now))]);
    frame.render_widget(Paragraph::new(title).wrap(Wrap { trim: true }), head);
    let header = Row::new(["region", "", "force N", "", "artifact N", "flags"]).dim();
    let rows = watched.regions.iter().map(|(name, region)| {
        let state = &region.state;
        let force = if state.force.is_finite() { state.force.max(0.0) } else { 0.0 };
        let filled = ((force / region.most).min(1.0) * BAR as f64).round() as usize;
        let contact =
            if state.contact { Span::from("\u{25cf} contact").magenta().bold() } else { Span::from("\u{25cb}").dim() };
        Row::new([
            Cell::from(name.as_str()),
            Cell::from(contact),
            Cell::from(format!("{:>7}", number(state.force))),
            Cell::from("\u{2588}".repeat(filled)).magenta(),
            Cell::from(format!("{:>7}", number(state.artifact))),
            Cell::from(flags(state, watched.is_silent(region, now))).yellow(),
        ])
    });
    let longest = watched.regions.keys().map(|name| name.chars().count()).max().unwrap_or(0);
    let widths = [
        Constraint::Length(longest.clamp("region".len(), 14) as u16),
        Constraint::Length(9),
        Constraint::Length(7),
        Constraint::Length(BAR as u16),
        Constraint::Length(10),
        Constraint::Min(8),
    ];
    frame.render_widget(Table::new(rows, widths).header(header), table);
    let mut lines: Vec<Line<'_>> = Vec::new();
    let late_s = watched.diagnostics_late_s(now);
    if let Some(age_s) = late_s {
        lines.push(Line::from(format!("the node said this {age_s:.0} s ago, and nothing since:")).red());
    }
    for health in &watched.diagnostics {
        let text = format!("{:<5} {}: {}", health.level, health.name, health.message);
        lines.push(match health.level {
            _ if late_s.is_some() => Line::from(text).dim(),
            "OK" => Line::from(text).green(),
            "WARN" => Line::from(text).yellow(),
            _ => Line::from(text).red(),
        });
    }
    if watched.regions.is_empty() {
        lines.push(Line::from(format!("waiting for {}; is the node running in this domain?", watched.topic)).yellow());
    }
    if let Some(unreadable) = &watched.unreadable {
        lines.push(Line::from(format!("some messages could not be read: {unreadable}")).red());
    }
    frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: true }), notes);
    frame.render_widget(Paragraph::new("q quit").dim(), keys);
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;
    use tactile_pose_fusion::fusion::Flags;
    use tactile_pose_fusion::msg::{ContactArray, ContactState, Header, to_cdr};
    use tactile_pose_fusion::units::NANOS_PER_SEC;

    fn state(region: &str, force: f64, flags: Flags) -> ContactState {
        ContactState {
            region: region.to_owned(),
            force,
            contact: force > 0.1,
            flags: flags.bits(),
            ..ContactState::default()
        }
    }

    #[test]
    fn every_region_is_on_a_small_screen_with_what_is_wrong_with_it() {
        let mut watched = Monitored::new("/tactile_pose_fusion/contacts", "/tactile_pose_fusion".to_owned());
        for k in 0..200 {
            let stamp = Stamp(k * NANOS_PER_SEC / 100);
            let array = ContactArray {
                header: Header { stamp: stamp.into(), frame_id: String::new() },
                contacts: vec![state("thumb", 0.0, Flags::STALE_POSE), state("index", 1.25, Flags::default())],
            };
            watched.handle_contacts(&to_cdr(&array), stamp.offset(4_000_000));
        }
        let now = Stamp(2 * NANOS_PER_SEC);
        for (width, height) in [(80, 24), (140, 40)] {
            let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
            terminal.draw(|frame| draw(frame, &watched, now)).unwrap();
            let buffer = terminal.backend().buffer().clone();
            let text: String = (0..height)
                .flat_map(|y| (0..width).map(move |x| (x, y)))
                .map(|at| buffer[at].symbol().to_owned())
                .collect();
            for expected in ["thumb", "STALE_POSE", "index", "1.25", "contact", "p50 4.0 ms", "100 Hz", "q quit"] {
                assert!(text.contains(expected), "{expected} is not on {width}x{height}: {text}");
            }
        }
        assert!(crate::report::monitor::text(&watched, now.offset(NANOS_PER_SEC)).contains("SILENT"));
    }
}
