//! Layers of the network: operators with weights, and the operators between them.

use super::super::attributes::Attributes;
use super::super::flow::{Axis, Flow, Gelu, Side, Size, Value, What};
use super::super::{Cells, DILATIONS, Dense, TAPS};
use super::Walk;
use crate::model::onnx::NodeProto;

/// Smallest epsilon of a layer normalization. With less, a variance near zero would amplify rounding errors.
const LEAST_EPSILON: f32 = 1e-8;

impl<'g> Walk<'g> {
    pub(super) fn convolution(
        &mut self,
        x: Flow,
        weight: &str,
        bias: &str,
        given: &mut Attributes<'_>,
    ) -> Option<Flow> {
        let (layer, n_in, is_flat) = match (x.what, x.axes.as_slice()) {
            (what, [Axis::Windows, Axis::Features(n_in), Axis::Frames(_)]) => (layer_behind(what)?, *n_in, true),
            (what, [Axis::Windows, Axis::Features(n_in), Axis::One, Axis::Frames(_)]) => {
                (layer_behind(what)?, *n_in, false)
            }
            _ => return None,
        };
        let dilation = *DILATIONS.get(layer)? as i64;
        let axes = |last: i64, other: i64| if is_flat { vec![last] } else { vec![other, last] };
        let is_plain = given.is("group", 1)
            && given.says("auto_pad", "NOTSET")
            && given.are("kernel_shape", &axes(TAPS as i64, 1))
            && given.are("strides", &axes(1, 1))
            && given.ints("dilations")?.unwrap_or(&axes(1, 1)) == axes(dilation, 1)
            && given.ints("pads")? == Some(&axes(dilation, 0).repeat(2));
        let (mut dims, weight) = self.weights(weight)?;
        if !is_flat && dims.len() == 4 && dims[2] == 1 {
            dims.remove(2);
        }
        let [n_out, of_inputs, TAPS] = *dims.as_slice() else { return None };
        let bias = self.shaped(bias, &[n_out])?;
        (is_plain && of_inputs == n_in && (layer == 0 || n_out == n_in)).then_some(())?;
        keep(&mut self.found.convolutions[layer], Dense { dims, weight, bias })?;
        let mut axes = x.axes;
        axes[1] = Axis::Features(n_out);
        Some(Flow { what: What::Convolved(layer), axes })
    }

    /// Maximum over all frames.
    pub(super) fn max_pool(&self, x: Flow, given: &mut Attributes<'_>) -> Option<Flow> {
        let Some((Axis::Windows, [Axis::Features(_), over @ ..])) = x.axes.split_first() else { return None };
        let (n, ones) = (over.len(), vec![1; over.len()]);
        let kernel: Vec<i64> =
            over.iter().map(|axis| if *axis == Axis::One { 1 } else { self.window as i64 }).collect();
        let is_plain = given.ints("kernel_shape")? == Some(&kernel)
            && given.ints("strides")?.is_none_or(|strides| strides.len() == n && strides.iter().all(|n| *n > 0))
            && given.are("pads", &vec![0; 2 * n])
            && given.are("dilations", &ones)
            && given.is("ceil_mode", 0)
            && given.is("storage_order", 0)
            && given.says("auto_pad", "NOTSET");
        let over: Vec<usize> = (2..x.axes.len()).collect();
        highest(x, &over).filter(|_| is_plain)
    }

    pub(super) fn reduce_max(&self, x: Flow, axes: &[&str], given: &mut Attributes<'_>) -> Option<Flow> {
        let axes = match axes {
            [] => given.ints("axes")??.to_vec(),
            [axes] => self.numbers(axes)?,
            _ => return None,
        };
        let over = axes.iter().map(|axis| x.at(*axis)).collect::<Option<Vec<_>>>()?;
        let keeps = given.int("keepdims", 1)? == 1;
        let fits = given.is("noop_with_empty_axes", 0) && !over.is_empty();
        let axes: Vec<i64> = over.iter().map(|at| *at as i64).collect();
        let highest = highest(x, &over).filter(|_| fits)?;
        if keeps { Some(highest) } else { highest.squeezed(&axes) }
    }

    pub(super) fn layer_norm(&mut self, x: Flow, gain: &str, shift: &str, given: &mut Attributes<'_>) -> Option<Flow> {
        let Some(Axis::Features(width)) = x.axes.last().copied() else { return None };
        let axis = x.at(given.int("axis", -1)?)?;
        let epsilon = given.float("epsilon", 1e-5)?; // ONNX's default
        let is_plain = axis + 1 == x.axes.len() && given.is("stash_type", 1) && (LEAST_EPSILON..1.0).contains(&epsilon);
        let (gain, shift) = (self.shaped(gain, &[width])?, self.shaped(shift, &[width])?);
        let normed = next(x, What::Encoded, What::Normed).filter(|_| is_plain)?;
        keep(&mut self.found.pose.norm, (gain, shift, epsilon))?;
        Some(normed)
    }

