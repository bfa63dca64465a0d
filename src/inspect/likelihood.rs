//! How much speaks for a candidate.

use serde::Serialize;

/// How much speaks for a candidate; the likeliest is least, so that it sorts first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Likelihood {
    /// Type or name say so.
    Likely,
    /// Its form allows it.
    Possible,
    /// Nothing but that it holds numbers.
    Unlikely,
}

impl Likelihood {
    /// One step down.
    pub(super) fn less(self) -> Self {
        match self {
            Likelihood::Likely => Likelihood::Possible,
            Likelihood::Possible | Likelihood::Unlikely => Likelihood::Unlikely,
        }
    }
}
