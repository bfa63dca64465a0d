//! The zero-load baseline from a bag: from its annotated stretches, or from its first seconds.

use super::inputs::{Input, InputError, Inputs};
use super::{BagError, BagReader};
use crate::fusion::{
    Baseline, BaselineBuilder, CalibrationError, CalibrationLimits, Event, FusionConfig, TactileBlock, TactileSource,
};
use crate::units::{NANOS_PER_SEC, Stamp, nanos};

/// Which part of a bag is at zero load.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ZeroLoad {
    /// The stretches that stage annotations say are.
    Annotated,
    /// The first seconds of each tactile source.
    First(f64),
}

/// Why a bag gives no baseline.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum BaselineError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(
        "tactile source {source_name}: its messages hold {got} values a row, tactile.{source_name}.n_taxels is {expected}; correct it"
    )]
    Length { source_name: String, expected: usize, got: usize },
    #[error("tactile source {source_name}: {error}")]
    Refused { source_name: String, error: CalibrationError },
}

/// A baseline of each tactile source, and the zero-load time that each was taken from.
#[derive(Debug, Clone, PartialEq)]
pub struct Baselines {
    /// `[tactile sources]`.
    pub baselines: Vec<Baseline>,
    /// `[tactile sources]`, s.
    pub spans_s: Vec<f64>,
    /// `[tactile sources]`: when each was at rest, in order of time.
    pub rest: Vec<Vec<Rest>>,
    /// `[tactile sources]`: for the first seconds, whether samples come after them.
    pub goes_on: Vec<bool>,
}

/// A stretch in which nothing touches the glove, as it is said: from the first stamp to the last, both within.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rest {
    /// The first.
    pub from: Stamp,
    /// The last.
    pub to: Stamp,
}

impl Rest {
    /// Whether a stamp lies within one of these stretches, which are in order of time.
    pub fn any_holds(stretches: &[Rest], stamp: Stamp) -> bool {
        let begun = stretches.partition_point(|rest| rest.from <= stamp);
        begun.checked_sub(1).is_some_and(|idx| stamp <= stretches[idx].to)
    }
}

/// When annotations say that nothing touches the glove.
///
/// # Errors
/// [`BaselineError`] when the bag can't be read.
pub fn annotated_rest(reader: &mut BagReader, inputs: &mut Inputs) -> Result<Vec<Rest>, BaselineError> {
    let mut annotated = Annotated::of_told(inputs);
    while let Some(message) = reader.next_message()? {
        for part in inputs.parts(message.channel)? {
            if let Input::Stage(stage) = inputs.decode(&message, part) {
                annotated.handle(stage.header.stamp.into(), stage.zero_load);
            }
        }
    }
    Ok(annotated.finish())
}

/// Stretches at rest, annotation by annotation.
#[derive(Default)]
struct Annotated {
    rest: Vec<Rest>,
    since: Option<Stamp>,
}

impl Annotated {
    /// Those that were told beside the bag, if any were.
    fn of_told(inputs: &Inputs) -> Self {
        let mut annotated = Annotated::default();
        for stage in inputs.told().unwrap_or_default() {
            annotated.handle(stage.header.stamp.into(), stage.zero_load);
        }
        annotated
    }

    fn handle(&mut self, stamp: Stamp, at_rest: bool) {
        match (self.since, at_rest) {
            (None, true) => self.since = Some(stamp),
            (Some(from), false) => {
                self.rest.push(Rest { from, to: stamp.offset(-1) });
                self.since = None;
            }
            (None, false) | (Some(_), true) => {}
        }
    }

    fn finish(mut self) -> Vec<Rest> {
        self.rest.extend(self.since.map(|from| Rest { from, to: Stamp(i64::MAX) }));
        self.rest.retain(|rest| rest.from <= rest.to);
        self.rest.sort_by_key(|rest| rest.from);
        self.rest
    }
}

