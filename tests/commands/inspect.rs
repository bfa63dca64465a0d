//! `tpf inspect` as a user runs it: what it tells of bags and models, and how it ends.

use crate::common;

use std::path::{Path, PathBuf};

use common::bags::{Bag, decoded};
use common::layouts;
use common::onnx::LinearModel;
use common::tpf::{Run, tpf};
use serde_json::Value;
use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, BagWriter, NewChannel, WriteOptions};
use tactile_pose_fusion::msg::*;
use tactile_pose_fusion::units::Stamp;

const MS: i64 = 1_000_000;
const START: i64 = 1_700_000_000_000 * MS;

fn at(ms: i64) -> Stamp {
    Stamp(START + ms * MS)
}

fn inspect_json(folder: &Path, path: &str) -> Value {
    tpf(folder, &["inspect", path, "--json"]).ok().json()[0].clone()
}

fn topic<'v>(report: &'v Value, name: &str) -> &'v Value {
    let topics = report["topics"].as_array().unwrap();
    topics.iter().find(|topic| topic["topic"] == name).unwrap_or_else(|| panic!("no {name} in {report}"))
}

/// A glove at 100 Hz with a hole of 100 ms, stamped 3 ms before receipt, joints in degrees, annotations and a wrench.
fn glove_bag(path: &Path) {
    let mut bag = Bag::create(path);
    let header = |ms| Header { stamp: at(ms).into(), frame_id: String::new() };
    let zero_load = |ms, zero_load| Stage {
        header: header(ms),
        stage: 1,
        substage: String::new(),
        pose: String::new(),
        repetition: 0,
        zero_load,
    };
    bag.send("/notes/stage", at(0), &zero_load(0, true));
    for n in 0..300_i64 {
        if (100..110).contains(&n) {
            continue;
        }
        let taxels = TaxelArray {
            header: header(10 * n - 3),
            sequence: n as u32,
            rows: 1,
            row_period: Duration::default(),
            values: vec![n as f32, 1.0, 2.0],
        };
        bag.send("/glove/taxels", at(10 * n), &taxels);
        bag.joints(at(10 * n), &["dip", "mcp"], &[0.3 * n as f64, 0.1]);
    }
    bag.send("/notes/stage", at(2000), &zero_load(2000, false));
    for n in 0..20 {
        let wrench = WrenchStamped { header: header(n * 50), wrench: Wrench::default() };
        bag.send("/scale", at(n * 50), &wrench);
    }
    bag.finish();
}

#[test]
fn stamps_are_told_apart_from_times_of_receipt() {
    let folder = tempfile::tempdir().unwrap();
    glove_bag(&folder.path().join("glove.mcap"));
    let report = inspect_json(folder.path(), "glove.mcap");
    assert_eq!(report["kind"], "bag");
    assert_eq!(report["n_messages"], 602);
    assert_eq!(report["duration_s"], 2.99);
    assert_eq!(report["files"], serde_json::json!(["glove.mcap"]));
    let taxels = topic(&report, "/glove/taxels");
    assert_eq!((&taxels["n_gaps"], &taxels["interval_max_ms"]), (&1.into(), &110.0.into()));
    let stamps = &taxels["stamps"];
    assert_eq!((&stamps["n_gaps"], &stamps["n_backward"], &stamps["n_unset"]), (&1.into(), &0.into(), &0.into()));
    for key in ["delay_mean_ms", "delay_min_ms", "delay_max_ms"] {
        assert!((stamps[key].as_f64().unwrap() - 3.0).abs() < 1e-9, "{key}: {stamps}");
    }
    // 289 intervals in 2.99 s.
    assert!((stamps["rate_hz"].as_f64().unwrap() - 289.0 / 2.99).abs() < 1e-9);
}

