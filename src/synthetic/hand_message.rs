//! One sample of the synthetic hand as a message.

use super::device_messages::{self, HandJointPose, HandJointPoses, ManusGlove, ManusRawNode};
use super::hand_forms::{self, HandForm};
use super::{FRAMES, JOINTS, KEYPOINTS, MANUS_GLOVE, NAMED_POSES, POSES};
use crate::hand::NamedLayout;
use crate::msg::definition::TypeTree;
use crate::msg::{Float64MultiArray, Header, JointState, Point, Pose, PoseArray, TFMessage, WireType, to_cdr_into};
use crate::units::Stamp;

/// The hand, in the form in which it is written.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs)] // the forms say it
pub enum HandMessage {
    Angles(JointState),
    Poses(PoseArray),
    Keypoints(Float64MultiArray),
    Named(HandJointPoses),
    Manus(ManusGlove),
    Transforms(TFMessage),
}

impl HandForm {
    /// Topic of the hand.
    pub fn topic(self) -> &'static str {
        match self {
            HandForm::Angles => JOINTS,
            HandForm::Poses(_) => POSES,
            HandForm::Keypoints(_) => KEYPOINTS,
            HandForm::Named => NAMED_POSES,
            HandForm::Manus => MANUS_GLOVE,
            HandForm::Transforms => FRAMES,
        }
    }

    /// Type of the messages.
    pub fn type_name(self) -> &'static str {
        match self {
            HandForm::Angles => JointState::TYPE_NAME,
            HandForm::Poses(_) => PoseArray::TYPE_NAME,
            HandForm::Keypoints(_) => Float64MultiArray::TYPE_NAME,
            HandForm::Named => HandJointPoses::TYPE_NAME,
            HandForm::Manus => ManusGlove::TYPE_NAME,
            HandForm::Transforms => TFMessage::TYPE_NAME,
        }
    }

    /// Definition of the type with all that it depends on, as rosbag2 writes it.
    pub fn schema_text(self) -> String {
        device_messages::schema_text(self.type_name())
    }

    /// The resolved type.
    pub fn type_tree(self) -> TypeTree {
        TypeTree::from_schema(self.type_name(), &self.schema_text()).expect("a test resolves the type of every form")
    }
}

impl HandMessage {
    /// A sample of the hand in a form.
    pub(super) fn new(form: HandForm, names: &[String], positions: &[f64], stamp: Stamp) -> Self {
        let header = |frame_id: &str| Header { stamp: stamp.into(), frame_id: frame_id.to_owned() };
        let poses = |layout| hand_forms::poses(names, positions, layout);
        match form {
            HandForm::Angles => {
                let (name, position) = (names.to_vec(), positions.to_vec());
                HandMessage::Angles(JointState { header: header(""), name, position, velocity: vec![], effort: vec![] })
            }
            HandForm::Poses(layout) => HandMessage::Poses(PoseArray { header: header("wrist"), poses: poses(layout) }),
            HandForm::Keypoints(layout) => {
                let data = poses(layout).into_iter().flat_map(|Pose { position: Point { x, y, z }, .. }| [x, y, z]);
                HandMessage::Keypoints(Float64MultiArray { data: data.collect(), ..Float64MultiArray::default() })
            }
            HandForm::Named => {
                let named =
                    |(name, pose): (String, Pose)| HandJointPose { name, valid: pose.position.x.is_finite(), pose };
                let layout = NamedLayout::OpenXr;
                let joints = layout.points().into_iter().zip(poses(layout)).map(named).collect();
                HandMessage::Named(HandJointPoses { header: header("wrist"), joints })
            }
            HandForm::Manus => HandMessage::Manus(manus(poses(NamedLayout::Manus))),
            HandForm::Transforms => HandMessage::Transforms(hand_forms::frames(names, positions, stamp)),
        }
    }

    /// Encodes the message in little-endian CDR, into a buffer that is cleared first.
    pub fn to_cdr_into(&self, cdr: &mut Vec<u8>) {
        match self {
            HandMessage::Angles(message) => to_cdr_into(message, cdr),
            HandMessage::Poses(message) => to_cdr_into(message, cdr),
            HandMessage::Keypoints(message) => to_cdr_into(message, cdr),
            HandMessage::Named(message) => to_cdr_into(message, cdr),
            HandMessage::Manus(message) => to_cdr_into(message, cdr),
            HandMessage::Transforms(message) => to_cdr_into(message, cdr),
        }
    }
}

/// The message of a Manus glove on the right hand with these points.
fn manus(poses: Vec<Pose>) -> ManusGlove {
    let layout = NamedLayout::Manus.layout();
    let chains = layout.fingers.iter().map(|chain| &chain[..]).chain([&layout.thumb[..]]);
    let mut parents = vec![layout.wrist; poses.len()];
    for pair in chains.flat_map(|chain| chain.windows(2)) {
        parents[pair[1]] = pair[0];
    }
    let node = |(idx, (name, pose)): (usize, (String, Pose))| {
        let (chain, joint) = name.split_once('_').expect("a point of the layout is named by chain and joint");
        let (joint_type, chain_type) = (joint.to_owned(), chain.to_owned());
        ManusRawNode { node_id: idx as i32, parent_node_id: parents[idx] as i32, joint_type, chain_type, pose }
    };
    let raw_nodes: Vec<ManusRawNode> =
        NamedLayout::Manus.points().into_iter().zip(poses).enumerate().map(node).collect();
    ManusGlove { side: "Right".to_owned(), raw_node_count: raw_nodes.len() as i32, raw_nodes, ..ManusGlove::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::dynamic::read_value;

    #[test]
    fn the_type_of_every_form_resolves_to_the_struct_that_is_encoded() {
        let layout = NamedLayout::Mano21;
        let forms = [
            HandForm::Angles,
            HandForm::Poses(layout),
            HandForm::Keypoints(layout),
            HandForm::Named,
            HandForm::Manus,
            HandForm::Transforms,
        ];
        for form in forms {
            let tree = form.type_tree();
            assert_eq!(tree.type_name(), form.type_name());
            let mut cdr = Vec::new();
            HandMessage::new(form, &[], &[], Stamp(1)).to_cdr_into(&mut cdr);
            let (_, n_left) = read_value(&tree, &cdr).unwrap_or_else(|error| panic!("{form:?}: {error}"));
            assert!(n_left < 4, "{form:?}: {n_left} bytes are left");
        }
    }
}
