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
        values: path("data"),
        rows: CountFrom::Field(path("rows")),
        cols: Some(CountFrom::Field(path("cols"))),
        row_period: PeriodFrom::Constant(1_000_000),
        sequence: None,
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
        let expected = TaxelMessage {
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
        refused(|fields| fields.values = path("force")),
        "values: field 'force' is not in crab_interfaces/msg/LoadCell; it has header, rows, cols, data"
    );
    assert_eq!(
        refused(|fields| fields.stamp = Some(StampFrom::Field(path("rows")))),
        "stamp: field 'rows' of crab_interfaces/msg/LoadCell is uint32, but one builtin_interfaces/msg/Time must be there"
    );
    assert_eq!(refused(|fields| fields.rows = CountFrom::Constant(0)), "rows: expected at least 1, got 0");
    assert_eq!(
        refused(|fields| fields.row_period = PeriodFrom::Constant(-5)),
        "row_period: expected more than 0 ns, got -5 ns"
    );
    assert_eq!(
        refused(|fields| fields.sequence = Some(path("header.stamp.sec"))),
        "sequence: field 'header.stamp.sec' of crab_interfaces/msg/LoadCell is int32, but an unsigned counter of at \
         least 32 bits must be there; leave it out"
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
    let by =
        |names| JointFields { stamp: Some(StampFrom::Field(path("at"))), positions: path("joints[].angle"), names };
    let mut named = JointBinding::compile(&by(NamesFrom::Field(path("joints[].name"))), &tree).expect("it compiles");
    let message = named.decode(&cdr, RECEIVED).expect("angles");
    assert_eq!((message.stamp, message.positions), (Stamp(7_000_000_000), [0.5, -0.5].as_slice()));
    assert_eq!(message.names, [path("a"), path("bcd")]);
    let three = NamesFrom::Constant(vec![path("x"), path("y"), path("z")]);
    let mut constant = JointBinding::compile(&by(three), &tree).expect("it compiles");
    assert_eq!(constant.decode(&cdr, RECEIVED).expect_err("2 of 3").reason(), "joint_count");
}
