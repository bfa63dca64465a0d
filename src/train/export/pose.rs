//! The pose branch: joint angles to the features of the last frame.

use super::super::error::TrainError;
use super::{GraphForm, LSTM_HIDDEN, N_FEATURES, NORM_EPSILON, Writer};

impl Writer<'_> {
    /// Joint angles to `[N, 64]`.
    pub(super) fn pose_branch(&mut self) -> Result<String, TrainError> {
        let embedded = self.pose_embedding()?;
        let first = self.bidirectional("pose.lstm0", &embedded)?;
        match self.form {
            GraphForm::Fast => self.last_state_of_layer_two(&first),
            GraphForm::Plain => {
                let hidden = self.bidirectional("pose.lstm1", &first)?;
                let window = self.network.architecture.window as i64;
                Ok(self.graph.gather_frame(&hidden, "pose_features", window - 1))
            }
        }
    }

    /// `pose` to `[L, N, 64]`, time first from here on.
    fn pose_embedding(&mut self) -> Result<String, TrainError> {
        let width = 2 * self.network.architecture.n_joints as i64;
        let pose = self.graph.transpose("pose", "pose_frames", &[1, 0, 2]);
        let sin = self.graph.node("Sin", &[&pose], "pose_sin", vec![]);
        let cos = self.graph.node("Cos", &[&pose], "pose_cos", vec![]);
        let encoded = self.graph.concat("pose_encoded", &[&sin, &cos], -1);
        let gain = self.values("pose.norm.weight")?.to_vec();
        let shift = self.values("pose.norm.bias")?.to_vec();
        let gain = self.graph.weights("pose.norm.weight", &[width], &gain);
        let shift = self.graph.weights("pose.norm.bias", &[width], &shift);
        let normed = self.graph.layer_norm(&encoded, &gain, &shift, NORM_EPSILON, "pose_normed");
        let weight = transposed(self.values("pose.embed.weight")?, width as usize);
        let bias = self.values("pose.embed.bias")?.to_vec();
        let weight = self.graph.weights("pose.embed.weight", &[width, N_FEATURES as i64], &weight);
        let bias = self.graph.weights("pose.embed.bias", &[N_FEATURES as i64], &bias);
        let product = self.graph.node("MatMul", &[&normed, &weight], "pose_product", vec![]);
        let sum = self.graph.node("Add", &[&product, &bias], "pose_sum", vec![]);
        Ok(self.graph.gelu(&sum, "pose_embedded"))
    }

    /// A layer in both directions over all frames: `[L, N, 64]` to `[L, N, 64]`.
    fn bidirectional(&mut self, layer: &str, x: &str) -> Result<String, TrainError> {
        let [forward, backward] = [self.lstm_weights(layer, "forward")?, self.lstm_weights(layer, "backward")?];
        let both = |part: usize| [forward[part].as_slice(), backward[part].as_slice()].concat();
        let weights = self.graph.lstm_weights(layer, 2, [&both(0), &both(1), &both(2)]);
        let output = format!("{layer}.states");
        self.graph.lstm(x, &weights, "bidirectional", [&output, ""]);
        // [L, 2, N, 32] to [L, N, 2, 32] to [L, N, 64].
        let by_window = self.graph.transpose(&output, &format!("{layer}.by_window"), &[0, 2, 1, 3]);
        Ok(self.graph.reshape(&by_window, &format!("{layer}.hidden"), &[0, 0, N_FEATURES as i64]))
    }

    /// Only the last frame of layer 2 is used, which its backward direction reaches in its first step.
    fn last_state_of_layer_two(&mut self, x: &str) -> Result<String, TrainError> {
        let window = self.network.architecture.window as i64;
        let [forward, backward] =
            [self.lstm_weights("pose.lstm1", "forward")?, self.lstm_weights("pose.lstm1", "backward")?];
        let weights = self.graph.lstm_weights("pose.lstm1.forward", 1, [&forward[0], &forward[1], &forward[2]]);
        self.graph.lstm(x, &weights, "forward", ["", "pose.lstm1.forward.last"]);
        let last_frame = self.graph.slice_frame(x, "pose.lstm1.last_frame", window - 1);
        let weights = self.graph.lstm_weights("pose.lstm1.backward", 1, [&backward[0], &backward[1], &backward[2]]);
        self.graph.lstm(&last_frame, &weights, "forward", ["", "pose.lstm1.backward.last"]);
        let both = ["pose.lstm1.forward.last", "pose.lstm1.backward.last"];
        let states = self.graph.concat("pose.lstm1.last", &both, 2);
        Ok(self.graph.squeeze(&states, "pose_features", 0))
    }

    /// Weights of a direction in ONNX's gate order: input, output, forget, cell.
    fn lstm_weights(&self, layer: &str, direction: &str) -> Result<[Vec<f32>; 3], TrainError> {
        let values = |part: &str| self.values(&format!("{layer}.{direction}.{part}"));
        let bias = [by_onnx_gates(values("bias_ih")?), by_onnx_gates(values("bias_hh")?)].concat();
        Ok([by_onnx_gates(values("weight_ih")?), by_onnx_gates(values("weight_hh")?), bias])
    }
}

/// From PyTorch's gate order (input, forget, cell, output) to ONNX's (input, output, forget, cell).
fn by_onnx_gates(values: &[f32]) -> Vec<f32> {
    let gate = values.len() / 4;
    debug_assert_eq!(gate % LSTM_HIDDEN, 0);
    [0, 3, 1, 2].iter().flat_map(|idx| &values[idx * gate..(idx + 1) * gate]).copied().collect()
}

/// The transpose of a row-major matrix of `columns`.
fn transposed(values: &[f32], columns: usize) -> Vec<f32> {
    let rows = values.len() / columns;
    (0..columns).flat_map(|column| (0..rows).map(move |row| values[row * columns + column])).collect()
}
