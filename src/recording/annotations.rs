//! What the protocol asked for, and when.

use crate::eval::{StageSpan, ZeroLoad};
use crate::msg::Stage;
use crate::units::Stamp;

/// What holds from a stamp until the next annotation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Annotation {
    /// From when on.
    pub from: Stamp,
    /// Stage of the protocol, 1 to 3; 0 outside of it.
    pub stage: u8,
    /// Substage, empty outside of one.
    pub substage: String,
    /// Instructed pose or movement, empty when free.
    pub pose: String,
    /// Repetition of the pose within the substage, from 0.
    pub repetition: u16,
    /// Whether nothing touches the glove.
    pub zero_load: bool,
}

/// All annotations of a recording, in the order of their stamps.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Annotations(Vec<Annotation>);

impl Annotations {
    /// Takes one more, in any order. Of two with one stamp the one that came later holds.
    pub fn handle(&mut self, stage: Stage) {
        let annotation = Annotation {
            from: stage.header.stamp.into(),
            stage: stage.stage,
            substage: stage.substage,
            pose: stage.pose,
            repetition: stage.repetition,
            zero_load: stage.zero_load,
        };
        let at = self.0.partition_point(|known| known.from <= annotation.from);
        self.0.insert(at, annotation);
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All of them, in the order of their stamps.
    pub fn all(&self) -> &[Annotation] {
        &self.0
    }

    /// The one that holds at a stamp; `None` before the first.
    pub fn at(&self, stamp: Stamp) -> Option<&Annotation> {
        self.idx_at(stamp).map(|idx| &self.0[idx])
    }

    /// Index of the one that holds at a stamp; `None` before the first.
    pub fn idx_at(&self, stamp: Stamp) -> Option<usize> {
        self.0.partition_point(|annotation| annotation.from <= stamp).checked_sub(1)
    }

    /// The stretches of each stage, up to `end`, for [`Split::cuts`](crate::eval::Split::cuts).
    pub fn stage_spans(&self, end: Stamp) -> Vec<StageSpan<'static>> {
        const STAGES: [&str; 4] = ["outside", "1", "2", "3"];
        let stage = |annotation: &Annotation| STAGES.get(usize::from(annotation.stage)).copied().unwrap_or("other");
        self.spans(end)
            .map(|(annotation, to)| StageSpan { from: annotation.from, to, stage: stage(annotation) })
            .collect()
    }

    /// The stretches without load; the last one ends at `end` if nothing else ends it.
    ///
    /// Neighbours stay apart, so that drift within a long zero-load stage is followed annotation by annotation.
    pub fn zero_load(&self, end: Stamp) -> Vec<ZeroLoad> {
        let stretches = self.spans(end).filter(|(annotation, to)| annotation.zero_load && *to > annotation.from);
        stretches.map(|(annotation, to)| ZeroLoad { from: annotation.from, to }).collect()
    }

    /// Each annotation and where it ends; the last one at `end`.
    fn spans(&self, end: Stamp) -> impl Iterator<Item = (&Annotation, Stamp)> {
        self.0.iter().zip(self.0.iter().skip(1).map(|next| next.from).chain([end]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::Header;

    fn stage(at: i64, substage: &str, zero_load: bool) -> Stage {
        Stage {
            header: Header { stamp: Stamp(at).into(), frame_id: String::new() },
            stage: 1,
            substage: substage.to_owned(),
            pose: String::new(),
            repetition: 0,
            zero_load,
        }
    }

    #[test]
    fn an_annotation_holds_from_its_stamp_to_the_next_whatever_the_order_of_arrival() {
        let mut annotations = Annotations::default();
        [stage(200, "b", false), stage(100, "a", true), stage(300, "c", true)]
            .into_iter()
            .for_each(|stage| annotations.handle(stage));
        let substage = |at| annotations.at(Stamp(at)).map(|annotation| annotation.substage.as_str());
        assert_eq!([99, 100, 199, 200, 5000].map(substage), [None, Some("a"), Some("a"), Some("b"), Some("c")]);
        let at = |from, to| ZeroLoad { from: Stamp(from), to: Stamp(to) };
        assert_eq!(annotations.zero_load(Stamp(400)), [at(100, 200), at(300, 400)]);
        assert_eq!(annotations.zero_load(Stamp(300)), [at(100, 200)]);
    }
}
