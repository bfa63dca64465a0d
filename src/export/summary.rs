//! Summary at the end of an export.

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

/// Summary of an export.
#[derive(Debug, Default, Serialize)]
pub struct Summary {
    /// Paths of the files and folders that were written.
    pub outputs: Vec<String>,
    /// One entry per exported bag.
    pub bags: Vec<BagSummary>,
    /// Bags that could not be exported. They are in no output.
    pub failed: Vec<Failed>,
}

/// A bag that could not be exported.
#[derive(Debug, Serialize)]
pub struct Failed {
    /// Its path.
    pub bag: String,
    /// The reason, on one line.
    pub error: String,
}

/// Summary of an exported bag.
#[derive(Debug, Serialize)]
pub struct BagSummary {
    /// Its path.
    pub bag: String,
    /// True if the data are simulated, not recorded.
    pub synthetic: bool,
    /// `recorded` if the bag has them, `computed` if the models made them.
    pub estimates: &'static str,
    /// Source of the zero. `None` if the estimates are from the bag.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero: Option<ZeroFrom>,
    /// Its episode of the dataset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub episode: Option<EpisodeSummary>,
    /// Number of rows in the tables.
    pub rows: usize,
    /// Data of the bag that were lost.
    pub losses: Vec<String>,
    /// Samples that were dropped, with reasons.
    pub drops: Vec<String>,
}

/// Summary of an episode.
#[derive(Debug, Serialize)]
pub struct EpisodeSummary {
    /// Number of frames.
    pub frames: usize,
    /// Time before the first frame, s, when some stream had not started.
    pub skipped_s: f64,
    /// Share of the frames with a known force, by region.
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
        let names = cfg.fusion().regions().iter().map(|region| region.name.clone());
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
    /// True if some of the input is in no output.
    pub fn has_lost(&self) -> bool {
        !self.failed.is_empty() || self.bags.iter().any(|bag| !bag.losses.is_empty())
    }

    /// Notes for the user, one line each.
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
