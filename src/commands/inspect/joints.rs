//! Which topics can be joint angles.

use std::f32::consts::TAU;

use serde::Serialize;

use super::candidates::{Likelihood, View};
use super::fields::ArrayWatch;
use super::hints;
use super::parameters::{Block, text};

const JOINT_STATE: &str = "sensor_msgs/msg/JointState";

/// Most joints of one topic that are told apart.
const MAX_JOINTS: usize = 256;

/// Words of what stands beside joint angles in messages and is none.
const NO_ANGLE: &[&str] =
    &["vel", "effort", "torque", "current", "force", "acc", "temp", "volt", "taxel", "tactile", "stamp"];

/// Last names of paths that lead to parts of positions and orientations in space.
const COORDINATES: &[&str] = &["x", "y", "z", "w"];

/// One joint angle as it was seen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Angle {
    /// Its name, where messages name it.
    pub(super) name: Option<String>,
    /// Least and greatest value, of the finite ones.
    pub(super) values: Option<[f32; 2]>,
    /// Whether some value is beyond a full turn in radians.
    pub(super) beyond_a_turn: bool,
}

/// The angles of an array, message after message.
#[derive(Debug, Default)]
pub(super) struct JointRun {
    angles: Vec<Angle>,
    /// Messages with another number of names than of values.
    n_unmatched: u64,
}

/// A topic that can be joint angles.
#[derive(Debug, Serialize)]
pub(super) struct JointCandidate {
    pub(super) topic: String,
    #[serde(rename = "type")]
    pub(super) type_name: String,
    pub(super) n_messages: u64,
    pub(super) rate_hz: Option<f64>,
    /// Path of the angles.
    pub(super) field: String,
    pub(super) element: String,
    /// Fewest and most values in a message.
    pub(super) n_values: [u64; 2],
    /// In the order in which they were first seen.
    pub(super) angles: Vec<Angle>,
    pub(super) looks_like_degrees: bool,
    pub(super) likelihood: Likelihood,
    pub(super) reasons: Vec<String>,
    /// Lines for the parameter file, below `ros__parameters`.
    pub(super) parameters: String,
}

impl JointRun {
    /// A run for an array whose name suggests joint angles.
    pub(super) fn of(type_name: &str, topic: &str, path: &str) -> Option<Self> {
        let is_one = type_name == JOINT_STATE
            || (!hints::is_ours(type_name)
                && !hints::is_standard(type_name)
                && hints::found(path, NO_ANGLE).is_none()
                && !COORDINATES.contains(&path.rsplit('.').next().unwrap_or_default())
                && hints::told(topic, type_name, path, hints::JOINT).is_some());
        is_one.then(JointRun::default)
    }

    pub(super) fn handle(&mut self, names: Option<&[String]>, values: &[f32]) {
        let names = names.filter(|names| !names.is_empty());
        if names.is_some_and(|names| names.len() != values.len()) {
            self.n_unmatched += 1;
            return;
        }
        for (idx, value) in values.iter().enumerate() {
            let name = names.and_then(|names| names.get(idx)).map(String::as_str);
            let Some(angle) = self.angle(idx, name) else { return };
            if value.is_finite() {
                let [least, most] = angle.values.get_or_insert([*value, *value]);
                (*least, *most) = (least.min(*value), most.max(*value));
                angle.beyond_a_turn |= value.abs() > TAU;
            }
        }
    }

    /// The angle by name, or by place where it has none; new ones up to the limit.
    fn angle(&mut self, idx: usize, name: Option<&str>) -> Option<&mut Angle> {
        let is_it = |angle: &Angle| angle.name.as_deref() == name;
        let place = match name {
            None => (idx < self.angles.len()).then_some(idx),
            // Messages seldom change the order of their joints.
            Some(_) if self.angles.get(idx).is_some_and(is_it) => Some(idx),
            Some(_) => self.angles.iter().position(is_it),
        };
        if place.is_none() {
            if self.angles.len() >= MAX_JOINTS {
                return None;
            }
            self.angles.push(Angle { name: name.map(str::to_owned), values: None, beyond_a_turn: false });
        }
        let place = place.unwrap_or(self.angles.len() - 1);
        self.angles.get_mut(place)
    }
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

    let mut block = Block::new("joint", &topic.name, &topic.type_name);
    if !is_joint_state {
        block.line("field", &text(&array.path));
        match array.names_path().filter(|_| is_named) {
            Some(path) => block.line("names_field", &text(path)),
            None => {
                let names: Vec<String> =
                    (0..array.n_values[1].min(MAX_JOINTS as u64)).map(|idx| format!("joint_{idx}")).collect();
                block.noted("names", &format!("[{}]", names.join(", ")), "their order is yours to tell");
            }
        }
    }
    block.stamp(look.stamp_path());
    if is_integer {
        block.noted("scale", "1.0", "rad per count: set it");
    } else if looks_like_degrees {
        block.line("degrees", "true");
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
        likelihood,
        reasons,
        parameters: block.finish(),
    })
}
