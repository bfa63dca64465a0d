//! Meaning of a tensor and of its axes in the paper's network.

use crate::model::onnx::TensorProto;

/// Longest list of sizes or axes that is followed. The network needs at most four.
const MAX_RANK: usize = 8;

/// Value of a tensor of the graph.
#[derive(Debug, Clone)]
pub(super) enum Value<'g> {
    /// Weights, or any other float constant.
    Weights(&'g TensorProto),
    /// Integers: constants, and sizes of tensors.
    Sizes(Sizes),
    /// Zeros of this shape: the initial state of an LSTM.
    Zeros(Vec<Size>),
    /// A tensor that depends on the inputs.
    Flow(Flow),
}

/// Length of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Size {
    /// The number of windows, which is not fixed.
    Windows,
    Known(i64),
}

/// A list of integers, or a single integer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::model) struct Sizes {
    pub(super) is_scalar: bool,
    values: Vec<Size>,
}

/// A tensor that depends on the inputs: its stage and its axes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Flow {
    pub(super) what: What,
    pub(super) axes: Vec<Axis>,
}

/// An axis of a tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    /// Axis of length one without meaning.
    One,
    Windows,
    Frames(usize),
    /// Taxels, joints, or features of the network.
    Features(usize),
    /// Directions of the LSTM: forward, backward.
    Directions,
    /// State of one direction.
    Hidden(usize),
}

/// Stage of the network that a tensor is the output of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Tactile,
    /// Output of the convolution with this index.
    Convolved(usize),
    /// Output of the ReLU after that convolution.
    Rectified(usize),
    /// Output of the tactile branch.
    Touch,
    Pose,
    Sine,
    Cosine,
    /// Sines, then cosines.
    Encoded,
    Normed,
    /// Product with the weight of the embedding.
    Multiplied,
    /// Sum with the bias of the embedding.
    Embedded,
    Gelu(Gelu),
    /// Output of the GELU.
    Activated,
    /// States of the first LSTM layer.
    Lower,
    /// State of the first LSTM layer at the last frame.
    LowerLast,
    /// States of the second LSTM layer.
    Upper,
    /// Last state of its forward direction.
    UpperForward,
    /// First state of its backward direction, which belongs to the last frame.
    UpperBackward,
    /// Output of the pose branch.
    Posed,
    /// Product of touch and pose.
    Product,
    /// Input of a decoder.
    Fused(Side),
    /// Output of a decoder's first layer.
    Hidden(Side),
    HiddenRectified(Side),
    /// Output of a decoder's second layer.
    Force(Side),
    /// Base force minus residual.
    Difference,
}

/// Intermediate result of x / 2 * (1 + erf(x / sqrt 2)).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Gelu {
    /// x / sqrt 2
    Scaled,
    Erf,
    /// 1 + erf
    Gate,
    /// x / 2
    Half,
    /// (1 + erf) / 2
    HalfGate,
    /// x * (1 + erf)
    Gated,
}

/// Input of a decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::model::paper) enum Side {
    Touch,
    /// Touch and pose.
    Both,
    /// Touch, pose and their product.
    WithProduct,
}

impl Axis {
    pub(super) fn size(self) -> Size {
        match self {
            Axis::One => Size::Known(1),
            Axis::Windows => Size::Windows,
            Axis::Frames(n) | Axis::Features(n) | Axis::Hidden(n) => known(n),
            Axis::Directions => Size::Known(2),
        }
    }
}

fn known(n: usize) -> Size {
    Size::Known(i64::try_from(n).unwrap_or(i64::MAX))
}

impl Sizes {
    pub(super) fn list(values: Vec<Size>) -> Option<Self> {
        (values.len() <= MAX_RANK).then_some(Sizes { is_scalar: false, values })
    }

    pub(super) fn single(value: Size) -> Self {
        Sizes { is_scalar: true, values: vec![value] }
    }

    /// Values of an int64 tensor.
    pub(in crate::model) fn of(tensor: &TensorProto) -> Option<Self> {
        if tensor.dims.len() > 1 {
            return None;
        }
        let values: Vec<i64> = match &tensor.raw_data {
            Some(raw) if raw.len() <= 8 * MAX_RANK => {
                raw.as_chunks::<8>().0.iter().map(|bytes| i64::from_le_bytes(*bytes)).collect()
            }
            Some(_) => return None,
            None => tensor.int64_data.iter().take(MAX_RANK + 1).copied().collect(),
        };
        let mut sizes = Sizes::list(values.into_iter().map(Size::Known).collect())?;
        sizes.is_scalar = tensor.dims.is_empty();
        (!sizes.is_scalar || sizes.values.len() == 1).then_some(sizes)
    }

