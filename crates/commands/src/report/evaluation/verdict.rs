//! The verdict of an evaluation, in a line: better or worse, by how much, and whether the gates let it pass.

use tactile_pose_fusion::eval::{Cell, Check, Measure, Verdict};
use tactile_pose_fusion::evaluate::{Change, Evaluated, GloveHeadline, Headline};

use crate::page::VerdictKind;

/// A word, and the sentence that explains it.
pub(super) struct Said {
    pub(super) kind: VerdictKind,
    pub(super) word: String,
    pub(super) sentence: String,
}

impl Said {
    /// As a terminal shows it.
    pub(super) fn line(&self) -> String {
        format!("{} {}", self.word, self.sentence)
    }
}

/// The verdict; `None` where nothing was judged.
pub(super) fn verdict(result: &Evaluated) -> Option<Said> {
    let headline = result.headline.as_ref()?;
    let n_failed = result.checks.iter().filter(|check| is_failed(check)).count();
    let (kind, word) = match headline.change {
        Some(Change::Better) => (VerdictKind::Better, "Better"),
        Some(Change::Worse) => (VerdictKind::Worse, "Worse"),
        Some(Change::Mixed) => (VerdictKind::Neither, "Better in some, worse in some"),
        Some(Change::Same) => (VerdictKind::Neither, "No clear difference"),
        None if result.has_scores() => (VerdictKind::Neither, "Scored"),
        None => (VerdictKind::Neither, "No scores, because the true force is missing"),
    };
    let (kind, word) = match n_failed {
        0 => (kind, format!("{word}.")),
        _ => (VerdictKind::Worse, format!("{word}; {}.", gates(&result.checks, n_failed))),
    };
    let synthetic = if result.synthetic { "SYNTHETIC data, " } else { "" };
    let gloves = match headline.gloves.as_slice() {
        [only] => format!("glove {}", only.glove),
        several => match glove_of_regions(several) {
            Some(glove) => format!("{} regions of glove {glove}", several.len()),
            None => format!("{} gloves", several.len()),
        },
    };
    let who = match &headline.from {
        Some(from) => format!("{} against {from}", headline.to),
        None => headline.to.clone(),
    };
    let mut parts = match headline.gloves.as_slice() {
        [only] => of_one(result, headline, only),
        several => of_several(several),
    };
    if headline.from.is_none() && result.has_scores() {
        parts.push("nothing to compare it with (--compare MODEL)".to_owned());
    }
    let mut sentence = format!("{who} ({synthetic}{gloves}): {}.", parts.join("; "));
    if parts.is_empty() {
        sentence = format!("{who} ({synthetic}{gloves}).");
    }
    if n_failed == 0 && !result.checks.is_empty() {
        sentence += &format!(" {}.", gates(&result.checks, 0));
    }
    Some(Said { kind, word, sentence })
}

fn is_failed(check: &Check) -> bool {
    matches!(check.verdict, Verdict::Failed(_))
}

fn gates(checks: &[Check], n_failed: usize) -> String {
    let n_skipped = checks.iter().filter(|check| matches!(check.verdict, Verdict::Skipped(_))).count();
    let judged = checks.len() - n_skipped;
    let skipped = if n_skipped > 0 { format!(", {n_skipped} skipped") } else { String::new() };
    match (n_failed, judged) {
        (0, 0) => format!("No gate was judged{skipped}"),
        (0, n) => format!("All gates passed ({n}{skipped})"),
        (n, _) => format!("{n} of {judged} gates FAILED{skipped}"),
    }
}

/// Names of measures where they stand first, and their units.
const MEASURES: [(Measure, &str, &str); 3] = [
    (Measure::Mdf, "minimal detectable force (MDF)", " gF"),
    (Measure::Mae, "mean absolute error (MAE)", " gF"),
    (Measure::Ba, "balanced accuracy of touch (BA)", " %"),
];

