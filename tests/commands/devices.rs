//! The parameter files of devices on the market: each replays a bag that is laid out as the device's messages are defined.
#![allow(non_snake_case)]

use crate::common;

use std::path::Path;

use common::bags::{Bag, at, decoded};
use common::layouts::{degrees, readings};
use common::onnx::LinearModel;
use common::tpf::{Run, tpf};
use serde::{Deserialize, Serialize};
use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, NewChannel, OutChannel};
use tactile_pose_fusion::hand::{self, NamedLayout, Side};
use tactile_pose_fusion::msg::*;

const RULE: &str = "================================================================================";
const N: i64 = 600;

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

macro_rules! named {
    ($($ty:ident: $name:literal),* $(,)?) => {
        $(impl WireType for $ty {
            const TYPE_NAME: &'static str = $name;
        })*
    };
}

named!(
    SensorState: "papillarray_ros2_v2/msg/SensorState",
    SensStream: "xela_server_ros2/msg/SensStream",
    TactileSensor: "paxini_hardware/msg/TactileSensor",
    HandPressures: "robotis_interfaces/msg/HandPressures",
    HandState: "unitree_hg/msg/HandState",
    ManusGlove: "manus_ros2_msgs/msg/ManusGlove",
    InspireHandTouch: "inspire_hand_ros2/msg/InspireHandTouch",
    InspireHandState: "inspire_hand_ros2/msg/InspireHandState",
    TactileFrame: "wujihand_tactile_msgs/msg/TactileFrame",
);

fn header(ms: i64) -> Header {
    Header { stamp: at(ms).into(), frame_id: String::new() }
}

fn header_parts() -> [(&'static str, &'static str); 2] {
    [
        ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
        ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    ]
}

/// Replays `glove.mcap` with a device's file and gives the forces of its regions in the last message, N.
fn forces(folder: &Path, device: &str, model: &LinearModel) -> Vec<f64> {
    let params = format!("{}/params/devices/{device}.yaml", env!("CARGO_MANIFEST_DIR"));
    std::fs::copy(&params, folder.join("device.yaml")).unwrap();
    model.clone().metadata("unit", "N").write(folder, "fingertip.onnx");
    let replay = ["replay", "glove.mcap", "--params-file", "device.yaml", "-o", "out.mcap", "--calibrate-first", "2.5"];
    let run = tpf(folder, &[&replay[..], &["-p", "calibration.max_force:=1000.0"]].concat());
    assert_eq!(run.code, 0, "{device}: {run:?}");
    assert!(!run.stdout.contains("lost by the sender"), "{device}: {run:?}");
    let contacts: Vec<ContactArray> = decoded(&folder.join("out.mcap"), "/tactile_pose_fusion/contacts");
    assert_eq!(contacts.len() as i64, N, "{device}");
    contacts.last().unwrap().contacts.iter().map(|contact| contact.force).collect()
}

/// What a region of these taxels must read at the end: 2 of a swing and 5 of a load above its zero, less its joints.
fn assert_forces(device: &str, forces: &[f64], model: &LinearModel, joints: &[Vec<f32>]) {
    assert_eq!(forces.len(), joints.len(), "{device}");
    for (region, (force, joints)) in forces.iter().zip(joints).enumerate() {
        let expected = f64::from(model.expected(&vec![7.0; model.n_taxels], joints).0);
        // Sums in another order, and degrees turned in f64 there and in f32 here.
        assert!((force - expected).abs() < 1e-3, "{device}, region {region}: {force} is not {expected}");
    }
}

/// Bags of taxels without joint angles.
fn taxels_only(device: &str, n_regions: usize, n_taxels: usize, record: impl Fn(&mut Bag)) {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("glove.mcap"));
    record(&mut bag);
    bag.finish();
    let model = LinearModel::new(8, n_taxels, 0);
    assert_forces(device, &forces(folder.path(), device, &model), &model, &vec![vec![]; n_regions]);
}

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

#[test]
fn contactile_papillarray() {
    taxels_only("contactile_papillarray", 1, 27, |bag| {
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
            let state =
                SensorState { header: header(10 * k), tus, pillars, global, friction_est, target_grip_force, is };
            send(bag, topic, 10 * k, &state);
        }
    });
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

