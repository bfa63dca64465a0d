//! Devices with joint angles, or with the points of a hand.

use serde::{Deserialize, Serialize};
use tactile_pose_fusion::hand::{self, NamedLayout, Side};
use tactile_pose_fusion::msg::*;

use super::super::bags::{Bag, Recorded, at, stamp_of};
use super::super::layouts::{degrees, readings};
use super::{Device, N, Own, When, add, header, header_parts, joints, read, send, taxels};

named!(
    HandState: "unitree_hg/msg/HandState",
    ManusGlove: "manus_ros2_msgs/msg/ManusGlove",
    InspireHandTouch: "inspire_hand_ros2/msg/InspireHandTouch",
    InspireHandState: "inspire_hand_ros2/msg/InspireHandState",
);

pub const PSYONIC: Device = Device {
    name: "psyonic_ability_hand",
    record: psyonic,
    own: |message| match message.type_name.as_str() {
        JointState::TYPE_NAME => {
            let JointState { header, name, position, .. } = read(message);
            vec![joints("hand", When::At(stamp_of(&header)), name, position)]
        }
        _ => vec![taxels("touch", When::Receipt, read::<Float32MultiArray>(message).data)],
    },
    tactile: &[("touch", 30)],
    joint: Some("hand"),
    models: &[("fingertip", 6, 2)],
};

pub const DEX3: Device = Device {
    name: "unitree_dex3",
    record: dex3,
    own: |message| {
        let HandState { motor_state, press_sensor_state, .. } = read(message);
        let names = ["thumb_0", "thumb_1", "thumb_2", "middle_0", "middle_1", "index_0", "index_1"];
        let angles = motor_state.iter().map(|motor| motor.q_dq_ddq_tau[0].into()).collect();
        vec![
            taxels("pads", When::Receipt, press_sensor_state.iter().flat_map(|pad| pad.pressure).collect()),
            joints("motors", When::Receipt, names.map(str::to_owned).to_vec(), angles),
        ]
    },
    tactile: &[("pads", 108)],
    joint: Some("motors"),
    models: &[("fingertip", 12, 2)],
};

pub const MANUS: Device = Device {
    name: "manus_gloves",
    record: manus,
    own: |message| {
        let ManusGlove { side, ergonomics, .. } = read(message);
        let (names, angles) = ergonomics.into_iter().map(|(name, angle)| (name, f64::from(angle).to_radians())).unzip();
        let own = || joints("manus", When::Receipt, names, angles);
        (side == "Right").then(own).into_iter().collect()
    },
    tactile: &[("glove", 6)],
    joint: Some("manus"),
    models: &[("fingertip", 6, 4)],
};

pub const INSPIRE: Device = Device {
    name: "inspire_rh56dftp",
    record: inspire,
    own: |message| match message.type_name.as_str() {
        InspireHandState::TYPE_NAME => {
            let InspireHandState { header, angle_actual, .. } = read(message);
            let names = ["little", "ring", "middle", "index", "thumb_bend", "thumb_rotation"];
            let angles = angle_actual.iter().map(|steps| f64::from(*steps) * (-0.156_f64).to_radians()).collect();
            vec![joints("hand", When::At(stamp_of(&header)), names.map(str::to_owned).to_vec(), angles)]
        }
        _ => {
            let InspireHandTouch { header, fingers, palm, .. } = read(message);
            let as_f32 = |arrays: &[&[i16]]| arrays.concat().into_iter().map(f32::from).collect();
            let sources = ["little", "ring", "middle", "index", "thumb"].into_iter().zip(&fingers);
            let of_finger = |(source, one): (&'static str, &FingerTactile)| {
                let values = match source {
                    "thumb" => as_f32(&[&one.tip, &one.nail, &one.middle_section, &one.pad]),
                    _ => as_f32(&[&one.tip, &one.nail, &one.pad]),
                };
                taxels(source, When::At(stamp_of(&header)), values)
            };
            let palm = taxels("palm", When::At(stamp_of(&header)), as_f32(&[&palm.concat()]));
            sources.map(of_finger).chain([palm]).collect()
        }
    },
    tactile: &[("little", 185), ("ring", 185), ("middle", 185), ("index", 185), ("thumb", 210), ("palm", 112)],
    joint: Some("hand"),
    models: &[("finger", 185, 1), ("thumb", 210, 2), ("palm", 112, 0)],
};

