//! A running node as `tpf monitor` shows it: a screen, and the same as text.

mod screen;

pub(crate) use screen::draw;

use tactile_pose_fusion::fusion::Flags;
use tactile_pose_fusion::msg::ContactState;
use tactile_pose_fusion::ros::Monitored;
use tactile_pose_fusion::units::Stamp;

/// Forces, flags and diagnostics as a table with lines below.
pub(crate) fn text(watched: &Monitored, now: Stamp) -> String {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::ASCII_MARKDOWN);
    table.set_header(["Region", "Contact", "Force N", "Base N", "Artifact N", "Pose age ms", "Onsets", "Flags"]);
    for (name, region) in &watched.regions {
        let state = &region.state;
        table.add_row([
            name.clone(),
            if state.contact { "yes" } else { "no" }.to_owned(),
            number(state.force),
            number(state.force_base),
            number(state.artifact),
            number(1e3 * state.pose_age),
            region.n_onsets.to_string(),
            flags(state, watched.is_silent(region, now)),
        ]);
    }
    let mut text = format!("{}\n", watched.headline(now));
    if !watched.regions.is_empty() {
        text += &format!("{table}\n");
    }
    if let Some(age_s) = watched.diagnostics_late_s(now) {
        text += &format!("the node said this {age_s:.0} s ago:\n");
    }
    for health in &watched.diagnostics {
        text += &format!("{} {}: {}\n", health.level, health.name, health.message);
    }
    if let Some(unreadable) = &watched.unreadable {
        text += &format!("some messages could not be read: {unreadable}\n");
    }
    text
}

fn number(value: f64) -> String {
    let value = if value.abs() < 0.005 { 0.0 } else { value }; // no -0.00
    if value.is_finite() { format!("{value:.2}") } else { "-".to_owned() }
}

/// The names of the flags that are set.
fn flags(state: &ContactState, is_silent: bool) -> String {
    let set = Flags::from_bits(state.flags);
    let names = Flags::names().filter(|(flag, _)| set.contains(*flag)).map(|(_, name)| name);
    names.chain(is_silent.then_some("SILENT")).collect::<Vec<_>>().join(" ")
}
