//! Summaries of sessions, for results.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::config::Config;
use crate::eval::{Timing, ZeroLoadCheck};
use crate::sessions::{Labelled, SessionError, fingerprint, session_name};
use crate::zero::ZeroFrom;

/// Summary of a session, for results.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SessionSummary {
    /// Its bag, without the folder it lies in.
    pub name: String,
    /// Its bag, as it was given.
    pub bag: String,
    /// SHA-256 of its files.
    pub sha256: String,
    /// Which glove was worn.
    pub glove: String,
    /// The wearer.
    pub user: String,
    /// Whether a simulator made it.
    pub synthetic: bool,
    /// Of the region with the most.
    pub frames_scored: usize,
    /// Of them, those without a true force.
    pub frames_without_truth: usize,
    /// Missing data, and the results that can't be given without them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<String>,
    /// How well the tared truth keeps below the touch threshold where nothing touches; absent without truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero_load: Option<ZeroLoadCheck>,
    /// Where the zero of the estimates comes from; absent where they were recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero: Option<ZeroFrom>,
    /// Of the estimates that are judged, by region.
    pub timing: BTreeMap<String, Timing>,
    /// Counts of all inputs of the core of the judged model; absent where estimates were recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub counters: Option<serde_json::Value>,
    /// Losses of the bag.
    pub losses: Vec<String>,
    /// Warnings for a person.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

impl SessionSummary {
    /// The summary of a session, still without its estimates.
    pub(super) fn new(labelled: &Labelled, bag: &Path, cfg: &Config) -> Result<Self, SessionError> {
        let named = |noted: &Option<String>, set: &Option<String>| {
            noted.clone().or_else(|| set.clone()).unwrap_or_else(|| "?".to_owned())
        };
        let mut warnings = Vec::new();
        let zero_load = labelled.zero_load_check(bag, &mut warnings);
        Ok(SessionSummary {
            name: session_name(bag),
            bag: bag.display().to_string(),
            sha256: fingerprint(bag)?,
            glove: named(&labelled.notes().glove, &cfg.glove),
            user: named(&labelled.notes().user, &cfg.user),
            synthetic: labelled.notes().synthetic,
            frames_scored: 0,
            frames_without_truth: 0,
            missing: labelled.missing().to_vec(),
            zero_load,
            zero: None,
            timing: BTreeMap::new(),
            counters: None,
            losses: Vec::new(),
            warnings,
        })
    }
}
