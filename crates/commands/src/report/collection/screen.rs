//! A collection as it is drawn on a terminal.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Gauge, Paragraph, Wrap};

use super::view::{Mood, Row, View};

/// Largest width of the list of what is done: as much as the longest name needs, and a gap.
const LIST_WIDTH: u16 = 44;

/// Draws a view: prompts in the middle of attention, progress at the left, sensors at the right.
pub(crate) fn draw(frame: &mut Frame<'_>, view: &View) {
    let notes = (view.notes.len() as u16 + 1).min(frame.area().height / 3);
    let [title, prompt, countdown, body, bottom, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(4),
        Constraint::Length(1),
        Constraint::Min(6),
        Constraint::Length(if view.notes.is_empty() { 0 } else { notes }),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    draw_title(frame, title, view);
    draw_prompt(frame, prompt, view);
    if let Some((part, left_s)) = view.countdown {
        let gauge = Gauge::default()
            .ratio(part)
            .label(format!("{left_s:.1} s"))
            .gauge_style(Style::new().fg(colour(view.mood)));
        frame.render_widget(gauge, countdown);
    }
    let half = (body.width * 12 / 25).min(LIST_WIDTH);
    let [left, right] = Layout::horizontal([Constraint::Length(half), Constraint::Min(38)]).areas(body);
    draw_progress(frame, left, view);
    draw_sensors(frame, right, view);
    let lines: Vec<Line<'_>> = view.notes.iter().map(|note| Line::from(note.as_str())).collect();
    frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: true }).yellow(), bottom);
    frame.render_widget(Paragraph::new(view.keys).dim(), keys);
}

fn colour(mood: Mood) -> Color {
    match mood {
        Mood::Ready => Color::Yellow,
        Mood::Air => Color::Cyan,
        Mood::Touch => Color::Magenta,
        Mood::Waiting => Color::White,
        Mood::Wrong => Color::Red,
    }
}

fn draw_title(frame: &mut Frame<'_>, area: Rect, view: &View) {
    let synthetic = if view.synthetic { "SYNTHETIC  " } else { "" };
    let [left, right] = Layout::horizontal([Constraint::Min(0), Constraint::Length(14)]).areas(area);
    let title =
        Line::from(vec![Span::from("tpf collect  ").bold(), Span::from(synthetic).red(), Span::from(&view.title)]);
    frame.render_widget(Paragraph::new(title), left);
    frame.render_widget(Paragraph::new(view.left.as_str()).right_aligned(), right);
}

fn draw_prompt(frame: &mut Frame<'_>, area: Rect, view: &View) {
    let style = Style::new().fg(colour(view.mood)).add_modifier(Modifier::BOLD);
    let next = if view.next.is_empty() { String::new() } else { format!("then: {}", view.next) };
    let lines =
        vec![Line::from(view.place.as_str()).dim(), Line::styled(view.prompt.as_str(), style), Line::from(next).dim()];
    frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: true }), area);
}

fn draw_progress(frame: &mut Frame<'_>, area: Rect, view: &View) {
    // Where not all fit, those around the one that goes on.
    let rows = area.height.saturating_sub(1) as usize;
    let current = view.rows.iter().position(|row| row.is_current).unwrap_or(0);
    let first = current.saturating_sub(rows / 2).min(view.rows.len().saturating_sub(rows));
    let width = area.width as usize;
    let line = |row: &Row| {
        let numbers = format!("{:>3}/{:<3}", row.done, row.items);
        let room = width.saturating_sub(numbers.len() + 5);
        let name: String = match row.name.chars().count() > room {
            true => row.name.chars().take(room.saturating_sub(1)).chain(['…']).collect(),
            false => row.name.clone(),
        };
        let text = format!("{} {} {name:<room$} {numbers}", if row.is_current { ">" } else { " " }, row.stage);
        match (row.is_current, row.done == row.items) {
            (true, _) => Line::from(text).bold(),
            (_, true) => Line::from(text).green(),
            _ => Line::from(text),
        }
    };
    let lines: Vec<Line<'_>> = view.rows.iter().skip(first).take(rows).map(line).collect();
    frame.render_widget(Paragraph::new(lines).block(Block::new().title("progress")), area);
}

fn draw_sensors(frame: &mut Frame<'_>, area: Rect, view: &View) {
    let width = area.width.saturating_sub(1) as usize;
    let mut lines: Vec<Line<'_>> = Vec::new();
    let rates = view.health.iter().map(|health| {
        let text = format!("{} {:.0}  ", health.name, health.rate_hz);
        if health.is_silent { Span::from(text).red().bold() } else { Span::from(text).green() }
    });
    lines.push(Line::from(rates.chain([Span::from("Hz")]).collect::<Vec<_>>()));
    if let Some(force) = view.force {
        lines.extend(force_lines(force, view, width));
    }
    for (name, parts) in &view.taxels {
        let shown: String = parts.iter().take(width.saturating_sub(name.len() + 1)).map(|part| eighth(*part)).collect();
        lines.push(Line::from(vec![Span::from(format!("{name} ")), Span::from(shown).cyan()]));
    }
    let name_width = view.joints.iter().map(|joint| joint.name.chars().count()).max().unwrap_or(0).min(20);
    for joint in &view.joints {
        let name: String = joint.name.chars().take(name_width).collect();
        let room = width.saturating_sub(name_width + joint.value.chars().count() + 3).clamp(4, 24);
        let at = (joint.part * (room - 1) as f64).round() as usize;
        let bar: String = (0..room).map(|k| if k == at { '\u{25cf}' } else { '\u{2500}' }).collect();
        lines.push(Line::from(vec![
            Span::from(format!("{name:<name_width$} ")),
            Span::from(bar).cyan(),
            Span::from(format!(" {}", joint.value)),
        ]));
    }
    let title = if view.force.is_some() { "sensors   l light  m medium  h heavy" } else { "sensors" };
    frame.render_widget(Paragraph::new(lines).block(Block::new().title(title)), area);
}

