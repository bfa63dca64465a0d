//! Which topics tell the true force.

use super::ask::{Chooser, InitError, Question};
use super::fingers;
use super::plan::{ModelFile, Region, TruthSource, most_seen};
use crate::inspect::{BagReport, ForceCandidate, ForceRange, Likelihood, number, source_name, yaml_text};

/// A force beyond this is in gF: no fingertip presses with 100 N.
const MOST_NEWTONS: f64 = 100.0;

/// Correlation with the taxels from which on a number goes with them.
const FOLLOWS: f64 = 0.3;

const WRENCH_STAMPED: &str = "geometry_msgs/msg/WrenchStamped";

/// The sources of true force, and what else could be one.
pub(super) fn sources(
    bags: &[BagReport],
    model: Option<&ModelFile>,
    chooser: &mut Chooser<'_>,
) -> Result<(Vec<TruthSource>, Vec<String>), InitError> {
    let field = |one: &ForceCandidate| one.fields.first().map_or("", String::as_str).len() as u64;
    let all: Vec<&ForceCandidate> = most_seen(
        bags,
        |bag| &bag.candidates.force,
        |one| (&one.topic, &one.type_name, one.n_messages.max(field(one))),
    );
    let is_read = |one: &&&ForceCandidate| !one.ranges.is_empty();
    let likely: Vec<&ForceCandidate> =
        all.iter().filter(is_read).filter(|one| one.likelihood == Likelihood::Likely).copied().collect();
    let possible: Vec<&ForceCandidate> =
        all.iter().filter(is_read).filter(|one| one.likelihood == Likelihood::Possible).copied().collect();
    // A number of a driver's own type is a force where the taxels go with it.
    let follows = |one: &ForceCandidate| best(one).and_then(|range| range.with_taxels).map_or(0.0, f64::abs);
    let following = possible.iter().filter(|one| follows(one) >= FOLLOWS && !is_of_device(one, bags));
    let following = following.max_by(|a, b| follows(a).total_cmp(&follows(b))).copied();
    let likely = if likely.is_empty() { following.into_iter().collect() } else { likely };
    let is_taken = |one: &ForceCandidate| likely.iter().any(|taken| std::ptr::eq(*taken, one));
    let others = possible.iter().filter(|one| !is_taken(one));
    let others = others.map(|one| format!("{} ({})", one.topic, one.fields.join(", "))).collect();
    let fingers: std::collections::BTreeSet<&str> =
        likely.iter().filter_map(|one| fingers::finger(&one.topic)).collect();
    let mut why = None;
    let chosen = if likely.len() > 1 && fingers.len() < likely.len() {
        let options = likely.iter().map(|one| one.topic.clone()).collect();
        let likeliest =
            (0..likely.len()).max_by(|a, b| follows(likely[*a]).total_cmp(&follows(likely[*b]))).unwrap_or(0);
        let because = "it goes with the taxels best".to_owned();
        let words = "Which topic tells the true force?".to_owned();
        let choice = chooser.choose(Question { words, options, likeliest, because: because.clone() })?;
        why = Some(choice.told(&because));
        vec![likely[choice.idx]]
    } else {
        likely
    };
    let has_axes = model.is_some_and(|model| model.n_force_axes == 3);
    Ok((chosen.into_iter().map(|one| source(one, why.clone(), has_axes, bags)).collect(), others))
}

/// Whether the topic holds taxels, too: what a tactile sensor says of forces is no true force.
fn is_of_device(one: &ForceCandidate, bags: &[BagReport]) -> bool {
    let mut taxels = bags.iter().flat_map(|bag| &bag.candidates.tactile);
    taxels.any(|taxels| taxels.topic == one.topic && taxels.likelihood != Likelihood::Unlikely)
}

/// Gives each region a force of its own finger. Where one load cell goes from finger to finger and its topic says which, a
/// recording may lack the topics of the others: a single source would count for them all, so theirs are named after it.
pub(super) fn for_other_fingers(truths: &mut Vec<TruthSource>, regions: &mut [Region]) {
    let [only] = truths.as_slice() else { return };
    let Some(known) = only.finger.filter(|_| regions.len() > 1) else { return };
    let only = only.clone();
    for region in regions {
        let Some(finger) = region.finger.filter(|finger| *finger != known) else { continue };
        let mut other = only.clone();
        let Some((_, topic, why)) = other.lines.first_mut().filter(|(_, topic, _)| topic.contains(known)) else {
            return;
        };
        *topic = topic.replace(known, finger);
        *why = format!("CHECK: not in these bags; named as that of the {known} finger");
        for (key, _, why) in other.lines.iter_mut().filter(|(key, _, why)| *key != "topic" && !why.is_empty()) {
            let check = if why.starts_with("CHECK") { "CHECK: " } else { "" };
            *why = format!("{check}{key} as that of the {known} finger");
        }
        other.name = only.name.replace(known, finger);
        other.finger = Some(finger);
        region.truth = Some(other.name.clone());
        truths.push(other);
    }
}

