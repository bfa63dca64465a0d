//! Messages of any type, read by its definition in every way there is.

use std::sync::OnceLock;

use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::*;

use super::driver::{Answer, Target};
use super::msg_common::{CdrWriter, read_all_ways};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "cdr", seeds, mutate: other, run, min_understood: 0.2 };

/// A type with everything that a definition can ask for.
const ODD: &str = "bool a\nwstring b\nstring<=4 c\nint8[3] d\nuint64[<=2] e\nInner[] f\nInner[2] g\nbuiltin_interfaces/Time h\n\
                   float64[] i\nwstring[] j\nEmpty[] k\nfloat32[4294967295] l\n\
                   ================================================================================\nMSG: p/Inner\n\
                   string[] names\nfloat32[] values\nDeep[<=3] deep\n\
                   ================================================================================\nMSG: p/Deep\nuint16 x\nuint8[] y\n\
                   ================================================================================\nMSG: p/Empty\n\
                   ================================================================================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

/// The types, each by the first byte of an input.
fn trees() -> &'static [TypeTree] {
    static TREES: OnceLock<Vec<TypeTree>> = OnceLock::new();
    TREES.get_or_init(|| {
        let ours = [
            "tactile_pose_fusion/msg/TaxelArray",
            "tactile_pose_fusion/msg/ContactArray",
            "tactile_pose_fusion/msg/Stage",
            "geometry_msgs/msg/WrenchStamped",
            "sensor_msgs/msg/JointState",
            "std_msgs/msg/Float32MultiArray",
        ];
        let mut trees: Vec<TypeTree> =
            ours.iter().map(|name| TypeTree::from_schema(name, &definition_text(name).unwrap()).unwrap()).collect();
        let odd = ODD.replace("float32[4294967295] l\n", "");
        trees.push(TypeTree::from_schema("p/msg/Odd", &odd).unwrap());
        trees.push(TypeTree::from_schema("p/msg/Odd", ODD).unwrap());
        trees
    })
}

fn seeds() -> Vec<Vec<u8>> {
    let header = || Header { stamp: Time { sec: 5, nanosec: 6 }, frame_id: "hand".to_owned() };
    let row_period = Duration { sec: 0, nanosec: 1 };
    let taxels = TaxelArray { header: header(), sequence: 7, rows: 2, row_period, values: vec![0.5; 8] };
    let names = ["index_mcp", "index_pip", "thumb"].map(str::to_owned).to_vec();
    let joints =
        JointState { header: header(), name: names, position: vec![0.1; 3], velocity: vec![1.0; 3], effort: vec![] };
    let contacts = ContactArray { header: header(), contacts: vec![ContactState::default(); 2] };
    let stage = Stage { header: header(), substage: "tap".to_owned(), ..Stage::default() };
    let numbers = Float32MultiArray { layout: MultiArrayLayout::default(), data: vec![1.0; 5] };
    let messages = [
        to_cdr(&taxels),
        to_cdr(&contacts),
        to_cdr(&stage),
        to_cdr(&WrenchStamped::default()),
        to_cdr(&joints),
        to_cdr(&numbers),
        odd(true),
    ];
    let mut seeds: Vec<Vec<u8>> =
        messages.into_iter().enumerate().map(|(idx, cdr)| [vec![idx as u8], cdr].concat()).collect();
    seeds.push([vec![6], odd(false)].concat());
    seeds.push([vec![7], odd(true)].concat());
    seeds
}

fn odd(little_endian: bool) -> Vec<u8> {
    let inner = |writer: CdrWriter| writer.u32(1).text("n").u32(1).f32(0.5).u32(1).u16(3).u32(2).u8(1).u8(2);
    let writer = CdrWriter::new(little_endian).u8(1).u32(1).u16(u16::from(b'w')).text("abc").u8(1).u8(2).u8(3);
    let writer = inner(inner(inner(writer.u32(1).bytes(9u64.to_le_bytes()).u32(1))));
    writer.u32(5).u32(6).u32(1).f64(0.25).u32(1).u32(1).u16(u16::from(b'j')).u32(2).u8(0).u8(0).cdr
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut input = seed.to_vec();
    let first = input.first().copied().unwrap_or_default();
    mutate::bytes(random, &mut input, other);
    // Most often of the same type: one that its bytes fit.
    if let (true, Some(kind)) = (random.percent(90), input.first_mut()) {
        *kind = first;
    }
    input
}

fn run(input: &[u8]) -> Answer {
    let Some((kind, cdr)) = input.split_first() else { return Answer::refused("empty") };
    let trees = trees();
    let tree = &trees[usize::from(*kind) % trees.len()];
    match read_all_ways(tree, cdr) {
        Ok(n_leaves) => Answer::understood(&(kind, n_leaves.min(64))),
        Err(error) => super::one_line(&error),
    }
}
