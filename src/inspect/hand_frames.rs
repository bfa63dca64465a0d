//! Which frames of `/tf` can be the points of a hand.

use super::hand::HandCandidate;
use super::likelihood::Likelihood;
use super::parameters::{SourceLines, yaml_text};
use super::view::View;
use crate::hand::NamedLayout;

/// Layouts whose points may be frames, with their names.
const LAYOUTS: [(NamedLayout, &str); 2] = [(NamedLayout::OpenXr25, "openxr25"), (NamedLayout::Mano21, "mano21")];

/// The hands whose points are all frames of a topic, or of the one with the frames that don't move.
pub(super) fn candidates(view: &View<'_>, views: &[View<'_>]) -> Vec<HandCandidate> {
    let Some(moving) = &view.look.frames else { return Vec::new() };
    let fixed = format!("{}_static", view.topic.name);
    let fixed = views.iter().find(|other| other.topic.name == fixed);
    let fixed = fixed.and_then(|other| other.look.frames.as_ref());
    let frame = |name: &str| moving.frames.get(name).or_else(|| fixed.and_then(|fixed| fixed.frames.get(name)));
    let mut found = Vec::new();
    for (layout, layout_name) in LAYOUTS {
        let points = layout.points();
        let Some(last) = points.last() else { continue };
        // The name of the last point stands inside of its frame's: right_hand/little_tip, little_tip_link.
        for (before, after) in moving.frames.keys().filter_map(|name| name.split_once(last.as_str())) {
            let frames: Option<Vec<String>> =
                points.iter().map(|point| frame(&format!("{before}{point}{after}")).cloned()).collect();
            if let Some(frames) = frames {
                found.push(candidate(view, (layout_name, &points), &frames));
            }
        }
    }
    found
}

fn candidate(view: &View<'_>, (layout, points): (&'static str, &[String]), frames: &[String]) -> HandCandidate {
    let View { topic, stats, .. } = *view;
    let reason = format!("{} of its frames are named as the points of {layout}", frames.len());
    let mut lines = SourceLines::new("joint", &topic.name, &topic.type_name);
    if frames == points {
        lines.noted("hand.layout", layout, &reason);
    } else {
        let names: Vec<String> = frames.iter().map(|name| yaml_text(name)).collect();
        lines.noted("hand.points", &format!("[{}]", names.join(", ")), &reason);
    }
    HandCandidate {
        topic: topic.name.clone(),
        type_name: topic.type_name.clone(),
        n_messages: stats.map_or(0, |stats| stats.n_messages),
        rate_hz: stats.and_then(|stats| stats.rate_hz),
        field: format!("transforms[child_frame_id={}]", frames[frames.len() - 1]),
        n_points: frames.len() as u64,
        layout,
        hands: vec![0],
        sides: None,
        likelihood: Likelihood::Likely,
        reasons: vec![reason],
        parameters: lines,
    }
}
