//! What the core and the model do not do while they run live: ask for memory.

mod common;

use common::fake::*;
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::model::{BackendChoice, ModelSpec, load};

const FINGERS: [&str; 5] = ["thumb", "index", "middle", "ring", "little"];

/// Five fingertips of four taxels and two joints, all on one model.
fn hand(batch: usize) -> Fusion {
    let joints: Vec<[String; 2]> = FINGERS.iter().map(|name| [format!("{name}_dip"), format!("{name}_pip")]).collect();
    let regions = FINGERS.iter().zip(&joints).enumerate().map(|(idx, (name, joints))| {
        let taxels: Vec<usize> = (4 * idx..4 * idx + 4).collect();
        region(name, &taxels, &[&joints[0], &joints[1]])
    });
    let cfg = config(20, regions.collect());
    let cfg = cfg.with_batch(batch_of(batch));
    fusion(cfg, vec![Sum::boxed(64, 4, 2)])
}

/// A second of frames at 100 Hz with joints 3 ms after each.
fn second(from_s: usize) -> Vec<Sample> {
    let names: Vec<String> = FINGERS.iter().flat_map(|name| [format!("{name}_dip"), format!("{name}_pip")]).collect();
    let samples = (100 * from_s..100 * (from_s + 1)).flat_map(|k| {
        let positions = vec![0.01 * (k % 100) as f64; names.len()];
        let joints: Vec<(&str, f64)> = names.iter().map(String::as_str).zip(positions).collect();
        let at_ms = 10.0 * k as f64;
        [Sample::tactile(at_ms, &[(k % 7) as f32; 20]), Sample::joints(at_ms + 3.0, &joints)]
    });
    samples.collect()
}

/// Plays seconds of samples one after the other until the core is warm, which it is when its timelines of 1024 states a joint are
/// full, and `n_measured` more: how much memory these asked for, and how many estimates there were in all.
fn measured(
    core: &mut Fusion,
    second: impl Fn(usize) -> Vec<Sample>,
    n_measured: usize,
) -> (allocation_counter::AllocationInfo, usize) {
    const WARM_S: usize = 12;
    let mut n_estimates = 0;
    let mut play = |samples: &[Sample]| {
        for sample in samples {
            core.handle(sample.event()).unwrap();
            while let Some(tick) = core.poll().unwrap() {
                n_estimates += tick.estimates.iter().filter(|estimate| estimate.force.is_some()).count();
            }
        }
    };
    (0..WARM_S).for_each(|from_s| play(&second(from_s)));
    let samples: Vec<Vec<Sample>> = (WARM_S..WARM_S + n_measured).map(second).collect();
    let used = allocation_counter::measure(|| samples.iter().for_each(|samples| play(samples)));
    (used, n_estimates)
}

#[test]
fn a_tick_of_the_core_asks_for_no_memory_once_it_is_warm() {
    for batch in [1, 16] {
        let (used, n_estimates) = measured(&mut hand(batch), second, 10);
        assert_eq!((used.count_total, used.bytes_total), (0, 0), "batch {batch}");
        assert!(n_estimates > 5 * 2000, "{n_estimates} estimates");
    }
}

#[test]
fn a_tick_of_five_regions_with_their_model_asks_for_no_memory_once_it_is_warm() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/models/glove1_pose_aware.onnx");
    let model = load(&ModelSpec { backend: BackendChoice::Builtin, ..ModelSpec::new(path) }).unwrap();
    let names = model.info.contract.joints.clone().unwrap();
    let joints: Vec<&str> = names.iter().map(String::as_str).collect();
    let n_taxels = model.info.contract.n_taxels;
    let regions = FINGERS
        .iter()
        .enumerate()
        .map(|(idx, name)| region(name, &(n_taxels * idx..n_taxels * (idx + 1)).collect::<Vec<_>>(), &joints));
    let mut core = fusion(config(n_taxels * FINGERS.len(), regions.collect()), vec![model.regressor]);
    let second = |from_s: usize| -> Vec<Sample> {
        let samples = (100 * from_s..100 * (from_s + 1)).flat_map(|k| {
            let angle = |idx: usize| 0.5 + 0.5 * (0.01 * k as f64 + idx as f64).sin();
            let angles: Vec<(&str, f64)> = joints.iter().enumerate().map(|(idx, name)| (*name, angle(idx))).collect();
            let taxels: Vec<f32> =
                (0..n_taxels * FINGERS.len()).map(|taxel| ((k * 31 + taxel * 17) % 97) as f32).collect();
            [Sample::tactile(10.0 * k as f64, &taxels), Sample::joints(10.0 * k as f64 + 3.0, &angles)]
        });
        samples.collect()
    };
    let (used, n_estimates) = measured(&mut core, second, 3);
    assert_eq!((used.count_total, used.bytes_total), (0, 0));
    assert!(n_estimates > 5 * 1400, "{n_estimates} estimates");
}

#[test]
fn following_artifacts_asks_for_no_memory_once_it_is_warm() {
    let (n_taxels, n_joints) = (4, 2);
    let artifact = ArtifactModel {
        n_taxels,
        n_joints,
        shapes: (0..n_taxels * n_joints * ARTIFACT_BASIS).map(|idx| (idx % 5) as f64).collect(),
        gain_variance: vec![0.1; n_taxels * n_joints],
        slip: 0.3,
        slip_common: 0.3,
        slip_time_s: 90.0,
        touch: vec![1.0; n_taxels],
        residual: vec![0.5; n_taxels],
        drift: vec![1.0; n_taxels],
        noise: Vec::new(),
        misfit: Vec::new(),
        uncertain_offsets: true,
        trust_inputs: true,
    };
    let fit = ArtifactFit {
        gains: vec![1.0; n_taxels * n_joints],
        offset: vec![0.0; n_taxels],
        covariance: [0.01, 0.0, 0.0, 0.01].repeat(n_taxels),
        offset_covariance: [0.002, 0.002, 0.02].repeat(n_taxels),
    };
    let joints: Vec<[String; 2]> = FINGERS.iter().map(|name| [format!("{name}_dip"), format!("{name}_pip")]).collect();
    let regions = FINGERS.iter().zip(&joints).enumerate().map(|(idx, (name, joints))| {
        region(name, &(4 * idx..4 * idx + 4).collect::<Vec<_>>(), &[&joints[0], &joints[1]])
    });
    let artifact = Some(std::sync::Arc::new(artifact));
    let contract = Contract { artifact, has_base: false, ..contract(64, n_taxels, 0) };
    let mut core = fusion(config(20, regions.collect()), vec![Box::new(Sum { contract })]);
    (0..FINGERS.len()).for_each(|idx| core.handle_artifact(RegionIdx::at(idx), fit.clone()).unwrap());
    let (used, n_estimates) = measured(&mut core, second, 10);
    assert_eq!((used.count_total, used.bytes_total), (0, 0));
    assert!(n_estimates > 5 * 2000, "{n_estimates} estimates");
    assert!(core.artifact(RegionIdx::at(0)).unwrap().change() > 0.0, "something was learned");
}
