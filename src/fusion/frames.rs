//! From tactile messages to model frames: order, loss, blocks and bursts, and the two frame clocks.

use serde::Serialize;

use super::config::{FrameClock, TactileSource, Timing};
use super::event::TactileBlock;
use super::health::SourceHealth;
use crate::units::{NANOS_PER_SEC, Stamp, nanos};

/// Counters of a source's samples, by outcome. Every row is counted in exactly one of `used` and the drops after it, up to
/// `no_row_period`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct TactileCounters {
    /// Messages received.
    pub messages: u64,
    /// Samples in them: a message carries one row or a block of rows.
    pub rows: u64,
    /// Rows that reached the frame clock.
    pub used: u64,
    /// Rows with the stamp of the one before.
    pub duplicate: u64,
    /// Rows older than what has been used.
    pub out_of_order: u64,
    /// Rows of messages whose length is not rows x taxels.
    pub wrong_length: u64,
    /// Rows of a block whose message gives no time between rows.
    pub no_row_period: u64,
    /// Messages with no row in them.
    pub empty: u64,
    /// Used rows with a reading that is NaN or infinite.
    pub non_finite: u64,
    /// Used rows that came while all taxels stood still for longer than their noise allows.
    pub frozen: u64,
    /// Used rows that came while some taxels stood still and others didn't.
    pub stuck: u64,
    /// Used rows that came while rows of two senders came in turn.
    pub interleaved: u64,
    /// Blocks that came faster than their rows last: their rows were spread over the time since the block before.
    pub bursts: u64,
    /// Messages that are missing in the sender's own count.
    pub lost_messages: u64,
    /// Frames cut.
    pub frames: u64,
    /// Frames that are missing between used ones and short enough to be interpolated.
    pub missing_frames: u64,
    /// Gaps longer than `max_gap`, each of which empties the windows.
    pub gaps: u64,
    /// Times the stamps jumped back, which resets the pipeline of the source.
    pub time_jumps: u64,
    /// Frame intervals within `max_gap`, summed, ns: with `frames`, the rate at which frames really came.
    pub active_ns: u64,
}

/// A frame of a source, all its taxels raw.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// When.
    pub stamp: Stamp,
    /// Frames of one epoch are connected; a gap or a jump of time starts the next one.
    pub epoch: u64,
    /// Number of the frame on the model's clock: one up a frame, more where frames are missing.
    pub number: i64,
    /// `[taxels of the source]`, raw.
    pub values: &'a [f32],
}

/// Change in a source's stream, besides frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Continuity {
    /// Nothing special.
    Steady,
    /// Stamps jumped back: what waits must be settled before frames of the new time come.
    Jumped,
}

/// Turns one source's messages into frames.
#[derive(Debug, Clone)]
pub struct FrameCutter {
    source: TactileSource,
    period_ns: f64,
    max_gap_ns: i64,
    time_jump_ns: i64,
    newest: Option<Stamp>,
    sequence: Option<u32>,
    epoch: u64,
    number: i64,
    nominal: Option<(Stamp, i64)>, // stamp of the last frame, and where the steady clock would have put it
    grid: Grid,
    health: SourceHealth,
    counters: TactileCounters,
}

#[derive(Debug, Clone, Default)]
struct Grid {
    start: Stamp,
    next: i64,
    previous: Vec<f32>,
    sums: Vec<f64>,
    counts: Vec<u32>,
    n_rows: u32,
    frame: Vec<f32>,
}

impl FrameCutter {
    /// A cutter that makes frames at `rate_hz`, which is positive and finite.
    pub fn new(source: TactileSource, rate_hz: f64, timing: &Timing) -> Self {
        let n = source.n_taxels;
        let period_ns = NANOS_PER_SEC as f64 / rate_hz;
        FrameCutter {
            period_ns,
            // One frame interval is never a gap, however slow the model's clock is.
            max_gap_ns: nanos(timing.max_gap).max((1.5 * period_ns) as i64),
            time_jump_ns: nanos(timing.time_jump),
            newest: None,
            sequence: None,
            epoch: 0,
            number: 0,
            nominal: None,
            grid: Grid {
                previous: vec![0.0; n],
                sums: vec![0.0; n],
                counts: vec![0; n],
                frame: vec![0.0; n],
                ..Grid::default()
            },
            health: SourceHealth::new(&source, rate_hz),
            counters: TactileCounters::default(),
            source,
        }
    }

    /// Newest stamp that was used: data time, as far as this source knows it.
    pub fn newest(&self) -> Option<Stamp> {
        self.newest
    }

    /// The longest step between samples that is not a gap, ns.
    pub fn max_gap_ns(&self) -> i64 {
        self.max_gap_ns
    }

    /// Takes the noise that a calibration found.
    ///
    /// # Shapes
    /// `noise`: `[taxels of the source]`, raw units.
    pub fn handle_noise(&mut self, noise: &[f32]) {
        self.health.handle_noise(noise);
    }

    /// Health of the source.
    pub fn health(&self) -> &SourceHealth {
        &self.health
    }

