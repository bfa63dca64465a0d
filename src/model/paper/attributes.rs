//! Attributes of a node. Each is read once.

use std::collections::BTreeMap;

use crate::model::onnx::{AttributeProto, NodeProto, TensorProto};

/// `AttributeProto.AttributeType`.
mod kind {
    pub(super) const FLOAT: i32 = 1;
    pub(super) const INT: i32 = 2;
    pub(super) const STRING: i32 = 3;
    pub(super) const TENSOR: i32 = 4;
    pub(super) const INTS: i32 = 7;
}

/// Attributes that have not been read yet. One that is left at the end was not accounted for, and rules the network
/// out.
pub(in crate::model) struct Attributes<'g>(BTreeMap<&'g str, &'g AttributeProto>);

impl<'g> Attributes<'g> {
    /// Attributes of a node. `None` if a name occurs twice.
    pub(in crate::model) fn of(node: &'g NodeProto) -> Option<Self> {
        let by_name: BTreeMap<_, _> =
            node.attribute.iter().map(|attribute| (attribute.name.as_str(), attribute)).collect();
        (by_name.len() == node.attribute.len()).then_some(Attributes(by_name))
    }

    /// True if every attribute was read.
    pub(in crate::model) fn all_read(&self) -> bool {
        self.0.is_empty()
    }

    /// Takes an attribute. `None` if it is absent, `Some(None)` if it has another type.
    fn take(&mut self, name: &str, kind: i32) -> Option<Option<&'g AttributeProto>> {
        self.0.remove(name).map(|attribute| (attribute.r#type == kind).then_some(attribute))
    }

    /// An integer attribute. A missing value counts as 0, because some writers omit zeros.
    pub(in crate::model) fn int(&mut self, name: &str, default: i64) -> Option<i64> {
        self.take(name, kind::INT).map_or(Some(default), |found| Some(found?.i.unwrap_or(0)))
    }

    /// True if an integer attribute, or its default, has the expected value.
    pub(in crate::model) fn is(&mut self, name: &str, expected: i64) -> bool {
        self.int(name, expected) == Some(expected)
    }

    pub(in crate::model) fn float(&mut self, name: &str, default: f32) -> Option<f32> {
        self.take(name, kind::FLOAT).map_or(Some(default), |found| Some(found?.f.unwrap_or(0.0)))
    }

    /// True if a string attribute, or its default, has the expected value.
    pub(in crate::model) fn says(&mut self, name: &str, expected: &str) -> bool {
        let said = self.text(name, expected);
        said.is_some_and(|said| said == expected.as_bytes())
    }

    pub(in crate::model) fn text<'d>(&mut self, name: &str, default: &'d str) -> Option<&'d [u8]>
    where
        'g: 'd,
    {
        let found = self.take(name, kind::STRING);
        found.map_or(Some(default.as_bytes()), |found| Some(found?.s.as_deref().unwrap_or_default()))
    }

    /// An integer list. `None` if the attribute has another type, `Some(None)` if it is absent.
    pub(in crate::model) fn ints(&mut self, name: &str) -> Option<Option<&'g [i64]>> {
        match self.take(name, kind::INTS) {
            None => Some(None),
            Some(found) => Some(Some(found?.ints.as_slice())),
        }
    }

    /// True if an integer list has the expected value, or is absent because that is its default.
    pub(in crate::model) fn are(&mut self, name: &str, expected: &[i64]) -> bool {
        self.ints(name).is_some_and(|found| found.is_none_or(|found| found == expected))
    }

    pub(in crate::model) fn tensor(&mut self, name: &str) -> Option<&'g TensorProto> {
        self.take(name, kind::TENSOR)??.t.as_ref()
    }
}
