//! Definitions of the types that we write, as `ros2msg` schemas of bags.

use std::collections::BTreeSet;

use super::definition::{BaseType, MessageDefinition};
use super::texts::standard_text;

/// Schema of one of our types, or of a standard type that we use: its text, then the text of each dependency after a
/// separator line, as rosbag2 writes it. `None` for any other type.
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
    use super::super::texts::TEXTS;
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
