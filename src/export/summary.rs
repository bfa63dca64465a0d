//! What an export tells at its end.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::Episode;
use super::loaded::Loaded;
use crate::bag::shown;
use crate::columns::Cells;
use crate::config::Config;
use crate::zero::ZeroFrom;

/// An export in numbers.
#[derive(Debug, Default, Serialize)]
pub struct Summary {
    /// Files and folders that were written.
    pub outputs: Vec<String>,
    /// What became of each bag.
    pub bags: Vec<BagSummary>,
    /// Bags that are in no output.
    pub failed: Vec<Failed>,
}

/// A bag that couldn't be exported.
#[derive(Debug, Serialize)]
pub struct Failed {
    /// Its path.
    pub bag: String,
    /// Why, in one line.
    pub error: String,
}

/// What became of a bag.
#[derive(Debug, Serialize)]
pub struct BagSummary {
    /// Its path.
    pub bag: String,
    /// Whether it is no recording but made by a simulator.
    pub synthetic: bool,
    /// `recorded` where they were in the bag, `computed` where the models made them.
    pub estimates: &'static str,
    /// Where the zero is from; `None` where the estimates were in the bag.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero: Option<ZeroFrom>,
    /// Its episode of the dataset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub episode: Option<EpisodeSummary>,
    /// Of the tables.
    pub rows: usize,
    /// What was lost of the bag.
    pub losses: Vec<String>,
    /// What was dropped of its samples.
    pub drops: Vec<String>,
}

/// An episode in numbers.
#[derive(Debug, Serialize)]
pub struct EpisodeSummary {
    /// Frames of the dataset.
    pub frames: usize,
    /// Before the first frame, until everything had come once.
    pub skipped_s: f64,
    /// By region: share of the frames in which the force is known.
    pub known: BTreeMap<String, f64>,
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
    pub fn has_lost(&self) -> bool {
        !self.failed.is_empty() || self.bags.iter().any(|bag| !bag.losses.is_empty())
    }

    /// What a person should know besides, a line each.
    pub fn notes(&self) -> Vec<String> {
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
