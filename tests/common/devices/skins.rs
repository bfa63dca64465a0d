//! Devices with taxels alone.
#![allow(non_snake_case)]

use serde::{Deserialize, Serialize};
use tactile_pose_fusion::msg::*;

use super::super::bags::{Bag, Recorded, stamp_of};
use super::super::layouts::readings;
use super::{Device, N, Own, When, add, header, header_parts, read, send, taxels};

named!(
    SensorState: "papillarray_ros2_v2/msg/SensorState",
    SensStream: "xela_server_ros2/msg/SensStream",
    TactileSensor: "paxini_hardware/msg/TactileSensor",
    HandPressures: "robotis_interfaces/msg/HandPressures",
    TactileFrame: "wujihand_tactile_msgs/msg/TactileFrame",
);

/// A device with one source and one model.
const fn skin(
    name: &'static str,
    record: fn(&mut Bag),
    own: fn(&Recorded) -> Vec<Own>,
    tactile: &'static [(&'static str, usize)],
    models: &'static [(&'static str, usize, usize)],
) -> Device {
    Device { name, record, own, tactile, joint: None, models }
}

pub const PAPILLARRAY: Device = skin(
    "contactile_papillarray",
    papillarray,
    |message| {
        let SensorState { header, pillars, .. } = read(message);
        let values = [0, 1, 2].iter().flat_map(|axis| pillars.iter().map(|pillar| pillar.f[*axis])).collect();
        vec![taxels("papillarray", When::At(stamp_of(&header)), values)]
    },
    &[("papillarray", 27)],
    &[("fingertip", 27, 0)],
);

pub const USKIN: Device = skin(
    "xela_uskin",
    uskin,
    |message| {
        let SensStream { header, sensors } = read(message);
        let patch = sensors.iter().find(|sensor| sensor.sensor_pos == 1).unwrap();
        let values =
            [0, 1, 2].iter().flat_map(|axis| patch.taxels.iter().map(|taxel| f32::from(taxel[*axis]))).collect();
        vec![taxels("uskin", When::At(stamp_of(&header)), values)]
    },
    &[("uskin", 48)],
    &[("fingertip", 48, 0)],
);

pub const PAXINI: Device = skin(
    "paxini_s1813",
    paxini,
    |message| {
        let TactileSensor { header, taxels: all, .. } = read(message);
        let values = [0, 1, 2].iter().flat_map(|axis| all.iter().map(|taxel| taxel.force[*axis] as f32)).collect();
        vec![taxels("paxini", When::At(stamp_of(&header)), values)]
    },
    &[("paxini", 93)],
    &[("fingertip", 93, 0)],
);

pub const HX5: Device = skin(
    "robotis_hx5",
    hx5,
    |message| {
        let HandPressures { header, sensors, .. } = read(message);
        let values = sensors.iter().flat_map(|sensor| sensor.pressure_values.map(f32::from)).collect();
        vec![taxels("pressures", When::At(stamp_of(&header)), values)]
    },
    &[("pressures", 45)],
    &[("fingertip", 9, 0)],
);

pub const WUJI: Device = skin(
    "wuji_glove",
    |bag| tactile_frames(bag, &[1, 0], |k| 4_294_965_000 + 10 * k), // wraps on the way
    |message| {
        let TactileFrame { hand, pressure, .. } = read(message);
        let own = || taxels("glove", When::Frame, pressure.concat());
        (hand == 1).then(own).into_iter().collect()
    },
    &[("glove", 768)],
    &[("fingertip", 6, 0)],
);

#[derive(Serialize, Deserialize)]
struct Pillar {
    id: i32,
    in_contact: bool,
    d: [f32; 3],
    f: [f32; 3],
}

#[derive(Serialize, Deserialize)]
struct SensorState {
    header: Header,
    tus: i64,
    pillars: Vec<Pillar>,
    global: [f32; 6],
    friction_est: f32,
    target_grip_force: f32,
    is: [bool; 3],
}

fn papillarray(bag: &mut Bag) {
    let parts = [
        header_parts().to_vec(),
        vec![(
            "papillarray_ros2_v2/PillarState",
            "int32 id\nbool in_contact\nfloat32 dX\nfloat32 dY\nfloat32 dZ\nfloat32 fX\nfloat32 fY\nfloat32 fZ\n",
        )],
    ]
    .concat();
    let definition = "std_msgs/Header header\nint64 tus\nPillarState[] pillars\nfloat32 gfX\nfloat32 gfY\nfloat32 gfZ\n\
                      float32 gtX\nfloat32 gtY\nfloat32 gtZ\nfloat32 friction_est\nfloat32 target_grip_force\n\
                      bool is_sd_active\nbool is_ref_loaded\nbool is_contact\n";
    let topic = add::<SensorState>(bag, "/hub_0/sensor_0", definition, &parts);
    for k in 0..N {
        let forces = readings(27, k);
        let pillar = |id: usize| Pillar {
            id: id as i32,
            in_contact: true,
            d: [k as f32; 3],
            f: [forces[id], forces[9 + id], forces[18 + id]],
        };
        let pillars = (0..9).map(pillar).collect();
        let (tus, global) = (k * 10_000, [k as f32; 6]);
        let (friction_est, target_grip_force) = (0.0, 0.0);
        let is = [false; 3];
        let state = SensorState { header: header(10 * k), tus, pillars, global, friction_est, target_grip_force, is };
        send(bag, topic, 10 * k, &state);
    }
}

#[derive(Serialize, Deserialize)]
struct SensStream {
    header: Header,
    sensors: Vec<SensorFull>,
}

#[derive(Serialize, Deserialize)]
struct SensorFull {
    message: u32,
    time: f64,
    model: String,
    sensor_pos: u8,
    taxels: Vec<[u16; 3]>,
    forces: Vec<[f32; 3]>,
}

