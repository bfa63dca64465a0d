//! `tpf export`: sessions as a LeRobot dataset, or as tables.

mod session;
mod summary;

use std::path::{Path, PathBuf};

use self::session::{Loaded, Loader};
use self::summary::{BagSummary, Failed, Summary};
use super::progress::Progress;
use super::sessions::find_bags;
use super::setup::{ModelArgs, ParamArgs, shown};
use super::zero::ZeroArgs;
use super::{Failure, Outcome, interrupt, print, say};
use crate::columns::{Cells, ColumnFile, CsvFile, Kind};
use crate::config::Config;
use crate::export::{Dataset, DatasetSpec, Episode, Layout, columns, rows};

/// Writes force, contact, artifact, taxels and joint angles for those who learn from them: as a LeRobot dataset at its
/// own rate, or as a table of all frames.
///
/// Estimates are those in the bag where it holds some (of `tpf run --record` or `tpf replay --merge`), else the models of
/// the parameters make them as `tpf replay` does.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("output").required(true).multiple(true))]
pub(super) struct Args {
    /// Bags, or folders of bags: one recording each, which becomes one episode
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    /// Write a LeRobotDataset v3 to this folder, which must not be there yet
    #[arg(long, value_name = "DIR", group = "output")]
    lerobot: Option<PathBuf>,
    /// Write every frame of every region as Parquet
    #[arg(long, value_name = "FILE", group = "output")]
    parquet: Option<PathBuf>,
    /// Write every frame of every region as CSV
    #[arg(long, value_name = "FILE", group = "output")]
    csv: Option<PathBuf>,
    /// Frames a second of the LeRobot dataset
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    fps: u32,
    /// How far back the tactile samples of a frame reach, at their own rate
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    tactile_window_ms: u32,
    /// What was done in these bags, in words: the task of the LeRobot dataset
    #[arg(long, value_name = "TEXT", default_value = "manipulation with a tactile glove")]
    task: String,
    #[command(flatten)]
    models: ModelArgs,
    #[command(flatten)]
    zero: ZeroArgs,
    /// Topic of the true force for the tables, instead of the one in the parameters
    #[arg(long, value_name = "TOPIC")]
    truth: Option<String>,
    /// Replace a table that is already there; a dataset is never replaced
    #[arg(long)]
    overwrite: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    args.refuse_outputs()?;
    let cfg = args.params.load_with_truth(args.truth.as_deref())?;
    let bags = find_bags(&args.bags)?;
    let mut outputs = Outputs::create(args, &cfg)?;
    let mut loader = Loader::new(args, &cfg, &bags);
    let mut summary = Summary::default();
    let mut progress = Progress::steps("export", bags.len() as u64);
    for (bag_idx, bag) in bags.iter().enumerate() {
        progress.set(bag_idx as u64);
        let made = loader.load(bag).and_then(|loaded| {
            let made = outputs.make(&loaded);
            Ok((made.map_err(|failure| Failure(format!("{}: {failure}", bag.display())))?, loaded))
        });
        interrupt::check()?;
        match made {
            Ok((made, loaded)) => summary.bags.push(outputs.write(bag, made, loaded)?),
            Err(failure) => summary.failed.push(Failed { bag: shown(bag), error: failure.to_string() }),
        }
    }
    drop(progress);
    if let (true, Some(failed)) = (summary.bags.is_empty(), summary.failed.first()) {
        summary.failed.iter().skip(1).for_each(|failed| say(&format!("not exported: {}", failed.error)));
        return Err(Failure(failed.error.clone()));
    }
    outputs.finish()?;
    summary.outputs = [&args.lerobot, &args.parquet, &args.csv].into_iter().flatten().map(|path| shown(path)).collect();
    summary.notes().iter().for_each(|note| say(note));
    print(&if args.json { serde_json::to_string_pretty(&summary)? + "\n" } else { summary.to_string() })?;
    Ok(if summary.has_lost() { Outcome::InputLost } else { Outcome::Done })
}

