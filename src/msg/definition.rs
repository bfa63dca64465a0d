//! Definitions of message types: parses and resolves `.msg` texts and the concatenated `ros2msg` schemas of bags.

mod idl;
mod installed;
mod line;
mod tree;

pub use installed::{Definitions, LookupError};
pub use tree::TypeTree;

/// Maximum number of fields of a type, with those of nested messages.
// Real messages have a few hundred at most, and `tpf inspect` reads each field by skipping all before it.
const MAX_FIELDS: usize = 4096;

/// A type with a fixed size on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Primitive {
    /// `bool`, one byte.
    Bool,
    /// `byte`, eight bits without meaning.
    Byte,
    /// `char`, which in ROS 2 is an unsigned byte.
    Char,
    /// `int8`.
    Int8,
    /// `uint8`.
    UInt8,
    /// `int16`.
    Int16,
    /// `uint16`.
    UInt16,
    /// `int32`.
    Int32,
    /// `uint32`.
    UInt32,
    /// `int64`.
    Int64,
    /// `uint64`.
    UInt64,
    /// `float32`.
    Float32,
    /// `float64`.
    Float64,
}

impl Primitive {
    /// The primitive with this name in `.msg` texts.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "bool" => Primitive::Bool,
            "byte" => Primitive::Byte,
            "char" => Primitive::Char,
            "int8" => Primitive::Int8,
            "uint8" => Primitive::UInt8,
            "int16" => Primitive::Int16,
            "uint16" => Primitive::UInt16,
            "int32" => Primitive::Int32,
            "uint32" => Primitive::UInt32,
            "int64" => Primitive::Int64,
            "uint64" => Primitive::UInt64,
            "float32" => Primitive::Float32,
            "float64" => Primitive::Float64,
            _ => return None,
        })
    }

    /// Its name in `.msg` texts.
    pub fn name(self) -> &'static str {
        match self {
            Primitive::Bool => "bool",
            Primitive::Byte => "byte",
            Primitive::Char => "char",
            Primitive::Int8 => "int8",
            Primitive::UInt8 => "uint8",
            Primitive::Int16 => "int16",
            Primitive::UInt16 => "uint16",
            Primitive::Int32 => "int32",
            Primitive::UInt32 => "uint32",
            Primitive::Int64 => "int64",
            Primitive::UInt64 => "uint64",
            Primitive::Float32 => "float32",
            Primitive::Float64 => "float64",
        }
    }

    /// Size on the wire, bytes. Its alignment is the same.
    pub fn size(self) -> usize {
        match self {
            Primitive::Bool | Primitive::Byte | Primitive::Char | Primitive::Int8 | Primitive::UInt8 => 1,
            Primitive::Int16 | Primitive::UInt16 => 2,
            Primitive::Int32 | Primitive::UInt32 | Primitive::Float32 => 4,
            Primitive::Int64 | Primitive::UInt64 | Primitive::Float64 => 8,
        }
    }
}

/// Type of one element of a field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BaseType {
    /// A number, boolean or byte.
    Primitive(Primitive),
    /// `string`, or `string<=bound`.
    Text {
        /// Maximum length in bytes, if the definition gives one.
        bound: Option<u32>,
    },
    /// `wstring`, or `wstring<=bound`.
    WideText {
        /// Maximum length in characters, if the definition gives one.
        bound: Option<u32>,
    },
    /// Another message, by canonical name.
    Message(String),
}

/// Number of elements of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    /// One: the field is not an array.
    One,
    /// `[n]`, at least 1.
    Fixed(u32),
    /// `[<=n]`.
    Bounded(u32),
    /// `[]`.
    Unbounded,
}

/// Type of a field: type and number of its elements.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldType {
    /// Type of one element.
    pub base: BaseType,
    /// Number of elements.
    pub arity: Arity,
}

impl std::fmt::Display for FieldType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.base {
            BaseType::Primitive(primitive) => f.write_str(primitive.name())?,
            BaseType::Text { bound: None } => f.write_str("string")?,
            BaseType::Text { bound: Some(bound) } => write!(f, "string<={bound}")?,
            BaseType::WideText { bound: None } => f.write_str("wstring")?,
            BaseType::WideText { bound: Some(bound) } => write!(f, "wstring<={bound}")?,
            BaseType::Message(name) => f.write_str(name)?,
        }
        match self.arity {
            Arity::One => Ok(()),
            Arity::Fixed(n) => write!(f, "[{n}]"),
            Arity::Bounded(n) => write!(f, "[<={n}]"),
            Arity::Unbounded => f.write_str("[]"),
        }
    }
}

/// A field of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldDefinition {
    /// Its name.
    pub name: String,
    /// Its type.
    pub ty: FieldType,
    /// Its default value as written, if there is one. It is not on the wire.
    pub default: Option<String>,
}

/// A constant of a message. It is not on the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConstantDefinition {
    /// Its name.
    pub name: String,
    /// Its type.
    pub ty: BaseType,
    /// Its value as written, without the quotes of a string.
    pub value: String,
}

/// A message type, as defined by its `.msg` text.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MessageDefinition {
    /// Canonical name, `package/msg/Name`.
    pub type_name: String,
    /// Fields in wire order. A message without fields takes one unused byte on the wire.
    pub fields: Vec<FieldDefinition>,
    /// Constants in the order of the text.
    pub constants: Vec<ConstantDefinition>,
}

