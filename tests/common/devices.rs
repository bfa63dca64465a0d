//! Devices on the market: their messages as their drivers define them, and the same data in this package's own types.
#![allow(dead_code, unreachable_pub)]

macro_rules! named {
    ($($ty:ident: $name:literal),* $(,)?) => {
        $(impl WireType for $ty {
            const TYPE_NAME: &'static str = $name;
        })*
    };
}

mod hands;
mod skins;

use std::path::{Path, PathBuf};

use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, NewChannel, OutChannel};
use tactile_pose_fusion::msg::*;
use tactile_pose_fusion::units::Stamp;

use super::bags::{Bag, Recorded, at, messages, stamp_of};
use super::onnx::LinearModel;
use super::root::ROOT;

pub use hands::{inspire_angle, isaac_angles};
pub use skins::tactile_frames;

/// Messages of each topic of a device.
pub const N: i64 = 600;

/// A device that params/devices has a file for.
pub struct Device {
    /// Name of that file.
    pub name: &'static str,
    /// Writes its topics.
    pub record: fn(&mut Bag),
    /// What a message of its own types holds.
    pub own: fn(&Recorded) -> Vec<Own>,
    /// Its tactile sources with their taxels.
    pub tactile: &'static [(&'static str, usize)],
    /// Its source of joint angles.
    pub joint: Option<&'static str>,
    /// The models that its file names: taxels and joints.
    pub models: &'static [(&'static str, usize, usize)],
}

/// A part of a message in this package's own types.
pub struct Own {
    pub source: &'static str,
    pub when: When,
    pub data: Data,
}

/// When it was.
pub enum When {
    At(Stamp),
    /// When the message was received.
    Receipt,
    /// When the frame was that the device's clock was mapped to.
    Frame,
}

pub enum Data {
    Taxels(Vec<f32>),
    Joints(Vec<String>, Vec<f64>),
}

/// All of them.
pub const DEVICES: [Device; 10] = [
    skins::PAPILLARRAY,
    skins::USKIN,
    skins::PAXINI,
    skins::HX5,
    skins::WUJI,
    hands::PSYONIC,
    hands::DEX3,
    hands::MANUS,
    hands::INSPIRE,
    hands::ISAAC,
];

/// The device with a file of this name.
pub fn device(name: &str) -> &'static Device {
    static ALL: [Device; 10] = DEVICES;
    ALL.iter().find(|device| device.name == name).unwrap()
}

impl Device {
    /// Leaves in a folder: a bag, the device's file and its models.
    pub fn write(&self, folder: &Path) {
        let mut bag = Bag::create(&folder.join("glove.mcap"));
        (self.record)(&mut bag);
        bag.finish();
        std::fs::write(folder.join("device.yaml"), self.params()).unwrap();
        for (name, n_taxels, n_joints) in self.models {
            let model = LinearModel::new(8, *n_taxels, *n_joints).metadata("unit", "N");
            model.write(folder, &format!("{name}.onnx"));
        }
    }

    /// The file that ships, with models that the same runtime runs everywhere.
    pub fn params(&self) -> String {
        let path = PathBuf::from(ROOT).join(format!("params/devices/{}.yaml", self.name));
        std::fs::read_to_string(path).unwrap().replace(".onnx}", ".onnx, backend: rten}")
    }

    /// Leaves `own.mcap` and `own.yaml` in a folder: the data of a bag of this device in this package's own types.
    ///
    /// `frames`: the stamps of the frames that came of the bag, for a device that stamps by its own clock.
    pub fn write_own(&self, folder: &Path, bag: &str, frames: &[Stamp]) {
        let mut out = Bag::create(&folder.join("own.mcap"));
        let (mut sequence, mut frames) = (0, frames.iter());
        for message in messages(&folder.join(bag)).iter().filter(|one| !one.topic.contains("tactile_pose_fusion")) {
            let own = match message.type_name.as_str() {
                // A tactile glove beside a device that tells the hand.
                TaxelArray::TYPE_NAME => vec![taxels(
                    "glove",
                    when::<TaxelArray>(message, |it| &it.header),
                    read::<TaxelArray>(message).values,
                )],
                _ => (self.own)(message),
            };
            for Own { source, when, data } in own {
                let stamp = match when {
                    When::At(stamp) => Some(stamp),
                    When::Receipt => Some(message.log_time),
                    When::Frame => frames.next().copied(),
                };
                let Some(stamp) = stamp else { continue };
                let header = Header { stamp: stamp.into(), frame_id: String::new() };
                let topic = format!("/own/{source}");
                match data {
                    Data::Taxels(values) => {
                        let row_period = Duration::default();
                        out.send(
                            &topic,
                            message.log_time,
                            &TaxelArray { header, sequence, rows: 1, row_period, values },
                        );
                        sequence += 1;
                    }
                    Data::Joints(name, position) => {
                        let state = JointState { header, name, position, velocity: vec![], effort: vec![] };
                        out.send(&topic, message.log_time, &state);
                    }
                }
            }
        }
        out.finish();
        std::fs::write(folder.join("own.yaml"), self.own_params()).unwrap();
    }

