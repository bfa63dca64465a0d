//! Whether a session is possible.

use super::super::hand::Finger;
use super::super::manipulation::Start;
use super::super::spec::{Activity, Fingers, SessionSpec};
use super::error::SimError;

/// Checks that such a session is possible.
pub(super) fn check(spec: &SessionSpec) -> Result<(), SimError> {
    let conditions = &spec.conditions;
    for (what, value, unit, from, to) in conditions.quantities() {
        if let Some(got) = value.filter(|value| !(from..=to).contains(value)) {
            return Err(SimError::Quantity { what, got, unit, from, to });
        }
    }
    if spec.activity == Activity::Protocol {
        let asked = [("episodes", !conditions.episodes.is_empty()), ("start", conditions.start != Start::default())];
        if let Some((what, _)) = asked.into_iter().find(|(_, asked)| *asked) {
            return Err(SimError::OnlyManipulation { what });
        }
    }
    let is_bare = |finger: &Finger| *finger != Finger::Index && conditions.fingers == Fingers::Index;
    if let Some(finger) = conditions.touching.filter(is_bare) {
        return Err(SimError::NoTaxels { finger: finger.name() });
    }
    let can_begin = conditions.episodes.is_empty() || conditions.episodes.iter().any(|episode| episode.is_held());
    match conditions.start == Start::InContact && !can_begin {
        true => Err(SimError::NothingHeld),
        false => Ok(()),
    }
}
