//! `tpf init` as a user runs it: from a bag to a parameter file that loads and replays.

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};

use common::ROOT;
use common::bags::{Bag, Recorded, at, decoded, messages};
use common::layouts;
use common::onnx::LinearModel;
use common::tpf::{Run, tpf};
use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, NewChannel};
use tactile_pose_fusion::config::{self, Config, DEFAULT_NODE};
use tactile_pose_fusion::glove::replace_model;
use tactile_pose_fusion::msg::{
    Float32MultiArray, Header, JointState, MultiArrayLayout, Stage, TFMessage, TaxelArray, WireType, WrenchStamped,
    from_cdr, to_cdr,
};

const INDEX: [&str; 4] = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"];

fn in_source(path: &str) -> String {
    format!("{ROOT}/{path}")
}

/// A synthetic session of two minutes, and its path.
fn simulated(folder: &Path, glove: &str, hand: &str) -> String {
    let args = ["simulate", "--glove", glove, "--users", "1", "--sessions", "1", "--minutes=1.7", "--seed", "7"];
    tpf(folder, &[&args[..], &["--hand", hand, "-o", "sessions"]].concat()).ok();
    format!("sessions/{}_user01_session1", if glove.len() == 1 { format!("glove{glove}") } else { glove.to_owned() })
}

fn init(folder: &Path, bag: &str, more: &[&str]) -> Run {
    tpf(folder, &[&["init", bag, "-o", "made.yaml"], more].concat())
}

fn load(folder: &Path) -> Config {
    let path = folder.join("made.yaml");
    let text = || fs::read_to_string(&path).unwrap();
    config::load(&path, DEFAULT_NODE).unwrap_or_else(|error| panic!("{error}\n{}", text()))
}

/// Forces on a region that replay writes, N.
fn forces(folder: &Path, bag: &str, params: &str, region: &str, more: &[&str]) -> Vec<(i64, f64)> {
    let args = ["replay", bag, "--params-file", params, "-o", "out.mcap", "--overwrite"];
    tpf(folder, &[&args[..], more].concat()).ok();
    let topic = format!("/tactile_pose_fusion/{region}/wrench");
    let wrenches: Vec<WrenchStamped> = decoded(&folder.join("out.mcap"), &topic);
    let force = |one: &WrenchStamped| {
        let stamp = i64::from(one.header.stamp.sec) * 1_000_000_000 + i64::from(one.header.stamp.nanosec);
        (stamp, one.wrench.force.z)
    };
    wrenches.iter().map(force).collect()
}

#[test]
fn the_file_of_a_synthetic_glove_gives_the_forces_of_the_one_that_ships() {
    for glove in 1..=3 {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let bag = simulated(folder, &glove.to_string(), "angles");
        // The first with the model that its file names, the paper's network; the others with one that runs faster.
        let kind = if glove == 1 { "pose_aware" } else { "adaptive" };
        let model = in_source(&format!("models/glove{glove}_{kind}.onnx"));
        let run = init(folder, &bag, &["--model", &model]).ok(); // nobody is there to ask: nothing is open
        assert_eq!(run.stderr, "", "{run:?}");
        assert!(run.stdout.contains("tpf replay"), "{run:?}");
        let (made, shipped) = (load(folder), in_source(&format!("params/glove{glove}.yaml")));
        let mut known = config::load(shipped.as_ref(), DEFAULT_NODE).unwrap();
        if glove > 1 {
            // The adaptive model of glove 2 has a joint of the next finger besides those of the region.
            replace_model(&mut known, model.clone().into()).unwrap();
        }
        assert_eq!(
            made.fusion().tactile_sources()[0].inverted,
            known.fusion().tactile_sources()[0].inverted,
            "glove {glove}"
        );
        assert_eq!(made.fusion().tactile_sources()[0].frame_clock, known.fusion().tactile_sources()[0].frame_clock);
        assert_eq!((made.tactile(), made.joints()), (known.tactile(), known.joints()));
        assert_eq!((made.truth(), &made.truth_sources()[0].unit), (known.truth(), &known.truth_sources()[0].unit));
        assert_eq!(made.truth_sources()[0].inverted, known.truth_sources()[0].inverted);
        // No bag tells the threshold that was chosen for glove 2.
        let chosen = known.fusion().regions()[0].contact.touch;
        assert_eq!(chosen.is_some(), glove == 2);
        let mut regions = made.fusion().regions().to_vec();
        regions[0].contact.touch = chosen;
        assert_eq!(regions, known.fusion().regions());
        let touch_on = chosen.map(|levels| format!("contact.touch_on:={}", levels.on));
        let chosen: Vec<&str> = touch_on.iter().flat_map(|touch_on| ["-p", touch_on.as_str()]).collect();
        let of_made = forces(folder, &bag, "made.yaml", "index", &chosen);
        let with = ["--model", &model];
        let of_shipped = forces(folder, &bag, &shipped, "index", if glove == 1 { &[] } else { &with });
        assert!(of_made.len() > 9_000, "{}", of_made.len());
        assert_eq!(of_made.len(), of_shipped.len());
        let same = |(a, b): (&(i64, f64), &(i64, f64))| a.0 == b.0 && a.1.to_bits() == b.1.to_bits();
        assert!(of_made.iter().zip(&of_shipped).all(same), "glove {glove}");
    }
}

