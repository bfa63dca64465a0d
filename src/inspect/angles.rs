//! Joint angles in messages, told apart by name.

use std::f32::consts::TAU;

use serde::Serialize;

use super::hints;

pub(super) const JOINT_STATE: &str = "sensor_msgs/msg/JointState";

/// Most joints of one topic that are told apart.
pub(super) const MAX_JOINTS: usize = 256;

/// Words of what stands beside joint angles in messages and is none.
const NO_ANGLE: &[&str] =
    &["vel", "effort", "torque", "current", "force", "acc", "temp", "volt", "taxel", "tactile", "stamp"];

/// Whether a path leads to the coordinate of each of several motors, as robots call it.
pub(super) fn is_coordinate(path: &str) -> bool {
    path.ends_with("[].q")
}

/// Last names of paths that lead to parts of positions and orientations in space.
const COORDINATES: &[&str] = &["x", "y", "z", "w"];

/// One joint angle as it was seen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Angle {
    /// Its name, where messages name it.
    pub name: Option<String>,
    /// Least and greatest value, of the finite ones.
    pub values: Option<[f32; 2]>,
    /// Whether some value is beyond a full turn in radians.
    pub beyond_a_turn: bool,
}

/// The angles of an array, message after message.
#[derive(Debug, Default)]
pub(super) struct JointRun {
    pub(super) angles: Vec<Angle>,
    /// Messages with another number of names than of values.
    pub(super) n_unmatched: u64,
}

impl JointRun {
    /// A run for an array whose name suggests joint angles.
    pub(super) fn of(type_name: &str, topic: &str, path: &str) -> Option<Self> {
        let is_one = type_name == JOINT_STATE
            || (!hints::is_ours(type_name)
                && !hints::is_standard(type_name)
                && hints::found(path, NO_ANGLE).is_none()
                && !COORDINATES.contains(&path.rsplit('.').next().unwrap_or_default())
                && (is_coordinate(path) || hints::told(topic, type_name, path, hints::JOINT).is_some()));
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