/// A block that is this full.
fn eighth(part: f64) -> char {
    const BLOCKS: [char; 9] =
        [' ', '\u{2581}', '\u{2582}', '\u{2583}', '\u{2584}', '\u{2585}', '\u{2586}', '\u{2587}', '\u{2588}'];
    BLOCKS[((part * 8.0).round() as usize).min(8)]
}

/// Force on a scale up to what may not be passed, with light, medium and heavy under it.
fn force_lines<'a>(force: f64, view: &View, width: usize) -> Vec<Line<'a>> {
    let most = view.levels.most;
    let room = width.saturating_sub(10).max(10);
    // A square root gives light touches the room that people need to dose them.
    let at = |force: f64| ((force.max(0.0) / most).sqrt().min(1.0) * room as f64).round() as usize;
    let is_too_much = force > most;
    let bar = "\u{2588}".repeat(at(force));
    let style = if is_too_much { Style::new().red() } else { Style::new().magenta() };
    let mut scale = vec![' '; room];
    for ((from, to), letter) in view.levels.taps.into_iter().zip(['l', 'm', 'h']) {
        for cell in scale.iter_mut().take(at(to)).skip(at(from)) {
            *cell = if *cell == ' ' { letter } else { '\u{b7}' };
        }
    }
    let scale: String = scale.into_iter().collect();
    vec![
        Line::from(vec![Span::from(format!("{force:6.2} N  ")).bold(), Span::styled(bar, style)]),
        Line::from(format!("          {scale}")).dim(),
    ]
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;
    use tactile_pose_fusion::collect::{Command, Layout as Sensors, LedSession, Senses};
    use tactile_pose_fusion::protocol::{Plan, Protocol};
    use tactile_pose_fusion::units::{Newton, Stamp};

    fn view() -> View {
        let protocol = Protocol::paper();
        let plan = Plan::new(&protocol, None, "tests");
        let mut session = LedSession::new(protocol, plan, BTreeSet::new());
        let mut senses = Senses::new(Sensors {
            taxels: vec![("glove".to_owned(), 6)],
            joint_sources: vec!["hand".to_owned()],
            joints: ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"].map(str::to_owned).to_vec(),
            force: vec!["load_cell".to_owned()],
        });
        let joints: Vec<String> = senses.layout().joints.clone();
        for k in 0..100_i64 {
            let now = Stamp(k * 10_000_000);
            senses.handle_taxels(0, &[1.0, 2.0, 3.0, 4.0, 5.0, k as f32], now);
            senses.handle_joints(0, &joints, &[0.1, 0.01 * k as f64, 0.3, 0.0], now);
            senses.handle_force(0, Newton(1.5), now);
        }
        session.handle_command(Command::Go, Stamp(0));
        session.handle_time(Stamp(3_000_000_000));
        let now = Stamp(3_500_000_000);
        // Nothing came for a while, which the rates tell.
        let mut view =
            View::new("glove 7, user anna, donning 1", &session, &senses, 0.0, now).of_session(&session, now);
        view.synthetic = true;
        view.notes = vec!["2 of 30 items want a second look".to_owned()];
        view
    }

    fn drawn(view: &View, width: u16, height: u16) -> Vec<String> {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| draw(frame, view)).unwrap();
        let buffer = terminal.backend().buffer().clone();
        let row = |y: u16| (0..width).map(|x| buffer[(x, y)].symbol().to_owned()).collect::<String>();
        (0..height).map(row).collect()
    }

    #[test]
    fn everything_that_a_person_needs_is_on_a_small_screen_and_on_a_wide_one() {
        for (width, height) in [(80, 24), (160, 50)] {
            let screen = drawn(&view(), width, height);
            let text = screen.join("\n");
            for expected in [
                "user anna",
                "left",
                "stage 1  terminal_poses  1 of 70",
                "In the air: ",
                "then: In the air: ",
                "1.5 s",
                "terminal_poses",
                "0/70",
                "load_cell 0  Hz",
                "SYNTHETIC",
                "1.50 N",
                "l light  m medium  h heavy",
                "glove",
                "index_mcp_abd",
                "(0 to 57)",
                "2 of 30 items want a second look",
                "space pause",
            ] {
                assert!(text.contains(expected), "{expected} is not on {width}x{height}:\n{text}");
            }
        }
    }
}
