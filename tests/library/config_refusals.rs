//! Every parameter that can't be meant is refused, in one line that names file, line, key, value and what is allowed.

use tactile_pose_fusion::config::{Config, DEFAULT_NODE, ParamTree, parse_param_file};
use tactile_pose_fusion::fusion::FrameClock;
use tactile_pose_fusion::msg::binding::{
    CountFrom, ForceFields, ForceReading, JointFields, NamesFrom, PeriodFrom, Since, StampFrom, StampUnit, TaxelFields,
};

use tactile_pose_fusion::units::{GramForce, Newton};

const BASE: &str = "\
/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {topic: taxels, n_taxels: 6}
    joint.hand: {topic: /joints}
    model.tip: {path: tip.onnx}
    region.index: {model: tip, joints: [dip, pip], frame_id: index_tip}
";

fn tree() -> ParamTree {
    parse_param_file(BASE, "params/index.yaml", DEFAULT_NODE).unwrap()
}

/// The configuration with overrides, which are the shortest way to set a key.
fn with(overrides: &[&str]) -> Result<Config, String> {
    let mut tree = tree();
    for rule in overrides {
        assert_eq!(tree.set_override(rule), Ok(true), "{rule}");
    }
    Config::from_tree(&tree).map_err(|e| e.to_string())
}

/// The configuration of the base file with lines added to it, from line 10 on.
fn with_lines(lines: &str) -> Result<Config, String> {
    let text = format!("{BASE}{lines}");
    parse_param_file(&text, "params/index.yaml", DEFAULT_NODE)
        .map_err(|e| e.to_string())
        .and_then(|tree| Config::from_tree(&tree).map_err(|e| e.to_string()))
}

/// The configuration of the base file without one of its lines.
fn without(line: &str) -> Result<Config, String> {
    let text: String = BASE.lines().filter(|kept| !kept.contains(line)).map(|kept| format!("{kept}\n")).collect();
    let tree = parse_param_file(&text, "params/index.yaml", DEFAULT_NODE).unwrap();
    Config::from_tree(&tree).map_err(|e| e.to_string())
}

#[test]
fn keys_of_other_nodes_in_a_shared_section_are_said_and_not_followed() {
    let lines = "    robot_description: x\n    publish_frequency: 50.0\n    model.arm.description: y\n";
    let cfg = with_lines(lines).unwrap();
    assert_eq!(cfg.of_others, ["model.arm.description", "publish_frequency", "robot_description"]);
    let note = cfg.note_on_others().unwrap();
    assert!(
        note.contains("no such parameters: model.arm.description, publish_frequency, robot_description;"),
        "{note}"
    );
    let tree = parse_param_file(BASE, "a.yaml", DEFAULT_NODE).unwrap();
    assert_eq!(Config::from_tree(&tree).unwrap().note_on_others(), None);
}

#[test]
fn an_unknown_key_under_the_nodes_own_name_is_refused() {
    for section in [DEFAULT_NODE, "tactile_pose_fusion", "/**/tactile_pose_fusion"] {
        let text = format!("{BASE}{section}:\n  ros__parameters:\n    robot_description: x\n");
        let tree = parse_param_file(&text, "params/index.yaml", DEFAULT_NODE).unwrap();
        assert_eq!(
            Config::from_tree(&tree).unwrap_err().to_string(),
            "params/index.yaml:12: robot_description is not a parameter of this node: params/example.yaml explains those that there are"
        );
    }
    let refused = with(&["robot_description:=x"]).unwrap_err();
    assert!(refused.starts_with("command line: robot_description is not a parameter"), "{refused}");
}

