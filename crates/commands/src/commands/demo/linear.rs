//! The simplest model, which everybody tries first: the sum of the taxels times a gain.

use tactile_pose_fusion::fusion::Contract;
use tactile_pose_fusion::model::onnx::{
    AttributeProto, DimensionProto, GraphProto, Message, ModelProto, NodeProto, TensorProto, ValueInfoProto,
};

/// How taxels read a light touch, by the artifact model of an adaptive model. One linear model serves all regions, so this is
/// the mean of their patterns if the adaptive model has several. `None` if it has no artifact model.
///
/// # Shapes
/// `[taxels]`, taxel units for each gF.
pub(super) fn touch_pattern(contract: &Contract) -> Option<Vec<f64>> {
    let of_regions = contract.regions.values().map(|terms| &terms.artifact);
    let patterns: Vec<&[f64]> = contract.artifact.iter().chain(of_regions).map(|artifact| &*artifact.touch).collect();
    let n_taxels = patterns.first()?.len();
    let mean = |taxel: usize| patterns.iter().map(|touch| touch[taxel]).sum::<f64>() / patterns.len() as f64;
    Some((0..n_taxels).map(mean).collect())
}

/// An ONNX model whose force is the taxels of a frame, each times a gain: those by which taxels read a light touch. Least
/// squares: `f = k y / k k`.
///
/// # Shapes
/// `touch`: `[taxels]`, as of [`touch_pattern`].
pub(super) fn model(touch: &[f64], rate_hz: f64) -> Vec<u8> {
    let square: f64 = touch.iter().map(|touch| touch * touch).sum();
    let gains: Vec<f32> = touch.iter().map(|touch| (touch / square) as f32).collect();
    let n_taxels = touch.len() as i64;
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
