//! Which frames of `/tf` can be the points of a hand.

use std::collections::BTreeMap;

use super::hand::HandCandidate;
use super::likelihood::Likelihood;
use super::parameters::{SourceLines, yaml_text};
use super::view::View;
use crate::hand::NamedLayout;
use crate::msg::binding::{TF, hand_paths};
use crate::msg::definition::TypeTree;
use crate::msg::dynamic::{FieldPlan, ReadAs};

/// Most frames of a topic whose names are kept.
const MAX_FRAMES: usize = 1024;

/// Layouts whose points may be frames, with their names.
const LAYOUTS: [(NamedLayout, &str); 2] = [(NamedLayout::OpenXr25, "openxr25"), (NamedLayout::Mano21, "mano21")];

/// The frames that the messages of a topic tell.
#[derive(Debug)]
pub(super) struct FrameWatch {
    names: FieldPlan,
    /// By their name in lower case.
    frames: BTreeMap<String, String>,
}

/// A watch for messages of transforms.
pub(super) fn watch(tree: &TypeTree) -> Option<FrameWatch> {
    let names = hand_paths(tree.type_name()).filter(|_| tree.type_name() == TF)?.names[0];
    Some(FrameWatch { names: FieldPlan::compile(tree, names, ReadAs::Texts).ok()?, frames: BTreeMap::new() })
}

impl FrameWatch {
    /// Takes in a message; one that can't be read is counted elsewhere.
    pub(super) fn handle(&mut self, cdr: &[u8], texts: &mut Vec<String>) {
        if self.names.read_texts(cdr, texts).is_err() {
            return;
        }
        for name in texts.iter() {
            let key = name.to_ascii_lowercase();
            if self.frames.len() < MAX_FRAMES || self.frames.contains_key(&key) {
                self.frames.entry(key).or_insert_with(|| name.clone());
            }
        }
    }
}

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