#[test]
fn candidates_of_a_glove_bag_are_found_with_their_reasons() {
    let folder = tempfile::tempdir().unwrap();
    glove_bag(&folder.path().join("glove.mcap"));
    let report = inspect_json(folder.path(), "glove.mcap");
    let tactile = &report["tactile"][0];
    assert_eq!((&tactile["topic"], &tactile["likelihood"]), (&"/glove/taxels".into(), &"likely".into()));
    assert_eq!((&tactile["n_taxels"], &tactile["field"]), (&3.into(), &"values".into()));
    assert_eq!(tactile["values"], serde_json::json!([0.0, 299.0]));
    let joints = &report["joints"][0];
    assert_eq!(joints["looks_like_degrees"], true);
    assert_eq!((&joints["angles"][0]["name"], &joints["angles"][0]["beyond_a_turn"]), (&"dip".into(), &true.into()));
    assert_eq!((&joints["angles"][1]["name"], &joints["angles"][1]["beyond_a_turn"]), (&"mcp".into(), &false.into()));
    assert!(joints["parameters"].as_str().unwrap().contains("degrees: true"));
    assert_eq!(report["force"][0]["topic"], "/scale");
    assert_eq!(report["force"][0]["fields"], serde_json::json!(["wrench.force.x", "wrench.force.y", "wrench.force.z"]));
    assert_eq!(
        report["stages"],
        serde_json::json!([{
            "topic": "/notes/stage", "n_messages": 2, "n_zero_load": 1, "parameters": "stage_topic: /notes/stage\n"
        }])
    );
    let text = tpf(folder.path(), &["inspect", "glove.mcap"]).ok().stdout;
    for words in ["602 messages on 4 topics in 2.99 s", "/glove/taxels (values): likely", "dip 0 to 89.7 (degrees?)"] {
        assert!(text.contains(words), "no {words:?} in {text}");
    }
}

/// Blocks of 4 samples of 3 taxels in a type of its own, and joints that name themselves in another.
fn foreign_bag(path: &Path) {
    let mut bag = Bag::create(path);
    let channel = |topic, type_name, schema_text| NewChannel {
        topic,
        type_name,
        schema_text,
        qos_yaml: BEST_EFFORT_QOS,
        type_hash: "",
    };
    let skin =
        channel("/skin", "acme/msg/Patch", "uint32 rows\nuint32 cols\nbuiltin_interfaces/Time at\nint16[] raw\n");
    let angles = channel("/hand/angles", "acme/msg/Angles", "string[] names\nfloat32[] rad\n");
    let (skin, angles) = (bag.writer.add_channel(skin).unwrap(), bag.writer.add_channel(angles).unwrap());
    for n in 0..400_i64 {
        let (sec, nanosec) = at(10 * n).to_sec_nanosec();
        let mut cdr = vec![0, 1, 0, 0];
        for word in [4, 3, sec.cast_unsigned(), nanosec, 12] {
            cdr.extend(word.to_le_bytes());
        }
        (0..12_i16).for_each(|idx| cdr.extend((idx * 7 + (n % 13) as i16).to_le_bytes()));
        bag.writer.write(skin, 0, at(10 * n), at(10 * n), &cdr).unwrap();
        let mut cdr = vec![0, 1, 0, 0, 1, 0, 0, 0, 4, 0, 0, 0];
        cdr.extend(b"dip\0");
        cdr.extend(1_u32.to_le_bytes());
        cdr.extend(0.5_f32.to_le_bytes());
        bag.writer.write(angles, 0, at(10 * n), at(10 * n), &cdr).unwrap();
    }
    bag.finish();
}

