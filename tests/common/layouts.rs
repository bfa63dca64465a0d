//! Messages of sensors and gloves on the market, laid out as their drivers define them.
#![allow(dead_code, unreachable_pub, non_snake_case)]

use serde::{Deserialize, Serialize};
use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, NewChannel, OutChannel};
use tactile_pose_fusion::msg::{Header, WireType, definition_text, to_cdr};
use tactile_pose_fusion::units::Stamp;

use super::bags::Bag;

const RULE: &str = "================================================================================";

/// XELA uSkin.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SensStream {
    pub header: Header,
    pub sensors: Vec<SensorFull>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SensorFull {
    pub message: u32,
    pub time: f64,
    pub model: String,
    pub sensor_pos: u8,
    pub taxels: Vec<Taxel>,
    pub forces: Vec<Forces>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Taxel {
    pub x: u16,
    pub y: u16,
    pub z: u16,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Forces {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

/// Contactile PapillArray.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SensorState {
    pub header: Header,
    pub tus: i64,
    pub pillars: Vec<PillarState>,
    pub gfX: f32,
    pub gfY: f32,
    pub gfZ: f32,
    pub is_contact: bool,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct PillarState {
    pub id: i32,
    pub in_contact: bool,
    pub dX: f32,
    pub dY: f32,
    pub dZ: f32,
    pub fX: f32,
    pub fY: f32,
    pub fZ: f32,
}

/// A Manus glove, which has no header.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ManusGlove {
    pub glove_id: i32,
    pub side: String,
    pub raw_node_count: i32,
    pub raw_nodes: Vec<ManusRawNode>,
    pub ergonomics_count: i32,
    pub ergonomics: Vec<ManusErgonomics>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ManusRawNode {
    pub node_id: i32,
    pub parent_node_id: i32,
    pub joint_type: String,
    pub chain_type: String,
    pub position: Forces,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ManusErgonomics {
    pub r#type: String,
    pub value: f32,
}

/// A hand whose taxels, angles and load cell come in one message without a header.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct HandState {
    pub motor_state: Vec<MotorState>,
    pub press_sensor_state: Vec<PressSensorState>,
    pub load: f32,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct MotorState {
    pub mode: u8,
    pub q: f32,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PressSensorState {
    pub pressure: [f32; 3],
    pub lost: u32,
}

macro_rules! named {
    ($($ty:ident: $name:literal),*) => {
        $(impl WireType for $ty {
            const TYPE_NAME: &'static str = $name;
        })*
    };
}

named!(
    SensStream: "xela_server_ros2/msg/SensStream",
    SensorState: "papillarray_ros2_v2/msg/SensorState",
    ManusGlove: "manus_ros2_msgs/msg/ManusGlove",
    HandState: "acme/msg/HandState"
);

/// The schema of a type of this file.
fn schema(type_name: &str) -> String {
    let header = || format!("\n{RULE}\nMSG: std_msgs/Header\n{}", definition_text("std_msgs/msg/Header").unwrap());
    match type_name {
        SensStream::TYPE_NAME => format!(
            "std_msgs/Header header\nSensorFull[] sensors\n{RULE}\nMSG: xela_server_ros2/SensorFull\nuint32 message\nfloat64 time\nstring model\nuint8 sensor_pos\nTaxel[] taxels\nForces[] forces\n{RULE}\nMSG: xela_server_ros2/Taxel\nuint16 x\nuint16 y\nuint16 z\n{RULE}\nMSG: xela_server_ros2/Forces\nfloat32 x\nfloat32 y\nfloat32 z{}",
            header()
        ),
        SensorState::TYPE_NAME => format!(
            "std_msgs/Header header\nint64 tus\nPillarState[] pillars\nfloat32 gfX\nfloat32 gfY\nfloat32 gfZ\nbool is_contact\n{RULE}\nMSG: papillarray_ros2_v2/PillarState\nint32 id\nbool in_contact\nfloat32 dX\nfloat32 dY\nfloat32 dZ\nfloat32 fX\nfloat32 fY\nfloat32 fZ{}",
            header()
        ),
        ManusGlove::TYPE_NAME => format!(
            "int32 glove_id\nstring side\nint32 raw_node_count\nManusRawNode[] raw_nodes\nint32 ergonomics_count\nManusErgonomics[] ergonomics\n{RULE}\nMSG: manus_ros2_msgs/ManusRawNode\nint32 node_id\nint32 parent_node_id\nstring joint_type\nstring chain_type\nPoint position\n{RULE}\nMSG: manus_ros2_msgs/Point\nfloat32 x\nfloat32 y\nfloat32 z\n{RULE}\nMSG: manus_ros2_msgs/ManusErgonomics\nstring type\nfloat32 value\n"
        ),
        HandState::TYPE_NAME => format!(
            "MotorState[] motor_state\nPressSensorState[] press_sensor_state\nfloat32 load\n{RULE}\nMSG: acme/MotorState\nuint8 mode\nfloat32 q\n{RULE}\nMSG: acme/PressSensorState\nfloat32[3] pressure\nuint32 lost\n"
        ),
        Image::TYPE_NAME => format!(
            "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data{}",
            header()
        ),
        LaserScan::TYPE_NAME => format!(
            "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 time_increment\nfloat32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\nfloat32[] intensities{}",
            header()
        ),
        other => panic!("{other}"),
    }
}

/// A topic of one of the types above.
pub fn add<T: WireType>(bag: &mut Bag, topic: &str) -> OutChannel {
    let (type_name, schema) = (T::TYPE_NAME, schema(T::TYPE_NAME));
    let channel = NewChannel { topic, type_name, schema_text: &schema, qos_yaml: BEST_EFFORT_QOS, type_hash: "" };
    bag.writer.add_channel(channel).unwrap()
}

/// A message on it.
pub fn send<T: WireType>(bag: &mut Bag, channel: OutChannel, at: Stamp, message: &T) {
    bag.writer.write(channel, 0, at, at, &to_cdr(message)).unwrap();
}

/// What a resting array of `n` taxels reads at message `k`, and 5 more under load from the 400th on; median over 5
/// messages: 100, 101, ...
pub fn readings(n: usize, k: i64) -> Vec<f32> {
    let load = if k >= 400 { 5 } else { 0 };
    (0..n as i64).map(|taxel| (100 + taxel + k % 5 - 2 + load) as f32).collect()
}

/// The angle of joint `joint` at message `k`, deg.
pub fn degrees(joint: usize, k: i64) -> f32 {
    10.0 * (joint + 1) as f32 + 0.05 * k as f32
}

/// Messages of each of the layouts here.
pub fn sens_stream(at: Stamp, k: i64) -> SensStream {
    let zs = readings(8, k);
    let sensor = |half: &[f32]| SensorFull {
        message: k as u32,
        time: 0.0,
        model: "XR1944".into(),
        sensor_pos: 1,
        taxels: half.iter().map(|z| Taxel { x: 7, y: k as u16, z: *z as u16 }).collect(),
        forces: half.iter().map(|_| Forces { x: 0.0, y: 0.0, z: 1.0 }).collect(),
    };
    let header = Header { stamp: at.into(), frame_id: String::new() };
    SensStream { header, sensors: zs.chunks(4).map(sensor).collect() }
}

pub fn sensor_state(at: Stamp, k: i64) -> SensorState {
    let pillar = |(id, fZ): (usize, &f32)| PillarState {
        id: id as i32,
        in_contact: true,
        dX: 0.0,
        dY: 0.0,
        dZ: 0.1,
        fX: 0.0,
        fY: 0.0,
        fZ: *fZ,
    };
    SensorState {
        header: Header { stamp: at.into(), frame_id: String::new() },
        tus: k * 10_000,
        pillars: readings(9, k).iter().enumerate().map(pillar).collect(),
        gfX: 0.0,
        gfY: 0.0,
        gfZ: 0.0,
        is_contact: false,
    }
}

pub fn manus_glove(k: i64) -> ManusGlove {
    let names = ["IndexSpread", "IndexMCPStretch", "IndexPIPStretch"];
    let node = |id: i32| ManusRawNode {
        node_id: id,
        parent_node_id: id - 1,
        joint_type: "MCP".into(),
        chain_type: "Index".into(),
        position: Forces { x: 0.1, y: 0.01 * k as f32, z: 0.0 },
    };
    let angle = |(joint, name): (usize, &&str)| ManusErgonomics { r#type: name.to_string(), value: degrees(joint, k) };
    ManusGlove {
        glove_id: 3,
        side: "Left".into(),
        raw_node_count: 5,
        raw_nodes: (0..5).map(node).collect(),
        ergonomics_count: 3,
        ergonomics: names.iter().enumerate().map(angle).collect(),
    }
}

pub fn hand_state(k: i64) -> HandState {
    let press = |values: &[f32]| PressSensorState { pressure: values.try_into().unwrap(), lost: 0 };
    HandState {
        motor_state: (0..2).map(|joint| MotorState { mode: 1, q: degrees(joint, k).to_radians() }).collect(),
        press_sensor_state: readings(6, k).chunks(3).map(press).collect(),
        load: if k >= 400 { 2.5 } else { 0.0 },
    }
}

/// `sensor_msgs/msg/LaserScan`, which everybody has: two arrays of numbers in one message.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct LaserScan {
    pub header: Header,
    pub angles_and_times: [f32; 5],
    pub range_limits: [f32; 2],
    pub ranges: Vec<f32>,
    pub intensities: Vec<f32>,
}

named!(LaserScan: "sensor_msgs/msg/LaserScan");

/// A pressure map as an image of 16 bits a pixel, rows padded, the most significant byte first.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Image {
    pub header: Header,
    pub height: u32,
    pub width: u32,
    pub encoding: String,
    pub is_bigendian: u8,
    pub step: u32,
    pub data: Vec<u8>,
}

named!(Image: "sensor_msgs/msg/Image");

pub fn image(at: Stamp, k: i64) -> Image {
    let row = |values: &[f32]| -> Vec<u8> {
        values.iter().flat_map(|value| (*value as u16).to_be_bytes()).chain([0xff; 3]).collect()
    };
    Image {
        header: Header { stamp: at.into(), frame_id: String::new() },
        height: 2,
        width: 4,
        encoding: "16UC1".into(),
        is_bigendian: 1,
        step: 11,
        data: readings(8, k).chunks(4).flat_map(row).collect(),
    }
}
