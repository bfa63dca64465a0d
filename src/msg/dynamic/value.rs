//! A whole message as a tree of values: for looking at, not for the path of samples.

use super::numbers;
use super::skip::Len;
use crate::msg::cdr::{CdrError, CdrReader};
use crate::msg::definition::{BaseType, MessageDefinition, Primitive, TypeTree};

/// A value of a message, with the names of its fields borrowed from the type.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'t> {
    /// A truth value.
    Bool(bool),
    /// A signed whole number.
    Int(i64),
    /// An unsigned whole number, byte or char.
    Unsigned(u64),
    /// A floating-point number; single precision widened.
    Float(f64),
    /// A string; bytes that are not UTF-8 are replaced by U+FFFD.
    Text(String),
    /// Elements of an array.
    Array(Vec<Value<'t>>),
    /// Fields of a message, in wire order.
    Message(Vec<(&'t str, Value<'t>)>),
}

impl<'t> Value<'t> {
    /// The field `name`, when this is a message that has it.
    pub fn field(&self, name: &str) -> Option<&Value<'t>> {
        match self {
            Value::Message(fields) => fields.iter().find(|(field, _)| *field == name).map(|(_, value)| value),
            _ => None,
        }
    }

    /// The elements, when this is an array.
    pub fn elements(&self) -> Option<&[Value<'t>]> {
        match self {
            Value::Array(elements) => Some(elements),
            _ => None,
        }
    }
}

/// All of a message, and how many bytes were left behind its last field: up to 3 are padding, more mean that the
/// definition is not the one that it was written by.
///
/// # Errors
/// [`CdrError`] when the bytes end early or are no plain CDR, or when there is a wide string in it.
pub fn read_value<'t>(tree: &'t TypeTree, cdr: &[u8]) -> Result<(Value<'t>, usize), CdrError> {
    let mut reader = CdrReader::new(cdr)?;
    let root = tree.root();
    if root.fields.is_empty() && reader.left() == 0 {
        return Ok((Value::Message(vec![]), 0)); // some senders leave out the made-up byte of an empty message
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
        reader.skip(1)?; // the member that IDL makes up for an empty struct
    }
    let fields: Result<Vec<_>, CdrError> = message
        .fields
        .iter()
        .map(|field| {
            let value = match Len::of(field.ty.arity) {
                None => element(tree, &field.ty.base, reader)?,
                Some(len) => {
                    // Grown one by one, so that a length that lies reserves nothing.
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