#[test]
fn a_whole_hand_has_a_region_a_finger_each_with_its_own_joints_and_force() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bag = simulated(folder, "hand1", "angles");
    let model = in_source("models/glove1_pose_aware.onnx");
    init(folder, &bag, &["--model", &model]).ok();
    let (made, known) = (load(folder), config::load(in_source("params/hand1.yaml").as_ref(), DEFAULT_NODE).unwrap());
    let parts = |cfg: &Config| -> Vec<_> {
        let truth = |idx: usize| cfg.truth_of_region()[idx].map(|truth| cfg.truth()[truth].name.clone());
        let regions = cfg.fusion().regions().iter().enumerate();
        regions
            .map(|(idx, one)| {
                (one.name.clone(), one.taxels.clone(), one.joints.clone(), truth(idx), one.patch.frame_id.clone())
            })
            .collect()
    };
    let sorted = |mut parts: Vec<_>| {
        parts.sort();
        parts
    };
    assert_eq!(sorted(parts(&made)), sorted(parts(&known)));
    // The model was trained on the index finger, so it reads the joints of the others under the index finger's names.
    let of_index = &made.fusion().regions()[made.fusion().region_named("index").unwrap().position()].joints;
    for region in made.fusion().regions() {
        let is_index = region.name == "index";
        assert_eq!(region.model_joints, if is_index { Vec::new() } else { of_index.clone() }, "{}", region.name);
    }
    // Without a model the taxels are divided all the same, by the fingers that are named.
    let run = init(folder, &bag, &["--yes", "--overwrite"]).ok();
    assert!(run.stderr.contains("How do the 30 taxels"), "{run:?}");
    assert_eq!(load(folder).fusion().regions().len(), 5);
}

#[test]
fn what_was_seen_of_one_fingers_load_cell_is_not_said_of_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let args = [
        "simulate",
        "--glove",
        "hand1",
        "--users",
        "1",
        "--sessions",
        "1",
        "--minutes=2",
        "--finger",
        "index",
        "--seed",
        "7",
    ];
    tpf(folder, &[&args[..], &["-o", "sessions"]].concat()).ok();
    init(folder, "sessions/hand1_user01_session1", &["--yes"]).ok();
    let text = fs::read_to_string(folder.join("made.yaml")).unwrap();
    let of_others = text.matches("CHECK: not in these bags; named as that of the index finger").count();
    let seen = text.lines().filter(|line| line.contains("field: wrench.force.z") && line.contains("correlation"));
    assert_eq!((of_others, seen.count(), load(folder).truth_sources().len()), (4, 1, 5), "{text}");
}

