//! Every message of the recorded ROS 2 bags is read by the schema that its bag holds.

use crate::msg_common;

use std::collections::BTreeMap;

use msg_common::{mcap_files, shared};
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::dynamic::{FieldPlan, NumericPath, ReadAs, Value, numeric_paths, read_value};
use tactile_pose_fusion::msg::{CdrError, definition_text, type_hash};

/// Most bytes that may stand behind the last field: CDR pads a message to a multiple of 4.
const PADDING: usize = 3;

#[test]
fn every_recorded_message_is_read_by_its_schema() {
    let Some(shared) = shared() else { return };
    let (mut n_messages, mut n_hashes, mut n_compressed) = (0, 0, 0);
    for file in mcap_files(&shared.join("data")) {
        let bytes = std::fs::read(&file).expect("a bag can be read");
        let Ok(messages) = mcap::MessageStream::new_with_options(&bytes, mcap::read::Options::IgnoreEndMagic.into())
        else {
            continue; // not a whole bag: what the reader of bags is tested with
        };
        let mut types: BTreeMap<String, (TypeTree, Vec<FieldPlan>)> = BTreeMap::new();
        for message in messages {
            let Ok(message) = message else { break };
            let Some(schema) = &message.channel.schema else { continue };
            if message.channel.message_encoding != "cdr" || schema.encoding != "ros2msg" {
                continue;
            }
            let (tree, plans) = types.entry(schema.name.clone()).or_insert_with(|| {
                let text = std::str::from_utf8(&schema.data).expect("a schema is text");
                let tree = TypeTree::from_schema(&schema.name, text).expect("a recorded schema resolves");
                let plan = |NumericPath { path, .. }: &NumericPath| {
                    FieldPlan::compile(&tree, path, ReadAs::Numbers).expect("a path that was listed compiles")
                };
                let plans = numeric_paths(&tree).iter().map(plan).collect();
                (tree, plans)
            });
            if let Some(hash) = message.channel.metadata.get("topic_type_hash").filter(|hash| !hash.is_empty()) {
                assert_eq!(&type_hash(tree), hash, "{} in {}", schema.name, file.display());
                n_hashes += 1;
            }
            let (value, left) = match read_value(tree, &message.data) {
                Err(CdrError::Compressed) => {
                    n_compressed += 1;
                    continue;
                }
                read => read.expect("a recorded message is read"),
            };
            assert!(left <= PADDING, "{left} bytes behind a {} in {}", schema.name, file.display());
            for plan in plans {
                let mut numbers = vec![];
                match plan.read_f64(&message.data, &mut numbers) {
                    // A picture in colours, and one with fewer bytes than pixels.
                    Err(error) if error.to_string().contains("an image of ") => continue,
                    read => read.expect("a listed field is read"),
                };
                assert!(same(&numbers, &numbers_at(&value, plan.path())), "{} of {}", plan.path(), schema.name);
            }
            n_messages += 1;
        }
    }
    assert!(n_messages > 20_000, "only {n_messages} messages were read");
    assert_eq!(n_compressed, 2); // soccer_goal_12.mcap, whose two images are compressed one by one
    assert!(n_hashes > 5_000, "only {n_hashes} messages had a type hash");
}

#[test]
fn standard_texts_have_the_fields_that_recorded_schemas_have() {
    let Some(shared) = shared() else { return };
    let file = shared.join("data/mcap_rosbags_rs_alltypes/test_bags/test_bag_mcap/test_bag_mcap.mcap");
    let bytes = std::fs::read(file).expect("a bag can be read");
    let mut n_types = 0;
    for message in mcap::MessageStream::new(&bytes).expect("a bag") {
        let message = message.expect("a message");
        let Some(schema) = &message.channel.schema else { continue };
        let Some(ours) = definition_text(&schema.name) else { continue };
        let recorded = std::str::from_utf8(&schema.data).expect("a schema is text");
        let hash = |text: &str| type_hash(&TypeTree::from_schema(&schema.name, text).expect("it resolves"));
        assert_eq!(hash(&ours), hash(recorded), "{}", schema.name);
        n_types += 1;
    }
    assert!(n_types >= 8, "only {n_types} of the standard types were met");
}

/// The numbers at a path whose arrays of messages are written with `[]`, taken from the value tree.
fn numbers_at(value: &Value<'_>, path: &str) -> Vec<f64> {
    let mut numbers = vec![];
    let (name, rest) = path.split_once('.').map_or((path, None), |(name, rest)| (name, Some(rest)));
    let found = value.field(name.trim_end_matches("[]")).expect("a listed field is in the value");
    match (found, rest) {
        (Value::Array(elements), Some(rest)) => {
            elements.iter().for_each(|element| numbers.extend(numbers_at(element, rest)))
        }
        (Value::Array(elements), None) => numbers.extend(elements.iter().map(number)),
        (found, Some(rest)) => numbers.extend(numbers_at(found, rest)),
        (found, None) => numbers.push(number(found)),
    }
    numbers
}

fn number(value: &Value<'_>) -> f64 {
    match value {
        Value::Bool(value) => f64::from(u8::from(*value)),
        Value::Int(value) => *value as f64,
        Value::Unsigned(value) => *value as f64,
        Value::Float(value) => *value,
        other => panic!("{other:?} is no number"),
    }
}

/// Equal bit for bit, so that NaN equals NaN.
fn same(a: &[f64], b: &[f64]) -> bool {
    a.iter().map(|number| number.to_bits()).eq(b.iter().map(|number| number.to_bits()))
}
