//! One raw message becomes the samples that it holds, or a drop with its reason.

use crate::msg_common;

use msg_common::CdrWriter;
use tactile_pose_fusion::msg::binding::*;
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::{
    Duration, Float32MultiArray, Header, JointState, MultiArrayDimension, MultiArrayLayout, TaxelArray, Time, WireType,
    definition_text, to_cdr,
};
use tactile_pose_fusion::units::Stamp;

const RECEIVED: Stamp = Stamp(99);

fn tree_of<T: WireType>() -> TypeTree {
    TypeTree::from_schema(T::TYPE_NAME, &definition_text(T::TYPE_NAME).expect("ours")).expect("it resolves")
}

fn header() -> Header {
    Header { stamp: Time { sec: 1, nanosec: 500 }, frame_id: "glove".to_owned() }
}

fn path(text: &str) -> String {
    text.to_owned()
}

fn taxel_array_binding() -> TaxelBinding {
    let fields = TaxelFields::for_type("tactile_pose_fusion/TaxelArray").expect("known");
    TaxelBinding::compile(&fields, &tree_of::<TaxelArray>()).expect("it compiles")
}

fn block(rows: u32, values: &[f32]) -> TaxelArray {
    let row_period = Duration { sec: 0, nanosec: 2_500_000 };
    TaxelArray { header: header(), sequence: 41, rows, row_period, values: values.to_vec() }
}

/// A load cell as it is recorded in a real bag: 20 rows of 6 values, and no period.
fn load_cell_tree() -> TypeTree {
    TypeTree::resolve(
        "crab_interfaces/msg/LoadCell",
        "std_msgs/Header header\nuint32 rows\nuint32 cols\nfloat32[] data\n",
        &mut |name| tactile_pose_fusion::msg::standard_text(name).map(str::to_owned),
    )
    .expect("it resolves")
}

fn load_cell_fields() -> TaxelFields {
    TaxelFields {
        stamp: Some(StampFrom::Field(path("header.stamp"))),
        values: vec![path("data")],
        no_reading: None,
        rows: CountFrom::Field(path("rows")),
        cols: Some(CountFrom::Field(path("cols"))),
        row_period: PeriodFrom::Constant(1_000_000),
        sequence: None,
        only: None,
    }
}

fn load_cell(rows: u32, cols: u32, values: &[f32]) -> Vec<u8> {
    let mut writer = CdrWriter::new(true).u32(1).u32(500).text("cell").u32(rows).u32(cols).u32(values.len() as u32);
    for value in values {
        writer = writer.f32(*value);
    }
    writer.cdr
}