#[test]
fn without_a_press_the_axis_of_a_load_cell_is_to_be_checked_and_all_bags_are_trained_on() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bag = simulated(folder, "1", "angles");
    // The first seconds, in the air.
    let all = messages(&folder.join(&bag));
    let first = all[0].log_time;
    let mut air = Bag::create(&folder.join("air.mcap"));
    let is_early = |message: &&Recorded| message.log_time.nanos_since(first) < 8_000_000_000;
    all.iter().filter(is_early).filter(|message| message.topic != "/stage").for_each(|one| air.send_recorded(one));
    air.finish();
    let run = init(folder, "air.mcap", &["--yes"]).ok();
    let expected = "truth.load_cell_wrench.field: ";
    let shown = run.stdout.lines().find(|line| line.trim().starts_with(expected)).unwrap_or_else(|| panic!("{run:?}"));
    assert!(shown.contains("CHECK: no press was seen that the taxels feel"), "{shown}");
    let text = fs::read_to_string(folder.join("made.yaml")).unwrap();
    assert!(!text.contains("so a press is taken to lower it"), "{text}");
    let args = ["init", "air.mcap", bag.as_str(), "-o", "both.yaml", "--yes"];
    let both = tpf(folder, &args).ok().stdout;
    assert!(both.contains(&format!("next: tpf train air.mcap {bag} --params-file both.yaml")), "{both}");
}

#[test]
fn points_of_a_hand_become_its_joint_angles() {
    let forms = [
        ("openxr", "/hand/poses", "openxr"),
        ("openxr25", "/hand/poses", "openxr25"),
        ("mano21", "/hand/poses", "mano21"),
        ("keypoints26", "/hand/keypoints", "openxr"),
        ("keypoints21", "/hand/keypoints", "mano21"),
        ("named", "/hand/named_poses", "openxr"),
        ("transforms", "/tf", "openxr25"),
    ];
    for (form, topic, layout) in forms {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let bag = simulated(folder, "1", form);
        let model = in_source("models/glove1_adaptive.onnx"); // the paper's network takes seconds
        let run = init(folder, &bag, &["--model", &model]);
        assert!(run.failure().contains(&format!("Which hand is {topic}")), "{form}: {run:?}");
        assert!(!folder.join("made.yaml").exists());
        let run = init(folder, &bag, &["--model", &model, "--yes"]).ok();
        assert!(run.stderr.starts_with("guessed: Which hand") && run.stderr.lines().count() == 1, "{run:?}");
        let text = fs::read_to_string(folder.join("made.yaml")).unwrap();
        assert!(text.contains(&format!("hand.layout: {layout}")) && text.contains("hand.side: right"), "{text}");
        assert_eq!(load(folder).fusion().regions()[0].joints, INDEX);
        assert!(forces(folder, &bag, "made.yaml", "index", &[]).len() > 9_000);
    }
}

#[test]
fn a_glove_that_says_which_hand_it_is_is_not_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bag = simulated(folder, "1", "manus");
    let run = init(folder, &bag, &["--model", &in_source("models/glove1_adaptive.onnx")]).ok();
    assert_eq!(run.stderr, "", "{run:?}");
    let text = fs::read_to_string(folder.join("made.yaml")).unwrap();
    for line in [
        "topic: /manus_glove_0",
        "only: \"side=Right\"",
        "hand.layout: manus",
        "hand.side: right  # as its messages say",
    ] {
        assert!(text.contains(line), "{line} is not in\n{text}");
    }
    assert_eq!(load(folder).fusion().regions()[0].joints, INDEX);
    assert!(forces(folder, &bag, "made.yaml", "index", &[]).len() > 9_000);
}

/// A recording whose frames have other names: those of two hands, in turn.
fn renamed_frames(from: &Path, to: &Path, spelt: &[&dyn Fn(&str) -> String]) {
    let mut bag = Bag::create(to);
    for message in messages(from) {
        match message.topic.as_str() {
            "/tf" | "/tf_static" => {
                let told: TFMessage = from_cdr(&message.data).unwrap();
                for spelt in spelt {
                    let mut told = told.clone();
                    for one in &mut told.transforms {
                        one.child_frame_id = spelt(&one.child_frame_id);
                        one.header.frame_id = spelt(&one.header.frame_id);
                    }
                    bag.send(&message.topic, message.log_time, &told);
                }
            }
            "/glove/taxels" => {
                bag.send(&message.topic, message.log_time, &from_cdr::<TaxelArray>(&message.data).unwrap());
            }
            "/stage" => bag.send(&message.topic, message.log_time, &from_cdr::<Stage>(&message.data).unwrap()),
            _ => {}
        }
    }
    bag.finish();
}

