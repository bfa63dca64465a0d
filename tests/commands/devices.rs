//! The parameter files of devices on the market: each replays a bag that is laid out as the device's messages are defined, and
//! gives the forces of the same data in this package's own types.

use crate::common;

use std::path::Path;

use common::bags::{Bag, decoded};
use common::devices::{self, N, device, inspire_angle, isaac_angles, outcomes};
use common::layouts::degrees;
use common::onnx::LinearModel;
use common::tpf::{Run, tpf};
use tactile_pose_fusion::config::{self, DEFAULT_NODE};
use tactile_pose_fusion::msg::*;

/// Any rest counts as one: the models only add up what they are given.
const REPLAY: [&str; 8] =
    ["--calibrate-first", "2.5", "-p", "calibration.max_force:=1000.0", "--batch", "1", "--backend", "rten"];

fn replay(folder: &Path, bag: &str, params: &str, out: &str) -> Run {
    tpf(folder, &[&["replay", bag, "--params-file", params, "-o", out], &REPLAY[..]].concat()).ok()
}

/// Replays a bag of the device with its file: the forces of its regions in the last message, N, which every frame shares with
/// a replay of the same data in our own types.
fn forces(name: &str) -> Vec<f64> {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let device = device(name);
    device.write(folder);
    let run = replay(folder, "glove.mcap", "device.yaml", "out.mcap");
    assert!(!run.stdout.contains("lost by the sender"), "{name}: {run:?}");
    let of_device = outcomes(&folder.join("out.mcap"));
    assert_eq!(of_device.len() as i64, N, "{name}");
    let stamps: Vec<_> = of_device.iter().map(|outcome| outcome.stamp).collect();
    device.write_own(folder, "glove.mcap", &stamps);
    replay(folder, "own.mcap", "own.yaml", "again.mcap");
    let of_own = outcomes(&folder.join("again.mcap"));
    let differs = of_device.iter().zip(&of_own).find(|(one, other)| one != other);
    assert_eq!((of_device.len(), differs), (of_own.len(), None), "{name}");
    let contacts: Vec<ContactArray> = decoded(&folder.join("out.mcap"), "/tactile_pose_fusion/contacts");
    contacts.last().unwrap().contacts.iter().map(|contact| contact.force).collect()
}

/// What a region of these taxels must read at the end: 2 of a swing and 5 of a load above its zero, less its joints.
fn assert_forces(device: &str, forces: &[f64], n_taxels: usize, joints: &[Vec<f32>]) {
    assert_eq!(forces.len(), joints.len(), "{device}");
    for (region, (force, joints)) in forces.iter().zip(joints).enumerate() {
        let model = LinearModel::new(8, n_taxels, joints.len());
        let expected = f64::from(model.expected(&vec![7.0; n_taxels], joints).0);
        // Sums in another order, and degrees turned in f64 there and in f32 here.
        assert!((force - expected).abs() < 1e-3, "{device}, region {region}: {force} is not {expected}");
    }
}

fn assert_taxels_only(device: &str, n_regions: usize, n_taxels: usize) {
    assert_forces(device, &forces(device), n_taxels, &vec![vec![]; n_regions]);
}

#[test]
fn contactile_papillarray() {
    assert_taxels_only("contactile_papillarray", 1, 27);
}

#[test]
fn xela_uskin() {
    assert_taxels_only("xela_uskin", 1, 48);
}

#[test]
fn paxini_s1813() {
    assert_taxels_only("paxini_s1813", 1, 93);
}

#[test]
fn robotis_hx5() {
    assert_taxels_only("robotis_hx5", 5, 9);
}

#[test]
fn wuji_glove() {
    assert_taxels_only("wuji_glove", 1, 6);
}

/// Angle of joint `joint` in the last message, rad.
fn last(joint: usize) -> f32 {
    degrees(joint, N - 1).to_radians()
}

#[test]
fn psyonic_ability_hand() {
    let joints: Vec<Vec<f32>> = (0..5).map(|finger| vec![last(2 * finger), last(2 * finger + 1)]).collect();
    assert_forces("psyonic", &forces("psyonic_ability_hand"), 6, &joints);
}

#[test]
fn unitree_dex3() {
    let joints = [[1, 2], [1, 2], [3, 4], [3, 4], [5, 6], [5, 6], [5, 6], [3, 4], [3, 4]];
    let joints: Vec<Vec<f32>> = joints.iter().map(|pair| pair.map(last).to_vec()).collect();
    assert_forces("dex3", &forces("unitree_dex3"), 12, &joints);
}

#[test]
fn manus_gloves() {
    assert_forces("manus", &forces("manus_gloves"), 6, &[[3, 2, 1, 0].map(last).to_vec()]);
}

#[test]
fn inspire_rh56dftp() {
    let forces = forces("inspire_rh56dftp");
    let at_end = |joint| (-0.156 * f32::from(inspire_angle(joint, N - 1))).to_radians();
    (0..4).for_each(|idx| assert_forces("inspire", &forces[idx..=idx], 185, &[vec![at_end(idx)]]));
    assert_forces("inspire", &forces[4..5], 210, &[vec![at_end(4), at_end(5)]]);
    assert_forces("inspire", &forces[5..], 112, &[vec![]]);
}

#[test]
fn isaac_teleop() {
    let joints = isaac_angles(N - 1)[..4].iter().map(|angle| *angle as f32).collect();
    assert_forces("isaac", &forces("isaac_teleop"), 6, &[joints]);
}