#[test]
fn pasted_parameter_lines_replay_the_bag() {
    let folder = tempfile::tempdir().unwrap();
    foreign_bag(&folder.path().join("foreign.mcap"));
    LinearModel::new(8, 3, 1).metadata("unit", "N").write(folder.path(), "model.onnx");
    let report = inspect_json(folder.path(), "foreign.mcap");
    let tactile = &report["tactile"][0];
    assert_eq!((&tactile["field"], &tactile["n_taxels"]), (&"raw".into(), &3.into()));
    assert_eq!(tactile["rows"], serde_json::json!({"field": "rows", "values": [4, 4]}));
    assert_eq!(tactile["cols"], serde_json::json!({"field": "cols", "values": [3, 3]}));
    let joints = &report["joints"][0];
    assert_eq!((&joints["field"], &joints["likelihood"]), (&"rad".into(), &"likely".into()));

    let mut params = "/tactile_pose_fusion:\n  ros__parameters:\n    regions: [tip]\n    tactile_sources: [skin]\n    \
                      joint_sources: [hand_angles]\n    model.m.path: model.onnx\n    region.tip: {model: m, joints: [dip], \
                      frame_id: tip}\n"
        .to_owned();
    for lines in [&tactile["parameters"], &joints["parameters"]] {
        lines.as_str().unwrap().lines().for_each(|line| params += &format!("    {line}\n"));
    }
    std::fs::write(folder.path().join("params.yaml"), &params).unwrap();
    let replay =
        ["replay", "foreign.mcap", "--params-file", "params.yaml", "-o", "out.mcap", "--calibrate-first", "2.5"];
    let run = tpf(folder.path(), &[&replay[..], &["--json", "-p", "calibration.max_force:=1000.0"]].concat());
    assert_eq!(run.code, 0, "{params}\n{run:?}");
    assert_eq!(run.json()["topics"]["/skin"]["read"], 400);
    assert_eq!(run.json()["topics"]["/hand/angles"]["read"], 400);
}

/// Replays a bag with the lines that `inspect` prints for it, and gives the contacts that come out.
fn pasted(folder: &Path, bag: &str, region: &str, lines: &[&Value]) -> Vec<ContactArray> {
    let mut params = format!(
        "/tactile_pose_fusion:\n  ros__parameters:\n    regions: [tip]\n    tactile_sources: [skin]\n    joint_sources: \
         [hand]\n    model.m.path: model.onnx\n    region.tip: {region}\n    calibration.max_force: 1000.0\n"
    );
    for lines in lines {
        for line in lines.as_str().unwrap().lines() {
            // The names of the sources are the reader's to choose.
            let is_name = line.starts_with("  ") && !line.starts_with("   ");
            let in_taxels = lines.as_str().unwrap().starts_with("tactile");
            let named = if in_taxels { "  skin:" } else { "  hand:" };
            params += &format!("    {}\n", if is_name { named } else { line });
        }
    }
    std::fs::write(folder.join("params.yaml"), &params).unwrap();
    let replay = ["replay", bag, "--params-file", "params.yaml", "-o", "out.mcap", "--calibrate-first", "2.5"];
    let run = tpf(folder, &[&replay[..], &["--overwrite"]].concat());
    assert_eq!(run.code, 0, "{params}\n{run:?}");
    decoded(&folder.join("out.mcap"), "/tactile_pose_fusion/contacts")
}

