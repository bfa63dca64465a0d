//! Standard messages that we read and write. Each matches a definition under `msg/standard`.

use serde::{Deserialize, Serialize};

use super::WireType;
use crate::units::{NANOS_PER_SEC, Stamp};

/// A point in ROS time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Time {
    /// Whole seconds, rounded down.
    pub sec: i32,
    /// Nanoseconds within the second, below 1e9.
    pub nanosec: u32,
}

impl From<Stamp> for Time {
    fn from(stamp: Stamp) -> Self {
        let (sec, nanosec) = stamp.to_sec_nanosec();
        Time { sec, nanosec }
    }
}

impl From<Time> for Stamp {
    fn from(time: Time) -> Self {
        Stamp::from_sec_nanosec(time.sec, time.nanosec)
    }
}

/// A duration, which may be negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Duration {
    /// Whole seconds, rounded down.
    pub sec: i32,
    /// Nanoseconds within the second, below 1e9.
    pub nanosec: u32,
}

impl Duration {
    /// The duration of `nanos`. Saturates if the seconds don't fit an `int32`.
    pub fn from_nanos(nanos: i64) -> Self {
        let (sec, nanosec) = Stamp(nanos).to_sec_nanosec();
        Duration { sec, nanosec }
    }

    /// The duration in nanoseconds.
    pub fn nanos(self) -> i64 {
        i64::from(self.sec) * NANOS_PER_SEC + i64::from(self.nanosec)
    }
}

/// Header at the beginning of most messages.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Header {
    /// Time of the data.
    pub stamp: Time,
    /// Frame of the data.
    pub frame_id: String,
}

/// Angles of joints, matched by name.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct JointState {
    /// Stamp of the angles.
    pub header: Header,
    /// `[joints]`.
    pub name: Vec<String>,
    /// `[joints]` or empty, rad or m.
    pub position: Vec<f64>,
    /// `[joints]` or empty, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// `[joints]` or empty, N m or N.
    pub effort: Vec<f64>,
}

/// Three components along the axes of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Vector3 {
    /// Along x.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// Along z.
    pub z: f64,
}

/// A point in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Point {
    /// Along x, m.
    pub x: f64,
    /// Along y, m.
    pub y: f64,
    /// Along z, m.
    pub z: f64,
}

/// An orientation as a unit quaternion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// Of the vector part.
    pub x: f64,
    /// Of the vector part.
    pub y: f64,
    /// Of the vector part.
    pub z: f64,
    /// The scalar part.
    pub w: f64,
}

impl Default for Quaternion {
    /// No rotation.
    fn default() -> Self {
        Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

/// A position and an orientation in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// The position.
    pub position: Point,
    /// The orientation.
    pub orientation: Quaternion,
}

/// Poses in one frame, such as the poses of a hand's joints.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PoseArray {
    /// Time and frame.
    pub header: Header,
    /// The poses.
    pub poses: Vec<Pose>,
}

/// From the coordinates of one frame to those of another.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Transform {
    /// Origin of the child in its parent.
    pub translation: Vector3,
    /// Orientation of the child in its parent.
    pub rotation: Quaternion,
}

/// Where a frame is in its parent.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TransformStamped {
    /// Time, and the parent.
    pub header: Header,
    /// The frame.
    pub child_frame_id: String,
    /// The transform.
    pub transform: Transform,
}

/// Transforms of some frames, as on `/tf`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TFMessage {
    /// The transforms.
    pub transforms: Vec<TransformStamped>,
}

/// A force and a torque about the origin of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Wrench {
    /// N.
    pub force: Vector3,
    /// N m.
    pub torque: Vector3,
}

/// A wrench with its frame and time.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WrenchStamped {
    /// Time and frame.
    pub header: Header,
    /// The wrench.
    pub wrench: Wrench,
}

/// One dimension of a multi-array.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct MultiArrayDimension {
    /// Meaning of the dimension.
    pub label: String,
    /// Elements along it.
    pub size: u32,
    /// Elements from one index of the dimension before it to the next.
    pub stride: u32,
}

/// Dimensions of a multi-array.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct MultiArrayLayout {
    /// Dimensions, outermost first.
    pub dim: Vec<MultiArrayDimension>,
    /// Index of the first value.
    pub data_offset: u32,
}

/// Array of floats, without a stamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Float32MultiArray {
    /// Dimensions.
    pub layout: MultiArrayLayout,
    /// The values.
    pub data: Vec<f32>,
}

/// Array of doubles, without a stamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Float64MultiArray {
    /// Dimensions.
    pub layout: MultiArrayLayout,
    /// The values.
    pub data: Vec<f64>,
}

impl WireType for Time {
    const TYPE_NAME: &'static str = "builtin_interfaces/msg/Time";
}

impl WireType for Duration {
    const TYPE_NAME: &'static str = "builtin_interfaces/msg/Duration";
}

/// `std_msgs/msg/String`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Text {
    /// The text.
    pub data: String,
}

impl WireType for Text {
    const TYPE_NAME: &'static str = "std_msgs/msg/String";
}

impl WireType for Header {
    const TYPE_NAME: &'static str = "std_msgs/msg/Header";
}

impl WireType for JointState {
    const TYPE_NAME: &'static str = "sensor_msgs/msg/JointState";
}

impl WireType for Point {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Point";
}

impl WireType for Quaternion {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Quaternion";
}

impl WireType for Pose {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Pose";
}

impl WireType for PoseArray {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/PoseArray";
}

impl WireType for Transform {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Transform";
}

impl WireType for TransformStamped {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/TransformStamped";
}

impl WireType for TFMessage {
    const TYPE_NAME: &'static str = "tf2_msgs/msg/TFMessage";
}

impl WireType for Vector3 {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Vector3";
}

impl WireType for Wrench {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Wrench";
}

impl WireType for WrenchStamped {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/WrenchStamped";
}

impl WireType for MultiArrayDimension {
    const TYPE_NAME: &'static str = "std_msgs/msg/MultiArrayDimension";
}

impl WireType for MultiArrayLayout {
    const TYPE_NAME: &'static str = "std_msgs/msg/MultiArrayLayout";
}

impl WireType for Float64MultiArray {
    const TYPE_NAME: &'static str = "std_msgs/msg/Float64MultiArray";
}

impl WireType for Float32MultiArray {
    const TYPE_NAME: &'static str = "std_msgs/msg/Float32MultiArray";
}
