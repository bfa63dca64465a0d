//! Which topics can be joint angles.

use serde::Serialize;

use super::angles::{Angle, JOINT_STATE, MAX_JOINTS, is_coordinate};
use super::arrays::ArrayWatch;
use super::hints;
use super::likelihood::Likelihood;
use super::parameters::{SourceLines, yaml_text};
use super::sides::{SideWatch, Sides};
use super::view::View;

/// A topic that can be joint angles.
#[derive(Debug, Serialize)]
pub struct JointCandidate {
    /// Its topic.
    pub topic: String,
    /// Its message type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Messages on the topic.
    pub n_messages: u64,
    /// Messages a second, by their stamps where there are any.
    pub rate_hz: Option<f64>,
    /// Path of the angles.
    pub field: String,
    /// Type of the numbers.
    pub element: String,
    /// Fewest and most values in a message.
    pub n_values: [u64; 2],
    /// In the order in which they were first seen.
    pub angles: Vec<Angle>,
    /// Whether some angle is beyond a full turn in rad.
    pub looks_like_degrees: bool,
    /// Whether messages name the angles; otherwise the parameters have to.
    #[serde(skip)]
    pub is_named: bool,
    /// How much speaks for it.
    pub likelihood: Likelihood,
    /// The reasons for it, and against it.
    pub reasons: Vec<String>,
    /// Which hand messages are of.
    #[serde(skip)]
    pub sides: Option<Sides>,
    /// Lines for the parameter file, below `ros__parameters`.
    pub parameters: SourceLines,
}

/// The joint angles that an array can be.
pub(super) fn candidate(view: &View<'_>, array: &ArrayWatch) -> Option<JointCandidate> {
    let run = array.joints.as_ref().filter(|_| array.n_values[1] > 0)?;
    let View { topic, look, stats, stamps, .. } = *view;
    let is_joint_state = topic.type_name == JOINT_STATE;
    let names: Vec<&str> = run.angles.iter().filter_map(|angle| angle.name.as_deref()).collect();
    let is_named = !names.is_empty() && run.n_unmatched == 0;
    let is_integer = !array.is_float();
    let looks_like_degrees = !is_integer && run.angles.iter().any(|angle| angle.beyond_a_turn);

    let mut reasons = Vec::new();
    if is_joint_state {
        reasons.push("its type is made for joint angles".to_owned());
    } else if let Some(hint) = hints::told(&topic.name, &topic.type_name, &array.path, hints::JOINT) {
        reasons.push(hint);
    } else if is_coordinate(&array.path) {
        reasons.push("robots call the coordinate of a motor q".to_owned());
    }
    if is_named && !is_joint_state {
        reasons.push("it names as many joints as it has values".to_owned());
    }
    if run.n_unmatched > 0 {
        reasons.push(format!("{} messages name another number of joints than they have values", run.n_unmatched));
    }
    if looks_like_degrees {
        reasons.push("values beyond a full turn in rad look like degrees".to_owned());
    }
    if is_integer {
        reasons.push("its values are whole numbers, such as counts of an encoder".to_owned());
    }
    let likelihood = if is_joint_state || is_named { Likelihood::Likely } else { Likelihood::Possible };

    let mut lines = SourceLines::new("joint", &topic.name, &topic.type_name);
    if !is_joint_state {
        lines.line("field", &yaml_text(&array.path));
        match array.names_path().filter(|_| is_named) {
            Some(path) => lines.line("names_field", &yaml_text(path)),
            None => {
                let names: Vec<String> =
                    (0..array.n_values[1].min(MAX_JOINTS as u64)).map(|idx| format!("joint_{idx}")).collect();
                lines.noted("names", &format!("[{}]", names.join(", ")), "their order is yours to tell");
            }
        }
    }
    lines.stamp(look);
    let sides = look.side.as_ref().and_then(SideWatch::seen);
    lines.only(sides.as_ref());
    if is_integer {
        lines.noted("scale", "1.0", "rad per count: set it");
    } else if looks_like_degrees {
        lines.line("degrees", "true");
    }
    Some(JointCandidate {
        topic: topic.name.clone(),
        type_name: topic.type_name.clone(),
        n_messages: stats.map_or(0, |stats| stats.n_messages),
        rate_hz: stamps.and_then(|stamps| stamps.rate_hz).or(stats.and_then(|stats| stats.rate_hz)),
        field: array.path.clone(),
        element: array.kind.to_string(),
        n_values: array.n_values,
        angles: run.angles.clone(),
        looks_like_degrees,
        is_named,
        likelihood,
        reasons,
        sides,
        parameters: lines,
    })
}
