//! Computes force and contact for a recording: [`run`] writes them to a bag, [`for_each`] passes them on frame by
//! frame.
//!
//! Both use the same stages, and the same core as the live node.

mod error;
mod kept;
mod side_by_side;
mod stages;
mod summary;

use std::num::{NonZero, NonZeroUsize};
use std::path::PathBuf;
use std::time::{Duration, Instant};

pub use error::ReplayError;
pub use kept::is_there;
pub use stages::BusySeconds;
pub use summary::{ModelSummary, Replayed, Summary};

use crate::bag::{BagReader, BagWriter, EstimateWriter, Inputs, PassThrough, WriteOptions, printable, shown};
use crate::config::{Config, ModelConfig};
use crate::fusion::{Fusion, Tick};
use crate::glove::{Models, known};
use crate::model::ModelInfo;
use crate::msg::EstimateTopics;
use crate::observer::Observer;
use crate::recording::{Notes, input_topics};
use crate::units::Stamp;
use crate::zero::{self, Wanted, ZeroFrom};
use stages::{CoreStage, InferenceTime, Read, Reading, Writing, busy_seconds};

/// Input of a replay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recording<'a> {
    /// MCAP files or bag folders of one recording. Several are merged by time.
    pub bags: &'a [PathBuf],
    /// Source of the zero of the forces.
    pub zero: Wanted<'a>,
}

/// Options of a replay to a bag.
#[derive(Debug, Clone)]
pub struct Options {
    /// Path of the output: NAME.mcap for a file, any other name for a bag folder.
    pub output: PathBuf,
    /// True if an existing output is replaced.
    pub overwrite: bool,
    /// True if everything in the input is copied to the output.
    pub merge: bool,
    /// Frames per inference call. `None` takes the number at which the models run fastest. With 1, the output has the
    /// same bytes as that of the live node.
    pub batch: Option<NonZeroUsize>,
    /// Number of cores to use. The output is the same for any number.
    pub jobs: NonZero<usize>,
}

impl Options {
    /// Options for a new bag, with all cores.
    pub fn new(output: impl Into<PathBuf>) -> Self {
        Options {
            output: output.into(),
            overwrite: false,
            merge: false,
            batch: None,
            jobs: std::thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN),
        }
    }
}

/// Result of [`for_each`].
#[derive(Debug)]
pub struct Seen {
    /// Source of the zero.
    pub zero: ZeroFrom,
    /// Data of the input that were lost or could not be decoded, one line each.
    pub warnings: Vec<String>,
    /// The core after the last frame, for its counters.
    pub core: Fusion,
}

/// Replays a recording to a bag.
///
/// # Errors
/// [`ReplayError`]. There is then no output.
pub fn run(
    mut cfg: Config,
    recording: Recording<'_>,
    options: &Options,
    observer: &dyn Observer,
) -> Result<Replayed, ReplayError> {
    cfg.models_mut().iter_mut().for_each(|model| model.spec.threads = options.jobs);
    let mut reader = open(recording.bags, observer)?;
    let inputs = Inputs::new(input_topics(&cfg), &mut reader)?;
    let topics = EstimateTopics::of_node(&cfg.node.to_string(), cfg.fusion());
    if options.merge
        && let Some(taken) = topics.names().find(|name| reader.channels().iter().any(|channel| channel.topic == *name))
    {
        return Err(ReplayError::TopicTaken { topic: taken.to_owned() });
    }
    let write =
        WriteOptions { overwrite: options.overwrite, inputs: recording.bags.to_vec(), ..WriteOptions::default() };
    let mut writer = BagWriter::create(&options.output, write)?;
    let Ready { models, fusion, zero, inference } =
        ready(&mut cfg, recording, &inputs, &reader, options.batch, observer)?;
    let contracts: Vec<_> =
        cfg.fusion().regions().iter().map(|region| &models.infos[region.model.position()].contract).collect();
    let estimates = EstimateWriter::new(&mut writer, &topics, cfg.fusion(), &contracts)?;

    let started = Instant::now();
    let wanted = (!options.merge).then(|| inputs.topics());
    let total = reader.bytes_total();
    let mut core = CoreStage::new(&cfg, fusion, inputs, zero.check, inference, observer);
    let pass_through = options.merge.then(PassThrough::default);
    let writing = Writing { writer, estimates, pass_through, busy: Duration::ZERO };
    let progress = |done| observer.progress(done, total);
    let (reading, writing) =
        side_by_side::run(Reading::new(reader, wanted), &mut core, writing, options.jobs, &progress)?;
    let busy = busy_seconds(&reading, &core, &writing);

    let (CoreStage { fusion, inputs, span, .. }, Writing { mut writer, mut estimates, .. }) = (core, writing);
    let losses: Vec<String> = reading.reader.losses().iter().map(ToString::to_string).collect();
    estimates.finish(&mut writer)?;
    let estimates_sha256 = estimates.sha256();
    let finished = writer.finish()?;
    let of_another_glove = glove_doubts(&cfg, &models.infos, &reading.notes);
    let models = cfg.models().iter().zip(&models.infos).map(|(model, info)| ModelSummary::new(&model.name, info));
    Ok(Replayed {
        inputs: recording.bags.iter().map(|bag| shown(bag)).collect(),
        output: shown(&finished.path),
        zero: zero.from,
        models: models.collect(),
        data_s: seconds(span),
        wall_s: started.elapsed().as_secs_f64(),
        jobs: options.jobs.get(),
        busy,
        topics: inputs.counters(),
        estimates_sha256,
        losses,
        doubts: inputs.angle_doubts().into_iter().chain(of_another_glove).collect(),
        written: finished.notes,
        core: fusion,
    })
}