#[test]
fn xela_uskin() {
    taxels_only("xela_uskin", 1, 48, |bag| {
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
    });
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

#[test]
fn paxini_s1813() {
    taxels_only("paxini_s1813", 1, 93, |bag| {
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
    });
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

#[test]
fn robotis_hx5() {
    taxels_only("robotis_hx5", 5, 9, |bag| {
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
    });
}

/// Angle of joint `joint` in the last message, rad.
fn last(joint: usize) -> f32 {
    degrees(joint, N - 1).to_radians()
}

#[test]
fn psyonic_ability_hand() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("glove.mcap"));
    let names = ["index", "middle", "ring", "pinky", "thumb"];
    let names: Vec<String> = names.iter().flat_map(|name| [format!("{name}_q1"), format!("{name}_q2")]).collect();
    for k in 0..N {
        let touch =
            Float32MultiArray { layout: MultiArrayLayout { dim: vec![], data_offset: 0 }, data: readings(30, k) };
        let position = (0..10).map(|joint| f64::from(degrees(joint, k)).to_radians()).collect();
        let state =
            JointState { header: header(10 * k), name: names.clone(), position, velocity: vec![], effort: vec![] };
        bag.send("/joint_states_ah", at(10 * k), &state);
        bag.send("/ability_hand/feedback/touch", at(10 * k), &touch);
    }
    bag.finish();
    let model = LinearModel::new(8, 6, 2);
    let joints: Vec<Vec<f32>> = (0..5).map(|finger| vec![last(2 * finger), last(2 * finger + 1)]).collect();
    assert_forces("psyonic", &forces(folder.path(), "psyonic_ability_hand", &model), &model, &joints);
}

#[derive(Serialize, Deserialize)]
struct Motor {
    mode: u8,
    q_dq_ddq_tau: [f32; 4],
    temperature: [i16; 2],
    vol: f32,
    sensor: [u32; 2],
    motorstate: u32,
    reserve: [u32; 4],
}

#[derive(Serialize, Deserialize)]
struct Pad {
    pressure: [f32; 12],
    temperature: [f32; 12],
    lost: u32,
    reserve: u32,
}

#[derive(Serialize, Deserialize)]
struct HandState {
    motor_state: Vec<Motor>,
    press_sensor_state: Vec<Pad>,
    imu: [f32; 13],
    imu_temperature: i16,
    power: [f32; 4],
    error: [u32; 2],
    reserve: [u32; 2],
}

#[test]
fn unitree_dex3() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("glove.mcap"));
    let parts = [
        (
            "unitree_hg/MotorState",
            "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nint16[2] temperature\nfloat32 vol\nuint32[2] \
             sensor\nuint32 motorstate\nuint32[4] reserve\n",
        ),
        ("unitree_hg/PressSensorState", "float32[12] pressure\nfloat32[12] temperature\nuint32 lost\nuint32 reserve\n"),
        (
            "unitree_hg/IMUState",
            "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\nint16 temperature\n",
        ),
    ];
    let definition = "MotorState[] motor_state\nPressSensorState[] press_sensor_state\nIMUState imu_state\nfloat32 power_v\n\
                      float32 power_a\nfloat32 system_v\nfloat32 device_v\nuint32[2] error\nuint32[2] reserve\n";
    let topic = add::<HandState>(&mut bag, "/dex3/right/state", definition, &parts);
    for k in 0..N {
        let motor = |joint: usize| Motor {
            mode: 1,
            q_dq_ddq_tau: [degrees(joint, k).to_radians(), k as f32, 0.0, 0.0],
            temperature: [30, 31],
            vol: 48.0,
            sensor: [0; 2],
            motorstate: 0,
            reserve: [0; 4],
        };
        let pad = |values: &[f32]| Pad {
            pressure: values.try_into().unwrap(),
            temperature: [k as f32; 12],
            lost: 0,
            reserve: 0,
        };
        let state = HandState {
            motor_state: (0..7).map(motor).collect(),
            press_sensor_state: readings(108, k).chunks(12).map(pad).collect(),
            imu: [0.0; 13],
            imu_temperature: 30,
            power: [0.0; 4],
            error: [0; 2],
            reserve: [0; 2],
        };
        send(&mut bag, topic, 10 * k, &state);
    }
    bag.finish();
    let model = LinearModel::new(8, 12, 2);
    let joints = [[1, 2], [1, 2], [3, 4], [3, 4], [5, 6], [5, 6], [5, 6], [3, 4], [3, 4]];
    let joints: Vec<Vec<f32>> = joints.iter().map(|pair| pair.map(last).to_vec()).collect();
    assert_forces("dex3", &forces(folder.path(), "unitree_dex3", &model), &model, &joints);
}

/// A tactile glove of the package's own message, beside a device that tells the hand.
fn glove_taxels(bag: &mut Bag, k: i64) {
    let taxels = TaxelArray {
        header: header(10 * k),
        sequence: k as u32,
        rows: 1,
        row_period: Duration::default(),
        values: readings(6, k),
    };
    bag.send("/glove/taxels", at(10 * k), &taxels);
}

