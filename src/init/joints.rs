//! Which topics are the joint angles of the hand.

use std::cmp::Reverse;

use super::ask::{Chooser, InitError, Question};
use super::fingers;
use super::plan::{JointSource, ModelFile, TaxelSource, free_name, listed, most_seen};
use crate::hand::JOINTS;
use crate::inspect::{BagReport, HandCandidate, JointCandidate, Likelihood, Sides, number};

/// Most angles that no name ties to a finger and that are still taken: those of one finger or a gripper.
pub(super) const MAX_UNNAMED: usize = 8;

/// Least way of an angle that moves: 1 degree in rad, and much less than one count of most encoders.
const MOVES: f32 = 0.017;

/// A candidate and what speaks for it.
struct Found<'a> {
    source: JointSource<'a>,
    has_model_joints: bool,
    names_fingers: bool,
    moves: bool,
    is_likely: bool,
    hand: Option<&'static str>,
    rate_hz: f64,
    topic: String,
    sides: Option<&'a Sides>,
    told: String,
}

/// The sources of joint angles, and what is there but not taken.
pub(super) fn sources<'a>(
    bags: &'a [BagReport],
    taxels: &[TaxelSource],
    model: Option<&ModelFile>,
    chooser: &mut Chooser<'_>,
) -> Result<(Vec<JointSource<'a>>, Vec<String>), InitError> {
    if model.is_some_and(|model| model.n_joints == 0) {
        return Ok((Vec::new(), vec!["the model takes no joint angles".to_owned()]));
    }
    let worn = taxels.first().and_then(|source| source.hand);
    let mut found = Vec::new();
    for one in most_seen(bags, |bag| &bag.candidates.joints, |one| (&one.topic, &one.field, one.n_messages)) {
        if one.likelihood != Likelihood::Unlikely && !one.angles.is_empty() {
            found.push(of_angles(one, model));
        }
    }
    for one in most_seen(bags, |bag| &bag.candidates.hands, |one| (&one.topic, &one.field, one.n_messages)) {
        if one.likelihood == Likelihood::Likely {
            found.push(of_hand(one, model));
        }
    }
    found.retain(|one| worn.is_none() || one.hand.is_none() || one.hand == worn);
    found.sort_by_key(|one| {
        let rate = Reverse((one.rate_hz * 10.0).round() as u64);
        (!one.has_model_joints, !one.names_fingers, !one.moves, one.source.is_whole_hand, !one.is_likely, rate)
    });
    let is_use = |one: &Found<'_>| one.has_model_joints || one.names_fingers || one.source.joints.len() <= MAX_UNNAMED;
    let (mut use_, left): (Vec<_>, Vec<_>) = found.into_iter().partition(is_use);
    let mut others: Vec<String> =
        left.iter().map(|one| format!("{}: none of its joints names a finger", one.told)).collect();
    if use_.is_empty() {
        return Ok((Vec::new(), others));
    }
    let level = |one: &Found<'_>| (one.has_model_joints, one.names_fingers, one.moves, one.source.is_whole_hand);
    let best = level(&use_[0]);
    let alike = use_.iter().take_while(|one| level(one) == best).count();
    let rest = use_.split_off(alike);
    others.extend(rest.iter().map(|one| format!("{}: less likely", one.told)));
    let is_apart = |a: &Found<'_>, b: &Found<'_>| a.source.joints.iter().all(|joint| !b.source.joints.contains(joint));
    let all_apart = use_.iter().enumerate().all(|(k, a)| use_[..k].iter().all(|b| is_apart(a, b)));
    if !all_apart || (use_.len() > 1 && !best.1) {
        let options = use_.iter().map(|one| one.told.clone()).collect();
        let because = "the first by what it names, how likely it is, and by rate".to_owned();
        let words = "Which topic holds the joint angles?".to_owned();
        let choice = chooser.choose(Question { words, options, likeliest: 0, because: because.clone() })?;
        let mut chosen = use_.swap_remove(choice.idx);
        chosen.source.why.insert(0, choice.told(&because));
        use_ = vec![chosen];
    }
    let mut sources: Vec<JointSource<'a>> = Vec::new();
    for one in use_ {
        let Found { hand, mut source, topic, sides, told, .. } = one;
        let only = super::sides::line(sides, &topic, worn, chooser)?;
        if source.is_whole_hand {
            let of_messages = match &only {
                Some((_, only, _)) => fingers::side(only),
                None => sides.and_then(|sides| fingers::side(&sides.values[0])),
            };
            let named = match of_messages {
                Some(side) => Some((side, "as its messages say")),
                None => hand.map(|side| (side, "as it is named")).or(worn.map(|side| (side, "as the taxels are"))),
            };
            source.more.push(side(&told, named, chooser)?);
        }
        source.more.extend(only);
        let taken: Vec<&str> = sources.iter().map(|known| known.name.as_str()).collect();
        source.name = free_name(&source.name, &taken);
        sources.push(source);
    }
    Ok((sources, others))
}

