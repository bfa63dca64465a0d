//! Decodes messages with the keypoints of a hand, as positions, poses or transforms.

use super::frames::FrameStore;
use super::{BindingError, SampleError, plan};
use crate::hand::{self, Layout, Point, Side};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs, ReadError};

/// How a message holds the keypoints of a hand.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HandFields {
    /// Positions of the keypoints within [`points`](Self::points).
    pub layout: Layout,
    /// Left or right hand.
    pub side: Side,
    /// Names of the points. If the order identifies the points, only the number of names counts.
    pub points: Vec<String>,
    /// Paths of the points' names, whose strings are joined by `_`. Empty if the order identifies the points.
    pub names: Vec<String>,
    /// Path of the flags that say whether each point is valid, if the messages have them.
    pub valid: Option<String>,
    /// Index of the first point of this hand, if a message has the points of more.
    pub first: usize,
    /// Names of the angles, in the order of [`hand::JOINTS`].
    pub joints: Vec<String>,
}

/// Messages of transforms.
pub(crate) const TF: &str = "tf2_msgs/msg/TFMessage";

/// Path of the stamp, for types that we know and whose points are identified by name. `None` if the stamp is in the
/// header.
///
/// A message of transforms may have only some of the hand's points. The hand is complete with the last point.
pub fn hand_stamp(type_name: &str, points: &[String]) -> Option<String> {
    let last = points.last().filter(|_| canonical_type_name(type_name) == TF)?;
    Some(format!("transforms[child_frame_id={last}].header.stamp"))
}

/// Message type of Manus gloves.
pub(crate) const MANUS: &str = "manus_ros2_msgs/msg/ManusGlove";

/// Message type of NVIDIA IsaacTeleop for the named points of a hand.
pub(crate) const NAMED_POSES: &str = "teleop_ros2_interfaces/msg/HandJointPoses";

/// Where the messages of a type have the points of a hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HandPaths {
    /// Path of the positions.
    pub positions: &'static str,
    /// Paths of the names, as [`HandFields::names`].
    pub names: &'static [&'static str],
    /// Path of the flags that say whether each point is valid.
    pub valid: Option<&'static str>,
}

/// Paths of the points, for types that we know.
pub fn hand_paths(type_name: &str) -> Option<HandPaths> {
    let unnamed = |positions| HandPaths { positions, names: &[], valid: None };
    match canonical_type_name(type_name).as_str() {
        "geometry_msgs/msg/PoseArray" => Some(unnamed("poses[].position")),
        TF => {
            Some(HandPaths { names: &["transforms[].child_frame_id"], ..unnamed("transforms[].transform.translation") })
        }
        MANUS => Some(HandPaths {
            names: &["raw_nodes[].chain_type", "raw_nodes[].joint_type"],
            ..unnamed("raw_nodes[].pose.position")
        }),
        NAMED_POSES => Some(HandPaths {
            names: &["joints[].name"],
            valid: Some("joints[].valid"),
            ..unnamed("joints[].pose.position")
        }),
        _ => None,
    }
}

/// Compiled [`HandFields`]. Computes angles from each message.
#[derive(Debug, Clone)]
pub(super) struct HandPlan {
    type_name: String,
    positions: Vec<FieldPlan>, // one path: x, y, z of each point in turn; three: one path per axis
    orientations: Vec<FieldPlan>, // none, or x, y, z, w
    /// Positions and orientations in one, where the messages have nothing else beside them.
    poses: Option<FieldPlan>,
    valid: Option<FieldPlan>,
    names: Vec<FieldPlan>,
    transforms: Option<Transforms>,
    fields: HandFields,
    columns: [Vec<f64>; 8], // x, y, z; x, y, z, w; valid
    read: Vec<f64>,         // the columns in turn, as `poses` reads them
    texts: Vec<Vec<String>>,
    /// The names that came last, and the point of the layout that each of them is.
    named: (Vec<Vec<String>>, Vec<Option<usize>>),
    points: Vec<Point>,
}

const VALID: usize = 7;

const POSE: [&str; VALID] =
    ["position.x", "position.y", "position.z", "orientation.x", "orientation.y", "orientation.z", "orientation.w"];
const TRANSFORM: [&str; VALID] =
    ["translation.x", "translation.y", "translation.z", "rotation.x", "rotation.y", "rotation.z", "rotation.w"];

/// Points that are `/tf` frames. Each is given in its parent.
#[derive(Debug, Clone)]
struct Transforms {
    parents: FieldPlan,
    read: Vec<String>,
    frames: FrameStore,
}