#[derive(Serialize, Deserialize)]
struct ManusGlove {
    glove_id: i32,
    side: String,
    raw_node_count: i32,
    raw_nodes: Vec<Text>,
    ergonomics_count: i32,
    ergonomics: Vec<(String, f32)>,
    raw_sensor_orientation: [f64; 4],
    raw_sensor_count: i32,
    raw_sensor: Vec<[f64; 7]>,
}

#[test]
fn manus_gloves() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("glove.mcap"));
    let parts = [
        (
            "manus_ros2_msgs/ManusRawNode",
            "int32 node_id\nint32 parent_node_id\nstring joint_type\nstring chain_type\ngeometry_msgs/Pose pose\n",
        ),
        ("manus_ros2_msgs/ManusErgonomics", "string type\nfloat32 value\n"),
        ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"),
        ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
        ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"),
    ];
    let definition = "int32 glove_id\nstring side\nint32 raw_node_count\nManusRawNode[] raw_nodes\nint32 ergonomics_count\n\
                      ManusErgonomics[] ergonomics\ngeometry_msgs/Quaternion raw_sensor_orientation\nint32 \
                      raw_sensor_count\ngeometry_msgs/Pose[] raw_sensor\n";
    let topic = add::<ManusGlove>(&mut bag, "/manus_glove_0", definition, &parts);
    let joints = ["IndexSpread", "IndexMCPStretch", "IndexPIPStretch", "IndexDIPStretch"];
    for k in 0..N {
        let ergonomics = joints.iter().enumerate().map(|(joint, name)| ((*name).to_owned(), degrees(joint, k)));
        let glove = ManusGlove {
            glove_id: 3,
            side: "Right".to_owned(),
            raw_node_count: 0,
            raw_nodes: vec![],
            ergonomics_count: 4,
            ergonomics: ergonomics.collect(),
            raw_sensor_orientation: [0.0; 4],
            raw_sensor_count: 0,
            raw_sensor: vec![],
        };
        send(&mut bag, topic, 10 * k, &glove);
        glove_taxels(&mut bag, k);
    }
    bag.finish();
    let model = LinearModel::new(8, 6, 4);
    let joints = vec![[3, 2, 1, 0].map(last).to_vec()];
    assert_forces("manus", &forces(folder.path(), "manus_gloves", &model), &model, &joints);
}

#[derive(Serialize, Deserialize)]
struct FingerTactile {
    name: String,
    tip: Vec<i16>,
    nail: Vec<i16>,
    pad: Vec<i16>,
    middle_section: Vec<i16>,
    total_and_max: [f32; 2],
    contact_count: i32,
}

#[derive(Serialize, Deserialize)]
struct InspireHandTouch {
    header: Header,
    fingers: [FingerTactile; 5],
    palm: [[i16; 16]; 7], // one array of 112
    total_contact: f32,
    fingers_in_contact: u8,
    stable_contact: bool,
}

#[derive(Serialize, Deserialize)]
struct InspireHandState {
    header: Header,
    position_actual: [i16; 6],
    angle_actual: [i16; 6],
    force_and_current: [[i16; 6]; 2],
    status_error_and_temperature: [[u8; 6]; 3],
}

