//! Slices to tensors of the flex backend, and back.

use burn::backend::flex::FlexTensor;
use burn::tensor::{Tensor, TensorData};

/// The reason why a tensor is on `Autodiff<Flex>`.
pub(super) const ON_FLEX: &str = "every tensor of the network is made on the flex device with autodiff";

/// A tensor of the backend itself.
pub(super) fn primitive(values: Vec<f32>, dims: &[usize]) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, dims))
}

/// The values of a tensor of the backend itself, row-major.
pub(super) fn primitive_values(tensor: FlexTensor) -> Vec<f32> {
    floats(tensor.into_data())
}

/// A tensor's values, row-major.
pub(in crate::train) fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    floats(tensor.into_data())
}

fn floats(data: TensorData) -> Vec<f32> {
    data.try_into_vec().expect("every tensor of the network holds float32")
}
