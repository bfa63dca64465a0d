//! Parameter files are read as rcl reads them, and what is refused is refused in one clear line.

use proptest::prelude::*;
use tactile_pose_fusion::config::{
    Config, DEFAULT_NODE, Origin, ParamTree, ParamValue, parse_param_file, parse_param_files,
};

const NODE: &str = "/ns/node2";

fn read(text: &str) -> Result<ParamTree, String> {
    parse_param_file(text, "p.yaml", NODE).map_err(|e| e.to_string())
}

fn value(text: &str, key: &str) -> ParamValue {
    read(text).unwrap().get(key).unwrap().value.clone()
}

/// Each of these was read by rcl 10.1 (Kilted) through rclpy.
#[test]
fn sections_apply_in_file_order_whatever_their_kind() {
    let specific_first = "/ns/node2:\n  ros__parameters: {x: 1}\n/**:\n  ros__parameters: {x: 2}\n";
    assert_eq!(value(specific_first, "x"), ParamValue::Int(2));
    let wild_first = "/**:\n  ros__parameters: {x: 2}\n/ns/node2:\n  ros__parameters: {x: 1}\n";
    assert_eq!(value(wild_first, "x"), ParamValue::Int(1));
}

#[test]
fn namespaces_nest_or_stand_in_the_name() {
    for text in [
        "/**:\n  node2:\n    ros__parameters: {x: 2}\n",
        "/ns:\n  node2:\n    ros__parameters: {x: 2}\n",
        "ns:\n  node2:\n    ros__parameters: {x: 2}\n",
        "ns/node2:\n  ros__parameters: {x: 2}\n",
        "/:\n  ns/node2:\n    ros__parameters: {x: 2}\n",
        "\"*\":\n  \"*\":\n    ros__parameters: {x: 2}\n",
        "/other:\n  ros__parameters: {x: 1}\n---\n/ns/node2:\n  ros__parameters: {x: 2}\n",
    ] {
        assert_eq!(value(text, "x"), ParamValue::Int(2), "{text}");
    }
}

#[test]
fn a_section_said_again_keeps_its_first_place() {
    // As rcl does: the second file's `/**` joins the first one's, so `/ns/node2` still comes after it.
    let first = "/**:\n  ros__parameters: {x: 1, y: 1}\n/ns/node2:\n  ros__parameters: {x: 2}\n";
    let second = "/**:\n  ros__parameters: {x: 3, y: 3}\n";
    let tree = parse_param_files(&[(first, "a.yaml"), (second, "b.yaml")], NODE).unwrap();
    assert_eq!(tree.get("x").unwrap().value, ParamValue::Int(2));
    assert_eq!(tree.get("y").unwrap().value, ParamValue::Int(3));
    assert_eq!(tree.get("y").unwrap().origin, Origin::File { file: "b.yaml".into(), line: 2, any_node: true });
    assert_eq!(tree.files(), "a.yaml, b.yaml");
}

#[test]
fn nested_maps_and_dotted_keys_are_the_same() {
    let tree = read("/**:\n  ros__parameters:\n    a:\n      b.c: 1\n      d: [x, 'y']\n    e.f: yes\n").unwrap();
    let keys: Vec<&str> = tree.iter().map(|(key, _)| key).collect();
    assert_eq!(keys, ["a.b.c", "a.d", "e.f"]);
    assert_eq!(tree.get("a.d").unwrap().value, ParamValue::StrArray(vec!["x".into(), "y".into()]));
    assert_eq!(tree.get("e.f").unwrap().value, ParamValue::Bool(true));
    assert_eq!(tree.get("e.f").unwrap().origin.to_string(), "p.yaml:6");
}

#[test]
fn arrays_have_one_type_and_may_be_empty_or_in_block_style() {
    let array = |text: &str| value(&format!("/**:\n  ros__parameters:\n    x: {text}\n"), "x");
    assert_eq!(array("[1, 0x10]"), ParamValue::IntArray(vec![1, 16]));
    assert_eq!(array("[1.0, .5]"), ParamValue::DoubleArray(vec![1.0, 0.5]));
    assert_eq!(array("[yes, off]"), ParamValue::BoolArray(vec![true, false]));
    assert_eq!(array("[]"), ParamValue::EmptyArray);
    assert_eq!(array("\n      - 1\n      - 2"), ParamValue::IntArray(vec![1, 2]));
}

