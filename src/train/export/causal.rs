//! The causal network as nodes of an ONNX graph.

use super::super::architecture::{CAUSAL_CHANNELS, CAUSAL_DILATIONS, CAUSAL_FRAMES, TAPS};
use super::Writer;
use crate::model::onnx::{AttributeProto, Graph};
use crate::train::TrainError;

impl Writer<'_> {
    /// Taxels to force and touch.
    pub(super) fn causal(&mut self) -> Result<(), TrainError> {
        let architecture = self.network.architecture.clone();
        let graph = &mut self.graph;
        let first = (architecture.window - CAUSAL_FRAMES) as i64;
        let seen = slice(graph, "tactile", "tactile_seen", 1, first, architecture.window as i64);
        let channels = graph.transpose(&seen, "tactile_channels", &[0, 2, 1]);
        let [scale, fine, one] =
            [("tactile_scale", architecture.tactile_scale), ("touch_scale", architecture.touch_scale), ("one", 1.0)]
                .map(|(name, value)| graph.scalar(name, value));
        let coarse = graph.node("Div", &[&channels, &scale], "tactile_coarse", vec![]);
        let fine = graph.node("Div", &[&channels, &fine], "tactile_fine", vec![]);
        let size = graph.node("Abs", &[&fine], "tactile_size", vec![]);
        let bound = graph.node("Add", &[&size, &one], "tactile_bound", vec![]);
        let soft = graph.node("Div", &[&fine, &bound], "tactile_soft", vec![]);
        let mut x = graph.concat("tactile_both", &[&coarse, &soft], 1);
        let mut frames = CAUSAL_FRAMES;
        let mut n_in = 2 * architecture.n_taxels;
        for (idx, dilation) in CAUSAL_DILATIONS.into_iter().enumerate() {
            let name = format!("causal.conv{idx}");
            let dims = [CAUSAL_CHANNELS as i64, n_in as i64, TAPS as i64];
            let values = self.values(&format!("{name}.weight"))?.to_vec();
            let weight = self.graph.weights(&format!("{name}.weight"), &dims, &values);
            let values = self.values(&format!("{name}.bias"))?.to_vec();
            let bias = self.graph.weights(&format!("{name}.bias"), &dims[..1], &values);
            let attributes = vec![
                AttributeProto::ints("dilations", &[dilation as i64]),
                AttributeProto::int("group", 1),
                AttributeProto::ints("kernel_shape", &dims[2..]),
                AttributeProto::ints("pads", &[0, 0]),
                AttributeProto::ints("strides", &[1]),
            ];
            let convolved = self.graph.node("Conv", &[&x, &weight, &bias], &name, attributes);
            let convolved = self.graph.node("Relu", &[&convolved], &format!("{name}.relu"), vec![]);
            let left = frames - (TAPS - 1) * dilation;
            x = if idx == 0 {
                convolved
            } else {
                let kept = format!("{name}.kept");
                let kept = slice(&mut self.graph, &x, &kept, 2, (frames - left) as i64, frames as i64);
                self.graph.node("Add", &[&convolved, &kept], &format!("{name}.sum"), vec![])
            };
            (frames, n_in) = (left, CAUSAL_CHANNELS);
        }
        let features = self.graph.flatten(&x, "causal_features");
        self.decoder("base", &features, architecture.force_scale, "force")?;
        self.decoder("touch", &features, 1.0, "touch_odds")?;
        self.graph.node("Sigmoid", &["touch_odds"], "touch", vec![]);
        Ok(())
    }
}

/// A slice of an axis.
fn slice(graph: &mut Graph, x: &str, output: &str, axis: i64, from: i64, to: i64) -> String {
    let bounds = [("starts", from), ("ends", to), ("axes", axis)];
    let [starts, ends, axes] = bounds.map(|(what, value)| graph.integers(&format!("{output}.{what}"), &[value]));
    graph.node("Slice", &[x, &starts, &ends, &axes], output, vec![])
}