    pub(super) fn values(&self) -> &[Size] {
        &self.values
    }

    /// The values, if all are known.
    pub(in crate::model) fn constants(&self) -> Option<Vec<i64>> {
        let constant = |size: &Size| match size {
            Size::Known(value) => Some(*value),
            Size::Windows => None,
        };
        self.values.iter().map(constant).collect()
    }

    /// Elementwise product.
    pub(super) fn times(&self, other: &Sizes) -> Option<Sizes> {
        let product = |pair: (&Size, &Size)| match pair {
            (Size::Known(a), Size::Known(b)) => a.checked_mul(*b).map(Size::Known),
            (Size::Windows, Size::Known(1)) | (Size::Known(1), Size::Windows) => Some(Size::Windows),
            _ => None,
        };
        if self.values.len() != other.values.len() || self.is_scalar != other.is_scalar {
            return None;
        }
        let values = self.values.iter().zip(&other.values).map(product).collect::<Option<_>>()?;
        Some(Sizes { is_scalar: self.is_scalar, values })
    }
}

impl Flow {
    pub(super) fn new(what: What, axes: &[Axis]) -> Self {
        Flow { what, axes: axes.to_vec() }
    }

    /// The same tensor at another stage.
    pub(super) fn becomes(self, what: What) -> Option<Self> {
        Some(Flow { what, ..self })
    }

    pub(super) fn sizes(&self) -> Vec<Size> {
        self.axes.iter().map(|axis| axis.size()).collect()
    }

    /// Position of an axis. A negative index counts from the end.
    pub(super) fn at(&self, axis: i64) -> Option<usize> {
        place(axis, self.axes.len())
    }

    pub(super) fn transposed(self, order: &[i64]) -> Option<Self> {
        let mut taken = vec![false; self.axes.len()];
        let mut axes = Vec::new();
        for &from in order {
            let from = usize::try_from(from).ok().filter(|from| *from < taken.len())?;
            if std::mem::replace(&mut taken[from], true) {
                return None;
            }
            axes.push(self.axes[from]);
        }
        (axes.len() == taken.len()).then_some(Flow { axes, ..self })
    }

    pub(super) fn squeezed(mut self, gone: &[i64]) -> Option<Self> {
        let gone = places(gone, self.axes.len())?;
        for &at in gone.iter().rev() {
            if self.axes.remove(at) != Axis::One {
                return None;
            }
        }
        Some(self)
    }

    pub(super) fn unsqueezed(mut self, new: &[i64]) -> Option<Self> {
        let rank = self.axes.len() + new.len();
        for at in places(new, rank)? {
            self.axes.insert(at, Axis::One);
        }
        (rank <= MAX_RANK).then_some(self)
    }

    /// Reshapes the tensor. Axes of length one may appear and disappear, and both directions of a state may become one
    /// axis.
    pub(super) fn reshaped(self, target: &[Size], zero_keeps: bool) -> Option<Self> {
        let mut rest = self.axes.as_slice();
        let mut axes = Vec::new();
        for size in self.resolved(target, zero_keeps)? {
            axes.push(loop {
                match rest {
                    [Axis::Directions, Axis::Hidden(hidden), tail @ ..] if size == known(2 * hidden) => {
                        rest = tail;
                        break Axis::Features(2 * hidden);
                    }
                    [axis, tail @ ..] if axis.size() == size => {
                        rest = tail;
                        break *axis;
                    }
                    _ if size == Size::Known(1) => break Axis::One,
                    [Axis::One, tail @ ..] => rest = tail,
                    _ => return None,
                }
            });
        }
        let only_ones = rest.iter().all(|axis| *axis == Axis::One);
        only_ones.then_some(Flow { what: self.what, axes })
    }

