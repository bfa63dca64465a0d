//! Arrays that belong together, each as one source: the axes of the same taxels, the elements of an array of messages, and the
//! parts of one finger.

use super::fingers;
use crate::inspect::{Elements, SourceLine, TactileCandidate, TaxelStats, yaml_text};

/// Words of what is told along axes and is no reading of a taxel.
const NO_READING: [&str; 6] = ["position", "normal", "displacement", "velocity", "orientation", "point"];

/// One source of taxels, made of one array or of several.
#[derive(Debug, Clone)]
pub(super) struct Group<'a> {
    /// As if it were one array: its paths, its taxels.
    pub(super) found: TactileCandidate,
    /// The array that speaks for it: the axis of a press, or the first one.
    pub(super) main: &'a TactileCandidate,
    /// Its mark among siblings: the value of a field.
    pub(super) label: Option<String>,
    /// How it was made, for comments.
    pub(super) why: Vec<String>,
}

impl<'a> Group<'a> {
    /// An array by itself.
    pub(super) fn single(one: &'a TactileCandidate) -> Self {
        Group { found: one.clone(), main: one, label: None, why: Vec::new() }
    }

    /// Where its array is: groups of the same place are parts of one sensor.
    pub(super) fn place(&self) -> (&str, &str) {
        (&self.main.topic, &self.main.field)
    }

    pub(super) fn n_taxels(&self) -> u64 {
        self.found.n_taxels.unwrap_or_default()
    }
}

/// Ways to make sources of these arrays, from all that belongs together down to each array by itself.
pub(super) fn ways<'a>(found: &[&'a TactileCandidate]) -> [Vec<Group<'a>>; 3] {
    let singles: Vec<Group<'a>> = found.iter().map(|one| Group::single(one)).collect();
    let elements: Vec<Group<'a>> = singles.iter().flat_map(by_element).collect();
    [of_fingers(of_axes(elements.clone())), elements, singles]
}

/// A group for each element that a field tells from the others; else the group as it is.
fn by_element<'a>(one: &Group<'a>) -> Vec<Group<'a>> {
    let Some(Elements { array, n, key: Some((key, values)) }) = &one.found.elements else { return vec![one.clone()] };
    let n_taxels = one.n_taxels() / n;
    if n_taxels == 0 || !one.n_taxels().is_multiple_of(*n) {
        return vec![one.clone()];
    }
    let of = |(k, value): (usize, &String)| {
        let from = k * n_taxels as usize;
        let range = from..from + n_taxels as usize;
        let of_element = |all: &[usize]| all.iter().filter(|idx| range.contains(idx)).map(|idx| idx - from).collect();
        let field = one.found.field.replacen(&format!("{array}[]"), &format!("{array}[{key}={value}]"), 1);
        let taxels = TaxelStats {
            constant: of_element(&one.found.taxels.constant),
            missing: of_element(&one.found.taxels.missing),
            skew: one.found.taxels.skew,
        };
        let mut found = TactileCandidate { n_taxels: Some(n_taxels), taxels, elements: None, ..one.found.clone() };
        set_fields(&mut found, &[field]);
        let why = vec![format!("one of the {n} elements of {array}, by its {key}: {}", values.join(", "))];
        Group { found, main: one.main, label: Some(value.clone()), why }
    };
    values.iter().enumerate().map(of).collect()
}