    /// Sample counters.
    pub fn counters(&self) -> &TactileCounters {
        &self.counters
    }

    /// Frames a second as they really came, gaps left out; `None` before there are two of them.
    pub fn measured_rate_hz(&self) -> Option<f64> {
        let intervals = self.counters.frames.checked_sub(1 + self.counters.gaps + self.counters.time_jumps)?;
        (self.counters.active_ns > 0).then(|| intervals as f64 * 1e9 / self.counters.active_ns as f64)
    }

    /// Looks at a message before its rows are cut. Call once a message, then [`FrameCutter::cut`].
    pub fn handle_header(&mut self, block: &TactileBlock<'_>) -> Continuity {
        self.counters.messages += 1;
        if let (Some(last), Some(now)) = (self.sequence, block.sequence) {
            let step = now.wrapping_sub(last);
            // A step of half the range or more is the sender starting over, not two billion lost messages.
            if (2..u32::MAX / 2).contains(&step) {
                self.counters.lost_messages += u64::from(step - 1);
            }
        }
        self.sequence = block.sequence;
        self.health.handle_sequence(block.sequence);
        if !block.is_of(self.source.n_taxels) {
            return Continuity::Steady; // its rows are dropped, and its stamp tells nothing
        }
        let stamp = block.stamp.offset(self.source.stamp_offset_ns);
        let jumped = self.newest.is_some_and(|newest| stamp.nanos_since(newest) < -self.time_jump_ns);
        if !jumped {
            return Continuity::Steady;
        }
        self.counters.time_jumps += 1;
        self.health.handle_jump(stamp);
        self.newest = None;
        self.nominal = None;
        self.epoch += 1;
        Continuity::Jumped
    }

