//! A bag as frames of each region: as it was recorded, or computed by the models.

use std::path::{Path, PathBuf};

use tactile_pose_fusion::bag::{BagReader, ContactReader, Input, Inputs, shown};
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::fusion::{Baseline, Event, Tick};
use tactile_pose_fusion::msg::{ContactArray, EstimateTopics, WireType};
use tactile_pose_fusion::observer::{Observer, check};
use tactile_pose_fusion::recording::input_topics;
use tactile_pose_fusion::replay::{Recording, for_each};
use tactile_pose_fusion::sessions::{Labelled, NeedsTruth, SessionError, hold_estimates, session_name};
use tactile_pose_fusion::units::{Newton, Stamp, nanos};
use tactile_pose_fusion::zero::{self, KnownModels, Wanted};

use super::error::ViewError;
use super::frames::{Frames, ViewFrame, Writing};
use super::rows::{Rows, RowsWriting};
use super::scalars::Scalars;
use super::setup::{Kind, RegionSetup, Setup, StageSetup};

/// The bag to show, and how.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// The bag.
    pub bag: &'a Path,
    /// Where the zero is from.
    pub zero: Wanted<'a>,
    /// True if the models run even if the bag holds estimates.
    pub compute: bool,
}

/// A model on the page: the name of its file, as paths are long on a phone.
fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| shown(path), |name| shown(Path::new(name)))
}

/// A bag, ready to be shown. Its frames are in temporary files, which end with it.
#[derive(Debug)]
pub struct BagView {
    setup: Setup,
    /// `[regions]`.
    regions: Vec<Frames>,
    /// The beginning of the page's time.
    origin: Stamp,
}

impl BagView {
    /// Reads a bag. Its estimates are shown if it has some on `~/contacts` of the node; otherwise the models compute them.
    ///
    /// # Errors
    /// [`ViewError`] if the bag can't be read or replayed, if it has no frames, or if there is no space for them.
    pub fn read(cfg: Config, request: &Request<'_>, observer: &dyn Observer) -> Result<Self, ViewError> {
        let bags = [request.bag.to_path_buf()];
        let labelled = Labelled::read(request.bag, &cfg, None, NeedsTruth::Tared, observer)?;
        let contacts = EstimateTopics::of_node(&cfg.node.to_string(), cfg.fusion()).contacts;
        let kept = Keeping::new(&cfg, &labelled);
        let mut read = match !request.compute && hold_estimates(&bags, &contacts) {
            true => recorded(&cfg, request, &contacts, kept, observer)?,
            false => computed(&cfg, request, kept, observer)?,
        };
        let begins = read.regions.iter().filter_map(|frames| frames.span).map(|(first, _)| first);
        let Some(origin) = begins.min() else { return Err(ViewError::Empty { bag: shown(request.bag) }) };
        let end = read.regions.iter().filter_map(|frames| frames.span).map(|(_, last)| last).max().unwrap_or(origin);
        for (region, frames) in cfg.fusion().regions().iter().zip(&read.regions) {
            if frames.n_disordered > 0 {
                read.notes.push(format!(
                    "region {}: {} frames have a stamp that is not after the one before, and are not shown",
                    region.name, frames.n_disordered
                ));
            }
        }
        read.notes.iter().for_each(|note| observer.warn(note));
        let mut setup = Setup::new(session_name(request.bag), read.kind, read.from, read.setups);
        setup.regions =
            setup.regions.into_iter().zip(&read.regions).map(|(region, frames)| region.with_frames(frames)).collect();
        let seconds = |stamp: Stamp| stamp.nanos_since(origin) as f64 * 1e-9;
        setup.stages = labelled
            .annotations()
            .all()
            .iter()
            .filter(|annotation| annotation.from <= end)
            .map(|annotation| {
                let words = [&annotation.substage, &annotation.pose].into_iter().filter(|word| !word.is_empty());
                let mut words: Vec<&str> = words.map(String::as_str).collect();
                words.dedup();
                StageSetup { t: seconds(annotation.from), name: words.join(": "), zero_load: annotation.zero_load }
            })
            .collect();
        setup.synthetic = labelled.notes().synthetic;
        setup.duration_s = seconds(end);
        let (sec, nanosec) = origin.to_sec_nanosec();
        setup.begin = format!("{sec}.{nanosec:09}");
        setup.notes = read.notes;
        if !cfg.truth().is_empty() && read.regions.iter().all(|frames| !frames.has_truth()) {
            setup.notes.push(
                "no true force: the bag lacks the force sensor's topic, or annotations of when nothing touches the glove"
                    .to_owned(),
            );
        }
        Ok(BagView { setup, regions: read.regions, origin })
    }