impl HandPlan {
    /// Compiles the path of the points' positions, and what stands beside them.
    ///
    /// Where points are frames, `frames` are those that all topics of the source tell.
    pub(super) fn compile(
        path: &str,
        fields: &HandFields,
        tree: &TypeTree,
        frames: &FrameStore,
    ) -> Result<Self, BindingError> {
        let axes = |of: &str, axes: &[&str]| -> Result<Vec<FieldPlan>, BindingError> {
            axes.iter().map(|axis| plan("field", tree, &format!("{of}.{axis}"), ReadAs::Numbers)).collect()
        };
        let positions = match plan("field", tree, path, ReadAs::Numbers) {
            Ok(flat) => vec![flat],
            Err(error) => axes(path, &["x", "y", "z"]).map_err(|_| error)?,
        };
        // The orientation of a pose can also mark the pose as unknown.
        let stamped = path.strip_suffix(".transform.translation");
        let turned = path.strip_suffix(".position").map(|pose| format!("{pose}.orientation"));
        let turned = turned.or_else(|| stamped.map(|stamped| format!("{stamped}.transform.rotation")));
        let orientations = turned.and_then(|turned| axes(&turned, &["x", "y", "z", "w"]).ok()).unwrap_or_default();
        let of_poses = path.rsplit_once('.').filter(|_| !orientations.is_empty()).and_then(|(pose, _)| {
            let numbers = if stamped.is_some() { TRANSFORM } else { POSE };
            FieldPlan::compile_block(tree, pose, &numbers).ok()
        });
        let transforms = match stamped.filter(|_| !orientations.is_empty() && fields.names.len() == 1) {
            Some(stamped) => {
                let parents = plan("field", tree, &format!("{stamped}.header.frame_id"), ReadAs::Texts)?;
                Some(Transforms { parents, read: vec![], frames: frames.clone() })
            }
            None => None,
        };
        let names: Result<Vec<_>, _> =
            fields.names.iter().map(|path| plan("names_field", tree, path, ReadAs::Texts)).collect();
        let valid = fields.valid.as_ref().map(|path| plan("hand.valid", tree, path, ReadAs::Numbers)).transpose()?;
        let names = names?;
        Ok(HandPlan {
            type_name: tree.type_name().to_owned(),
            positions,
            orientations,
            poses: of_poses,
            read: Vec::new(),
            valid,
            texts: vec![vec![]; names.len()],
            named: Default::default(),
            names,
            transforms,
            points: vec![[f64::NAN; 3]; fields.points.len()],
            fields: fields.clone(),
            columns: Default::default(),
        })
    }

    /// Replaces `angles` by the angles of the hand in a message, rad. NaN for an angle whose points are missing.
    pub(super) fn decode(&mut self, cdr: &[u8], angles: &mut Vec<f64>) -> Result<(), SampleError> {
        angles.clear();
        let n_points = self.read(cdr)?;
        self.points.fill([f64::NAN; 3]);
        if self.transforms.is_some() {
            self.take_frames(cdr, false)?;
            self.place_frames()?;
            angles.extend(hand::angles(&self.points, &self.fields.layout, self.fields.side));
            return Ok(());
        }
        let is_flat = self.positions.len() == 1;
        self.find_named();
        for element in self.fields.first..n_points {
            let Some(slot) = self.slot_of(element) else { continue };
            let [x, y, z, .., valid] = &self.columns;
            let is_known = valid.get(element).is_none_or(|valid| *valid != 0.0) && self.is_turned(element);
            if is_known {
                self.points[slot] = match is_flat {
                    true => [x[3 * element], x[3 * element + 1], x[3 * element + 2]],
                    false => [x[element], y[element], z[element]],
                };
            }
        }
        angles.extend(hand::angles(&self.points, &self.fields.layout, self.fields.side));
        Ok(())
    }

    /// Keeps the transforms of a message that hold until they are told anew.
    pub(super) fn keep_frames(&mut self, cdr: &[u8]) -> Result<(), SampleError> {
        self.read(cdr)?;
        self.take_frames(cdr, true)
    }

    /// Takes the transforms of a message whose columns have been read.
    fn take_frames(&mut self, cdr: &[u8], are_static: bool) -> Result<(), SampleError> {
        let Some(Transforms { parents, read, frames }) = &mut self.transforms else { return Ok(()) };
        parents.read_texts(cdr, read)?;
        let children = &self.texts[0];
        let [x, y, z, qx, qy, qz, qw, _] = &self.columns;
        if let Some(n_beside) = [read.len(), y.len(), z.len(), qx.len()].into_iter().find(|len| *len != children.len())
        {
            return Err(SampleError::Beside { type_name: self.type_name.clone(), n_points: children.len(), n_beside });
        }
        let mut frames = frames.lock();
        for (k, (parent, child)) in read.iter().zip(children).enumerate() {
            frames.handle((parent, child), [x[k], y[k], z[k]], [qx[k], qy[k], qz[k], qw[k]], are_static);
        }
        Ok(())
    }

    /// Places the points that are frames, in the frame that they have in common with the last of them, which must have been
    /// in the message that was taken.
    fn place_frames(&mut self) -> Result<(), SampleError> {
        let Some(Transforms { frames, .. }) = &self.transforms else { return Ok(()) };
        let children = &self.texts[0];
        let mut frames = frames.lock();
        let Some(last) = self.fields.points.last().filter(|last| children.contains(last)) else {
            let wanted = self.fields.points.last().map_or(String::new(), |last| format!("a transform of {last}"));
            let got = children.first().map_or("nothing".to_owned(), |first| format!("'{}'", first.escape_debug()));
            return Err(SampleError::NotForSource { type_name: self.type_name.clone(), wanted, got });
        };
        let root = frames.origin(last).map(|(_, root)| root);
        for (point, name) in self.points.iter_mut().zip(&self.fields.points) {
            if let Some((origin, _)) = frames.origin(name).filter(|(_, of)| Some(*of) == root) {
                *point = origin;
            }
        }
        frames.end_round();
        Ok(())
    }