/// Runs a recording through the core and passes on the estimates of each frame, in the order of their stamps within a
/// source.
///
/// # Errors
/// [`ReplayError`]. The frames that were passed on before are valid.
pub fn for_each(
    mut cfg: Config,
    recording: Recording<'_>,
    observer: &dyn Observer,
    mut each: impl FnMut(&Tick),
) -> Result<Seen, ReplayError> {
    let mut reader = open(recording.bags, observer)?;
    let inputs = Inputs::new(input_topics(&cfg), &mut reader)?;
    let Ready { models, fusion, zero, inference } = ready(&mut cfg, recording, &inputs, &reader, None, observer)?;
    let (wanted, total) = (Some(inputs.topics()), reader.bytes_total());
    let mut core = CoreStage::new(&cfg, fusion, inputs, zero.check, inference, observer);
    let mut reading = Reading::new(reader, wanted);
    while let Some(Read { portion, bytes_read }) = reading.next()? {
        observer.progress(bytes_read, total);
        core.take(portion)?.ticks().for_each(&mut each);
    }
    core.end()?.ticks().for_each(&mut each);
    let CoreStage { fusion, inputs, .. } = core;
    let losses: Vec<String> = reading.reader.losses().iter().map(ToString::to_string).collect();
    let mut warnings = summary::warnings(&losses, &inputs.counters(), &fusion);
    warnings.extend(inputs.angle_doubts());
    warnings.extend(glove_doubts(&cfg, &models.infos, &reading.notes));
    Ok(Seen { zero: zero.from, warnings, core: fusion })
}

/// Models, core and zero, ready for the first message.
struct Ready {
    models: Models,
    fusion: Fusion,
    zero: zero::Zero,
    inference: InferenceTime,
}

fn ready(
    cfg: &mut Config,
    recording: Recording<'_>,
    inputs: &Inputs,
    reader: &BagReader,
    batch: Option<NonZeroUsize>,
    observer: &dyn Observer,
) -> Result<Ready, ReplayError> {
    let mut models = Models::load(cfg)?;
    models.tell(cfg, observer);
    let batch = batch.unwrap_or_else(|| models.batch_hint());
    cfg.set_batch(batch);
    cfg.set_receipts(inputs.receipts(reader));
    let zero = zero::find(recording.zero, cfg, recording.bags, &known(cfg, &models.infos))?;
    zero.notes.iter().for_each(|note| observer.note(note));
    let inference = InferenceTime::default();
    let regressors = std::mem::take(&mut models.regressors).into_iter().map(|model| inference.of(model)).collect();
    let mut fusion = Fusion::new(cfg.fusion().clone(), regressors)?;
    zero.install(&mut fusion)?;
    Ok(Ready { models, fusion, zero, inference })
}

/// Beginning of the names of the simulator's gloves.
const SYNTHETIC: &str = "synthetic-";

/// Doubts whether models belong to the glove of a recording, where the parameters don't name the glove.
fn glove_doubts(cfg: &Config, infos: &[ModelInfo], notes: &Notes) -> Vec<String> {
    // Sessions of the simulator have the number of their glove, and models its whole name.
    let whole = |worn: &String| match notes.synthetic && !worn.starts_with(SYNTHETIC) {
        true => format!("{SYNTHETIC}{worn}"),
        false => worn.clone(),
    };
    let worn = notes.glove.as_ref().map(whole);
    let of_model = |(model, info): (&ModelConfig, &ModelInfo)| {
        let noted = |key: &str| info.noted(key).map(printable);
        let name = &model.name;
        match (noted("glove"), &worn) {
            (Some(trained), Some(worn)) if trained != *worn && cfg.glove.is_none() && model.spec.of_glove.is_none() => {
                return Some(format!(
                    "model {name}: it was trained on glove {trained}, and the recording is of glove {worn}: its forces are not those of this glove"
                ));
            }
            _ => {}
        }
        let on_synthetic = noted("trained_on").filter(|trained| trained.contains("synthetic") && !notes.synthetic)?;
        Some(format!(
            "model {name}: it was trained on {on_synthetic}, and the recording does not say that it is synthetic: if it is of a real glove, the forces mean nothing"
        ))
    };
    cfg.models().iter().zip(infos).filter_map(of_model).collect()
}

fn open(bags: &[PathBuf], observer: &dyn Observer) -> Result<BagReader, ReplayError> {
    let reader = BagReader::open(bags)?;
    reader.notes().iter().for_each(|note| observer.note(note));
    Ok(reader)
}

fn seconds(span: Option<(Stamp, Stamp)>) -> f64 {
    span.map_or(0.0, |(first, last)| last.nanos_since(first) as f64 * 1e-9)
}
