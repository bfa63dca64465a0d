//! Reading any message type by its definition, straight from its bytes.
//!
//! A field is named by a path: `data`, `header.stamp`, `wrench.force.z`, `sensors[2].values` for one element of an
//! array of messages, `fingers[].pressure` for all of them one after another, `sensors[name=tip].values` for those in
//! which a field has a value. [`FieldPlan`] compiles a path once and then reads it from each message, past everything
//! that stands before it, without allocating.
//!
//! Bytes that a message describes are read as the numbers that they are: `data` of an image by its encoding, and
//! `data[].z` of a point cloud by its point fields.

mod condition;
mod leaf;
mod listing;
mod numbers;
mod only;
mod packed;
mod path;
mod skip;
mod value;
mod walk;

use std::fmt;

pub use listing::{NumericPath, numeric_paths, text_paths};
pub use only::{MessageCondition, check_condition};
pub use value::{Value, read_value};

use super::cdr::{CdrError, CdrReader};
use super::definition::{Primitive, TypeTree};
use crate::units::{NANOS_PER_SEC, Stamp};
use leaf::Leaf;
use packed::Packed;
use walk::Walk;

/// What one element of a field is, and whether there can be several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldKind {
    /// What one element is.
    pub element: ElementKind,
    /// Whether the path leads to an array, or through all elements of one.
    pub many: bool,
}

/// What one element of a field is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ElementKind {
    /// A number, truth value or byte.
    Number(Primitive),
    /// A string.
    Text,
    /// `builtin_interfaces/msg/Time`.
    Time,
    /// `builtin_interfaces/msg/Duration`.
    Duration,
}

impl ElementKind {
    /// Whether one element is a byte, which may be a number or a part of one.
    pub fn is_byte(self) -> bool {
        matches!(self, ElementKind::Number(Primitive::Byte | Primitive::Char | Primitive::UInt8))
    }
}

impl fmt::Display for FieldKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.element {
            ElementKind::Number(primitive) => primitive.name(),
            ElementKind::Text => "string",
            ElementKind::Time => "builtin_interfaces/msg/Time",
            ElementKind::Duration => "builtin_interfaces/msg/Duration",
        })?;
        f.write_str(if self.many { "[]" } else { "" })
    }
}

/// What a field is to be read as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadAs {
    /// Any numbers, one or many: [`FieldPlan::read_f32`], [`FieldPlan::read_f64`].
    Numbers,
    /// One whole number that is not negative: [`FieldPlan::read_count`].
    Count,
    /// One point in time: [`FieldPlan::read_stamp`].
    Stamp,
    /// One number of any kind, exactly: [`FieldPlan::read_nanos`].
    Nanos,
    /// One span of time, as a duration or as a number of seconds: [`FieldPlan::read_period`].
    Period,
    /// Any strings, one or many: [`FieldPlan::read_texts`].
    Texts,
}

impl ReadAs {
    fn wanted(self) -> &'static str {
        match self {
            ReadAs::Numbers => "numbers",
            ReadAs::Count => "one whole number",
            ReadAs::Stamp => "one builtin_interfaces/msg/Time",
            ReadAs::Nanos => "one number",
            ReadAs::Period => "one builtin_interfaces/msg/Duration, or one number of seconds",
            ReadAs::Texts => "strings",
        }
    }

    fn accepts(self, kind: FieldKind) -> bool {
        let float = |primitive| matches!(primitive, Primitive::Float32 | Primitive::Float64);
        match (self, kind.element) {
            (ReadAs::Numbers, ElementKind::Number(_)) | (ReadAs::Texts, ElementKind::Text) => true,
            (ReadAs::Count, ElementKind::Number(primitive)) => !kind.many && !float(primitive),
            (ReadAs::Nanos, ElementKind::Number(_)) => !kind.many,
            (ReadAs::Period, ElementKind::Number(_) | ElementKind::Duration) => !kind.many,
            (ReadAs::Stamp, ElementKind::Time) => !kind.many,
            _ => false,
        }
    }
}

/// Why a path can't be read from a type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FieldError {
    /// The path is not written as paths are.
    #[error(
        "'{path}' is not a field path ({reason}); expected names such as header.stamp, fingers[0].taxels, fingers[].pressure, fingers[name=thumb].taxels"
    )]
    Syntax {
        /// The path.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A name on the path is not there.
    #[error("field '{field}' is not in {type_name}; it has {fields}")]
    Missing {
        /// The name.
        field: String,
        /// The type in which it was looked for.
        type_name: String,
        /// The names that are there.
        fields: String,
    },
    /// The path ends at, or goes on behind, something that it can't.
    #[error("field '{field}' of {type_name} is {found}; {remedy}")]
    Shape {
        /// The path up to the field.
        field: String,
        /// The type of the message.
        type_name: String,
        /// Type of the field.
        found: String,
        /// What to write instead.
        remedy: String,
    },
    /// The field can't be read as what it is wanted for.
    #[error("field '{path}' of {type_name} is {found}, but {wanted} must be there")]
    Kind {
        /// The path.
        path: String,
        /// The type of the message.
        type_name: String,
        /// Type of the field.
        found: String,
        /// What was wanted.
        wanted: &'static str,
    },
    /// A wide string stands at or before the field.
    #[error(
        "field '{path}' of {type_name} can't be read: wstring '{field}' stands at or before it, and its encoding differs between ROS 2 releases"
    )]
    WideText {
        /// The path.
        path: String,
        /// The type of the message.
        type_name: String,
        /// The wide string.
        field: String,
    },
}

