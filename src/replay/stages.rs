//! Stages of a replay: reading, core, writing.
//!
//! Each stage handles the output of the stage before in its order. The result is therefore the same whether the stages
//! run in turn or on threads of their own.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::error::ReplayError;
use crate::bag::{BagError, BagReader, BagRecord, BagWriter, EstimateWriter, Input, Inputs, PassThrough, Portion};
use crate::config::Config;
use crate::fusion::{Contract, Forces, Fusion, RegressError, Regressor, SharedWindows, Tick};
use crate::observer::{Observer, check};
use crate::recording::Notes;
use crate::units::Stamp;
use crate::zero::LoadCheck;

/// Size of messages at which a portion is complete, bytes: a few hundred frames.
const PORTION_BYTES: usize = 256 << 10;

/// Number of records at which a portion is complete, if the records are small.
const PORTION_RECORDS: usize = 4096;

/// Length of the bags after which a portion is complete even if it is empty, so that progress is shown and interrupts
/// are handled.
const PORTION_SPAN: u64 = 4 << 20;

/// Reads the records that the other stages need.
pub(super) struct Reading {
    pub(super) reader: BagReader,
    /// Topics to read. `None` reads everything.
    topics: Option<BTreeSet<String>>,
    /// By channel id.
    wanted: BTreeMap<usize, bool>,
    busy: Duration,
    /// Notes of the recorder, as far as it was read.
    pub(super) notes: Notes,
}

/// A portion of the input, and the number of bytes of all bags up to its end.
pub(super) struct Read {
    pub(super) portion: Portion,
    pub(super) bytes_read: u64,
}

/// Fusion stage.
pub(super) struct CoreStage<'c> {
    cfg: &'c Config,
    pub(super) fusion: Fusion,
    pub(super) inputs: Inputs,
    /// Checks on the baseline that are not finished yet.
    check: Option<LoadCheck>,
    /// Stamps of the first and the last frame.
    pub(super) span: Option<(Stamp, Stamp)>,
    busy: Duration,
    /// Part of `busy` that the models took.
    inference: InferenceTime,
    observer: &'c dyn Observer,
}

/// A portion of the input with its results.
#[derive(Default)]
pub(super) struct Fused {
    portion: Portion,
    /// Each with the number of records that were handled before it.
    ticks: Vec<(usize, Tick)>,
}

/// Writes estimates and, if asked for, a copy of the input.
pub(super) struct Writing {
    pub(super) writer: BagWriter,
    pub(super) estimates: EstimateWriter,
    pub(super) pass_through: Option<PassThrough>,
    pub(super) busy: Duration,
}

/// Working time of each stage, s. If the stages run in parallel, the sum may exceed the elapsed time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BusySeconds {
    /// Reading and decompression.
    read: f64,
    /// Decoding, alignment, windows, contacts.
    fuse: f64,
    /// Models, in elapsed time: with more jobs it is shorter.
    infer: f64,
    /// Encoding, hashing, compression, writing.
    write: f64,
}

/// Time in the models.
#[derive(Debug, Clone, Default)]
pub(super) struct InferenceTime(Arc<AtomicU64>);

/// A model whose time is measured.
#[derive(Debug)]
struct Timed {
    model: Box<dyn Regressor>,
    time: InferenceTime,
}

impl InferenceTime {
    /// Measures the time of a model.
    pub(super) fn of(&self, model: Box<dyn Regressor>) -> Box<dyn Regressor> {
        Box::new(Timed { model, time: self.clone() })
    }

