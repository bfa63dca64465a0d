//! Which topics can be the points of a hand, from which joint angles are computed.

use super::hand_points::{HAND, HandWatch};
use super::hints;
use super::likelihood::Likelihood;
use super::parameters::{SourceLines, yaml_text};
use super::sides::{SideWatch, Sides};
use super::view::View;
use crate::msg::binding::{MANUS, hand_paths};
use crate::msg::canonical_type_name;

/// A topic that can be the points of a hand.
#[derive(Debug, Clone)]
pub struct HandCandidate {
    /// Its topic.
    pub topic: String,
    /// Its message type.
    pub type_name: String,
    /// Messages on the topic.
    pub n_messages: u64,
    /// Messages a second, by their stamps where there are any.
    pub rate_hz: Option<f64>,
    /// Path of the positions.
    pub field: String,
    /// Points in a message.
    pub n_points: u64,
    /// Name of the layout in the parameters.
    pub layout: &'static str,
    /// Index of the first point of each hand in a message.
    pub hands: Vec<u64>,
    /// The field that says which hand a message is of, if there is one.
    pub sides: Option<Sides>,
    /// How much speaks for it.
    pub likelihood: Likelihood,
    /// The reasons for it, and against it.
    pub reasons: Vec<String>,
    /// Lines for the parameter file, below `ros__parameters`: all but which hand it is.
    pub parameters: SourceLines,
}

/// Layouts by the number of points of one hand, or of two.
const LAYOUTS: [(u64, &str); 3] = [(21, "mano21"), (25, "openxr25"), (26, "openxr")];

/// The hand that a field can be.
pub(super) fn candidate(view: &View<'_>, watch: &HandWatch) -> Option<HandCandidate> {
    let View { topic, look, stats, stamps, .. } = *view;
    if watch.n_seen == 0 {
        return None;
    }
    let known = hand_paths(&topic.type_name).filter(|known| known.positions == watch.path);
    let is_manus = known.is_some() && canonical_type_name(&topic.type_name) == MANUS;
    let n_points = watch.n_points[0];
    let (layout, n_hands) = match is_manus {
        true => ("manus", 1),
        false if watch.n_points[0] != watch.n_points[1] => return None,
        false => {
            let of =
                |n_hands: u64| LAYOUTS.iter().find(|(n, _)| n * n_hands == n_points).map(|(_, name)| (*name, n_hands));
            of(1).or(of(2))?
        }
    };
    let hint = hints::told(&topic.name, &topic.type_name, &watch.path, HAND);
    let mut reasons = vec![match is_manus {
        true => "its type is that of a Manus glove".to_owned(),
        false => format!("its {n_points} points are {n_hands} x {layout}"),
    }];
    let mut likelihood = if hint.is_some() { Likelihood::Likely } else { Likelihood::Possible };
    reasons.extend(hint);
    if !watch.moves && watch.n_seen > 1 {
        reasons.push("but its points never move".to_owned());
        likelihood = likelihood.less();
    }
    let mut lines = SourceLines::new("joint", &topic.name, &topic.type_name);
    if known.is_none() {
        lines.line("field", &yaml_text(&watch.path));
        if let Some(names) = &watch.names {
            lines.line("names_field", &yaml_text(names));
        }
    }
    let sides = look.side.as_ref().and_then(SideWatch::seen);
    lines.only(sides.as_ref());
    lines.stamp(look);
    lines.noted("hand.layout", layout, &reasons[0]);
    if let Some(valid) = watch.valid.as_ref().filter(|_| known.is_none_or(|known| known.valid.is_none())) {
        lines.line("hand.valid", &yaml_text(valid));
    }
    Some(HandCandidate {
        topic: topic.name.clone(),
        type_name: topic.type_name.clone(),
        n_messages: stats.map_or(0, |stats| stats.n_messages),
        rate_hz: stamps.and_then(|stamps| stamps.rate_hz).or(stats.and_then(|stats| stats.rate_hz)),
        field: watch.path.clone(),
        n_points,
        layout,
        hands: (0..n_hands).map(|hand| hand * n_points / n_hands).collect(),
        sides,
        likelihood,
        reasons,
        parameters: lines,
    })
}
