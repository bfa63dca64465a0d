//! Any message is read by its definition, of either byte order.

use crate::msg_common;

use msg_common::CdrWriter;
use tactile_pose_fusion::msg::CdrError;
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::dynamic::{FieldError, FieldPlan, ReadAs, numeric_paths};
use tactile_pose_fusion::units::Stamp;

/// A glove as an array of structs, with fields of every size out of step with each other.
const GLOVE: &str = "\
uint8 side
builtin_interfaces/Time stamp
string serial
builtin_interfaces/Duration period
Empty nothing
Finger[] fingers
Finger[2] thumbs
bool[3] valid
int16[] raw
float32 scale
int64 offset
string[] notes
float64 last
================================================================================
MSG: pkg/Empty
uint8 ONLY_A_CONSTANT=1
================================================================================
MSG: pkg/Finger
string name
uint8 id
float64 pressure
uint16[] taxels
Pad pad
================================================================================
MSG: pkg/Pad
int8 a
float32[2] temperature
";

fn glove() -> TypeTree {
    TypeTree::from_schema("pkg/msg/Glove", GLOVE).expect("it resolves")
}

fn finger(writer: CdrWriter, name: &str, pressure: f64, taxels: &[u16]) -> CdrWriter {
    let mut writer = writer.text(name).u8(7).f64(pressure).u32(taxels.len() as u32);
    for taxel in taxels {
        writer = writer.u16(*taxel);
    }
    writer.u8(0xff).f32(pressure as f32 + 0.5).f32(-1.0)
}

fn message(little_endian: bool) -> Vec<u8> {
    let mut writer = CdrWriter::new(little_endian).u8(1).u32(12).u32(34).text("sn-1").u32(u32::MAX).u32(999_999_000);
    writer = writer.u8(0).u32(3);
    writer = finger(writer, "index", 1.0, &[1, 2, 3]);
    writer = finger(writer, "ring", 2.0, &[]);
    writer = finger(writer, "little one", 3.0, &[65535]);
    writer = finger(writer, "left", 4.0, &[10, 11]);
    writer = finger(writer, "right", 5.0, &[12]);
    writer = writer.u8(1).u8(0).u8(2).u32(2).u16(-5_i16 as u16).u16(6).f32(0.25);
    writer = writer.bytes((-9_i64).to_le_bytes()).u32(2).text("first").text("").f64(6.5);
    writer.cdr
}

fn numbers(path: &str) -> Vec<f64> {
    let plan = FieldPlan::compile(&glove(), path, ReadAs::Numbers).expect(path);
    let [little, big] = [true, false].map(|little_endian| {
        let (mut double, mut single) = (vec![], vec![]);
        plan.read_f64(&message(little_endian), &mut double).expect(path);
        plan.read_f32(&message(little_endian), &mut single).expect(path);
        let widened: Vec<f64> = single.into_iter().map(f64::from).collect();
        assert_eq!(double, widened, "{path}: every number of the test fits single precision");
        double
    });
    assert_eq!(little, big, "{path}");
    little
}

fn refused(path: &str, read_as: ReadAs) -> String {
    FieldPlan::compile(&glove(), path, read_as).expect_err(path).to_string()
}

#[test]
fn numbers_are_found_behind_whatever_stands_before_them() {
    assert_eq!(numbers("side"), [1.0]);
    assert_eq!(numbers("fingers[0].taxels"), [1.0, 2.0, 3.0]);
    assert_eq!(numbers("fingers[1].taxels"), Vec::<f64>::new());
    assert_eq!(numbers("fingers[2].taxels[0]"), [65535.0]);
    assert_eq!(numbers("fingers[].pressure"), [1.0, 2.0, 3.0]);
    assert_eq!(numbers("fingers[].pad.temperature"), [1.5, -1.0, 2.5, -1.0, 3.5, -1.0]);
    assert_eq!(numbers("fingers[].pad.temperature[1]"), [-1.0; 3]);
    assert_eq!(numbers("fingers[].pad.a"), [-1.0; 3]);
    assert_eq!(numbers("thumbs[].taxels"), [10.0, 11.0, 12.0]);
    assert_eq!(numbers("thumbs[1].pressure"), [5.0]);
    assert_eq!(numbers("valid"), [1.0, 0.0, 1.0]);
    assert_eq!(numbers("valid[2]"), [1.0]);
    assert_eq!(numbers("raw"), [-5.0, 6.0]);
    assert_eq!(numbers("raw[]"), [-5.0, 6.0]);
    assert_eq!(numbers("scale"), [0.25]);
    assert_eq!(numbers("offset"), [-9.0]);
    assert_eq!(numbers("last"), [6.5]);
}