    pub(super) fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The traces of all regions between two times, s, each of about so many points.
    pub(super) fn traces(&self, from: f64, to: f64, points: usize) -> Result<Vec<super::bins::Traces>, ViewError> {
        let (from, to) = (self.stamp(from), self.stamp(to));
        self.regions.iter().map(|frames| frames.traces(from, to, points, self.origin)).collect()
    }

    /// The newest frame of each region at a time, s.
    pub(super) fn at(&self, t: f64) -> Result<Vec<Option<ViewFrame>>, ViewError> {
        let stamp = self.stamp(t);
        self.regions.iter().map(|frames| frames.at(stamp, self.origin)).collect()
    }

    fn stamp(&self, t: f64) -> Stamp {
        // Any time within centuries of the session; a double holds those of a bag to the nanosecond or so.
        self.origin.offset((t.clamp(-1e9, 1e9) * 1e9).round() as i64)
    }
}

/// A bag as it was read.
struct Read {
    kind: Kind,
    from: String,
    setups: Vec<RegionSetup>,
    regions: Vec<Frames>,
    notes: Vec<String>,
}

/// Source of the true force, which the frames of all regions need beside the estimates.
struct Keeping<'a> {
    cfg: &'a Config,
    labelled: &'a Labelled,
}

impl<'a> Keeping<'a> {
    fn new(cfg: &'a Config, labelled: &'a Labelled) -> Self {
        Keeping { cfg, labelled }
    }

    /// The true force of a region at a stamp.
    fn truth(&self, region: usize, stamp: Stamp) -> Option<Newton> {
        let source = self.cfg.truth_of_region()[region];
        let truth = self.labelled.truth_at(source, &[stamp], self.cfg.fusion().timing().max_gap)?;
        truth.first().copied().flatten().map(Newton::from)
    }

    /// Files for the frames of all regions.
    fn files(&self, has_taxels: bool, has_features: bool) -> Result<Vec<Writing>, ViewError> {
        let n_taxels = |taxels: usize| if has_taxels { taxels } else { 0 };
        self.cfg
            .fusion()
            .regions()
            .iter()
            .map(|region| Writing::new(n_taxels(region.taxels.len()), has_features))
            .collect()
    }

    /// The setup of each region.
    fn setups(&self, has_taxels: bool, baselines: &[Option<Baseline>]) -> Vec<RegionSetup> {
        let setup = |(region_idx, region): (usize, &tactile_pose_fusion::fusion::RegionConfig)| {
            let n_taxels = if has_taxels { region.taxels.len() } else { 0 };
            let baseline = baselines.get(region.source.position()).and_then(Option::as_ref);
            RegionSetup::new(self.cfg, region_idx, n_taxels, baseline)
        };
        self.cfg.fusion().regions().iter().enumerate().map(setup).collect()
    }
}

/// The estimates that the models compute.
fn computed(
    cfg: &Config,
    request: &Request<'_>,
    kept: Keeping<'_>,
    observer: &dyn Observer,
) -> Result<Read, ViewError> {
    let mut files = kept.files(true, true)?;
    let bags = [request.bag.to_path_buf()];
    let recording = Recording { bags: &bags, zero: request.zero };
    let mut asked = cfg.clone();
    asked.set_kept_taxels(true);
    let mut failed = None;
    let each = |tick: &Tick| {
        let mut at = 0;
        for estimate in &tick.estimates {
            let taxels = at..at + cfg.fusion().regions()[estimate.region.position()].taxels.len();
            at = taxels.end;
            let scalars = Scalars::of_estimate(estimate, kept.truth(estimate.region.position(), tick.stamp));
            let (reading, feature) = (&tick.taxels.reading[taxels.clone()], &tick.taxels.feature[taxels]);
            if failed.is_none() {
                failed = files[estimate.region.position()].handle(tick.stamp, &scalars, reading, feature).err();
            }
        }
    };
    let seen = for_each(asked, recording, observer, each)?;
    if let Some(failed) = failed {
        return Err(failed);
    }
    let sources = cfg.fusion().tactile_source_idxs();
    let baselines: Vec<_> = sources.map(|source| seen.core.baseline(source).cloned()).collect();
    let mut models: Vec<String> = cfg.models().iter().map(|model| file_name(&model.spec.path)).collect();
    models.sort();
    models.dedup();
    Ok(Read {
        kind: Kind::Computed,
        from: format!("Forces computed for this page by {}; zero from {}.", models.join(", "), seen.zero),
        setups: kept.setups(true, &baselines),
        regions: files.into_iter().map(Writing::finish).collect::<Result<_, _>>()?,
        notes: seen.warnings,
    })
}