impl Args {
    /// Before any work is done.
    fn refuse_outputs(&self) -> Result<(), Failure> {
        for path in [&self.lerobot, &self.parquet, &self.csv].into_iter().flatten() {
            let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty() && !parent.is_dir());
            if let Some(parent) = parent {
                let (path, parent) = (path.display(), parent.display());
                return Err(Failure(format!("{path}: the folder {parent} is not there: create it first")));
            }
        }
        if let Some(path) = self.lerobot.as_deref().filter(|path| path.symlink_metadata().is_ok()) {
            return Err(Failure(format!(
                "{}: is there already, and a dataset is never replaced: remove it, or choose another name",
                path.display()
            )));
        }
        let mut tables = [&self.parquet, &self.csv].into_iter().flatten();
        if let Some(path) = tables.find(|path| path.exists() && !self.overwrite) {
            return Err(Failure(format!("{} is there already; give another name, or --overwrite", path.display())));
        }
        Ok(())
    }
}

/// Everything that is written, open until all bags are read.
struct Outputs<'a> {
    args: &'a Args,
    cfg: &'a Config,
    dataset: Option<Dataset>,
    layout: Option<Layout>,
    /// Joints of the tables: those of the first bag.
    joints: Option<Vec<String>>,
    parquet: Option<ColumnFile>,
    csv: Option<CsvFile>,
}

/// What one bag adds to the outputs.
struct Made {
    episode: Option<Episode>,
    /// `[regions][columns]`
    rows: Vec<Vec<Cells>>,
}

impl<'a> Outputs<'a> {
    fn create(args: &'a Args, cfg: &'a Config) -> Result<Self, Failure> {
        let spec = DatasetSpec { fps: args.fps, task: args.task.clone(), robot_type: cfg.glove.clone() };
        let dataset = args.lerobot.as_deref().map(|path| Dataset::create(path, spec)).transpose()?;
        Ok(Outputs { args, cfg, dataset, layout: None, joints: None, parquet: None, csv: None })
    }

    fn has_tables(&self) -> bool {
        self.args.parquet.is_some() || self.args.csv.is_some()
    }

    /// What a bag adds, all of it before any is written.
    fn make(&mut self, loaded: &Loaded) -> Result<Made, Failure> {
        let session = loaded.session();
        let mut episode = None;
        if self.dataset.is_some() {
            let layout = match &self.layout {
                Some(layout) => layout.clone(),
                None => Layout::new(&self.cfg.fusion, self.args.fps, self.args.tactile_window_ms, session.samples)?,
            };
            episode = Some(layout.episode(&session)?);
            self.layout = Some(layout);
        }
        let rows = match self.has_tables() {
            true => {
                let joints = self.joints.as_deref().unwrap_or(&session.samples.joint_names);
                rows(&self.cfg.fusion, joints, &session)?
            }
            false => Vec::new(),
        };
        Ok(Made { episode, rows })
    }

    fn write(&mut self, bag: &Path, made: Made, loaded: Loaded) -> Result<BagSummary, Failure> {
        let Made { episode, rows } = made;
        let summary = BagSummary::new(bag, self.cfg, &loaded, episode.as_ref(), &rows);
        if let (Some(dataset), Some(episode)) = (&mut self.dataset, episode) {
            dataset.handle_episode(episode)?;
        }
        if self.joints.is_none() && self.has_tables() {
            self.create_tables(&loaded)?;
        }
        for cells in &rows {
            self.parquet.as_mut().map_or(Ok(()), |table| table.write(cells))?;
            self.csv.as_mut().map_or(Ok(()), |table| table.write(cells))?;
        }
        Ok(summary)
    }

    fn create_tables(&mut self, first: &Loaded) -> Result<(), Failure> {
        let joints = first.samples.joint_names.clone();
        let columns = columns(&joints);
        let columns: Vec<(&str, Kind)> = columns.iter().map(|(name, kind)| (name.as_str(), *kind)).collect();
        let made_by = format!("tactile_pose_fusion {}", env!("CARGO_PKG_VERSION"));
        let notes = [("synthetic", first.synthetic.to_string()), ("made_by", made_by)];
        let Args { parquet, csv, .. } = self.args;
        self.parquet = parquet.as_deref().map(|path| ColumnFile::create(path, &columns, &notes)).transpose()?;
        self.csv = csv.as_deref().map(|path| CsvFile::create(path, &columns)).transpose()?;
        self.joints = Some(joints);
        Ok(())
    }

    /// Gives every output its name.
    fn finish(self) -> Result<(), Failure> {
        self.parquet.map_or(Ok(()), ColumnFile::finish)?;
        self.csv.map_or(Ok(()), CsvFile::finish)?;
        Ok(self.dataset.map_or(Ok(()), Dataset::finish)?)
    }
}
