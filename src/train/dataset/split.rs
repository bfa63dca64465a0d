//! What is trained on, what picks the best model, and what is kept for the report.

use serde::{Deserialize, Serialize};

use super::super::error::DatasetError;
use super::session::Session;

/// A part of the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// Gradients come from here.
    Train,
    /// The best model is picked here; the end of what would be training data, so that the test stays unseen.
    Validation,
    /// Only for the report.
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

/// Where the chronological cut is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplitRule {
    /// Within each stage of each session, so that every stage is tested.
    #[default]
    WithinStages,
    /// Once a session, as the paper words it; a staged session is then tested on its last stage alone.
    WholeSession,
}

/// The split.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SplitConfig {
    /// Where the cut is made.
    pub rule: SplitRule,
    /// Share of the frames, the last ones, that is kept for the test; the paper's is 0.2.
    pub test: f64,
    /// Share of the frames, right before the test, that picks the best model. 0 trains on them, and the last model is
    /// the best.
    pub validation: f64,
}

impl Default for SplitConfig {
    fn default() -> Self {
        SplitConfig { rule: SplitRule::default(), test: 0.2, validation: 0.08 }
    }
}

impl SplitConfig {
    pub(super) fn check(&self) -> Result<(), DatasetError> {
        for (key, share) in [("split.test", self.test), ("split.validation", self.validation)] {
            if !(0.0..1.0).contains(&share) {
                return Err(DatasetError::Setting { key, got: share.to_string(), expected: "0 or more, and below 1" });
            }
        }
        if self.test + self.validation >= 1.0 {
            let got = format!("{} and test {}", self.validation, self.test);
            return Err(DatasetError::Setting { key: "split.validation", got, expected: "a sum below 1" });
        }
        Ok(())
    }

    /// Share of the frames that a part gets.
    pub(super) fn fraction(&self, part: Part) -> f64 {
        match part {
            Part::Train => 1.0 - self.test - self.validation,
            Part::Validation => self.validation,
            Part::Test => self.test,
        }
    }

    /// The part of each frame.
    pub(super) fn parts(&self, session: &Session) -> Vec<Part> {
        let n = session.n_frames();
        let group = |frame: usize| match self.rule {
            SplitRule::WithinStages => session.frames().stage[frame],
            SplitRule::WholeSession => 0,
        };
        let mut sizes = std::collections::BTreeMap::<u16, usize>::new();
        (0..n).for_each(|frame| *sizes.entry(group(frame)).or_default() += 1);
        let mut seen = std::collections::BTreeMap::<u16, usize>::new();
        (0..n)
            .map(|frame| {
                let size = sizes[&group(frame)];
                let place = seen.entry(group(frame)).or_default();
                *place += 1;
                let until = |fraction: f64| (size as f64 * fraction).round() as usize;
                if *place <= until(self.fraction(Part::Train)) {
                    Part::Train
                } else if *place <= until(1.0 - self.test) {
                    Part::Validation
                } else {
                    Part::Test
                }
            })
            .collect()
    }
}
