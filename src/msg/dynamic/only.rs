//! Messages in which a field has a value.

use super::condition::{Wanted, shown};
use super::path::{self, Segment};
use super::{FieldError, FieldPlan, ReadError, walk};
use crate::msg::definition::TypeTree;

/// `field=value` of a whole message, compiled: whether a message is of the kind that is wanted.
#[derive(Debug, Clone)]
pub struct MessageCondition {
    plan: FieldPlan,
    wanted: Wanted,
}

impl MessageCondition {
    /// Compiles `text` against the type.
    ///
    /// # Errors
    /// [`FieldError`] where it is not written as a condition, names a field that is not there, or a value that the field
    /// can't have.
    pub fn compile(tree: &TypeTree, text: &str) -> Result<Self, FieldError> {
        let (field, value) = parse(text)?;
        let path = path::display(&field);
        let (walk, kind) = walk::compile(tree, &path)?;
        let type_name = tree.type_name().to_owned();
        match Wanted::of(kind, &value) {
            Some(wanted) => {
                Ok(MessageCondition { plan: FieldPlan { path, type_name, kind, walk, packed: None }, wanted })
            }
            None => Err(FieldError::Kind {
                path: text.to_owned(),
                type_name,
                found: kind.to_string(),
                wanted: Wanted::EXPECTED,
            }),
        }
    }

    /// Whether the message has the value; otherwise the value that it has, in one line.
    ///
    /// # Errors
    /// [`ReadError`] when the bytes end early or are no plain CDR.
    pub fn holds(&self, cdr: &[u8]) -> Result<Result<(), String>, ReadError> {
        self.plan.read_one(cdr, |leaf, reader| match self.wanted.holds(*leaf, &mut reader.clone())? {
            true => Ok(Ok(())),
            false => shown(*leaf, reader).map(Err),
        })
    }
}

/// Refuses what is not written as `field=value`, before there is a type to compile it against.
///
/// # Errors
/// [`FieldError::Syntax`].
pub fn check_condition(text: &str) -> Result<(), FieldError> {
    parse(text).map(|_| ())
}

fn parse(text: &str) -> Result<(Vec<Segment>, String), FieldError> {
    let error = |reason: String| FieldError::Syntax { path: text.to_owned(), reason };
    let (field, value) = text.split_once('=').ok_or_else(|| error("there is no '=' in it".to_owned()))?;
    path::condition(field, value).map_err(error)
}
