//! Decodes annotations, and finds the spans of a recording that they mark.

use crate::bag::printable;
use crate::eval::{StageSpan, ZeroLoad};
use crate::msg::{Header, Stage};
use crate::protocol::{Annotation, Annotations};
use crate::units::Stamp;

impl From<Stage> for Annotation {
    fn from(stage: Stage) -> Self {
        Annotation {
            from: stage.header.stamp.into(),
            stage: stage.stage,
            substage: printable(&stage.substage),
            pose: printable(&stage.pose),
            repetition: stage.repetition,
            zero_load: stage.zero_load,
        }
    }
}

impl From<Annotation> for Stage {
    fn from(annotation: Annotation) -> Self {
        Stage {
            header: Header { stamp: annotation.from.into(), frame_id: String::new() },
            stage: annotation.stage,
            substage: annotation.substage,
            pose: annotation.pose,
            repetition: annotation.repetition,
            zero_load: annotation.zero_load,
        }
    }
}

/// The spans of each stage, up to `end`, for [`Split::cuts`](crate::eval::Split::cuts).
pub fn stage_spans(annotations: &Annotations, end: Stamp) -> Vec<StageSpan<'static>> {
    const STAGES: [&str; 4] = ["outside", "1", "2", "3"];
    let stage = |annotation: &Annotation| STAGES.get(usize::from(annotation.stage)).copied().unwrap_or("other");
    let spans = annotations.spans(end);
    spans.map(|(annotation, to)| StageSpan { from: annotation.from, to, stage: stage(annotation) }).collect()
}

/// The spans without load. The last one ends at `end` if nothing ends it before.
///
/// Adjacent spans are not merged, so that the tare follows a drift within a long zero-load stage.
pub fn zero_load(annotations: &Annotations, end: Stamp) -> Vec<ZeroLoad> {
    let stretches = annotations.spans(end).filter(|(annotation, to)| annotation.zero_load && *to > annotation.from);
    stretches.map(|(annotation, to)| ZeroLoad { from: annotation.from, to }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretch_without_load_ends_with_the_next_annotation_or_the_recording() {
        let mut annotations = Annotations::default();
        for (from, zero_load) in [(100, true), (200, false), (300, true)] {
            annotations.handle(Annotation { zero_load, ..Annotation::outside(Stamp(from)) });
        }
        let at = |from, to| ZeroLoad { from: Stamp(from), to: Stamp(to) };
        assert_eq!(zero_load(&annotations, Stamp(400)), [at(100, 200), at(300, 400)]);
        assert_eq!(zero_load(&annotations, Stamp(300)), [at(100, 200)]);
    }
}
