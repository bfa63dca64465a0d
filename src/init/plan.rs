//! Contents of the document, before it is written.

use std::collections::BTreeMap;

use crate::inspect::{BagReport, SourceLines, TactileCandidate};

/// The model that is to be used.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// Its path as the document is to have it: relative to the folder of the parameter file.
    pub path: String,
    /// Taxels in a frame.
    pub n_taxels: usize,
    /// Joints of a region.
    pub n_joints: usize,
    /// Their names, in order, where it tells them.
    pub joints: Option<Vec<String>>,
    /// Names of the joints of each region, for a model of several.
    pub regions: BTreeMap<String, Vec<String>>,
    /// Frames a second.
    pub rate_hz: f64,
    /// Axes of its force: 1 or 3.
    pub n_force_axes: usize,
    /// Why it is this one.
    pub why: String,
}

impl ModelFile {
    /// Names of the joints of a region, where the model tells them.
    pub fn joints_of(&self, region: Option<&str>) -> Option<&Vec<String>> {
        region.and_then(|region| self.regions.get(region)).or(self.joints.as_ref())
    }
}

/// Candidates of all bags, each once: as the bag with most messages of it has it.
pub(super) fn most_seen<'a, C>(
    bags: &'a [BagReport],
    of: impl Fn(&'a BagReport) -> &'a [C],
    key: impl Fn(&C) -> (&str, &str, u64),
) -> Vec<&'a C> {
    let mut found: Vec<&C> = Vec::new();
    for one in bags.iter().flat_map(of) {
        let (topic, field, n_messages) = key(one);
        match found.iter_mut().find(|known| (key(known).0, key(known).1) == (topic, field)) {
            Some(known) if key(known).2 < n_messages => *known = one,
            Some(_) => {}
            None => found.push(one),
        }
    }
    found
}

/// A source of taxels.
#[derive(Debug, Clone)]
pub(super) struct TaxelSource {
    pub(super) name: String,
    pub(super) found: TactileCandidate,
    pub(super) n_taxels: usize,
    /// Its mark among siblings.
    pub(super) label: Option<String>,
    /// Keys beside those that inspection suggests, each with its reason.
    pub(super) more: Vec<(&'static str, String, String)>,
    pub(super) finger: Option<&'static str>,
    pub(super) hand: Option<&'static str>,
    /// 1 or -1, and why.
    pub(super) sign: (i32, String),
    pub(super) why: Vec<String>,
}

/// A source of joint angles.
#[derive(Debug, Clone)]
pub(super) struct JointSource<'a> {
    pub(super) name: String,
    pub(super) lines: &'a SourceLines,
    /// Keys beside those that inspection suggests, each with its reason.
    pub(super) more: Vec<(&'static str, String, String)>,
    /// Names of its angles.
    pub(super) joints: Vec<String>,
    /// Whether it holds the points of a whole hand, whatever is worn on it.
    pub(super) is_whole_hand: bool,
    /// Whether its messages name them.
    pub(super) is_named: bool,
    pub(super) why: Vec<String>,
}

/// A source of true force.
#[derive(Debug, Clone)]
pub(super) struct TruthSource {
    pub(super) name: String,
    pub(super) finger: Option<&'static str>,
    /// Keys and values, each with its reason, which may be empty.
    pub(super) lines: Vec<(&'static str, String, String)>,
    pub(super) why: Vec<String>,
}

/// A patch.
#[derive(Debug, Clone)]
pub(super) struct Region {
    pub(super) name: String,
    pub(super) finger: Option<&'static str>,
    pub(super) source: String,
    /// Indices of its taxels; none for all.
    pub(super) taxels: Option<Vec<usize>>,
    pub(super) joints: Vec<String>,
    pub(super) model_joints: Vec<String>,
    pub(super) model: String,
    pub(super) truth: Option<String>,
    pub(super) why: Vec<String>,
}

/// A name that isn't taken yet, from one that may be.
pub(super) fn free_name(wanted: &str, taken: &[&str]) -> String {
    let numbered = (2..).map(|n| format!("{wanted}_{n}"));
    let mut names = std::iter::once(wanted.to_owned()).chain(numbered);
    names.find(|name| !taken.contains(&name.as_str())).unwrap_or_default() // there is always one more number
}

/// The first names of many.
pub(super) fn listed(names: &[String]) -> String {
    let shown = names.iter().take(24).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > 24 { format!("{shown} and {} more", names.len() - 24) } else { shown }
}