#[test]
fn each_refusal_names_file_line_key_value_and_what_is_allowed() {
    let table = [
        (
            "    contact.force_of: 0.01\n",
            "params/index.yaml:10: contact.force_of is not a parameter of this node: did you mean contact.force_on?",
        ),
        (
            "    contact.forceoff: 0.01\n",
            "params/index.yaml:10: contact.forceoff is not a parameter of this node: did you mean contact.force_off?",
        ),
        (
            "    tactile.glove.n_taxel: 6\n",
            "params/index.yaml:10: tactile.glove.n_taxel is not a parameter of this node: did you mean tactile.glove.n_taxels?",
        ),
        (
            "    region.index.stiffness: 1.0\n",
            "params/index.yaml:10: region.index.stiffness is not a parameter of this node: params/example.yaml explains those that there are",
        ),
        (
            "    tactile.glov.sign: 1\n",
            "params/index.yaml:10: tactile.glov.sign is not a parameter of this node: tactile_sources = [glove] has no \"glov\"",
        ),
        (
            "    joint.arm.scale: 1\n",
            "params/index.yaml:10: joint.arm.scale is not a parameter of this node: joint_sources = [hand] has no \"arm\"",
        ),
        (
            "    region.thumb.model: tip\n",
            "params/index.yaml:10: region.thumb.model is not a parameter of this node: regions = [index] has no \"thumb\"",
        ),
        (
            "    model.palm.path: x\n",
            "params/index.yaml:10: model.palm.path is not a parameter of this node: the models that regions use = [tip] has no \"palm\"",
        ),
        (
            "    contact.force_off: 0.06\n    contact.force_on: 0.0245\n",
            "params/index.yaml:10: contact.force_off = 0.06 N must be below contact.force_on = 0.0245 N",
        ),
        (
            "    contact.force_on: 0.01\n",
            "params/index.yaml:10: contact.force_off = 0.014709975 N must be below contact.force_on = 0.01 N; contact.force_off is the default, set it too",
        ),
        (
            "    region.index.model_joints: [a, b, c]\n",
            "params/index.yaml:10: region.index.model_joints = [a, b, c] names 3 joints and region.index.joints 2; name one for each",
        ),
        (
            "    calibration: {file: zero.yaml, worn_file: zero.yaml}\n",
            "params/index.yaml:10: calibration.worn_file = \"zero.yaml\" is the file of the calibration, which would be lost; choose another name",
        ),
        (
            "    contact.touch_off: 0.3\n",
            "params/index.yaml:10: contact.touch_off = 0.3 is set without contact.touch_on; set both, or neither for the model's own",
        ),
        (
            "    contact.touch_on: 0.3\n    contact.touch_off: 0.3\n",
            "params/index.yaml:11: contact.touch_off = 0.3 must be below contact.touch_on = 0.3",
        ),
        (
            "    region.index.contact.force_off: 0.03\n",
            "params/index.yaml:10: region.index.contact.force_off = 0.03 N must be below contact.force_on = 0.024516625 N",
        ),
        ("    contact.force_on: 0\n", "params/index.yaml:10: contact.force_on = 0 N must be in (0, 1000] N"),
        ("    contact.force_on: .nan\n", "params/index.yaml:10: contact.force_on = .nan N must be in (0, 1000] N"),
        (
            "    contact.force_on: \"0.1\"\n",
            "params/index.yaml:10: contact.force_on = \"0.1\" is of type string, expected double",
        ),
        (
            "    contact.on_frames: 2.0\n",
            "params/index.yaml:10: contact.on_frames = 2.0 is of type double, expected int",
        ),
        (
            "    contact.on_frames: 0\n",
            "params/index.yaml:10: contact.on_frames = 0 frames must be in [1, 1000] frames",
        ),
        ("    timing.max_gap_ms: -1\n", "params/index.yaml:10: timing.max_gap_ms = -1 ms must be in [0, 10000] ms"),
        (
            "    timing.time_jump_ms: 0.5\n",
            "params/index.yaml:10: timing.time_jump_ms = 0.5 ms must be in [1, 60000] ms",
        ),
        ("    glove: 17\n", "params/index.yaml:10: glove = 17 is of type int, expected string: write it in quotes"),
        ("    tactile.glove.sign: 2\n", "params/index.yaml:10: tactile.glove.sign = 2 must be 1 or -1"),
        (
            "    tactile.glove.frame_clock: fast\n",
            "params/index.yaml:10: tactile.glove.frame_clock = \"fast\" must be \"tactile\" or \"grid\"",
        ),
        (
            "    tactile.glove.stamp_offset_ms: 10001.0\n",
            "params/index.yaml:10: tactile.glove.stamp_offset_ms = 10001.0 ms must be in [-10000, 10000] ms",
        ),
        (
            "    tactile.glove.type: std_msgs/msg/Float32MultiArray\n",
            "params/index.yaml: tactile.glove.stamp is required: std_msgs/msg/Float32MultiArray has no header, so its stamp can only be the time of receipt; write receipt",
        ),
        (
            "    tactile.glove.type: std_msgs/msg/Float32MultiArray\n    tactile.glove.stamp: header.stamp\n",
            "params/index.yaml:11: tactile.glove.stamp = \"header.stamp\" is not there: std_msgs/msg/Float32MultiArray has no header, so its stamp can only be the time of receipt; write receipt",
        ),
        (
            "    tactile.glove.type: my_msgs/msg/Glove\n",
            "params/index.yaml: tactile.glove.field is required: Path of the numbers: rows x taxels, row-major",
        ),
        (
            "    tactile.glove.type: my_msgs/Glove\n",
            "params/index.yaml:10: tactile.glove.type = \"my_msgs/Glove\" is not a message type: write my_msgs/msg/Glove",
        ),
        (
            "    tactile.glove.type: Glove\n",
            "params/index.yaml:10: tactile.glove.type = \"Glove\" is not a message type, such as sensor_msgs/msg/JointState",
        ),
        (
            "    tactile.glove.field: a..b\n",
            "params/index.yaml:10: tactile.glove.field = \"a..b\" is not the path of a field, such as header.stamp, layout.dim[0].size or sensors[].taxels[].z",
        ),
        (
            "    tactile.glove.field: a\n    tactile.glove.fields: [a]\n",
            "params/index.yaml:11: tactile.glove.fields = [a] and tactile.glove.field exclude each other",
        ),
        ("    tactile.glove.fields: []\n", "params/index.yaml:10: tactile.glove.fields = [] must name at least one"),
        (
            "    tactile.glove.fields: [a, \"b[c=]\"]\n",
            "params/index.yaml:10: tactile.glove.fields = [a, b[c=]] has what is no path of a field: 'b[c=]' is not a field path ('' is not a value, such as tip or 2); expected names such as header.stamp, fingers[0].taxels, fingers[].pressure, fingers[name=thumb].taxels",
        ),
        (
            "    tactile.glove.stamp: receipt\n    tactile.glove.stamp_unit: ms\n",
            "params/index.yaml:11: tactile.glove.stamp_unit = \"ms\" is for stamps in the messages, and tactile.glove.stamp is receipt",
        ),
        (
            "    joint.hand.stamp: receipt\n    joint.hand.stamp_since: boot\n",
            "params/index.yaml:11: joint.hand.stamp_since = \"boot\" is for stamps in the messages, and joint.hand.stamp is receipt",
        ),
        (
            "    joint.hand.stamp_unit: min\n",
            "params/index.yaml:10: joint.hand.stamp_unit = \"min\" must be \"\" or \"s\" or \"ms\" or \"us\" or \"ns\"",
        ),
        (
            "    joint.hand.only: left\n",
            "params/index.yaml:10: joint.hand.only = \"left\" is not a field and its value, such as side=Left or hand=1",
        ),
        (
            "    tactile.glove.cols: 5\n",
            "params/index.yaml:10: tactile.glove.cols = 5 must equal tactile.glove.n_taxels = 6",
        ),
        ("    tactile.glove.rows: 0\n", "params/index.yaml:10: tactile.glove.rows = 0 must be in [1, 65536]"),
        (
            "    tactile.glove.row_period: \"\"\n",
            "params/index.yaml: tactile.glove.row_period or tactile.glove.row_period_ms is required: with tactile.glove.rows there may be several rows, whose times are not known without it",
        ),
        (
            "    tactile.glove.row_period: a\n    tactile.glove.row_period_ms: 1\n",
            "params/index.yaml:11: tactile.glove.row_period_ms = 1 and tactile.glove.row_period = \"a\" exclude each other",
        ),
        (
            "    tactile.glove.row_period_ms: 0\n",
            "params/index.yaml:10: tactile.glove.row_period_ms = 0 ms must be in (0, 10000] ms",
        ),
        (
            "    joint.hand.scale: 0\n",
            "params/index.yaml:10: joint.hand.scale = 0 must not be 0, nor so small or large that angles vanish",
        ),
        ("    joint.hand.scale: .inf\n", "params/index.yaml:10: joint.hand.scale = .inf must be finite"),
        (
            "    joint.hand.names: [a]\n",
            "params/index.yaml:10: joint.hand.names = [a] is for types without names, and sensor_msgs/msg/JointState carries them",
        ),
        (
            "    joint.hand.type: my_msgs/msg/Hand\n",
            "params/index.yaml: joint.hand.names_field or joint.hand.names is required: joints are told apart by name, so say which field has the names, or what they are",
        ),
        (
            "    joint.hand.type: my_msgs/msg/Hand\n    joint.hand.names: [dip]\n    joint.hand.names_field: joint_names\n",
            "params/index.yaml:11: joint.hand.names = [dip] and joint.hand.names_field exclude each other",
        ),
        (
            "    joint.hand.type: my_msgs/msg/Hand\n    joint.hand.names: [dip]\n",
            "params/index.yaml: joint.hand.field is required: Path of the angles",
        ),
        (
            "    joint.hand.type: my_msgs/msg/Hand\n    joint.hand.names: [dip]\n    joint.hand.field: a\n",
            "params/index.yaml:9: region.index.joints = [dip, pip] has \"pip\", but the joint sources send dip",
        ),
        (
            "    model.tip.backend: tensorrt\n",
            "params/index.yaml:10: model.tip.backend = \"tensorrt\" must be \"auto\" or \"builtin\" or \"onnxruntime\" or \"rten\"",
        ),
        ("    model.tip.unit: kg\n", "params/index.yaml:10: model.tip.unit = \"kg\" must be \"\" or \"gF\" or \"N\""),
        ("    model.tip.inputs.pose: \"\"\n", "params/index.yaml:10: model.tip.inputs.pose = \"\" must not be empty"),
        (
            "    region.index.taxels: [0, 6]\n",
            "params/index.yaml:10: region.index.taxels = [0, 6] has 6, but taxels of the source glove are 0 to 5",
        ),
        ("    region.index.taxels: [-1]\n", "params/index.yaml:10: region.index.taxels = [-1] must be in [0, 4095]"),
        ("    region.index.taxels: [1, 1]\n", "params/index.yaml:10: region.index.taxels = [1, 1] has 1 twice"),
        (
            "    region.index.tactile_source: palm\n",
            "params/index.yaml:10: region.index.tactile_source = \"palm\" is not among tactile_sources = [glove]",
        ),
        (
            "    region.index.normal: [0, 0, 0]\n",
            "params/index.yaml:10: region.index.normal = [0, 0, 0] must not be zero: it is a direction",
        ),
        (
            "    region.index.normal: [0, 0]\n",
            "params/index.yaml:10: region.index.normal = [0, 0] is of type int[], expected double[3]",
        ),
        (
            "    region.index.mount.rotation: [0, 0, 0, 2]\n",
            "params/index.yaml:10: region.index.mount.rotation = [0, 0, 0, 2] has the norm 2: it must be a unit quaternion x, y, z, w, within 0.001",
        ),
        (
            "    calibration.duration_s: 1\n",
            "params/index.yaml:10: calibration.min_s = 2.0 s must be at most calibration.duration_s = 1.0 s; calibration.min_s is the default, set it too",
        ),
        (
            "    calibration.duration_s: 0.5\n",
            "params/index.yaml:10: calibration.duration_s = 0.5 s must be in (0.5, 600] s",
        ),
        (
            "    calibration.max_loaded_fraction: 1.5\n",
            "params/index.yaml:10: calibration.max_loaded_fraction = 1.5 must be in [0, 1]",
        ),
        (
            "    stage_topic: a b\n",
            "params/index.yaml:10: stage_topic = \"a b\" is not a valid topic name: it may hold only letters, digits, '_', '/', '~' and substitutions in '{}'",
        ),
    ];
    for (lines, message) in table {
        assert_eq!(with_lines(lines).unwrap_err(), message, "{lines}");
    }
}

