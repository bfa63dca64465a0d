//! Which arrays are taxels.

use std::collections::BTreeSet;

use super::ask::{Chooser, InitError, Question};
use super::groups::{self, Group};
use super::plan::{ModelFile, TaxelSource, free_name, listed, most_seen};
use super::{fingers, sides};
use crate::inspect::{BagReport, ForceCandidate, Likelihood, TactileCandidate, number, source_name};

/// Correlation with the measured force, and skewness, from which on they tell the sign.
const FOLLOWS: f64 = 0.3;
const SKEWED: f64 = 0.5;

/// The sources of taxels.
pub(super) fn sources(
    bags: &[BagReport],
    model: Option<&ModelFile>,
    chooser: &mut Chooser<'_>,
) -> Result<Vec<TaxelSource>, InitError> {
    let all: Vec<&TactileCandidate> =
        most_seen(bags, |bag| &bag.candidates.tactile, |one| (&one.topic, &one.field, one.n_messages));
    let usable: Vec<&TactileCandidate> =
        all.iter().copied().filter(|one| changes(one) && !is_rather_a_force(one, bags)).collect();
    let likeliest = usable.iter().map(|one| one.likelihood).min();
    let found: Vec<&TactileCandidate> = match likeliest {
        Some(Likelihood::Likely) => of(&usable, Likelihood::Likely),
        Some(Likelihood::Possible) => of(&usable, Likelihood::Possible),
        Some(Likelihood::Unlikely) | None => return Err(none(bags, &all)),
    };
    let mut found = grouped(&found, model)?;
    found.sort_by_key(|one| rank(one));
    let mut why = Vec::new();
    let places: BTreeSet<(&str, &str)> = found.iter().map(Group::place).collect();
    if places.len() > 1 && !are_fingers(&found) {
        let mut firsts: Vec<&Group<'_>> = Vec::new();
        for one in &found {
            if firsts.iter().all(|first| first.place() != one.place()) {
                firsts.push(one);
            }
        }
        let options: Vec<String> = firsts.iter().map(|one| told(one)).collect();
        let because = "the first by type, by the axis that a press changes most (z), and by how many taxels change";
        let words = "Which array holds the taxels?".to_owned();
        let question = Question { words, options: options.clone(), likeliest: 0, because: because.to_owned() };
        let choice = chooser.choose(question)?;
        let others: Vec<String> =
            options.iter().enumerate().filter(|(idx, _)| *idx != choice.idx).map(|(_, told)| told.clone()).collect();
        why.push(format!("{}; the others: {}", choice.told(because), listed(&others)));
        let (topic, field) = firsts[choice.idx].place();
        let (topic, field) = (topic.to_owned(), field.to_owned());
        found.retain(|one| one.place() == (&topic, &field));
    }
    let has_one_topic = found.iter().all(|one| one.found.topic == found[0].found.topic);
    let n_found = found.len();
    let mut sources: Vec<TaxelSource> = Vec::new();
    for one in found {
        let name = &one.found.parameters.name;
        let wanted = match (finger_of(&one), &one.label) {
            (Some(finger), _) if n_found > 1 && has_one_topic => format!("{name}_{finger}"),
            (None, Some(label)) if n_found > 1 => source_name(&format!("{name}_{label}")),
            _ => name.clone(),
        };
        let taken: Vec<&str> = sources.iter().map(|source| source.name.as_str()).collect();
        let side = sides::line(one.found.sides.as_ref(), &one.found.topic, None, chooser)?;
        sources.push(TaxelSource {
            name: free_name(&wanted, &taken),
            n_taxels: one.found.n_taxels.and_then(|n| usize::try_from(n).ok()).unwrap_or_default(),
            finger: finger_of(&one),
            hand: hand_of(&one),
            label: one.label.clone(),
            more: side.into_iter().collect(),
            sign: sign(one.main, bags),
            why: why.iter().cloned().chain(reasons(&one)).collect(),
            found: one.found,
        });
    }
    Ok(sources)
}

