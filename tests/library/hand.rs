//! The points of a hand become joint angles, or are missing: by the pure computation, by bytes of messages, by parameters.

use crate::msg_common;

use msg_common::CdrWriter;
use serde::Deserialize;
use tactile_pose_fusion::hand::{JOINTS, Layout, NamedLayout, Point, Side, angles, poses};
use tactile_pose_fusion::msg::binding::{
    HandFields, HandPaths, JointBinding, JointFields, NamesFrom, StampFrom, hand_paths, hand_stamp,
};
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::{
    Header, Quaternion, TFMessage, Time, Transform, TransformStamped, Vector3, WireType, definition_text, to_cdr,
};
use tactile_pose_fusion::sim::hand::TERMINAL_POSES;
use tactile_pose_fusion::units::Stamp;

#[derive(Deserialize)]
struct Hand {
    layout: String,
    side: String,
    points: Vec<Point>,
    angles: Vec<f64>,
    /// The points as frames, of some hands.
    #[serde(default)]
    frames: Vec<Frame>,
}

/// A frame in the one of another point.
#[derive(Deserialize)]
struct Frame {
    parent: Option<usize>,
    translation: Point,
    rotation: [f64; 4],
}

/// The hands of tests/python/hand_reference.py.
fn reference() -> Vec<Hand> {
    serde_json::from_str(include_str!("../data/hand_reference.json")).expect("as the script writes it")
}

fn named(layout: &str) -> NamedLayout {
    match layout {
        "openxr" => NamedLayout::OpenXr,
        "openxr25" => NamedLayout::OpenXr25,
        "manus" => NamedLayout::Manus,
        _ => NamedLayout::Mano21,
    }
}

fn side(side: &str) -> Side {
    if side == "left" { Side::Left } else { Side::Right }
}

fn worst(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    // f64::max would pass over NaN.
    found
        .iter()
        .zip(expected)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, |worst, off| if off <= worst { worst } else { off })
}

#[test]
fn random_hands_have_the_angles_that_scipy_made_them_from() {
    for (k, hand) in reference().iter().enumerate() {
        let found = angles(&hand.points, &named(&hand.layout).layout(), side(&hand.side));
        let off = worst(&found, &hand.angles);
        assert!(off < 1e-6, "hand {k}: {off} rad\n{found:?}\n{:?}", hand.angles);
    }
}

#[test]
fn random_frames_in_one_another_have_the_angles_that_scipy_made_them_from() {
    let hands: Vec<Hand> = reference().into_iter().filter(|hand| !hand.frames.is_empty()).collect();
    assert_eq!(hands.len(), 20);
    for (k, hand) in hands.iter().enumerate() {
        let layout = named(&hand.layout);
        let names = layout.points();
        let transform = |(child, frame): (&String, &Frame)| {
            let ([x, y, z], [qx, qy, qz, qw]) = (frame.translation, frame.rotation);
            TransformStamped {
                header: Header {
                    stamp: Time { sec: 7, nanosec: 0 },
                    frame_id: frame.parent.map_or("world", |at| &names[at]).to_owned(),
                },
                child_frame_id: child.clone(),
                transform: Transform {
                    translation: Vector3 { x, y, z },
                    rotation: Quaternion { x: qx, y: qy, z: qz, w: qw },
                },
            }
        };
        let transforms = names.iter().zip(&hand.frames).map(transform).collect();
        let HandPaths { positions, names: names_at, .. } = hand_paths(TFMessage::TYPE_NAME).expect("known");
        let points = HandFields {
            layout: layout.layout(),
            side: side(&hand.side),
            points: names.clone(),
            names: names_at.iter().map(|path| (*path).to_owned()).collect(),
            valid: None,
            first: 0,
            joints: JOINTS.map(str::to_owned).to_vec(),
        };
        let stamp = hand_stamp(TFMessage::TYPE_NAME, &names).map(StampFrom::Field);
        let names = NamesFrom::Hand(Box::new(points));
        let fields = JointFields { stamp, positions: positions.to_owned(), names, only: None };
        let tree = TypeTree::from_schema(TFMessage::TYPE_NAME, &definition_text(TFMessage::TYPE_NAME).expect("known"));
        let mut binding = JointBinding::compile(&fields, &tree.expect("it resolves")).expect("it compiles");
        let found = binding.decode(&to_cdr(&TFMessage { transforms }), Stamp(9)).expect("angles");
        let off = worst(found.positions, &hand.angles);
        assert!(off < 1e-6, "hand {k}: {off} rad");
    }
}

