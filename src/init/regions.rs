//! Which patches the taxels make.

use super::ask::{Chooser, InitError, Question};
use super::fingers::{FINGERS, finger, on_finger};
use super::joints::MAX_UNNAMED;
use super::plan::{JointSource, ModelFile, Region, TaxelSource, TruthSource, free_name, listed};
use crate::inspect::{Elements, source_name};

/// Name of a patch that no name ties to a finger.
const PATCH: &str = "patch";

/// The patches of all sources.
pub(super) fn regions(
    sources: &[TaxelSource],
    joints: &[JointSource<'_>],
    truths: &[TruthSource],
    model: Option<&ModelFile>,
    chooser: &mut Chooser<'_>,
) -> Result<Vec<Region>, InitError> {
    let mut regions: Vec<Region> = Vec::new();
    let mut unknown: Vec<String> = Vec::new();
    for source in sources {
        for part in parts(source, joints, truths, model, chooser)? {
            let name = match (part.finger, &source.label) {
                (Some(finger), _) => finger.to_owned(),
                (None, Some(label)) if label.starts_with(|c: char| c.is_ascii_alphabetic()) => source_name(label),
                (None, Some(label)) => format!("{PATCH}_{}", label.replace('-', "_")),
                (None, None) => PATCH.to_owned(),
            };
            let name = source.hand.filter(|_| sources.len() > 1).map_or(name.clone(), |hand| format!("{hand}_{name}"));
            let taken: Vec<&str> = regions.iter().map(|region| region.name.as_str()).collect();
            let name = free_name(&name, &taken);
            if model.is_some_and(|model| !model.regions.is_empty() && !model.regions.contains_key(&name)) {
                unknown.push(name);
                continue;
            }
            let (own, model_joints) = region_joints(part.finger, joints, model);
            if let Some(model) = model.filter(|model| model.n_joints > 0 && own.is_empty()) {
                return Err(other_joints(model, &name, joints));
            }
            let unnamed = !model_joints.is_empty() && own.iter().all(|joint| finger(joint).is_none());
            let truth = truths.iter().find(|truth| truth.finger.is_some() && truth.finger == part.finger);
            let mut why = part.why;
            if unnamed {
                why.push("CHECK: which joint is which was taken from their order".to_owned());
            }
            if own.is_empty() && !joints.is_empty() {
                why.push("CHECK: no joint angles of this patch were found, so its model can take none".to_owned());
            }
            regions.push(Region {
                name,
                finger: part.finger,
                source: source.name.clone(),
                taxels: part.taxels,
                joints: own,
                model_joints,
                model: String::new(),
                truth: truth.map(|truth| truth.name.clone()),
                why,
            });
        }
    }
    if let (Some(model), [first, ..]) = (model, &unknown[..]) {
        let known = model.regions.keys().cloned().collect::<Vec<_>>().join(", ");
        if regions.is_empty() {
            return Err(InitError::ModelRegions { model: model.path.clone(), known, region: first.clone() });
        }
        chooser.guesses.push(format!(
            "left out: {}, because {} was trained on {known}; give them a region and a model of their own to have their forces",
            listed(&unknown),
            model.path
        ));
    }
    // Patches of one shape share a model until each has its own.
    let shares = model.is_some() || regions.len() == 1;
    for region in &mut regions {
        region.model = if shares { "fingertip".to_owned() } else { region.name.clone() };
    }
    Ok(regions)
}

/// A part of a source's taxels.
struct Part {
    finger: Option<&'static str>,
    taxels: Option<Vec<usize>>,
    why: Vec<String>,
}

fn parts(
    source: &TaxelSource,
    joints: &[JointSource<'_>],
    truths: &[TruthSource],
    model: Option<&ModelFile>,
    chooser: &mut Chooser<'_>,
) -> Result<Vec<Part>, InitError> {
    let n_taxels = source.n_taxels;
    let missing = &source.found.taxels.missing;
    let mut why = Vec::new();
    if !source.found.taxels.constant.is_empty() {
        why.push(format!("CHECK: these taxels never change here: {:?}", source.found.taxels.constant));
    }
    if !missing.is_empty() {
        why.push(format!("{} of {n_taxels} taxels never have a value and are left out", missing.len()));
    }
    let kept = |all: std::ops::Range<usize>| all.filter(|taxel_idx| !missing.contains(taxel_idx)).collect::<Vec<_>>();
    let named = named_fingers(joints, truths);
    let wanted = model.map_or(n_taxels, |model| model.n_taxels);
    let is_part = wanted < n_taxels && wanted != n_taxels - missing.len() && n_taxels.is_multiple_of(wanted);
    if source.finger.is_none() && is_part {
        let n_parts = n_taxels / wanted;
        why.insert(0, format!("the model takes {wanted} taxels, and there are {n_parts} times as many"));
        return Ok(split(n_parts, n_taxels, &named, &why, kept));
    }
    if let (None, Some(Elements { array, n, .. }), None) = (source.finger, &source.found.elements, model)
        && source.found.is_made_of(*n)
    {
        why.insert(0, format!("a patch for each of the {n} elements of {array}"));
        return Ok(split(*n as usize, n_taxels, &named, &why, kept));
    }
    if source.finger.is_none()
        && model.is_none()
        && named.len() > 1
        && n_taxels.is_multiple_of(named.len())
        && n_taxels > named.len()
    {
        let each = n_taxels / named.len();
        let words = format!("How do the {n_taxels} taxels of {} lie on the hand?", source.found.topic);
        let options =
            vec![format!("{each} on each of {}, in this order", named.join(", ")), "all on one patch".to_owned()];
        let because =
            format!("joints or force sensors of {} fingers are named, and {n_taxels} divide into them", named.len());
        let choice = chooser.choose(Question { words, options, likeliest: 0, because: because.clone() })?;
        why.insert(0, choice.told(&because));
        if choice.idx == 0 {
            return Ok(split(named.len(), n_taxels, &named, &why, kept));
        }
    }
    let finger = match source.finger {
        Some(finger) => {
            why.insert(0, "its finger by the name of the array".to_owned());
            Some(finger)
        }
        None => only_finger(source, joints, truths, model, &mut why, chooser)?,
    };
    let taxels = (!missing.is_empty()).then(|| kept(0..n_taxels));
    Ok(vec![Part { finger, taxels, why }])
}

/// So many parts of equal size, in the order of the fingers that are named.
fn split(
    n_parts: usize,
    n_taxels: usize,
    named: &[&'static str],
    why: &[String],
    kept: impl Fn(std::ops::Range<usize>) -> Vec<usize>,
) -> Vec<Part> {
    let each = n_taxels / n_parts;
    let order: &[&'static str] = if named.len() == n_parts {
        named
    } else if n_parts == FINGERS.len() {
        &FINGERS
    } else {
        &[]
    };
    let part = |k: usize| {
        let mut why = why.to_vec();
        if n_parts > 1 {
            why.push("CHECK: which taxels these are was taken from their order".to_owned());
        }
        Part { finger: order.get(k).copied(), taxels: Some(kept(each * k..each * (k + 1))), why }
    };
    (0..n_parts).map(part).collect()
}

/// Fingers that angles or force sensors are named after, in their order; points of a hand always have all, and tell nothing.
fn named_fingers(joints: &[JointSource<'_>], truths: &[TruthSource]) -> Vec<&'static str> {
    let angles = joints.iter().filter(|source| !source.is_whole_hand).flat_map(|source| &source.joints);
    let mut named: Vec<&'static str> = Vec::new();
    for one in angles.filter_map(|joint| finger(joint)).chain(truths.iter().filter_map(|truth| truth.finger)) {
        if !named.contains(&one) {
            named.push(one);
        }
    }
    named
}

/// The finger of a patch that its own names don't tell.
fn only_finger(
    source: &TaxelSource,
    joints: &[JointSource<'_>],
    truths: &[TruthSource],
    model: Option<&ModelFile>,
    why: &mut Vec<String>,
    chooser: &mut Chooser<'_>,
) -> Result<Option<&'static str>, InitError> {
    let of_model =
        model.and_then(|model| model.joints.as_ref()).and_then(|joints| joints.iter().find_map(|joint| finger(joint)));
    let named = named_fingers(joints, truths);
    if let Some(finger) = of_model {
        why.insert(0, format!("{finger}, because the model was trained on its joints"));
        return Ok(Some(finger));
    }
    if let [only] = named[..] {
        why.insert(0, format!("{only}, because no other finger has joint angles or a force sensor"));
        return Ok(Some(only));
    }
    let whole_hand = joints.iter().any(|source| source.is_whole_hand);
    if named.is_empty() && !whole_hand {
        why.insert(0, "no name tells its finger: call it what it is".to_owned());
        return Ok(None);
    }
    let options: Vec<&'static str> = if named.is_empty() { FINGERS.to_vec() } else { named };
    let words = format!("Which finger are the {} taxels of {} on?", source.n_taxels, source.found.topic);
    let because = "the joint angles are of several fingers".to_owned();
    let names = options.iter().map(|finger| (*finger).to_owned()).collect();
    let choice = chooser.choose(Question { words, options: names, likeliest: 0, because: because.clone() })?;
    why.insert(0, choice.told(&because));
    Ok(Some(options[choice.idx]))
}

/// Why a model is refused whose joints are not there.
fn other_joints(model: &ModelFile, region: &str, sources: &[JointSource<'_>]) -> InitError {
    let all: Vec<String> = sources.iter().flat_map(|source| source.joints.clone()).collect();
    InitError::ModelJoints {
        model: model.path.clone(),
        expected: model
            .joints_of(Some(region))
            .map_or_else(|| format!("of {} joints", model.n_joints), |joints| joints.join(", ")),
        region: region.to_owned(),
        got: if all.is_empty() { "none".to_owned() } else { listed(&all) },
    }
}

/// The joints of a patch, and the names by which the model knows them where those are others.
fn region_joints(
    of: Option<&'static str>,
    sources: &[JointSource<'_>],
    model: Option<&ModelFile>,
) -> (Vec<String>, Vec<String>) {
    let all: Vec<&String> = sources.iter().flat_map(|source| &source.joints).collect();
    let has = |wanted: &[String]| wanted.iter().all(|joint| all.contains(&joint));
    if let Some(wanted) = model.and_then(|model| model.joints_of(of)) {
        let trained_on = wanted.iter().find_map(|joint| finger(joint));
        let own: Option<Vec<String>> = of.and_then(|of| wanted.iter().map(|joint| on_finger(joint, of)).collect());
        return match own {
            Some(own) if of != trained_on && has(&own) => (own, wanted.clone()),
            _ if has(wanted) => (wanted.clone(), Vec::new()),
            // Nothing names the angles, and there are as many.
            _ if all.len() == wanted.len() && !sources.iter().any(|source| source.is_named) => {
                (all.into_iter().cloned().collect(), wanted.clone())
            }
            _ => (Vec::new(), Vec::new()),
        };
    }
    let mut own: Vec<String> = match of {
        Some(of) => all.iter().filter(|joint| finger(joint) == Some(of)).map(|joint| (*joint).clone()).collect(),
        None => Vec::new(),
    };
    if own.is_empty() && all.len() <= MAX_UNNAMED && all.iter().all(|joint| finger(joint).is_none()) {
        own = all.into_iter().cloned().collect();
    }
    if let Some(model) = model {
        own.truncate(model.n_joints);
        if own.len() < model.n_joints {
            own.clear();
        }
    }
    (own, Vec::new())
}
