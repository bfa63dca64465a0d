//! Texts of message definitions.

use tactile_pose_fusion::msg::definition::{MessageDefinition, TypeTree};
use tactile_pose_fusion::msg::dynamic::{FieldPlan, ReadAs, numeric_paths};
use tactile_pose_fusion::msg::{definition_text, type_hash};

use super::driver::{Answer, Target};
use super::msg_common::read_all_ways;
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "definition", seeds, mutate: other, run, min_understood: 0.2 };

const WORDS: [&str; 46] = [
    "int32",
    "float64",
    "string",
    "wstring",
    "string<=",
    "<=",
    "bool",
    "byte",
    "char",
    "uint8",
    "T",
    "Header",
    "time",
    "duration",
    "std_msgs/Header",
    "p/T",
    "p/msg/T",
    "geometry_msgs/Vector3",
    "[]",
    "[<=",
    "[<=3]",
    "[3]",
    "[0]",
    "[4294967295]",
    "[4294967296]",
    "4294967295",
    "=",
    "=1",
    "= \"x\"",
    "#",
    "\"",
    "'",
    "\\",
    "---",
    "MSG: p/T",
    "MSG: p/msg/U",
    "SRV: p/A",
    "IDL: p/A",
    "================================================================================",
    "x",
    "@",
    "\u{e9}",
    "\u{feff}",
    "\r",
    "[1, 2",
    "\u{2028}",
];

fn seeds() -> Vec<Vec<u8>> {
    let ours = [
        "tactile_pose_fusion/msg/TaxelArray",
        "tactile_pose_fusion/msg/ContactArray",
        "sensor_msgs/msg/JointState",
        "geometry_msgs/msg/WrenchStamped",
        "std_msgs/msg/Float32MultiArray",
    ];
    let mut texts: Vec<String> = ours.iter().map(|name| definition_text(name).unwrap()).collect();
    let bar = "=".repeat(80);
    texts.push(
        "int32 A=1\nstring B=\"b # c\"\nfloat64[3] d [1, 2, 3]\nstring<=4[<=2] e\nwstring f \"x\"\nbool g true\n"
            .into(),
    );
    texts.push(format!("U[2] a\nU[] b\n{bar}\nMSG: p/U\nV[4] c\nV d\n{bar}\nMSG: p/V\nuint8 x\nfloat32[] y\n"));
    // Every type twice in the one before: a tree of 2^n fields.
    let doubling: Vec<String> = (0..24).map(|n| format!("{bar}\nMSG: p/D{n}\nD{0} a\nD{0} b\n", n + 1)).collect();
    texts.push(format!("D0 a\n{}{bar}\nMSG: p/D24\nint8 x\n", doubling.concat()));
    texts.push("int32 a\n---\nint32 b\n".into());
    texts.into_iter().map(String::into_bytes).collect()
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    mutate::text(random, seed, other, &WORDS)
}

fn run(input: &[u8]) -> Answer {
    let text = String::from_utf8_lossy(input);
    if let Err(error) = MessageDefinition::parse("p/msg/T", &text) {
        super::one_line(&error);
    }
    if let Ok(tree) = TypeTree::from_schema("p/srv/T_Event", &text) {
        type_hash(&tree);
    }
    let tree = match TypeTree::from_schema("p/msg/T", &text) {
        Ok(tree) => tree,
        Err(error) => return super::one_line(&error),
    };
    let paths = numeric_paths(&tree);
    for field in paths.iter().step_by(1 + paths.len() / 128) {
        FieldPlan::compile(&tree, &field.path, ReadAs::Numbers).expect("a listed path compiles");
    }
    for cdr in [&[0, 1, 0, 0][..], &[0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], &[0, 1, 0, 0, 3, 0, 0, 0, 1, 1, 1, 1, 1]] {
        let _ = read_all_ways(&tree, cdr);
    }
    type_hash(&tree);
    let root = tree.root();
    let kinds: Vec<_> = root.fields.iter().map(|field| (field.ty.to_string(), field.default.is_some())).collect();
    Answer::understood(&(paths.len().min(32), kinds, root.constants.len(), tree.dependencies().count()))
}