#[test]
fn stamps_periods_counts_and_texts_are_read() {
    let tree = glove();
    for cdr in [message(true), message(false)] {
        let plan = |path: &str, read_as| FieldPlan::compile(&tree, path, read_as).expect(path);
        assert_eq!(plan("stamp", ReadAs::Stamp).read_stamp(&cdr), Ok(Stamp(12_000_000_034)));
        assert_eq!(plan("period", ReadAs::Period).read_period(&cdr), Ok(-1000));
        assert_eq!(plan("scale", ReadAs::Period).read_period(&cdr), Ok(250_000_000));
        assert_eq!(plan("fingers[2].id", ReadAs::Count).read_count(&cdr), Ok(7));
        assert_eq!(plan("stamp.nanosec", ReadAs::Count).read_count(&cdr), Ok(34));
        let negative = plan("offset", ReadAs::Count).read_count(&cdr).expect_err("-9").to_string();
        assert_eq!(negative, "field 'offset' of pkg/msg/Glove: expected a whole number that is not negative, got -9");
        let mut texts = vec!["kept".to_owned(); 9];
        plan("notes", ReadAs::Texts).read_texts(&cdr, &mut texts).expect("texts");
        assert_eq!(texts, ["first", ""]);
        plan("fingers[].name", ReadAs::Texts).read_texts(&cdr, &mut texts).expect("texts");
        assert_eq!(texts, ["index", "ring", "little one"]);
        plan("serial", ReadAs::Texts).read_texts(&cdr, &mut texts).expect("texts");
        assert_eq!(texts, ["sn-1"]);
    }
}

#[test]
fn all_listed_paths_compile_and_read() {
    let tree = glove();
    let listed: Vec<String> =
        numeric_paths(&tree).into_iter().map(|field| format!("{}: {}", field.path, field.kind)).collect();
    assert_eq!(
        listed,
        [
            "side: uint8",
            "fingers[].id: uint8[]",
            "fingers[].pressure: float64[]",
            "fingers[].taxels: uint16[]",
            "fingers[].pad.a: int8[]",
            "fingers[].pad.temperature: float32[]",
            "thumbs[].id: uint8[]",
            "thumbs[].pressure: float64[]",
            "thumbs[].taxels: uint16[]",
            "thumbs[].pad.a: int8[]",
            "thumbs[].pad.temperature: float32[]",
            "valid: bool[]",
            "raw: int16[]",
            "scale: float32",
            "offset: int64",
            "last: float64",
        ]
    );
    for field in numeric_paths(&tree) {
        let plan = FieldPlan::compile(&tree, &field.path, ReadAs::Numbers).expect("a listed path compiles");
        assert_eq!(plan.kind(), field.kind, "{}", field.path);
        plan.read_f64(&message(true), &mut vec![]).expect("a listed path is read");
    }
}

#[test]
fn a_path_that_leads_nowhere_names_the_fields_that_are_there() {
    assert_eq!(
        refused("fingers[].force", ReadAs::Numbers),
        "field 'fingers[].force' is not in pkg/msg/Finger; it has name, id, pressure, taxels, pad"
    );
    assert_eq!(
        refused("fingers.pressure", ReadAs::Numbers),
        "field 'fingers' of pkg/msg/Glove is pkg/msg/Finger[]; write fingers[] for all elements or fingers[0] for one"
    );
    assert_eq!(
        refused("fingers[0].pad", ReadAs::Numbers),
        "field 'fingers[0].pad' of pkg/msg/Glove is pkg/msg/Pad; go on to one of its fields: a, temperature"
    );
    assert_eq!(
        refused("raw.x", ReadAs::Numbers),
        "field 'raw' of pkg/msg/Glove is int16[]; it has no fields, so leave out '.x'"
    );
    assert_eq!(
        refused("scale[]", ReadAs::Numbers),
        "field 'scale' of pkg/msg/Glove is float32; it is no array, so leave the brackets out"
    );
    assert_eq!(
        refused("thumbs[2].id", ReadAs::Numbers),
        "field 'thumbs' of pkg/msg/Glove is pkg/msg/Finger[2]; there is no element 2"
    );
    assert_eq!(
        refused("serial", ReadAs::Numbers),
        "field 'serial' of pkg/msg/Glove is string, but numbers must be there"
    );
    assert_eq!(
        refused("fingers[].id", ReadAs::Count),
        "field 'fingers[].id' of pkg/msg/Glove is uint8[], but one whole number must be there"
    );
    assert!(refused("nothing.x", ReadAs::Numbers).ends_with("is not in pkg/msg/Empty; it has no fields"));
    for path in ["", ".", "a..b", "a[", "a[x]", "a[-1]", "a[1]b", "a b", "[0]", "a[99999999999999999999]"] {
        assert!(
            matches!(FieldPlan::compile(&glove(), path, ReadAs::Numbers), Err(FieldError::Syntax { .. })),
            "'{path}'"
        );
    }
}