/// Reads a bag for its baselines.
///
/// # Errors
/// [`BaselineError`] when the bag can't be read, or what is at zero load in it is too short or has a dead taxel.
pub fn collect_baselines(
    reader: &mut BagReader,
    inputs: &mut Inputs,
    cfg: &FusionConfig,
    zero_load: ZeroLoad,
    limits: &CalibrationLimits,
) -> Result<Baselines, BaselineError> {
    let hole_ns = nanos(cfg.timing().max_gap).max(NANOS_PER_SEC / 2); // slow sensors have long steps, not holes
    let mut sources: Vec<Collector> = cfg
        .tactile_source_idxs()
        .zip(cfg.tactile_sources())
        .map(|(source_idx, source)| Collector {
            n_taxels: source.n_taxels,
            offset_ns: source.stamp_offset_ns,
            builder: BaselineBuilder::new(source.n_taxels, hole_ns).needing(cfg.taxels_in_use(source_idx)),
            first: None,
            last: Stamp(i64::MIN),
            done: false,
            wrong_length: None,
        })
        .collect();
    // The annotation in force, and the one before it for samples that arrive after the change but are older.
    let mut annotation: Option<(Stamp, bool)> = None;
    let mut annotated = Annotated::of_told(inputs);
    // What was told is known for every sample, in whatever order they arrive.
    let told = inputs.told().is_some().then(|| Annotated::of_told(inputs).finish());
    while let Some(message) = reader.next_message()? {
        for part in inputs.parts(message.channel)? {
            match inputs.decode(&message, part) {
                Input::Event(Event::Tactile(block)) => {
                    let collector = &mut sources[block.source.position()];
                    collector.take(&block, |stamp, first| match zero_load {
                        ZeroLoad::Annotated => match &told {
                            Some(rest) => Rest::any_holds(rest, stamp),
                            None => annotation.is_some_and(|(since, at_rest)| at_rest && stamp >= since),
                        },
                        ZeroLoad::First(seconds) => stamp.nanos_since(first) as f64 <= seconds * 1e9,
                    });
                }
                Input::Stage(stage) => {
                    let since = stage.header.stamp.into();
                    annotation = Some((since, stage.zero_load));
                    annotated.handle(since, stage.zero_load);
                }
                Input::Event(Event::Joints(_)) | Input::Truth { .. } | Input::None => {}
            }
        }
        if matches!(zero_load, ZeroLoad::First(_)) && sources.iter().all(|source| source.done) {
            break;
        }
    }
    if sources.iter().any(|collector| collector.first.is_none() && collector.wrong_length.is_none()) {
        inputs.check_end(std::iter::empty())?; // which says why nothing came
    }
    let finish = |(collector, source): (&Collector, &TactileSource)| {
        if let (None, Some(got)) = (collector.first, collector.wrong_length) {
            let (source_name, expected) = (source.name.clone(), source.n_taxels);
            return Err(BaselineError::Length { source_name, expected, got });
        }
        let refused = |error| BaselineError::Refused { source_name: source.name.clone(), error };
        collector.builder.finish(limits).map_err(refused)
    };
    let annotated = annotated.finish();
    let rest = |collector: &Collector| match zero_load {
        ZeroLoad::Annotated => annotated.clone(),
        ZeroLoad::First(_) => collector.first.map(|from| Rest { from, to: collector.last }).into_iter().collect(),
    };
    Ok(Baselines {
        baselines: sources.iter().zip(cfg.tactile_sources()).map(finish).collect::<Result<_, _>>()?,
        spans_s: sources.iter().map(|collector| collector.builder.span_s()).collect(),
        rest: sources.iter().map(rest).collect(),
        goes_on: sources.iter().map(|collector| collector.done).collect(),
    })
}

struct Collector {
    n_taxels: usize,
    offset_ns: i64,
    builder: BaselineBuilder,
    first: Option<Stamp>,
    last: Stamp,
    done: bool,
    wrong_length: Option<usize>, // values in a row of the first message that has another number than the source
}

impl Collector {
    fn take(&mut self, block: &TactileBlock<'_>, at_rest: impl Fn(Stamp, Stamp) -> bool) {
        if !block.is_of(self.n_taxels) {
            self.wrong_length.get_or_insert(block.values.len() / block.rows.max(1));
            return; // replay counts it
        }
        for (row_idx, row) in block.values.chunks_exact(self.n_taxels).enumerate() {
            let before_last = (block.rows - 1 - row_idx) as i64;
            let stamp = block.stamp.offset(self.offset_ns - block.row_period_ns.saturating_mul(before_last));
            let first = *self.first.get_or_insert(stamp);
            if at_rest(stamp, first) {
                self.builder.handle_sample(stamp, row);
                self.last = self.last.max(stamp);
            } else {
                self.done = true;
            }
        }
    }
}