    /// Reads all columns and returns the number of points.
    fn read(&mut self, cdr: &[u8]) -> Result<usize, SampleError> {
        self.columns.iter_mut().for_each(Vec::clear);
        if let Some(poses) = &self.poses {
            self.read.clear();
            poses.read_f64(cdr, &mut self.read)?;
            for pose in self.read.chunks_exact(VALID) {
                self.columns.iter_mut().zip(pose).for_each(|(column, part)| column.push(*part));
            }
        }
        let parts = self.positions.iter().zip(0..).chain(self.orientations.iter().zip(3..));
        let columns: Result<(), ReadError> = parts
            .filter(|_| self.poses.is_none())
            .chain(self.valid.iter().zip(VALID..))
            .try_for_each(|(plan, column): (_, usize)| plan.read_f64(cdr, &mut self.columns[column]).map(|_| ()));
        columns?;
        for (plan, texts) in self.names.iter().zip(&mut self.texts) {
            plan.read_texts(cdr, texts)?;
        }
        let n_values = self.columns[0].len();
        let n_points = if self.positions.len() == 1 { n_values / 3 } else { n_values };
        let type_name = || self.type_name.clone();
        if n_values == 0 {
            return Err(SampleError::Empty { type_name: type_name(), rows: 1, n_values });
        }
        if self.positions.len() == 1 && !n_values.is_multiple_of(3) {
            return Err(SampleError::Coordinates { type_name: type_name(), n_values });
        }
        let lengths = self.columns[3..].iter().map(Vec::len).chain(self.columns[1..3].iter().map(Vec::len));
        let beside = lengths.filter(|len| *len > 0).chain(self.texts.iter().map(Vec::len));
        let beside = beside.chain(self.valid.iter().map(|_| self.columns[VALID].len()));
        if let Some(n_beside) = beside.into_iter().find(|len| *len != n_points) {
            return Err(SampleError::Beside { type_name: type_name(), n_points, n_beside });
        }
        let wanted = self.fields.first + self.fields.points.len();
        if self.names.is_empty() && n_points < wanted {
            return Err(SampleError::Points { type_name: type_name(), n_points, wanted });
        }
        Ok(n_points)
    }

    /// Index in the layout of an element of the message. If several points have the same name, the first valid one
    /// counts.
    fn slot_of(&self, element: usize) -> Option<usize> {
        if self.names.is_empty() {
            return Some(element - self.fields.first).filter(|slot| *slot < self.points.len());
        }
        self.named.1[element].filter(|slot| self.points[*slot][0].is_nan())
    }

    /// Finds the points that the names of a message are of, if they are not those of the message before.
    fn find_named(&mut self) {
        if self.names.is_empty() || self.named.0 == self.texts {
            return;
        }
        let slots = (0..self.texts[0].len()).map(|element| self.named_slot(element)).collect();
        self.named.0.clone_from(&self.texts);
        self.named.1 = slots;
    }

    /// The point of the layout that an element of the message is named as.
    fn named_slot(&self, element: usize) -> Option<usize> {
        let texts = || self.texts.iter().map(|texts| bare(&texts[element]));
        let is_named = |name: &str| {
            let mut rest = Some(name);
            for (k, text) in texts().enumerate() {
                let from = if k == 0 { rest } else { rest.and_then(|rest| rest.strip_prefix('_')) };
                rest = from.and_then(|rest| strip_prefix(rest, text));
            }
            rest == Some("")
        };
        self.fields.points.iter().position(|name| is_named(name))
    }

    /// True if the orientation of an element is valid: neither NaN nor all zeros.
    fn is_turned(&self, element: usize) -> bool {
        self.orientations.is_empty() || {
            let norm: f64 = self.columns[3..VALID].iter().map(|axis| axis[element] * axis[element]).sum();
            norm.is_finite() && norm > 1e-6
        }
    }
}

/// Name of a point without prefix and suffix of OpenXR's constants: `XR_HAND_JOINT_INDEX_TIP_EXT` gives `INDEX_TIP`.
fn bare(name: &str) -> &str {
    let from = strip_prefix(name, "XR_HAND_JOINT_").unwrap_or(name);
    from.strip_suffix("_EXT").or_else(|| from.strip_suffix("_ext")).unwrap_or(from)
}

/// Like `str::strip_prefix`, ignoring ASCII case.
fn strip_prefix<'a>(text: &'a str, prefix: &str) -> Option<&'a str> {
    let (start, rest) = text.split_at_checked(prefix.len())?;
    start.eq_ignore_ascii_case(prefix).then_some(rest)
}
