//! Which hand, or which device, a message is of: a field of it by which one topic carries several.

use super::hints;
use crate::msg::definition::{Arity, BaseType, Primitive, TypeTree};
use crate::msg::dynamic::{FieldPlan, ReadAs};

/// Words of such fields.
const SIDE: &[&str] = &["side", "hand", "handedness", "chirality"];

/// Most values that are told apart: more are no hands.
const MAX_VALUES: usize = 4;

/// The field that says it, and its values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sides {
    /// Path of the field.
    pub field: String,
    /// Its values, in the order in which they came.
    pub values: Vec<String>,
}

/// The field of a type that says it, message after message.
#[derive(Debug)]
pub(super) struct SideWatch {
    plan: FieldPlan,
    is_text: bool,
    /// None once there are too many, or one that parameters can't hold.
    values: Option<Vec<String>>,
}

/// The first field of the type that may say it.
pub(super) fn watch(tree: &TypeTree) -> Option<SideWatch> {
    if hints::is_ours(tree.type_name()) || hints::is_standard(tree.type_name()) {
        return None;
    }
    tree.root().fields.iter().find_map(|field| {
        let is_text = matches!(field.ty.base, BaseType::Text { .. });
        let is_number = matches!(
            field.ty.base,
            BaseType::Primitive(primitive) if !matches!(primitive, Primitive::Float32 | Primitive::Float64)
        );
        if field.ty.arity != Arity::One || !(is_text || is_number) || hints::found(&field.name, SIDE).is_none() {
            return None;
        }
        let plan = FieldPlan::compile(tree, &field.name, if is_text { ReadAs::Texts } else { ReadAs::Numbers }).ok()?;
        Some(SideWatch { plan, is_text, values: Some(Vec::new()) })
    })
}

impl SideWatch {
    /// Takes in a message; one that can't be read is counted elsewhere.
    pub(super) fn handle(&mut self, cdr: &[u8], numbers: &mut Vec<f64>, texts: &mut Vec<String>) {
        let Some(values) = &mut self.values else { return };
        let value = if self.is_text {
            self.plan.read_texts(cdr, texts).ok().and_then(|_| texts.first().cloned())
        } else {
            numbers.clear();
            self.plan.read_f64(cdr, numbers).ok().and_then(|_| numbers.first().map(f64::to_string))
        };
        let Some(value) = value.filter(|value| !values.contains(value)) else { return };
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if values.len() == MAX_VALUES || value.is_empty() || value.len() > 64 || !value.chars().all(plain) {
            self.values = None;
            return;
        }
        values.push(value);
    }

    /// The field and its values; none where it has no values that can tell hands apart.
    pub(super) fn seen(&self) -> Option<Sides> {
        let values = self.values.clone().filter(|values| !values.is_empty())?;
        Some(Sides { field: self.plan.path().to_owned(), values })
    }
}
