//! The simplest model, which everybody tries first: the sum of the taxels times a gain.

use tactile_pose_fusion::fusion::ArtifactModel;
use tactile_pose_fusion::model::onnx::{
    AttributeProto, DimensionProto, GraphProto, Message, ModelProto, NodeProto, TensorProto, ValueInfoProto,
};

/// An ONNX model whose force is the taxels of a frame, each times a gain: those by which taxels read a light touch, as the
/// artifact model of a trained glove tells them. Least squares: `f = k y / k k`.
pub(super) fn model(artifact: &ArtifactModel, rate_hz: f64) -> Vec<u8> {
    let square: f64 = artifact.touch.iter().map(|touch| touch * touch).sum();
    let gains: Vec<f32> = artifact.touch.iter().map(|touch| (touch / square) as f32).collect();
    let n_taxels = artifact.n_taxels as i64;
    let gather = vec![AttributeProto::int("axis", 1)];
    let dims = vec![DimensionProto::named("N"), DimensionProto::fixed(1), DimensionProto::fixed(n_taxels)];
    let graph = GraphProto {
        name: "taxels_times_a_gain".to_owned(),
        node: vec![
            NodeProto::standard("Gather", &["tactile", "last"], &["frame"], gather),
            NodeProto::standard("MatMul", &["frame", "gains"], &["force"], Vec::new()),
        ],
        initializer: vec![
            TensorProto::int64("last", &[], &[-1]),
            TensorProto::float32("gains", &[n_taxels, 1], &gains),
        ],
        input: vec![ValueInfoProto::float32("tactile", dims)],
        output: vec![ValueInfoProto::float32("force", vec![DimensionProto::named("N"), DimensionProto::fixed(1)])],
        ..GraphProto::default()
    };
    let mut model = ModelProto::with_graph(graph, 17);
    model.push_metadata("unit", "gF");
    model.push_metadata("rate_hz", &rate_hz.to_string());
    model.encode_to_vec()
}