/// Refuses what is not written as a path, before there is a type to compile it against.
///
/// # Errors
/// [`FieldError::Syntax`].
pub fn check_path(path: &str) -> Result<(), FieldError> {
    path::parse(path).map(|_| ())
}

/// Why a field can't be read from the bytes of a message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("field '{path}' of {type_name}: {fault}")]
pub struct ReadError {
    /// The path.
    pub path: String,
    /// The type that the bytes should be.
    pub type_name: String,
    /// What is wrong with them.
    pub fault: CdrError,
}

/// A path compiled against a type: how to get from the first byte of a message to the field.
#[derive(Debug, Clone)]
pub struct FieldPlan {
    path: String,
    type_name: String,
    kind: FieldKind,
    walk: Walk,
    packed: Option<Packed>,
}

impl FieldPlan {
    /// Compiles `path` against the type, to be read as `read_as`.
    ///
    /// # Errors
    /// [`FieldError`] naming the path, the type and the fields that are there.
    pub fn compile(tree: &TypeTree, path: &str, read_as: ReadAs) -> Result<Self, FieldError> {
        match packed::compile(tree, path)? {
            Some((data, packed)) if read_as == ReadAs::Numbers => {
                Ok(FieldPlan { path: path.to_owned(), packed: Some(packed), ..data })
            }
            _ => FieldPlan::plain(tree, path, read_as),
        }
    }

    /// Compiles a path to what stands in the message itself.
    fn plain(tree: &TypeTree, path: &str, read_as: ReadAs) -> Result<Self, FieldError> {
        let (walk, kind) = walk::compile(tree, path)?;
        let type_name = tree.type_name().to_owned();
        if !read_as.accepts(kind) {
            let (found, wanted) = (kind.to_string(), read_as.wanted());
            return Err(FieldError::Kind { path: path.to_owned(), type_name, found, wanted });
        }
        Ok(FieldPlan { path: path.to_owned(), type_name, kind, walk, packed: None })
    }

    /// The path as it was given.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// What the field is.
    pub fn kind(&self) -> FieldKind {
        self.kind
    }

    /// Appends the numbers to `out`, converted; how many there were. A truth value is 0 or 1.
    ///
    /// # Errors
    /// [`ReadError`] when the bytes end early or are no plain CDR; `out` is then as it was.
    pub fn read_f32(&self, cdr: &[u8], out: &mut Vec<f32>) -> Result<usize, ReadError> {
        let before = out.len();
        let outcome = self.numbers(cdr, &mut |primitive, bytes, is_little| {
            numbers::append_f32(primitive, bytes, is_little, out);
        });
        out.truncate(if outcome.is_ok() { out.len() } else { before });
        outcome.map(|()| out.len() - before)
    }

    /// As [`read_f32`](Self::read_f32), in double precision.
    ///
    /// # Errors
    /// [`ReadError`] when the bytes end early or are no plain CDR; `out` is then as it was.
    pub fn read_f64(&self, cdr: &[u8], out: &mut Vec<f64>) -> Result<usize, ReadError> {
        let before = out.len();
        let outcome = self.numbers(cdr, &mut |primitive, bytes, is_little| {
            numbers::append_f64(primitive, bytes, is_little, out);
        });
        out.truncate(if outcome.is_ok() { out.len() } else { before });
        outcome.map(|()| out.len() - before)
    }

    /// The whole number, which must not be negative.
    ///
    /// # Errors
    /// [`ReadError`] when it is negative, or the bytes end early or are no plain CDR.
    pub fn read_count(&self, cdr: &[u8]) -> Result<u64, ReadError> {
        self.read_one(cdr, |leaf, reader| {
            let (primitive, bytes) = leaf.numbers(reader)?;
            numbers::count(primitive, bytes, reader.is_little_endian())
        })
    }

    /// The point in time.
    ///
    /// # Errors
    /// [`ReadError`] when the bytes end early or are no plain CDR.
    pub fn read_stamp(&self, cdr: &[u8]) -> Result<Stamp, ReadError> {
        self.read_one(cdr, |leaf, reader| match leaf {
            Leaf::Time => sec_nanosec(reader),
            leaf => Err(leaf.unlike(ReadAs::Stamp)),
        })
    }