#[test]
fn nested_arrays_of_sensors_and_gloves_on_the_market_go_from_inspect_to_forces() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    for (name, n_taxels, field) in
        [("xela", 8, "sensors[].taxels[].z"), ("contactile", 9, "pillars[].fZ"), ("image", 8, "data")]
    {
        let bag_name = format!("{name}.mcap");
        let mut bag = Bag::create(&path.join(&bag_name));
        let manus = layouts::add::<layouts::ManusGlove>(&mut bag, "/manus_glove_0");
        let skin = match name {
            "xela" => layouts::add::<layouts::SensStream>(&mut bag, "/xServTopic"),
            "image" => layouts::add::<layouts::Image>(&mut bag, "/glove/pressure"),
            _ => layouts::add::<layouts::SensorState>(&mut bag, "/hub_0/sensor_0"),
        };
        for k in 0..600 {
            layouts::send(&mut bag, manus, at(10 * k), &layouts::manus_glove(k));
            match name {
                "image" => layouts::send(&mut bag, skin, at(10 * k), &layouts::image(at(10 * k), k)),
                "xela" => layouts::send(&mut bag, skin, at(10 * k), &layouts::sens_stream(at(10 * k), k)),
                _ => layouts::send(&mut bag, skin, at(10 * k), &layouts::sensor_state(at(10 * k), k)),
            }
        }
        bag.finish();
        let model = LinearModel::new(8, n_taxels, 2).metadata("unit", "N");
        model.write(path, "model.onnx");
        let report = inspect_json(path, &bag_name);
        let of = |kind: &str, field: &str| {
            let all = report[kind].as_array().unwrap();
            all.iter().find(|one| one["field"] == field).unwrap_or_else(|| panic!("{name}: no {field} in {report}"))
        };
        let (taxels, joints) = (of("tactile", field), of("joints", "ergonomics[].value"));
        assert_eq!((&taxels["n_taxels"], &taxels["likelihood"]), (&n_taxels.into(), &"likely".into()), "{name}");
        let words = joints["parameters"].as_str().unwrap();
        assert!(words.contains("names_field: \"ergonomics[].type\"\n"), "{words}");
        assert!(words.contains("degrees: true\n") && words.contains("stamp: receipt"), "{words}");
        assert_eq!(report["joints"].as_array().unwrap().len(), 1, "coordinates are no angles: {report}");

        let region = "{model: m, joints: [IndexPIPStretch, IndexSpread], frame_id: tip}";
        let contacts = pasted(path, &bag_name, region, &[&taxels["parameters"], &joints["parameters"]]);
        assert_eq!(contacts.len(), 600, "{name}");
        let last = contacts.last().unwrap();
        let zero: Vec<f32> = (0..n_taxels).map(|taxel| 100.0 + taxel as f32).collect();
        let features: Vec<f32> =
            layouts::readings(n_taxels, 599).iter().zip(&zero).map(|(now, zero)| now - zero).collect();
        let angles = [layouts::degrees(2, 599).to_radians(), layouts::degrees(0, 599).to_radians()];
        let expected = model.expected(&features, &angles).0;
        let force = last.contacts[0].force;
        // Sums in another order, and degrees turned in f64 there and in f32 here.
        assert!((force - f64::from(expected)).abs() < 1e-4, "{name}: {force} is not {expected}");
    }
}

#[test]
fn backward_and_unset_stamps_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("odd.mcap"));
    for (log, stamp) in [(0, at(0)), (10, at(10)), (20, Stamp(0)), (30, at(5)), (40, at(5)), (50, at(40))] {
        let header = Header { stamp: stamp.into(), frame_id: String::new() };
        bag.send("/w", at(log), &WrenchStamped { header, wrench: Wrench::default() });
    }
    bag.finish();
    let report = inspect_json(folder.path(), "odd.mcap");
    let stamps = &topic(&report, "/w")["stamps"];
    assert_eq!((&stamps["n_unset"], &stamps["n_backward"], &stamps["n_repeated"]), (&1.into(), &1.into(), &1.into()));
    assert_eq!((&stamps["backward_max_ms"], &stamps["delay_max_ms"]), (&5.0.into(), &35.0.into()));
}

#[test]
fn topics_that_can_not_be_read_are_listed_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("odd.mcap"));
    let broken = NewChannel {
        topic: "/broken",
        type_name: "acme/msg/Lost",
        schema_text: "acme/Other other\n",
        qos_yaml: BEST_EFFORT_QOS,
        type_hash: "",
    };
    let broken = bag.writer.add_channel(broken).unwrap();
    bag.writer.write(broken, 0, at(0), at(0), &[0, 1, 0, 0, 7]).unwrap();
    bag.send_bytes::<JointState>("/cut", at(1), &[0, 1, 0, 0, 1, 0]);
    bag.finish();
    let report = inspect_json(folder.path(), "odd.mcap");
    let note = |name| topic(&report, name)["notes"][0].as_str().unwrap().to_owned();
    assert!(note("/broken").contains("acme/msg/Other, which is not defined"), "{report}");
    assert!(note("/cut").starts_with("1 messages could not be read, the first: "), "{report}");
    assert_eq!(report["joints"], serde_json::json!([]));
    let text = tpf(folder.path(), &["inspect", "odd.mcap"]).ok().stdout;
    assert!(text.contains("/broken: not looked into: "), "{text}");
}