#[test]
fn each_missing_or_impossible_list_is_refused() {
    let table = [
        (
            without("regions:"),
            "params/index.yaml: regions is required: Names of the patches to estimate, each with one force",
        ),
        (without("tactile_sources:"), "params/index.yaml: tactile_sources is required: Names of the streams of taxels"),
        (
            without("model.tip:"),
            "params/index.yaml: model.tip.path is required: The ONNX file, relative to the folder of this file (given with -p: to the working directory)",
        ),
        (
            without("region.index:"),
            "params/index.yaml: region.index.model is required: Name of its model; regions that share one run as a batch",
        ),
        (without("tactile.glove:"), "params/index.yaml: tactile.glove.n_taxels is required: Taxels in a sample"),
        (without("joint.hand:"), "params/index.yaml: joint.hand.topic is required: Topic of the joint angles"),
        (with(&["regions:=[]"]), "command line: regions = [] must name at least one"),
        (
            with(&["regions:=index"]),
            "command line: regions = \"index\" is of type string, expected string[]: write [\"index\"]",
        ),
        (with(&["regions:=[index, index]"]), "command line: regions = [index, index] has \"index\" twice"),
        (
            with(&["regions:=[Index]"]),
            "command line: regions = [Index] has \"Index\", which must start with a small letter and hold only small letters, digits and '_'",
        ),
        (
            with(&["tactile_sources:=[glove, palm]", "tactile.palm.topic:=p", "tactile.palm.n_taxels:=4"]),
            "params/index.yaml: region.index.tactile_source is required: there are several tactile sources: glove, palm",
        ),
        (
            with(&["region.index.joints:=[dip, dip]"]),
            "command line: region.index.joints = [dip, dip] has \"dip\" twice",
        ),
        (with(&["region.index.frame_id:=\"\""]), "command line: region.index.frame_id = \"\" must not be empty"),
        (
            with(&["region.index.model:=a.b"]),
            "command line: region.index.model = \"a.b\" must start with a small letter and hold only small letters, digits and '_'",
        ),
    ];
    for (config, message) in table {
        assert_eq!(config.unwrap_err(), message);
    }
    let text = BASE.replace("    joint_sources: [hand]\n", "").replace("    joint.hand: {topic: /joints}\n", "");
    let tree = parse_param_file(&text, "p.yaml", DEFAULT_NODE).unwrap();
    let message =
        "p.yaml:7: region.index.joints = [dip, pip] needs a source of joint angles, but joint_sources is empty";
    assert_eq!(Config::from_tree(&tree).unwrap_err().to_string(), message);
}

