//! Writes a LeRobotDataset v3.
//!
//! The layout is that of `lerobot` 0.4.4 and 0.6.1 (`src/lerobot/datasets`): `meta/info.json`, `meta/stats.json`,
//! `meta/tasks.parquet`, `meta/episodes/chunk-000/file-000.parquet`, and frames in `data/chunk-000/file-000.parquet`.

mod notes;
mod sealed;
mod shard;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

pub(super) use self::notes::{ShardBag, ShardNotes};
pub use self::shard::{Joined, join};

use super::card::card;
use super::stats::{QUANTILES, Stats};
use super::{Episode, ExportError, Feature};
use crate::columns::{Cells, ColumnFile, Kind};
use crate::files::{self, NewFolder};

/// Size of a data file above which the next episode starts a new file; LeRobot's value.
const FILE_MB: usize = 100;

/// Number of LeRobot's counter columns, the last columns of every table.
const N_COUNTING: usize = 5;

/// Files per chunk; LeRobot's value.
const CHUNK_FILES: usize = 1000;

/// Properties of a whole dataset.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DatasetSpec {
    /// Frames per second.
    pub fps: u32,
    /// Description of the task, the same for all episodes.
    pub task: String,
    /// Name of the hardware that recorded the data.
    pub robot_type: Option<String>,
}

/// A dataset that is being written. It gets its name in [`finish`](Self::finish), and is deleted if it is dropped
/// before.
pub struct Dataset {
    out: PathBuf,
    folder: NewFolder,
    spec: DatasetSpec,
    /// True if some data are simulated, not recorded.
    synthetic: bool,
    /// Name, type and shape of each feature, from the first episode.
    schema: Vec<(String, Value)>,
    data: Option<ColumnFile>,
    n_files: usize,
    n_frames: usize,
    episodes: Vec<Row>,
}

/// Metadata of an episode.
struct Row {
    file: usize,
    from: usize,
    to: usize,
    /// `[features]`.
    stats: Vec<Option<Stats>>,
}

impl Dataset {
    /// Creates a dataset that will be named `out`. Nothing may exist there.
    ///
    /// # Errors
    /// [`ExportError::Io`] if `out` exists, or if a write fails.
    pub fn create(out: &Path, spec: DatasetSpec) -> Result<Self, ExportError> {
        let folder = NewFolder::create(out, &["info.json"]).map_err(io(out))?;
        Ok(Dataset {
            out: out.to_path_buf(),
            folder,
            spec,
            synthetic: false,
            schema: Vec::new(),
            data: None,
            n_files: 0,
            n_frames: 0,
            episodes: Vec::new(),
        })
    }

    /// Adds an episode with the same layout as the episodes before.
    ///
    /// # Errors
    /// [`ExportError`] if a write fails.
    pub fn handle_episode(&mut self, episode: Episode) -> Result<(), ExportError> {
        let (n, from) = (episode.n_frames, self.n_frames);
        self.synthetic |= episode.synthetic;
        let mut features = episode.features;
        features.extend(self.counting_features(n));
        if self.schema.is_empty() {
            self.schema = features.iter().map(|feature| (feature.name.clone(), description(feature))).collect();
        }
        if self.data.as_ref().is_some_and(|data| data.bytes_written() >= FILE_MB << 20) {
            self.finish_data()?;
        }
        let mut data = match self.data.take() {
            Some(data) => data,
            None => {
                let columns: Vec<(&str, Kind)> =
                    features.iter().map(|feature| (feature.name.as_str(), feature.cells.kind())).collect();
                let path = self.in_folder("data", self.n_files)?;
                self.n_files += 1;
                ColumnFile::create(&path, &columns, &[], false)?
            }
        };
        let (stats, cells): (Vec<_>, Vec<_>) =
            features.into_iter().map(|feature| (Stats::of(&feature.cells), feature.cells)).unzip();
        data.write(&cells)?;
        self.data = Some(data);
        self.n_frames += n;
        self.episodes.push(Row { file: self.n_files - 1, from, to: self.n_frames, stats });
        Ok(())
    }

    /// Refuses an episode of a shard whose features differ from those of the episodes before.
    fn refuse_other_features(&self, episode: &Episode, of: &Path) -> Result<(), ExportError> {
        let ours = self.schema.iter().take(self.schema.len().saturating_sub(N_COUNTING));
        let theirs = episode.features.iter().map(|feature| (feature.name.clone(), description(feature)));
        if self.schema.is_empty() || ours.cloned().eq(theirs) {
            return Ok(());
        }
        let reason = "its features are not those of the other shards".to_owned();
        Err(ExportError::Shard { path: of.to_path_buf(), reason })
    }