impl MessageDefinition {
    /// Parses the text of one `.msg` file. Types of other messages are not resolved yet.
    ///
    /// # Errors
    /// [`DefinitionError`], which names the type, the line and the error.
    pub fn parse(type_name: &str, text: &str) -> Result<Self, DefinitionError> {
        let type_name = checked_type_name(type_name)?;
        let mut definition = MessageDefinition { type_name, ..Default::default() };
        for (line_idx, text) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            line::parse(text, &mut definition).map_err(|reason| DefinitionError::Line {
                type_name: definition.type_name.clone(),
                line: line_idx + 1,
                text: shortened(text.trim()),
                reason,
            })?;
        }
        Ok(definition)
    }

    /// The field with this name.
    pub fn field(&self, name: &str) -> Option<&FieldDefinition> {
        self.fields.iter().find(|field| field.name == name)
    }

    /// Package of the message.
    pub fn package(&self) -> &str {
        self.type_name.split('/').next().unwrap_or_default()
    }
}

/// Canonical name of a type. `pkg/Name` and `pkg/msg/Name` are the same type: this crate writes and compares the
/// second.
///
/// Names of service and action types (`pkg/srv/Name_Event`) stay unchanged.
pub fn canonical_type_name(name: &str) -> String {
    let name = name.trim();
    match name.split_once('/') {
        Some((package, short)) if !short.contains('/') => format!("{package}/msg/{short}"),
        _ => name.to_owned(),
    }
}

/// A definition that can't be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DefinitionError {
    /// A type name is not of the form `package/msg/Name`.
    #[error("'{name}' is not a type name: expected package/msg/Name")]
    TypeName {
        /// The name found.
        name: String,
    },
    /// A line of the text is neither field, constant, comment nor empty.
    #[error("definition of {type_name}, line {line}: {reason} in '{text}'")]
    Line {
        /// The type whose definition it is.
        type_name: String,
        /// Line number within it, from 1.
        line: usize,
        /// The line, shortened.
        text: String,
        /// The error.
        reason: String,
    },
    /// A section of a concatenated schema doesn't name its type.
    #[error("schema of {type_name}, line {line}: expected 'MSG: package/Name' after the separator, got '{text}'")]
    Section {
        /// Type of the schema.
        type_name: String,
        /// Line number within the schema, from 1.
        line: usize,
        /// The line found.
        text: String,
    },
    /// A type is used but not defined.
    #[error("{type_name} uses {dependency}, which is not defined; give the .msg file of {dependency}")]
    UnknownDependency {
        /// The type that uses it.
        type_name: String,
        /// The undefined type.
        dependency: String,
    },
    /// A schema has no definition.
    #[error(
        "{type_name} is not defined in the bag, as in any .db3 bag before ROS 2 Jazzy: source the setup file of its package, so that its .msg file is found on AMENT_PREFIX_PATH"
    )]
    Missing {
        /// The type.
        type_name: String,
    },
    /// A schema is in an unsupported language.
    #[error("the schema of {type_name} is written as '{got}', expected ros2msg or ros2idl")]
    Encoding {
        /// The type.
        type_name: String,
        /// Its language.
        got: String,
    },
    /// An IDL text is longer than any real one.
    #[error("the IDL of {type_name} has {n_bytes} bytes, expected at most {limit}")]
    TooLong {
        /// The type.
        type_name: String,
        /// Length of the text.
        n_bytes: usize,
        /// The limit.
        limit: usize,
    },
    /// An IDL text doesn't define the type of its schema.
    #[error("the IDL of {type_name} has no struct of that name")]
    NotInIdl {
        /// The type.
        type_name: String,
    },
    /// A type contains itself.
    #[error("{type_name} contains itself, by way of {through}; a ROS message can't")]
    Recursive {
        /// The type.
        type_name: String,
        /// The type in it that contains it.
        through: String,
    },
    /// Types are nested more deeply than in any real message.
    #[error("{type_name} nests more than {limit} messages deep; a message of a robot does not")]
    TooDeep {
        /// The type.
        type_name: String,
        /// The limit.
        limit: usize,
    },
    /// A type has more fields, with nested ones, than any real message.
    #[error("{type_name} has more than {limit} fields, nested ones included; a message of a robot does not")]
    TooLarge {
        /// The type.
        type_name: String,
        /// The limit.
        limit: usize,
    },
    /// The text defines a service or action, but the type is not one of its parts.
    #[error(
        "the definition of {type_name} has parts divided by '---', which only a service event, request or response may have"
    )]
    NotAMessage {
        /// The type.
        type_name: String,
    },
}

/// The canonical form of a valid type name: three identifiers, separated by slashes.
fn checked_type_name(name: &str) -> Result<String, DefinitionError> {
    let canonical = canonical_type_name(name);
    let parts: Vec<&str> = canonical.split('/').collect();
    if parts.len() == 3 && parts.iter().all(|part| line::is_identifier(part)) {
        Ok(canonical)
    } else {
        Err(DefinitionError::TypeName { name: shortened(name) })
    }
}

/// Text from a file, which may be malicious, cut so that it fits on the line of an error.
fn shortened(text: &str) -> String {
    const LIMIT: usize = 80;
    let shown: String = text.chars().take(LIMIT).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().nth(LIMIT).is_some() { format!("{shown}...") } else { shown }
}

#[cfg(test)]
mod tests;
