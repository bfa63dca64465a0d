//! `tpf replay`: a recorded bag in, newtons and contact out.

mod side_by_side;
mod stages;

use std::num::NonZero;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::progress::Progress;
use super::setup::{ModelArgs, ParamArgs, batch_hint, input_topics, load_models, shown, without_unused_joints};
use super::summary::{ModelSummary, Summary};
use super::zero::ZeroArgs;
use super::{Failure, Outcome, interrupt, print, say, sessions};
use crate::bag::{BagError, BagWriter, EstimateWriter, Inputs, PassThrough, WriteOptions};
use crate::fusion::Fusion;
use crate::msg::EstimateTopics;
pub(super) use stages::BusySeconds;
use stages::{Core, InferenceTime, Reading, Writing, busy_seconds};

/// Reads bags, fuses taxels and joint angles through the models, and writes wrench and contact to a new bag.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP file or bag folder: one recording; several are parts of one, merged by time
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    /// Bag to write: NAME.mcap for a file, any other name for a bag folder
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    models: ModelArgs,
    #[command(flatten)]
    zero: ZeroArgs,
    /// Frames in one inference call, unless set as many as the model runs fastest with; 1 gives the bytes of the live node
    #[arg(long, value_name = "N", value_parser = batch)]
    batch: Option<usize>,
    /// Cores to use, as many as there are unless set; the output is the same on any number
    #[arg(long, value_name = "N")]
    jobs: Option<NonZero<usize>>,
    /// Copy everything in the input into the output, untouched
    #[arg(long)]
    merge: bool,
    /// Replace an output that is already there
    #[arg(long)]
    overwrite: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let (text, outcome) = replay(args)?;
    print(&text)?;
    Ok(outcome)
}

/// Replays, and gives the summary to print.
pub(super) fn replay(args: &Args) -> Result<(String, Outcome), Failure> {
    let mut cfg = args.params.load()?;
    let jobs = args.jobs.or_else(|| std::thread::available_parallelism().ok()).unwrap_or(NonZero::<usize>::MIN);
    cfg.models.iter_mut().for_each(|model| model.spec.threads = jobs);
    args.models.apply(&mut cfg)?;
    let mut reader = sessions::open(&args.bags)?;
    let inputs = Inputs::new(input_topics(&cfg), &mut reader)?;
    let topics = EstimateTopics::of_node(&cfg.node.to_string(), &cfg.fusion);
    if args.merge
        && let Some(taken) = topics.names().find(|name| reader.channels().iter().any(|channel| channel.topic == *name))
    {
        return Err(Failure(format!(
            "topic {taken} is already in the input, --merge would mix two runs; choose another --node, or leave --merge out"
        )));
    }
    interrupt::listen();
    let options = WriteOptions { overwrite: args.overwrite, inputs: args.bags.clone(), ..WriteOptions::default() };
    let mut writer = BagWriter::create(&args.output, options).map_err(|error| match error {
        BagError::Exists { path } => {
            Failure(format!("{}: is there already; choose another name, or give --overwrite", path.display()))
        }
        error => error.into(),
    })?;
    let models = load_models(&cfg)?;
    cfg.fusion.batch = args.batch.unwrap_or_else(|| batch_hint(&models.infos));
    if args.models.replaces() {
        without_unused_joints(&mut cfg, &models.infos);
    }
    let zero = args.zero.find(&cfg, &args.bags, &models.infos)?;
    let contracts: Vec<_> = cfg.fusion.regions.iter().map(|region| &models.infos[region.model].contract).collect();
    let estimates = EstimateWriter::new(&mut writer, &topics, &cfg.fusion, &contracts)?;
    let inference = InferenceTime::default();
    let regressors = models.regressors.into_iter().map(|model| inference.of(model)).collect();
    cfg.fusion.receipts = inputs.receipts(&reader);
    let mut fusion = Fusion::new(cfg.fusion.clone(), regressors)?;
    zero.install(&mut fusion)?;

    let started = Instant::now();
    let topics = (!args.merge).then(|| inputs.topics());
    let mut progress = Progress::bytes("replay", reader.bytes_total());
    let mut core = Core { cfg: &cfg, fusion, inputs, check: zero.check, span: None, busy: Duration::ZERO, inference };
    let writing =
        Writing { writer, estimates, pass_through: args.merge.then(PassThrough::default), busy: Duration::ZERO };
    let (reading, writing) = side_by_side::run(Reading::new(reader, topics), &mut core, writing, jobs, &mut progress)?;
    drop(progress);
    let busy = busy_seconds(&reading, &core, &writing);

    let (Core { fusion, inputs, span, .. }, Writing { mut writer, mut estimates, .. }) = (core, writing);
    let reader = reading.reader;
    let losses: Vec<String> = reader.losses().iter().map(ToString::to_string).collect();
    estimates.finish(&mut writer)?;
    let sha256 = estimates.sha256();
    let finished = writer.finish()?;
    let summary = Summary {
        inputs: args.bags.iter().map(|bag| shown(bag)).collect(),
        output: shown(&finished.path),
        baseline: zero.from,
        models: cfg
            .models
            .iter()
            .zip(&models.infos)
            .map(|(model, info)| ModelSummary::new(&model.name, info))
            .collect(),
        data_s: span.map_or(0.0, |(first, last)| last.nanos_since(first) as f64 * 1e-9),
        wall_s: started.elapsed().as_secs_f64(),
        jobs: jobs.get(),
        busy_s: busy,
        topics: inputs.counters().clone(),
        counters: fusion.counters(),
        estimates_sha256: sha256,
        losses,
    };
    finished.notes.iter().for_each(|note| say(note));
    summary.warnings(&fusion).iter().for_each(|warning| say(warning));
    inputs.angle_doubts().iter().for_each(|doubt| say(doubt));
    let text = if args.json { summary.to_json()? } else { summary.to_string() };
    let lost = !summary.losses.is_empty() || inputs.has_unreadable();
    Ok((text, if lost { Outcome::InputLost } else { Outcome::Done }))
}

fn batch(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(batch @ 1..=4096) => Ok(batch),
        _ => Err(format!("expected 1 to 4096 frames, got {text:?}")),
    }
}