#[test]
fn cut_bag_shows_what_is_left_and_ends_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("glove.mcap");
    glove_bag(&path);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let run = tpf(folder.path(), &["inspect", "glove.mcap", "--json"]);
    assert_eq!(run.code, 3, "{run:?}");
    let losses = run.json()[0]["losses"].as_array().unwrap().len();
    assert!(losses > 0 && run.stderr.lines().count() == losses, "{run:?}");
    assert!(run.stderr.lines().all(|line| line.starts_with("input lost: ")), "{run:?}");
}

#[test]
fn model_tells_its_contract() {
    let folder = tempfile::tempdir().unwrap();
    LinearModel::new(64, 16, 2)
        .metadata("unit", "gF")
        .metadata("joints", r#"["dip","pip"]"#)
        .metadata("pose_range", r#"[[0.0,1.5],[-0.1,1.7]]"#)
        .metadata("metrics", r#"{"mdf_gf": 4.5}"#)
        .metadata("odd\u{1b}key", "two\nlines")
        .write(folder.path(), "model.onnx");
    let report = inspect_json(folder.path(), "model.onnx");
    assert_eq!(report["kind"], "model");
    assert_eq!((&report["contract"]["window"], &report["contract"]["taxels"]), (&64.into(), &16.into()));
    assert_eq!((&report["unit_from"], &report["rate_from"]), (&"metadata".into(), &"default".into()));
    let text = tpf(folder.path(), &["inspect", "model.onnx"]).ok().stdout;
    for words in ["[N, 64, 16]", "2: dip, pip", "gF, as its metadata says", "assumed", "85.9", "4.50 gF", "two lines"] {
        assert!(text.contains(words), "no {words:?} in {text}");
    }
    assert!(!text.contains('\u{1b}'));
}

#[test]
fn paths_that_can_not_be_opened_take_a_line_each_and_the_others_are_told_of() {
    let folder = tempfile::tempdir().unwrap();
    glove_bag(&folder.path().join("glove.mcap"));
    std::fs::write(folder.path().join("notes.txt"), "no bag").unwrap();
    std::fs::write(folder.path().join("not.onnx"), "no model").unwrap();
    let run = tpf(folder.path(), &["inspect", "gone.mcap", "glove.mcap", "notes.txt", "not.onnx", "--json"]);
    assert_eq!(run.code, 1, "{run:?}");
    let lines: Vec<&str> = run.stderr.lines().collect();
    assert_eq!(lines.len(), 3, "{run:?}");
    for (line, name) in lines.iter().zip(["gone.mcap", "notes.txt", "not.onnx"]) {
        assert!(line.starts_with(&format!("tpf: {name}: ")), "{line}");
    }
    let kinds: Vec<String> =
        run.json().as_array().unwrap().iter().map(|report| report["kind"].as_str().unwrap().to_owned()).collect();
    assert_eq!(kinds, ["refused", "bag", "refused", "refused"]);
}

/// Every file and folder below `folder`, in order.
fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        found.push(path.clone());
        if path.is_dir() {
            walk(&path, found);
        }
    }
}

/// How `tpf inspect` must end with a path of the shared data.
fn expected_code(path: &Path) -> i32 {
    let name = path.file_name().unwrap().to_str().unwrap();
    let holds = |ending: &str| {
        let mut entries = std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path());
        entries.any(|entry| entry.extension().is_some_and(|extension| extension == ending))
    };
    match name {
        // Cut off, and without the definitions of its channels.
        "chunk_not_closed.mcap" | "zstd_chunk_with_padding.mcap" => 3,
        // Of ROS 1.
        "compressed.mcap" | "uncompressed.mcap" | "mcap_crate_testdata" => 1,
        _ if path.is_dir() => i32::from(!holds("mcap") && !holds("db3")),
        _ => i32::from(!name.ends_with(".mcap") && !name.ends_with(".db3")),
    }
}