    /// The device's file with its sources in place of topics in our own types.
    fn own_params(&self) -> String {
        let params = self.params();
        let (before, rest) = params.split_once("    tactile:\n").unwrap();
        let (_, after) = rest.split_once("    model:").unwrap();
        let mut own = "    tactile:\n".to_owned();
        for (source, n_taxels) in self.tactile {
            own += &format!("      {source}: {{topic: /own/{source}, n_taxels: {n_taxels}}}\n");
        }
        if let Some(source) = self.joint {
            own += &format!("    joint:\n      {source}: {{topic: /own/{source}}}\n");
        }
        format!("{before}{own}    model:{after}")
    }
}

/// What came of a frame, to be held against another.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    pub stamp: Stamp,
    /// Region, force and base as bits, contact.
    pub regions: Vec<(String, [u64; 2], bool)>,
}

/// The estimates that a bag holds on the topic with contacts, without those of silence.
pub fn outcomes(bag: &Path) -> Vec<Outcome> {
    let is_it = |message: &Recorded| message.topic.ends_with("/tactile_pose_fusion/contacts");
    let arrays =
        messages(bag).into_iter().filter(is_it).map(|message| from_cdr::<ContactArray>(&message.data).unwrap());
    let is_frame = |array: &ContactArray| array.contacts.iter().any(|one| one.flags & ContactState::STALE_TACTILE == 0);
    let bits = |value: f64| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
    let of = |array: ContactArray| Outcome {
        stamp: stamp_of(&array.header),
        regions: array
            .contacts
            .iter()
            .map(|one| (one.region.clone(), [bits(one.force), bits(one.force_base)], one.contact))
            .collect(),
    };
    arrays.filter(is_frame).map(of).collect()
}

const RULE: &str = "================================================================================";

/// A topic of a type that isn't ours: its definition, and those of the types in it.
fn add<T: WireType>(bag: &mut Bag, topic: &str, definition: &str, parts: &[(&str, &str)]) -> OutChannel {
    let part = |(name, text): &(&str, &str)| format!("\n{RULE}\nMSG: {name}\n{text}");
    let schema = format!("{definition}{}", parts.iter().map(part).collect::<String>());
    let channel =
        NewChannel { topic, type_name: T::TYPE_NAME, schema_text: &schema, qos_yaml: BEST_EFFORT_QOS, type_hash: "" };
    bag.writer.add_channel(channel).unwrap()
}

fn send<T: WireType>(bag: &mut Bag, channel: OutChannel, ms: i64, message: &T) {
    bag.writer.write(channel, 0, at(ms), at(ms), &to_cdr(message)).unwrap();
}

fn header(ms: i64) -> Header {
    Header { stamp: at(ms).into(), frame_id: String::new() }
}

fn header_parts() -> [(&'static str, &'static str); 2] {
    [
        ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
        ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    ]
}

fn read<T: WireType>(message: &Recorded) -> T {
    assert_eq!(message.type_name, T::TYPE_NAME);
    from_cdr(&message.data).unwrap()
}

fn when<T: WireType>(message: &Recorded, header: impl Fn(&T) -> &Header) -> When {
    When::At(stamp_of(header(&read::<T>(message))))
}

fn taxels(source: &'static str, when: When, values: Vec<f32>) -> Own {
    Own { source, when, data: Data::Taxels(values) }
}

fn joints(source: &'static str, when: When, names: Vec<String>, angles: Vec<f64>) -> Own {
    Own { source, when, data: Data::Joints(names, angles) }
}
