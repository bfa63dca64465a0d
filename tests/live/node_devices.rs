//! Devices on the market, live: a node for each, with the file that ships, between publishers of the devices' own types.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::fs;
use std::path::Path;

use common::bags::messages;
use common::devices::{DEVICES, Device, outcomes};
use common::tpf::tpf;
use node_common::{Live, peer, write_definitions};

const ANY_REST: [&str; 2] = ["-p", "calibration.max_force:=1000.0"];
const ALIKE: [&str; 4] = ["--batch", "1", "--backend", "rten"];

fn start(folder: &Path, device: &Device) -> Live {
    device.write(folder);
    write_definitions(folder, "glove.mcap");
    let calibrate = ["calibrate", "glove.mcap", "--params-file", "device.yaml", "--calibrate-first", "2.5"];
    tpf(folder, &[&calibrate[..], &["-o", "zero.yaml"], &ANY_REST].concat()).ok();
    let run = ["--params-file", "device.yaml", "--calibration", "zero.yaml", "--record", "run.mcap"];
    let here = ["-p", "message_definitions:=definitions", "-p", "tactile_timeout_ms:=2000.0"];
    let namespace = format!("__ns:=/{}", device.name);
    Live::start(folder, &[&run[..], &here, &ANY_REST, &["--ros-args", "-r", &namespace]].concat())
}

/// Holds what a node recorded against a replay of the same data in our own types.
fn assert_forces_are_those_of_our_own_types(folder: &Path, device: &Device) -> usize {
    let live = outcomes(&folder.join("run.mcap"));
    let stamps: Vec<_> = live.iter().map(|outcome| outcome.stamp).collect();
    device.write_own(folder, "run.mcap", &stamps);
    let replay =
        ["replay", "own.mcap", "--params-file", "own.yaml", "--calibration", "zero.yaml", "-o", "own-out.mcap"];
    tpf(folder, &[&replay[..], &ANY_REST, &ALIKE].concat()).ok();
    let own = outcomes(&folder.join("own-out.mcap"));
    // The last frames, which replay settles because its input ends, still wait for joint angles in the node.
    assert!(
        live.len() <= own.len() && own.len() <= live.len() + 10,
        "{}: {} of {}",
        device.name,
        live.len(),
        own.len()
    );
    let differs = live.iter().zip(&own).find(|(one, other)| one != other);
    assert_eq!(differs, None, "{}", device.name);
    live.iter()
        .filter(|outcome| outcome.regions.iter().all(|(_, force, _)| f64::from_bits(force[0]).is_finite()))
        .count()
}

#[test]
fn ten_devices_in_their_own_types_give_the_forces_of_ours() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let of = |device: &Device| {
        let folder = folder.path().join(device.name);
        fs::create_dir(&folder).unwrap();
        folder
    };
    let nodes: Vec<_> = DEVICES.iter().map(|device| (device, of(device))).collect();
    let live: Vec<Live> = nodes.iter().map(|(device, folder)| start(folder, device)).collect();
    let names: Vec<&str> = DEVICES.iter().map(|device| device.name).collect();
    let sent: serde_json::Value = serde_json::from_str(&peer(&python, "devices.py", &names, folder.path())).unwrap();
    live.into_iter().for_each(|node| drop(node.stop()));
    for (device, folder) in &nodes {
        let received = messages(&folder.join("run.mcap"));
        for topic in received.iter().map(|message| &message.topic).collect::<std::collections::BTreeSet<_>>() {
            let Some(n_sent) = sent[topic.as_str()].as_u64() else { continue }; // of the node
            let n_received = received.iter().filter(|message| message.topic == *topic).count() as u64;
            assert!(n_sent >= 250 && 2 * n_received > n_sent, "{}: {n_received} of {n_sent}", device.name); // best effort
        }
        let n_forces = assert_forces_are_those_of_our_own_types(folder, device);
        assert!(n_forces > 50, "{}: {n_forces} frames have all forces", device.name);
    }
}
