//! Reads fields of any message type from its bytes, by its definition.
//!
//! A field is named by a path: `data`, `header.stamp`, `wrench.force.z`, `sensors[2].values` for one element of an
//! array of messages, `fingers[].pressure` for all elements one after another, `sensors[name=tip].values` for the
//! elements in which a field has this value. [`FieldPlan`] compiles a path once. It then reads the field from each
//! message without allocations, skipping the fields before it.
//!
//! If a message describes its bytes, they are read as numbers: `data` of an image by its encoding, `data[].z` of a
//! point cloud by its point fields.

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

/// Element type of a field, and whether it can have several elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FieldKind {
    /// Type of an element.
    pub element: ElementKind,
    /// True if the path leads to an array, or through all elements of one.
    pub many: bool,
}

/// Type of an element of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ElementKind {
    /// A number, boolean or byte.
    Number(Primitive),
    /// A string.
    Text,
    /// `builtin_interfaces/msg/Time`.
    Time,
    /// `builtin_interfaces/msg/Duration`.
    Duration,
}

impl ElementKind {
    /// True if an element is a byte, which may be a number or a part of one.
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

/// Type that a field is read as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadAs {
    /// Numbers, one or more: [`FieldPlan::read_f32`], [`FieldPlan::read_f64`].
    Numbers,
    /// One non-negative integer: [`FieldPlan::read_count`].
    Count,
    /// One point in time: [`FieldPlan::read_stamp`].
    Stamp,
    /// One number of any type, without rounding: [`FieldPlan::read_nanos`].
    Nanos,
    /// One duration, as a `Duration` or as a number of seconds: [`FieldPlan::read_period`].
    Period,
    /// Strings, one or more: [`FieldPlan::read_texts`].
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

/// A path that can't be read from a type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FieldError {
    /// The path has a syntax error.
    #[error(
        "'{path}' is not a field path ({reason}); expected names such as header.stamp, fingers[0].taxels, fingers[].pressure, fingers[name=thumb].taxels"
    )]
    Syntax {
        /// The path.
        path: String,
        /// The syntax error.
        reason: String,
    },
    /// A field of the path doesn't exist.
    #[error("field '{field}' is not in {type_name}; it has {fields}")]
    Missing {
        /// The name of the field.
        field: String,
        /// The type that was searched.
        type_name: String,
        /// The fields that exist.
        fields: String,
    },
    /// The path ends at a field that it can't end at, or continues after one that has no fields.
    #[error("field '{field}' of {type_name} is {found}; {remedy}")]
    Shape {
        /// The path up to the field.
        field: String,
        /// The type of the message.
        type_name: String,
        /// Type of the field.
        found: String,
        /// The correct form.
        remedy: String,
    },
    /// The field doesn't have the required type.
    #[error("field '{path}' of {type_name} is {found}, but {wanted} must be there")]
    Kind {
        /// The path.
        path: String,
        /// The type of the message.
        type_name: String,
        /// Type of the field.
        found: String,
        /// The required type.
        wanted: &'static str,
    },
    /// There is a wide string at or before the field.
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

/// Checks the syntax of a path, before its type is known.
///
/// # Errors
/// [`FieldError::Syntax`].
pub fn check_path(path: &str) -> Result<(), FieldError> {
    path::parse(path).map(|_| ())
}

/// A field that can't be read from the bytes of a message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("field '{path}' of {type_name}: {fault}")]
pub struct ReadError {
    /// The path.
    pub path: String,
    /// The expected type.
    pub type_name: String,
    /// The error in the bytes.
    pub fault: CdrError,
}

/// A path compiled against a type. It leads from the first byte of a message to the field.
#[derive(Debug, Clone)]
pub struct FieldPlan {
    path: String,
    type_name: String,
    kind: FieldKind,
    walk: Walk,
    packed: Option<Packed>,
}

impl FieldPlan {
    /// Compiles `path` against the type, for reading as `read_as`.
    ///
    /// # Errors
    /// [`FieldError`], which names the path, the type and the existing fields.
    pub fn compile(tree: &TypeTree, path: &str, read_as: ReadAs) -> Result<Self, FieldError> {
        match packed::compile(tree, path)? {
            Some((data, packed)) if read_as == ReadAs::Numbers => {
                Ok(FieldPlan { path: path.to_owned(), packed: Some(packed), ..data })
            }
            _ => FieldPlan::plain(tree, path, read_as),
        }
    }

    /// Compiles a path to a message, or to those of an array, whose `numbers` have these paths in this order and are all it has:
    /// the pose of `poses[]` has `position.x` to `orientation.w`. They are read at once, one message after another.
    ///
    /// # Errors
    /// [`FieldError`], also if the message has other fields.
    pub(in crate::msg) fn compile_block(tree: &TypeTree, path: &str, numbers: &[&str]) -> Result<Self, FieldError> {
        let (walk, kind) = walk::compile_block(tree, path, numbers)?;
        Ok(FieldPlan { path: path.to_owned(), type_name: tree.type_name().to_owned(), kind, walk, packed: None })
    }

    /// Compiles a path to a field of the message itself, not to packed numbers.
    fn plain(tree: &TypeTree, path: &str, read_as: ReadAs) -> Result<Self, FieldError> {
        let (walk, kind) = walk::compile(tree, path)?;
        let type_name = tree.type_name().to_owned();
        if !read_as.accepts(kind) {
            let (found, wanted) = (kind.to_string(), read_as.wanted());
            return Err(FieldError::Kind { path: path.to_owned(), type_name, found, wanted });
        }
        Ok(FieldPlan { path: path.to_owned(), type_name, kind, walk, packed: None })
    }

