//! `tpf replay`: a recorded bag in, newtons and contact out.

use std::path::PathBuf;
use std::time::Instant;

use super::progress::Progress;
use super::setup::{
    ModelArgs, ParamArgs, ask_for_stretches, batch_hint, input_topics, load_models, shown, without_unused_joints,
};
use super::summary::{ModelSummary, Summary};
use super::zero::{LoadCheck, ZeroArgs};
use super::{Failure, Outcome, interrupt, print, say};
use crate::bag::{BagReader, BagRecord, BagWriter, EstimateWriter, Input, Inputs, PassThrough, WriteOptions};
use crate::config::Config;
use crate::fusion::Fusion;
use crate::model::FEWEST_FOR_STRETCHES;
use crate::msg::EstimateTopics;

/// Reads bags, fuses taxels and joint angles through the models, and writes wrench and contact to a new bag.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP files or bag folders; several are parts of one recording
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
    if args.batch.is_none_or(|batch| batch >= FEWEST_FOR_STRETCHES) {
        ask_for_stretches(&mut cfg, 1);
    }
    args.models.apply(&mut cfg)?;
    let mut reader = BagReader::open(&args.bags)?;
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
    let mut writer = BagWriter::create(&args.output, options)?;
    let models = load_models(&cfg)?;
    cfg.fusion.batch = args.batch.unwrap_or_else(|| batch_hint(&models.infos));
    if args.models.replaces() {
        without_unused_joints(&mut cfg, &models.infos);
    }
    let zero = args.zero.find(&cfg, &args.bags, &models.infos)?;
    let mdf: Vec<_> = cfg.fusion.regions.iter().map(|region| models.infos[region.model].contract.mdf).collect();
    let estimates = EstimateWriter::new(&mut writer, &topics, &cfg.fusion, &mdf)?;
    let mut fusion = Fusion::new(cfg.fusion.clone(), models.regressors)?;
    zero.install(&mut fusion)?;

    let started = Instant::now();
    let pass_through = args.merge.then(PassThrough::default);
    let mut replay =
        Replay { cfg: &cfg, fusion, inputs, writer, estimates, check: zero.check, pass_through, span: None };
    let mut progress = Progress::bytes("replay", reader.bytes_total());
    replay.run(&mut reader, &mut progress)?;
    drop(progress);

    let Replay { fusion, inputs, writer, estimates, span, .. } = replay;
    let losses: Vec<String> = reader.losses().iter().map(ToString::to_string).collect();
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
        topics: inputs.counters().clone(),
        counters: fusion.counters(),
        estimates_sha256: sha256,
        losses,
    };
    finished.notes.iter().for_each(|note| say(note));
    summary.warnings(&fusion).iter().for_each(|warning| say(warning));
    let text = if args.json { summary.to_json()? } else { summary.to_string() };
    let lost = !summary.losses.is_empty() || inputs.has_unreadable();
    Ok((text, if lost { Outcome::InputLost } else { Outcome::Done }))
}

/// What runs while messages come.
struct Replay<'c> {
    cfg: &'c Config,
    fusion: Fusion,
    inputs: Inputs,
    writer: BagWriter,
    estimates: EstimateWriter,
    check: Option<LoadCheck>,
    pass_through: Option<PassThrough>,
    span: Option<(crate::units::Stamp, crate::units::Stamp)>,
}

impl Replay<'_> {
    fn run(&mut self, reader: &mut BagReader, progress: &mut Progress) -> Result<(), Failure> {
        loop {
            interrupt::check()?;
            progress.set(reader.bytes_read());
            let Some(record) = reader.next_record()? else { break };
            if let Some(pass_through) = &mut self.pass_through {
                pass_through.copy(&record, &mut self.writer)?;
            }
            let BagRecord::Message(message) = record else { continue };
            if let Input::Event(event) = self.inputs.decode(&message)? {
                self.fusion.handle(event);
                self.drain()?;
            }
        }
        self.fusion.handle_end();
        self.drain()?;
        self.inputs.check_end(self.fusion.missing_joints())?;
        self.check_used()?;
        match self.check.take() {
            Some(check) => check.judge(self.cfg),
            None => Ok(()),
        }
    }

    /// Refuses a run in which a tactile source gave nothing that could be used.
    fn check_used(&self) -> Result<(), Failure> {
        let counters = self.fusion.counters();
        let Some(idle) = counters.tactile.iter().position(|source| source.counts.used == 0) else { return Ok(()) };
        let (name, counts) = (counters.tactile[idle].name, counters.tactile[idle].counts);
        let n_taxels = self.cfg.fusion.tactile_sources[idle].n_taxels;
        Err(Failure(format!(
            "tactile source {name}: none of its {} rows could be used, {} had another length than tactile.{name}.n_taxels = {n_taxels}; correct it",
            counts.rows, counts.wrong_length
        )))
    }

    fn drain(&mut self) -> Result<(), Failure> {
        while let Some(tick) = self.fusion.poll()? {
            let (first, last) = self.span.get_or_insert((tick.stamp, tick.stamp));
            (*first, *last) = ((*first).min(tick.stamp), (*last).max(tick.stamp));
            self.estimates.write(&mut self.writer, tick)?;
            if let Some(check) = &mut self.check
                && !check.takes(tick)
            {
                check.judge(self.cfg)?;
                self.check = None;
            }
        }
        Ok(())
    }
}

fn batch(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(batch @ 1..=4096) => Ok(batch),
        _ => Err(format!("expected 1 to 4096 frames, got {text:?}")),
    }
}
