//! Messages in which devices on the market send a hand, as their packages define them.

use serde::{Deserialize, Serialize};

use crate::msg::binding::{MANUS, NAMED_POSES};
use crate::msg::{Header, Pose, Quaternion, WireType, definition_text};

/// A named point of a hand.
/// # Source
/// `teleop_ros2_interfaces` of NVIDIA IsaacTeleop.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct HandJointPose {
    /// Name of the point, as OpenXR names it.
    pub name: String,
    /// Pose of the point.
    pub pose: Pose,
    /// False if the point is not known.
    pub valid: bool,
}

/// The named points of a hand.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct HandJointPoses {
    /// Time, and the frame of the poses.
    pub header: Header,
    /// The points.
    pub joints: Vec<HandJointPose>,
}

/// A point of a hand in a Manus glove.
/// # Source
/// `manus_ros2_msgs` of Manus.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ManusRawNode {
    /// Number of the point.
    pub node_id: i32,
    /// Number of the point before it.
    pub parent_node_id: i32,
    /// `MCP`, `PIP`, `IP`, `DIP` or `TIP`; `Invalid` for the wrist.
    pub joint_type: String,
    /// `Thumb`, `Index`, `Middle`, `Ring` or `Pinky`; `Hand` for the wrist.
    pub chain_type: String,
    /// Pose of the point.
    pub pose: Pose,
}

/// An angle that Manus' own software computed.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ManusErgonomics {
    /// Name of the angle.
    pub r#type: String,
    /// Degrees.
    pub value: f32,
}

/// A message of a Manus glove, without a header.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ManusGlove {
    /// Number of the glove.
    pub glove_id: i32,
    /// `Left` or `Right`.
    pub side: String,
    /// Length of `raw_nodes`.
    pub raw_node_count: i32,
    /// Points of the hand.
    pub raw_nodes: Vec<ManusRawNode>,
    /// Length of `ergonomics`.
    pub ergonomics_count: i32,
    /// Angles of the hand.
    pub ergonomics: Vec<ManusErgonomics>,
    /// Orientation of the glove.
    pub raw_sensor_orientation: Quaternion,
    /// Length of `raw_sensor`.
    pub raw_sensor_count: i32,
    /// Poses of the glove's sensors.
    pub raw_sensor: Vec<Pose>,
}

impl WireType for HandJointPoses {
    const TYPE_NAME: &'static str = NAMED_POSES;
}

impl WireType for ManusGlove {
    const TYPE_NAME: &'static str = MANUS;
}

/// The definition of a type with all that it depends on, as rosbag2 writes it: one of those above, or one that is compiled in.
pub(super) fn schema_text(type_name: &str) -> String {
    let (text, parts, standard): (&str, &[(&str, &str)], &[&str]) = match type_name {
        NAMED_POSES => (
            "std_msgs/Header header\nHandJointPose[] joints\n",
            &[("teleop_ros2_interfaces/HandJointPose", "string name\ngeometry_msgs/Pose pose\nbool valid\n")],
            &["std_msgs/Header", "geometry_msgs/Pose"],
        ),
        MANUS => (
            "int32 glove_id\nstring side\nint32 raw_node_count\nManusRawNode[] raw_nodes\nint32 ergonomics_count\n\
             ManusErgonomics[] ergonomics\ngeometry_msgs/Quaternion raw_sensor_orientation\nint32 raw_sensor_count\n\
             geometry_msgs/Pose[] raw_sensor\n",
            &[
                (
                    "manus_ros2_msgs/ManusRawNode",
                    "int32 node_id\nint32 parent_node_id\nstring joint_type\nstring chain_type\ngeometry_msgs/Pose pose\n",
                ),
                ("manus_ros2_msgs/ManusErgonomics", "string type\nfloat32 value\n"),
            ],
            &["geometry_msgs/Pose"],
        ),
        _ => return definition_text(type_name).expect("the definition of a wire struct is compiled in"),
    };
    let rule = "=".repeat(80);
    let compiled_in = |name: &&str| definition_text(name).expect("a standard type of the table");
    let standard = standard.iter().map(|name| (*name, compiled_in(name)));
    let parts = parts.iter().map(|(name, text)| (*name, (*text).to_owned()));
    let below = parts.chain(standard).map(|(name, text)| format!("\n{rule}\nMSG: {name}\n{text}"));
    format!("{text}{}", below.collect::<String>())
}