    pub(super) fn embedding(&mut self, x: Flow, weight: &str) -> Option<Flow> {
        let (dims, weight) = self.weights(weight)?;
        let ([n_in, n_out], Some(last)) = (*dims.as_slice().first_chunk::<2>()?, x.axes.last()) else { return None };
        (dims.len() == 2 && *last == Axis::Features(n_in)).then_some(())?;
        let mut product = next(x, What::Normed, What::Multiplied)?;
        keep(&mut self.found.pose.weight, (dims, weight))?;
        product.axes.pop();
        product.axes.push(Axis::Features(n_out));
        Some(product)
    }

    /// A tensor that depends on the inputs, and a constant, in either order.
    fn with_constant<'n>(&self, a: &'n str, b: &'n str) -> Option<(Flow, &'n str)> {
        self.flow(a).map(|flow| (flow, b)).or_else(|| self.flow(b).map(|flow| (flow, a)))
    }

    pub(super) fn sum(&mut self, a: &str, b: &str) -> Option<Flow> {
        let (x, constant) = self.with_constant(a, b)?;
        match x.what {
            What::Multiplied => {
                let Some(Axis::Features(width)) = x.axes.last().copied() else { return None };
                let bias = self.shaped(constant, &[width])?;
                keep(&mut self.found.pose.bias, bias)?;
                x.becomes(What::Embedded)
            }
            What::Gelu(Gelu::Erf) if self.number(constant, x.axes.len())? == 1.0 => x.becomes(What::Gelu(Gelu::Gate)),
            _ => None,
        }
    }

    pub(super) fn product(&self, a: &str, b: &str) -> Option<Value<'g>> {
        use Gelu::{Gate, Gated, Half, HalfGate, Scaled};
        if let (Some(a), Some(b)) = (self.sizes(a), self.sizes(b)) {
            return a.times(&b).map(Value::Sizes);
        }
        let what = match (self.flow(a), self.flow(b)) {
            (Some(a), Some(b)) if a.axes != b.axes => return None,
            (Some(a), Some(b)) => match [(a.what, b.what), (b.what, a.what)] {
                [(What::Touch, What::Posed), _] | [_, (What::Touch, What::Posed)] => What::Product,
                [(What::Embedded, What::Gelu(Gate)), _] | [_, (What::Embedded, What::Gelu(Gate))] => What::Gelu(Gated),
                [(What::Gelu(Half), What::Gelu(Gate)), _] | [_, (What::Gelu(Half), What::Gelu(Gate))] => {
                    What::Activated
                }
                [(What::Embedded, What::Gelu(HalfGate)), _] | [_, (What::Embedded, What::Gelu(HalfGate))] => {
                    What::Activated
                }
                _ => return None,
            },
            _ => {
                let (x, constant) = self.with_constant(a, b)?;
                let factor = self.number(constant, x.axes.len())?;
                match x.what {
                    What::Embedded if factor == std::f32::consts::FRAC_1_SQRT_2 => What::Gelu(Scaled),
                    What::Embedded if factor == 0.5 => What::Gelu(Half),
                    What::Gelu(Gate) if factor == 0.5 => What::Gelu(HalfGate),
                    What::Gelu(Gated) if factor == 0.5 => What::Activated,
                    _ => return None,
                }
            }
        };
        let (x, _) = self.with_constant(a, b)?;
        x.becomes(what).map(Value::Flow)
    }

    /// Fully connected layer of a decoder.
    pub(super) fn linear(&mut self, x: Flow, weight: &str, bias: &str, given: &mut Attributes<'_>) -> Option<Flow> {
        let [Axis::Windows, Axis::Features(n_in)] = *x.axes.as_slice() else { return None };
        let is_plain = given.float("alpha", 1.0)? == 1.0
            && given.float("beta", 1.0)? == 1.0
            && given.is("transA", 0)
            && given.int("transB", 0)? == 1;
        let (dims, weight) = self.weights(weight)?;
        let [n_out, of_inputs] = *dims.as_slice() else { return None };
        let bias = self.shaped(bias, &[n_out])?;
        (is_plain && of_inputs == n_in).then_some(())?;
        let (side, idx, what, axis) = match x.what {
            What::Touch => (Side::Touch, 0, What::Hidden(Side::Touch), Axis::Features(n_out)),
            What::Fused(side) => (side, 0, What::Hidden(side), Axis::Features(n_out)),
            What::HiddenRectified(side) if n_out == 1 => (side, 1, What::Force(side), Axis::One),
            _ => return None,
        };
        let place = &mut self.found.decoders.entry(side).or_default()[idx];
        keep(place, Dense { dims, weight, bias })?;
        Some(Flow::new(what, &[Axis::Windows, axis]))
    }

    pub(super) fn lstm(
        &mut self,
        node: &'g NodeProto,
        given: &mut Attributes<'_>,
        x: Flow,
        weights: &[&str],
    ) -> Option<()> {
        let ([Axis::Frames(_) | Axis::One, Axis::Windows, Axis::Features(width)], [input, recurrent, bias, rest @ ..]) =
            (x.axes.as_slice(), weights)
        else {
            return None;
        };
        let both_ways = match given.text("direction", "forward")? {
            b"bidirectional" => true,
            b"forward" => false,
            _ => return None,
        };
        // Layer and first direction of the weights, and the stages of the outputs: all states, and the last state.
        let (layer, first, states, last) = match (x.what, both_ways) {
            (What::Activated, true) => (0, 0, Some(What::Lower), None),
            (What::Lower, true) => (1, 0, Some(What::Upper), None),
            (What::Lower, false) => (1, 0, None, Some(What::UpperForward)),
            (What::LowerLast, false) => (1, 1, None, Some(What::UpperBackward)),
            _ => return None,
        };
        let directions = if both_ways { 2 } else { 1 };
        let (dims, recurrent) = self.weights(recurrent)?;
        let [_, _, hidden] = *dims.as_slice() else { return None };
        let gates = hidden.checked_mul(4)?;
        let input = self.shaped(input, &[directions, gates, *width])?;
        let bias = self.shaped(bias, &[directions, 2 * gates])?;
        let is_plain = dims == [directions, gates, hidden]
            && given.int("hidden_size", 0)? == hidden as i64
            && given.is("layout", 0)
            && given.is("input_forget", 0);
        let start = [Size::Known(directions as i64), Size::Windows, Size::Known(hidden as i64)];
        let from_zero =
            |name: &&str| name.is_empty() || matches!(self.value(name), Some(Value::Zeros(shape)) if shape == start);
        let starts_plain = match rest {
            [] => true,
            ["", states @ ..] => states.len() <= 2 && states.iter().all(from_zero),
            _ => false,
        };
        (is_plain && starts_plain).then_some(())?;
        for direction in 0..directions {
            let part = |values: &[f32]| {
                let n = values.len() / directions;
                values[direction * n..(direction + 1) * n].to_vec()
            };
            let both = part(&bias);
            let bias = both[..gates].iter().zip(&both[gates..]).map(|(input, recurrent)| input + recurrent).collect();
            let cells = Cells { hidden, input: part(&input), recurrent: part(&recurrent), bias };
            keep(&mut self.found.pose.lstm[layer][first + direction], cells)?;
        }
        let (frames, hidden) = (x.axes[0], Axis::Hidden(hidden));
        if let Some(what) = states {
            let axes = [frames, Axis::Directions, Axis::Windows, hidden];
            self.give(node, 0, Value::Flow(Flow::new(what, &axes)))?;
        }
        if let Some(what) = last {
            self.give(node, 1, Value::Flow(Flow::new(what, &[Axis::One, Axis::Windows, hidden])))?;
        }
        Some(())
    }
}

