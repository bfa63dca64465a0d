//! Every command that reads bags or writes outputs does with URIs what it does with paths, byte for byte.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::onnx::LinearModel;
use crate::common::scored::PARAMS;
use crate::common::tpf::write_params;
use crate::common::{bags, files};
use crate::server::Cloud;
use tactile_pose_fusion::msg::{WrenchStamped, to_cdr};

/// Two users' short sessions below `bags` here and in the bucket, parameters and models.
fn sessions(cloud: &Cloud) {
    let folder = cloud.folder();
    fs::write(folder.join("params.yaml"), PARAMS).unwrap();
    cloud
        .tpf(&[
            "simulate",
            "--glove",
            "1",
            "--users",
            "2",
            "--sessions",
            "1",
            "--minutes=1.7",
            "--seed",
            "5",
            "-o",
            "bags",
        ])
        .ok();
    LinearModel::new(64, 6, 4).metadata("unit", "gF").write(folder, "model.onnx");
    LinearModel::new(64, 6, 0).metadata("unit", "gF").write(folder, "other.onnx");
    for name in files(&folder.join("bags")).keys() {
        let name = format!("bags/{}", name.to_str().unwrap());
        cloud.put(&name, &name);
    }
    for name in ["params.yaml", "model.onnx", "other.onnx"] {
        cloud.put(name, name);
    }
}

/// A text with the places of bags taken out of it.
fn without_places(text: &str) -> String {
    text.replace("s3://bags/", "")
}

#[test]
fn bags_of_a_bucket_give_what_bags_of_this_machine_give() {
    let Some(cloud) = Cloud::start() else { return };
    sessions(&cloud);
    let first = "bags/glove1_user01_session1";
    let both = |args: &[&str]| {
        let here = cloud.tpf(args).ok();
        let there: Vec<String> = args
            .iter()
            .map(|arg| if arg.starts_with("bags") { format!("s3://bags/{arg}") } else { (*arg).to_owned() })
            .collect();
        let there = cloud.tpf(&there.iter().map(String::as_str).collect::<Vec<_>>()).ok();
        assert_eq!(without_places(&there.stdout), here.stdout, "{args:?}");
        here
    };
    both(&["inspect", first, "--json"]);
    both(&[
        "eval",
        "bags",
        "--params-file",
        "params.yaml",
        "--model",
        "model.onnx",
        "--compare",
        "other.onnx",
        "--json",
    ]);
    both(&["characterize", "bags", "--params-file", "params.yaml", "--json"]);
}

