//! Lists the fields of a type that have numbers.

use super::{ElementKind, FieldKind, FieldPlan, ReadAs};
use crate::msg::definition::{Arity, BaseType, MessageDefinition, TypeTree};

/// A field with numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NumericPath {
    /// Its path, with `[]` after each array of messages.
    pub path: String,
    /// Its element type, and whether it has several elements.
    pub kind: FieldKind,
}

/// All fields of the type with numbers, in wire order, without stamps and durations.
///
/// Fields that can't be read are left out: those after a wide string, and bytes that are not numbers by themselves.
pub fn numeric_paths(tree: &TypeTree) -> Vec<NumericPath> {
    let mut paths = vec![];
    list(tree, tree.root(), "", false, &mut |path, kind| {
        if matches!(kind.element, ElementKind::Number(_)) && FieldPlan::compile(tree, &path, ReadAs::Numbers).is_ok() {
            paths.push(NumericPath { path, kind });
        }
    });
    paths
}

/// Paths of all fields with several strings, in wire order, in the form of [`numeric_paths`].
pub fn text_paths(tree: &TypeTree) -> Vec<String> {
    let mut paths = vec![];
    list(tree, tree.root(), "", false, &mut |path, kind| {
        if kind == (FieldKind { element: ElementKind::Text, many: true }) {
            paths.push(path);
        }
    });
    paths
}

/// Passes the fields of `message` to the callback. False if a wide string stops it.
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
            // A definition may add a wide string to a time.
            BaseType::Message(name) if is_time(name) => !holds_wide_text(tree, tree.message(name)),
            BaseType::Message(name) => {
                let message = tree.message(name);
                // To reach the second element of an array, the whole first one must be skipped.
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