fn has_all(joints: &[String], model: Option<&ModelFile>) -> bool {
    let mut wanted = model.into_iter().flat_map(|model| model.joints.iter().chain(model.regions.values()));
    wanted.any(|wanted| wanted.iter().all(|joint| joints.contains(joint)))
}

fn of_angles<'a>(one: &'a JointCandidate, model: Option<&ModelFile>) -> Found<'a> {
    let name = |(idx, angle): (usize, &crate::inspect::Angle)| match &angle.name {
        Some(name) if one.is_named => name.clone(),
        _ => format!("joint_{idx}"),
    };
    let joints: Vec<String> = one.angles.iter().enumerate().map(name).collect();
    let span = |angle: &crate::inspect::Angle| angle.values.map_or(0.0, |[least, most]| most - least);
    let moves = one.angles.iter().any(|angle| span(angle) > MOVES);
    let word = if one.likelihood == Likelihood::Likely { "likely" } else { "CHECK: possible" };
    let mut why = vec![format!("{word}: {}", one.reasons.join("; "))];
    why.push(format!("it names {}", listed(&joints)));
    let still: Vec<String> = joints
        .iter()
        .zip(&one.angles)
        .filter(|(_, angle)| span(angle) <= MOVES)
        .map(|(name, _)| name.clone())
        .collect();
    if !still.is_empty() {
        why.push(format!("these don't move here: {}", listed(&still)));
    }
    let told = format!(
        "{} ({}), {} angles at {} Hz",
        one.topic,
        one.field,
        joints.len(),
        number(one.rate_hz.unwrap_or_default())
    );
    Found {
        has_model_joints: has_all(&joints, model),
        names_fingers: joints.iter().any(|joint| fingers::finger(joint).is_some()),
        moves,
        is_likely: one.likelihood == Likelihood::Likely,
        hand: fingers::side(&one.topic).or(fingers::side(&one.field)),
        rate_hz: one.rate_hz.unwrap_or_default(),
        topic: one.topic.clone(),
        sides: one.sides.as_ref(),
        told,
        source: JointSource {
            name: one.parameters.name.clone(),
            lines: &one.parameters,
            more: Vec::new(),
            joints,
            is_whole_hand: false,
            is_named: one.is_named,
            why,
        },
    }
}

fn of_hand<'a>(one: &'a HandCandidate, model: Option<&ModelFile>) -> Found<'a> {
    let joints = JOINTS.map(str::to_owned).to_vec();
    let mut more = Vec::new();
    if one.hands.len() > 1 {
        let why = format!("CHECK: a message holds two hands, this is the first; {} is the second", one.hands[1]);
        more.push(("hand.first", one.hands[0].to_string(), why));
    }
    let told = format!("{} ({}), {} points of a hand", one.topic, one.field, one.n_points);
    Found {
        has_model_joints: has_all(&joints, model),
        names_fingers: true,
        moves: true,
        is_likely: true,
        hand: fingers::side(&one.topic).or(fingers::side(&one.field)),
        rate_hz: one.rate_hz.unwrap_or_default(),
        topic: one.topic.clone(),
        sides: one.sides.as_ref(),
        told,
        source: JointSource {
            name: one.parameters.name.clone(),
            lines: &one.parameters,
            more,
            joints,
            is_whole_hand: true,
            is_named: true,
            why: vec![
                format!("likely: {}", one.reasons.join("; ")),
                "joint angles are computed from these points".to_owned(),
            ],
        },
    }
}

/// Which hand points are of.
fn side(
    told: &str,
    named: Option<(&'static str, &'static str)>,
    chooser: &mut Chooser<'_>,
) -> Result<(&'static str, String, String), InitError> {
    if let Some((side, why)) = named {
        return Ok(("hand.side", side.to_owned(), why.to_owned()));
    }
    let words = format!("Which hand is {told}?");
    let options = vec!["right".to_owned(), "left".to_owned()];
    let because = "points don't tell left from right".to_owned();
    let choice = chooser.choose(Question { words, options, likeliest: 0, because: because.clone() })?;
    let side = if choice.idx == 0 { "right" } else { "left" };
    Ok(("hand.side", side.to_owned(), choice.told(&because)))
}
