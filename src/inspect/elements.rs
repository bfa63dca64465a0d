//! The elements of an array of messages: how many there are, and the field that tells them apart.

use super::hints;
use crate::msg::definition::{Arity, BaseType, FieldDefinition, Primitive, TypeTree};
use crate::msg::dynamic::{FieldPlan, ReadAs};

/// Most elements that are told apart; two hands have ten fingertips.
const MAX_ELEMENTS: usize = 16;

/// Names of fields that say which element it is.
const KEYS: &[&str] = &["name", "id", "pos", "side", "label", "finger", "hand", "location"];

/// The elements of an array of messages, which each hold an array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Elements {
    /// Path of the array: `sensors`.
    pub array: String,
    /// Elements in a message.
    pub n: u64,
    /// The field of each that tells them apart, and its values.
    pub key: Option<(String, Vec<String>)>,
}

/// An array of messages, message after message.
#[derive(Debug)]
pub(super) struct ElementWatch {
    /// Its path.
    pub(super) array: String,
    keys: Vec<KeyWatch>,
    n_seen: u64,
    counts: [usize; 2],
}

/// A field of each element.
#[derive(Debug)]
struct KeyWatch {
    field: String,
    plan: FieldPlan,
    is_text: bool,
    /// Its values in the first message, in their order.
    values: Vec<String>,
    /// Whether they are different in one message, and the same in all messages.
    tells: bool,
}

/// The arrays of messages of a type that hold arrays of numbers.
pub(super) fn watches(tree: &TypeTree) -> Vec<ElementWatch> {
    let of_field = |field: &FieldDefinition| {
        let BaseType::Message(name) = &field.ty.base else { return None };
        let inner = tree.dependencies().find(|inner| inner.type_name == *name)?;
        let holds_array = |field: &FieldDefinition| {
            field.ty.arity != Arity::One && matches!(field.ty.base, BaseType::Primitive(_) | BaseType::Message(_))
        };
        if field.ty.arity == Arity::One || !inner.fields.iter().any(holds_array) {
            return None;
        }
        let key = |of: &FieldDefinition| KeyWatch::of(tree, &field.name, of);
        let keys = inner.fields.iter().filter_map(key).collect();
        Some(ElementWatch { array: field.name.clone(), keys, n_seen: 0, counts: [0, 0] })
    };
    tree.root().fields.iter().filter_map(of_field).collect()
}

impl KeyWatch {
    fn of(tree: &TypeTree, array: &str, field: &FieldDefinition) -> Option<Self> {
        let is_text = matches!(field.ty.base, BaseType::Text { .. });
        let is_number = matches!(
            field.ty.base,
            BaseType::Primitive(primitive) if !matches!(primitive, Primitive::Float32 | Primitive::Float64 | Primitive::Bool)
        );
        if field.ty.arity != Arity::One || !(is_text || is_number) {
            return None;
        }
        let read_as = if is_text { ReadAs::Texts } else { ReadAs::Numbers };
        let plan = FieldPlan::compile(tree, &format!("{array}[].{}", field.name), read_as).ok()?;
        Some(KeyWatch { field: field.name.clone(), plan, is_text, values: Vec::new(), tells: true })
    }

    /// The values of a message; none where it can't be read, which is counted elsewhere.
    fn read(&self, cdr: &[u8], numbers: &mut Vec<f64>) -> Option<Vec<String>> {
        if self.is_text {
            let mut texts = Vec::new();
            self.plan.read_texts(cdr, &mut texts).ok()?;
            return Some(texts);
        }
        numbers.clear();
        self.plan.read_f64(cdr, numbers).ok()?;
        Some(numbers.iter().map(|number| number.to_string()).collect())
    }

    fn handle(&mut self, values: Vec<String>, is_first: bool) {
        let sorted = |values: &[String]| {
            let mut sorted = values.to_vec();
            sorted.sort();
            sorted
        };
        let now = sorted(&values);
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        let is_plain = |value: &String| !value.is_empty() && value.len() <= 64 && value.chars().all(plain);
        self.tells &= now.windows(2).all(|pair| pair[0] != pair[1]) && values.iter().all(is_plain);
        self.tells &= is_first || now == sorted(&self.values);
        if is_first {
            self.values = values;
        }
    }
}

impl ElementWatch {
    /// Takes in a message.
    pub(super) fn handle(&mut self, cdr: &[u8], numbers: &mut Vec<f64>) {
        let mut count = None;
        let is_first = self.n_seen == 0;
        // The first field that can be read counts the elements; the others go on as long as they tell something.
        for key in &mut self.keys {
            if !key.tells && count.is_some() {
                continue;
            }
            let Some(values) = key.read(cdr, numbers) else { continue };
            count.get_or_insert(values.len());
            if values.len() > MAX_ELEMENTS {
                key.tells = false;
            }
            if key.tells {
                key.handle(values, is_first);
            }
        }
        let Some(count) = count else { return };
        let [fewest, most] = if is_first { [count, count] } else { self.counts };
        self.counts = [fewest.min(count), most.max(count)];
        self.n_seen += 1;
    }

    /// The elements, where messages always have as many, and several.
    pub(super) fn seen(&self) -> Option<Elements> {
        let [fewest, most] = self.counts;
        if self.n_seen == 0 || fewest != most || !(2..=MAX_ELEMENTS).contains(&most) {
            return None;
        }
        let is_key = |key: &&KeyWatch| key.tells && hints::found(&key.field, KEYS).is_some();
        let key = self.keys.iter().find(is_key).map(|key| (key.field.clone(), key.values.clone()));
        Some(Elements { array: self.array.clone(), n: most as u64, key })
    }
}