    /// The path as given.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Element type of the field, and whether it can have several elements.
    pub fn kind(&self) -> FieldKind {
        self.kind
    }

    /// Converts the numbers, appends them to `out`, and returns how many there were. A boolean gives 0 or 1.
    ///
    /// # Errors
    /// [`ReadError`] if the bytes end early or are not plain CDR. `out` is then unchanged.
    pub fn read_f32(&self, cdr: &[u8], out: &mut Vec<f32>) -> Result<usize, ReadError> {
        let before = out.len();
        let outcome = self.numbers(cdr, &mut |primitive, bytes, is_little| {
            numbers::append_f32(primitive, bytes, is_little, out);
        });
        out.truncate(if outcome.is_ok() { out.len() } else { before });
        outcome.map(|()| out.len() - before)
    }

    /// Like [`read_f32`](Self::read_f32), in double precision.
    ///
    /// # Errors
    /// [`ReadError`] if the bytes end early or are not plain CDR. `out` is then unchanged.
    pub fn read_f64(&self, cdr: &[u8], out: &mut Vec<f64>) -> Result<usize, ReadError> {
        let before = out.len();
        let outcome = self.numbers(cdr, &mut |primitive, bytes, is_little| {
            numbers::append_f64(primitive, bytes, is_little, out);
        });
        out.truncate(if outcome.is_ok() { out.len() } else { before });
        outcome.map(|()| out.len() - before)
    }

    /// Reads an integer, which must not be negative.
    ///
    /// # Errors
    /// [`ReadError`] if it is negative, or if the bytes end early or are not plain CDR.
    pub fn read_count(&self, cdr: &[u8]) -> Result<u64, ReadError> {
        self.read_one(cdr, |leaf, reader| {
            let (primitive, bytes) = leaf.numbers(reader)?;
            numbers::count(primitive, bytes, reader.is_little_endian())
        })
    }

    /// Reads a point in time.
    ///
    /// # Errors
    /// [`ReadError`] if the bytes end early or are not plain CDR.
    pub fn read_stamp(&self, cdr: &[u8]) -> Result<Stamp, ReadError> {
        self.read_one(cdr, |leaf, reader| match leaf {
            Leaf::Time => sec_nanosec(reader),
            leaf => Err(leaf.unlike(ReadAs::Stamp)),
        })
    }

    /// Reads a number and multiplies it by `unit_ns`: exactly for integers; floats within their precision and the range
    /// of `i128`.
    ///
    /// # Errors
    /// [`ReadError`] if it is not finite, or if the bytes end early or are not plain CDR.
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
            // In two parts, because an f64 represents 1.7e18 ns since 1970 only to within 256 ns. The casts saturate.
            let part = (number.fract() * unit_ns as f64).round() as i128;
            Ok((number.trunc() as i128).saturating_mul(unit_ns.into()).saturating_add(part))
        })
    }

    /// Reads a duration in nanoseconds. A number counts as seconds.
    ///
    /// # Errors
    /// [`ReadError`] if it is not finite, or if the bytes end early or are not plain CDR.
    pub fn read_period(&self, cdr: &[u8]) -> Result<i64, ReadError> {
        self.read_one(cdr, |leaf, reader| match leaf {
            Leaf::Duration => sec_nanosec(reader).map(|Stamp(nanos)| nanos),
            leaf => {
                let (primitive, bytes) = leaf.numbers(reader)?;
                let seconds = numbers::first(primitive, bytes, reader.is_little_endian());
                let nanos = seconds * NANOS_PER_SEC as f64;
                // The cast saturates. A duration of more than 292 years is therefore still longer than any that is
                // accepted.
                if nanos.is_finite() {
                    Ok(nanos.round() as i64)
                } else {
                    Err(CdrError::NotASpan { value: seconds.to_string() })
                }
            }
        })
    }

    /// Replaces the strings in `out`, whose memory is reused. Afterwards `out` has as many strings as the field.
    ///
    /// # Errors
    /// [`ReadError`] if a string is not UTF-8, or if the bytes end early or are not plain CDR. `out` is then empty.
    pub fn read_texts(&self, cdr: &[u8], out: &mut Vec<String>) -> Result<(), ReadError> {
        let mut filled = 0;
        let outcome = self.run(cdr, |leaf, reader| {
            for _ in 0..leaf.texts(reader)? {
                let start = reader.clone();
                let bytes = reader.text()?;
                // Names are mostly those of the message before, which are known to be UTF-8.
                if out.get(filled).is_none_or(|before| before.as_bytes() != bytes) {
                    *reader = start;
                    let text = reader.utf8()?;
                    match out.get_mut(filled) {
                        Some(slot) => {
                            slot.clear();
                            slot.push_str(text);
                        }
                        None => out.push(text.to_owned()),
                    }
                }
                filled += 1;
            }
            Ok(())
        });
        out.truncate(if outcome.is_ok() { filled } else { 0 });
        outcome
    }

    /// Passes all numbers to `tell` in blocks: their type, their bytes, and whether these are little-endian.
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

    /// The bytes of a byte array.
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

/// Reads `sec` and `nanosec`, which `Time` and `Duration` have in common, in nanoseconds.
fn sec_nanosec(reader: &mut CdrReader<'_>) -> Result<Stamp, CdrError> {
    let sec = reader.u32()?.cast_signed();
    Ok(Stamp::from_sec_nanosec(sec, reader.u32()?))
}
