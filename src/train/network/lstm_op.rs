//! An LSTM layer and direction as one node of the autodiff graph.

use std::sync::Arc;

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::NoCheckpointing;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::{Autodiff, Flex};
use burn::tensor::{Tensor, TensorData};

use super::flex::{ON_FLEX, primitive, primitive_values, values};
use super::lstm::{self, LstmShape, LstmTape, LstmWeights};

/// Runs an LSTM from a zero state over all frames.
///
/// # Shapes
/// `x`: `[L, B, I]`; `weights`: `[4H, I]`, `[4H, H]`, `[4H]` flat; the output is `[L, B, H]`.
pub(super) fn lstm(x: Tensor<3>, weights: [Tensor<1>; 3], hidden: usize, reversed: bool) -> Tensor<3> {
    let [frames, batch, input] = x.dims();
    let shape = LstmShape { frames, batch, input, hidden, reversed };
    if !x.is_autodiff() {
        let [w_input, w_hidden, bias] = weights.map(values);
        let weights = LstmWeights { input: &w_input, hidden: &w_hidden, bias: &bias };
        let device = x.device();
        let tape = lstm::forward(shape, &values(x), weights);
        return Tensor::from_data(TensorData::new(tape.hidden, [frames, batch, hidden]), &device);
    }
    let x = x.try_into_primitive::<Autodiff<Flex>>().expect(ON_FLEX);
    let [w_input, w_hidden, bias] = weights.map(|w| w.try_into_primitive::<Autodiff<Flex>>().expect(ON_FLEX));
    let nodes = [x.node(), w_input.node(), w_hidden.node(), bias.node()];
    let inputs = Inputs {
        shape,
        x: primitive_values(x.into_primitive()),
        input: primitive_values(w_input.into_primitive()),
        hidden: primitive_values(w_hidden.into_primitive()),
        bias: primitive_values(bias.into_primitive()),
    };
    let tape = lstm::forward(shape, &inputs.x, inputs.weights());
    let output = primitive(tape.hidden.clone(), &[frames, batch, hidden]);
    let output = match LstmBackward.prepare::<NoCheckpointing>(nodes).compute_bound().stateful() {
        OpsKind::Tracked(prepared) => prepared.finish(Arc::new((inputs, tape)), output),
        OpsKind::UnTracked(prepared) => prepared.finish(output),
    };
    Tensor::from_primitive::<Autodiff<Flex>>(output)
}

#[derive(Debug)]
struct Inputs {
    shape: LstmShape,
    x: Vec<f32>,
    input: Vec<f32>,
    hidden: Vec<f32>,
    bias: Vec<f32>,
}

impl Inputs {
    fn weights(&self) -> LstmWeights<'_> {
        LstmWeights { input: &self.input, hidden: &self.hidden, bias: &self.bias }
    }
}

#[derive(Debug)]
struct LstmBackward;

impl Backward<Flex, 4> for LstmBackward {
    type State = Arc<(Inputs, LstmTape)>;

    fn backward(self, ops: Ops<Self::State, 4>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let (inputs, tape) = &*ops.state;
        let LstmShape { frames, batch, input, hidden, .. } = inputs.shape;
        let grad = primitive_values(grads.consume::<Flex>(&ops.node));
        let back = lstm::backward(inputs.shape, &inputs.x, inputs.weights(), tape, &grad);
        let back = [
            primitive(back.x, &[frames, batch, input]),
            primitive(back.weight_input, &[4 * hidden * input]),
            primitive(back.weight_hidden, &[4 * hidden * hidden]),
            primitive(back.bias, &[4 * hidden]),
        ];
        for (node, grad) in ops.parents.into_iter().zip(back) {
            if let Some(node) = node {
                grads.register::<Flex>(node.id, grad);
            }
        }
    }
}