/// A replay of a Wuji glove's frames with its file.
fn replay_wuji(hands: &[u8], device_ms: impl Fn(i64) -> i64) -> Run {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    device("wuji_glove").write(folder);
    let mut bag = Bag::create(&folder.join("hands.mcap"));
    devices::tactile_frames(&mut bag, hands, device_ms);
    bag.finish();
    tpf(
        folder,
        &[&["replay", "hands.mcap", "--params-file", "device.yaml", "-o", "out.mcap", "--json"], &REPLAY[..]].concat(),
    )
}

#[test]
fn messages_of_the_other_hand_are_counted_and_a_glove_that_sends_no_others_is_refused() {
    let both = replay_wuji(&[1, 0], |k| 10 * k).ok();
    let topic = &both.json()["topics"]["/tactile/raw"];
    assert_eq!((&topic["read"], &topic["not_for_source"]), (&N.into(), &N.into()), "{both:?}");
    assert!(!both.stderr.contains("could not be read"), "{both:?}");
    let other = replay_wuji(&[0], |k| 10 * k);
    let told = "topic /tactile/raw: none of its ";
    assert!(other.failure().contains(told), "{other:?}");
    assert!(other.failure().contains("is not for this source: only hand=1 is, and it has 0"), "{other:?}");
}

#[test]
fn a_device_that_starts_anew_is_said_and_counted_and_goes_on() {
    let run = replay_wuji(&[1], |k| if k < 500 { 90_000 + 10 * k } else { 10 * (k - 500) }).ok();
    assert_eq!(run.json()["topics"]["/tactile/raw"]["clock_restarts"], 1, "{run:?}");
    assert_eq!(run.json()["tactile"][0]["frames"], N, "{run:?}");
    assert!(run.stderr.contains("/tactile/raw: the device's clock was set or started anew 1 times"), "{run:?}");
}

/// What `tpf init` makes of a device's bag: taxels of each source, taxels of each region, and joint angles of each.
fn made_of(device: &str) -> (Vec<usize>, Vec<usize>, Vec<usize>) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("glove.mcap"));
    (devices::device(device).record)(&mut bag);
    bag.finish();
    tpf(folder, &["init", "glove.mcap", "-o", "made.yaml", "--yes"]).ok();
    let text = std::fs::read_to_string(folder.join("made.yaml")).unwrap();
    let cfg = config::load(&folder.join("made.yaml"), DEFAULT_NODE).unwrap_or_else(|error| panic!("{error}\n{text}"));
    for region in cfg.fusion().regions() {
        let path = &cfg.models()[region.model.position()].spec.path;
        // Nobody tells the scale of angles that are counts: they must weigh little.
        let model = LinearModel::new(8, region.taxels.len(), region.joints.len()).gains(1.0, 0.001);
        let model = model.metadata("unit", "N");
        std::fs::write(path, model.bytes()).unwrap();
    }
    replay(folder, "glove.mcap", "made.yaml", "out.mcap");
    let outcomes = outcomes(&folder.join("out.mcap"));
    assert_eq!(outcomes.len() as i64, N, "{device}: {text}");
    let last = outcomes.last().unwrap();
    assert!(
        last.regions.iter().all(|(_, force, _)| f64::from_bits(force[0]).is_finite()),
        "{device}: {last:?}\n{text}"
    );
    // Of a press of 5 above a swing of 2 each taxel tells 7: as the file that ships reads them.
    for (region, (name, [_, base], _)) in cfg.fusion().regions().iter().zip(&last.regions) {
        let expected = 7.0 * region.taxels.len() as f64;
        let base = f64::from_bits(*base);
        assert!((base - expected).abs() < 1e-3 || device == "xela_uskin", "{device} {name}: {base}\n{text}");
    }
    let regions = cfg.fusion().regions();
    (
        cfg.fusion().tactile_sources().iter().map(|source| source.n_taxels).collect(),
        regions.iter().map(|region| region.taxels.len()).collect(),
        regions.iter().map(|region| region.joints.len()).collect(),
    )
}

#[test]
fn init_leads_from_each_devices_bag_to_its_axes_its_elements_its_fingers_and_one_of_its_hands() {
    let none = |n: usize| vec![0; n];
    for (device, sources, regions, joints) in [
        ("contactile_papillarray", vec![27], vec![27], none(1)),
        ("xela_uskin", vec![48, 48], vec![48, 48], none(2)), // a source for each patch
        ("paxini_s1813", vec![93], vec![93], none(1)),
        ("robotis_hx5", vec![9; 5], vec![9; 5], none(5)),
        ("wuji_glove", vec![768], vec![6], none(1)),
        ("psyonic_ability_hand", vec![30], vec![6; 5], vec![2; 5]),
        ("unitree_dex3", vec![108], vec![12; 9], vec![7; 9]), // nobody names its joints
        ("manus_gloves", vec![6], vec![6], vec![4]),
        ("isaac_teleop", vec![6], vec![6], vec![4]),
    ] {
        assert_eq!(made_of(device), (sources, regions, joints), "{device}");
    }
    let (mut sources, mut regions, _) = made_of("inspire_rh56dftp");
    sources.sort();
    regions.sort();
    assert_eq!((&sources, sources.clone()), (&vec![112, 185, 185, 185, 185, 210], regions));
}