#[test]
fn each_malformed_file_is_refused_with_its_line_and_reason() {
    let param = |text: &str| format!("/**:\n  ros__parameters:\n    {text}\n");
    let table = [
        (
            param("x: [1, 2.0]"),
            "p.yaml:3: x is not an array of one type: element 0 is int, element 1 is double; write every number with a decimal point",
        ),
        (
            param("x: [a, 2]"),
            "p.yaml:3: x is not an array of one type: element 0 is string, element 1 is int; put each text in quotes",
        ),
        (param("x: [true, 2]"), "p.yaml:3: x is not an array of one type: element 0 is bool, element 1 is int"),
        (param("x: [[1], [2]]"), "p.yaml:3: x is not an array of one type: element 0 is not a scalar"),
        (param("x: [a, ~]"), "p.yaml:3: x is not an array of one type: element 1 has no value"),
        (param("x: null"), "p.yaml:3: x has no value: give it one, or remove the key"),
        (param("x: ~"), "p.yaml:3: x has no value: give it one, or remove the key"),
        (param("x:"), "p.yaml:3: x has no value: give it one, or remove the key"),
        (param("x: {}"), "p.yaml:3: x has no value: give it one, or remove the key"),
        (param("a.b: 1\n    a:\n      b: 2"), "p.yaml:5: a.b was already set in line 3: keep one of them"),
        (param("x: 1\n    x: 2"), "p.yaml:4: not a parameter file: duplicated key in mapping"),
        (
            param("a: &q 5\n    b: *q"),
            "p.yaml:3: not a parameter file: anchors (`&name`) are not supported, since no alias could use them: remove it",
        ),
        (
            param("a: !!str 5"),
            "p.yaml:3: not a parameter file: tags (`!name`) are not supported: write the plain value, in quotes if it is text",
        ),
        (
            param("a: !mine 5"),
            "p.yaml:3: not a parameter file: tags (`!name`) are not supported: write the plain value, in quotes if it is text",
        ),
        (param("? [a]\n    : 1"), "p.yaml:3: not a parameter file: a key must be a name, not a mapping or a sequence"),
        (param("'': 1"), "p.yaml:3: not a parameter file: a key must not be empty"),
        (
            "/**:\n  x: 1\n".into(),
            "p.yaml:2: `/**/x` has no `ros__parameters:` (two underscores) below it: write the parameters below that key",
        ),
        (
            "/**:\n".into(),
            "p.yaml:1: `/**` has no `ros__parameters:` (two underscores) below it: write the parameters below that key",
        ),
        (
            "/**:\n  ros_parameters:\n    x: 1\n".into(),
            "p.yaml:3: `/**/ros_parameters/x` has no `ros__parameters:` (two underscores) below it: write the parameters below that key",
        ),
        (
            "/**:\n  ros__parameters: 5\n".into(),
            "p.yaml:2: not a parameter file: `ros__parameters:` must be followed by keys and values",
        ),
        (
            "ros__parameters:\n  x: 1\n".into(),
            "p.yaml:1: not a parameter file: `ros__parameters:` needs the name of a node above it",
        ),
        (
            "- 1\n".into(),
            "p.yaml:1: not a parameter file: expected a node name, then `ros__parameters:`, then parameters",
        ),
        (
            "/ns/no*:\n  ros__parameters: {x: 1}\n".into(),
            "p.yaml:2: `/ns/no*` is not a valid node name: '*' and '**' stand for whole names, not for parts of one",
        ),
        (
            "ns:\n  /node2:\n    ros__parameters: {x: 1}\n".into(),
            "p.yaml:3: `ns//node2` is not a valid node name: it must not be empty or hold '//'",
        ),
        (
            "".into(),
            "p.yaml: no parameters for the node /ns/node2: the file has no node at all; put them under `/**` for a node of any name, or under `/ns/node2` for this one only",
        ),
        (
            "/a:\n  ros__parameters: {x: 1}\nb:\n  ros__parameters: {x: 1}\n".into(),
            "p.yaml: no parameters for the node /ns/node2: the file has parameters for /a, b; put them under `/**` for a node of any name, or under `/ns/node2` for this one only",
        ),
    ];
    for (text, message) in table {
        assert_eq!(read(&text).unwrap_err(), message, "{text}");
    }
}

#[test]
fn overrides_win_over_every_section() {
    let mut tree = read("/**:\n  ros__parameters: {x: 1}\n/ns/node2:\n  ros__parameters: {x: 2}\n").unwrap();
    for (rule, key, set) in [
        ("x:=5", "x", ParamValue::Int(5)),
        ("x:= 5", "x", ParamValue::Int(5)),
        ("x:=\"5\"", "x", ParamValue::Str("5".into())),
        ("x:=true", "x", ParamValue::Bool(true)),
        ("x:=a b", "x", ParamValue::Str("a b".into())),
        ("x:=hello # comment", "x", ParamValue::Str("hello".into())),
        ("x:=a:b", "x", ParamValue::Str("a:b".into())),
        ("x:=1:=2", "x", ParamValue::Str("1:=2".into())),
        ("x:=/foo/bar", "x", ParamValue::Str("/foo/bar".into())),
        ("x:=~/bar", "x", ParamValue::Str("~/bar".into())),
        ("x:=\"\"", "x", ParamValue::Str(String::new())),
        ("x:=[1,2]", "x", ParamValue::IntArray(vec![1, 2])),
        ("x:=- 5", "x", ParamValue::IntArray(vec![5])),
        ("x:=[]", "x", ParamValue::EmptyArray),
        ("a.b:=0.5", "a.b", ParamValue::Double(0.5)),
    ] {
        assert_eq!(tree.set_override(rule), Ok(true), "{rule}");
        assert_eq!(tree.get(key).unwrap().value, set, "{rule}");
        assert_eq!(tree.get(key).unwrap().origin, Origin::CommandLine);
    }
}