/// Stores a weight. `None` if it was stored before.
fn keep<T>(place: &mut Option<T>, found: T) -> Option<()> {
    place.is_none().then(|| *place = Some(found))
}

/// The flow at stage `to`, if it is at stage `from`.
pub(super) fn next(x: Flow, from: What, to: What) -> Option<Flow> {
    (x.what == from).then_some(Flow { what: to, ..x })
}

/// Index of the convolution that follows a stage.
fn layer_behind(what: What) -> Option<usize> {
    match what {
        What::Tactile => Some(0),
        What::Rectified(layer) => Some(layer + 1),
        _ => None,
    }
}

pub(super) fn rectified(x: Flow) -> Option<Flow> {
    let what = match x.what {
        What::Convolved(layer) => What::Rectified(layer),
        What::Hidden(side) => What::HiddenRectified(side),
        _ => return None,
    };
    x.becomes(what)
}

/// Maximum over these axes, which must include all frames. Each then has length one.
fn highest(mut x: Flow, over: &[usize]) -> Option<Flow> {
    let mut frames = 0;
    for &at in over {
        match std::mem::replace(x.axes.get_mut(at)?, Axis::One) {
            Axis::Frames(_) => frames += 1,
            Axis::One => {}
            _ => return None,
        }
    }
    next(x, What::Rectified(DILATIONS.len() - 1), What::Touch).filter(|_| frames == 1)
}