#[test]
fn fields_behind_a_wide_string_are_refused_and_not_listed() {
    let text = "int32 before\nwstring wide\nint32 behind\n";
    let tree = TypeTree::from_schema("pkg/msg/Wide", text).expect("it resolves");
    assert!(FieldPlan::compile(&tree, "before", ReadAs::Numbers).is_ok());
    let error = FieldPlan::compile(&tree, "behind", ReadAs::Numbers).expect_err("behind").to_string();
    assert_eq!(
        error,
        "field 'behind' of pkg/msg/Wide can't be read: wstring 'wide' stands at or before it, and its encoding differs \
         between ROS 2 releases"
    );
    assert_eq!(numeric_paths(&tree).len(), 1);
    let nested = TypeTree::resolve("pkg/msg/Outer", "pkg/Wide[] all\nint32 x\n", &mut |_| Some(text.to_owned()));
    assert_eq!(numeric_paths(&nested.expect("it resolves")), []);
}

#[test]
fn elements_that_a_message_lacks_are_an_error_that_leaves_the_buffer_as_it_was() {
    let plan = FieldPlan::compile(&glove(), "fingers[3].pressure", ReadAs::Numbers).expect("it compiles");
    let mut out = vec![9.0];
    let error = plan.read_f64(&message(true), &mut out).expect_err("three fingers");
    assert_eq!(error.fault, CdrError::NoElement { index: 3, len: 3 });
    let plan = FieldPlan::compile(&glove(), "fingers[].pad.temperature", ReadAs::Numbers).expect("it compiles");
    let cdr = message(true);
    plan.read_f64(&cdr[..120], &mut out).expect_err("cut off within the second finger");
    assert_eq!(out, [9.0]);
}

#[test]
fn encodings_that_ros_does_not_use_are_refused() {
    let plan = FieldPlan::compile(&glove(), "side", ReadAs::Count).expect("it compiles");
    for (id, name) in [(2_u8, "0x0002"), (3, "0x0003"), (6, "0x0006"), (7, "0x0007"), (9, "0x0009")] {
        let error = plan.read_count(&[0, id, 0, 0, 1]).expect_err(name).to_string();
        assert_eq!(
            error,
            format!("field 'side' of pkg/msg/Glove: expected plain CDR (encapsulation 0x0000 or 0x0001), got {name}")
        );
    }
    assert_eq!(plan.read_count(&[0x28, 0xb5, 0x2f, 0xfd, 1]).expect_err("zstd").fault, CdrError::Compressed);
    assert_eq!(plan.read_count(&[0, 1, 0]).expect_err("short").fault, CdrError::NoHeader { n_bytes: 3 });
    assert_eq!(
        plan.read_count(&[0, 1, 0, 0]).expect_err("empty").fault,
        CdrError::Truncated { at: 0, needed: 1, left: 0 }
    );
}

#[test]
fn an_empty_sequence_takes_no_padding() {
    let tree = TypeTree::from_schema("pkg/msg/T", "float64[] empty\nuint32 behind\n").expect("it resolves");
    let plan = FieldPlan::compile(&tree, "behind", ReadAs::Count).expect("it compiles");
    assert_eq!(plan.read_count(&CdrWriter::new(true).u32(0).u32(5).cdr), Ok(5));
    assert_eq!(plan.read_count(&CdrWriter::new(true).u32(1).f64(0.0).u32(5).cdr), Ok(5));
}

#[test]
fn a_plan_read_as_something_else_is_an_error() {
    let plan = FieldPlan::compile(&glove(), "stamp", ReadAs::Stamp).expect("it compiles");
    let error = plan.read_f32(&message(true), &mut vec![]).expect_err("a stamp is no number").to_string();
    assert_eq!(
        error,
        "field 'stamp' of pkg/msg/Glove: expected a field to read as numbers, got builtin_interfaces/msg/Time"
    );
}