#[test]
fn the_points_of_openxr_are_the_same_without_the_palm() {
    let hand = reference().into_iter().find(|hand| hand.layout == "openxr").expect("there are some");
    let found = angles(&hand.points[1..], &NamedLayout::OpenXr25.layout(), side(&hand.side));
    assert!(worst(&found, &hand.angles) < 1e-6);
    assert_eq!(NamedLayout::OpenXr25.points(), NamedLayout::OpenXr.points()[1..]);
}

fn rotated(of: Point, axis: Point, angle: f64) -> Point {
    let (sin, cos) = angle.sin_cos();
    let dot: f64 = (0..3).map(|k| of[k] * axis[k]).sum();
    let cross =
        [axis[1] * of[2] - axis[2] * of[1], axis[2] * of[0] - axis[0] * of[2], axis[0] * of[1] - axis[1] * of[0]];
    [0, 1, 2].map(|k| of[k] * cos + cross[k] * sin + axis[k] * dot * (1.0 - cos))
}

/// A right hand of mano21 that points along z, its thumb's side along x, its back along y.
fn right_hand(pose: &[f64]) -> Vec<Point> {
    let mut points = vec![[0.0; 3]; 21];
    let mut chain = |first: usize, start: Point, wrist_to: Point, [tip, middle, flexion, abduction]: [f64; 4]| {
        let length = wrist_to.iter().map(|part| part * part).sum::<f64>().sqrt();
        let forward = wrist_to.map(|part| part / length);
        let (back, radial) = ([0.0, 1.0, 0.0], [forward[2], 0.0, -forward[0]]);
        let is_thumb = first == 1;
        let up = rotated(back, radial, flexion);
        let mut bone = rotated(rotated(forward, radial, flexion), up, abduction);
        let hinge = if is_thumb { up.map(|part| -part) } else { rotated(radial, up, abduction) };
        points[first] = start;
        for (k, bend) in [0.0, middle, tip].into_iter().enumerate() {
            bone = rotated(bone, hinge, bend);
            points[first + k + 1] = [0, 1, 2].map(|axis| points[first + k][axis] + 0.03 * bone[axis]);
        }
    };
    let knuckles = [[0.03, 0.0, 0.09], [0.0, 0.0, 0.095], [-0.01, 0.0, 0.09], [-0.03, 0.0, 0.08]];
    for (finger, knuckle) in knuckles.into_iter().enumerate() {
        chain(5 + 4 * finger, knuckle, knuckle, [0, 1, 2, 3].map(|joint| pose[4 * finger + joint]));
    }
    chain(1, [0.02, 0.0, 0.02], knuckles[1], [16, 17, 18, 19].map(|joint| pose[joint]));
    points
}

#[test]
fn the_simulators_poses_come_back_from_their_points_and_a_straight_hand_is_zero() {
    let layout = NamedLayout::Mano21.layout();
    for terminal in TERMINAL_POSES {
        let pose = terminal.pose.angles();
        let off = worst(&angles(&right_hand(&pose), &layout, Side::Right), &pose);
        assert!(off < 1e-9, "{}: {off}", terminal.name);
    }
    assert!(worst(&angles(&right_hand(&[0.0; 20]), &layout, Side::Right), &[0.0; 20]) < 1e-9, "a straight hand");
    assert_eq!(JOINTS, tactile_pose_fusion::sim::hand::JOINTS, "named alike");
}