/// The number of a topic that is the force: what goes with the taxels best, else what spans most.
fn best(one: &ForceCandidate) -> Option<&ForceRange> {
    let span = |range: &ForceRange| range.values[1] - range.values[0];
    // A torque is in no unit of force: where six numbers come as an array, the last three.
    let place = |range: &ForceRange| range.field.strip_suffix(']')?.rsplit_once('[')?.1.parse::<usize>().ok();
    let is_torque = |range: &ForceRange| range.field.contains("torque") || place(range).is_some_and(|place| place > 2);
    let forces = || one.ranges.iter().filter(|range| !is_torque(range));
    let follows = |range: &&ForceRange| range.with_taxels.is_some_and(|with| with.abs() >= FOLLOWS);
    let by_taxels = |range: &&ForceRange| range.with_taxels.map_or(0.0, f64::abs);
    let following = forces().filter(follows).max_by(|a, b| by_taxels(a).total_cmp(&by_taxels(b)));
    following.or_else(|| forces().max_by(|a, b| span(a).total_cmp(&span(b))))
}

/// All three axes of a force sensor as the fields of a model's three axes: x, y and z of the patch, of which the last is the
/// one that is `pressed`. None where it has one axis alone.
fn axes(one: &ForceCandidate, pressed: &str) -> Option<[String; 3]> {
    let (stem, place) = match pressed.strip_suffix(']').and_then(|it| it.rsplit_once('[')) {
        Some((stem, place)) => (format!("{stem}["), place.parse().ok()?),
        None => {
            let (stem, axis) = pressed.split_at(pressed.len().checked_sub(1)?);
            (stem.to_owned(), "xyz".find(axis)?)
        }
    };
    let is_array = stem.ends_with('[');
    let named = |place: usize| match is_array {
        true => format!("{stem}{place}]"),
        false => format!("{stem}{}", ["x", "y", "z"][place]),
    };
    // In turn, so that they stay right-handed.
    let fields = [1, 2, 3].map(|after| named((place + after) % 3));
    (place < 3 && fields.iter().all(|field| one.ranges.iter().any(|range| range.field == *field))).then_some(fields)
}

fn source(one: &ForceCandidate, chosen: Option<String>, has_axes: bool, bags: &[BagReport]) -> TruthSource {
    let mut lines =
        vec![("topic", yaml_text(&one.topic), String::new()), ("type", yaml_text(&one.type_name), String::new())];
    if let Some(ForceRange { field, values: [least, most], with_taxels, .. }) = best(one) {
        let seen = format!("{} to {}", number(*least), number(*most));
        let with = with_taxels.map_or(String::new(), |with| format!("; correlation with the taxels {with:.2}"));
        let is_pressed = with_taxels.is_some_and(|with| with.abs() >= FOLLOWS);
        let axes = axes(one, field).filter(|_| has_axes);
        match &axes {
            Some(axes) => {
                let why = format!("CHECK: x, y and z of the patch; the last one is pressed: {seen}{with}");
                lines.push(("fields", format!("[{}]", axes.each_ref().map(|axis| yaml_text(axis)).join(", ")), why));
            }
            None if is_pressed => lines.push(("field", yaml_text(field), format!("{seen}{with}"))),
            None => {
                let why = format!(
                    "CHECK: no press was seen that the taxels feel, so a press may change another number: {seen}{with}"
                );
                lines.push(("field", yaml_text(field), why));
            }
        }
        let (unit, why) = unit(one, field, least.abs().max(most.abs()));
        lines.push(("unit", unit.to_owned(), why));
        // Noise goes as far down as up.
        if -least > *most && (is_pressed || -least > 2.0 * most.abs()) {
            let why = "CHECK: its force goes further down than up, so a press is taken to lower it".to_owned();
            match axes {
                Some(_) => lines.push(("signs", "[1, 1, -1]".to_owned(), why)),
                None => lines.push(("sign", "-1".to_owned(), why)),
            }
        }
    }
    if one.type_name != WRENCH_STAMPED {
        let topics = bags.iter().flat_map(|bag| &bag.topics).filter(|topic| topic.stats.topic == one.topic);
        match topics.filter_map(|topic| topic.stamps.as_ref()).next() {
            Some(stamps) => lines.push(("stamp", yaml_text(&stamps.field), String::new())),
            None => {
                let why = "the type has none, so the time of receipt counts".to_owned();
                lines.push(("stamp", "receipt".to_owned(), why));
            }
        }
    }
    let mut why: Vec<String> = chosen.into_iter().collect();
    let word =
        if one.likelihood == Likelihood::Likely { "likely" } else { "CHECK: possible, and the taxels go with it" };
    why.push(format!("{word}: {}", one.reasons.join("; ")));
    TruthSource { name: source_name(&one.topic), finger: fingers::finger(&one.topic), lines, why }
}

/// The unit of a force as YAML, and why.
fn unit(one: &ForceCandidate, field: &str, largest: f64) -> (&'static str, String) {
    let name = format!("{}/{field}", one.topic).to_ascii_lowercase();
    let says = |words: &[&str]| name.split(|c: char| !c.is_ascii_alphanumeric()).any(|word| words.contains(&word));
    if says(&["kgf", "kg", "kilogram", "kilograms"]) {
        return ("kgf", "its name says kilogram-force".to_owned());
    }
    if says(&["mn", "millinewton", "millinewtons"]) {
        return ("mN", "its name says mN".to_owned());
    }
    if says(&["gf", "grams", "gram", "g"]) {
        return ("gF", "its name says gram-force".to_owned());
    }
    if one.type_name.starts_with("geometry_msgs/msg/Wrench") {
        return ("\"N\"", "a wrench is in N".to_owned());
    }
    match largest > MOST_NEWTONS {
        true => ("gF", format!("CHECK: up to {}: no fingertip presses with more than 100 N", number(largest))),
        false => ("\"N\"", format!("CHECK: up to {}, as N are", number(largest))),
    }
}