#[test]
fn frames_that_are_named_as_a_robot_names_them_become_joint_angles_and_two_hands_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (bag, model) = (simulated(folder, "1", "transforms"), in_source("models/glove1_adaptive.onnx"));
    let of_bag = fs::read_dir(folder.join(&bag)).unwrap().map(|entry| entry.unwrap().path());
    let from = of_bag.into_iter().find(|path| path.extension().is_some_and(|it| it == "mcap")).unwrap();
    let linked = |point: &str| format!("right_{}_link", point.to_uppercase());
    renamed_frames(&from, &folder.join("one.mcap"), &[&linked]);
    let made = |bag: &str, more: &[&str]| init(folder, bag, &[&["--model", &model, "--overwrite"], more].concat());
    let text = || fs::read_to_string(folder.join("made.yaml")).unwrap();
    made(&bag, &["--yes"]).ok();
    let of_bag = forces(folder, &bag, "made.yaml", "index", &[]);
    // The name says which hand it is: nothing is asked.
    made("one.mcap", &[]).ok();
    let one = text();
    assert!(one.contains("hand.points: [right_WRIST_link, right_THUMB_METACARPAL_link,"), "{one}");
    assert!(one.contains("hand.side: right  # as it is named"), "{one}");
    let of_one = forces(folder, "one.mcap", "made.yaml", "index", &[]);
    assert!(of_one.len() > 9_000 && of_one == of_bag, "{} forces, {} before", of_one.len(), of_bag.len());
    let left = |point: &str| format!("left/{point}");
    let right = |point: &str| format!("right/{point}");
    renamed_frames(&from, &folder.join("two.mcap"), &[&left, &right]);
    let asked = made("two.mcap", &[]);
    assert!(asked.failure().contains("Which topic holds the joint angles?"), "{asked:?}");
    made("two.mcap", &["--yes"]).ok();
    let two = text();
    assert!(two.contains("hand.points: [left/wrist,") && two.contains("hand.side: left"), "{two}");
}

#[test]
fn gloves_on_the_market_go_from_init_to_forces() {
    for (name, n_taxels) in [("xela", 8), ("contactile", 9), ("image", 8)] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        let mut bag = Bag::create(&path.join("glove.mcap"));
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
        let joints = r#"["IndexPIPStretch","IndexSpread"]"#;
        LinearModel::new(8, n_taxels, 2).metadata("unit", "N").metadata("joints", joints).write(path, "fingertip.onnx");
        // The model is found beside the file.
        let run = init(path, "glove.mcap", &["--yes"]).ok();
        let text = fs::read_to_string(path.join("made.yaml")).unwrap();
        assert!(run.stderr.contains("guessed: the model is"), "{run:?}");
        let cfg = load(path);
        assert_eq!(cfg.fusion().tactile_sources()[0].n_taxels, n_taxels, "{name}: {text}");
        assert_eq!(cfg.fusion().regions()[0].joints, ["IndexPIPStretch", "IndexSpread"], "{name}: {text}");
        assert!(text.contains("degrees: true") && text.contains("stamp: receipt"), "{name}: {text}");
        let more = ["--calibrate-first", "2.5", "-p", "calibration.max_force:=1000.0"];
        // The first window is full with the eighth frame.
        assert_eq!(forces(path, "glove.mcap", "made.yaml", "index", &more).len(), 593, "{name}: {text}");
    }
}

/// A grid of 24 x 32 cells as a Wuji glove sends it: NaN where there is no taxel.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
struct TactileFrame {
    header: Header,
    hand: u8,
    sequence: u16,
    device_timestamp_ms: u32,
    pressure: Vec<f32>,
}