#[test]
fn the_shortest_file_gives_the_defaults() {
    let config = with(&[]).unwrap();
    assert_eq!(config.tactile()[0].name, "/taxels");
    let fields = TaxelFields {
        stamp: Some(StampFrom::Field("header.stamp".into())),
        values: vec!["values".into()],
        no_reading: None,
        rows: CountFrom::Field("rows".into()),
        cols: None,
        row_period: PeriodFrom::Field("row_period".into()),
        sequence: Some("sequence".into()),
        only: None,
    };
    assert_eq!(config.tactile()[0].fields, fields);
    assert_eq!(config.models()[0].spec.path.to_str(), Some("params/tip.onnx"));
    assert_eq!(config.fusion().timing().max_gap.as_millis(), 50);
    assert_eq!(config.calibration.file, None);
    assert_eq!((config.glove, config.user), (None, None));
}

#[test]
fn a_message_without_header_takes_receipt_and_its_own_defaults() {
    let config = with(&[
        "tactile.glove.type:=std_msgs/msg/Float32MultiArray",
        "tactile.glove.stamp:=receipt",
        "tactile.glove.sign:=-1",
        "tactile.glove.frame_clock:=grid",
        "tactile.glove.stamp_offset_ms:=-1.5",
    ])
    .unwrap();
    let fields = TaxelFields {
        stamp: Some(StampFrom::Receipt),
        values: vec!["data".into()],
        no_reading: None,
        rows: CountFrom::Layout("layout".into()),
        cols: None,
        row_period: PeriodFrom::None,
        sequence: None,
        only: None,
    };
    assert_eq!(config.tactile()[0].fields, fields);
    let source = &config.fusion().tactile_sources()[0];
    assert!(source.inverted);
    assert_eq!(source.frame_clock, FrameClock::Grid);
    assert_eq!(source.stamp_offset_ns, -1_500_000);
}