#[test]
fn outputs_in_a_bucket_are_the_bytes_of_outputs_on_this_machine() {
    let Some(cloud) = Cloud::start() else { return };
    sessions(&cloud);
    let (folder, first) = (cloud.folder(), "bags/glove1_user01_session1");
    let params = ["--params-file", "params.yaml"];
    let run = |args: &[&str]| cloud.tpf(&[args, &params].concat()).ok();
    let same = |name: &str, key: &str| {
        assert!(fs::read(folder.join(name)).unwrap() == fs::read(cloud.object(key)).unwrap(), "{name}");
    };

    run(&["replay", first, "-o", "out.mcap"]);
    run(&["replay", &format!("s3://bags/{first}"), "-o", "s3://bags/out.mcap"]);
    same("out.mcap", "out.mcap");
    // A bag as a folder: its metadata.yaml names its file.
    run(&["replay", first, "-o", "out"]);
    run(&["replay", &format!("s3://bags/{first}"), "-o", "s3://bags/out"]);
    same("out/out_0.mcap", "out/out_0.mcap");
    same("out/metadata.yaml", "out/metadata.yaml");
    cloud.tpf(&["diff", "s3://bags/out", "out.mcap"]).ok();
    run(&["replay", "bags", "--each", "-o", "each"]);
    run(&["replay", "s3://bags/bags", "--each", "-o", "s3://bags/each"]);
    assert_eq!(files(&folder.join("each")), files(&cloud.object("each")));

    let tables = |at: &str| [format!("{at}t.parquet"), format!("{at}t.csv"), format!("{at}set")];
    for (bags, at) in [("bags", ""), ("s3://bags/bags", "s3://bags/")] {
        let [parquet, csv, set] = tables(at);
        run(&["export", bags, "--parquet", &parquet, "--csv", &csv, "--lerobot", &set]);
        for shard in ["0/2", "1/2"] {
            let (partial, set) = (format!("{at}p{}.parquet", &shard[..1]), format!("{at}s{}", &shard[..1]));
            run(&["eval", bags, "--model", "model.onnx", "--partial", &partial, "--shard", shard]);
            run(&["export", bags, "--lerobot", &set, "--shard", shard]);
        }
        run(&[
            "eval",
            bags,
            "--model",
            "model.onnx",
            "--report",
            &format!("{at}r.html"),
            "--parquet",
            &format!("{at}r.parquet"),
            "--frames",
            &format!("{at}f.parquet"),
        ]);
        let (p0, p1, json) = (format!("{at}p0.parquet"), format!("{at}p1.parquet"), format!("{at}m.html"));
        let merged = cloud.tpf(&["merge", &p0, &p1, "--report", &json, "--expect", bags, "--json"]).ok();
        fs::write(folder.join(if at.is_empty() { "m0.json" } else { "m1.json" }), without_places(&merged.stdout))
            .unwrap();
        cloud.tpf(&["merge", &format!("{at}s0"), &format!("{at}s1"), "--lerobot", &format!("{at}joined")]).ok();
        let calibration = format!("{at}calibration.yaml");
        run(&["calibrate", &format!("{bags}/glove1_user01_session1"), "-o", &calibration]);
    }
    same("t.parquet", "t.parquet");
    same("t.csv", "t.csv");
    same("r.parquet", "r.parquet");
    same("calibration.yaml", "calibration.yaml");
    assert_eq!(files(&folder.join("set")), files(&cloud.object("set")));
    assert_eq!(files(&folder.join("joined")), files(&cloud.object("joined")));
    assert_eq!(
        files(&folder.join("set")),
        files(&folder.join("joined")).into_iter().filter(|(name, _)| folder.join("set").join(name).exists()).collect()
    );
    assert_eq!(fs::read(folder.join("m0.json")).unwrap(), fs::read(folder.join("m1.json")).unwrap());
    // Pages name their bags.
    let page = |path: PathBuf| without_places(&fs::read_to_string(path).unwrap());
    assert_eq!(page(folder.join("r.html")), page(cloud.object("r.html")));
    // Parameters, and the model beside them, from the bucket.
    cloud.tpf(&["replay", first, "--params-file", "s3://bags/params.yaml", "-o", "by_uri.mcap"]).ok();
    same("by_uri.mcap", "out.mcap");
    assert_eq!(cloud.n_unfinished(), 0, "uploads that were begun are completed or taken back");
    assert_eq!(cloud.n_temporary(), 0);
}

#[test]
fn a_sqlite3_bag_a_packed_one_and_a_file_uri_are_read() {
    let Some(cloud) = Cloud::start() else { return };
    let folder = cloud.folder();
    fs::create_dir(folder.join("odd")).unwrap();
    bags::write_session(&folder.join("odd/plain.mcap"), 8);
    let packed = zstd::stream::encode_all(&fs::read(folder.join("odd/plain.mcap")).unwrap()[..], 3).unwrap();
    fs::write(folder.join("odd/packed.mcap.zstd"), packed).unwrap();
    write_rows(&folder.join("odd/rows.db3"));
    for name in ["odd/plain.mcap", "odd/packed.mcap.zstd", "odd/rows.db3"] {
        cloud.put(name, name);
        let here = cloud.tpf(&["inspect", name, "--json"]).ok();
        let there = cloud.tpf(&["inspect", &format!("s3://bags/{name}"), "--json"]).ok();
        assert_eq!(without_places(&there.stdout), here.stdout, "{name}");
        let by_uri = cloud.tpf(&["inspect", "--json", &format!("file://{}/{name}", folder.display())]).ok();
        assert_eq!(by_uri.stdout.replace(&format!("{}/", folder.display()), ""), here.stdout, "{name}");
        assert_eq!(cloud.n_temporary(), 0, "{name}");
        let says_copy = there.stderr.contains("in the folder for temporary files");
        assert_eq!(says_copy, name != "odd/plain.mcap", "{there:?}");
    }
}

