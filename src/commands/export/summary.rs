//! What an export tells at its end.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::super::setup::shown;
use super::session::Loaded;
use crate::columns::Cells;
use crate::config::Config;
use crate::export::Episode;
use crate::zero::ZeroFrom;

/// An export in numbers.
#[derive(Debug, Default, Serialize)]
pub(super) struct Summary {
    pub(super) outputs: Vec<String>,
    pub(super) bags: Vec<BagSummary>,
    /// Bags that are in no output.
    pub(super) failed: Vec<Failed>,
}

/// A bag that couldn't be exported.
#[derive(Debug, Serialize)]
pub(super) struct Failed {
    pub(super) bag: String,
    pub(super) error: String,
}

/// What became of a bag.
#[derive(Debug, Serialize)]
pub(super) struct BagSummary {
    bag: String,
    synthetic: bool,
    /// `recorded` where they were in the bag, `computed` where the models made them.
    estimates: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    zero: Option<ZeroFrom>,
    #[serde(skip_serializing_if = "Option::is_none")]
    episode: Option<EpisodeSummary>,
    /// Of the tables.
    rows: usize,
    losses: Vec<String>,
    drops: Vec<String>,
}

#[derive(Debug, Serialize)]
struct EpisodeSummary {
    frames: usize,
    /// Before the first frame, until everything had come once.
    skipped_s: f64,
    /// By region: share of the frames in which the force is known.
    known: BTreeMap<String, f64>,
}

impl BagSummary {
    pub(super) fn new(
        bag: &Path,
        cfg: &Config,
        loaded: &Loaded,
        episode: Option<&Episode>,
        rows: &[Vec<Cells>],
    ) -> Self {
        let names = cfg.fusion.regions.iter().map(|region| region.name.clone());
        let episode = episode.map(|episode| EpisodeSummary {
            frames: episode.n_frames,
            skipped_s: episode.skipped_s,
            known: names.zip(episode.known.iter().copied()).collect(),
        });
        BagSummary {
            bag: shown(bag),
            synthetic: loaded.synthetic,
            estimates: if loaded.zero.is_some() { "computed" } else { "recorded" },
            zero: loaded.zero.clone(),
            episode,
            rows: rows.iter().filter_map(|cells| cells.first()).map(Cells::n_rows).sum(),
            losses: loaded.losses.clone(),
            drops: loaded.drops.clone(),
        }
    }
}

impl Summary {
    /// Whether something of the input is in no output.
    pub(super) fn has_lost(&self) -> bool {
        !self.failed.is_empty() || self.bags.iter().any(|bag| !bag.losses.is_empty())
    }

    /// What a person should know besides, a line each.
    pub(super) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        for bag in &self.bags {
            notes.extend(bag.losses.iter().chain(&bag.drops).map(|text| format!("{}: {text}", bag.bag)));
            for (region, _) in bag.episode.iter().flat_map(|one| &one.known).filter(|(_, known)| **known == 0.0) {
                notes.push(format!("{}: region {region} has no estimate in any frame", bag.bag));
            }
        }
        notes.extend(self.failed.iter().map(|failed| format!("not exported: {}", failed.error)));
        notes
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for bag in &self.bags {
            let synthetic = if bag.synthetic { " (synthetic)" } else { "" };
            write!(f, "{}{synthetic}: estimates ", bag.bag)?;
            match &bag.zero {
                Some(zero) => write!(f, "computed, zero from {zero}")?,
                None => write!(f, "as they are in the bag")?,
            }
            if let Some(EpisodeSummary { frames, skipped_s, known }) = &bag.episode {
                write!(f, "; {frames} frames from {skipped_s:.2} s on")?;
                for (region, known) in known {
                    write!(f, ", {region} known in {:.1} %", known * 100.0)?;
                }
            }
            if bag.rows > 0 {
                write!(f, "; {} rows", bag.rows)?;
            }
            writeln!(f)?;
        }
        let n = self.bags.len();
        writeln!(f, "{n} of {} bags in {}", n + self.failed.len(), self.outputs.join(", "))
    }
}
