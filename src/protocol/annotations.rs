//! The annotations of a recording: each task and its time.

use crate::units::Stamp;

/// An annotation that holds from a stamp until the next annotation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Annotation {
    /// Start of the annotation.
    pub from: Stamp,
    /// Stage of the protocol, 1 to 3; 0 outside of it.
    pub stage: u8,
    /// Substage, empty outside of one.
    pub substage: String,
    /// Instructed pose or movement, empty when free.
    pub pose: String,
    /// Repetition of the pose within the substage, from 0.
    pub repetition: u16,
    /// True if nothing touches the glove.
    pub zero_load: bool,
}

impl Annotation {
    /// An annotation without a task: between items, or to end the one before.
    pub fn outside(from: Stamp) -> Self {
        Annotation { from, stage: 0, substage: String::new(), pose: String::new(), repetition: 0, zero_load: false }
    }
}

/// All annotations of a recording, sorted by stamp. If two have the same stamp, the one added later counts.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Annotations(Vec<Annotation>);

impl Annotations {
    /// Adds an annotation, in any order.
    pub fn handle(&mut self, annotation: Annotation) {
        match self.0.binary_search_by_key(&annotation.from, |known| known.from) {
            Ok(at) => self.0[at] = annotation,
            Err(at) => self.0.insert(at, annotation),
        }
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All of them, in the order of their stamps.
    pub fn all(&self) -> &[Annotation] {
        &self.0
    }

    /// The annotation that holds at a stamp; `None` before the first.
    pub fn at(&self, stamp: Stamp) -> Option<&Annotation> {
        self.idx_at(stamp).map(|idx| &self.0[idx])
    }

    /// Index of the annotation that holds at a stamp; `None` before the first.
    pub fn idx_at(&self, stamp: Stamp) -> Option<usize> {
        self.0.partition_point(|annotation| annotation.from <= stamp).checked_sub(1)
    }

    /// Each annotation and its end; the last one ends at `end`.
    pub fn spans(&self, end: Stamp) -> impl Iterator<Item = (&Annotation, Stamp)> {
        self.0.iter().zip(self.0.iter().skip(1).map(|next| next.from).chain([end]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_annotation_holds_from_its_stamp_to_the_next_whatever_the_order_of_arrival() {
        let mut annotations = Annotations::default();
        for (from, stage) in [(200, 2), (100, 9), (300, 3), (100, 1)] {
            annotations.handle(Annotation { stage, ..Annotation::outside(Stamp(from)) });
        }
        let stage = |at| annotations.at(Stamp(at)).map(|annotation| annotation.stage);
        assert_eq!([99, 100, 199, 200, 5000].map(stage), [None, Some(1), Some(1), Some(2), Some(3)]);
        let ends: Vec<i64> = annotations.spans(Stamp(400)).map(|(_, end)| end.0).collect();
        assert_eq!(ends, [200, 300, 400]);
    }
}
