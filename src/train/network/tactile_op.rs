//! The tactile branch as one node of the autodiff graph.

use std::sync::Arc;

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::{Autodiff, Flex};
use burn::tensor::{Device, Tensor, TensorData};

use super::super::architecture::N_FEATURES;
use super::flex::{ON_FLEX, primitive, primitive_values, values};
use super::tactile::{self, N_PARAMETERS, TactileShape, TactileTape};
use super::{BatchNormStatistics, Normalize};

/// Runs the branch over windows.
///
/// # Shapes
/// `x`: `[L, N, T]`; the output is `[N, 64]`.
pub(super) fn features(
    shape: TactileShape,
    x: Vec<f32>,
    parameters: [Tensor<1>; N_PARAMETERS],
    normalize: Normalize<'_>,
    device: &Device,
) -> (Tensor<2>, Option<BatchNormStatistics>) {
    let dims = [shape.batch, N_FEATURES];
    if !parameters[0].is_autodiff() {
        let (tape, statistics) = tactile::forward(shape, &x, &parameters.map(values), normalize);
        return (Tensor::from_data(TensorData::new(tape.features, dims), device), statistics);
    }
    let parameters = parameters.map(|tensor| tensor.try_into_primitive::<Autodiff<Flex>>().expect(ON_FLEX));
    let nodes = parameters.each_ref().map(|tensor| tensor.node());
    let parameters = parameters.map(|tensor| primitive_values(tensor.into_primitive()));
    let (tape, statistics) = tactile::forward(shape, &x, &parameters, normalize);
    let output = primitive(tape.features.clone(), &dims);
    let output = match TactileBackward.prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(prepared) => prepared.finish(Arc::new(Pass { shape, x, parameters, tape }), output),
        OpsKind::UnTracked(prepared) => prepared.finish(output),
    };
    (Tensor::from_primitive::<Autodiff<Flex>>(output), statistics)
}

#[derive(Debug)]
struct Pass {
    shape: TactileShape,
    x: Vec<f32>,
    parameters: [Vec<f32>; N_PARAMETERS],
    tape: TactileTape,
}

#[derive(Debug)]
struct TactileBackward;

impl Backward<Flex, N_PARAMETERS> for TactileBackward {
    type State = Arc<Pass>;

    fn backward(self, ops: Ops<Self::State, N_PARAMETERS>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let Pass { shape, x, parameters, tape } = &*ops.state;
        let grad = primitive_values(grads.consume::<Flex>(&ops.node));
        let back = tactile::backward(*shape, x, parameters, tape, &grad);
        for (node, grad) in ops.parents.into_iter().zip(back) {
            if let Some(node) = node {
                let n = grad.len();
                grads.register::<Flex>(node.id, primitive(grad, &[n]));
            }
        }
    }
}
