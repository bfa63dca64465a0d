//! The split into training and test: always the earlier and the later part, so that no future leaks into a model.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::units::Stamp;

/// Within what a session is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplitBy {
    /// Each stage by itself, so that the test part holds all of them. The default.
    #[default]
    Stage,
    /// The session as a whole: the paper's words (Sec. VI-A). Of a staged session that tests the last stage alone.
    Session,
}

/// Purpose of a moment of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// Gradients come from here.
    Train,
    /// The best step of a training is picked here: stretches of what would train, so that the test stays unseen.
    Validation,
    /// Results are reported on it.
    Test,
}

impl Part {
    /// All parts, in the order in which they lie in time.
    pub const ALL: [Part; 3] = [Part::Train, Part::Validation, Part::Test];

    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Part::Train => "training",
            Part::Validation => "validation",
            Part::Test => "test",
        }
    }
}

/// A stretch of the validation is not shorter than this: a window is two thirds of a second.
const SHORTEST_VALIDATION_NS: i128 = 5_000_000_000;

/// Stretches of the validation within a stage.
const MOST_VALIDATIONS: i128 = 5;

/// A split that can't be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum SplitError {
    #[error("share of a session that is kept for the {part} is {got}, expected 0 or more, and below 1", part = part.name())]
    Share { part: Part, got: f64 },
    #[error(
        "{validation} for the validation and {test} for the test leave nothing to train on; expected a sum below 1"
    )]
    NothingLeft { validation: f64, test: f64 },
}

/// A stretch of a session in one stage, from `from` up to but without `to`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StageSpan<'a> {
    /// Begin, inclusive.
    pub from: Stamp,
    /// End, exclusive.
    pub to: Stamp,
    /// The stage.
    pub stage: &'a str,
}

/// A chronological split, in shares of time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Split {
    by: SplitBy,
    validation: f64,
    test: f64,
}

impl Default for Split {
    /// The paper's 80/20, within each stage, and nothing for a validation.
    fn default() -> Self {
        Split { by: SplitBy::Stage, validation: 0.0, test: 0.2 }
    }
}

impl Split {
    /// A split that keeps the last `test` of the time for the test, and `validation` of what is before it.
    ///
    /// # Errors
    /// [`SplitError`] for shares that are none, or leave nothing.
    pub fn new(by: SplitBy, validation: f64, test: f64) -> Result<Self, SplitError> {
        for (part, got) in [(Part::Validation, validation), (Part::Test, test)] {
            if !(0.0..1.0).contains(&got) {
                return Err(SplitError::Share { part, got });
            }
        }
        if validation + test >= 1.0 {
            return Err(SplitError::NothingLeft { validation, test });
        }
        Ok(Split { by, validation, test })
    }

    /// The parts of a stage that takes so long, ns, one after the other.
    ///
    /// The validation is spread over what isn't for the test, in up to five stretches of 5 s or more, so that it resembles
    /// the test: a recording may hold one pose or one place for minutes.
    fn pieces(&self, total: i128) -> Vec<(Range<i128>, Part)> {
        let at = |kept: f64| (total as f64 * (1.0 - kept)).round() as i128;
        let test_at = at(self.test);
        let validation = test_at - at(self.validation + self.test);
        let n = (validation / SHORTEST_VALIDATION_NS).clamp(1, MOST_VALIDATIONS);
        let mut pieces = Vec::new();
        let mut from = 0;
        for k in 1..=n {
            let (begin, end) = (k * test_at / n - validation / n, k * test_at / n);
            // The first takes what the division leaves, so that all of them are what was asked for.
            let begin = if k == 1 { begin - validation % n } else { begin };
            pieces.push((from..begin, Part::Train));
            pieces.push((begin..end, Part::Validation));
            from = end;
        }
        pieces.push((test_at..total, Part::Test));
        pieces
    }

    /// Where the cuts of one session lie. Stretches that end before they begin are left out.
    ///
    /// Stages are cut by the time that was spent in them; one that was interrupted and taken up again is one stage. The
    /// cuts are times, not counts of frames, so that they are the same for every model and rate.
    pub fn cuts(&self, spans: &[StageSpan<'_>]) -> Cuts {
        let mut sorted: Vec<StageSpan<'_>> = spans.iter().copied().filter(|span| span.from < span.to).collect();
        sorted.sort_by_key(|span| span.from);
        let group = |span: &StageSpan<'_>| match self.by {
            SplitBy::Stage => span.stage.to_owned(),
            SplitBy::Session => String::new(),
        };
        let mut cuts: Vec<Cut> = Vec::new();
        let mut groups: std::collections::BTreeMap<String, Vec<StageSpan<'_>>> = std::collections::BTreeMap::new();
        sorted.iter().for_each(|span| groups.entry(group(span)).or_default().push(*span));
        for spans in groups.values() {
            let nanos = |span: &StageSpan<'_>| i128::from(span.to.0) - i128::from(span.from.0);
            let total: i128 = spans.iter().map(nanos).sum();
            let pieces = self.pieces(total);
            let mut done = 0;
            for span in spans {
                for (share, part) in &pieces {
                    // Where in this stretch a share of the stage's time begins and ends.
                    let at = |share: i128| Stamp(span.from.0 + (share - done).clamp(0, nanos(span)) as i64);
                    let (from, to) = (at(share.start), at(share.end));
                    if from < to {
                        cuts.push(Cut { from, to, part: *part });
                    }
                }
                done += nanos(span);
            }
        }
        cuts.sort_by_key(|cut| cut.from);
        Cuts(cuts)
    }
}

/// A stretch of time of one part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Cut {
    from: Stamp,
    to: Stamp,
    part: Part,
}

/// Where one session is cut.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cuts(Vec<Cut>);

impl Cuts {
    /// The part that a moment belongs to; `None` outside of every stage.
    pub fn part_at(&self, stamp: Stamp) -> Option<Part> {
        let after = self.0.partition_point(|cut| cut.from <= stamp);
        let cut = self.0.get(after.checked_sub(1)?).filter(|cut| stamp < cut.to)?;
        Some(cut.part)
    }
}