/// The arrays that belong together as one source, as far as they fit the model.
fn grouped<'a>(found: &[&'a TactileCandidate], model: Option<&ModelFile>) -> Result<Vec<Group<'a>>, InitError> {
    let [whole, elements, singles] = groups::ways(found);
    let Some(model) = model else { return Ok(whole) };
    let wanted = model.n_taxels as u64;
    let is_as_large = |one: &Group<'_>| one.n_taxels().saturating_sub(one.found.taxels.missing.len() as u64) == wanted;
    for mut way in [whole, elements] {
        way.retain(is_as_large);
        if !way.is_empty() {
            return Ok(way);
        }
    }
    let counts: BTreeSet<u64> = singles.iter().map(Group::n_taxels).collect();
    let mut fitting = singles;
    fitting.retain(|one| is_as_large(one) || one.n_taxels().is_multiple_of(wanted));
    if fitting.is_empty() {
        let got = counts.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
        return Err(InitError::Model { model: model.path.clone(), expected: model.n_taxels, got });
    }
    Ok(fitting)
}

/// Whether an array is a sensor's: of fixed length and alive.
fn changes(one: &TactileCandidate) -> bool {
    one.likelihood != Likelihood::Unlikely && one.n_taxels.is_some_and(|n| n > 0) && !is_constant(one)
}

/// Whether a topic speaks for a force sensor more than for taxels.
fn is_rather_a_force(one: &TactileCandidate, bags: &[BagReport]) -> bool {
    bags.iter().any(|bag| bag.candidates.is_rather_a_force(one))
}

/// Whether no taxel ever changes.
fn is_constant(one: &TactileCandidate) -> bool {
    one.taxels.skew.is_none()
        && one.n_taxels.is_some_and(|n| (one.taxels.constant.len() + one.taxels.missing.len()) as u64 >= n)
}

fn of<'a>(all: &[&'a TactileCandidate], likelihood: Likelihood) -> Vec<&'a TactileCandidate> {
    all.iter().copied().filter(|one| one.likelihood == likelihood).collect()
}

fn none(bags: &[BagReport], all: &[&TactileCandidate]) -> InitError {
    let names = bags.iter().map(|bag| bag.path.clone()).collect::<Vec<_>>().join(", ");
    let constant = |one: &TactileCandidate| match one {
        one if is_constant(one) => "; none of its taxels ever changes",
        one if is_rather_a_force(one, bags) => {
            "; it is more likely a force sensor (if it is not, tpf inspect prints its lines for a parameter file)"
        }
        _ => "",
    };
    let because =
        |one: &&TactileCandidate| format!("{} ({}): {}{}", one.topic, one.field, one.reasons.join("; "), constant(one));
    let why = match all.first().map(because) {
        None => "no topic that was looked at has an array that may be taxels".to_owned(),
        Some(first) if all.len() == 1 => format!("the only array of numbers is {first}"),
        Some(first) => format!("none of {} arrays looks like taxels, the first: {first}", all.len()),
    };
    let unread = bags.iter().flat_map(|bag| &bag.topics);
    let unread: Vec<String> = unread
        .filter_map(|topic| {
            let reason = topic.unread.as_ref()?;
            Some(format!("{} [{}]: {reason}", topic.stats.topic, topic.stats.type_name))
        })
        .collect();
    let why = match unread.as_slice() {
        [] => why,
        [only] => format!("{why}; 1 topic could not be looked into: {only}"),
        [first, ..] => format!("{why}; {} topics could not be looked into, the first: {first}", unread.len()),
    };
    InitError::NoTaxels { bags: names, why: why.replace(|c: char| c.is_control(), " ") }
}

