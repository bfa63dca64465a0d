//! The causal network: dilated convolutions over taxels without their artifact, with one force and touch per frame.
//!
//! There is no padding, so a force is the same whatever window it is computed in.

use burn::tensor::activation::relu;
use burn::tensor::{Tensor, TensorData};

use super::super::architecture::{Architecture, CAUSAL_DILATIONS, CAUSAL_FRAMES, TAPS};
use super::{NetworkInput, Output, Weights};

impl Weights<'_> {
    /// Forces of the last frames of each window: one, plus one for each frame beyond the network's own window.
    pub(super) fn causal(&self, input: NetworkInput) -> Output {
        let Architecture { window, n_taxels, tactile_scale, touch_scale, force_scale, .. } = *self.architecture;
        let NetworkInput { n, tactile, .. } = input;
        let frames = tactile.len() / (n * n_taxels).max(1);
        let fine: Vec<f32> = tactile.iter().map(|value| softsign(value * tactile_scale / touch_scale)).collect();
        let tensor = |values| Tensor::<3>::from_data(TensorData::new(values, [frames, n, n_taxels]), &self.device);
        let both = Tensor::cat(vec![tensor(tactile), tensor(fine)], 2);
        let mut x = both.slice([window - CAUSAL_FRAMES..frames, 0..n, 0..2 * n_taxels]);
        for (idx, dilation) in CAUSAL_DILATIONS.into_iter().enumerate() {
            let convolved = relu(self.causal_convolution(&format!("causal.conv{idx}"), x.clone(), dilation));
            let [left, n, width] = convolved.dims();
            let [had, ..] = x.dims();
            x = if idx == 0 { convolved } else { convolved + x.slice([had - left..had, 0..n, 0..width]) };
        }
        let [left, n, width] = x.dims();
        let features = x.reshape([left * n, width]);
        let force = self.decode("base", features.clone()) * force_scale;
        let touch = self.decode("touch", features);
        Output { force, base: None, touch: Some(touch), artifact: None, statistics: None }
    }

    /// `[L, N, C]` to `[L - 2 * dilation, N, CAUSAL_CHANNELS]`.
    fn causal_convolution(&self, name: &str, x: Tensor<3>, dilation: usize) -> Tensor<3> {
        let bias = self.flat(&format!("{name}.bias"));
        let ([frames, n, n_in], n_out) = (x.dims(), bias.dims()[0]);
        let left = frames - (TAPS - 1) * dilation;
        let weight = self.flat(&format!("{name}.weight")).reshape([n_out, n_in, TAPS]);
        let mut sum = bias.reshape([1, n_out]);
        for tap in 0..TAPS {
            let begin = tap * dilation;
            let seen = x.clone().slice([begin..begin + left, 0..n, 0..n_in]).reshape([left * n, n_in]);
            let weight = weight.clone().slice([0..n_out, 0..n_in, tap..tap + 1]).reshape([n_out, n_in]);
            sum = seen.matmul(weight.transpose()) + sum;
        }
        sum.reshape([left, n, n_out])
    }
}

/// Between -1 and 1, and nearly the value itself near zero.
fn softsign(value: f32) -> f32 {
    value / (1.0 + value.abs())
}
