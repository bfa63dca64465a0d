//! Faults of a tactile source while it runs: readings that stand still, two senders on one topic, and a rate that
//! isn't the model's.
//!
//! The raw rows are checked, by the noise that the calibration found. A taxel whose noise is 0 there, because it is
//! quantized more coarsely than it is noisy, or because it is unknown, may stand still for any time.

use std::fmt;

use super::config::{FrameClock, TactileSource};
use super::estimate::Flags;
use crate::units::{NANOS_PER_SEC, Stamp};

/// Evidence (nats) from which readings stand still for another reason than chance: once in 2e17 rows.
const ENOUGH: f64 = 40.0;

/// Evidence (nats) of a repeated reading of a taxel whose noise is two of its steps or more: such noise repeats a
/// reading in at most 17 % of rows, wherever between two steps its mean lies.
const CLEAR: f64 = 1.77;

/// The same for noise of about one step, or where steps are not known yet: a mean in the middle of a step repeats in up to 80 %.
const FAINT: f64 = 0.22;

/// Least rows for which a whole source must repeat itself: noise is not quite independent from row to row.
const MIN_FROZEN_ROWS: u32 = 10;

/// Least time for which a whole source must repeat itself: as long as a source may be silent, unless that is set.
const MIN_FROZEN_NS: i64 = 100_000_000;

/// Least rows for which a single taxel must repeat itself, and least time.
const MIN_STUCK_ROWS: u32 = 50;
const MIN_STUCK_NS: i64 = 500_000_000;

/// Of the last 32 rows, as many must alternate to be of two senders, and no more than that to be of one again.
const INTERLEAVED_ROWS: u32 = 24;
const ALONE_ROWS: u32 = 4;

/// Rows alternate when each is so many times as far from the one before as from the one before that, and from the one before
/// so many deviations of the noise.
const ALTERNATION: f64 = 4.0;
const ALTERNATION_NOISE: f64 = 8.0;

/// Tolerance of a source's rate against its model's.
const RATE_TOLERANCE: f64 = 0.2;

/// Time of frames that a rate is taken over.
const RATE_WINDOW_NS: i64 = NANOS_PER_SEC;

/// A tactile source, each of whose samples is a frame, that doesn't come at its model's rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateFault<'a> {
    /// Name in the parameters.
    pub source: &'a str,
    /// Frames a second as they came.
    pub measured_hz: f64,
    /// Frames a second that the model was trained on.
    pub model_hz: f64,
}

