//! Skips fields that are not read.

use crate::msg::cdr::{CdrError, CdrReader};
use crate::msg::definition::{Arity, BaseType, FieldDefinition, MessageDefinition, Primitive, TypeTree};

/// Number of elements of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Len {
    /// Given by the definition.
    Fixed(usize),
    /// Given by the bytes.
    Sequence,
}

impl Len {
    /// The length. `None` if the field is not an array.
    pub(super) fn of(arity: Arity) -> Option<Self> {
        match arity {
            Arity::One => None,
            Arity::Fixed(n) => Some(Len::Fixed(n as usize)),
            Arity::Bounded(_) | Arity::Unbounded => Some(Len::Sequence),
        }
    }

    /// Reads the length. Every element has at least one byte. A length beyond the remaining bytes is therefore refused
    /// here, before memory is reserved or a loop starts.
    #[inline]
    pub(super) fn read(self, reader: &mut CdrReader<'_>) -> Result<usize, CdrError> {
        let len = match self {
            Len::Fixed(len) => len,
            Len::Sequence => reader.len()?,
        };
        if len > reader.left() { reader.skip(len).map(|()| 0) } else { Ok(len) }
    }
}

/// One step that skips bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Op {
    /// Advance to a multiple of this.
    Align(usize),
    /// Advance by this number of bytes.
    Advance(usize),
    /// Skip a string.
    Text,
    /// Skip a sequence of primitives.
    Primitives(Primitive),
    /// Skip an array whose elements need these steps.
    Array(Len, Vec<Op>),
}

pub(super) fn run(ops: &[Op], reader: &mut CdrReader<'_>) -> Result<(), CdrError> {
    for op in ops {
        match op {
            Op::Align(alignment) => reader.align(*alignment)?,
            Op::Advance(n_bytes) => reader.skip(*n_bytes)?,
            Op::Text => reader.text().map(|_| ())?,
            Op::Primitives(primitive) => {
                let len = reader.len()?;
                reader.primitives(*primitive, len)?;
            }
            Op::Array(len, element) => {
                for _ in 0..len.read(reader)? {
                    run(element, reader)?;
                }
            }
        }
    }
    Ok(())
}

/// Compiles steps. Consecutive fields of fixed size become one step while the alignment is known.
#[derive(Debug, Clone)]
pub(super) struct Skipper {
    ops: Vec<Op>,
    // The position is `residue` modulo `modulus`, which is a power of two up to 8.
    modulus: usize,
    residue: usize,
}

/// Error: a wide string with this name comes before the field.
pub(super) struct WideTextInTheWay(pub(super) String);

impl Skipper {
    /// Starts at the first byte of a message.
    pub(super) fn at_start() -> Self {
        Skipper { ops: vec![], modulus: 8, residue: 0 }
    }

    /// Starts at an unknown position.
    pub(super) fn anywhere() -> Self {
        Skipper { ops: vec![], modulus: 1, residue: 0 }
    }

    pub(super) fn into_ops(self) -> Vec<Op> {
        self.ops
    }

    /// Skips one element of a type.
    pub(super) fn element(&mut self, tree: &TypeTree, name: &str, base: &BaseType) -> Result<(), WideTextInTheWay> {
        match base {
            BaseType::Primitive(primitive) => {
                self.fixed(primitive.size(), primitive.size());
                Ok(())
            }
            BaseType::Text { .. } => {
                self.unknown(Op::Text, 1);
                Ok(())
            }
            BaseType::WideText { .. } => Err(WideTextInTheWay(name.to_owned())),
            BaseType::Message(type_name) => self.message(tree, tree.message(type_name)),
        }
    }

    pub(super) fn message(&mut self, tree: &TypeTree, message: &MessageDefinition) -> Result<(), WideTextInTheWay> {
        if message.fields.is_empty() {
            self.fixed(1, 1); // the member that IDL adds to an empty struct
        }
        message.fields.iter().try_for_each(|field| self.field(tree, field))
    }

    pub(super) fn field(&mut self, tree: &TypeTree, field: &FieldDefinition) -> Result<(), WideTextInTheWay> {
        match (Len::of(field.ty.arity), &field.ty.base) {
            (None, base) => self.element(tree, &field.name, base)?,
            (Some(Len::Fixed(n)), BaseType::Primitive(primitive)) => {
                self.fixed(primitive.size(), primitive.size().saturating_mul(n));
            }
            (Some(Len::Sequence), BaseType::Primitive(primitive)) => {
                // An empty sequence ends after its length, at a multiple of 4. Larger elements end at a larger
                // multiple.
                self.unknown(Op::Primitives(*primitive), primitive.size().min(4));
            }
            (Some(len), base) => {
                let mut element = Skipper::anywhere();
                element.element(tree, &field.name, base)?;
                self.unknown(Op::Array(len, element.into_ops()), 1);
            }
        }
        Ok(())
    }

    fn fixed(&mut self, alignment: usize, n_bytes: usize) {
        if alignment <= self.modulus {
            let padding = self.residue.wrapping_neg() & (alignment - 1);
            self.advance(padding.saturating_add(n_bytes));
        } else {
            self.unknown(Op::Align(alignment), alignment);
            self.advance(n_bytes);
        }
    }

    fn advance(&mut self, n_bytes: usize) {
        match self.ops.last_mut() {
            Some(Op::Advance(before)) => *before = before.saturating_add(n_bytes),
            _ => self.ops.push(Op::Advance(n_bytes)),
        }
        self.residue = self.residue.wrapping_add(n_bytes) & (self.modulus - 1);
    }

    /// Adds a step after which the position is only known to be a multiple of `modulus`.
    fn unknown(&mut self, op: Op, modulus: usize) {
        self.ops.push(op);
        self.modulus = modulus;
        self.residue = 0;
    }
}