/// The axes of the same taxels as one source, x of all taxels first. What tells no reading is left out where readings are there.
fn of_axes(groups: Vec<Group<'_>>) -> Vec<Group<'_>> {
    let mut made: Vec<Group<'_>> = Vec::new();
    let mut used = vec![false; groups.len()];
    let mut has_axes = Vec::new();
    for (k, one) in groups.iter().enumerate() {
        let Some((stem, 'x')) = axis(&one.found.field) else { continue };
        let other = |wanted: char| {
            groups.iter().position(|other| {
                other.found.topic == one.found.topic
                    && other.found.n_taxels == one.found.n_taxels
                    && axis(&other.found.field) == Some((stem, wanted))
            })
        };
        let (Some(y), Some(z)) = (other('y'), other('z')) else { continue };
        [k, y, z].into_iter().for_each(|idx| used[idx] = true);
        has_axes.push((one.found.topic.clone(), is_reading(stem)));
        if is_reading(stem) {
            made.push(joined(&[one, &groups[y], &groups[z]], &groups[z], |n| {
                format!(
                    "three axes: taxels 0 to {} are x, {n} to {} y, {} to {} z; a model without shear takes those of z",
                    n - 1,
                    2 * n - 1,
                    2 * n,
                    3 * n - 1
                )
            }));
        }
    }
    // Positions of taxels are none of their readings; alone on their topic they are what there is.
    let has_readings = |topic: &str| has_axes.iter().any(|(of, is_reading)| of == topic && *is_reading);
    for (k, one) in groups.into_iter().enumerate() {
        let is_left_out = used[k] && has_readings(&one.found.topic);
        if !is_left_out {
            made.push(one);
        }
    }
    made
}

/// The path without its axis, and the axis: `pillars[].fX` is along x of `pillars[].f`.
fn axis(field: &str) -> Option<(&str, char)> {
    let last = field.rsplit('.').next()?;
    let axis = last.chars().last().map(|c| c.to_ascii_lowercase()).filter(|c| matches!(c, 'x' | 'y' | 'z'))?;
    let name = &last[..last.len() - 1];
    // `fX`, `force_x` and `x` end with an axis; `index` doesn't.
    let is_axis = name.is_empty() || name.ends_with('_') || last.ends_with(|c: char| c.is_ascii_uppercase());
    is_axis.then(|| (&field[..field.len() - 1], axis))
}

/// Whether a path without its axis can lead to readings: `d` is a displacement, as the makers of force sensors write it.
fn is_reading(stem: &str) -> bool {
    let last = stem.trim_end_matches('.').rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    last != "d" && !NO_READING.iter().any(|word| last.contains(word))
}

/// The arrays of one finger as one source, in the order of the message.
fn of_fingers(groups: Vec<Group<'_>>) -> Vec<Group<'_>> {
    let parent = |one: &Group<'_>| one.found.field.rsplit_once('.').map(|(parent, _)| parent.to_owned());
    let mut made: Vec<Group<'_>> = Vec::new();
    let mut used = vec![false; groups.len()];
    for (k, one) in groups.iter().enumerate() {
        if used[k] {
            continue;
        }
        let is_sibling = |other: &Group<'_>| {
            let (of_one, of_other) = (parent(one), parent(other));
            other.found.topic == one.found.topic
                && of_one.is_some()
                && of_one == of_other
                && one.label.is_none()
                && axis(&other.found.field).is_none()
                && !one.found.field.contains('[')
        };
        let has_finger = fingers::finger(&one.found.field).is_some();
        let siblings: Vec<usize> =
            (k..groups.len()).filter(|idx| *idx == k || (has_finger && is_sibling(&groups[*idx]))).collect();
        siblings.iter().for_each(|idx| used[*idx] = true);
        let parts: Vec<&Group<'_>> = siblings.iter().map(|idx| &groups[*idx]).collect();
        match parts[..] {
            [only] => made.push(only.clone()),
            _ => made.push(joined(&parts, one, |_| "the arrays of one finger, one after another".to_owned())),
        }
    }
    made
}

/// Several groups as one source.
fn joined<'a>(parts: &[&Group<'a>], main: &Group<'a>, told: impl Fn(u64) -> String) -> Group<'a> {
    let (mut constant, mut missing, mut n_before) = (Vec::new(), Vec::new(), 0);
    for part in parts {
        let shifted = |all: &[usize]| all.iter().map(|idx| idx + n_before as usize).collect::<Vec<_>>();
        constant.extend(shifted(&part.found.taxels.constant));
        missing.extend(shifted(&part.found.taxels.missing));
        n_before += part.n_taxels();
    }
    let taxels = TaxelStats { constant, missing, skew: main.found.taxels.skew };
    let mut found = TactileCandidate { n_taxels: Some(n_before), taxels, ..main.found.clone() };
    let fields: Vec<String> = parts.iter().map(|part| part.found.field.clone()).collect();
    set_fields(&mut found, &fields);
    let mut why = main.why.clone();
    why.push(told(main.n_taxels()));
    Group { found, main: main.main, label: main.label.clone(), why }
}

/// Writes which fields hold the taxels, and how many there are.
fn set_fields(found: &mut TactileCandidate, fields: &[String]) {
    if let [only] = fields {
        found.field.clone_from(only);
    }
    let n_taxels = found.n_taxels.unwrap_or_default();
    for line in &mut found.parameters.lines {
        match line {
            SourceLine::Value { key, value, .. } if *key == "n_taxels" => *value = n_taxels.to_string(),
            SourceLine::Value { key, value, .. } if matches!(*key, "field" | "fields") => match fields {
                [only] => (*key, *value) = ("field", yaml_text(only)),
                all => (*key, *value) = ("fields", super::yaml::list(all)),
            },
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_told_by_the_end_of_a_name() {
        assert_eq!(axis("taxels[].force.x"), Some(("taxels[].force.", 'x')));
        assert_eq!(axis("pillars[].fZ"), Some(("pillars[].f", 'z')));
        assert_eq!(axis("a.force_y"), Some(("a.force_", 'y')));
        assert_eq!((axis("fingers.index"), axis("data")), (None, None));
        assert!(is_reading("pillars[].f") && !is_reading("pillars[].d") && !is_reading("taxels[].position."));
    }
}
