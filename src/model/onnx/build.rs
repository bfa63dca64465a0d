//! Short constructors of ONNX messages.

use super::{
    AttributeProto, DimensionProto, DimensionValue, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    StringStringEntryProto, TensorProto, TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto, data_type,
};

impl ModelProto {
    /// A model with one graph over version `opset` of the standard operators, at IR version 8, which every runtime
    /// loads.
    pub fn with_graph(graph: GraphProto, opset: i64) -> Self {
        ModelProto {
            ir_version: 8,
            producer_name: env!("CARGO_PKG_NAME").to_string(),
            producer_version: env!("CARGO_PKG_VERSION").to_string(),
            graph: Some(graph),
            opset_import: vec![OperatorSetIdProto { domain: String::new(), version: opset }],
            ..Default::default()
        }
    }

    /// Appends an entry to `metadata_props`.
    pub fn push_metadata(&mut self, key: &str, value: &str) {
        self.metadata_props.push(StringStringEntryProto { key: key.to_string(), value: value.to_string() });
    }
}

impl NodeProto {
    /// A node with a standard operator, named after its first output.
    pub fn standard(op_type: &str, inputs: &[&str], outputs: &[&str], attributes: Vec<AttributeProto>) -> Self {
        NodeProto {
            input: inputs.iter().map(ToString::to_string).collect(),
            output: outputs.iter().map(ToString::to_string).collect(),
            name: format!("{op_type}_{}", outputs.first().copied().unwrap_or_default()),
            op_type: op_type.to_string(),
            attribute: attributes,
            domain: String::new(),
        }
    }
}

impl AttributeProto {
    /// A float attribute.
    pub fn float(name: &str, value: f32) -> Self {
        AttributeProto { name: name.to_string(), f: Some(value), r#type: 1, ..Default::default() }
    }

    /// An integer attribute.
    pub fn int(name: &str, value: i64) -> Self {
        AttributeProto { name: name.to_string(), i: Some(value), r#type: 2, ..Default::default() }
    }

    /// A string attribute.
    pub fn string(name: &str, value: &str) -> Self {
        AttributeProto { name: name.to_string(), s: Some(value.as_bytes().to_vec()), r#type: 3, ..Default::default() }
    }

    /// A tensor attribute.
    pub fn tensor(name: &str, value: TensorProto) -> Self {
        AttributeProto { name: name.to_string(), t: Some(value), r#type: 4, ..Default::default() }
    }

    /// An integer list attribute.
    pub fn ints(name: &str, values: &[i64]) -> Self {
        AttributeProto { name: name.to_string(), ints: values.to_vec(), r#type: 7, ..Default::default() }
    }
}

impl TensorProto {
    /// A float32 tensor, row-major. The caller guarantees that the number of `values` fits `dims`.
    pub fn float32(name: &str, dims: &[i64], values: &[f32]) -> Self {
        TensorProto {
            dims: dims.to_vec(),
            data_type: data_type::FLOAT,
            name: name.to_string(),
            raw_data: Some(values.iter().flat_map(|value| value.to_le_bytes()).collect()),
            ..Default::default()
        }
    }

    /// An int64 tensor, row-major. The caller guarantees that the number of `values` fits `dims`.
    pub fn int64(name: &str, dims: &[i64], values: &[i64]) -> Self {
        TensorProto {
            dims: dims.to_vec(),
            data_type: data_type::INT64,
            name: name.to_string(),
            raw_data: Some(values.iter().flat_map(|value| value.to_le_bytes()).collect()),
            ..Default::default()
        }
    }
}

impl ValueInfoProto {
    /// An input or output of a graph.
    pub fn tensor(name: &str, elem_type: i32, dims: Vec<DimensionProto>) -> Self {
        let tensor_type = TensorTypeProto { elem_type, shape: Some(TensorShapeProto { dim: dims }) };
        ValueInfoProto { name: name.to_string(), r#type: Some(TypeProto { tensor_type: Some(tensor_type) }) }
    }

    /// A float32 input or output of a graph.
    pub fn float32(name: &str, dims: Vec<DimensionProto>) -> Self {
        Self::tensor(name, data_type::FLOAT, dims)
    }
}

impl DimensionProto {
    /// A dimension of known size.
    pub fn fixed(size: i64) -> Self {
        DimensionProto { value: Some(DimensionValue::DimValue(size)) }
    }

    /// A dimension whose size is known at run time.
    pub fn named(name: &str) -> Self {
        DimensionProto { value: Some(DimensionValue::DimParam(name.to_string())) }
    }
}