pub const ISAAC: Device = Device {
    name: "isaac_teleop",
    record: isaac,
    own: |message| {
        let PoseArray { header, poses } = read(message);
        let points: Vec<hand::Point> =
            poses[25..].iter().map(|it| [it.position.x, it.position.y, it.position.z]).collect();
        let angles = hand::angles(&points, &NamedLayout::OpenXr25.layout(), Side::Right);
        vec![joints("hand", When::At(stamp_of(&header)), hand::JOINTS.map(str::to_owned).to_vec(), angles.to_vec())]
    },
    tactile: &[("glove", 6)],
    joint: Some("hand"),
    models: &[("fingertip", 6, 4)],
};

fn psyonic(bag: &mut Bag) {
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

fn dex3(bag: &mut Bag) {
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
    let topic = add::<HandState>(bag, "/dex3/right/state", definition, &parts);
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
        send(bag, topic, 10 * k, &state);
    }
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

fn manus(bag: &mut Bag) {
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
    let topic = add::<ManusGlove>(bag, "/manus_glove_0", definition, &parts);
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
        send(bag, topic, 10 * k, &glove);
        glove_taxels(bag, k);
    }
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

/// The angle of a joint at message `k`, in steps of 1000.
pub fn inspire_angle(joint: usize, k: i64) -> i16 {
    900 - 50 * joint as i16 - k as i16
}

fn inspire(bag: &mut Bag) {
    let finger = "string name\nint16[] tip\nint16[] nail\nint16[] pad\nint16[] middle_section\nfloat32 total_pressure\n\
                  float32 max_pressure\nint32 contact_count\n";
    let parts = [header_parts().to_vec(), vec![("inspire_hand_ros2/FingerTactile", finger)]].concat();
    let touch = "std_msgs/Header header\nFingerTactile little\nFingerTactile ring\nFingerTactile middle\nFingerTactile index\n\
                 FingerTactile thumb\nint16[112] palm\nfloat32 total_contact\nuint8 fingers_in_contact\nbool stable_contact\n";
    let state = "std_msgs/Header header\nint16[6] position_actual\nint16[6] angle_actual\nint16[6] force_actual\n\
                 int16[6] current\nuint8[6] status\nuint8[6] error\nuint8[6] temperature\n";
    let topic = "/inspire_hand/inspire_hand_node";
    let touches = add::<InspireHandTouch>(bag, &format!("{topic}/touch"), touch, &parts);
    let states = add::<InspireHandState>(bag, &format!("{topic}/state"), state, &header_parts());
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
            angle_actual: std::array::from_fn(|joint| inspire_angle(joint, k)),
            force_and_current: [[k as i16; 6]; 2],
            status_error_and_temperature: [[3; 6]; 3],
        };
        send(bag, states, 10 * k, &state);
        let [palm] = arrays(k, &[112]).try_into().unwrap();
        let touch = InspireHandTouch {
            header: header(10 * k),
            fingers: std::array::from_fn(finger),
            palm: std::array::from_fn(|row| palm[16 * row..16 * (row + 1)].try_into().unwrap()),
            total_contact: k as f32,
            fingers_in_contact: 1,
            stable_contact: true,
        };
        send(bag, touches, 10 * k, &touch);
    }
}

/// The angles of the right hand at message `k`, rad.
pub fn isaac_angles(k: i64) -> [f64; 20] {
    std::array::from_fn(|joint| 0.1 + 0.01 * joint as f64 + 0.0005 * k as f64)
}

fn isaac(bag: &mut Bag) {
    for k in 0..N {
        let of = |angles: &[f64; 20], side| {
            let pose = |hand::HandPose { position: [x, y, z], orientation: [qx, qy, qz, qw] }| Pose {
                position: Point { x, y, z },
                orientation: Quaternion { x: qx, y: qy, z: qz, w: qw },
            };
            hand::poses(angles, NamedLayout::OpenXr25, side).into_iter().map(pose).collect::<Vec<Pose>>()
        };
        let poses = [of(&[0.3; 20], Side::Left), of(&isaac_angles(k), Side::Right)].concat();
        bag.send("/xr_teleop/hand", at(10 * k), &PoseArray { header: header(10 * k), poses });
        glove_taxels(bag, k);
    }
}