impl WireType for TactileFrame {
    const TYPE_NAME: &'static str = "wujihand_tactile_msgs/msg/TactileFrame";
}

#[test]
fn cells_that_hold_no_taxel_are_left_out_of_the_region_and_replay_takes_the_zero_of_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut bag = Bag::create(&path.join("glove.mcap"));
    let rule = "=".repeat(80);
    let schema_text = format!(
        "std_msgs/Header header\nuint8 hand\nuint16 sequence\nuint32 device_timestamp_ms\nfloat32[] pressure\n{rule}\nMSG: \
         std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{rule}\nMSG: builtin_interfaces/Time\nint32 \
         sec\nuint32 nanosec\n"
    );
    let channel = NewChannel {
        topic: "/right/tactile",
        type_name: TactileFrame::TYPE_NAME,
        schema_text: &schema_text,
        qos_yaml: BEST_EFFORT_QOS,
        type_hash: "",
    };
    let topic = bag.writer.add_channel(channel).unwrap();
    for k in 0..600_i64 {
        let reading = |cell: i64| if cell % 32 < 4 { 0.1 + (k % 5) as f32 * 0.01 } else { f32::NAN };
        let frame = TactileFrame {
            header: Header { stamp: at(8 * k).into(), frame_id: String::new() },
            hand: 1,
            sequence: k as u16,
            device_timestamp_ms: 8 * k as u32,
            pressure: (0..768).map(reading).collect(),
        };
        bag.writer.write(topic, 0, at(8 * k), at(8 * k), &to_cdr(&frame)).unwrap();
    }
    bag.finish();
    LinearModel::new(8, 96, 0).metadata("unit", "N").write(path, "model.onnx");
    init(path, "glove.mcap", &["--model", "model.onnx"]).ok();
    let cfg = load(path);
    let expected: Vec<usize> = (0..768).filter(|cell| cell % 32 < 4).collect();
    assert_eq!(cfg.fusion().regions()[0].taxels, expected);
    let text = fs::read_to_string(path.join("made.yaml")).unwrap();
    assert!(text.contains("672 of 768 taxels never have a value"), "{text}");
    let region = cfg.fusion().regions()[0].name.clone();
    let more = ["--calibrate-first", "2.5", "-p", "calibration.max_force:=1000.0"];
    assert!(forces(path, "glove.mcap", "made.yaml", &region, &more).len() > 400);
}

#[test]
fn a_load_cell_that_sends_an_array_is_the_true_force_and_no_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let press = |k: i64| if (k / 100) % 2 == 1 { 2.0 } else { 0.0 };
    let array = |data: Vec<f32>| Float32MultiArray { layout: MultiArrayLayout::default(), data };
    for topic in ["/ft_sensor/raw", "/fingertip/load_cell", "/right/force_torque"] {
        let mut bag = Bag::create(&path.join("glove.mcap"));
        for k in 0..600 {
            let (force, noise) = (press(k) as f32, (k * 7919 % 13) as f32 * 0.01);
            bag.send(
                "/finger/pressure",
                at(10 * k),
                &array((0..8).map(|n| 100.0 + 9.0 * force + noise + n as f32).collect()),
            );
            bag.send(topic, at(10 * k), &array(vec![noise, -noise, -3.0 - force + noise, 0.0, 0.001 * force, 0.0]));
            bag.joints(at(10 * k), &["index_pip"], &[0.5 + 0.4 * (k as f64 * 0.02).sin()]);
        }
        bag.finish();
        init(path, "glove.mcap", &["--yes"]).ok();
        let (cfg, text) = (load(path), fs::read_to_string(path.join("made.yaml")).unwrap());
        assert_eq!((cfg.tactile().len(), cfg.tactile()[0].name.as_str()), (1, "/finger/pressure"), "{topic}: {text}");
        assert_eq!(cfg.truth().iter().map(|truth| truth.name.as_str()).collect::<Vec<_>>(), [topic], "{text}");
        assert!(text.contains("field: \"data[2]\"") && cfg.truth_sources()[0].inverted, "{topic}: {text}");
        fs::remove_file(path.join("glove.mcap")).unwrap();
        fs::remove_file(path.join("made.yaml")).unwrap();
    }
}

