//! Reads a whole message as a tree of values, for display. Samples are decoded with [`FieldPlan`](super::FieldPlan)
//! instead.

use super::numbers;
use super::skip::Len;
use crate::msg::cdr::{CdrError, CdrReader};
use crate::msg::definition::{BaseType, MessageDefinition, Primitive, TypeTree};

/// A value of a message. The names of its fields are borrowed from the type.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'t> {
    /// A boolean.
    Bool(bool),
    /// A signed integer.
    Int(i64),
    /// An unsigned integer, byte or char.
    Unsigned(u64),
    /// A floating-point number. Single precision is converted to double.
    Float(f64),
    /// A string; bytes that are not UTF-8 are replaced by U+FFFD.
    Text(String),
    /// Elements of an array.
    Array(Vec<Value<'t>>),
    /// Fields of a message, in wire order.
    Message(Vec<(&'t str, Value<'t>)>),
}

impl<'t> Value<'t> {
    /// The field `name`, if this is a message with such a field.
    pub fn field(&self, name: &str) -> Option<&Value<'t>> {
        match self {
            Value::Message(fields) => fields.iter().find(|(field, _)| *field == name).map(|(_, value)| value),
            _ => None,
        }
    }

    /// The elements, if this is an array.
    pub fn elements(&self) -> Option<&[Value<'t>]> {
        match self {
            Value::Array(elements) => Some(elements),
            _ => None,
        }
    }
}

/// Reads a whole message. Also returns the number of bytes after its last field: up to 3 are padding, more mean that
/// the message was not written with this definition.
///
/// # Errors
/// [`CdrError`] if the bytes end early or are not plain CDR, or if there is a wide string.
pub fn read_value<'t>(tree: &'t TypeTree, cdr: &[u8]) -> Result<(Value<'t>, usize), CdrError> {
    let mut reader = CdrReader::new(cdr)?;
    let root = tree.root();
    if root.fields.is_empty() && reader.left() == 0 {
        return Ok((Value::Message(vec![]), 0)); // some senders omit the byte that stands for an empty message
    }
    let value = message(tree, root, &mut reader)?;
    Ok((value, reader.left()))
}

fn message<'t>(
    tree: &'t TypeTree,
    message: &'t MessageDefinition,
    reader: &mut CdrReader<'_>,
) -> Result<Value<'t>, CdrError> {
    if message.fields.is_empty() {
        reader.skip(1)?; // the member that IDL adds to an empty struct
    }
    let fields: Result<Vec<_>, CdrError> = message
        .fields
        .iter()
        .map(|field| {
            let value = match Len::of(field.ty.arity) {
                None => element(tree, &field.ty.base, reader)?,
                Some(len) => {
                    // Elements are added one by one, so that a wrong length reserves no memory.
                    let mut elements = vec![];
                    for _ in 0..len.read(reader)? {
                        elements.push(element(tree, &field.ty.base, reader)?);
                    }
                    Value::Array(elements)
                }
            };
            Ok((field.name.as_str(), value))
        })
        .collect();
    fields.map(Value::Message)
}

fn element<'t>(tree: &'t TypeTree, base: &'t BaseType, reader: &mut CdrReader<'_>) -> Result<Value<'t>, CdrError> {
    match base {
        BaseType::Primitive(primitive) => {
            let bytes = reader.primitives(*primitive, 1)?;
            Ok(number(*primitive, bytes, reader.is_little_endian()))
        }
        BaseType::Text { .. } => reader.text().map(|text| Value::Text(String::from_utf8_lossy(text).into_owned())),
        BaseType::WideText { .. } => Err(CdrError::WideText),
        BaseType::Message(name) => message(tree, tree.message(name), reader),
    }
}

fn number(primitive: Primitive, bytes: &[u8], little_endian: bool) -> Value<'static> {
    let signed = || numbers::signed(primitive, bytes, little_endian);
    match primitive {
        Primitive::Bool => Value::Bool(signed() != 0),
        Primitive::Int8 | Primitive::Int16 | Primitive::Int32 | Primitive::Int64 => Value::Int(signed()),
        Primitive::Float32 | Primitive::Float64 => Value::Float(numbers::first(primitive, bytes, little_endian)),
        _ => Value::Unsigned(signed().cast_unsigned()),
    }
}