#[test]
fn every_file_of_the_shared_data_opens_or_is_refused_with_one_line() {
    let Some(shared) = common::shared() else { return };
    let mut paths = Vec::new();
    walk(&shared.join("data"), &mut paths);
    assert!(paths.len() > 100, "{}", paths.len());
    for path in paths {
        let run: Run = tpf(&shared, &["inspect", path.to_str().unwrap()]);
        assert_eq!(run.code, expected_code(&path), "{path:?}: {run:?}");
        assert!(!run.stderr.contains("panicked"), "{path:?}: {run:?}");
        // A folder says so when it holds several recordings, or the parts of one without a list of them.
        if run.stderr.contains("each by itself") || run.stderr.contains("are read as one split recording") {
            continue;
        }
        assert_eq!(run.stderr.lines().count(), usize::from(run.code != 0), "{path:?}: {run:?}");
        assert_eq!(run.stdout.is_empty(), run.code == 1, "{path:?}: {run:?}");
    }
}

#[test]
fn recorded_load_cell_is_explained_by_its_rows_and_columns() {
    let Some(shared) = common::shared() else { return };
    let report = inspect_json(&shared.join("data/mcap_crab_loadcell"), "adya_gait.bag");
    assert_eq!(report["n_messages"], 5637);
    let tactile = &report["tactile"][0];
    assert_eq!((&tactile["topic"], &tactile["n_taxels"]), (&"/load_cell_data".into(), &6.into()));
    assert_eq!(tactile["n_values"], serde_json::json!([120, 120]));
    assert_eq!(report["force"][0]["topic"], "/load_cell_data");
    let joints: Vec<&Value> = report["joints"].as_array().unwrap().iter().map(|one| &one["topic"]).collect();
    assert_eq!(joints, ["/servo/encoder_data", "/servo/position_data"]);
    let stamps = &topic(&report, "/load_cell_data")["stamps"];
    // As measured by other readers of the same file.
    assert!((stamps["delay_mean_ms"].as_f64().unwrap() - 0.14).abs() < 0.01, "{stamps}");
    assert!((stamps["interval_max_ms"].as_f64().unwrap() - 301.0).abs() < 1.0, "{stamps}");
}

/// `tpf inspect --json` in 1 GB of address space.
fn inspect_in_a_gigabyte(folder: &Path, path: &str) -> Value {
    let script = "ulimit -v 1000000; exec \"$0\" inspect \"$1\" --json";
    let mut command = std::process::Command::new("bash");
    let run: Run =
        command.current_dir(folder).args(["-c", script, env!("CARGO_BIN_EXE_tpf"), path]).output().unwrap().into();
    assert!(!run.stdout.is_empty(), "{}", run.stderr);
    run.json()[0].clone()
}

#[test]
fn topics_without_end_take_bounded_memory() {
    let folder = tempfile::tempdir().unwrap();
    let text = definition_text(TaxelArray::TYPE_NAME).unwrap();
    let mut writer = BagWriter::create(&folder.path().join("many.mcap"), WriteOptions::default()).unwrap();
    for n in 0..10_000 {
        let (topic, type_name) = (format!("/topic_{n:05}"), TaxelArray::TYPE_NAME);
        let channel = NewChannel { topic: &topic, type_name, schema_text: &text, qos_yaml: "", type_hash: "" };
        let channel = writer.add_channel(channel).unwrap();
        writer.write(channel, 0, at(n), at(n), &[0, 1, 0, 0]).unwrap();
    }
    writer.finish().unwrap();
    let report = inspect_in_a_gigabyte(folder.path(), "many.mcap");
    assert_eq!(report["topics"].as_array().unwrap().len(), 4096);
    assert_eq!((&report["n_more_topics"], &report["n_messages"]), (&5_904.into(), &10_000.into()));
    let text = tpf(folder.path(), &["inspect", "many.mcap"]).ok().stdout;
    assert!(text.contains("5,904 further topics are not told of"), "{}", &text[..400]);
}