    fn get(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

impl Regressor for Timed {
    fn contract(&self) -> &Contract {
        self.model.contract()
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        let began = Instant::now();
        let ran = self.model.run(windows, out);
        self.time.0.fetch_add(began.elapsed().as_nanos() as u64, Ordering::Relaxed);
        ran
    }
}

/// Working time of each stage.
pub(super) fn busy_seconds(reading: &Reading, core: &CoreStage<'_>, writing: &Writing) -> BusySeconds {
    let infer = core.inference.get();
    BusySeconds {
        read: reading.busy.as_secs_f64(),
        fuse: core.busy.saturating_sub(infer).as_secs_f64(),
        infer: infer.as_secs_f64(),
        write: writing.busy.as_secs_f64(),
    }
}

impl Reading {
    /// Reads these topics, or everything.
    pub(super) fn new(mut reader: BagReader, topics: Option<BTreeSet<String>>) -> Self {
        if let Some(topics) = &topics {
            reader.read_only(topics);
        }
        Reading { reader, topics, wanted: BTreeMap::new(), busy: Duration::ZERO, notes: Notes::default() }
    }

    /// The next portion of the input. `None` at the end.
    pub(super) fn next(&mut self) -> Result<Option<Read>, BagError> {
        let began = Instant::now();
        let read = self.read();
        self.busy += began.elapsed();
        read
    }

    fn read(&mut self) -> Result<Option<Read>, BagError> {
        let Reading { reader, topics, wanted, notes, .. } = self;
        let (mut portion, from) = (Portion::default(), reader.bytes_read());
        while portion.n_bytes() < PORTION_BYTES && portion.len() < PORTION_RECORDS {
            let Some(record) = reader.next_record()? else {
                let bytes_read = reader.bytes_read();
                return Ok((!portion.is_empty()).then_some(Read { portion, bytes_read }));
            };
            if let BagRecord::Metadata(metadata) = &record {
                notes.handle(metadata);
            }
            let needed = match (&record, &*topics) {
                (_, None) => true,
                (BagRecord::Message(message), Some(topics)) => {
                    let channel = message.channel;
                    *wanted.entry(channel.id).or_insert_with(|| topics.contains(&channel.topic))
                }
                (BagRecord::Attachment(_) | BagRecord::Metadata(_), Some(_)) => false,
            };
            if needed {
                portion.push(&record);
            } else if reader.bytes_read() - from > PORTION_SPAN {
                break;
            }
        }
        Ok(Some(Read { portion, bytes_read: reader.bytes_read() }))
    }
}

impl Fused {
    /// The frames that resulted from it.
    pub(super) fn ticks(&self) -> impl Iterator<Item = &Tick> {
        self.ticks.iter().map(|(_, tick)| tick)
    }
}

impl<'c> CoreStage<'c> {
    /// A core before the first portion of the input.
    pub(super) fn new(
        cfg: &'c Config,
        fusion: Fusion,
        inputs: Inputs,
        check: Option<LoadCheck>,
        inference: InferenceTime,
        observer: &'c dyn Observer,
    ) -> Self {
        CoreStage { cfg, fusion, inputs, check, span: None, busy: Duration::ZERO, inference, observer }
    }

    /// Handles a portion of the input.
    pub(super) fn take(&mut self, portion: Portion) -> Result<Fused, ReplayError> {
        let began = Instant::now();
        let mut ticks = Vec::new();
        for (idx, record) in portion.records().enumerate() {
            check(self.observer)?;
            let BagRecord::Message(message) = record else { continue };
            for part in self.inputs.parts(message.channel)? {
                if let Input::Event(event) = self.inputs.decode(&message, part) {
                    self.fusion.handle(event)?;
                    self.drain(idx + 1, &mut ticks)?;
                }
            }
        }
        self.busy += began.elapsed();
        Ok(Fused { portion, ticks })
    }

    /// Handles the end of the input.
    pub(super) fn end(&mut self) -> Result<Fused, ReplayError> {
        let began = Instant::now();
        let mut ticks = Vec::new();
        self.fusion.handle_end();
        self.drain(0, &mut ticks)?;
        self.busy += began.elapsed();
        self.inputs.check_end(self.fusion.missing_joints())?;
        self.check_used()?;
        if let Some(check) = self.check.take() {
            check.judge(self.cfg)?.iter().for_each(|note| self.observer.warn(note));
        }
        Ok(Fused { portion: Portion::default(), ticks })
    }

    fn drain(&mut self, n_handled: usize, ticks: &mut Vec<(usize, Tick)>) -> Result<(), ReplayError> {
        while let Some(tick) = self.fusion.poll()? {
            let (first, last) = self.span.get_or_insert((tick.stamp, tick.stamp));
            (*first, *last) = ((*first).min(tick.stamp), (*last).max(tick.stamp));
            ticks.push((n_handled, tick.clone()));
            if let Some(check) = &mut self.check
                && !check.takes(tick)
            {
                check.judge(self.cfg)?.iter().for_each(|note| self.observer.warn(note));
                self.check = None;
            }
        }
        Ok(())
    }

    /// Refuses a run in which a tactile source had no usable data.
    fn check_used(&self) -> Result<(), ReplayError> {
        let counters = self.fusion.counters();
        let Some(idle) = counters.tactile.iter().position(|source| source.counts.used == 0) else { return Ok(()) };
        let (name, counts) = (counters.tactile[idle].name.to_owned(), counters.tactile[idle].counts);
        let n_taxels = self.cfg.fusion().tactile_sources()[idle].n_taxels;
        Err(ReplayError::Idle { name, rows: counts.rows, wrong_length: counts.wrong_length, n_taxels })
    }
}

impl Writing {
    /// Writes a portion, with the input if it is copied, and its results. The order is as if each record were written
    /// before the next one is read.
    pub(super) fn write(&mut self, fused: &Fused) -> Result<(), BagError> {
        let began = Instant::now();
        let Writing { writer, estimates, pass_through, busy } = self;
        let mut ticks = fused.ticks.iter().peekable();
        if let Some(pass_through) = pass_through {
            for (idx, record) in fused.portion.records().enumerate() {
                while let Some((_, tick)) = ticks.next_if(|(n_handled, _)| *n_handled <= idx) {
                    estimates.write(writer, tick)?;
                }
                pass_through.copy(&record, writer)?;
            }
        }
        ticks.try_for_each(|(_, tick)| estimates.write(writer, tick))?;
        *busy += began.elapsed();
        Ok(())
    }
}
