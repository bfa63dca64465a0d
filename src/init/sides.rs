//! Which of several hands on one topic.

use super::ask::{Chooser, InitError, Question};
use super::fingers;
use crate::inspect::{Sides, yaml_text};

/// The key `only`, its value and its reason, where a topic carries several hands; nothing where inspection says it already.
pub(super) fn line(
    sides: Option<&Sides>,
    topic: &str,
    worn: Option<&str>,
    chooser: &mut Chooser<'_>,
) -> Result<Option<(&'static str, String, String)>, InitError> {
    let Some(Sides { field, values }) = sides.filter(|sides| sides.values.len() > 1) else { return Ok(None) };
    let of = |wanted: &str| values.iter().position(|value| fingers::side(value) == Some(wanted));
    let known = worn.or_else(|| fingers::side(topic)).and_then(of);
    let (idx, why) = match known {
        Some(idx) => (idx, "as the topic of the taxels is named".to_owned()),
        None => {
            let likeliest = of("right").unwrap_or(0);
            let because = match values.len() {
                2 => "messages of both hands are on the topic".to_owned(),
                n => format!("messages of {n} devices are on the topic"),
            };
            let options = values.iter().map(|value| format!("{field}={value}")).collect();
            let words = format!("Which messages of {topic} are those of your glove?");
            let choice = chooser.choose(Question { words, options, likeliest, because: because.clone() })?;
            (choice.idx, choice.told(&because))
        }
    };
    Ok(Some(("only", yaml_text(&format!("{field}={}", values[idx])), why)))
}