#[test]
fn without_a_model_the_file_loads_and_says_how_to_get_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bag = simulated(folder, "1", "angles");
    let question = "Which finger are the 6 taxels of /glove/taxels on?";
    assert!(init(folder, &bag, &[]).failure().starts_with(question));
    let run = init(folder, &bag, &["--yes"]).ok();
    assert!(
        run.stderr.contains(question)
            && run.stdout.contains("next: tpf train")
            && run.stdout.ends_with(" -o fingertip.onnx\n"),
        "{run:?}"
    );
    let text = fs::read_to_string(folder.join("made.yaml")).unwrap();
    assert!(text.contains("No model was given") && text.contains("`tpf train"), "{text}");
    assert_eq!(load(folder).fusion().regions()[0].joints, INDEX);
    assert!(text.lines().all(|line| line.chars().count() <= 120), "{text}");
}

#[test]
fn a_file_that_is_there_stays_unless_asked() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("made.yaml"), "mine").unwrap();
    let run = init(folder.path(), "gone.mcap", &["--yes"]);
    assert_eq!(run.failure(), "made.yaml is there already; give another name, or --overwrite");
    assert_eq!(fs::read_to_string(folder.path().join("made.yaml")).unwrap(), "mine");
}

#[test]
fn a_bag_without_taxels_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("arm.mcap"));
    (0..50).for_each(|k| bag.joints(at(10 * k), &["elbow"], &[0.01 * k as f64]));
    bag.finish();
    let run = init(folder.path(), "arm.mcap", &["--yes"]);
    assert!(run.failure().starts_with("arm.mcap: no taxels found: "), "{run:?}");
    // A topic that never changes is no sensor.
    let mut bag = Bag::create(&folder.path().join("constant.mcap"));
    (0..50).for_each(|k| bag.taxels(at(10 * k), &[1.0, 2.0]));
    bag.finish();
    assert!(init(folder.path(), "constant.mcap", &["--yes"]).failure().contains("none of its taxels ever changes"));
    assert!(!folder.path().join("made.yaml").exists());
}

#[test]
fn a_model_of_another_glove_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("glove.mcap"));
    (0..50).for_each(|k| bag.taxels(at(10 * k), &[1.0, k as f32]));
    bag.finish();
    LinearModel::new(8, 3, 0).write(folder.path(), "model.onnx");
    let run = init(folder.path(), "glove.mcap", &["--model", "model.onnx"]);
    assert_eq!(
        run.failure(),
        "model.onnx takes 3 taxels, and the bags have 2; leave --model out, or give one for this glove"
    );
}

/// Every MCAP file below `folder`, in order.
fn bags(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            bags(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "mcap") {
            found.push(path);
        }
    }
}

#[test]
fn every_recorded_bag_gives_a_file_that_loads_or_one_line() {
    let Some(shared) = common::shared() else { return };
    let mut paths = Vec::new();
    bags(&shared.join("data"), &mut paths);
    let folder = tempfile::tempdir().unwrap();
    for path in paths {
        let run = init(folder.path(), path.to_str().unwrap(), &["--yes", "--overwrite"]);
        assert!(!run.stderr.contains("panicked"), "{path:?}: {run:?}");
        if run.code == 1 {
            assert!(run.failure().contains(path.file_name().unwrap().to_str().unwrap()), "{path:?}: {run:?}");
            // A load cell in batches, and no taxels.
            let is_crab = path.ends_with("adya_gait.bag");
            assert!(!is_crab || run.stderr.contains("it is more likely a force sensor"), "{run:?}");
        } else {
            load(folder.path());
        }
    }
}