#[test]
fn an_override_for_another_node_is_left_alone() {
    let mut tree = ParamTree::empty(DEFAULT_NODE);
    assert_eq!(tree.set_override("other:x:=1"), Ok(false));
    assert!(tree.get("x").is_none());
    assert_eq!(tree.set_override("tactile_pose_fusion:x:=1"), Ok(true));
    assert!(tree.get("x").is_some());
}

#[test]
fn an_override_can_name_a_topic() {
    let mut tree = ParamTree::empty(DEFAULT_NODE);
    let key = "qos_overrides./glove/taxels.subscription.depth";
    assert_eq!(tree.set_override(&format!("{key}:=5")), Ok(true));
    assert!(tree.get(key).is_some());
}

#[test]
fn each_malformed_override_is_refused_with_its_reason() {
    let mut tree = ParamTree::empty(DEFAULT_NODE);
    let keys = "a key is made of letters, digits, '_' and '/', with '.' between its parts";
    for (rule, reason) in [
        ("x=5", "expected key:=value"),
        ("x:=", "it has no value; write key:=\"\" for empty text"),
        ("x:=null", "a value is a scalar or a list of scalars, and not null"),
        ("x:={a: 1}", "a value is a scalar or a list of scalars, and not null"),
        ("x:=[1,2.0]", "element 0 is int, element 1 is double; write every number with a decimal point"),
        ("use-x:=1", keys),
        ("x :=1", keys),
        ("x.:=1", keys),
        ("x..y:=1", keys),
        ("x.1/a:=1", keys),
        ("~x:=1", keys),
        (":=1", keys),
        ("/ns/node2:x:=1", "the node before ':' must be a name without '/'"),
    ] {
        let message = format!("command line: `-p {rule}` is not an override: {reason}");
        assert_eq!(tree.set_override(rule).unwrap_err().to_string(), message);
    }
    assert_eq!(tree, ParamTree::empty(DEFAULT_NODE));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_text_is_read_or_refused_in_one_line(text in "\\PC*|[-a-z0-9 :\\n\\[\\]{}'\"#&*!|>?,.%@`~/]{0,200}") {
        if let Err(e) = read(&text) {
            prop_assert!(!e.contains('\n'), "{}", e);
        }
        let mut tree = ParamTree::empty(DEFAULT_NODE);
        let _ = tree.set_override(&format!("x:={text}"));
        let _ = tree.set_override(&text);
    }

    #[test]
    fn any_parameters_are_taken_or_refused_in_one_line(
        keys in prop::collection::vec((0..12usize, "[-a-z0-9 .\\[\\],'\"]{0,12}"), 0..8)
    ) {
        let known = ["regions", "tactile_sources", "joint_sources", "contact.force_on", "contact.on_frames", "glove",
            "region.index.taxels", "region.index.normal", "tactile.glove.n_taxels", "tactile.glove.rows", "model.a.path", "x"];
        let mut text = String::from("/**:\n  ros__parameters:\n    user: me\n");
        for (idx, value) in keys {
            text.push_str(&format!("    {}: {value}\n", known[idx]));
        }
        let refused = read(&text).and_then(|tree| Config::from_tree(&tree).map_err(|e| e.to_string()));
        if let Err(e) = refused {
            prop_assert!(!e.contains('\n'), "{}", e);
        }
    }

    #[test]
    fn a_broken_example_is_read_or_refused_in_one_line(at in 0..8000usize, len in 0..40usize, new in "[-a-z0-9 :\\n\\[\\]{}'\"#.]{0,6}") {
        let mut text = include_str!("../../params/example.yaml").to_owned();
        let start = at.min(text.len());
        let end = (start + len).min(text.len());
        prop_assume!(text.is_char_boundary(start) && text.is_char_boundary(end));
        text.replace_range(start..end, &new);
        let refused = parse_param_file(&text, "p.yaml", DEFAULT_NODE)
            .map_err(|e| e.to_string())
            .and_then(|tree| Config::from_tree(&tree).map_err(|e| e.to_string()));
        if let Err(e) = refused {
            prop_assert!(!e.contains('\n'), "{}", e);
        }
    }
}
