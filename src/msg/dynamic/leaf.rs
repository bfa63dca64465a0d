//! The field at the end of a path.

use super::skip::Len;
use super::{ElementKind, FieldKind, ReadAs};
use crate::msg::cdr::{CdrError, CdrReader};
use crate::msg::definition::Primitive;

/// The field at the end of a path.
#[derive(Debug, Clone, Copy)]
pub(super) enum Leaf {
    Number(Primitive),
    Numbers(Primitive, Len),
    /// The numbers of a message that has so many of one type and nothing else.
    Block(Primitive, usize),
    Text,
    Texts(Len),
    Time,
    Duration,
}

impl Leaf {
    /// The bytes of the numbers: whole elements of the primitive.
    #[inline]
    pub(super) fn numbers<'a>(&self, reader: &mut CdrReader<'a>) -> Result<(Primitive, &'a [u8]), CdrError> {
        match *self {
            Leaf::Number(primitive) => Ok((primitive, reader.primitives(primitive, 1)?)),
            Leaf::Numbers(primitive, len) => {
                let len = len.read(reader)?;
                Ok((primitive, reader.primitives(primitive, len)?))
            }
            Leaf::Block(primitive, len) => Ok((primitive, reader.primitives(primitive, len)?)),
            _ => Err(self.unlike(ReadAs::Numbers)),
        }
    }

    /// Number of strings that follow.
    pub(super) fn texts(&self, reader: &mut CdrReader<'_>) -> Result<usize, CdrError> {
        match self {
            Leaf::Text => Ok(1),
            Leaf::Texts(len) => len.read(reader),
            _ => Err(self.unlike(ReadAs::Texts)),
        }
    }

    /// The error if a plan is read as another type than the one it was compiled for.
    pub(super) fn unlike(&self, read_as: ReadAs) -> CdrError {
        CdrError::Kind { wanted: read_as.wanted(), found: self.kind(false).to_string() }
    }

    pub(super) fn kind(&self, within_every: bool) -> FieldKind {
        let (element, many) = match *self {
            Leaf::Number(primitive) => (ElementKind::Number(primitive), false),
            Leaf::Numbers(primitive, _) | Leaf::Block(primitive, _) => (ElementKind::Number(primitive), true),
            Leaf::Text => (ElementKind::Text, false),
            Leaf::Texts(_) => (ElementKind::Text, true),
            Leaf::Time => (ElementKind::Time, false),
            Leaf::Duration => (ElementKind::Duration, false),
        };
        FieldKind { element, many: many || within_every }
    }
}