#[test]
fn any_message_type_is_described_by_its_fields() {
    let config = with(&[
        "tactile.glove.type:=my_msgs/msg/Glove",
        "tactile.glove.field:=layers[1].raw",
        "tactile.glove.stamp:=stamp",
        "tactile.glove.rows:=layout.dim[0].size",
        "tactile.glove.cols:=6",
        "tactile.glove.row_period_ms:=2.5",
        "joint.hand.type:=my_msgs/msg/Hand",
        "joint.hand.field:=angles",
        "joint.hand.names:=[pip, dip]",
        "joint.hand.stamp:=receipt",
        "joint.hand.degrees:=true",
        "joint.hand.scale:=2",
    ])
    .unwrap();
    let fields = TaxelFields {
        stamp: Some(StampFrom::Field("stamp".into())),
        values: vec!["layers[1].raw".into()],
        no_reading: None,
        rows: CountFrom::Field("layout.dim[0].size".into()),
        cols: Some(CountFrom::Constant(6)),
        row_period: PeriodFrom::Constant(2_500_000),
        sequence: None,
        only: None,
    };
    assert_eq!(config.tactile()[0].fields, fields);
    let fields = JointFields {
        stamp: Some(StampFrom::Receipt),
        positions: "angles".into(),
        names: NamesFrom::Constant(vec!["pip".into(), "dip".into()]),
        only: None,
    };
    assert_eq!(config.joints()[0].fields, fields);
    assert_eq!(config.fusion().joint_sources()[0].scale, 2.0 * std::f64::consts::PI / 180.0);
}

