//! What we write, read by programs that know nothing of us: `mcap`, `mcap-ros2-support` and `rosbags` from PyPI.

use crate::common;

use std::collections::BTreeMap;
use std::process::Command;

use common::ROOT;
use common::bags::{messages, write_session};
use common::onnx::LinearModel;
use common::tpf::tpf;
use serde_json::{Value, json};
use tactile_pose_fusion::msg::*;

fn bits(value: f64) -> Value {
    json!(format!("{:016x}", value.to_bits()))
}

fn header(header: &Header) -> Value {
    json!({"stamp": {"sec": header.stamp.sec, "nanosec": header.stamp.nanosec}, "frame_id": header.frame_id})
}

fn vector(v: &Vector3) -> Value {
    json!({"x": bits(v.x), "y": bits(v.y), "z": bits(v.z)})
}

fn contact(c: &ContactState) -> Value {
    json!({
        "region": c.region, "frame_id": c.frame_id, "contact_raw": c.contact_raw, "contact": c.contact,
        "event": c.event, "since": {"sec": c.since.sec, "nanosec": c.since.nanosec}, "force": bits(c.force),
        "force_base": bits(c.force_base), "artifact": bits(c.artifact), "on_threshold": bits(c.on_threshold),
        "off_threshold": bits(c.off_threshold), "mdf": bits(c.mdf), "pose_age": bits(c.pose_age), "age": bits(c.age),
        "flags": c.flags, "adaptation": c.adaptation, "artifact_change": bits(c.artifact_change), "touch": bits(c.touch),
        "touch_on": bits(c.touch_on), "touch_off": bits(c.touch_off)
    })
}

/// What we hold of a message, in the words of the script.
fn told(type_name: &str, data: &[u8]) -> Value {
    match type_name {
        ContactArray::TYPE_NAME => {
            let array: ContactArray = from_cdr(data).unwrap();
            json!({"header": header(&array.header), "contacts": array.contacts.iter().map(contact).collect::<Vec<_>>()})
        }
        WrenchStamped::TYPE_NAME => {
            let stamped: WrenchStamped = from_cdr(data).unwrap();
            let wrench = json!({"force": vector(&stamped.wrench.force), "torque": vector(&stamped.wrench.torque)});
            json!({"header": header(&stamped.header), "wrench": wrench})
        }
        TaxelArray::TYPE_NAME => {
            let array: TaxelArray = from_cdr(data).unwrap();
            let values: Vec<Value> = array.values.iter().map(|&value| bits(f64::from(value))).collect();
            let period = json!({"sec": array.row_period.sec, "nanosec": array.row_period.nanosec});
            json!({"header": header(&array.header), "sequence": array.sequence, "rows": array.rows, "row_period": period, "values": values})
        }
        JointState::TYPE_NAME => {
            let state: JointState = from_cdr(data).unwrap();
            let list = |values: &[f64]| values.iter().map(|&value| bits(value)).collect::<Vec<_>>();
            json!({"header": header(&state.header), "name": state.name, "position": list(&state.position),
                "velocity": list(&state.velocity), "effort": list(&state.effort)})
        }
        other => panic!("{other}"),
    }
}

/// `rosbags` adds the type's name to its message classes; the rest must be equal.
fn without_class_names(value: &mut Value) {
    match value {
        Value::Object(fields) => {
            fields.remove("__msgtype__");
            fields.values_mut().for_each(without_class_names);
        }
        Value::Array(items) => items.iter_mut().for_each(without_class_names),
        _ => {}
    }
}

#[test]
fn independent_readers_decode_every_message_to_what_we_hold() {
    let Some(python) = common::python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(&folder.join("session.mcap"), 6);
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    common::tpf::write_params(folder, 2, &["dip"], "");
    let args = ["replay", "session.mcap", "--params-file", "params.yaml", "--calibrate-first", "3.13", "--merge"];
    tpf(folder, &[&args[..], &["-o", "out"]].concat()).ok();
    let file = folder.join("out/out_0.mcap");
    let script = &format!("{ROOT}/tests/python/read_bag.py");
    let output = Command::new(python).arg(script).arg(folder.join("out")).arg(&file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    let mut seen: BTreeMap<String, BTreeMap<String, Vec<(i64, Value)>>> = BTreeMap::new();
    let mut digests = BTreeMap::new();
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        let reader = line[0].as_str().unwrap().to_owned();
        if reader == "digests" {
            digests = serde_json::from_value::<BTreeMap<String, String>>(line[1].clone()).unwrap();
            continue;
        }
        let mut fields = line[3].clone();
        without_class_names(&mut fields);
        let topic = line[1].as_str().unwrap().to_owned();
        seen.entry(reader).or_default().entry(topic).or_default().push((line[2].as_i64().unwrap(), fields));
    }
    let mut held: BTreeMap<String, Vec<(i64, Value)>> = BTreeMap::new();
    for message in messages(&file) {
        let fields = told(&message.type_name, &message.data);
        held.entry(message.topic).or_default().push((message.log_time.0, fields));
    }
    assert_eq!(held.len(), 4);
    for reader in ["mcap_ros2", "rosbags"] {
        for (topic, expected) in &held {
            let mut got = seen[reader][topic].clone();
            let mut expected = expected.clone();
            // Readers sort by log time, and messages of one instant may change places: compare them as a set.
            let key = |message: &(i64, Value)| (message.0, message.1.to_string());
            got.sort_by_key(key);
            expected.sort_by_key(key);
            assert_eq!(got.len(), expected.len(), "{reader}, {topic}");
            for (got, expected) in got.iter().zip(&expected) {
                assert_eq!(got, expected, "{reader}, {topic}");
            }
        }
    }
    for (topic, type_name) in [
        ("/tactile_pose_fusion/contacts", ContactArray::TYPE_NAME),
        ("/tactile_pose_fusion/index/wrench", WrenchStamped::TYPE_NAME),
    ] {
        assert_eq!(digests[topic], rihs01(type_name).unwrap(), "type hash in metadata.yaml of {topic}");
    }
}