    /// Gives the dataset its name.
    ///
    /// # Errors
    /// [`ExportError`] if `out` exists by now, or if a write fails. There is then no dataset.
    pub fn finish(mut self) -> Result<(), ExportError> {
        self.complete()?;
        self.folder.put_in_place().map_err(io(&self.out))
    }

    /// As [`finish`](Self::finish), as a shard of a larger dataset, sealed with the checksums of its files.
    pub(super) fn finish_shard(mut self, notes: &ShardNotes) -> Result<(), ExportError> {
        self.complete()?;
        let folder = self.folder.path();
        let text = sealed::seal(folder, notes).map_err(io(&self.out))?;
        files::replace(&folder.join(sealed::FILE), text.as_bytes()).map_err(io(&self.out))?;
        self.folder.put_in_place().map_err(io(&self.out))
    }

    /// Writes what is still missing.
    fn complete(&mut self) -> Result<(), ExportError> {
        self.finish_data()?;
        self.write_tasks()?;
        self.write_episodes()?;
        self.write_json("stats.json", &self.stats())?;
        self.write_json("info.json", &self.info())?;
        let readme = self.folder.path().join("README.md");
        let text = card(self.spec.fps, &self.spec.task, self.synthetic);
        files::replace(&readme, text.as_bytes()).map_err(io(&self.out))
    }

    fn finish_data(&mut self) -> Result<(), ExportError> {
        Ok(self.data.take().map_or(Ok(()), ColumnFile::finish)?)
    }

    /// LeRobot's counter columns. Their times are relative to the episode; absolute stamps are in `stamp_ns`.
    fn counting_features(&self, n: usize) -> [Feature; N_COUNTING] {
        let fps = f64::from(self.spec.fps);
        let whole = |of: &dyn Fn(usize) -> usize| Cells::Whole((0..n).map(|idx| i64::try_from(of(idx)).ok()).collect());
        let (episode, before) = (self.episodes.len(), self.n_frames);
        let seconds = Cells::Single((0..n).map(|idx| (idx as f64 / fps) as f32).collect());
        [
            Feature::plain("timestamp".to_owned(), seconds),
            Feature::plain("frame_index".to_owned(), whole(&|idx| idx)),
            Feature::plain("episode_index".to_owned(), whole(&|_| episode)),
            Feature::plain("index".to_owned(), whole(&|idx| before + idx)),
            Feature::plain("task_index".to_owned(), whole(&|_| 0)),
        ]
    }

    /// Path of a numbered file. Creates its folder.
    fn in_folder(&self, kind: &str, file: usize) -> Result<PathBuf, ExportError> {
        let path = numbered(&self.folder.path().join(kind), file);
        std::fs::create_dir_all(path.parent().unwrap_or(self.folder.path())).map_err(io(&self.out))?;
        Ok(path)
    }

    /// Writes the tasks as a pandas data frame with the task as its index, because LeRobot searches for it there.
    fn write_tasks(&self) -> Result<(), ExportError> {
        const INDEX: &str = "__index_level_0__";
        let column = |name: Option<&str>, field: &str, pandas: &str, numpy: &str| json!({"name": name, "field_name": field, "pandas_type": pandas, "numpy_type": numpy, "metadata": null});
        let pandas = json!({
            "index_columns": [INDEX],
            "column_indexes": [{"name": null, "field_name": null, "pandas_type": "unicode", "numpy_type": "object", "metadata": {"encoding": "UTF-8"}}],
            "columns": [column(Some("task_index"), "task_index", "int64", "int64"), column(None, INDEX, "unicode", "object")],
            "creator": {"library": "tactile_pose_fusion", "version": env!("CARGO_PKG_VERSION")},
            "pandas_version": "2.0.0",
        });
        let path = self.meta_file("tasks.parquet")?;
        let columns = [("task_index", Kind::Whole), (INDEX, Kind::Text)];
        let mut file = ColumnFile::create(&path, &columns, &[("pandas", pandas.to_string())], false)?;
        file.write(&[Cells::Whole(vec![Some(0)]), Cells::Text(vec![Some(self.spec.task.clone())])])?;
        Ok(file.finish()?)
    }

