//! `tpf collect` with a synthetic glove that publishes, whose user does what prompts say.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::ROOT;
use common::bags::decoded;
use common::tpf::Run;
use tactile_pose_fusion::bag::BagReader;
use tactile_pose_fusion::msg::{ContactArray, ContactState, Stage, WrenchStamped};
use tactile_pose_fusion::units::Stamp;

/// A protocol of a quarter of a minute that has every kind of thing in it.
const PROTOCOL: &str = include_str!("../ros/quarter_minute.yaml");

/// A synthetic glove that publishes until it is dropped.
struct Glove(Child);

impl Glove {
    fn start(folder: &Path, args: &[&str]) -> Glove {
        let log = File::create(folder.join("glove.log")).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(folder).args(["simulate", "--glove", "1", "--seed", "5", "--live", "--protocol", "p.yaml"]);
        Glove(command.args(args).stdout(Stdio::null()).stderr(log).spawn().unwrap())
    }
}

impl Drop for Glove {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A folder with the protocol, or the reason to skip.
fn room() -> Option<tempfile::TempDir> {
    if !common::skip::isolated() {
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("p.yaml"), PROTOCOL).unwrap();
    Some(folder)
}

fn collect(folder: &Path, args: &[&str]) -> Command {
    let params = Path::new(ROOT).join("params/glove1.yaml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
    command.current_dir(folder).args(["collect", "--params-file"]).arg(params).args(["-o", "s", "--user", "anna"]);
    command.args(args);
    command
}

fn run(command: &mut Command) -> Run {
    command.output().unwrap().into()
}

fn stages(bag: &Path) -> Vec<Stage> {
    decoded(bag, "/stage")
}

/// Substages with the number of their annotations, in their order.
fn counts(stages: &[Stage]) -> Vec<(String, usize)> {
    let mut counts: Vec<(String, usize)> = Vec::new();
    for stage in stages.iter().filter(|stage| stage.stage != 0) {
        match counts.last_mut().filter(|(name, _)| *name == stage.substage) {
            Some((_, n)) => *n += 1,
            None => counts.push((stage.substage.clone(), 1)),
        }
    }
    counts
}

fn expected() -> Vec<(String, usize)> {
    [("poses", 4), ("presses", 4), ("transitions", 3), ("in_air", 1)].map(|(name, n)| (name.to_owned(), n)).to_vec()
}

#[test]
fn a_session_is_led_through_and_recorded_with_what_was_asked_for() {
    let Some(room) = room() else { return };
    let _glove = Glove::start(room.path(), &[]);
    std::thread::sleep(Duration::from_secs(1));
    let done = run(&mut collect(room.path(), &["--protocol", "p.yaml", "--plain"])).ok();
    assert!(done.stdout.starts_with("s/s.mcap: "), "{done:?}");
    assert!(done.stderr.contains("stage 1  poses  1 of 4: In the air: "), "{done:?}");
    let bag = room.path().join("s/s.mcap");
    let stages = stages(&bag);
    assert_eq!(counts(&stages), expected());
    // What the load cell read while it was to be pressed, and while nothing was to be touched.
    let forces: Vec<WrenchStamped> = decoded(&bag, "/load_cell/wrench");
    let force_of = |substage: &str, zero_load: bool| -> Vec<f64> {
        let at = |stamp: Stamp| stages.iter().rev().find(|stage| Stamp::from(stage.header.stamp) <= stamp);
        let is_it = |stage: &Stage| stage.substage == substage && stage.zero_load == zero_load;
        let of_it = forces.iter().filter(|force| at(force.header.stamp.into()).is_some_and(is_it));
        of_it.map(|force| force.wrench.force.z).collect()
    };
    let mean = |forces: &[f64]| forces.iter().sum::<f64>() / forces.len() as f64;
    for substage in ["poses", "presses", "in_air"] {
        let most = force_of(substage, true).into_iter().fold(0.0, f64::max);
        assert!(most < 0.15, "{substage}: {most} N in the air"); // the cell's noise and drift
    }
    assert!(mean(&force_of("presses", false)) > 0.3 && mean(&force_of("transitions", false)) > 0.3);
    let mut reader = BagReader::open(&[bag]).unwrap();
    let mut noted = false;
    while let Some(record) = reader.next_record().unwrap() {
        if let tactile_pose_fusion::bag::BagRecord::Metadata(notes) = record
            && notes.name == tactile_pose_fusion::recording::SESSION_NOTES
        {
            noted = true;
            assert_eq!((&*notes.metadata["user"], &*notes.metadata["synthetic"]), ("anna", "true"));
        }
    }
    assert!(noted);
    assert!(!room.path().join("s/parts").exists());
    let again = run(&mut collect(room.path(), &["--protocol", "p.yaml", "--plain"]));
    assert!(again.failure().contains("s: already exists"), "{again:?}");
    let resumed = run(&mut collect(room.path(), &["--resume", "--plain"]));
    assert!(resumed.failure().contains("this collection is complete"), "{resumed:?}");
}

/// Known touches of the quarter-minute protocol.
const KNOWN_TOUCHES: &str =
    "known_touches: {presses: 3, seconds: 5, hold_seconds: 0.7, at_least: 0.3, ask: press and hold}\n";

#[test]
fn known_touches_at_the_start_of_a_donning_give_the_gain_of_its_forces() {
    let Some(room) = room() else { return };
    std::fs::write(room.path().join("t.yaml"), format!("{PROTOCOL}{KNOWN_TOUCHES}")).unwrap();
    let _glove = Glove::start(room.path(), &[]);
    std::thread::sleep(Duration::from_secs(1));
    let log = room.path().join("first.log");
    let mut command = collect(room.path(), &["--protocol", "t.yaml", "--plain"]);
    let mut first = command.stdout(Stdio::null()).stderr(File::create(&log).unwrap()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    while !std::fs::read_to_string(&log).unwrap().contains("stage 1  poses  2 of 4") {
        assert!(Instant::now() < deadline, "{}", std::fs::read_to_string(&log).unwrap());
        std::thread::sleep(Duration::from_millis(20));
    }
    first.kill().unwrap();
    first.wait().unwrap();
    let log = std::fs::read_to_string(&log).unwrap();
    for line in
        ["known touches  1 of 3: Let go of the load cell", "known touches  3 of 3: press and hold", "3 known touches: "]
    {
        assert!(log.contains(line), "{line}: {log}");
    }
    // They are of this donning, so who goes on with the session is not asked again.
    let resumed = run(&mut collect(room.path(), &["--resume", "--plain"])).ok();
    assert!(!resumed.stderr.contains("known touches"), "{resumed:?}");
    let bag = room.path().join("s/s.mcap");
    let presses = |stage: &&Stage| stage.substage == "known_touches" && stage.pose == "press" && stage.stage == 0;
    assert_eq!(stages(&bag).iter().filter(presses).count(), 3);
    assert_eq!(counts(&stages(&bag)), expected());
    let params = Path::new(ROOT).join("params/glove1.yaml");
    let mut calibrate = Command::new(env!("CARGO_BIN_EXE_tpf"));
    calibrate.current_dir(room.path()).args(["calibrate", "s/s.mcap", "-o", "donning.yaml", "--touches"]);
    let model = Path::new(ROOT).join("models/glove1_pose_aware.onnx");
    calibrate.arg("--params-file").arg(params).arg("--model").arg(model);
    let calibrated = run(&mut calibrate).ok();
    assert!(calibrated.stdout.contains("region index: forces times "), "{calibrated:?}");
}

#[test]
fn known_touches_that_nobody_feels_end_it_before_the_protocol_and_are_asked_for_again() {
    let Some(room) = room() else { return };
    std::fs::write(
        room.path().join("t.yaml"),
        format!("{PROTOCOL}{}", KNOWN_TOUCHES.replace("seconds: 5", "seconds: 1.5")),
    )
    .unwrap();
    let _glove = Glove::start(room.path(), &[]);
    std::thread::sleep(Duration::from_secs(1));
    // Its presses lower what is read as force.
    let wrong = ["-p", "truth.load_cell.sign:=-1"];
    let unfelt = run(&mut collect(room.path(), &[&["--protocol", "t.yaml", "--plain"][..], &wrong].concat()));
    let told = unfelt.failure();
    assert!(
        told.contains("none of 3 known touches was felt") && told.contains("--resume asks for the touches again"),
        "{told}"
    );
    assert!(!unfelt.stderr.contains("stage 1"), "{unfelt:?}");
    let again = run(&mut collect(room.path(), &[&["--resume", "--plain"][..], &wrong].concat()));
    assert!(again.failure().contains("none of 3 known touches was felt"), "{again:?}");
    // Right parameters: the touches are asked for once more, and the session goes on to its end.
    let done = run(&mut collect(room.path(), &["--resume", "--plain"])).ok();
    assert!(done.stderr.contains("3 known touches: "), "{done:?}");
    assert_eq!(counts(&stages(&room.path().join("s/s.mcap"))), expected());
}

#[test]
fn a_session_that_was_killed_goes_on_with_what_was_recorded() {
    let Some(room) = room() else { return };
    let _glove = Glove::start(room.path(), &[]);
    std::thread::sleep(Duration::from_secs(1));
    let log = room.path().join("first.log");
    let mut command = collect(room.path(), &["--protocol", "p.yaml", "--plain"]);
    let mut first = command.stdout(Stdio::null()).stderr(File::create(&log).unwrap()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    // In the second press of stage 2, so that an item is cut in two.
    while !std::fs::read_to_string(&log).unwrap().contains("stage 2  presses  2 of 2: Press") {
        assert!(Instant::now() < deadline, "{}", std::fs::read_to_string(&log).unwrap());
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(Duration::from_millis(1200)); // what the last second held may be lost
    first.kill().unwrap();
    first.wait().unwrap();
    let parts: Vec<PathBuf> =
        std::fs::read_dir(room.path().join("s/parts")).unwrap().map(|e| e.unwrap().path()).collect();
    assert!(parts.len() == 1 && !room.path().join("s/s.mcap").exists(), "{parts:?}");
    let other = run(Command::new(env!("CARGO_BIN_EXE_tpf")).current_dir(room.path()).args([
        "collect",
        "--params-file",
        &format!("{ROOT}/params/glove1.yaml"),
        "-o",
        "s",
        "--user",
        "ben",
        "--resume",
        "--plain",
    ]));
    assert!(other.failure().contains("begun with user \"anna\", the parameters say \"ben\""), "{other:?}");
    let done = run(&mut collect(room.path(), &["--resume", "--plain"]));
    assert!(done.code == 0, "{done:?}");
    assert!(
        done.stderr.contains("a run that was cut off left it") && !done.stderr.contains("stage 1  poses"),
        "{done:?}"
    );
    assert_eq!(counts(&stages(&room.path().join("s/s.mcap"))), expected());
}

#[test]
fn a_dead_taxel_a_swapped_name_and_an_untared_cell_are_caught_before_anything_is_recorded() {
    let Some(room) = room() else { return };
    for (fault, expected) in [
        ("dead-taxel", "tactile source glove: taxels 2 never changed while the hand moved"),
        ("swapped-joints", "their names may be swapped"),
        ("untared-load-cell", "force sensor load_cell reads 1.50 N with nothing on it"),
    ] {
        let _glove = Glove::start(room.path(), &["--fault", fault]);
        std::thread::sleep(Duration::from_secs(1));
        let refused = run(&mut collect(room.path(), &["--protocol", "p.yaml", "--plain"]));
        assert!(refused.failure().contains("a check failed and nothing was recorded"), "{refused:?}");
        assert!(refused.stderr.contains(expected), "{fault}: {refused:?}");
        assert!(!room.path().join("s").exists(), "{fault}");
    }
}

#[test]
fn a_user_who_ignores_prompts_is_told_of() {
    let Some(room) = room() else { return };
    let _glove = Glove::start(room.path(), &["--ignore-prompts"]);
    std::thread::sleep(Duration::from_secs(1));
    let done = run(&mut collect(room.path(), &["--protocol", "p.yaml", "--plain", "--accept-checks"]));
    assert_eq!(done.code, 0, "{done:?}");
    let flagged =
        done.stderr.contains("while nothing was to be touched") || done.stderr.contains("of the time, expected 50 %");
    assert!(flagged, "{done:?}");
}

#[test]
#[cfg(feature = "train")]
fn the_whole_way_from_a_glove_to_a_dataset_is_walked() {
    if !common::skip::isolated() {
        return;
    }
    if Command::new("tmux").arg("-V").output().is_err() {
        assert!(std::env::var_os("TPF_REQUIRE_ROS").is_none(), "tmux is not here; run scripts/tmux");
        return common::skip::skipped("tmux is not here; scripts/tmux installs it");
    }
    let folder = tempfile::tempdir().unwrap();
    let way = folder.path().join("way");
    let mut script = Command::new(format!("{ROOT}/tests/ros/glove_to_robot"));
    let walked = script.arg(&way).arg("short").env("TPF", env!("CARGO_BIN_EXE_tpf")).output().unwrap();
    let walked: Run = walked.into();
    assert_eq!(walked.code, 0, "{walked:?}");
    // What each step says that went well.
    for expected in
        ["model   anna.onnx", "good: nothing was touched", "| index ", "estimating", "1 of 1 bags in dataset"]
    {
        assert!(walked.stdout.contains(expected), "{expected}: {walked:?}");
    }
    for made in
        ["anna_1/anna_1.mcap", "anna_2/anna_2.mcap", "anna.onnx", "zero.yaml", "run.mcap", "dataset/meta/info.json"]
    {
        assert!(way.join(made).exists(), "{made}: {walked:?}");
    }
}

#[test]
fn a_model_that_follows_pose_is_calibrated_live_and_its_recording_replays_bit_by_bit() {
    let Some(room) = room() else { return };
    let room = room.path();
    let params = &format!("{ROOT}/params/glove3.yaml");
    let model = &format!("{ROOT}/models/glove3_adaptive.onnx");
    let tpf = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(room).args(args).args(["--params-file", params, "--model", model]);
        command
    };
    let simulate = ["simulate", "--glove", "3", "--seed", "9", "--live", "--ignore-prompts", "--minutes", "5"];
    let log = File::create(room.join("glove.log")).unwrap();
    let mut glove = Command::new(env!("CARGO_BIN_EXE_tpf"));
    let _glove = Glove(glove.current_dir(room).args(simulate).stdout(Stdio::null()).stderr(log).spawn().unwrap());
    let calibrated = run(&mut tpf(&["calibrate", "--live", "--seconds", "10", "-o", "c.yaml"])).ok();
    assert!(calibrated.stdout.contains("good: nothing was touched"), "{calibrated:?}");
    assert!(std::fs::read_to_string(room.join("c.yaml")).unwrap().contains("artifacts:"));

    let keep = ["-p", "calibration.worn_file:=worn.yaml"];
    let mut node = tpf(&[&["run", "--calibration", "c.yaml", "--record", "live.mcap"], &keep[..]].concat());
    let mut node = node.stderr(File::create(room.join("node.log")).unwrap()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(12));
    assert!(Command::new("kill").args(["-INT", &node.id().to_string()]).status().unwrap().success());
    assert!(node.wait().unwrap().success(), "{}", std::fs::read_to_string(room.join("node.log")).unwrap());
    run(&mut tpf(&["replay", "live.mcap", "--calibration", "c.yaml", "-o", "again.mcap"])).ok();
    let compared =
        Command::new(env!("CARGO_BIN_EXE_tpf")).current_dir(room).args(["diff", "live.mcap", "again.mcap"]).output();
    let compared = Run::from(compared.unwrap()).ok();
    assert!(compared.stdout.contains("every field equal, bit by bit"), "{compared:?}");
    let states: Vec<ContactArray> = decoded(&room.join("live.mcap"), "/tactile_pose_fusion/contacts");
    let learning = |array: &&ContactArray| array.contacts[0].adaptation == ContactState::ADAPTATION_LEARNING;
    assert!(states.len() > 500 && states.iter().filter(learning).count() > 50, "{}", states.len());

    // What was followed is kept, and the next start goes on from there.
    let [calibrated, worn] = ["c.yaml", "worn.yaml"].map(|file| std::fs::read_to_string(room.join(file)).unwrap());
    assert!(worn.contains("; kept while the glove was worn") && worn.contains("artifacts:"), "{worn}");
    let gains = |text: &str| text.split("gains:").nth(1).unwrap().split("offset:").next().unwrap().to_owned();
    assert_ne!(gains(&calibrated), gains(&worn));
    let mut node = tpf(&[&["run", "--calibration", "worn.yaml", "--record", "on.mcap"], &keep[..]].concat());
    let mut node = node.stderr(File::create(room.join("node.log")).unwrap()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(6));
    assert!(Command::new("kill").args(["-TERM", &node.id().to_string()]).status().unwrap().success());
    assert!(node.wait().unwrap().success());
    let states: Vec<ContactArray> = decoded(&room.join("on.mcap"), "/tactile_pose_fusion/contacts");
    assert!(states.iter().filter(learning).count() > 20, "{}", states.len());
    assert_ne!(std::fs::read_to_string(room.join("worn.yaml")).unwrap(), worn, "it is kept again");
}

#[test]
fn touches_of_the_load_cell_give_a_live_donning_its_gain() {
    let Some(room) = room() else { return };
    let room = room.path();
    let params = &format!("{ROOT}/params/glove3.yaml");
    let simulate = ["simulate", "--glove", "3", "--seed", "9", "--live", "--ignore-prompts", "--minutes", "4"];
    let log = File::create(room.join("glove.log")).unwrap();
    let mut glove = Command::new(env!("CARGO_BIN_EXE_tpf"));
    let _glove = Glove(glove.current_dir(room).args(simulate).stdout(Stdio::null()).stderr(log).spawn().unwrap());
    let calibrate = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(room).args(["calibrate", "--live", "--params-file", params, "--seconds", "10"]).args(args);
        command.stdin(Stdio::piped());
        command
    };
    // Told presses in the air: what the glove read is no such force.
    let mut told = calibrate(&["-o", "told.yaml", "--press", "200gF", "--press", "2N", "--press", "index:300gF"]);
    let mut told = told.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::io::Write::write_all(&mut told.stdin.take().unwrap(), b"\n\n\n").unwrap();
    let refused = Run::from(told.wait_with_output().unwrap());
    assert_eq!(refused.code, 1, "{refused:?}");
    assert!(refused.stderr.contains("press 3 of 3: index with 300gF (300 gF)"), "{refused:?}");
    assert!(refused.stderr.contains("no gain of the touches: region index: "), "{refused:?}");
    assert!(!room.join("told.yaml").exists());

    // A node beside it is asked for the same.
    let mut node = Command::new(env!("CARGO_BIN_EXE_tpf"));
    node.current_dir(room).args(["run", "--params-file", params, "-p", "calibration.touch_s:=60.0"]);
    node.args(["-p", "calibration.duration_s:=10.0", "-p", "calibration.file:=node.yaml"]);
    let _node = Glove(node.stderr(File::create(room.join("node.log")).unwrap()).spawn().unwrap());
    let mut call = Command::new(env!("CARGO_BIN_EXE_tpf"));
    call.current_dir(room).args(["call", "calibrate", "--wait", "20"]).stdout(Stdio::piped()).stderr(Stdio::piped());
    let call = call.spawn().unwrap();
    let measured = run(&mut calibrate(&["-o", "c.yaml", "--touches", "--touch-seconds", "60"])).ok();
    assert!(measured.stdout.contains("region index: forces times "), "{measured:?}");
    let called = Run::from(call.wait_with_output().unwrap()).ok();
    assert!(called.stderr.contains("now touch the force sensor: "), "{called:?}");
    let factor = |text: &str| -> f64 {
        let (_, after) = text.split_once("region index: forces times ").unwrap_or_else(|| panic!("{text}"));
        after.split(' ').next().unwrap().parse().unwrap()
    };
    let factors = [&measured, &called].map(|run| factor(&run.stdout));
    // They do not begin at the same moment, so they may not see the same touches.
    assert!((factors[0] / factors[1] - 1.0).abs() < 0.1, "{factors:?}");
    assert!(std::fs::read_to_string(room.join("node.yaml")).unwrap().contains("force_gains"), "{called:?}");
    assert!(std::fs::read_to_string(room.join("c.yaml")).unwrap().contains("force_gains"), "{measured:?}");

    let unknown = run(&mut calibrate(&["-o", "d.yaml", "--press", "thumb:200gF"]));
    assert!(unknown.code == 1 && unknown.stderr.contains("--press names region thumb, the parameters have index"));
}
