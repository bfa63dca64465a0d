//! Outputs of an export. All stay open until the last bag is read.

use std::path::Path;

use super::lerobot::ShardNotes;
use super::loaded::Loaded;
use super::summary::BagSummary;
use super::{Dataset, DatasetSpec, Episode, ExportError, Layout, Request, TableLayout, Targets, rows};
use crate::columns::{Cells, ColumnFile, CsvFile, Kind};
use crate::config::Config;

/// All outputs, open until all bags are read.
pub(super) struct Outputs<'a> {
    request: &'a Request<'a>,
    cfg: &'a Config,
    dataset: Option<Dataset>,
    layout: Option<Layout>,
    /// Of the tables: that of the first bag.
    table: Option<TableLayout>,
    parquet: Option<ColumnFile>,
    csv: Option<CsvFile>,
}

/// The part of the outputs that one bag adds.
pub(super) struct Made {
    episode: Option<Episode>,
    /// `[regions][columns]`
    rows: Vec<Vec<Cells>>,
}

impl<'a> Outputs<'a> {
    pub(super) fn create(request: &'a Request<'a>, cfg: &'a Config) -> Result<Self, ExportError> {
        let spec = DatasetSpec { fps: request.fps, task: request.task.to_owned(), robot_type: cfg.glove.clone() };
        let dataset = request.targets.lerobot.map(|path| Dataset::create(path, spec)).transpose()?;
        Ok(Outputs { request, cfg, dataset, layout: None, table: None, parquet: None, csv: None })
    }

    fn has_tables(&self) -> bool {
        self.request.targets.parquet.is_some() || self.request.targets.csv.is_some()
    }

    /// True if a bag has defined the layout of the frames.
    pub(super) fn has_layout(&self) -> bool {
        self.layout.is_some()
    }

    /// Prepares everything that a bag adds, before any of it is written.
    pub(super) fn make(&mut self, loaded: &Loaded) -> Result<Made, ExportError> {
        let session = loaded.session();
        let mut episode = None;
        if self.dataset.is_some() {
            let layout = match &self.layout {
                Some(layout) => layout.clone(),
                None => Layout::new(self.cfg.fusion(), self.request.fps, self.request.tactile_window_ms, &session)?,
            };
            episode = Some(layout.episode(&session)?);
            self.layout = Some(layout);
        }
        let rows = match self.has_tables() {
            true => {
                let layout = self.table.clone().unwrap_or_else(|| TableLayout::of(self.cfg, &session));
                rows(self.cfg.fusion(), &layout, &session)?
            }
            false => Vec::new(),
        };
        Ok(Made { episode, rows })
    }

    pub(super) fn write(&mut self, bag: &Path, made: Made, loaded: Loaded) -> Result<BagSummary, ExportError> {
        let Made { episode, rows } = made;
        let summary = BagSummary::new(bag, self.cfg, &loaded, episode.as_ref(), &rows);
        if let (Some(dataset), Some(episode)) = (&mut self.dataset, episode) {
            dataset.handle_episode(episode)?;
        }
        if self.table.is_none() && self.has_tables() {
            self.create_tables(&loaded)?;
        }
        for cells in &rows {
            self.parquet.as_mut().map_or(Ok(()), |table| table.write(cells))?;
            self.csv.as_mut().map_or(Ok(()), |table| table.write(cells))?;
        }
        Ok(summary)
    }

    fn create_tables(&mut self, first: &Loaded) -> Result<(), ExportError> {
        let layout = TableLayout::of(self.cfg, &first.session());
        let columns = layout.columns();
        let columns: Vec<(&str, Kind)> = columns.iter().map(|(name, kind)| (name.as_str(), *kind)).collect();
        let made_by = format!("tactile_pose_fusion {}", env!("CARGO_PKG_VERSION"));
        let notes = [("synthetic", first.synthetic.to_string()), ("made_by", made_by)];
        let Targets { parquet, csv, overwrite, .. } = self.request.targets;
        self.parquet = parquet.map(|path| ColumnFile::create(path, &columns, &notes, overwrite)).transpose()?;
        self.csv = csv.map(|path| CsvFile::create(path, &columns, overwrite)).transpose()?;
        self.table = Some(layout);
        Ok(())
    }

    /// Completes all outputs and gives them their names. `shard` marks the dataset as a shard of a larger one.
    pub(super) fn finish(self, shard: Option<&ShardNotes>) -> Result<(), ExportError> {
        self.parquet.map_or(Ok(()), ColumnFile::finish)?;
        self.csv.map_or(Ok(()), CsvFile::finish)?;
        let Some(dataset) = self.dataset else { return Ok(()) };
        match shard {
            Some(notes) => dataset.finish_shard(notes),
            None => dataset.finish(),
        }
    }
}