/// A bag as rosbag2 wrote it before MCAP.
fn write_rows(path: &Path) {
    let bag = rusqlite::Connection::open(path).unwrap();
    bag.execute_batch(
        "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT);
         CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
         INSERT INTO topics VALUES (1, '/forces', 'geometry_msgs/msg/WrenchStamped', 'cdr', '')",
    )
    .unwrap();
    let message = to_cdr(&WrenchStamped::default());
    for k in 0..500 {
        bag.execute("INSERT INTO messages VALUES (?1, 1, ?2, ?3)", rusqlite::params![k, k * 1_000_000, message])
            .unwrap();
    }
}

/// A session with a camera beside it, 20 MiB: what the glove sends is a small part of the bytes, in chunks of its own.
pub fn with_camera(path: &Path) {
    let mut bag = bags::Bag::create(path);
    let camera = bag.writer.add_topic::<WrenchStamped>("/camera").unwrap();
    let mut state = 1_u64;
    for k in 0..800 {
        if k % 40 == 0 {
            let noise = std::iter::repeat_with(|| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 33) as u8
            });
            let picture: Vec<u8> = noise.take(1 << 20).collect();
            bag.writer.flush().unwrap();
            bag.writer.write(camera, 0, bags::at(k * 10 + 1), bags::at(k * 10 + 1), &picture).unwrap();
            bag.writer.flush().unwrap();
        }
        let bend = (k as f64 * 0.02).sin();
        let touch = if k >= 400 && (k / 100) % 2 == 0 { 100.0 } else { 0.0 };
        bag.joints(bags::at(k * 10 + 3), &["pip", "dip"], &[2.0 * bend, bend]);
        bag.taxels(bags::at(k * 10 + 10), &[10.0 + 20.0 * bend as f32 + touch, 5.0 + touch]);
    }
    bag.finish();
}

#[test]
fn only_what_is_needed_of_a_bag_is_read_and_a_whole_one_in_few_requests() {
    let Some(cloud) = Cloud::start() else { return };
    with_camera(&cloud.folder().join("camera.mcap"));
    cloud.put("camera.mcap", "camera.mcap");
    let size = fs::metadata(cloud.folder().join("camera.mcap")).unwrap().len();
    assert!(size > 20 << 20, "{size}");
    let here = cloud.tpf(&["inspect", "camera.mcap", "--json"]).ok();
    cloud.proxy.take_seen();
    let there = cloud.tpf(&["inspect", "s3://bags/camera.mcap", "--json"]).ok();
    let seen = cloud.proxy.take_seen();
    assert_eq!(without_places(&there.stdout), here.stdout);
    let bytes: u64 = seen.iter().map(|request| request.sent).sum();
    assert!(bytes < size + (1 << 20), "{bytes} of {size}: nothing is read twice but the ends");
    assert!(seen.len() < 25, "{} requests for {size} bytes", seen.len());

    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(cloud.folder(), "model.onnx");
    write_params(cloud.folder(), 2, &["dip"], "");
    let replay = |bag: &str, out: &str| {
        let options = ["--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", out];
        cloud.tpf(&[&["replay", bag], &options[..]].concat())
    };
    replay("camera.mcap", "here.mcap").ok();
    cloud.proxy.take_seen();
    replay("s3://bags/camera.mcap", "there.mcap").ok();
    let seen = cloud.proxy.take_seen();
    let bytes: u64 = seen.iter().map(|request| request.sent).sum();
    let read = |name: &str| fs::read(cloud.folder().join(name)).unwrap();
    assert!(read("here.mcap") == read("there.mcap"));
    // It is read twice: for the zero, and for the estimates.
    assert!(bytes < size / 4, "{bytes} of {size} bytes were read in {} requests", seen.len());
}