#[test]
fn a_channel_that_is_defined_again_and_again_takes_bounded_memory_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let string = |text: &str| [(text.len() as u32).to_le_bytes().to_vec(), text.as_bytes().to_vec()].concat();
    let record = |opcode: u8, body: &[u8]| [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat();
    let schema = [vec![1, 0], string("std_msgs/msg/UInt64"), string("ros2msg"), string("uint64 data")].concat();
    let mut bytes =
        [mcap::MAGIC.to_vec(), record(1, &[string("ros2"), string("")].concat()), record(3, &schema)].concat();
    for n in 0..100_000_u32 {
        // Half of them on one topic, with other notes each time.
        let topic = if n % 2 == 0 { "/one".to_owned() } else { format!("/topic_{n}") };
        let notes = [string("n"), string(&n.to_string())].concat();
        let notes = [(notes.len() as u32).to_le_bytes().to_vec(), notes].concat();
        bytes.extend(record(4, &[vec![1, 0, 1, 0], string(&topic), string("cdr"), notes].concat()));
        let time = u64::from(n).to_le_bytes();
        bytes.extend(record(
            5,
            &[&[1, 0, 0, 0, 0, 0][..], &time, &time, &[0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0]].concat(),
        ));
    }
    std::fs::write(folder.path().join("again.mcap"), bytes).unwrap();
    let report = inspect_in_a_gigabyte(folder.path(), "again.mcap");
    assert_eq!((&report["n_messages"], &topic(&report, "/one")["n_messages"]), (&100_000.into(), &50_000.into()));
    assert_eq!(report["topics"].as_array().unwrap().len(), 4096);
}

#[test]
fn a_force_is_told_with_its_range_and_with_the_way_it_goes_when_taxels_rise() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("press.mcap"));
    for n in 0..400_i64 {
        let press = if (n / 50) % 2 == 1 { 4.0 } else { 0.0 };
        let header = || Header { stamp: at(10 * n).into(), frame_id: String::new() };
        let taxels = TaxelArray {
            header: header(),
            sequence: n as u32,
            rows: 1,
            row_period: Duration::default(),
            values: vec![100.0 + 50.0 * press as f32 + (n % 7) as f32, 90.0],
        };
        bag.send("/glove/taxels", at(10 * n), &taxels);
        let force = Vector3 { x: 0.1 * (n % 3) as f64, y: 0.5 + press, z: -press };
        let wrench = Wrench { force, ..Wrench::default() };
        bag.send("/scale", at(10 * n + 1), &WrenchStamped { header: header(), wrench });
    }
    bag.finish();
    let report = inspect_json(folder.path(), "press.mcap");
    let ranges = report["force"][0]["ranges"].as_array().unwrap();
    let of = |field: &str| ranges.iter().find(|range| range["field"] == field).unwrap();
    assert_eq!(of("wrench.force.z")["values"], serde_json::json!([-4.0, 0.0]));
    assert!(of("wrench.force.z")["with_taxels"].as_f64().unwrap() < -0.9, "{ranges:?}");
    assert!(of("wrench.force.y")["with_taxels"].as_f64().unwrap() > 0.9, "{ranges:?}");
    assert!(of("wrench.force.x")["with_taxels"].as_f64().unwrap().abs() < 0.3, "{ranges:?}");
    let text = tpf(folder.path(), &["inspect", "press.mcap"]).ok().stdout;
    assert!(text.contains("wrench.force.y: 0.50 to 4.50; it rises with /glove/taxels (values)"), "{text}");
    assert!(
        text.contains(
            "wrench.force.z: -4.00 to 0; it falls where /glove/taxels (values) rises, so one of the two needs sign: -1: the one that falls under a press"
        ),
        "{text}"
    );
}
