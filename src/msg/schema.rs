//! The texts of the types that we write, as `ros2msg` schemas of a bag hold them.

use std::collections::BTreeSet;

use super::definition::{BaseType, MessageDefinition};

/// Canonical name and text of every type that has a struct here, ours and the standard ones.
const TEXTS: [(&str, &str); 20] = [
    ("builtin_interfaces/msg/Duration", include_str!("../../msg/standard/Duration.msg")),
    ("builtin_interfaces/msg/Time", include_str!("../../msg/standard/Time.msg")),
    ("geometry_msgs/msg/Vector3", include_str!("../../msg/standard/Vector3.msg")),
    ("geometry_msgs/msg/Wrench", include_str!("../../msg/standard/Wrench.msg")),
    ("geometry_msgs/msg/Point", include_str!("../../msg/standard/Point.msg")),
    ("geometry_msgs/msg/Pose", include_str!("../../msg/standard/Pose.msg")),
    ("geometry_msgs/msg/PoseArray", include_str!("../../msg/standard/PoseArray.msg")),
    ("geometry_msgs/msg/Quaternion", include_str!("../../msg/standard/Quaternion.msg")),
    ("geometry_msgs/msg/WrenchStamped", include_str!("../../msg/standard/WrenchStamped.msg")),
    ("sensor_msgs/msg/JointState", include_str!("../../msg/standard/JointState.msg")),
    ("service_msgs/msg/ServiceEventInfo", include_str!("../../msg/standard/ServiceEventInfo.msg")),
    ("std_msgs/msg/Float32MultiArray", include_str!("../../msg/standard/Float32MultiArray.msg")),
    ("std_msgs/msg/Header", include_str!("../../msg/standard/Header.msg")),
    ("std_msgs/msg/MultiArrayDimension", include_str!("../../msg/standard/MultiArrayDimension.msg")),
    ("std_msgs/msg/MultiArrayLayout", include_str!("../../msg/standard/MultiArrayLayout.msg")),
    ("std_msgs/msg/String", include_str!("../../msg/standard/String.msg")),
    ("tactile_pose_fusion/msg/ContactArray", include_str!("../../msg/ContactArray.msg")),
    ("tactile_pose_fusion/msg/ContactState", include_str!("../../msg/ContactState.msg")),
    ("tactile_pose_fusion/msg/Stage", include_str!("../../msg/Stage.msg")),
    ("tactile_pose_fusion/msg/TaxelArray", include_str!("../../msg/TaxelArray.msg")),
];

/// The `.msg` text of one of our types, or of a standard one that we use, by canonical name; dependencies left out.
pub fn standard_text(type_name: &str) -> Option<&'static str> {
    TEXTS.iter().find(|(name, _)| *name == type_name).map(|(_, text)| *text)
}

/// The whole schema of one of our types, or of a standard one that we use: its text, then that of each dependency
/// under a separator line, as rosbag2 writes it. `None` for any other type.
pub fn definition_text(type_name: &str) -> Option<String> {
    let type_name = super::canonical_type_name(type_name);
    let mut text = standard_text(&type_name)?.to_owned();
    append_dependencies(&type_name, &mut BTreeSet::from([type_name.clone()]), &mut text);
    Some(text)
}

fn append_dependencies(type_name: &str, written: &mut BTreeSet<String>, text: &mut String) {
    let own = standard_text(type_name).expect("a test resolves every type of the table from the table alone");
    let definition = MessageDefinition::parse(type_name, own).expect("a test parses every text of the table");
    let dependencies: BTreeSet<String> = definition
        .fields
        .into_iter()
        .filter_map(|field| match field.ty.base {
            BaseType::Message(name) => Some(name),
            _ => None,
        })
        .collect();
    for name in dependencies {
        if written.insert(name.clone()) {
            let short = name.replacen("/msg/", "/", 1);
            let own = standard_text(&name).expect("a test resolves every type of the table from the table alone");
            text.push_str(&format!("\n{}\nMSG: {short}\n{own}", "=".repeat(80)));
            append_dependencies(&name, written, text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::definition::TypeTree;

    #[test]
    fn every_text_of_the_table_resolves_from_the_table_alone() {
        for (type_name, _) in TEXTS {
            let text = definition_text(type_name).expect(type_name);
            TypeTree::from_schema(type_name, &text).expect(type_name);
        }
    }

    #[test]
    fn dependencies_stand_under_separators_in_the_order_of_rosbag2() {
        let text = definition_text("geometry_msgs/WrenchStamped").expect("it is in the table");
        let separator = "=".repeat(80);
        let expected = format!(
            "std_msgs/Header header\nWrench wrench\n\n{separator}\nMSG: geometry_msgs/Wrench\nVector3 force\nVector3 \
             torque\n\n{separator}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n\n{separator}\nMSG: \
             std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\n{separator}\nMSG: \
             builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        );
        assert_eq!(text, expected);
        assert_eq!(definition_text("sensor_msgs/msg/Imu"), None);
    }
}