fn uskin(bag: &mut Bag) {
    let parts = [
        header_parts().to_vec(),
        vec![
            (
                "xela_server_ros2/SensorFull",
                "uint32 message\nfloat64 time\nstring model\nuint8 sensor_pos\nTaxel[] taxels\nForces[] forces\n",
            ),
            ("xela_server_ros2/Taxel", "uint16 x\nuint16 y\nuint16 z\n"),
            ("xela_server_ros2/Forces", "float32 x\nfloat32 y\nfloat32 z\n"),
        ],
    ]
    .concat();
    let definition = "std_msgs/Header header\nSensorFull[] sensors\n";
    let topic = add::<SensStream>(bag, "/xServTopic", definition, &parts);
    for k in 0..N {
        let axes = readings(48, k);
        let taxel = |idx: usize, of: u8| [0, 16, 32].map(|axis| axes[axis + idx] as u16 * u16::from(of));
        let sensor = |sensor_pos: u8| SensorFull {
            message: k as u32,
            time: 0.01 * k as f64,
            model: "uSPa44".to_owned(),
            sensor_pos,
            taxels: (0..16).map(|idx| taxel(idx, sensor_pos)).collect(),
            forces: vec![],
        };
        send(bag, topic, 10 * k, &SensStream { header: header(10 * k), sensors: vec![sensor(2), sensor(1)] });
    }
}

#[derive(Serialize, Deserialize)]
struct TactileSensor {
    header: Header,
    resultant_force: [f64; 3],
    taxels: Vec<TactileTaxel>,
}

#[derive(Serialize, Deserialize)]
struct TactileTaxel {
    index: u32,
    position: [f64; 3],
    normal: [f64; 3],
    force: [f64; 3],
}

fn paxini(bag: &mut Bag) {
    let vector = "float64 x\nfloat64 y\nfloat64 z\n";
    let parts = [
        header_parts().to_vec(),
        vec![
            (
                "paxini_hardware/TactileTaxel",
                "uint32 index\ngeometry_msgs/Point position\ngeometry_msgs/Vector3 normal\ngeometry_msgs/Vector3 force\n",
            ),
            ("geometry_msgs/Vector3", vector),
            ("geometry_msgs/Point", vector),
        ],
    ]
    .concat();
    let definition =
        "std_msgs/Header header\ngeometry_msgs/Vector3 resultant_force\npaxini_hardware/TactileTaxel[] taxels\n";
    let topic = add::<TactileSensor>(bag, "/paxini/index/tactile_sensor", definition, &parts);
    for k in 0..N {
        let axes = readings(93, k);
        let taxel = |idx: usize| TactileTaxel {
            index: idx as u32 + 1,
            position: [0.1; 3],
            normal: [0.0; 3],
            force: [0, 31, 62].map(|axis| axes[axis + idx].into()),
        };
        let taxels = (0..31).map(taxel).collect();
        send(bag, topic, 10 * k, &TactileSensor { header: header(10 * k), resultant_force: [k as f64; 3], taxels });
    }
}

#[derive(Serialize, Deserialize)]
struct HandPressures {
    header: Header,
    hand_name: String,
    sensors: Vec<HandSensor>,
}

#[derive(Serialize, Deserialize)]
struct HandSensor {
    sensor_name: String,
    pressure_names: [String; 9],
    pressure_values: [u8; 9],
}

fn hx5(bag: &mut Bag) {
    let parts = [
        header_parts().to_vec(),
        vec![(
            "robotis_interfaces/TactileSensor",
            "string sensor_name\nstring[9] pressure_names\nuint8[9] pressure_values\n",
        )],
    ]
    .concat();
    let definition = "std_msgs/Header header\nstring hand_name\nTactileSensor[] sensors\n";
    let topic = add::<HandPressures>(bag, "/right_hand/finger_pressures", definition, &parts);
    for k in 0..N {
        let sensor = |(finger, values): (usize, &[f32])| HandSensor {
            sensor_name: format!("finger{finger}"),
            pressure_names: std::array::from_fn(|idx| format!("p{idx}")),
            pressure_values: std::array::from_fn(|idx| values[idx] as u8),
        };
        let sensors = readings(45, k).chunks(9).enumerate().map(sensor).collect();
        send(bag, topic, 10 * k, &HandPressures { header: header(10 * k), hand_name: "right".to_owned(), sensors });
    }
}

#[derive(Serialize, Deserialize)]
struct TactileFrame {
    header: Header,
    hand: u8,
    sequence: u16,
    device_timestamp_ms: u32,
    pressure: [[f32; 32]; 24], // one array of 768
}

/// Frames of these hands, with the device's clock at message `k`.
pub fn tactile_frames(bag: &mut Bag, hands: &[u8], device_ms: impl Fn(i64) -> i64) {
    let definition =
        "std_msgs/Header header\nuint8 hand\nuint16 sequence\nuint32 device_timestamp_ms\nfloat32[768] pressure\n";
    let topic = add::<TactileFrame>(bag, "/tactile/raw", definition, &header_parts());
    let cells = [4, 5, 36, 37, 68, 69];
    for k in 0..N {
        for hand in hands {
            let mut pressure = [[f32::NAN; 32]; 24];
            for (cell, reading) in cells.iter().zip(readings(6, k)) {
                pressure[cell / 32][cell % 32] = reading * f32::from(*hand);
            }
            let sequence = (65_300 + k) as u16; // wraps on the way
            let device_timestamp_ms = device_ms(k) as u32;
            let frame = TactileFrame { header: header(0), hand: *hand, sequence, device_timestamp_ms, pressure };
            send(bag, topic, 10 * k, &frame);
        }
    }
}
