//! Checks the tensors of a model file: stored in this file, complete, and finite.

use std::path::Path;

use super::error::{ModelError, one_line};
use super::onnx::{EXTERNAL, GraphProto, ModelProto, NodeProto, TensorProto, data_type};

/// Maximum number of nodes in a model, with those of subgraphs and functions. The largest networks that run at the rate
/// of a glove have a few hundred. With 100,000, runtimes take minutes or overflow their stack.
const MAX_NODES: usize = 10_000;

/// Refuses a model with too many nodes, with tensors in other files or that don't fill their shapes, or with weights
/// that are NaN or infinite.
///
/// A tensor with a single infinite element is accepted, because exporters write the bounds of `Clip` and masks this
/// way. If it reaches the force, the trial runs find it.
///
/// # Errors
/// [`ModelError::TooManyNodes`], [`ModelError::ExternalData`], [`ModelError::Malformed`], [`ModelError::NonFiniteWeight`].
pub(super) fn check(path: &Path, model: &ModelProto) -> Result<(), ModelError> {
    let n_nodes = model.graph.iter().map(|graph| count(&graph.node)).sum::<usize>()
        + model.functions.iter().map(|function| count(&function.node)).sum::<usize>();
    if n_nodes > MAX_NODES {
        return Err(ModelError::TooManyNodes { path: path.to_path_buf(), n_nodes, most: MAX_NODES });
    }
    if let Some(graph) = &model.graph {
        check_graph(path, graph)?;
    }
    model.functions.iter().try_for_each(|function| check_nodes(path, &function.node))
}

/// Number of nodes, with those of subgraphs.
fn count(nodes: &[NodeProto]) -> usize {
    let within = nodes.iter().flat_map(|node| &node.attribute);
    nodes.len() + within.flat_map(|one| one.g.iter().chain(&one.graphs)).map(|graph| count(&graph.node)).sum::<usize>()
}

// The recursion is bounded: the decoder refuses messages that are nested more than 100 deep.
fn check_graph(path: &Path, graph: &GraphProto) -> Result<(), ModelError> {
    for tensor in &graph.initializer {
        check_tensor(path, tensor, &tensor.name)?;
    }
    for tensor in graph.sparse_initializer.iter().filter_map(|sparse| sparse.values.as_ref()) {
        check_tensor(path, tensor, &tensor.name)?;
    }
    check_nodes(path, &graph.node)
}

fn check_nodes(path: &Path, nodes: &[NodeProto]) -> Result<(), ModelError> {
    for node in nodes {
        // The tensor of a constant is mostly unnamed. Users see the name of its output.
        let fallback = node.output.first().unwrap_or(&node.name);
        for attribute in &node.attribute {
            let sparse = attribute.sparse_tensor.as_ref().and_then(|sparse| sparse.values.as_ref());
            for tensor in attribute.t.iter().chain(&attribute.tensors).chain(sparse) {
                let name = if tensor.name.is_empty() { fallback } else { &tensor.name };
                check_tensor(path, tensor, name)?;
            }
            for graph in attribute.g.iter().chain(&attribute.graphs) {
                check_graph(path, graph)?;
            }
        }
    }
    Ok(())
}

fn check_tensor(path: &Path, tensor: &TensorProto, name: &str) -> Result<(), ModelError> {
    let name = one_line(name);
    if tensor.data_location == EXTERNAL || !tensor.external_data.is_empty() {
        return Err(ModelError::ExternalData { path: path.to_path_buf(), tensor: name });
    }
    let malformed = |reason: String| ModelError::Malformed { path: path.to_path_buf(), reason };
    let Some(expected) = n_elements(&tensor.dims) else {
        return Err(malformed(format!(
            "tensor {name} has the impossible shape {}",
            one_line(&format!("{:?}", tensor.dims))
        )));
    };
    let Some(stored) = n_stored(tensor) else { return Ok(()) };
    if stored != expected as f64 {
        return Err(malformed(format!("tensor {name} of {expected} elements holds {stored}")));
    }
    if let Some((element, value)) = first_non_finite(tensor)
        && (value.is_nan() || expected > 1)
    {
        let path = path.to_path_buf();
        return Err(ModelError::NonFiniteWeight { path, tensor: name, element, value: value.to_string() });
    }
    Ok(())
}

fn n_elements(dims: &[i64]) -> Option<usize> {
    dims.iter().try_fold(1usize, |n, &dim| n.checked_mul(usize::try_from(dim).ok()?))
}

/// Number of stored elements, a fraction if the bytes are cut off. `None` for types that are not checked.
fn n_stored(tensor: &TensorProto) -> Option<f64> {
    let (width, typed) = match tensor.data_type {
        data_type::FLOAT => (4, tensor.float_data.len()),
        data_type::DOUBLE => (8, tensor.double_data.len()),
        data_type::FLOAT16 | data_type::BFLOAT16 => (2, tensor.int32_data.len()),
        data_type::INT32 => (4, tensor.int32_data.len()),
        data_type::INT64 => (8, tensor.int64_data.len()),
        _ => return None,
    };
    Some(match &tensor.raw_data {
        Some(raw) => raw.len() as f64 / f64::from(width),
        None => typed as f64,
    })
}

