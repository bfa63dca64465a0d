//! Type hashes are the ones that ROS 2 itself records.

use crate::msg_common;

use msg_common::shared;
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::{rihs01, type_hash};

/// From rosbags 0.11 (Python), an implementation of its own: `Typestore.hash_rihs01`, standard types of its Jazzy store.
const REFERENCE: [(&str, &str); 10] = [
    ("tactile_pose_fusion/msg/TaxelArray", "RIHS01_ea56f5660e2bd9068eaff07fc47b85a53b3ca3ed6b749c9a71e29462d25bf950"),
    ("tactile_pose_fusion/msg/ContactState", "RIHS01_2e88ecc5549fef58d29768c782741f66da422eebdc6fb4ea110745b602e98224"),
    ("tactile_pose_fusion/msg/ContactArray", "RIHS01_b11eda3711b37aa6ffac6ebc9dab801f8d5f61ae19383f9330b019e0e4f7bb97"),
    ("tactile_pose_fusion/msg/Stage", "RIHS01_9c652bb38bd91fcc0c8d22d8b4523dc819f5136d49e391d6ac08fa3adfc9f984"),
    ("geometry_msgs/msg/WrenchStamped", "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"),
    ("geometry_msgs/msg/PoseArray", "RIHS01_af0cc36d190e104d546d168d6b39df04fa4b4ccecf59cb4c9ed328d3d5004aa0"),
    ("sensor_msgs/msg/JointState", "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"),
    ("std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
    ("std_msgs/msg/Float32MultiArray", "RIHS01_0599f6f85b4bfca379873a0b4375a0aca022156bd2d7021275d116ed1fa8bfe0"),
    ("std_msgs/msg/Header", "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"),
];

#[test]
fn hashes_of_the_types_we_write_equal_those_of_another_implementation() {
    for (type_name, expected) in REFERENCE {
        assert_eq!(rihs01(type_name).as_deref(), Some(expected), "{type_name}");
    }
    assert_eq!(rihs01("sensor_msgs/msg/Imu"), None);
}

#[test]
fn hashes_equal_those_that_ros_recorded_into_bags() {
    let Some(shared) = shared() else { return };
    let text = std::fs::read_to_string(shared.join("data/rihs01_from_recorded_bags.json")).expect("the file is there");
    let recorded: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
    let recorded = recorded.as_object().expect("it is an object");
    assert_eq!(recorded.len(), 11);
    for (type_name, entry) in recorded {
        let schema = entry["schema_text"].as_str().expect("a text");
        let tree = TypeTree::from_schema(type_name, schema).expect(type_name);
        assert_eq!(Some(type_hash(&tree).as_str()), entry["rihs01"].as_str(), "{type_name}");
    }
}

#[test]
fn comments_defaults_and_constants_do_not_reach_the_hash() {
    let hash = |text: &str| type_hash(&TypeTree::from_schema("p/msg/T", text).expect("it resolves"));
    assert_eq!(hash("float64 w 1 # scalar\nint8 X=3\n"), hash("float64 w\n"));
    assert_ne!(hash("float64 w\n"), hash("float64 v\n"));
    assert_ne!(hash("string<=5 s\n"), hash("string<=6 s\n"));
    assert_ne!(hash("uint8[3] a\n"), hash("uint8[<=3] a\n"));
}
