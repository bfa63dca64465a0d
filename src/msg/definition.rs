//! What a message type is made of: `.msg` text and the concatenated `ros2msg` schemas of bags, parsed and resolved.

mod idl;
mod installed;
mod line;
mod tree;

pub use installed::{Definitions, LookupError};
pub use tree::TypeTree;

/// Most fields, those of nested messages included, that a type may have.
// Real messages have a few hundred at most, and `tpf inspect` looks at each by way of all before it.
const MAX_FIELDS: usize = 4096;

/// A type of fixed size on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Primitive {
    /// `bool`, one byte.
    Bool,
    /// `byte`, eight bits without a meaning.
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
    /// The primitive that `.msg` text calls `name`.
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

    /// What `.msg` text calls it.
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

    /// Bytes on the wire, which is its alignment too.
    pub fn size(self) -> usize {
        match self {
            Primitive::Bool | Primitive::Byte | Primitive::Char | Primitive::Int8 | Primitive::UInt8 => 1,
            Primitive::Int16 | Primitive::UInt16 => 2,
            Primitive::Int32 | Primitive::UInt32 | Primitive::Float32 => 4,
            Primitive::Int64 | Primitive::UInt64 | Primitive::Float64 => 8,
        }
    }
}

/// What one element of a field is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BaseType {
    /// A number, truth value or byte.
    Primitive(Primitive),
    /// `string`, or `string<=bound`.
    Text {
        /// Most bytes that it may hold, where the definition says.
        bound: Option<u32>,
    },
    /// `wstring`, or `wstring<=bound`.
    WideText {
        /// Most characters that it may hold, where the definition says.
        bound: Option<u32>,
    },
    /// Another message, by its canonical name.
    Message(String),
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    /// The field is no array.
    One,
    /// `[n]`, at least 1.
    Fixed(u32),
    /// `[<=n]`.
    Bounded(u32),
    /// `[]`.
    Unbounded,
}

/// Type of a field: its elements, and how many.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldType {
    /// What one element is.
    pub base: BaseType,
    /// How many elements there are.
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
    /// Its default value as written, where there is one. It never reaches the wire.
    pub default: Option<String>,
}

/// A constant of a message. It never reaches the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConstantDefinition {
    /// Its name.
    pub name: String,
    /// Its type.
    pub ty: BaseType,
    /// Its value as written, without the quotes of a string.
    pub value: String,
}

/// One message type, as its `.msg` text says.
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
    /// Parses the text of one `.msg` file; types of other messages are not looked up yet.
    ///
    /// # Errors
    /// [`DefinitionError`] naming the type, the line and what is wrong with it.
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

    /// The field called `name`.
    pub fn field(&self, name: &str) -> Option<&FieldDefinition> {
        self.fields.iter().find(|field| field.name == name)
    }

    /// The package that the message belongs to.
    pub fn package(&self) -> &str {
        self.type_name.split('/').next().unwrap_or_default()
    }
}

/// `pkg/Name` and `pkg/msg/Name` are one type: the second is what this crate writes and compares.
///
/// Names of services and actions (`pkg/srv/Name_Event`) stay as they are.
pub fn canonical_type_name(name: &str) -> String {
    let name = name.trim();
    match name.split_once('/') {
        Some((package, short)) if !short.contains('/') => format!("{package}/msg/{short}"),
        _ => name.to_owned(),
    }
}

/// Why a definition can't be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DefinitionError {
    /// A type name is no `package/msg/Name`.
    #[error("'{name}' is not a type name: expected package/msg/Name")]
    TypeName {
        /// What came.
        name: String,
    },
    /// A line of the text is neither field, constant, comment nor empty.
    #[error("definition of {type_name}, line {line}: {reason} in '{text}'")]
    Line {
        /// Whose definition it is.
        type_name: String,
        /// Line within it, from 1.
        line: usize,
        /// The line, shortened.
        text: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A section of a concatenated schema does not say what it defines.
    #[error("schema of {type_name}, line {line}: expected 'MSG: package/Name' after the separator, got '{text}'")]
    Section {
        /// Type of the schema.
        type_name: String,
        /// Line within the schema, from 1.
        line: usize,
        /// What came.
        text: String,
    },
    /// A type that is used is not defined.
    #[error("{type_name} uses {dependency}, which is not defined; give the .msg file of {dependency}")]
    UnknownDependency {
        /// Who uses it.
        type_name: String,
        /// What is missing.
        dependency: String,
    },
    /// A schema comes without a definition.
    #[error(
        "{type_name} is not defined in the bag, as in any .db3 bag before ROS 2 Jazzy: source the setup file of its package, so that its .msg file is found on AMENT_PREFIX_PATH"
    )]
    Missing {
        /// The type.
        type_name: String,
    },
    /// A schema is written in another language than those that are read.
    #[error("the schema of {type_name} is written as '{got}', expected ros2msg or ros2idl")]
    Encoding {
        /// The type.
        type_name: String,
        /// How it is written.
        got: String,
    },
    /// A text in IDL is longer than any real one.
    #[error("the IDL of {type_name} has {n_bytes} bytes, expected at most {limit}")]
    TooLong {
        /// The type.
        type_name: String,
        /// Length of the text.
        n_bytes: usize,
        /// The limit.
        limit: usize,
    },
    /// A text in IDL defines other types than the one that it is the schema of.
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
        /// The type inside of it that leads back.
        through: String,
    },
    /// Types are nested deeper than any real message.
    #[error("{type_name} nests more than {limit} messages deep; a message of a robot does not")]
    TooDeep {
        /// The type.
        type_name: String,
        /// The limit.
        limit: usize,
    },
    /// A type has more fields, nested ones included, than any real message.
    #[error("{type_name} has more than {limit} fields, nested ones included; a message of a robot does not")]
    TooLarge {
        /// The type.
        type_name: String,
        /// The limit.
        limit: usize,
    },
    /// The text is the definition of a service or action, but the type is not one of those that are made of it.
    #[error(
        "the definition of {type_name} has parts divided by '---', which only a service event, request or response may have"
    )]
    NotAMessage {
        /// The type.
        type_name: String,
    },
}

/// The canonical form of a name, if it is one: identifiers divided by slashes, three of them.
fn checked_type_name(name: &str) -> Result<String, DefinitionError> {
    let canonical = canonical_type_name(name);
    let parts: Vec<&str> = canonical.split('/').collect();
    if parts.len() == 3 && parts.iter().all(|part| line::is_identifier(part)) {
        Ok(canonical)
    } else {
        Err(DefinitionError::TypeName { name: shortened(name) })
    }
}

/// Text that may be hostile, cut to what fits into one line of an error.
fn shortened(text: &str) -> String {
    const LIMIT: usize = 80;
    let shown: String = text.chars().take(LIMIT).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().nth(LIMIT).is_some() { format!("{shown}...") } else { shown }
}

#[cfg(test)]
mod tests;
