//! `.msg` texts of the types that need no installed package.

/// Canonical name and text of every type that has a struct here, ours and the standard ones.
pub(super) const TEXTS: [(&str, &str); 31] = [
    ("builtin_interfaces/msg/Duration", include_str!("../../msg/standard/Duration.msg")),
    ("builtin_interfaces/msg/Time", include_str!("../../msg/standard/Time.msg")),
    ("geometry_msgs/msg/Vector3", include_str!("../../msg/standard/Vector3.msg")),
    ("geometry_msgs/msg/Wrench", include_str!("../../msg/standard/Wrench.msg")),
    ("geometry_msgs/msg/Point", include_str!("../../msg/standard/Point.msg")),
    ("geometry_msgs/msg/Pose", include_str!("../../msg/standard/Pose.msg")),
    ("geometry_msgs/msg/PoseArray", include_str!("../../msg/standard/PoseArray.msg")),
    ("geometry_msgs/msg/Quaternion", include_str!("../../msg/standard/Quaternion.msg")),
    ("geometry_msgs/msg/Transform", include_str!("../../msg/standard/Transform.msg")),
    ("geometry_msgs/msg/TransformStamped", include_str!("../../msg/standard/TransformStamped.msg")),
    ("geometry_msgs/msg/WrenchStamped", include_str!("../../msg/standard/WrenchStamped.msg")),
    ("sensor_msgs/msg/CompressedImage", include_str!("../../msg/standard/CompressedImage.msg")),
    ("sensor_msgs/msg/Image", include_str!("../../msg/standard/Image.msg")),
    ("sensor_msgs/msg/JointState", include_str!("../../msg/standard/JointState.msg")),
    ("service_msgs/msg/ServiceEventInfo", include_str!("../../msg/standard/ServiceEventInfo.msg")),
    ("std_msgs/msg/ColorRGBA", include_str!("../../msg/standard/ColorRGBA.msg")),
    ("std_msgs/msg/Float32MultiArray", include_str!("../../msg/standard/Float32MultiArray.msg")),
    ("std_msgs/msg/Float64MultiArray", include_str!("../../msg/standard/Float64MultiArray.msg")),
    ("std_msgs/msg/Header", include_str!("../../msg/standard/Header.msg")),
    ("std_msgs/msg/MultiArrayDimension", include_str!("../../msg/standard/MultiArrayDimension.msg")),
    ("std_msgs/msg/MultiArrayLayout", include_str!("../../msg/standard/MultiArrayLayout.msg")),
    ("std_msgs/msg/String", include_str!("../../msg/standard/String.msg")),
    ("tactile_pose_fusion/msg/ContactArray", include_str!("../../msg/ContactArray.msg")),
    ("tactile_pose_fusion/msg/ContactState", include_str!("../../msg/ContactState.msg")),
    ("tactile_pose_fusion/msg/Stage", include_str!("../../msg/Stage.msg")),
    ("tactile_pose_fusion/msg/TaxelArray", include_str!("../../msg/TaxelArray.msg")),
    ("tf2_msgs/msg/TFMessage", include_str!("../../msg/standard/TFMessage.msg")),
    ("visualization_msgs/msg/Marker", include_str!("../../msg/standard/Marker.msg")),
    ("visualization_msgs/msg/MarkerArray", include_str!("../../msg/standard/MarkerArray.msg")),
    ("visualization_msgs/msg/MeshFile", include_str!("../../msg/standard/MeshFile.msg")),
    ("visualization_msgs/msg/UVCoordinate", include_str!("../../msg/standard/UVCoordinate.msg")),
];

/// `.msg` text of one of our types or of a standard type that we use, by canonical name, without dependencies.
pub fn standard_text(type_name: &str) -> Option<&'static str> {
    TEXTS.iter().find(|(name, _)| *name == type_name).map(|(_, text)| *text)
}