/// Rank of a candidate among several: our own type, then a press (z) before shear, then live taxels, then rate.
fn rank(one: &Group<'_>) -> (bool, bool, std::cmp::Reverse<u64>, std::cmp::Reverse<u64>) {
    let one = one.main;
    let is_ours = one.type_name == "tactile_pose_fusion/msg/TaxelArray";
    let last = one.field.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    let is_shear = last.ends_with('x') || last.ends_with('y');
    let dead = (one.taxels.constant.len() + one.taxels.missing.len()) as u64;
    let rate = one.sample_rate_hz.map_or(0, |rate| rate.round() as u64);
    let live = one.n_taxels.unwrap_or_default().saturating_sub(dead);
    (!is_ours, is_shear, std::cmp::Reverse(live), std::cmp::Reverse(rate))
}

fn told(one: &Group<'_>) -> String {
    let main = one.main;
    let rate = main.sample_rate_hz.map_or(String::new(), |rate| format!(" at {} Hz", number(rate)));
    format!("{} ({}), {} taxels{rate}", main.topic, main.field, main.n_taxels.unwrap_or_default())
}

fn finger_of(one: &Group<'_>) -> Option<&'static str> {
    fingers::finger(&one.found.field).or_else(|| fingers::finger(&one.found.topic))
}

fn hand_of(one: &Group<'_>) -> Option<&'static str> {
    fingers::side(&one.found.field).or_else(|| fingers::side(&one.found.topic))
}

/// Whether each is named after another finger, or another hand's.
fn are_fingers(found: &[Group<'_>]) -> bool {
    let named: BTreeSet<(Option<&str>, &str)> =
        found.iter().filter_map(|one| Some((hand_of(one), finger_of(one)?))).collect();
    named.len() == found.len()
}

fn reasons(group: &Group<'_>) -> Vec<String> {
    let one = group.main;
    let word = if one.likelihood == Likelihood::Likely { "likely" } else { "CHECK: possible" };
    let mut why = vec![format!("{word}: {}", one.reasons.join("; "))];
    let values = one
        .values
        .map_or(String::new(), |[least, most]| format!(", {} to {}", number(least.into()), number(most.into())));
    let rate = one.sample_rate_hz.map_or(String::new(), |rate| format!(", {} samples a second", number(rate)));
    why.push(format!("{} of {} values a message{values}{rate}", one.element, one.n_values[1]));
    why.extend(group.why.iter().cloned());
    why
}

/// Which way a press goes: 1 or -1, and why.
fn sign(one: &TactileCandidate, bags: &[BagReport]) -> (i32, String) {
    let name = format!("{} ({})", one.topic, one.field);
    let forces = bags.iter().flat_map(|bag| &bag.candidates.force);
    let forces = forces.filter(|force| force.likelihood != Likelihood::Unlikely);
    let with = |force: &ForceCandidate| -> Vec<(f64, String)> {
        let of_these = force.ranges.iter().filter(|range| range.taxels.as_ref() == Some(&name));
        let press = |[least, most]: [f64; 2]| if -least > most { -1.0 } else { 1.0 };
        let told = |range: &crate::inspect::ForceRange| {
            let sign = if press(range.values) < 0.0 { "minus " } else { "" };
            Some((range.with_taxels? * press(range.values), format!("{sign}{} of {}", range.field, force.topic)))
        };
        of_these.filter_map(told).collect()
    };
    let best = forces.flat_map(with).max_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()));
    if let Some((with, force)) = best.filter(|(with, _)| with.abs() >= FOLLOWS) {
        return match with > 0.0 {
            true => (1, format!("readings rise with {force} (correlation {with:.2})")),
            false => (-1, format!("readings fall where {force} rises (correlation {with:.2})")),
        };
    }
    match one.taxels.skew {
        Some(skew) if skew >= SKEWED => {
            (1, format!("CHECK: readings rise now and then (skewness {skew:.1}), as under a press"))
        }
        Some(skew) if skew <= -SKEWED => {
            (-1, format!("CHECK: readings fall now and then (skewness {skew:.1}), as under a press"))
        }
        _ => (1, "CHECK: nothing tells; -1 where a lower reading means more pressure".to_owned()),
    }
}