#[test]
fn several_fields_a_devices_clock_and_its_side_are_described_too() {
    let config = with(&[
        "tactile.glove.type:=my_msgs/msg/Glove",
        "tactile.glove.fields:=[\"pads[finger=index].taxels[].z\", palm]",
        "tactile.glove.no_reading:=3072",
        "tactile.glove.stamp:=time_us",
        "tactile.glove.stamp_unit:=us",
        "tactile.glove.stamp_since:=boot",
        "tactile.glove.only:=side=Left",
        "joint.hand.stamp_since:=boot",
    ])
    .unwrap();
    let fields = TaxelFields {
        stamp: Some(StampFrom::Number { path: "time_us".into(), unit: StampUnit::Micros, since: Since::Boot }),
        values: vec!["pads[finger=index].taxels[].z".into(), "palm".into()],
        no_reading: Some(3072.0),
        rows: CountFrom::One,
        cols: None,
        row_period: PeriodFrom::None,
        sequence: None,
        only: Some("side=Left".into()),
    };
    assert_eq!(config.tactile()[0].fields, fields);
    assert_eq!(config.joints()[0].fields.stamp, Some(StampFrom::SinceBoot("header.stamp".into())));
}

#[test]
fn regions_share_models_and_override_thresholds() {
    let config = with(&[
        "regions:=[index, palm, thumb]",
        "region.thumb.model:=tip",
        "region.thumb.frame_id:=thumb_tip",
        "region.thumb.taxels:=[3, 1]",
        "region.thumb.normal:=[0, 0, -2]",
        "region.palm.model:=flat",
        "region.palm.frame_id:=palm",
        "model.flat.path:=/models/flat.onnx",
        "model.flat.rate_hz:=200",
        "region.palm.contact.force_on:=0.5",
        "region.palm.mount.translation:=[0.02, 0.0, 0.0]",
        "region.palm.mount.rotation:=[0.0, 0.0, 0.7072, 0.7071]",
    ])
    .unwrap();
    let names: Vec<&str> = config.models().iter().map(|model| model.name.as_str()).collect();
    assert_eq!(names, ["tip", "flat"]);
    assert_eq!(config.models()[1].spec.rate_hz, Some(200.0));
    let [index, palm, thumb] = config.fusion().regions() else { panic!() };
    assert_eq!([index, palm, thumb].map(|region| region.model.position()), [0, 1, 0]);
    assert_eq!(thumb.taxels, [3, 1]);
    assert_eq!(thumb.patch.normal_in_patch.z, -1.0);
    assert_eq!(palm.contact.force_on.0, 0.5);
    assert_eq!(index.contact.force_on.0, 0.024516625);
    assert_eq!(palm.patch.frame_from_patch.translation.x, 0.02);
    assert!((palm.patch.frame_from_patch.rotation.norm() - 1.0).abs() < 1e-15); // rounding of one normalization
    assert!(palm.joints.is_empty());
}

