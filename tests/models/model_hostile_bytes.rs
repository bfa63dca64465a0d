//! Damaged model files are refused without a panic, a hang, or an allocation that the file does not account for.

use crate::common;

use std::path::Path;

use common::onnx::LinearModel;
use proptest::prelude::*;
use tactile_pose_fusion::model::onnx::{GraphProto, Message, ModelProto, ValueInfoProto};
use tactile_pose_fusion::model::{self, BackendChoice, ModelSpec};

fn small_model() -> Vec<u8> {
    let linear = LinearModel::new(4, 3, 2).metadata("unit", "gF").metadata("joints", "mcp,pip");
    linear.metadata("pose_range", "[[0, 1], [0, 1]]").bytes()
}

/// Inspects bytes as a file. An error must be one line.
fn inspect(folder: &Path, bytes: &[u8]) -> bool {
    let path = folder.join("m.onnx");
    common::write_anew(&path, bytes);
    match model::inspect(&path) {
        Ok(_) => true,
        Err(refused) => {
            let text = refused.to_string();
            assert_eq!(text.lines().count(), 1, "{text}");
            assert!(text.chars().all(|c| !c.is_control()), "{text}");
            false
        }
    }
}

/// Loads bytes in RTen, trial runs and all.
fn load(folder: &Path, bytes: &[u8]) {
    let path = folder.join("m.onnx");
    common::write_anew(&path, bytes);
    let spec = ModelSpec { backend: BackendChoice::Rten, ..ModelSpec::new(&path) };
    if let Err(refused) = model::load(&spec) {
        assert_eq!(refused.to_string().lines().count(), 1, "{refused}");
    }
}

#[test]
fn every_truncation_is_inspected_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_model();
    assert!(inspect(folder.path(), &bytes));
    for len in 0..bytes.len() {
        inspect(folder.path(), &bytes[..len]);
    }
}

#[test]
fn every_truncation_is_loaded_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_model();
    for len in 0..bytes.len() {
        load(folder.path(), &bytes[..len]);
    }
}

#[test]
fn every_flipped_bit_is_inspected_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_model();
    for idx in 0..bytes.len() {
        for bit in 0..8 {
            let mut damaged = bytes.clone();
            damaged[idx] ^= 1 << bit;
            inspect(folder.path(), &damaged);
        }
    }
}

#[test]
fn every_flipped_bit_is_loaded_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_model();
    for idx in 0..bytes.len() {
        for bit in 0..8 {
            let mut damaged = bytes.clone();
            damaged[idx] ^= 1 << bit;
            load(folder.path(), &damaged);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn noise_is_inspected_without_a_panic(noise in proptest::collection::vec(any::<u8>(), 0..512)) {
        let folder = tempfile::tempdir().unwrap();
        inspect(folder.path(), &noise);
    }

    #[test]
    fn spliced_bytes_are_inspected_without_a_panic(at in 0usize..600, cut in 0usize..64, noise in proptest::collection::vec(any::<u8>(), 0..32)) {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = small_model();
        let at = at.min(bytes.len());
        let end = (at + cut).min(bytes.len());
        bytes.splice(at..end, noise);
        inspect(folder.path(), &bytes);
    }
}

#[test]
fn a_length_prefix_of_gigabytes_allocates_nothing() {
    let folder = tempfile::tempdir().unwrap();
    // Field 7 (graph), length 2^60.
    let bytes = [0x3A, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x10];
    assert!(!inspect(folder.path(), &bytes));
}

#[test]
fn graphs_nested_without_end_are_refused() {
    let mut graph = GraphProto::default();
    for _ in 0..200 {
        let mut node = tactile_pose_fusion::model::onnx::NodeProto::standard("If", &["x"], &["y"], vec![]);
        node.attribute.push(tactile_pose_fusion::model::onnx::AttributeProto { g: Some(graph), ..Default::default() });
        graph = GraphProto { node: vec![node], ..Default::default() };
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(!inspect(folder.path(), &ModelProto::with_graph(graph, 17).encode_to_vec()));
}

#[test]
fn shapes_of_absurd_size_are_refused_before_anything_is_run() {
    let folder = tempfile::tempdir().unwrap();
    for (window, taxels) in
        [(i64::MAX, 3), (4, i64::MAX), (1 << 40, 1 << 40), (0, 3), (i64::MIN, 3), (1 << 20, 1 << 10)]
    {
        let mut model = LinearModel::new(4, 3, 0).proto();
        let graph = model.graph.as_mut().unwrap();
        let dim = tactile_pose_fusion::model::onnx::DimensionProto::fixed;
        graph.input[0] = ValueInfoProto::float32("tactile", vec![dim(1), dim(window), dim(taxels)]);
        assert!(!inspect(folder.path(), &model.encode_to_vec()), "{window} x {taxels}");
    }
}