    /// Cuts the frames that a message completes, oldest first, and passes each to `sink` with the source's health then.
    pub fn cut(&mut self, block: &TactileBlock<'_>, mut sink: impl FnMut(Frame<'_>, &SourceHealth)) {
        let rows = block.rows;
        self.counters.rows += rows as u64;
        if rows == 0 {
            self.counters.empty += 1;
            return;
        }
        if rows.checked_mul(self.source.n_taxels) != Some(block.values.len()) {
            self.counters.wrong_length += rows as u64;
            return;
        }
        if rows > 1 && block.row_period_ns <= 0 {
            self.counters.no_row_period += rows as u64;
            return;
        }
        let last_stamp = block.stamp.offset(self.source.stamp_offset_ns);
        let Some(stamps) = RowStamps::new(last_stamp, rows, block.row_period_ns, self.newest) else {
            let is_again = self.newest == Some(last_stamp);
            let late = if is_again { &mut self.counters.duplicate } else { &mut self.counters.out_of_order };
            *late += rows as u64;
            return;
        };
        self.counters.bursts += u64::from(stamps.is_burst());
        for (row_idx, values) in block.values.chunks_exact(self.source.n_taxels).enumerate() {
            let stamp = stamps.at(row_idx);
            if self.newest.is_some_and(|newest| stamp <= newest) {
                self.counters.duplicate += 1; // more rows than nanoseconds
                continue;
            }
            self.counters.used += 1;
            self.health.handle_row(stamp, values);
            self.counters.non_finite += u64::from(values.iter().any(|value| !value.is_finite()));
            self.counters.frozen += u64::from(self.health.is_frozen());
            self.counters.stuck += u64::from(self.health.has_stuck());
            self.counters.interleaved += u64::from(self.health.is_interleaved());
            self.handle_row(stamp, values, &mut sink);
            self.newest = Some(stamp);
        }
    }

    fn handle_row(&mut self, stamp: Stamp, values: &[f32], sink: &mut impl FnMut(Frame<'_>, &SourceHealth)) {
        let gap = self.newest.is_some_and(|newest| stamp.nanos_since(newest) > self.max_gap_ns);
        if gap {
            self.counters.gaps += 1;
            self.epoch += 1;
            self.nominal = None;
        }
        match self.source.frame_clock {
            FrameClock::Tactile => self.emit(stamp, values, sink),
            FrameClock::Grid => self.handle_grid_row(stamp, values, gap, sink),
        }
    }

    fn handle_grid_row(
        &mut self,
        stamp: Stamp,
        values: &[f32],
        gap: bool,
        sink: &mut impl FnMut(Frame<'_>, &SourceHealth),
    ) {
        let mut grid = std::mem::take(&mut self.grid);
        let previous_stamp = match self.newest {
            Some(newest) if !gap => newest,
            _ => {
                grid.clear_interval();
                grid.start = stamp;
                grid.next = 0;
                stamp
            }
        };
        loop {
            let next_stamp = grid.stamp(grid.next, self.period_ns);
            // At the end of time the grid stands still, and so do its frames.
            if next_stamp > stamp || (grid.next > 0 && next_stamp <= grid.stamp(grid.next - 1, self.period_ns)) {
                break;
            }
            if next_stamp == stamp {
                grid.add(values);
            }
            if grid.n_rows >= 2 {
                grid.average();
            } else if next_stamp == stamp {
                grid.frame.copy_from_slice(values);
            } else {
                let part = next_stamp.nanos_since(previous_stamp) as f64 / stamp.nanos_since(previous_stamp) as f64;
                grid.interpolate(values, part);
            }
            grid.clear_interval();
            grid.next += 1;
            self.emit(next_stamp, &grid.frame, sink);
        }
        if grid.next == 0 || grid.stamp(grid.next - 1, self.period_ns) != stamp {
            grid.add(values);
        }
        grid.previous.copy_from_slice(values);
        self.grid = grid;
    }

    fn emit(&mut self, stamp: Stamp, values: &[f32], sink: &mut impl FnMut(Frame<'_>, &SourceHealth)) {
        let missing = self.advance(stamp);
        self.counters.missing_frames += missing as u64;
        self.counters.frames += 1;
        self.number += 1 + missing;
        sink(Frame { stamp, epoch: self.epoch, number: self.number, values }, &self.health);
    }

    /// How many frames are missing before the one at `stamp`.
    ///
    /// A steady clock is followed that runs at the model's rate and leans a tenth of each deviation towards the stamps:
    /// jitter and a slightly different rate leave no holes, a lost sample does.
    fn advance(&mut self, stamp: Stamp) -> i64 {
        let Some((last, nominal)) = self.nominal else {
            self.nominal = Some((stamp, stamp.0));
            return 0;
        };
        self.counters.active_ns += stamp.nanos_since(last).unsigned_abs();
        self.health.handle_interval(stamp.nanos_since(last));
        let expected = nominal.saturating_add(self.period_ns.round() as i64);
        let lag = stamp.0.saturating_sub(expected);
        let missing = if lag as f64 > 0.75 * self.period_ns { (lag as f64 / self.period_ns).round() as i64 } else { 0 };
        let caught_up = expected.saturating_add((missing as f64 * self.period_ns).round() as i64);
        self.nominal = Some((stamp, caught_up.saturating_add(stamp.0.saturating_sub(caught_up) / 10)));
        missing
    }
}

impl Grid {
    fn stamp(&self, k: i64, period_ns: f64) -> Stamp {
        self.start.offset((k as f64 * period_ns).round() as i64)
    }

    fn add(&mut self, values: &[f32]) {
        self.n_rows += 1;
        for ((sum, count), &value) in self.sums.iter_mut().zip(&mut self.counts).zip(values) {
            if value.is_finite() {
                *sum += f64::from(value);
                *count += 1;
            }
        }
    }

    /// The mean of the interval's finite readings; NaN for a taxel that has none.
    fn average(&mut self) {
        for ((mean, &sum), &count) in self.frame.iter_mut().zip(&self.sums).zip(&self.counts) {
            *mean = if count == 0 { f32::NAN } else { (sum / f64::from(count)) as f32 };
        }
    }

    fn interpolate(&mut self, values: &[f32], part: f64) {
        for ((between, &before), &after) in self.frame.iter_mut().zip(&self.previous).zip(values) {
            *between = (f64::from(before) + (f64::from(after) - f64::from(before)) * part) as f32;
        }
    }

    fn clear_interval(&mut self) {
        self.n_rows = 0;
        self.sums.fill(0.0);
        self.counts.fill(0);
    }
}

/// Stamps of the rows of one message. The last row has the stamp of the message, and the others lie one period apart before it. Where
/// they would lie at or before a row that came already (a burst), all of them are spread evenly after that row.
#[derive(Debug, Clone, Copy)]
pub struct RowStamps {
    last: Stamp,
    rows: usize,
    row_period_ns: i64,
    after: Option<Stamp>,
}

impl RowStamps {
    /// The stamps of `rows` rows, of which `last` is the newest, after the row at `newest`. `None` if `last` is not newer.
    pub fn new(last: Stamp, rows: usize, row_period_ns: i64, newest: Option<Stamp>) -> Option<Self> {
        let after = match newest {
            Some(newest) if last <= newest => return None,
            Some(newest) => {
                let span_ns = row_period_ns.saturating_mul((rows as i64).saturating_sub(1));
                (rows > 1 && last.offset(-span_ns) <= newest).then_some(newest)
            }
            None => None,
        };
        Some(RowStamps { last, rows, row_period_ns, after })
    }

    /// True if the rows are spread.
    pub fn is_burst(&self) -> bool {
        self.after.is_some()
    }

    /// Stamp of a row, 0 the oldest.
    pub fn at(&self, row_idx: usize) -> Stamp {
        match self.after {
            Some(newest) => {
                let step = i128::from(self.last.nanos_since(newest)) * (row_idx as i128 + 1) / self.rows as i128;
                newest.offset(step as i64) // a part of an i64 span
            }
            None => self.last.offset(-self.row_period_ns.saturating_mul((self.rows - 1 - row_idx) as i64)),
        }
    }
}

#[cfg(test)]
#[path = "frames_tests.rs"]
mod tests;