#[test]
fn a_namespaced_node_resolves_its_topics_there() {
    let text = BASE.replace("topic: taxels", "topic: ~/taxels");
    let tree = parse_param_file(&text, "p.yaml", "/left/fusion").unwrap();
    let config = Config::from_tree(&tree).unwrap();
    assert_eq!(config.tactile()[0].name, "/left/fusion/taxels");
    assert_eq!(config.node.namespace(), "/left");
}

#[test]
fn files_that_cannot_be_read_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none.yaml");
    let message = tactile_pose_fusion::config::load(&missing, DEFAULT_NODE).unwrap_err().to_string();
    assert!(message.starts_with(&format!("{}: can't be read: No such file", missing.display())), "{message}");
    let binary = folder.path().join("binary.yaml");
    std::fs::write(&binary, [0xff, 0xfe, 0x00]).unwrap();
    let message = tactile_pose_fusion::config::load(&binary, DEFAULT_NODE).unwrap_err().to_string();
    assert_eq!(message, format!("{}: can't be read: it is not UTF-8 text", binary.display()));
    let long = folder.path().join("long.yaml");
    std::fs::write(&long, vec![b'x'; 300_000]).unwrap();
    let message = tactile_pose_fusion::config::load(&long, DEFAULT_NODE).unwrap_err().to_string();
    assert_eq!(message, format!("{}: can't be read: it has more than 262144 bytes", long.display()));
    let message = tactile_pose_fusion::config::load(folder.path(), DEFAULT_NODE).unwrap_err().to_string();
    assert!(message.contains("can't be read: Is a directory"), "{message}");
}

const THREE_AXES: &str = "    truth_sources: [cell]
    truth.cell.topic: /cell
    truth.cell.fields: [wrench.force.y, wrench.force.x, wrench.force.z]
";

