//! The tail of a live tick: joint angles and one frame of taxels in, the estimates of five regions out, on one thread, by our
//! own code and by the runtimes that it is held against.
//!
//! Criterion tells means; a controller waits for the slowest. Ticks come one after the other, and at 100 Hz as they do
//! live, where the caches are cold and the core may have slept. Pin it to one core: `taskset -c 0 cargo bench --bench tick`.
#![allow(clippy::print_stdout)] // the table is the result

#[path = "../tests/common/mod.rs"]
mod common;

use std::path::Path;
use std::time::{Duration, Instant};

use common::bags::at;
use common::fake::{config, joints, region, tactile};
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::glove::Glove;
use tactile_pose_fusion::model::{BackendChoice, ModelSpec, load, vectors};
use tactile_pose_fusion::observer::Unobserved;
use tactile_pose_fusion::sim::{Activity, Conditions, Fingers, SessionSpec, Tracking};
use tactile_pose_fusion::synthetic;
use tactile_pose_fusion::zero::{self, KnownModels, Wanted};

const FINGERS: [&str; 5] = ["thumb", "index", "middle", "ring", "little"];
const JOINTS: [&str; 4] = ["dip", "pip", "mcp_flex", "mcp_abd"];
/// The paper's model names its joints, so every fingertip is given the angles of this finger; a joint state has those of all.
const TRAINED: &str = "index";
const N_TAXELS: usize = 6;
const N_BACK_TO_BACK: i64 = 10_000;
const N_PACED: i64 = 2_000;
const PERIOD: Duration = Duration::from_millis(10);

/// Five fingertips that share the model of synthetic glove 1.
fn hand(backend: BackendChoice) -> Fusion {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/glove1_pose_aware.onnx");
    let spec = ModelSpec { backend, ..ModelSpec::new(path) };
    let regions = FINGERS.iter().enumerate().map(|(idx, finger)| {
        let taxels: Vec<usize> = (N_TAXELS * idx..N_TAXELS * (idx + 1)).collect();
        let joints: Vec<String> = JOINTS.iter().map(|joint| format!("{TRAINED}_{joint}")).collect();
        region(finger, &taxels, &joints.iter().map(String::as_str).collect::<Vec<_>>())
    });
    let cfg = config(N_TAXELS * FINGERS.len(), regions.collect());
    common::fake::fusion(cfg, vec![load(&spec).unwrap().regressor])
}

/// The hand of `params/hand1.yaml`: a fingertip each has an adaptive model. The artifact of a synthetic donning is followed.
fn adaptive_hand() -> Fusion {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("session");
    let spec = SessionSpec {
        glove: 1,
        user: 1,
        session: 1,
        seed: 5,
        minutes: 1.7,
        activity: Activity::Protocol,
        tracking: Tracking::Markers,
        conditions: Conditions { fingers: Fingers::All, ..Conditions::default() },
    };
    synthetic::write(&spec, &session, false, &Unobserved).unwrap();
    let params = Path::new(env!("CARGO_MANIFEST_DIR")).join("params/hand1.yaml");
    let glove = Glove::load(params).unwrap();
    let names = glove.config().models().iter().map(|model| model.name.as_str());
    let known = names.zip(glove.models()).map(|(name, info)| (name, info.sha256.as_str(), &info.contract));
    let zero = zero::find(Wanted::Any, glove.config(), &[session], &KnownModels::new(known)).unwrap();
    let mut core = glove.into_core().unwrap();
    zero.install(&mut core).unwrap();
    core
}

/// Seconds of each of `n` ticks, sorted.
fn ticks(fusion: &mut Fusion, is_adaptive: bool, first: i64, n: i64, period: Option<Duration>) -> Vec<f64> {
    let of_thumb = ["thumb_ip", "thumb_mcp", "thumb_cmc_flex", "thumb_cmc_abd"].map(str::to_owned);
    let of_finger = |finger| JOINTS.iter().map(move |joint| format!("{finger}_{joint}"));
    let names: Vec<String> = FINGERS[1..].iter().flat_map(of_finger).chain(of_thumb).collect();
    let begin = Instant::now();
    let mut seconds: Vec<f64> = (first..first + n)
        .map(|k| {
            let stamp = at(k * 10);
            let positions: Vec<f64> = (0..names.len()).map(|joint| (k as f64 * 0.01 + joint as f64).sin()).collect();
            let values: Vec<f32> =
                (0..N_TAXELS * FINGERS.len()).map(|taxel| ((k * 31 + taxel as i64 * 17) % 97) as f32).collect();
            if let Some(period) = period {
                let due = begin + period * (k - first) as u32;
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
            let began = Instant::now();
            fusion.handle(joints(stamp, &names, &positions)).unwrap();
            fusion.handle(tactile(stamp, &values)).unwrap();
            let tick = fusion.poll().unwrap().expect("a frame has its joints and is run");
            let taken = began.elapsed().as_secs_f64();
            assert!(k < 63 || tick.estimates.iter().all(|estimate| estimate.force.is_some()));
            let follows = |estimate: &Estimate| !matches!(estimate.adaptation, Adaptation::Off | Adaptation::Frozen);
            assert!(k < 63 || tick.estimates.iter().all(|estimate| follows(estimate) == is_adaptive));
            taken
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    seconds
}

fn main() {
    println!("vectors of the built-in code: {}\n", vectors());
    println!("| five regions, one tick | ticks | p50 us | p99 us | p99.9 us | max us |\n|---|---|---|---|---|---|");
    let mut ways = vec![
        ("the built-in code", hand(BackendChoice::Builtin), false),
        ("adaptive models, the built-in code", adaptive_hand(), true),
        ("RTen", hand(BackendChoice::Rten), false),
    ];
    if common::onnx_runtime_is_here() {
        ways.push(("ONNX Runtime", hand(BackendChoice::OnnxRuntime), false));
    }
    for (name, mut fusion, is_adaptive) in ways {
        let mut first = 0;
        for (how, n, period) in
            [("", 200, None), ("one after the other", N_BACK_TO_BACK, None), ("at 100 Hz", N_PACED, Some(PERIOD))]
        {
            let seconds = ticks(&mut fusion, is_adaptive, first, n, period);
            first += n;
            if how.is_empty() {
                continue; // to warm up
            }
            // Nearest rank.
            let us = |share: f64| seconds[((share * n as f64).ceil() as usize).max(1) - 1] * 1e6;
            let [p50, p99, p999, max] = [0.5, 0.99, 0.999, 1.0].map(us);
            println!("| {name}, {how} | {n} | {p50:.0} | {p99:.0} | {p999:.0} | {max:.0} |");
        }
    }
}
