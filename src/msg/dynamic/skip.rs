//! Getting past fields that nobody asked for.

use crate::msg::cdr::{CdrError, CdrReader};
use crate::msg::definition::{Arity, BaseType, FieldDefinition, MessageDefinition, Primitive, TypeTree};

/// How many elements an array has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Len {
    /// As many as the definition says.
    Fixed(usize),
    /// As many as the bytes say.
    Sequence,
}

impl Len {
    /// The length, `None` for what is no array.
    pub(super) fn of(arity: Arity) -> Option<Self> {
        match arity {
            Arity::One => None,
            Arity::Fixed(n) => Some(Len::Fixed(n as usize)),
            Arity::Bounded(_) | Arity::Unbounded => Some(Len::Sequence),
        }
    }

    /// Reads the length. Every element takes a byte at least, so a length beyond what is left is refused here,
    /// before anything is reserved or looped over.
    #[inline]
    pub(super) fn read(self, reader: &mut CdrReader<'_>) -> Result<usize, CdrError> {
        let len = match self {
            Len::Fixed(len) => len,
            Len::Sequence => reader.len()?,
        };
        if len > reader.left() { reader.skip(len).map(|()| 0) } else { Ok(len) }
    }
}

/// One step past bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Op {
    /// Up to a multiple of this.
    Align(usize),
    /// Past this many bytes.
    Advance(usize),
    /// Past a string.
    Text,
    /// Past a sequence of primitives.
    Primitives(Primitive),
    /// Past an array of what takes these steps.
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

/// Compiles steps. Runs of fixed-size fields fold into one step as long as the alignment is known.
#[derive(Debug, Clone)]
pub(super) struct Skipper {
    ops: Vec<Op>,
    // The position is known to be `residue` modulo `modulus`, a power of two up to 8.
    modulus: usize,
    residue: usize,
}

/// A wide string is in the way: its name.
pub(super) struct WideTextInTheWay(pub(super) String);

impl Skipper {
    /// At the first byte of a message.
    pub(super) fn at_start() -> Self {
        Skipper { ops: vec![], modulus: 8, residue: 0 }
    }

    /// Anywhere.
    pub(super) fn anywhere() -> Self {
        Skipper { ops: vec![], modulus: 1, residue: 0 }
    }

    pub(super) fn into_ops(self) -> Vec<Op> {
        self.ops
    }

    /// Past one element of a type.
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
            self.fixed(1, 1); // the member that IDL makes up for an empty struct
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
                // Behind its length an empty sequence ends on a multiple of 4, one of larger elements on more.
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

    /// A step that ends on a multiple of `modulus`, and that is all that is known.
    fn unknown(&mut self, op: Op, modulus: usize) {
        self.ops.push(op);
        self.modulus = modulus;
        self.residue = 0;
    }
}