#[test]
fn a_force_sensor_of_three_axes_has_its_fields_its_signs_and_the_normal_of_its_region() {
    let cfg = with_lines(&format!("{THREE_AXES}    truth.cell.signs: [1, -1, 1]\n")).unwrap();
    let paths = ["wrench.force.y", "wrench.force.x", "wrench.force.z"].map(str::to_owned);
    assert_eq!(cfg.truth()[0].fields.force, ForceFields::Axes(paths));
    let (normal, force) = cfg.truth_sources()[0].force(ForceReading::Axes([1.0, 2.0, 3.0]));
    let in_gf = |newtons: f64| GramForce::from(Newton(newtons));
    assert_eq!((normal, force), (in_gf(3.0), Some([1.0, -2.0, 3.0].map(in_gf))));
    let turned = with_lines(&format!("{THREE_AXES}    region.index.normal: [0.0, -2.0, 0.0]\n")).unwrap();
    assert_eq!(turned.truth_sources()[0].force(ForceReading::Axes([1.0, 2.0, 3.0])).0, in_gf(-2.0));
    // One axis, as before.
    let one = with_lines("    truth_sources: [cell]\n    truth.cell: {topic: /cell, sign: -1}\n").unwrap();
    assert_eq!(one.truth()[0].fields.force, ForceFields::Normal("wrench.force.z".into()));
    assert_eq!(one.truth_sources()[0].force(ForceReading::Normal(2.0)), (in_gf(-2.0), None));
}

#[test]
fn what_can_not_be_three_axes_is_refused_in_one_line() {
    let refused = |lines: &str| with_lines(&format!("{THREE_AXES}{lines}")).unwrap_err();
    assert_eq!(
        refused("    truth.cell.sign: -1\n"),
        "params/index.yaml:13: truth.cell.sign = -1 is for one axis; with truth.cell.fields, set truth.cell.signs"
    );
    assert_eq!(
        refused("    truth.cell.field: wrench.force.z\n"),
        "params/index.yaml:13: truth.cell.field = \"wrench.force.z\" is for one axis; with truth.cell.fields, set truth.cell.fields"
    );
    assert_eq!(
        refused("    truth.cell.signs: [1, -1]\n"),
        "params/index.yaml:13: truth.cell.signs = [1, -1] must have three elements, 1 or -1: one for each of the fields"
    );
    let told = refused("    truth.cell.signs: [1, 2, 1]\n");
    assert!(told.starts_with("params/index.yaml:13: truth.cell.signs = [1, 2, 1] must be 1 or -1"), "{told}");
    let with_fields = |fields: &str| {
        with_lines(&format!("    truth_sources: [cell]\n    truth.cell: {{topic: /cell, fields: {fields}}}\n"))
            .unwrap_err()
    };
    let told = with_fields("[wrench.force.x, wrench.force.y]");
    assert!(told.ends_with("must name three fields: the force along x, y and z of the patch"), "{told}");
    let told = with_fields("[a.x, a.y, a.x]");
    assert!(told.ends_with("has \"a.x\" twice"), "{told}");
    let told = with_fields("[a.x, a..y, a.z]");
    assert!(told.ends_with("has \"a..y\", which is not the path of a field, such as wrench.force.x"), "{told}");
    let one = "    truth_sources: [cell]\n    truth.cell: {topic: /cell, signs: [1, 1, 1]}\n";
    let told = with_lines(one).unwrap_err();
    assert!(told.ends_with("is for truth.cell.fields; set truth.cell.sign for one axis"), "{told}");
    // Two regions that are pressed from different sides, under one sensor.
    let two = THREE_AXES.to_owned()
        + "    region.thumb: {model: tip, joints: [dip, pip], frame_id: thumb_tip, normal: [0.0, 0.0, -1.0]}\n";
    let text = format!("{BASE}{two}").replace("regions: [index]", "regions: [index, thumb]");
    let tree = parse_param_file(&text, "params/index.yaml", DEFAULT_NODE).unwrap();
    let told = Config::from_tree(&tree).unwrap_err().to_string();
    assert!(
        told.contains("region.thumb.normal = [0.0, 0.0, -1.0] must be that of region.index.normal: both are measured"),
        "{told}"
    );
}