/// Current faults of a tactile source.
#[derive(Debug, Clone, PartialEq)]
pub enum SourceFault<'a> {
    /// All taxels stand still.
    Frozen(&'a str),
    /// Rows of two senders come in turn.
    Interleaved(&'a str),
    /// These taxels stand still.
    Stuck(&'a str, Vec<usize>),
    /// It comes at another rate than its model's.
    Rate(RateFault<'a>),
}

/// The rows of one source, judged.
#[derive(Debug, Clone)]
pub struct SourceHealth {
    taxels: Vec<Taxel>,
    /// Evidence from one repeated row of all taxels, nats.
    evidence: f64,
    /// How far the taxels scatter by noise or steps, summed, raw units.
    noise: f64,
    /// The row before the last one.
    before: Vec<f32>,
    /// Rows that were seen, up to two.
    n_rows: u32,
    same_rows: u32,
    same_since: Stamp,
    frozen: bool,
    n_stuck: usize,
    /// The last two counts of the sender.
    sequences: [Option<u32>; 2],
    counts_alternate: bool,
    /// One bit a row, the newest lowest.
    alternated: u32,
    interleaved: bool,
    /// Frames a second of the model, where each sample is a frame.
    model_hz: Option<f64>,
    /// Intervals between frames, and their time, since the rate was last taken.
    intervals: (u32, i64),
    recent_hz: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Taxel {
    last: f32,
    /// Smallest step that was seen, raw units; infinite before the first.
    step: f32,
    noise: f32,
    /// Evidence from one repeated reading, nats.
    evidence: f64,
    rows: u32,
    since: Stamp,
    stuck: bool,
}

impl SourceHealth {
    /// For a source with unknown properties.
    pub(super) fn new(source: &TactileSource, model_hz: f64) -> Self {
        let n_taxels = source.n_taxels;
        let taxel =
            Taxel { last: 0.0, step: f32::INFINITY, noise: 0.0, evidence: 0.0, rows: 0, since: Stamp(0), stuck: false };
        SourceHealth {
            taxels: vec![taxel; n_taxels],
            evidence: 0.0,
            noise: 0.0,
            before: vec![0.0; n_taxels],
            n_rows: 0,
            same_rows: 0,
            same_since: Stamp(0),
            frozen: false,
            n_stuck: 0,
            sequences: [None; 2],
            counts_alternate: false,
            alternated: 0,
            interleaved: false,
            model_hz: Some(model_hz).filter(|_| source.frame_clock == FrameClock::Tactile),
            intervals: (0, 0),
            recent_hz: None,
        }
    }

    /// Takes the noise that a calibration found.
    ///
    /// # Shapes
    /// `noise`: `[taxels of the source]`, raw units.
    pub(super) fn handle_noise(&mut self, noise: &[f32]) {
        for (taxel, &noise) in self.taxels.iter_mut().zip(noise) {
            taxel.noise = if noise.is_finite() { noise } else { 0.0 };
            taxel.evidence = taxel.told();
        }
        self.sum_up();
    }

    fn sum_up(&mut self) {
        self.noise = self.taxels.iter().map(|taxel| taxel.scatter()).sum();
        self.evidence = self.taxels.iter().map(|taxel| taxel.evidence).sum();
    }

    /// Takes the sender's count of a message, where it has one.
    pub(super) fn handle_sequence(&mut self, sequence: Option<u32>) {
        let follows =
            |earlier: Option<u32>| sequence.zip(earlier).is_some_and(|(now, then)| now == then.wrapping_add(1));
        let [last, before] = self.sequences;
        self.counts_alternate = follows(before) && !follows(last);
        self.sequences = [sequence, last];
    }

    /// Takes a row that is used.
    ///
    /// # Shapes
    /// `values`: `[taxels of the source]`, raw.
    pub(super) fn handle_row(&mut self, stamp: Stamp, values: &[f32]) {
        let first = self.n_rows == 0;
        let (mut same, mut step_sum, mut second_sum, mut n_stuck, mut finer) = (!first, 0.0, 0.0, 0, false);
        for ((taxel, before), &value) in self.taxels.iter_mut().zip(&mut self.before).zip(values) {
            step_sum += f64::from((value - taxel.last).abs());
            second_sum += f64::from((value - *before).abs());
            *before = taxel.last;
            if first || value.to_bits() != taxel.last.to_bits() {
                same = false;
                let step = (value - taxel.last).abs();
                if !first && step > 0.0 && step < taxel.step {
                    taxel.step = step;
                    taxel.evidence = taxel.told();
                    finer = true;
                }
                (taxel.last, taxel.rows, taxel.since, taxel.stuck) = (value, 0, stamp, false);
                continue;
            }
            taxel.rows = taxel.rows.saturating_add(1);
            taxel.stuck = taxel.rows >= MIN_STUCK_ROWS
                && f64::from(taxel.rows) * taxel.evidence >= ENOUGH
                && stamp.nanos_since(taxel.since) >= MIN_STUCK_NS;
            n_stuck += usize::from(taxel.stuck);
        }
        self.n_stuck = n_stuck;
        if finer {
            self.sum_up();
        }
        if same {
            self.same_rows = self.same_rows.saturating_add(1);
        } else {
            (self.same_rows, self.same_since) = (0, stamp);
        }
        self.frozen = self.same_rows >= MIN_FROZEN_ROWS
            && f64::from(self.same_rows) * self.evidence >= ENOUGH
            && stamp.nanos_since(self.same_since) >= MIN_FROZEN_NS;
        // Comparisons with NaN are false: such a row alternates with none.
        let values_alternate =
            self.n_rows >= 2 && step_sum > ALTERNATION * second_sum && step_sum > ALTERNATION_NOISE * self.noise;
        self.alternated = self.alternated << 1 | u32::from(values_alternate || self.counts_alternate);
        self.interleaved = match self.alternated.count_ones() {
            INTERLEAVED_ROWS.. => true,
            0..=ALONE_ROWS => false,
            _ => self.interleaved,
        };
        self.n_rows = (self.n_rows + 1).min(2);
    }

    /// Takes the time between two frames that belong together.
    pub(super) fn handle_interval(&mut self, interval_ns: i64) {
        let (n, spanned_ns) = &mut self.intervals;
        *n += 1;
        *spanned_ns = spanned_ns.saturating_add(interval_ns.max(0));
        if *spanned_ns >= RATE_WINDOW_NS {
            self.recent_hz = Some(f64::from(*n) * NANOS_PER_SEC as f64 / *spanned_ns as f64);
            self.intervals = (0, 0);
        }
    }

    /// Forgets how long readings have stood still, because time jumped.
    pub(super) fn handle_jump(&mut self, stamp: Stamp) {
        self.taxels.iter_mut().for_each(|taxel| (taxel.rows, taxel.since, taxel.stuck) = (0, stamp, false));
        (self.same_rows, self.same_since, self.frozen, self.n_stuck) = (0, stamp, false, 0);
    }

    /// True if the source repeats its last row for longer than noise allows.
    pub(super) fn is_frozen(&self) -> bool {
        self.frozen
    }

    /// True if rows of two senders come in turn.
    pub(super) fn is_interleaved(&self) -> bool {
        self.interleaved
    }

    /// True if some taxel stands still while others go on.
    pub(super) fn has_stuck(&self) -> bool {
        self.n_stuck > 0 && !self.frozen
    }

    /// Faults that concern a region with these taxels.
    pub(super) fn flags(&self, taxels: &[usize]) -> Flags {
        let mut flags = Flags::default();
        let too_fast = self.model_hz.zip(self.recent_hz).is_some_and(|(model, hz)| hz > model * (1.0 + RATE_TOLERANCE));
        let stuck = self.has_stuck() && taxels.iter().any(|&taxel_idx| self.taxels[taxel_idx].stuck);
        for (is, flag) in [
            (self.frozen, Flags::FROZEN),
            (self.interleaved, Flags::INTERLEAVED),
            (too_fast, Flags::WRONG_RATE),
            (stuck, Flags::FAULTY_TAXEL),
        ] {
            if is {
                flags.insert(flag);
            }
        }
        flags
    }

    /// Current faults, as text for people.
    pub(super) fn faults<'a>(&self, source: &'a TactileSource, model_hz: f64) -> Vec<SourceFault<'a>> {
        let name = source.name.as_str();
        let mut faults = Vec::new();
        faults.extend(self.frozen.then_some(SourceFault::Frozen(name)));
        faults.extend(self.interleaved.then_some(SourceFault::Interleaved(name)));
        faults.extend(self.has_stuck().then(|| SourceFault::Stuck(name, self.stuck().collect())));
        let rate = self.recent_hz.and_then(|hz| RateFault::judge(source, hz, model_hz));
        faults.extend(rate.map(SourceFault::Rate));
        faults
    }

    /// Taxels that repeat their last reading for longer than their noise allows.
    fn stuck(&self) -> impl Iterator<Item = usize> {
        let stuck = self.taxels.iter().enumerate().filter(|(_, taxel)| taxel.stuck);
        stuck.map(|(taxel_idx, _)| taxel_idx)
    }
}

impl<'a> RateFault<'a> {
    /// The fault in the rate of a source whose samples came at `measured_hz`, if there is one: with the frame clock
    /// `grid` every rate is right.
    pub fn judge(source: &'a TactileSource, measured_hz: f64, model_hz: f64) -> Option<Self> {
        let off = source.frame_clock == FrameClock::Tactile && (measured_hz / model_hz - 1.0).abs() > RATE_TOLERANCE;
        off.then_some(RateFault { source: &source.name, measured_hz, model_hz })
    }
}

impl fmt::Display for RateFault<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let RateFault { source, measured_hz, model_hz } = self;
        write!(
            f,
            "tactile source {source} came at {measured_hz:.1} Hz and its model was trained on {model_hz} Hz: set tactile.{source}.frame_clock to grid, or make its driver keep that rate"
        )
    }
}

impl fmt::Display for SourceFault<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SourceFault::Frozen(source) => write!(
                f,
                "tactile source {source} repeats its last sample for longer than its noise allows: restart its driver, or look at its cable"
            ),
            SourceFault::Interleaved(source) => write!(
                f,
                "tactile source {source} alternates between two senders: end one of them, or set tactile.{source}.topic to one's own topic"
            ),
            SourceFault::Stuck(source, taxels) => write!(
                f,
                "tactile source {source}: taxels {taxels:?} stand still while others move: look at their wiring, or leave them out of region.*.taxels"
            ),
            SourceFault::Rate(fault) => fault.fmt(f),
        }
    }
}

impl Taxel {
    /// How far readings lie apart by noise or steps alone; 0 if unknown.
    fn scatter(&self) -> f64 {
        let step = if self.step.is_finite() { self.step } else { 0.0 };
        f64::from(self.noise.max(step))
    }

    /// Evidence from one repeated reading, by noise and step.
    fn told(&self) -> f64 {
        match self.noise / self.step {
            _ if self.noise <= 0.0 => 0.0,
            _ if self.step.is_infinite() => FAINT,
            2.0.. => CLEAR,
            1.0.. => FAINT,
            _ => 0.0,
        }
    }
}