    /// The target shape with all sizes known: 0 keeps a size, -1 stands for the remaining one.
    fn resolved(&self, target: &[Size], zero_keeps: bool) -> Option<Vec<Size>> {
        let mut sizes = Vec::new();
        let mut open = None;
        for (idx, size) in target.iter().enumerate() {
            sizes.push(match size {
                Size::Known(0) if zero_keeps => self.axes.get(idx)?.size(),
                Size::Known(-1) if open.is_none() => {
                    open = Some(idx);
                    Size::Known(1)
                }
                Size::Known(n) if *n < 1 => return None,
                size => *size,
            });
        }
        let ((windows, numbers), (of_windows, of_numbers)) = (count(&sizes)?, count(&self.sizes())?);
        match (open, of_windows.checked_sub(windows)?) {
            (None, 0) if numbers == of_numbers => {}
            (Some(idx), 0) if of_numbers % numbers == 0 => sizes[idx] = Size::Known(of_numbers / numbers),
            (Some(idx), 1) if of_numbers == numbers => sizes[idx] = Size::Windows,
            _ => return None,
        }
        Some(sizes)
    }
}

/// How often the number of windows occurs among the sizes, and the product of the others.
fn count(sizes: &[Size]) -> Option<(usize, i64)> {
    sizes.iter().try_fold((0, 1i64), |(windows, numbers), size| match size {
        Size::Windows => Some((windows + 1, numbers)),
        Size::Known(n) => Some((windows, numbers.checked_mul(*n)?)),
    })
}

/// Position of an axis. A negative index counts from the end.
pub(super) fn place(axis: i64, rank: usize) -> Option<usize> {
    let rank = i64::try_from(rank).ok()?;
    let axis = if axis < 0 { axis.checked_add(rank)? } else { axis };
    usize::try_from(axis).ok().filter(|_| axis < rank)
}

/// Positions of axes in rising order. `None` if one occurs twice.
fn places(axes: &[i64], rank: usize) -> Option<Vec<usize>> {
    let mut places = axes.iter().map(|axis| place(*axis, rank)).collect::<Option<Vec<_>>>()?;
    places.sort_unstable();
    places.is_sorted_by(|a, b| a < b).then_some(places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use Axis::{Directions, Features, Frames, Hidden, One, Windows};

    fn reshaped(axes: &[Axis], target: &[i64], zero_keeps: bool) -> Option<Vec<Axis>> {
        let target: Vec<Size> = target.iter().map(|n| Size::Known(*n)).collect();
        Flow::new(What::Upper, axes).reshaped(&target, zero_keeps).map(|flow| flow.axes)
    }

    #[test]
    fn a_reshape_is_followed_where_every_number_keeps_its_meaning() {
        let states = [Frames(20), Windows, Directions, Hidden(4)];
        let merged = Some(vec![Frames(20), Windows, Features(8)]);
        assert_eq!(reshaped(&states, &[0, 0, 8], true), merged);
        assert_eq!(reshaped(&states, &[20, -1, 8], true), merged);
        assert_eq!(reshaped(&states, &[0, 0, -1], true), merged);
        assert_eq!(reshaped(&[Windows, Features(8), One], &[-1, 8], true), Some(vec![Windows, Features(8)]));
        assert_eq!(
            reshaped(&[Windows, One, Features(8)], &[-1, 8, 1, 1], false),
            Some(vec![Windows, Features(8), One, One])
        );
    }

    #[test]
    fn any_other_reshape_is_not() {
        let states = [Frames(20), Windows, Directions, Hidden(4)];
        for target in [&[0, 0, 4][..], &[0, -1, 4], &[-1, 0, 8, 0], &[0, 0, 4, 2], &[0, 1, 8], &[-1, -1, 8], &[160, -1]]
        {
            assert_eq!(reshaped(&states, target, true), None, "{target:?}");
        }
        assert_eq!(reshaped(&states, &[0, 0, 8], false), None);
        // The same lengths in another order would reorder the values.
        assert_eq!(reshaped(&[Windows, Frames(20), Features(8)], &[-1, 8, 20], true), None);
        assert_eq!(reshaped(&[Frames(20), Directions, Windows, Hidden(4)], &[20, -1, 8], true), None);
    }

    #[test]
    fn only_axes_of_length_one_are_squeezed() {
        let flow = Flow::new(What::Touch, &[Windows, Features(8), One]);
        assert_eq!(flow.clone().squeezed(&[-1]).map(|flow| flow.axes), Some(vec![Windows, Features(8)]));
        assert_eq!(flow.clone().squeezed(&[0]), None);
        assert_eq!(flow.clone().squeezed(&[2, -1]), None);
        assert_eq!(flow.unsqueezed(&[1, -1]).map(|flow| flow.axes), Some(vec![Windows, One, Features(8), One, One]));
    }
}
