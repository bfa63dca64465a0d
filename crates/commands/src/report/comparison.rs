//! How the estimates of two bags differ.

use std::fmt::Write as _;

use tactile_pose_fusion::eval::{Check, Diff, FieldValue, Moment, OnlyIn, RegionDiff, Verdict};
use tactile_pose_fusion::fusion::Flags;
use tactile_pose_fusion::units::Stamp;

/// Frames and fields of each region, a check each.
///
/// `names` are those of the two bags; forces may differ by `tolerance_n`, N.
pub fn checks(found: &Diff, names: [&str; 2], tolerance_n: f64) -> Vec<Check> {
    let mut checks = Vec::new();
    for (region, diff) in &found.regions {
        let mut push = |what: &str, n_different: u64, expected: String, reason: String| {
            let verdict = if n_different == 0 { Verdict::Passed } else { Verdict::Failed(reason) };
            checks.push(Check {
                name: format!("{region}: {what}"),
                value: Some(n_different as f64),
                expected,
                verdict,
            });
        };
        for ((only, bag), side) in [&diff.only_in_a, &diff.only_in_b].into_iter().zip(names).zip(["a", "b"]) {
            let reason = format!("{} frames are in {bag} only", only.n);
            push(&format!("frames only in {side}"), only.n, "0".to_owned(), reason);
        }
        for field in &diff.fields {
            let first = field.first.as_ref().map_or(String::new(), |first| {
                format!(", first at {}: {} and {}", at(&first.at), value(&first.a), value(&first.b))
            });
            let reason = format!("{} of {} differ{first}", field.n_different, field.n_compared);
            push(field.field.name(), field.n_different, agreement_wanted(tolerance_n), reason);
        }
    }
    checks
}

fn agreement_wanted(tolerance_n: f64) -> String {
    if tolerance_n == 0.0 { "equal bit by bit".to_owned() } else { format!("equal within {tolerance_n} N") }
}

/// The differences, region by region.
///
/// `names` are those of the two bags; forces may differ by `tolerance_n`, N.
pub fn text(found: &Diff, names: [&str; 2], tolerance_n: f64) -> String {
    let mut text = String::new();
    for (region, diff) in &found.regions {
        // Writing to a string can't fail.
        let _ = writeln!(text, "region {region}: {} frames in both", diff.n_matched);
        only(&mut text, names[0], &diff.only_in_a);
        only(&mut text, names[1], &diff.only_in_b);
        let differing: Vec<_> = diff.fields.iter().filter(|field| field.n_different > 0).collect();
        if differing.is_empty() {
            let _ = writeln!(text, "  {}", agreement(diff, tolerance_n));
            continue;
        }
        // Each field has lines of its own: a table of all this is wider than a terminal.
        for field in differing {
            let name = field.field.name();
            let apart = field.largest.as_ref().and_then(|largest| Some((largest.distance?, &largest.a)));
            let apart = apart.map_or(String::new(), |(distance, of)| format!(", by up to {}", apart_by(distance, of)));
            let _ = writeln!(text, "  {name}: {} of {} differ{apart}", field.n_different, field.n_compared);
            let largest = field.largest.as_ref().filter(|largest| Some(*largest) != field.first.as_ref());
            for (which, found) in [("first", field.first.as_ref()), ("largest", largest)] {
                let Some(found) = found else { continue };
                let _ = writeln!(text, "    {which} at {}", at(&found.at));
                let _ = writeln!(text, "      a: {}\n      b: {}", value(&found.a), value(&found.b));
            }
        }
    }
    let _ = writeln!(text, "{}", if found.is_same() { "same" } else { "different" });
    text
}

fn agreement(diff: &RegionDiff, tolerance_n: f64) -> String {
    let largest = diff.fields.iter().filter_map(|field| field.largest.as_ref()?.distance).fold(0.0, f64::max);
    match tolerance_n {
        0.0 => "every field equal, bit by bit".to_owned(),
        _ => format!("every field equal within {tolerance_n} N, the largest difference {largest:.3e} N"),
    }
}

/// A distance between two values of a field, in the field's unit.
fn apart_by(distance: f64, of: &FieldValue) -> String {
    match of {
        FieldValue::Force(_) => format!("{distance:.3e} N"),
        FieldValue::Nanos(_) => format!("{:.3} ms", distance * 1e-6),
        FieldValue::Wrench(_) => format!("{distance:.3e} N or N m"),
        _ => format!("{distance:.3e}"),
    }
}

fn only(text: &mut String, bag: &str, only: &OnlyIn) {
    if let (Some(first), Some(last)) = (&only.first, &only.last) {
        let _ =
            writeln!(text, "  only in {bag}: {} frames\n    first at {}\n    last at {}", only.n, at(first), at(last));
    }
}

fn at(moment: &Moment) -> String {
    let epoch = if moment.epoch > 0 { format!(" (lap {})", moment.epoch + 1) } else { String::new() };
    format!("{}{epoch}", Stamp(moment.stamp_ns))
}

fn value(value: &FieldValue) -> String {
    match value {
        FieldValue::Force(force) => format!("{force:.6} N"),
        FieldValue::Wrench(wrench) => {
            let [x, y, z, about_x, about_y, about_z] = wrench.map(|part| format!("{part:.6}"));
            format!("{x} {y} {z} N, {about_x} {about_y} {about_z} N m")
        }
        FieldValue::Nanos(nanos) => Stamp(*nanos).to_string(),
        FieldValue::State(state) => state.to_string(),
        FieldValue::Bits(bits) => Flags::from_bits(*bits).to_string(),
        FieldValue::Share(share) => format!("{:.3} %", 100.0 * share),
        FieldValue::Text(text) => (*text).to_owned(),
        FieldValue::Missing => "none".to_owned(),
    }
}
