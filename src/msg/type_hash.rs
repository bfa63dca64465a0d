//! RIHS01 type hashes. From Jazzy on, ROS 2 compares them to check that two sides use the same type.

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::definition::{Arity, BaseType, FieldType, MessageDefinition, Primitive, TypeTree};

/// Hash of one of our types, or of a standard type that we use. `None` for any other type.
pub fn rihs01(type_name: &str) -> Option<String> {
    let text = super::definition_text(type_name)?;
    let tree = TypeTree::from_schema(type_name, &text).ok()?;
    Some(type_hash(&tree))
}

/// Hash of a type: `RIHS01_` and the SHA-256 of its description, in hexadecimal.
///
/// It depends on the names and types of the fields, not on comments, constants and defaults.
/// # Source
/// REP-2016, and the description that rosidl_generator_type_description writes.
pub fn type_hash(tree: &TypeTree) -> String {
    let description = TypeDescription {
        type_description: individual(tree.root()),
        referenced_type_descriptions: tree.dependencies().map(individual).collect(),
    };
    let digest = Sha256::digest(spaced_json(&description));
    digest.iter().fold("RIHS01_".to_owned(), |mut hash, byte| {
        hash.push_str(&format!("{byte:02x}"));
        hash
    })
}

#[derive(Serialize)]
struct TypeDescription<'a> {
    type_description: IndividualType<'a>,
    referenced_type_descriptions: Vec<IndividualType<'a>>,
}

#[derive(Serialize)]
struct IndividualType<'a> {
    type_name: &'a str,
    fields: Vec<Field<'a>>,
}

#[derive(Serialize)]
struct Field<'a> {
    name: &'a str,
    #[serde(rename = "type")]
    ty: FieldDescription<'a>,
}

#[derive(Serialize)]
struct FieldDescription<'a> {
    type_id: u8,
    capacity: u32,
    string_capacity: u32,
    nested_type_name: &'a str,
}

fn individual(definition: &MessageDefinition) -> IndividualType<'_> {
    let mut fields: Vec<Field<'_>> =
        definition.fields.iter().map(|field| Field { name: &field.name, ty: describe(&field.ty) }).collect();
    if fields.is_empty() {
        let ty = FieldDescription { type_id: 3, capacity: 0, string_capacity: 0, nested_type_name: "" };
        fields.push(Field { name: "structure_needs_at_least_one_member", ty });
    }
    IndividualType { type_name: &definition.type_name, fields }
}

/// Description of a field type, with the type ids of `type_description_interfaces/msg/FieldType`.
fn describe(ty: &FieldType) -> FieldDescription<'_> {
    let (element, string_capacity, nested_type_name) = match &ty.base {
        BaseType::Primitive(primitive) => (primitive_id(*primitive), 0, ""),
        BaseType::Text { bound: None } => (17, 0, ""),
        BaseType::WideText { bound: None } => (18, 0, ""),
        BaseType::Text { bound: Some(bound) } => (21, *bound, ""),
        BaseType::WideText { bound: Some(bound) } => (22, *bound, ""),
        BaseType::Message(name) => (1, 0, name.as_str()),
    };
    let (array, capacity) = match ty.arity {
        Arity::One => (0, 0),
        Arity::Fixed(n) => (48, n),
        Arity::Bounded(n) => (96, n),
        Arity::Unbounded => (144, 0),
    };
    FieldDescription { type_id: element + array, capacity, string_capacity, nested_type_name }
}

fn primitive_id(primitive: Primitive) -> u8 {
    match primitive {
        Primitive::Int8 => 2,
        // rosidl turns char into uint8 before it describes the type, so 13 (char) never occurs.
        Primitive::UInt8 | Primitive::Char => 3,
        Primitive::Int16 => 4,
        Primitive::UInt16 => 5,
        Primitive::Int32 => 6,
        Primitive::UInt32 => 7,
        Primitive::Int64 => 8,
        Primitive::UInt64 => 9,
        Primitive::Float32 => 10,
        Primitive::Float64 => 11,
        Primitive::Bool => 15,
        Primitive::Byte => 16,
    }
}

/// JSON with a space after each comma and colon, because the hash is defined on this form.
fn spaced_json(description: &TypeDescription<'_>) -> Vec<u8> {
    struct Spaced;
    impl serde_json::ser::Formatter for Spaced {
        fn begin_array_value<W: ?Sized + std::io::Write>(
            &mut self,
            writer: &mut W,
            first: bool,
        ) -> std::io::Result<()> {
            if first { Ok(()) } else { writer.write_all(b", ") }
        }
        fn begin_object_key<W: ?Sized + std::io::Write>(&mut self, writer: &mut W, first: bool) -> std::io::Result<()> {
            if first { Ok(()) } else { writer.write_all(b", ") }
        }
        fn begin_object_value<W: ?Sized + std::io::Write>(&mut self, writer: &mut W) -> std::io::Result<()> {
            writer.write_all(b": ")
        }
    }
    let mut json = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut json, Spaced);
    description.serialize(&mut serializer).expect("a description holds only strings and numbers");
    json
}
