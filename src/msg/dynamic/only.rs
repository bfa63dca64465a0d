//! Selects messages by the value of a field.

use super::condition::{Wanted, shown};
use super::path::{self, Segment};
use super::{FieldError, FieldPlan, ReadError, walk};
use crate::msg::definition::TypeTree;

/// Compiled `field=value` on a whole message. It selects the messages of a source.
#[derive(Debug, Clone)]
pub struct MessageCondition {
    plan: FieldPlan,
    wanted: Wanted,
}

impl MessageCondition {
    /// Compiles `text` against the type.
    ///
    /// # Errors
    /// [`FieldError`] if the syntax is wrong, if the field doesn't exist, or if it can't have the value.
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

    /// `Ok` if the message has the value; otherwise the value that it has, on one line.
    ///
    /// # Errors
    /// [`ReadError`] if the bytes end early or are not plain CDR.
    pub fn holds(&self, cdr: &[u8]) -> Result<Result<(), String>, ReadError> {
        self.plan.read_one(cdr, |leaf, reader| match self.wanted.holds(*leaf, &mut reader.clone())? {
            true => Ok(Ok(())),
            false => shown(*leaf, reader).map(Err),
        })
    }
}

/// Checks the syntax of `field=value`, before the type is known.
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
