//! Which fields of a type hold numbers.

use super::{ElementKind, FieldKind, FieldPlan, ReadAs};
use crate::msg::definition::{Arity, BaseType, MessageDefinition, TypeTree};

/// A field that holds numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NumericPath {
    /// Its path, with `[]` behind each array of messages on the way.
    pub path: String,
    /// What it holds.
    pub kind: FieldKind,
}

/// All fields of the type that hold numbers, in wire order; stamps and durations left out.
///
/// Fields that no plan reads are left out too: those behind a wide string, and bytes that pack something that is not numbers
/// by themselves.
pub fn numeric_paths(tree: &TypeTree) -> Vec<NumericPath> {
    let mut paths = vec![];
    list(tree, tree.root(), "", false, &mut |path, kind| {
        if matches!(kind.element, ElementKind::Number(_)) && FieldPlan::compile(tree, &path, ReadAs::Numbers).is_ok() {
            paths.push(NumericPath { path, kind });
        }
    });
    paths
}

/// The paths of all fields of the type that hold several strings, in wire order, as [`numeric_paths`] are written.
pub fn text_paths(tree: &TypeTree) -> Vec<String> {
    let mut paths = vec![];
    list(tree, tree.root(), "", false, &mut |path, kind| {
        if kind == (FieldKind { element: ElementKind::Text, many: true }) {
            paths.push(path);
        }
    });
    paths
}

/// Tells of the fields of `message`; false when a wide string stops it.
fn list(
    tree: &TypeTree,
    message: &MessageDefinition,
    prefix: &str,
    many: bool,
    tell: &mut dyn FnMut(String, FieldKind),
) -> bool {
    message.fields.iter().all(|field| {
        let is_array = field.ty.arity != Arity::One;
        let path = format!("{prefix}{}", field.name);
        match &field.ty.base {
            BaseType::Primitive(primitive) => {
                tell(path, FieldKind { element: ElementKind::Number(*primitive), many: many || is_array });
                true
            }
            BaseType::Text { .. } => {
                tell(path, FieldKind { element: ElementKind::Text, many: many || is_array });
                true
            }
            BaseType::WideText { .. } => false,
            // A definition may say that a time holds a wide string.
            BaseType::Message(name) if is_time(name) => !holds_wide_text(tree, tree.message(name)),
            BaseType::Message(name) => {
                let message = tree.message(name);
                // To reach the second element of an array all of the first must be skipped.
                let readable = !is_array || !holds_wide_text(tree, message);
                readable
                    && list(
                        tree,
                        message,
                        &format!("{path}{}.", if is_array { "[]" } else { "" }),
                        many || is_array,
                        tell,
                    )
            }
        }
    })
}

fn is_time(type_name: &str) -> bool {
    matches!(type_name, "builtin_interfaces/msg/Time" | "builtin_interfaces/msg/Duration")
}

fn holds_wide_text(tree: &TypeTree, message: &MessageDefinition) -> bool {
    message.fields.iter().any(|field| match &field.ty.base {
        BaseType::WideText { .. } => true,
        BaseType::Message(name) => holds_wide_text(tree, tree.message(name)),
        _ => false,
    })
}
