//! Bytes and texts that nobody meant never panic, and never take memory that they don't hold.

use crate::msg_common;

use msg_common::read_all_ways;
use proptest::prelude::*;
use tactile_pose_fusion::msg::definition::{MessageDefinition, TypeTree};
use tactile_pose_fusion::msg::dynamic::{FieldPlan, ReadAs, numeric_paths, read_value};
use tactile_pose_fusion::msg::*;

const TYPES: [&str; 6] = [
    "tactile_pose_fusion/msg/TaxelArray",
    "tactile_pose_fusion/msg/ContactArray",
    "tactile_pose_fusion/msg/Stage",
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Float32MultiArray",
];

fn tree(type_name: &str) -> TypeTree {
    TypeTree::from_schema(type_name, &definition_text(type_name).expect("ours")).expect("it resolves")
}

fn joint_state() -> JointState {
    JointState {
        header: Header { stamp: Time { sec: 5, nanosec: 6 }, frame_id: "hand".to_owned() },
        name: ["index_mcp", "index_pip", "thumb"].map(str::to_owned).to_vec(),
        position: vec![0.1, 0.2, 0.3],
        velocity: vec![1.0; 3],
        effort: vec![],
    }
}

fn taxel_array() -> TaxelArray {
    TaxelArray { rows: 2, row_period: Duration { sec: 0, nanosec: 1 }, values: vec![0.5; 8], ..Default::default() }
}

/// Parts of `.msg` lines, so that random texts get past the first word.
fn fragment() -> impl Strategy<Value = String> {
    let words = [
        "int32",
        "float64",
        "string",
        "wstring",
        "string<=",
        "T",
        "Header",
        "std_msgs/Header",
        "time",
        "[",
        "]",
        "[]",
        "[<=",
        "[3]",
        "4294967295",
        "0",
        " ",
        "\t",
        "\n",
        "=",
        "#",
        "\"",
        "'",
        "\\",
        "---",
        "MSG: p/T",
        "SRV: p/A",
        "x",
        "Y",
        "@",
        "\u{e9}",
        "\u{feff}",
        ",",
        "-",
    ];
    prop_oneof![
        prop::sample::select(words.to_vec()).prop_map(str::to_owned),
        Just("\n".to_owned()),
        Just(format!("\n{}\n", "=".repeat(80))),
        Just("int32 a\n".to_owned()),
        "[ -~]{0,6}",
    ]
}

proptest! {
    #[test]
    fn random_bytes_are_read_or_refused(
        type_name in prop::sample::select(TYPES.to_vec()),
        header in prop::sample::select(vec![[0, 1, 0, 0], [0, 0, 0, 0], [0, 7, 0, 0]]),
        body in prop::collection::vec(prop_oneof![3 => Just(0_u8), 2 => 0..5_u8, 1 => any::<u8>()], 0..300),
    ) {
        let cdr: Vec<u8> = header.into_iter().chain(body).collect();
        let _ = read_all_ways(&tree(type_name), &cdr);
    }

    #[test]
    fn altered_messages_are_read_or_refused(at in 0..200_usize, byte in any::<u8>(), len in 0..200_usize) {
        for (type_name, mut cdr) in [
            (JointState::TYPE_NAME, to_cdr(&joint_state())),
            (TaxelArray::TYPE_NAME, to_cdr(&taxel_array())),
        ] {
            let at = at % cdr.len();
            cdr[at] = byte;
            let _ = read_all_ways(&tree(type_name), &cdr);
            cdr.truncate(len);
            let _ = read_all_ways(&tree(type_name), &cdr);
        }
    }

    #[test]
    fn random_texts_resolve_or_are_refused(parts in prop::collection::vec(fragment(), 0..40)) {
        let text: String = parts.concat();
        for type_name in ["p/msg/T", "p/srv/T_Event"] {
            if let Ok(tree) = TypeTree::from_schema(type_name, &text) {
                let paths = numeric_paths(&tree);
                for field in &paths {
                    FieldPlan::compile(&tree, &field.path, ReadAs::Numbers).expect("a listed path compiles");
                }
                let _ = read_value(&tree, &[0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
                type_hash(&tree);
            }
        }
        let _ = MessageDefinition::parse("p/msg/T", &text);
    }

    #[test]
    fn random_paths_compile_or_are_refused(path in "[a-z_.\\[\\]0-9]{0,24}") {
        let _ = FieldPlan::compile(&tree("sensor_msgs/msg/JointState"), &path, ReadAs::Numbers);
    }
}

#[test]
fn a_message_cut_off_anywhere_is_refused_where_its_last_field_is_wanted() {
    let cdr = to_cdr(&joint_state());
    let tree = tree(JointState::TYPE_NAME);
    let effort = FieldPlan::compile(&tree, "effort", ReadAs::Numbers).expect("it compiles");
    assert_eq!(effort.read_f64(&cdr, &mut vec![]), Ok(0));
    for len in 0..cdr.len() {
        assert!(effort.read_f64(&cdr[..len], &mut vec![]).is_err(), "{len} of {} bytes", cdr.len());
        assert!(read_value(&tree, &cdr[..len]).is_err());
    }
}

#[test]
fn lengths_that_lie_take_no_memory() {
    let text = "T2[] a\nT2[4294967295] b\nstring[] c\nfloat64[4294967295] d\nT2[] e\n".to_owned();
    let tree = TypeTree::resolve("p/msg/T", &text, &mut |_| Some("int8 x\n".to_owned())).expect("it resolves");
    let lying = [0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 1, 2, 3];
    let honest = [0, 1, 0, 0, 0, 0, 0, 0, 1, 2, 3];
    for cdr in [lying.as_slice(), honest.as_slice()] {
        assert!(read_value(&tree, cdr).is_err());
        for path in ["a[].x", "b[].x", "b[4294967294].x", "d", "e[].x"] {
            let plan = FieldPlan::compile(&tree, path, ReadAs::Numbers).expect(path);
            let mut out: Vec<f64> = vec![];
            assert_eq!(plan.read_f64(cdr, &mut out).is_ok(), cdr == honest && path.starts_with('a'), "{path}");
            assert!(out.capacity() < 16);
        }
        let texts = FieldPlan::compile(&tree, "c", ReadAs::Texts).expect("it compiles");
        assert!(texts.read_texts(cdr, &mut vec![]).is_err());
    }
}