#[test]
fn a_taxel_array_is_taken_as_it_says() {
    let mut binding = taxel_array_binding();
    let cdr = to_cdr(&block(2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    for _ in 0..2 {
        let message = binding.decode(&cdr, RECEIVED).expect("samples");
        let expected = TaxelSamples {
            stamp: Stamp(1_000_000_500),
            rows: 2,
            row_period_ns: 2_500_000,
            sequence: Some(41),
            values: &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        };
        assert_eq!(message, expected);
    }
    let one = to_cdr(&block(1, &[1.0, 2.0]));
    let message = binding.decode(&one, RECEIVED).expect("samples");
    assert_eq!((message.rows, message.row_period_ns, message.values.len()), (1, 0, 2));
}

#[test]
fn messages_that_do_not_hold_what_they_say_are_drops_with_a_reason() {
    let mut binding = taxel_array_binding();
    let mut drop = |message: &TaxelArray| {
        let error = binding.decode(&to_cdr(message), RECEIVED).expect_err("a drop");
        (error.reason(), error.to_string())
    };
    let name = "tactile_pose_fusion/msg/TaxelArray";
    assert_eq!(drop(&block(0, &[1.0])), ("empty", format!("a {name} without values: 0 rows, 1 values")));
    assert_eq!(drop(&block(3, &[])), ("empty", format!("a {name} without values: 3 rows, 0 values")));
    assert_eq!(
        drop(&block(2, &[1.0; 3])),
        ("shape", format!("a {name} of 2 rows holds 3 values, which don't divide into them"))
    );
    assert_eq!(drop(&block(u32::MAX, &[1.0; 3])).0, "shape");
    let unspaced = TaxelArray { row_period: Duration::default(), ..block(2, &[1.0; 4]) };
    assert_eq!(
        drop(&unspaced),
        ("row_period", format!("a {name} of 2 rows has a row period of 0 ns; expected more than 0: set row_period"))
    );
    let cdr = to_cdr(&block(1, &[1.0; 4]));
    assert_eq!(binding.decode(&cdr[..cdr.len() - 1], RECEIVED).expect_err("cut off").reason(), "unreadable");
}

#[test]
fn any_type_is_bound_by_field_paths() {
    let mut binding = TaxelBinding::compile(&load_cell_fields(), &load_cell_tree()).expect("it compiles");
    let cdr = load_cell(2, 3, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let message = binding.decode(&cdr, RECEIVED).expect("samples");
    assert_eq!((message.stamp, message.rows, message.row_period_ns), (Stamp(1_000_000_500), 2, 1_000_000));
    assert_eq!(message.sequence, None);
    let error = binding.decode(&load_cell(2, 3, &[1.0; 5]), RECEIVED).expect_err("5 of 6").to_string();
    assert_eq!(error, "a crab_interfaces/msg/LoadCell of 2 rows x 3 taxels holds 5 values; expected 6");
    let huge = binding.decode(&load_cell(u32::MAX, u32::MAX, &[1.0]), RECEIVED).expect_err("too many").reason();
    assert_eq!(huge, "shape");
}

#[test]
fn fields_that_are_not_there_are_named_with_those_that_are() {
    let refused = |change: fn(&mut TaxelFields)| {
        let mut fields = load_cell_fields();
        change(&mut fields);
        TaxelBinding::compile(&fields, &load_cell_tree()).expect_err("it is refused").to_string()
    };
    assert_eq!(
        refused(|fields| fields.values = vec![path("force")]),
        "values: field 'force' is not in crab_interfaces/msg/LoadCell; it has header, rows, cols, data"
    );
    assert_eq!(
        refused(|fields| fields.stamp = Some(StampFrom::Field(path("rows")))),
        "stamp: field 'rows' of crab_interfaces/msg/LoadCell is uint32, a number: set stamp_unit to s, ms, us or ns, or name \
         another field"
    );
    assert_eq!(refused(|fields| fields.rows = CountFrom::Constant(0)), "rows: expected at least 1, got 0");
    assert_eq!(
        refused(|fields| fields.row_period = PeriodFrom::Constant(-5)),
        "row_period: expected more than 0 ns, got -5 ns"
    );
    assert_eq!(
        refused(|fields| fields.sequence = Some(path("header.frame_id"))),
        "sequence: field 'header.frame_id' of crab_interfaces/msg/LoadCell is string, but one number must be there"
    );
}

#[test]
fn a_multi_array_needs_to_be_told_where_its_stamp_comes_from() {
    let fields = TaxelFields::for_type("std_msgs/Float32MultiArray").expect("known");
    let tree = tree_of::<Float32MultiArray>();
    assert_eq!(
        TaxelBinding::compile(&fields, &tree).expect_err("no stamp").to_string(),
        "stamp: std_msgs/msg/Float32MultiArray has no field that is known to be its stamp; give a field path, or \
         'receipt' for the time of arrival"
    );
    let fields = TaxelFields { stamp: Some(StampFrom::Receipt), row_period: PeriodFrom::Constant(10), ..fields };
    let mut binding = TaxelBinding::compile(&fields, &tree).expect("it compiles");
    let mut rows = |sizes: &[u32]| {
        let dim = |size: &u32| MultiArrayDimension { size: *size, ..Default::default() };
        let layout = MultiArrayLayout { dim: sizes.iter().map(dim).collect(), data_offset: 0 };
        let message = Float32MultiArray { layout, data: vec![0.5; 6] };
        let message = binding.decode(&to_cdr(&message), RECEIVED).expect("samples").to_owned();
        assert_eq!((message.stamp, message.values), (RECEIVED, [0.5; 6].as_slice()));
        message.rows
    };
    assert_eq!(rows(&[2, 3]), 2);
    assert_eq!(rows(&[]), 1);
    assert_eq!(rows(&[6]), 1);
    assert_eq!(rows(&[2, 2]), 1);
    assert_eq!(rows(&[1, 2, 3]), 1);
}

#[test]
fn joint_states_give_names_and_angles() {
    let fields = JointFields::for_type("sensor_msgs/JointState").expect("known");
    let mut binding = JointBinding::compile(&fields, &tree_of::<JointState>()).expect("it compiles");
    let state = |names: &[&str], position: &[f64]| JointState {
        header: header(),
        name: names.iter().map(|name| path(name)).collect(),
        position: position.to_vec(),
        velocity: vec![9.0; 3],
        effort: vec![],
    };
    let many = to_cdr(&state(&["index_mcp", "index_pip"], &[0.25, 0.5]));
    let message = binding.decode(&many, RECEIVED).expect("angles");
    assert_eq!(message.stamp, Stamp(1_000_000_500));
    assert_eq!(
        (message.names, message.positions),
        ([path("index_mcp"), path("index_pip")].as_slice(), [0.25, 0.5].as_slice())
    );
    let few = to_cdr(&state(&["thumb"], &[1.0]));
    let message = binding.decode(&few, RECEIVED).expect("angles");
    assert_eq!((message.names, message.positions), ([path("thumb")].as_slice(), [1.0].as_slice()));
    let mut drop = |state: &JointState| binding.decode(&to_cdr(state), RECEIVED).expect_err("a drop");
    let uneven = drop(&state(&["a", "b"], &[1.0]));
    assert_eq!(
        (uneven.reason(), uneven.to_string().as_str()),
        ("joint_count", "a sensor_msgs/msg/JointState names 2 joints and holds 1 positions; expected as many of both")
    );
    assert_eq!(drop(&state(&[], &[])).reason(), "empty");
}

#[test]
fn joints_in_an_array_of_structs_or_without_names_are_bound_too() {
    let text = "Joint[] joints\nbuiltin_interfaces/Time at\n";
    let joint = |_: &str| Some("string name\nfloat32 angle\nbool valid\n".to_owned());
    let tree = TypeTree::resolve("hand/msg/Joints", text, &mut |name| joint(name).filter(|_| name == "hand/msg/Joint"))
        .expect("it resolves");
    let cdr = CdrWriter::new(false).u32(2).text("a").f32(0.5).u8(1).text("bcd").f32(-0.5).u8(0).u32(7).u32(0).cdr;
    let by = |names| JointFields {
        stamp: Some(StampFrom::Field(path("at"))),
        positions: path("joints[].angle"),
        names,
        only: None,
    };
    let mut named = JointBinding::compile(&by(NamesFrom::Field(path("joints[].name"))), &tree).expect("it compiles");
    let message = named.decode(&cdr, RECEIVED).expect("angles");
    assert_eq!((message.stamp, message.positions), (Stamp(7_000_000_000), [0.5, -0.5].as_slice()));
    assert_eq!(message.names, [path("a"), path("bcd")]);
    let three = NamesFrom::Constant(vec![path("x"), path("y"), path("z")]);
    let mut constant = JointBinding::compile(&by(three), &tree).expect("it compiles");
    assert_eq!(constant.decode(&cdr, RECEIVED).expect_err("2 of 3").reason(), "joint_count");
}

/// Three pads of two taxels with three axes each, two of them of one finger, and a clock of its own.
const SKIN: &str = "uint8 hand
uint16 count
uint32 time_ms
Pad[] pads
int16[4] palm
================================================================================
MSG: skin/Pad
string finger
Taxel[] taxels
================================================================================
MSG: skin/Taxel
int16 x
int16 y
int16 z
";

fn skin_tree() -> TypeTree {
    TypeTree::from_schema("skin/msg/Skin", SKIN).expect("it resolves")
}

fn skin_fields(values: &[&str]) -> TaxelFields {
    TaxelFields {
        stamp: Some(StampFrom::Receipt),
        values: values.iter().map(|value| path(value)).collect(),
        no_reading: None,
        rows: CountFrom::One,
        cols: None,
        row_period: PeriodFrom::None,
        sequence: None,
        only: None,
    }
}

/// Taxel k of a message reads 10 k + 1, 10 k + 2, 10 k + 3 and the palm -1 to -4.
fn skin(hand: u8, count: u16, time_ms: u32) -> Vec<u8> {
    let mut writer = CdrWriter::new(true).u8(hand).u16(count).u32(time_ms).u32(3);
    for (pad, finger) in ["index", "thumb", "index"].iter().enumerate() {
        writer = writer.text(finger).u32(2);
        for taxel in 0..2 {
            let first = (20 * pad + 10 * taxel) as u16;
            writer = writer.u16(first + 1).u16(first + 2).u16(first + 3);
        }
    }
    (1..=4).fold(writer, |writer, value| writer.u16(0_u16.wrapping_sub(value))).cdr
}

#[test]
fn several_fields_make_one_sample_field_after_field() {
    let read = |values: &[&str]| {
        let mut binding = TaxelBinding::compile(&skin_fields(values), &skin_tree()).expect("it compiles");
        (0..2).map(|_| binding.decode(&skin(0, 0, 0), RECEIVED).expect("samples").values.to_vec()).last().unwrap()
    };
    assert_eq!(
        read(&["pads[].taxels[].z", "pads[].taxels[].x", "palm"]),
        [3.0, 13.0, 23.0, 33.0, 43.0, 53.0, 1.0, 11.0, 21.0, 31.0, 41.0, 51.0, -1.0, -2.0, -3.0, -4.0]
    );
    let mut rows = TaxelFields {
        rows: CountFrom::Constant(2),
        row_period: PeriodFrom::Constant(1_000_000),
        ..skin_fields(&["pads[1].taxels[].z", "palm"])
    };
    let mut binding = TaxelBinding::compile(&rows, &skin_tree()).expect("it compiles");
    let cdr = skin(0, 0, 0);
    let message = binding.decode(&cdr, RECEIVED).expect("samples");
    assert_eq!((message.rows, message.values), (2, [23.0, -1.0, -2.0, 33.0, -3.0, -4.0].as_slice()));
    rows.rows = CountFrom::Constant(4);
    let mut uneven = TaxelBinding::compile(&rows, &skin_tree()).expect("it compiles");
    assert_eq!(
        uneven.decode(&cdr, RECEIVED).expect_err("two of four").to_string(),
        "a skin/msg/Skin of 4 rows holds 2 values, which don't divide into them"
    );
    let refused = TaxelBinding::compile(&skin_fields(&["palm", "sole"]), &skin_tree()).expect_err("no sole");
    assert_eq!(
        refused.to_string(),
        "fields: field 'sole' is not in skin/msg/Skin; it has hand, count, time_ms, pads, palm"
    );
}

#[test]
fn elements_are_picked_by_the_value_of_a_field_beside() {
    let read = |of: &str| {
        let mut binding = TaxelBinding::compile(&skin_fields(&[of]), &skin_tree()).expect("it compiles");
        match binding.decode(&skin(0, 0, 0), RECEIVED) {
            Ok(message) => Ok(message.values.to_vec()),
            Err(error) => Err((error.reason(), error.to_string())),
        }
    };
    assert_eq!(read("pads[finger=thumb].taxels[].z"), Ok(vec![23.0, 33.0]));
    assert_eq!(read("pads[finger=index].taxels[].z"), Ok(vec![3.0, 13.0, 43.0, 53.0]));
    assert_eq!(read("pads[ finger = thumb ].taxels[x=31].y"), Ok(vec![32.0]));
    let none = "field 'pads[finger=ring].taxels[].z' of skin/msg/Skin: expected an element with finger=ring, got 'index', \
                'thumb', 'index'";
    assert_eq!(read("pads[finger=ring].taxels[].z"), Err(("no_match", path(none))));
    assert_eq!(read("pads[finger=thumb].taxels[x=-4].z").unwrap_err().1.split("got ").nth(1), Some("21, 31"));

    let refused = |of: &str| TaxelBinding::compile(&skin_fields(&[of]), &skin_tree()).expect_err(of).to_string();
    assert_eq!(
        refused("pads[hand=1].taxels[].z"),
        "values: field 'hand' is not in skin/msg/Pad; it has finger, taxels"
    );
    assert_eq!(
        refused("pads[].taxels[x=40000].z"),
        "values: field 'x=40000' of skin/msg/Taxel is int16, but a string, a whole number or a truth value that can have \
         this value must be there"
    );
    assert_eq!(
        refused("palm[x=1]"),
        "values: field 'palm' of skin/msg/Skin is int16[4]; its elements have no fields to pick them by"
    );
    for wrong in ["pads[=1].taxels[].z", "pads[finger=].taxels[].z", "pads[finger=a", "pads[a[]=1].x"] {
        assert!(refused(wrong).contains("is not a field path"), "{wrong}");
    }
}

#[test]
fn messages_with_another_value_are_for_another_source() {
    let mut fields = skin_fields(&["palm"]);
    fields.only = Some(path("hand=1"));
    let mut binding = TaxelBinding::compile(&fields, &skin_tree()).expect("it compiles");
    assert_eq!(binding.decode(&skin(1, 0, 0), RECEIVED).expect("samples").values.len(), 4);
    let error = binding.decode(&skin(0, 0, 0), RECEIVED).expect_err("the other hand");
    assert!(error.is_for_another());
    assert_eq!(
        (error.reason(), error.to_string()),
        ("not_for_source", path("a skin/msg/Skin is not for this source: only hand=1 is, and it has 0"))
    );
    fields.only = Some(path("pads[finger=thumb].finger=thumb"));
    let refused = TaxelBinding::compile(&fields, &skin_tree()).expect_err("a name is wanted").to_string();
    assert!(refused.starts_with("only: 'pads[finger=thumb].finger=thumb' is not a field path"), "{refused}");
    fields.only = Some(path("hand=left"));
    let refused = TaxelBinding::compile(&fields, &skin_tree()).expect_err("a number").to_string();
    assert!(refused.starts_with("only: field 'hand=left' of skin/msg/Skin is uint8, but"), "{refused}");
}

#[test]
fn a_stated_reading_stands_for_no_taxel() {
    let fields = TaxelFields { no_reading: Some(-3.0), ..skin_fields(&["palm"]) };
    let mut binding = TaxelBinding::compile(&fields, &skin_tree()).expect("it compiles");
    let cdr = skin(0, 0, 0);
    let values = binding.decode(&cdr, RECEIVED).expect("samples").values;
    assert_eq!(values[..2], [-1.0, -2.0]);
    assert!(values[2].is_nan() && values[3] == -4.0);
}

#[test]
fn stamps_may_be_numbers_since_1970_or_since_the_start_of_the_device() {
    let number = |unit, since| StampFrom::Number { path: path("time_ms"), unit, since };
    let bind =
        |stamp| TaxelBinding::compile(&TaxelFields { stamp: Some(stamp), ..skin_fields(&["palm"]) }, &skin_tree());
    let mut seconds = bind(number(StampUnit::Seconds, Since::Epoch)).expect("32 bits hold seconds");
    let message = seconds.decode(&skin(0, 0, 1_700_000_000), RECEIVED).expect("samples").stamp;
    assert_eq!(message, Stamp(1_700_000_000_000_000_000));
    let mut boot = bind(number(StampUnit::Millis, Since::Boot)).expect("it compiles");
    let begin = 1_700_000_000_000_000_000;
    for (time_ms, received_ms) in [(5_000, 0), (5_010, 14), (5_020, 23), (5_030, 31)] {
        let received = Stamp(begin + received_ms * 1_000_000);
        let stamp = boot.decode(&skin(0, 0, time_ms), received).expect("samples").stamp;
        assert_eq!(stamp, Stamp(begin + i64::from(time_ms - 5_000) * 1_000_000));
    }
    assert_eq!(boot.clock_restarts(), 0);
    boot.decode(&skin(0, 0, 3), Stamp(begin + 2_000_000_000)).expect("samples");
    assert_eq!(boot.clock_restarts(), 1);
    let refused = |stamp| bind(stamp).expect_err("it is refused").to_string();
    assert_eq!(
        refused(number(StampUnit::Millis, Since::Epoch)),
        "stamp: field 'time_ms' of skin/msg/Skin is uint32, too small for the time since 1970: is stamp_since boot?"
    );
    let narrow = StampFrom::Number { path: path("count"), unit: StampUnit::Micros, since: Since::Boot };
    assert_eq!(
        refused(narrow),
        "stamp: field 'count' of skin/msg/Skin is uint16, begins at 0 again within 4 s in this unit; write receipt"
    );
    let many = StampFrom::Number { path: path("palm"), unit: StampUnit::Micros, since: Since::Boot };
    assert_eq!(refused(many), "stamp: field 'palm' of skin/msg/Skin is int16[], but one number must be there");
}

#[test]
fn every_kind_of_number_is_a_stamp_to_its_precision() {
    let since_epoch = 1_700_000_000.25_f64;
    let begin = 1_700_000_000_250_000_000_i64;
    let cases: [(&str, StampUnit, Vec<u8>); 6] = [
        ("float64", StampUnit::Seconds, since_epoch.to_le_bytes().to_vec()),
        ("float64", StampUnit::Millis, (since_epoch * 1e3).to_le_bytes().to_vec()),
        ("uint64", StampUnit::Nanos, begin.to_le_bytes().to_vec()),
        ("int64", StampUnit::Nanos, begin.to_le_bytes().to_vec()),
        ("int64", StampUnit::Micros, (begin / 1_000).to_le_bytes().to_vec()),
        ("uint64", StampUnit::Millis, (begin / 1_000_000).to_le_bytes().to_vec()),
    ];
    let stamped = |name: &str, stamp| {
        let tree = TypeTree::from_schema("pkg/msg/T", &format!("{name} time\nfloat32 value\n")).expect("it resolves");
        TaxelBinding::compile(&TaxelFields { stamp: Some(stamp), ..skin_fields(&["value"]) }, &tree)
    };
    for (name, unit, bytes) in cases {
        let mut binding =
            stamped(name, StampFrom::Number { path: path("time"), unit, since: Since::Epoch }).expect("it compiles");
        let cdr = [&[0, 1, 0, 0], bytes.as_slice(), &1.0_f32.to_le_bytes()].concat();
        assert_eq!(binding.decode(&cdr, RECEIVED).expect(name).stamp, Stamp(begin), "{name} {unit:?}");
    }
    let float = StampFrom::Number { path: path("time"), unit: StampUnit::Seconds, since: Since::Epoch };
    let error = stamped("float32", float.clone()).expect_err("two minutes").to_string();
    assert!(error.contains("is float32, too small for the time since 1970"), "{error}");
    let mut nan = stamped("float64", float).expect("it compiles");
    let cdr = [&[0, 1, 0, 0], f64::NAN.to_le_bytes().as_slice(), &1.0_f32.to_le_bytes()].concat();
    assert_eq!(
        nan.decode(&cdr, RECEIVED).expect_err("no time").to_string(),
        "field 'time' of pkg/msg/T: expected a finite number as a stamp, got NaN"
    );
    let time = StampFrom::Number { path: path("header.stamp"), unit: StampUnit::Seconds, since: Since::Epoch };
    let fields = TaxelFields { stamp: Some(time), ..load_cell_fields() };
    assert_eq!(
        TaxelBinding::compile(&fields, &load_cell_tree()).expect_err("a time has its unit").to_string(),
        "stamp: field 'header.stamp' of crab_interfaces/msg/LoadCell is builtin_interfaces/msg/Time, no number: leave \
         stamp_unit out"
    );
}