    fn write_episodes(&self) -> Result<(), ExportError> {
        let whole = |of: &dyn Fn(&Row) -> usize| {
            Cells::Whole(self.episodes.iter().map(|row| i64::try_from(of(row)).ok()).collect())
        };
        let numbers = (0..self.episodes.len()).map(|idx| i64::try_from(idx).ok()).collect();
        let tasks = vec![Some(vec![self.spec.task.clone()]); self.episodes.len()];
        let mut table: Vec<(String, Cells)> = vec![
            ("episode_index".to_owned(), Cells::Whole(numbers)),
            ("tasks".to_owned(), Cells::Texts(tasks)),
            ("length".to_owned(), whole(&|row| row.to - row.from)),
            ("data/chunk_index".to_owned(), whole(&|row| row.file / CHUNK_FILES)),
            ("data/file_index".to_owned(), whole(&|row| row.file % CHUNK_FILES)),
            ("dataset_from_index".to_owned(), whole(&|row| row.from)),
            ("dataset_to_index".to_owned(), whole(&|row| row.to)),
        ];
        for (idx, (feature, _)) in self.schema.iter().enumerate() {
            let of = |row: &Row, name: &str| {
                let stats = row.stats[idx].as_ref()?;
                stats.named().find(|(known, _)| *known == name).map(|(_, values)| values.to_vec())
            };
            for name in ["min", "max", "mean", "std"].into_iter().chain(QUANTILES.iter().map(|(_, name)| *name)) {
                let cells = Cells::Numbers(self.episodes.iter().map(|row| of(row, name)).collect());
                table.push((format!("stats/{feature}/{name}"), cells));
            }
            let count = |row: &Row| i64::try_from(row.stats[idx].as_ref()?.count).ok().map(|count| vec![count]);
            let counts = Cells::Wholes(self.episodes.iter().map(count).collect());
            table.push((format!("stats/{feature}/count"), counts));
        }
        table.push(("meta/episodes/chunk_index".to_owned(), whole(&|_| 0)));
        table.push(("meta/episodes/file_index".to_owned(), whole(&|_| 0)));
        let columns: Vec<(&str, Kind)> = table.iter().map(|(name, cells)| (name.as_str(), cells.kind())).collect();
        let path = self.in_folder("meta/episodes", 0)?;
        let mut file = ColumnFile::create(&path, &columns, &[], false)?;
        file.write(&table.into_iter().map(|(_, cells)| cells).collect::<Vec<_>>())?;
        Ok(file.finish()?)
    }

    /// Statistics of all episodes. A feature without known values has none, because any number would be misleading.
    fn stats(&self) -> Value {
        let of = |idx: usize| Stats::of_all(self.episodes.iter().filter_map(move |row| row.stats[idx].as_ref()));
        let stats = self.schema.iter().enumerate();
        Value::Object(stats.filter_map(|(idx, (name, _))| Some((name.clone(), of(idx)?.to_json()))).collect())
    }

    fn info(&self) -> Value {
        let robot_type = match (&self.spec.robot_type, self.synthetic) {
            (Some(name), true) => json!(format!("{name} (synthetic)")),
            (None, true) => json!("synthetic"),
            (name, false) => json!(name),
        };
        json!({
            "codebase_version": "v3.0",
            "robot_type": robot_type,
            "total_episodes": self.episodes.len(),
            "total_frames": self.n_frames,
            "total_tasks": 1,
            "chunks_size": CHUNK_FILES,
            "data_files_size_in_mb": FILE_MB,
            "video_files_size_in_mb": 200,
            "fps": self.spec.fps,
            "splits": {"train": format!("0:{}", self.episodes.len())},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": null,
            "features": self.schema.iter().cloned().collect::<serde_json::Map<_, _>>(),
        })
    }

    fn write_json(&self, name: &str, value: &Value) -> Result<(), ExportError> {
        let text = serde_json::to_string_pretty(value)? + "\n";
        files::replace(&self.meta_file(name)?, text.as_bytes()).map_err(io(&self.out))
    }

    fn meta_file(&self, name: &str) -> Result<PathBuf, ExportError> {
        let meta = self.folder.path().join("meta");
        std::fs::create_dir_all(&meta).map_err(io(&self.out))?;
        Ok(meta.join(name))
    }
}

/// Path of a numbered file in a chunk folder.
fn numbered(folder: &Path, file: usize) -> PathBuf {
    let chunk = folder.join(format!("chunk-{:03}", file / CHUNK_FILES));
    chunk.join(format!("file-{:03}.parquet", file % CHUNK_FILES))
}

/// Type and shape of a feature, as in `info.json`.
fn description(feature: &Feature) -> Value {
    let (dtype, shape) = match &feature.cells {
        Cells::Whole(_) => ("int64", vec![1]),
        Cells::Flag(_) => ("bool", vec![1]),
        Cells::Vector { len, .. } => ("float32", vec![*len]),
        Cells::Matrix { n_rows, n_columns, .. } => ("float32", vec![*n_rows, *n_columns]),
        _ => ("float32", vec![1]),
    };
    json!({"dtype": dtype, "shape": shape, "names": feature.names})
}

fn io(out: &Path) -> impl Fn(std::io::Error) -> ExportError {
    let path = out.display().to_string();
    move |error| ExportError::Io { path: path.clone(), error }
}