#[test]
fn inspire_rh56dftp() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("glove.mcap"));
    let finger = "string name\nint16[] tip\nint16[] nail\nint16[] pad\nint16[] middle_section\nfloat32 total_pressure\n\
                  float32 max_pressure\nint32 contact_count\n";
    let parts = [header_parts().to_vec(), vec![("inspire_hand_ros2/FingerTactile", finger)]].concat();
    let touch = "std_msgs/Header header\nFingerTactile little\nFingerTactile ring\nFingerTactile middle\nFingerTactile index\n\
                 FingerTactile thumb\nint16[112] palm\nfloat32 total_contact\nuint8 fingers_in_contact\nbool stable_contact\n";
    let state = "std_msgs/Header header\nint16[6] position_actual\nint16[6] angle_actual\nint16[6] force_actual\n\
                 int16[6] current\nuint8[6] status\nuint8[6] error\nuint8[6] temperature\n";
    let topic = "/inspire_hand/inspire_hand_node";
    let touches = add::<InspireHandTouch>(&mut bag, &format!("{topic}/touch"), touch, &parts);
    let states = add::<InspireHandState>(&mut bag, &format!("{topic}/state"), state, &header_parts());
    let angle = |joint: usize, k: i64| 900 - 50 * joint as i16 - k as i16;
    let arrays = |k: i64, lengths: &[usize]| -> Vec<Vec<i16>> {
        let all = readings(lengths.iter().sum(), k);
        let ends = lengths.iter().scan(0, |end, len| {
            *end += len;
            Some((*end - len, *end))
        });
        ends.map(|(from, to)| all[from..to].iter().map(|value| *value as i16).collect()).collect()
    };
    for k in 0..N {
        let finger = |idx: usize| {
            let (lengths, name) = match idx {
                4 => ([9, 96, 9, 96], "thumb"),
                _ => ([9, 96, 0, 80], "finger"),
            };
            let [tip, nail, middle_section, pad] = arrays(k, &lengths).try_into().unwrap();
            let (total_and_max, contact_count) = ([k as f32; 2], 3);
            FingerTactile { name: name.to_owned(), tip, nail, pad, middle_section, total_and_max, contact_count }
        };
        let state = InspireHandState {
            header: header(10 * k),
            position_actual: [7; 6],
            angle_actual: std::array::from_fn(|joint| angle(joint, k)),
            force_and_current: [[k as i16; 6]; 2],
            status_error_and_temperature: [[3; 6]; 3],
        };
        send(&mut bag, states, 10 * k, &state);
        let [palm] = arrays(k, &[112]).try_into().unwrap();
        let touch = InspireHandTouch {
            header: header(10 * k),
            fingers: std::array::from_fn(finger),
            palm: std::array::from_fn(|row| palm[16 * row..16 * (row + 1)].try_into().unwrap()),
            total_contact: k as f32,
            fingers_in_contact: 1,
            stable_contact: true,
        };
        send(&mut bag, touches, 10 * k, &touch);
    }
    bag.finish();
    let model = |name: &str, n_taxels, n_joints| {
        let model = LinearModel::new(8, n_taxels, n_joints).metadata("unit", "N");
        model.write(folder.path(), &format!("{name}.onnx"));
        model
    };
    let (finger, thumb, palm) = (model("finger", 185, 1), model("thumb", 210, 2), model("palm", 112, 0));
    let forces = forces(folder.path(), "inspire_rh56dftp", &palm);
    let at_end = |joint| (-0.156 * f32::from(angle(joint, N - 1))).to_radians();
    (0..4).for_each(|idx| assert_forces("inspire", &forces[idx..=idx], &finger, &[vec![at_end(idx)]]));
    assert_forces("inspire", &forces[4..5], &thumb, &[vec![at_end(4), at_end(5)]]);
    assert_forces("inspire", &forces[5..], &palm, &[vec![]]);
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
fn tactile_frames(bag: &mut Bag, hands: &[u8], device_ms: impl Fn(i64) -> i64) {
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

#[test]
fn wuji_glove() {
    taxels_only("wuji_glove", 1, 6, |bag| tactile_frames(bag, &[1, 0], |k| 4_294_965_000 + 10 * k)); // wraps, too
}

/// A replay of `glove.mcap` with the file of the Wuji glove.
fn replay_wuji(hands: &[u8], device_ms: impl Fn(i64) -> i64) -> Run {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("glove.mcap"));
    tactile_frames(&mut bag, hands, device_ms);
    bag.finish();
    LinearModel::new(8, 6, 0).metadata("unit", "N").write(folder.path(), "fingertip.onnx");
    let params = format!("{}/params/devices/wuji_glove.yaml", env!("CARGO_MANIFEST_DIR"));
    let replay = ["replay", "glove.mcap", "--params-file", &params, "-o", "out.mcap", "--calibrate-first", "2.5"];
    let model = format!("model.fingertip.path:={}/fingertip.onnx", folder.path().display());
    tpf(folder.path(), &[&replay[..], &["-p", "calibration.max_force:=1000.0", "-p", &model, "--json"]].concat())
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

#[test]
fn isaac_teleop() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("glove.mcap"));
    let angles = |k: i64| -> [f64; 20] { std::array::from_fn(|joint| 0.1 + 0.01 * joint as f64 + 0.0005 * k as f64) };
    for k in 0..N {
        let of = |angles: &[f64; 20], side| {
            let pose = |hand::HandPose { position: [x, y, z], orientation: [qx, qy, qz, qw] }| Pose {
                position: Point { x, y, z },
                orientation: Quaternion { x: qx, y: qy, z: qz, w: qw },
            };
            hand::poses(angles, NamedLayout::OpenXr25, side).into_iter().map(pose).collect::<Vec<Pose>>()
        };
        let poses = [of(&[0.3; 20], Side::Left), of(&angles(k), Side::Right)].concat();
        bag.send("/xr_teleop/hand", at(10 * k), &PoseArray { header: header(10 * k), poses });
        glove_taxels(&mut bag, k);
    }
    bag.finish();
    let model = LinearModel::new(8, 6, 4);
    let joints = vec![angles(N - 1)[..4].iter().map(|angle| *angle as f32).collect::<Vec<f32>>()];
    assert_forces("isaac", &forces(folder.path(), "isaac_teleop", &model), &model, &joints);
}