/// A recording in which nothing names the joints as any model does: `names` beside the angles, or none.
fn strangers_joints(folder: &Path, bag: &str, names: Option<&[&str]>) {
    #[derive(serde::Serialize, serde::Deserialize)]
    struct Angles {
        who: Vec<String>,
        rad: Vec<f32>,
    }
    impl WireType for Angles {
        const TYPE_NAME: &'static str = "odd_msgs/msg/Angles";
    }
    let from = folder.join(bag);
    let path = folder.join("odd.mcap");
    let _ = fs::remove_file(&path); // of another case
    let mut odd = Bag::create(&path);
    let text = "string[] who\nfloat32[] rad\n";
    let (topic, type_name) = ("/hand/angles", Angles::TYPE_NAME);
    let channel = NewChannel { topic, type_name, schema_text: text, qos_yaml: BEST_EFFORT_QOS, type_hash: "" };
    let channel = odd.writer.add_channel(channel).unwrap();
    for message in messages(&from) {
        if message.topic != "/hand/joint_states" {
            odd.send_recorded(&message);
            continue;
        }
        let state: JointState = from_cdr(&message.data).unwrap();
        let of = INDEX.map(|joint| state.position[state.name.iter().position(|name| name == joint).unwrap()] as f32);
        let who = names.unwrap_or_default().iter().map(|name| (*name).to_owned()).collect();
        let angles = Angles { who, rad: of.to_vec() };
        odd.writer.write(channel, 0, message.log_time, message.log_time, &to_cdr(&angles)).unwrap();
    }
    odd.finish();
}

#[test]
fn a_file_for_a_model_has_the_models_joints_or_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (bag, model) = (simulated(folder, "1", "angles"), in_source("models/glove1_adaptive.onnx"));
    let made = |names: Option<&[&str]>, more: &[&str]| {
        strangers_joints(folder, &bag, names);
        init(folder, "odd.mcap", &[&["--yes", "--overwrite"], more].concat())
    };
    let text = || fs::read_to_string(folder.join("made.yaml")).unwrap();
    // Whatever the array of names is called.
    made(Some(&INDEX), &["--model", &model]).ok();
    assert!(text().contains("names_field: who"), "{}", text());
    assert_eq!(load(folder).fusion().regions()[0].joints, INDEX);
    let named = forces(folder, "odd.mcap", "made.yaml", "index", &[]);
    assert!(named.len() > 9_000);
    // No names, and as many angles: in their order, to be looked at.
    made(None, &["--model", &model]).ok();
    let region = load(folder).fusion().regions()[0].clone();
    assert_eq!(
        (&region.joints[..], &region.model_joints[..]),
        (&["joint_0", "joint_1", "joint_2", "joint_3"].map(str::to_owned)[..], &INDEX.map(str::to_owned)[..])
    );
    assert!(text().contains("CHECK: which joint is which was taken from their order"), "{}", text());
    assert!(forces(folder, "odd.mcap", "made.yaml", "index", &[]) == named);
    // Other names: no file that would not load.
    let other = ["knee", "hip", "ankle", "toe"];
    fs::remove_file(folder.join("made.yaml")).unwrap();
    let refused = made(Some(&other), &["--model", &model]);
    let told = "takes the joint angles index_dip, index_pip, index_mcp_flex, index_mcp_abd, and for region index the bags have knee, hip";
    assert!(refused.failure().contains(told), "{refused:?}");
    assert!(!folder.join("made.yaml").exists());
    // A model that lies beside the file and doesn't fit is not taken.
    fs::copy(&model, folder.join("glove1.onnx")).unwrap();
    made(Some(&other), &[]).ok();
    assert!(!text().contains("glove1.onnx") && load(folder).fusion().regions()[0].joints == other, "{}", text());
    made(Some(&INDEX), &[]).ok();
    assert!(text().contains("glove1.onnx"), "{}", text());
    // Points of a hand are no joints of another device.
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    LinearModel::new(64, 6, 4).metadata("joints", r#"["knee", "hip", "ankle", "toe"]"#).write(folder, "robot.onnx");
    let points = simulated(folder, "1", "keypoints21");
    init(folder, &points, &["--yes"]).ok();
    let text = fs::read_to_string(folder.join("made.yaml")).unwrap();
    assert!(!text.contains("robot.onnx") && load(folder).fusion().regions()[0].joints == INDEX, "{text}");
}