#[test]
fn a_hand_made_from_angles_gives_them_back_in_every_layout() {
    let layouts = [NamedLayout::OpenXr, NamedLayout::OpenXr25, NamedLayout::Mano21, NamedLayout::Manus];
    for (hand, layout) in reference().iter().zip(layouts.into_iter().cycle()) {
        let made: [f64; 20] = hand.angles.clone().try_into().expect("20 angles");
        for side in [Side::Left, Side::Right] {
            let poses = poses(&made, layout, side);
            assert_eq!(poses.len(), layout.points().len());
            let points: Vec<Point> = poses.iter().map(|pose| pose.position).collect();
            assert!(worst(&angles(&points, &layout.layout(), side), &made) < 1e-9, "{layout:?} {side:?}");
            for pose in &poses {
                let [x, y, z, w] = pose.orientation;
                assert!((x * x + y * y + z * z + w * w - 1.0).abs() < 1e-12, "{pose:?}");
            }
            // -z of a point's orientation is the bone to the next one.
            let chain = layout.layout().fingers[0];
            for bone in chain.windows(2).skip(1) {
                let along = [0, 1, 2].map(|k| points[bone[1]][k] - points[bone[0]][k]);
                let length = along.iter().map(|part| part * part).sum::<f64>().sqrt();
                let minus_z = turned(poses[bone[0]].orientation, [0.0, 0.0, -1.0]);
                assert!((0..3).all(|k| (along[k] / length - minus_z[k]).abs() < 1e-9), "{bone:?} {layout:?} {side:?}");
            }
        }
    }
    let mut without = [0.1; 20];
    without[2] = f64::NAN; // flexion of the index finger's MCP
    let points: Vec<Point> =
        poses(&without, NamedLayout::OpenXr, Side::Right).iter().map(|pose| pose.position).collect();
    let found = angles(&points, &NamedLayout::OpenXr.layout(), Side::Right);
    let known = |joint: &str| !joint.starts_with("index_");
    assert!(JOINTS.iter().zip(found).all(|(joint, angle)| angle.is_finite() == known(joint)), "{found:?}");
}

/// A vector turned by a unit quaternion.
fn turned([x, y, z, w]: [f64; 4], of: Point) -> Point {
    let cross = |a: Point, b: Point| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let vector = [x, y, z];
    let once = cross(vector, of).map(|part| 2.0 * part);
    let twice = cross(vector, once);
    [0, 1, 2].map(|k| of[k] + w * once[k] + twice[k])
}

