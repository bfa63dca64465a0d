//! Operators that change no value of a tensor: reshaping, slicing, and arithmetic on sizes.

use super::super::attributes::Attributes;
use super::super::flow::{Axis, Flow, Side, Size, Sizes, Value, What, place};
use super::Walk;
use crate::model::onnx::{TensorProto, data_type};

impl<'g> Walk<'g> {
    pub(super) fn concat(&self, names: &[&str], given: &mut Attributes<'_>) -> Option<Value<'g>> {
        let axis = given.int("axis", i64::MIN)?;
        if let Some(sizes) = names.iter().map(|name| self.sizes(name)).collect::<Option<Vec<_>>>() {
            (place(axis, 1)? == 0 && sizes.iter().all(|part| !part.is_scalar)).then_some(())?;
            return Sizes::list(sizes.iter().flat_map(Sizes::values).copied().collect()).map(Value::Sizes);
        }
        let flows = names.iter().map(|name| self.flow(name)).collect::<Option<Vec<_>>>()?;
        let first = flows.first()?.clone();
        let same = flows.iter().all(|flow| flow.axes == first.axes);
        (same && first.at(axis)? + 1 == first.axes.len()).then_some(())?;
        let stages: Vec<What> = flows.iter().map(|flow| flow.what).collect();
        let (last, mut axes) = (*first.axes.last()?, first.axes);
        let what = match stages.as_slice() {
            [What::Sine, What::Cosine] => What::Encoded,
            [What::UpperForward, What::UpperBackward] => What::Posed,
            [What::Touch, What::Posed] => What::Fused(Side::Both),
            [What::Touch, What::Posed, What::Product] => What::Fused(Side::WithProduct),
            _ => return None,
        };
        let (Axis::Features(width) | Axis::Hidden(width)) = last else { return None };
        axes.pop();
        axes.push(Axis::Features(stages.len() * width));
        Some(Value::Flow(Flow { what, axes }))
    }

    pub(super) fn gather(&self, x: &str, at: &str, given: &mut Attributes<'_>) -> Option<Value<'g>> {
        let (axis, at) = (given.int("axis", 0)?, self.sizes(at)?);
        let [idx] = *at.constants()?.as_slice() else { return None };
        match self.value(x)? {
            Value::Sizes(sizes) if !sizes.is_scalar && axis == 0 => {
                let size = sizes.values()[place(idx, sizes.values().len())?];
                let picked = if at.is_scalar { Sizes::single(size) } else { Sizes::list(vec![size])? };
                Some(Value::Sizes(picked))
            }
            Value::Flow(flow) => {
                let axis = flow.at(axis)?;
                let last = self.last_frame(flow, axis, idx)?;
                if at.is_scalar { last.squeezed(&[axis as i64]).map(Value::Flow) } else { Some(Value::Flow(last)) }
            }
            _ => None,
        }
    }

    pub(super) fn slice(&self, x: &str, bounds: &[&str]) -> Option<Value<'g>> {
        let ([start, end, ..], true) = (bounds, bounds.len() <= 4) else { return None };
        let one = |name: &str| match *self.numbers(name)?.as_slice() {
            [number] => Some(number),
            _ => None,
        };
        let optional = |idx: usize, default: i64| match bounds.get(idx) {
            None | Some(&"") => Some(default),
            Some(name) => one(name),
        };
        let (start, end, axis, step) = (one(start)?, one(end)?, optional(2, 0)?, optional(3, 1)?);
        (step == 1).then_some(())?;
        match self.value(x)? {
            Value::Sizes(sizes) if !sizes.is_scalar && place(axis, 1)? == 0 => {
                let (from, to) = within(start, end, sizes.values().len())?;
                Sizes::list(sizes.values().get(from..to)?.to_vec()).map(Value::Sizes)
            }
            Value::Zeros(mut shape) => {
                let at = place(axis, shape.len())?;
                let Size::Known(len) = shape[at] else { return None };
                let (from, to) = within(start, end, usize::try_from(len).ok()?)?;
                shape[at] = Size::Known(i64::try_from(to - from).ok()?);
                Some(Value::Zeros(shape))
            }
            Value::Flow(flow) => {
                let (from, to) = within(start, end, self.window)?;
                let axis = flow.at(axis)?;
                (to == from + 1).then_some(())?;
                self.last_frame(flow, axis, from as i64).map(Value::Flow)
            }
            _ => None,
        }
    }

    /// Last frame of the states. Its axis gets length one.
    fn last_frame(&self, flow: Flow, axis: usize, idx: i64) -> Option<Flow> {
        let what = match flow.what {
            What::Lower => What::LowerLast,
            What::Upper => What::Posed,
            _ => return None,
        };
        let is_last = place(idx, self.window)? + 1 == self.window;
        let mut axes = flow.axes;
        let axis = axes.get_mut(axis).filter(|axis| matches!(axis, Axis::Frames(_)) && is_last)?;
        *axis = Axis::One;
        Some(Flow { what, axes })
    }

    pub(super) fn squeeze(&self, x: &str, axes: &[i64]) -> Option<Value<'g>> {
        match self.value(x)? {
            Value::Flow(flow) => flow.squeezed(axes).map(Value::Flow),
            Value::Sizes(sizes) if !sizes.is_scalar => match (sizes.values(), axes) {
                ([size], [0 | -1]) => Some(Value::Sizes(Sizes::single(*size))),
                _ => None,
            },
            _ => None,
        }
    }

