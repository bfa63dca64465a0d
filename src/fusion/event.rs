//! Inputs of the fusion core. Samples are borrowed: the core copies what it keeps into buffers it already owns.

use super::idx::{JointSourceIdx, TactileSourceIdx};
use crate::units::Stamp;

/// One message of a tactile array: a block of consecutive samples, most often just one.
#[derive(Debug, Clone, Copy)]
pub struct TactileBlock<'a> {
    /// Which source sent it.
    pub source: TactileSourceIdx,
    /// Stamp of the last row, before the source's `stamp_offset`.
    pub stamp: Stamp,
    /// Number of consecutive samples.
    pub rows: usize,
    /// Time between rows; `0` where there is one row.
    pub row_period_ns: i64,
    /// The sender's message count, one up a message and wrapping, where it has one: what is missing in it was lost.
    pub sequence: Option<u32>,
    /// `[rows, taxels]`, row-major, raw as the sensor sent them.
    pub values: &'a [f32],
    /// When the message arrived, by the clock of whoever received it. It marks outputs, and tells the age of frames where
    /// [`Receipts::Live`](super::Receipts::Live); it reaches no force.
    pub received: Stamp,
}

impl TactileBlock<'_> {
    /// True if it holds whole samples of so many taxels, with the time between them where there are several. Nothing else
    /// of a message that doesn't is used, its stamp included.
    pub fn is_of(&self, n_taxels: usize) -> bool {
        self.rows > 0
            && self.rows.checked_mul(n_taxels) == Some(self.values.len())
            && (self.rows == 1 || self.row_period_ns > 0)
    }
}

/// One message of joint angles. Joints are matched by name, never by position.
#[derive(Debug, Clone, Copy)]
pub struct JointSample<'a> {
    /// Which source sent it.
    pub source: JointSourceIdx,
    /// Stamp of the angles, before the source's `stamp_offset`.
    pub stamp: Stamp,
    /// `[joints of the message]`.
    pub names: &'a [String],
    /// `[joints of the message]`, in the source's own unit. Shorter than `names` when the message was malformed.
    pub positions: &'a [f64],
    /// When the message arrived, by the clock of whoever received it, as of taxels.
    pub received: Stamp,
}

/// Anything the core reacts to.
#[derive(Debug, Clone, Copy)]
pub enum Event<'a> {
    /// Taxels arrived.
    Tactile(TactileBlock<'a>),
    /// Joint angles arrived.
    Joints(JointSample<'a>),
}

impl Event<'_> {
    /// When the message arrived.
    pub fn received(&self) -> Stamp {
        match self {
            Event::Tactile(block) => block.received,
            Event::Joints(sample) => sample.received,
        }
    }
}