#[test]
fn what_is_missing_makes_the_angles_that_need_it_nan_and_no_others() {
    let hand = right_hand(&TERMINAL_POSES[2].pose.angles());
    let layout = NamedLayout::Mano21.layout();
    let missing = |points: &[Point]| -> Vec<&str> {
        let found = angles(points, &layout, Side::Right);
        JOINTS.iter().zip(found).filter(|(_, angle)| angle.is_nan()).map(|(name, _)| *name).collect()
    };
    let with = |idx: usize, point: Point| {
        let mut points = hand.clone();
        points[idx] = point;
        missing(&points)
    };
    assert!(missing(&hand).is_empty());
    for bad in [[f64::NAN; 3], [f64::INFINITY, 0.0, 0.0], [1e300; 3], hand[7]] {
        assert_eq!(with(8, bad), ["index_dip"], "the tip is {bad:?}");
    }
    assert_eq!(with(6, hand[5]), ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"]);
    assert_eq!(with(4, [f64::NAN; 3]), ["thumb_ip"]);
    // Without the palm only the thumb's outer joints are left.
    let rest = &JOINTS[..16];
    assert!(with(17, [f64::NAN; 3]).starts_with(rest) && with(17, [f64::NAN; 3]).len() == 18);
    assert_eq!(missing(&[]).len(), 20);
    assert_eq!(missing(&[[0.5; 3]; 21]).len(), 20, "all in one place");
}

fn tree(type_name: &str, text: &str) -> TypeTree {
    let part = |name: &str| {
        Some(match name {
            "geometry_msgs/msg/Pose" => "Point position\nQuaternion orientation\n".to_owned(),
            "geometry_msgs/msg/Point" => "float64 x\nfloat64 y\nfloat64 z\n".to_owned(),
            "geometry_msgs/msg/Quaternion" => "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n".to_owned(),
            "test_msgs/msg/Named" => "string name\ngeometry_msgs/Pose pose\nbool valid\n".to_owned(),
            _ => return None,
        })
    };
    TypeTree::resolve(type_name, text, &mut |name| part(name)).expect("it resolves")
}

fn fields(
    positions: &str,
    layout: &Layout,
    points: Vec<String>,
    side: Side,
    names: &[&str],
    first: usize,
) -> JointFields {
    let hand = HandFields {
        layout: layout.clone(),
        side,
        points,
        names: names.iter().map(|path| (*path).to_owned()).collect(),
        valid: (!names.is_empty()).then(|| "joints[].valid".to_owned()),
        first,
        joints: JOINTS.map(str::to_owned).to_vec(),
    };
    let names = NamesFrom::Hand(Box::new(hand));
    JointFields { stamp: Some(StampFrom::Receipt), positions: positions.to_owned(), names, only: None }
}

#[test]
fn poses_by_index_of_the_second_hand_and_flat_arrays_give_the_same_angles() {
    let hand = &reference()[0];
    let (layout, side) = (named(&hand.layout), side(&hand.side));
    let poses = tree("test_msgs/msg/Poses", "geometry_msgs/Pose[] poses\n");
    let mut writer = CdrWriter::new(true).u32(52);
    for point in hand.points.iter().map(|point| point.map(|part| -part)).chain(hand.points.clone()) {
        writer = point.iter().chain(&[0.0, 0.0, 0.0, 1.0]).fold(writer, |writer, value| writer.f64(*value));
    }
    let by_index = fields("poses[].position", &layout.layout(), layout.points(), side, &[], 26);
    let mut binding = JointBinding::compile(&by_index, &poses).expect("it compiles");
    let message = binding.decode(&writer.cdr, Stamp(9)).expect("angles");
    assert_eq!((message.stamp, message.names.len()), (Stamp(9), 20));
    assert!(worst(message.positions, &hand.angles) < 1e-6);
    assert_eq!(binding.decode(&writer.cdr[..99], Stamp(9)).expect_err("cut off").reason(), "unreadable");

    let flat = tree("test_msgs/msg/Flat", "float64[] data\n");
    let write = |n: usize| {
        let values: Vec<f64> = hand.points.iter().flatten().copied().take(n).collect();
        values.iter().fold(CdrWriter::new(false).u32(n as u32), |writer, value| writer.f64(*value)).cdr
    };
    let by_order = fields("data", &layout.layout(), layout.points(), side, &[], 0);
    let mut binding = JointBinding::compile(&by_order, &flat).expect("it compiles");
    assert!(worst(binding.decode(&write(78), Stamp(9)).expect("angles").positions, &hand.angles) < 1e-6);
    for (n, told) in [(77, "are not three a point"), (63, "holds 21 points where at least 26"), (0, "without values")] {
        let error = binding.decode(&write(n), Stamp(9)).expect_err("a drop").to_string();
        assert!(error.contains(told), "{error}");
    }
}

#[test]
fn named_poses_in_any_order_lose_the_angles_of_those_that_are_not_valid() {
    let hand = &reference()[0];
    let (layout, side) = (named(&hand.layout), side(&hand.side));
    let named_poses = tree("test_msgs/msg/Hand", "Named[] joints\n");
    let names = layout.points();
    let plain = |name: &str| name.to_owned();
    let write = |invalid: &str, unturned: &str, spelt: &dyn Fn(&str) -> String| {
        let mut writer = CdrWriter::new(true).u32(27).text("elbow");
        writer = (0..7).fold(writer, |writer, _| writer.f64(1.0)).u8(1);
        for (name, point) in names.iter().zip(&hand.points).rev() {
            let w = if name == unturned { 0.0 } else { 1.0 };
            let values = point.iter().chain(&[0.0, 0.0, 0.0]).copied().chain([w]);
            writer =
                values.fold(writer.text(&spelt(name)), |writer, value| writer.f64(value)).u8(u8::from(name != invalid));
        }
        writer.cdr
    };
    let by_name = fields("joints[].pose.position", &layout.layout(), names.clone(), side, &["joints[].name"], 0);
    let mut binding = JointBinding::compile(&by_name, &named_poses).expect("it compiles");
    assert!(worst(binding.decode(&write("", "", &plain), Stamp(9)).expect("angles").positions, &hand.angles) < 1e-6);
    let of_openxr = write("", "", &|name| format!("XR_HAND_JOINT_{}_EXT", name.to_uppercase()));
    assert!(worst(binding.decode(&of_openxr, Stamp(9)).expect("angles").positions, &hand.angles) < 1e-6);
    let lost = write("index_tip", "middle_tip", &plain);
    let message = binding.decode(&lost, Stamp(9)).expect("angles");
    let nan: Vec<&str> = message
        .names
        .iter()
        .zip(message.positions)
        .filter(|(_, angle)| angle.is_nan())
        .map(|(name, _)| name.as_str())
        .collect();
    assert_eq!(nan, ["index_dip", "middle_dip"]);
}

#[test]
fn transforms_are_chained_and_complete_with_the_last_point_of_the_hand() {
    let hand = &reference()[0];
    let (layout, side) = (named(&hand.layout), side(&hand.side));
    let text = "geometry_msgs/TransformStamped[] transforms\n";
    let tree = TypeTree::resolve("tf2_msgs/msg/TFMessage", text, &mut |name| {
        Some(match name {
            "geometry_msgs/msg/TransformStamped" => {
                "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n".to_owned()
            }
            "geometry_msgs/msg/Transform" => "Vector3 translation\nQuaternion rotation\n".to_owned(),
            other => return tactile_pose_fusion::msg::standard_text(other).map(str::to_owned),
        })
    })
    .expect("it resolves");
    // Each point in the one before it of its finger, and every frame turned by half a turn about x on the way.
    let names = layout.points();
    let finger = |name: &str| name.split('_').next().unwrap_or_default().to_owned();
    let parent = |k: usize| (k > 0 && finger(&names[k - 1]) == finger(&names[k])).then(|| k - 1);
    let depth = |k: usize| {
        let mut depth = 1;
        let mut at = k;
        while let Some(before) = parent(at) {
            (depth, at) = (depth + 1, before);
        }
        depth
    };
    let turn = |[x, y, z]: [f64; 3], times: usize| if times.is_multiple_of(2) { [x, y, z] } else { [x, -y, -z] };
    let write = |points: &[usize], sec: u32| {
        let mut writer = CdrWriter::new(true).u32(points.len() as u32);
        for &k in points {
            let point = hand.points[k];
            let (from, frame, times) = match parent(k) {
                Some(before) => (hand.points[before], names[before].as_str(), depth(before)),
                None => ([0.0; 3], "world", 0),
            };
            let translation = turn(std::array::from_fn(|axis| point[axis] - from[axis]), times);
            writer = writer.u32(sec).u32(0).text(frame).text(&names[k]);
            writer = translation.iter().chain(&[1.0, 0.0, 0.0, 0.0]).fold(writer, |writer, value| writer.f64(*value));
        }
        writer.cdr
    };
    let of_tf = |stamp: Option<StampFrom>| {
        let HandPaths { positions, names: names_at, .. } = hand_paths("tf2_msgs/msg/TFMessage").expect("known");
        let fields = fields(positions, &layout.layout(), names.clone(), side, &[], 0);
        let NamesFrom::Hand(mut points) = fields.names.clone() else { panic!("a hand") };
        points.names = names_at.iter().map(|path| (*path).to_owned()).collect();
        let fields = JointFields { stamp: stamp.or(fields.stamp), names: NamesFrom::Hand(points), ..fields };
        JointBinding::compile(&fields, &tree).expect("it compiles")
    };
    let stamp = hand_stamp("tf2_msgs/msg/TFMessage", &names).expect("known");
    let all: Vec<usize> = (0..names.len()).collect();
    let mut binding = of_tf(Some(StampFrom::Field(stamp)));
    let whole = write(&all, 7);
    let message = binding.decode(&whole, Stamp(9)).expect("angles");
    assert_eq!(message.stamp, Stamp(7_000_000_000));
    assert!(worst(message.positions, &hand.angles) < 1e-6);

    let mut binding = of_tf(None);
    for half in [&all[..10], &all[10..20]] {
        let error = binding.decode(&write(half, 1), Stamp(9)).expect_err("there is more to come");
        assert!(error.is_for_another(), "{error}");
    }
    let last = write(&all[20..], 1);
    assert!(worst(binding.decode(&last, Stamp(9)).expect("complete").positions, &hand.angles) < 1e-6);
    for _ in 0..20 {
        binding.decode(&last, Stamp(9)).expect("the little finger alone");
    }
    let lost = binding.decode(&last, Stamp(9)).expect("the little finger alone");
    assert!(lost.positions[0].is_nan(), "an index finger that is not told any more");
}