    pub(super) fn unsqueeze(&self, x: &str, axes: &[i64]) -> Option<Value<'g>> {
        match self.value(x)? {
            Value::Flow(flow) => flow.unsqueezed(axes).map(Value::Flow),
            Value::Sizes(sizes) if sizes.is_scalar && matches!(axes, [0 | -1]) => {
                Sizes::list(sizes.values().to_vec()).map(Value::Sizes)
            }
            _ => None,
        }
    }

    pub(super) fn reshape(&self, x: &str, target: &str, given: &mut Attributes<'_>) -> Option<Value<'g>> {
        let zero_keeps = given.int("allowzero", 0)? == 0;
        let target = self.sizes(target).filter(|target| !target.is_scalar)?;
        match self.value(x)? {
            Value::Flow(flow) => flow.reshaped(target.values(), zero_keeps).map(Value::Flow),
            Value::Sizes(sizes) if target.values() == [Size::Known(-1)] => {
                Sizes::list(sizes.values().to_vec()).map(Value::Sizes)
            }
            _ => None,
        }
    }

    pub(super) fn zeros_of_shape(&self, shape: &str, given: &mut Attributes<'g>) -> Option<Value<'g>> {
        let value = given.tensor("value")?;
        let is_zero = value.data_type == data_type::FLOAT && value.dims == [1] && is_zero(value);
        let shape = self.sizes(shape).filter(|shape| !shape.is_scalar)?;
        is_zero.then(|| Value::Zeros(shape.values().to_vec()))
    }

    pub(super) fn expanded_zeros(&self, x: &str, shape: &str) -> Option<Value<'g>> {
        let Value::Weights(value) = self.value(x)? else { return None };
        let shape = self.sizes(shape).filter(|shape| !shape.is_scalar)?;
        (value.dims.is_empty() && is_zero(value)).then(|| Value::Zeros(shape.values().to_vec()))
    }
}

/// True if a float tensor is a single zero.
fn is_zero(tensor: &TensorProto) -> bool {
    match &tensor.raw_data {
        Some(raw) => raw.as_slice() == [0; 4],
        None => tensor.float_data == [0.0],
    }
}

pub(super) fn flatten(x: Flow, given: &mut Attributes<'_>) -> Option<Flow> {
    let axis = given.int("axis", 1)?;
    (axis == 1 && x.axes.first() == Some(&Axis::Windows)).then_some(())?;
    x.reshaped(&[Size::Windows, Size::Known(-1)], false)
}

/// The sizes of a tensor, from axis `start` to `end`.
pub(super) fn shape<'g>(x: &Flow, given: &mut Attributes<'_>) -> Option<Value<'g>> {
    let sizes = x.sizes();
    let (start, end) = (given.int("start", 0)?, given.int("end", i64::MAX)?);
    let (from, to) = within(start, end, sizes.len())?;
    Sizes::list(sizes[from..to].to_vec()).map(Value::Sizes)
}

/// Bounds of a slice in a list of this length. `None` if the slice is empty.
fn within(start: i64, end: i64, len: usize) -> Option<(usize, usize)> {
    let n = i64::try_from(len).ok()?;
    let bound = |at: i64| usize::try_from(if at < 0 { at.saturating_add(n) } else { at }.clamp(0, n)).ok();
    let (from, to) = (bound(start)?, bound(end)?);
    (from < to).then_some((from, to))
}