    /// The number times `unit_ns`: whole numbers exactly, others to within their precision and within an `i128`.
    ///
    /// # Errors
    /// [`ReadError`] when it is not finite, or the bytes end early or are no plain CDR.
    pub fn read_nanos(&self, cdr: &[u8], unit_ns: i64) -> Result<i128, ReadError> {
        self.read_one(cdr, |leaf, reader| {
            let (primitive, bytes) = leaf.numbers(reader)?;
            let is_little = reader.is_little_endian();
            if numbers::whole_range(primitive).is_some() {
                return Ok(numbers::whole(primitive, bytes, is_little) * i128::from(unit_ns)); // 64 bits by 64
            }
            let number = numbers::first(primitive, bytes, is_little);
            if !number.is_finite() {
                return Err(CdrError::NotAStamp { value: number.to_string() });
            }
            // By parts, as 1.7e18 ns since 1970 are told to within 256 ns only; the casts saturate.
            let part = (number.fract() * unit_ns as f64).round() as i128;
            Ok((number.trunc() as i128).saturating_mul(unit_ns.into()).saturating_add(part))
        })
    }

    /// The span of time in nanoseconds; a number counts as seconds.
    ///
    /// # Errors
    /// [`ReadError`] when it is not finite, or the bytes end early or are no plain CDR.
    pub fn read_period(&self, cdr: &[u8]) -> Result<i64, ReadError> {
        self.read_one(cdr, |leaf, reader| match leaf {
            Leaf::Duration => sec_nanosec(reader).map(|Stamp(nanos)| nanos),
            leaf => {
                let (primitive, bytes) = leaf.numbers(reader)?;
                let seconds = numbers::first(primitive, bytes, reader.is_little_endian());
                let nanos = seconds * NANOS_PER_SEC as f64;
                // The cast saturates, so a span beyond 292 years stays beyond any that is accepted.
                if nanos.is_finite() {
                    Ok(nanos.round() as i64)
                } else {
                    Err(CdrError::NotASpan { value: seconds.to_string() })
                }
            }
        })
    }

    /// The strings, into a buffer whose strings keep their memory; it is as long as there were strings.
    ///
    /// # Errors
    /// [`ReadError`] when a string is not UTF-8, or the bytes end early or are no plain CDR; `out` is then empty.
    pub fn read_texts(&self, cdr: &[u8], out: &mut Vec<String>) -> Result<(), ReadError> {
        let mut filled = 0;
        let outcome = self.run(cdr, |leaf, reader| {
            for _ in 0..leaf.texts(reader)? {
                let text = reader.utf8()?;
                match out.get_mut(filled) {
                    Some(slot) => {
                        slot.clear();
                        slot.push_str(text);
                    }
                    None => out.push(text.to_owned()),
                }
                filled += 1;
            }
            Ok(())
        });
        out.truncate(if outcome.is_ok() { filled } else { 0 });
        outcome
    }

    /// Tells all numbers stretch by stretch: what they are, their bytes, whether those are little-endian.
    fn numbers(&self, cdr: &[u8], tell: &mut dyn FnMut(Primitive, &[u8], bool)) -> Result<(), ReadError> {
        match &self.packed {
            Some(packed) => packed.read(self, cdr, tell),
            None => self.run(cdr, |leaf, reader| {
                let (primitive, bytes) = leaf.numbers(reader)?;
                tell(primitive, bytes, reader.is_little_endian());
                Ok(())
            }),
        }
    }

    /// The bytes of an array of them.
    fn bytes<'a>(&self, cdr: &'a [u8]) -> Result<&'a [u8], ReadError> {
        let mut found: &[u8] = &[];
        self.run(cdr, |leaf, reader| {
            found = leaf.numbers(reader)?.1;
            Ok(())
        })?;
        Ok(found)
    }

    fn read_one<T>(
        &self,
        cdr: &[u8],
        mut read: impl FnMut(&Leaf, &mut CdrReader<'_>) -> Result<T, CdrError>,
    ) -> Result<T, ReadError> {
        let mut one = None;
        self.run(cdr, |leaf, reader| {
            if one.is_some() {
                return Err(CdrError::SeveralMatch);
            }
            one = Some(read(leaf, reader)?);
            Ok(())
        })?;
        one.ok_or_else(|| self.error(CdrError::NoElement { index: 0, len: 0 }))
    }

    fn run<'a>(
        &self,
        cdr: &'a [u8],
        mut visit: impl FnMut(&Leaf, &mut CdrReader<'a>) -> Result<(), CdrError>,
    ) -> Result<(), ReadError> {
        CdrReader::new(cdr)
            .and_then(|mut reader| self.walk.run(&mut reader, &mut visit))
            .map_err(|fault| self.error(fault))
    }

    fn error(&self, fault: CdrError) -> ReadError {
        ReadError { path: self.path.clone(), type_name: self.type_name.clone(), fault }
    }
}

/// The two fields that `Time` and `Duration` have alike, in nanoseconds.
fn sec_nanosec(reader: &mut CdrReader<'_>) -> Result<Stamp, CdrError> {
    let sec = reader.u32()?.cast_signed();
    Ok(Stamp::from_sec_nanosec(sec, reader.u32()?))
}