/// The estimates that the bag holds, with the newest taxels at each.
fn recorded(
    cfg: &Config,
    request: &Request<'_>,
    topic: &str,
    kept: Keeping<'_>,
    observer: &dyn Observer,
) -> Result<Read, ViewError> {
    let bags: [PathBuf; 1] = [request.bag.to_path_buf()];
    let in_bag = |error: &dyn std::fmt::Display| SessionError::at(request.bag, error);
    let mut reader = BagReader::open(&bags)?;
    let names: Vec<&str> = cfg.tactile().iter().map(|topic| topic.name.as_str()).collect();
    reader.scan(&names)?;
    let lacks = |name: &&&str| !reader.channels().iter().any(|channel| channel.topic == **name);
    let lacking = names.iter().find(lacks).map(ToString::to_string);
    let mut notes: Vec<String> = lacking.iter().map(|name| format!("no taxels: the bag has no topic {name}")).collect();
    let has_taxels = lacking.is_none();
    let taxels = if has_taxels { cfg.tactile().to_vec() } else { Vec::new() };
    let topics = tactile_pose_fusion::bag::InputTopics {
        taxels,
        joints: Vec::new(),
        joint_sources: Vec::new(),
        ..input_topics(cfg)
    };
    let mut inputs = Inputs::new(topics, &mut reader).map_err(|error| in_bag(&error))?;
    let mut baselines: Vec<Option<Baseline>> = Vec::new();
    if has_taxels {
        // Only how taxels are drawn depends on it: the forces are those of the bag.
        match zero::find(request.zero, cfg, &bags, &KnownModels::default()) {
            Ok(zero) => baselines = zero.donning.baselines.into_iter().map(Some).collect(),
            Err(error) => notes.push(format!("taxels are shown as sent, without their zero: {error}")),
        }
    }
    let mut rows = taxel_rows(cfg, &mut reader, &mut inputs, request.bag, observer)?;
    // Contacts may be anywhere in the file: after those of later frames, or before the taxels that they are of.
    let mut reader = BagReader::open(&bags)?;
    let mut files = kept.files(has_taxels, false)?;
    let mut contacts = ContactReader::default();
    let (total, max_age_ns) = (reader.bytes_total(), nanos(cfg.fusion().timing().max_gap));
    loop {
        check(observer)?;
        observer.progress(reader.bytes_read(), total);
        let Some(message) = reader.next_message()? else { break };
        if message.channel.topic != topic || message.channel.type_name() != ContactArray::TYPE_NAME {
            continue;
        }
        let array = contacts.read(&message).map_err(|error| in_bag(&format!("{topic}: {error}")))?;
        let stamp = Stamp::from(array.header.stamp);
        for state in &array.contacts {
            let Some(idx) = cfg.fusion().regions().iter().position(|region| region.name == state.region) else {
                continue;
            };
            let region = &cfg.fusion().regions()[idx];
            let row = if has_taxels { rows[region.source.position()].at(stamp, max_age_ns)? } else { None };
            let reading: Vec<f32> = match (has_taxels, row) {
                (false, _) => Vec::new(),
                (true, None) => vec![f32::NAN; region.taxels.len()],
                (true, Some(row)) => region.taxels.iter().map(|&taxel_idx| row[taxel_idx]).collect(),
            };
            files[idx].handle(stamp, &Scalars::of_state(state, kept.truth(idx, stamp)), &reading, &[])?;
        }
    }
    notes.extend(reader.losses().iter().map(ToString::to_string));
    Ok(Read {
        kind: Kind::Recorded,
        from: format!("Forces as they were recorded on {topic}."),
        setups: kept.setups(has_taxels, &baselines),
        regions: files.into_iter().map(Writing::finish).collect::<Result<_, _>>()?,
        notes,
    })
}

/// All samples of the tactile sources of a bag, by their stamps.
fn taxel_rows(
    cfg: &Config,
    reader: &mut BagReader,
    inputs: &mut Inputs,
    bag: &Path,
    observer: &dyn Observer,
) -> Result<Vec<Rows>, ViewError> {
    let sources = cfg.fusion().tactile_sources();
    let mut writing = sources.iter().map(|_| RowsWriting::new()).collect::<Result<Vec<_>, _>>()?;
    while let Some(message) = reader.next_message()? {
        check(observer)?;
        for part in inputs.parts(message.channel).map_err(|error| SessionError::at(bag, &error))? {
            if let Input::Event(Event::Tactile(block)) = inputs.decode(&message, part) {
                writing[block.source.position()].handle(&block, &sources[block.source.position()])?;
            }
        }
    }
    writing.into_iter().zip(sources).map(|(rows, source)| rows.finish(source.n_taxels)).collect()
}