fn first_non_finite(tensor: &TensorProto) -> Option<(usize, f64)> {
    let raw = tensor.raw_data.as_deref();
    let values: Box<dyn Iterator<Item = f64> + '_> = match (tensor.data_type, raw) {
        (data_type::FLOAT, Some(raw)) => Box::new(chunks(raw).map(|bytes| f64::from(f32::from_le_bytes(bytes)))),
        (data_type::FLOAT, None) => Box::new(tensor.float_data.iter().map(|&value| f64::from(value))),
        (data_type::DOUBLE, Some(raw)) => Box::new(chunks(raw).map(f64::from_le_bytes)),
        (data_type::DOUBLE, None) => Box::new(tensor.double_data.iter().copied()),
        (data_type::FLOAT16, Some(raw)) => Box::new(chunks(raw).map(|bytes| half(u16::from_le_bytes(bytes), 0x7C00))),
        (data_type::FLOAT16, None) => Box::new(tensor.int32_data.iter().map(|&bits| half(bits as u16, 0x7C00))),
        (data_type::BFLOAT16, Some(raw)) => Box::new(chunks(raw).map(|bytes| half(u16::from_le_bytes(bytes), 0x7F80))),
        (data_type::BFLOAT16, None) => Box::new(tensor.int32_data.iter().map(|&bits| half(bits as u16, 0x7F80))),
        _ => return None,
    };
    values.enumerate().find(|(_, value)| !value.is_finite())
}

fn chunks<const WIDTH: usize>(raw: &[u8]) -> impl Iterator<Item = [u8; WIDTH]> {
    raw.as_chunks::<WIDTH>().0.iter().copied()
}

/// Classifies a 16-bit float: NaN and infinities stay, every finite number gives 0.
fn half(bits: u16, exponent: u16) -> f64 {
    let mantissa = 0x7FFF & !exponent;
    match (bits & exponent == exponent, bits & mantissa == 0, bits & 0x8000 == 0) {
        (false, _, _) => 0.0,
        (true, true, true) => f64::INFINITY,
        (true, true, false) => f64::NEG_INFINITY,
        (true, false, _) => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(tensor: TensorProto) -> Option<String> {
        let graph = GraphProto { initializer: vec![tensor], ..Default::default() };
        check(Path::new("m.onnx"), &ModelProto::with_graph(graph, 17)).err().map(|e| e.to_string())
    }

    #[test]
    fn a_nan_weight_is_named_in_every_float_type() {
        let bits = |data_type, raw: Vec<u8>| TensorProto {
            dims: vec![2],
            data_type,
            name: "w".into(),
            raw_data: Some(raw),
            ..Default::default()
        };
        let float64 = [0.5f64, f64::NAN].iter().flat_map(|v| v.to_le_bytes()).collect();
        for tensor in [
            TensorProto::float32("w", &[2], &[0.5, f32::NAN]),
            bits(data_type::DOUBLE, float64),
            bits(data_type::FLOAT16, vec![0x00, 0x3C, 0x01, 0x7E]),
            bits(data_type::BFLOAT16, vec![0x80, 0x3F, 0xC0, 0x7F]),
            TensorProto {
                dims: vec![2],
                data_type: data_type::FLOAT,
                name: "w".into(),
                float_data: vec![0.5, f32::NAN],
                ..Default::default()
            },
        ] {
            assert_eq!(
                refusal(tensor).as_deref(),
                Some(
                    "m.onnx: tensor w holds NaN at element 1, expected finite weights; train or export the model again"
                )
            );
        }
    }

    #[test]
    fn a_lone_infinite_constant_is_a_bound_but_an_infinite_weight_is_refused() {
        assert_eq!(refusal(TensorProto::float32("clip_max", &[], &[f32::INFINITY])), None);
        let refused = refusal(TensorProto::float32("w", &[3], &[1.0, 2.0, f32::NEG_INFINITY])).unwrap();
        assert!(refused.contains("tensor w holds -inf at element 2"), "{refused}");
    }

    #[test]
    fn a_tensor_that_does_not_fill_its_shape_is_refused() {
        let refused = refusal(TensorProto::float32("w", &[4], &[1.0, 2.0])).unwrap();
        assert_eq!(refused, "m.onnx: not a whole ONNX model: tensor w of 4 elements holds 2; export it again");
        assert!(refusal(TensorProto::float32("w", &[-1], &[])).unwrap().contains("impossible shape [-1]"));
        assert!(refusal(TensorProto::float32("w", &[i64::MAX, i64::MAX], &[])).unwrap().contains("impossible shape"));
    }

    #[test]
    fn values_in_another_file_are_refused_even_inside_of_a_node() {
        let tensor = TensorProto { data_location: EXTERNAL, ..TensorProto::float32("", &[1], &[1.0]) };
        let node = NodeProto::standard(
            "Constant",
            &[],
            &["bias"],
            vec![super::super::onnx::AttributeProto::tensor("value", tensor)],
        );
        let model = ModelProto::with_graph(GraphProto { node: vec![node], ..Default::default() }, 17);
        let refused = check(Path::new("m.onnx"), &model).unwrap_err().to_string();
        assert_eq!(refused, "m.onnx: tensor bias keeps its values in another file; export the model into one file");
    }
}