fn of_one(result: &Evaluated, headline: &Headline, glove: &GloveHeadline) -> Vec<String> {
    let mut parts = Vec::new();
    for (measure, name, unit) in MEASURES {
        let Some(to) = &glove.to else { continue };
        let mut part = format!("{name} {}", with_unit(to, measure, unit));
        if let Some(from) = &glove.from {
            part += &format!(", was {}", with_unit(from, measure, unit));
            if let (Some(from), Some(to), true) = (from.value(measure), to.value(measure), measure != Measure::Ba) {
                part += &format!(" ({})", percent(from, to));
            }
        }
        // The paper's test by user is of this measure; a single user's minimal detectable force is often not a number.
        if measure == Measure::Mae
            && let Some(users) = users(result, headline, &glove.glove, measure)
        {
            part += &format!(", better for {users}");
        }
        parts.push(part);
    }
    match glove.false_per_min {
        [Some(from), Some(to)] => parts.push(format!("false touches in the air {to:.1} a minute, was {from:.1}")),
        [None, Some(to)] => parts.push(format!("false touches in the air {to:.1} a minute")),
        _ => {}
    }
    parts
}

/// For how many users a measure is better; `None` of fewer than two.
fn users(result: &Evaluated, headline: &Headline, glove: &str, measure: Measure) -> Option<String> {
    let from = headline.from.as_ref()?;
    let pairing = result.paired.iter().find(|pairing| pairing.from == *from && pairing.to == headline.to)?;
    let test = pairing.tests.iter().find(|test| test.glove == glove && test.measure == measure)?;
    (test.pairs.len() > 1).then(|| format!("{} of {} users", test.n_improved, test.pairs.len()))
}

/// The glove whose regions these are, `GLOVE/REGION`, if they are of one.
fn glove_of_regions(gloves: &[GloveHeadline]) -> Option<&str> {
    let mut names = gloves.iter().map(|glove| glove.glove.rsplit_once('/').map(|(glove, _)| glove));
    let first = names.next()??;
    names.all(|name| name == Some(first)).then_some(first)
}

/// From where to where the change is on several gloves.
fn of_several(gloves: &[GloveHeadline]) -> Vec<String> {
    let mut parts = Vec::new();
    for (measure, name, _) in MEASURES {
        let changes = gloves.iter().filter_map(|glove| {
            let (from, to) = (glove.from.as_ref()?.value(measure)?, glove.to.as_ref()?.value(measure)?);
            Some(if measure == Measure::Ba { 100.0 * (to - from) } else { 100.0 * (to - from) / from })
        });
        let changes: Vec<f64> = changes.filter(|change| change.is_finite()).collect();
        let unit = if measure == Measure::Ba { "points" } else { "%" };
        parts.extend(range(&changes).map(|[low, high]| format!("{name} {low:+.1} to {high:+.1} {unit}")));
    }
    let values = |measure: Measure| {
        gloves.iter().filter_map(move |glove| glove.to.as_ref()?.value(measure)).collect::<Vec<f64>>()
    };
    if parts.is_empty() {
        for (measure, name, unit) in MEASURES {
            let scale = if measure == Measure::Ba { 100.0 } else { 1.0 };
            parts.extend(
                range(&values(measure))
                    .map(|[low, high]| format!("{name} {:.1} to {:.1}{unit}", scale * low, scale * high)),
            );
        }
    }
    parts
}

fn range(values: &[f64]) -> Option<[f64; 2]> {
    let low = values.iter().copied().reduce(f64::min)?;
    Some([low, values.iter().copied().fold(low, f64::max)])
}

/// A measure with its unit, where it is a number or a bound.
fn with_unit(cell: &Cell, measure: Measure, unit: &str) -> String {
    let text = cell.text(measure);
    if text.ends_with(|last: char| last.is_ascii_digit()) { text + unit } else { text }
}

fn percent(from: f64, to: f64) -> String {
    if from > 0.0 { format!("{:+.1} %", 100.0 * (to - from) / from) } else { "from none".to_owned() }
}
