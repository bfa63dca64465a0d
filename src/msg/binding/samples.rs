//! Decodes the messages of an input to events for the core, for bags and for the live node.

use super::{FramesBinding, JointBinding, SampleError, TaxelBinding};
use crate::fusion::{Event, JointSample, JointSourceIdx, TactileBlock, TactileSourceIdx};
use crate::units::Stamp;

/// Decoder for the messages of one input topic.
#[derive(Debug, Clone)]
pub enum SampleBinding {
    /// Taxels of a source.
    Taxels(TactileSourceIdx, Box<TaxelBinding>),
    /// Joint angles of a source.
    Joints(JointSourceIdx, Box<JointBinding>),
    /// Frames of a joint source that don't change, and give no event.
    Frames(JointSourceIdx, FramesBinding),
}

impl SampleBinding {
    /// Decodes a message that was received at `received`.
    ///
    /// # Errors
    /// [`SampleError`] when it holds no samples, or not the ones that it says; [`SampleError::Kept`] for frames, which are kept.
    pub fn decode<'a>(&'a mut self, cdr: &[u8], received: Stamp) -> Result<Event<'a>, SampleError> {
        match self {
            SampleBinding::Taxels(source, binding) => {
                let taxels = binding.decode(cdr, received)?;
                Ok(Event::Tactile(TactileBlock {
                    source: *source,
                    stamp: taxels.stamp,
                    rows: taxels.rows,
                    row_period_ns: taxels.row_period_ns,
                    sequence: taxels.sequence,
                    values: taxels.values,
                    received,
                }))
            }
            SampleBinding::Joints(source, binding) => {
                let joints = binding.decode(cdr, received)?;
                Ok(Event::Joints(JointSample {
                    source: *source,
                    stamp: joints.stamp,
                    names: joints.names,
                    positions: joints.positions,
                    received,
                }))
            }
            SampleBinding::Frames(_, frames) => {
                Err(frames.keep(cdr).map_or_else(|error| error, |()| SampleError::Kept))
            }
        }
    }

    /// Number of times that the device's clock was set or restarted, if stamps come from its own clock.
    pub fn clock_restarts(&self) -> u64 {
        match self {
            SampleBinding::Taxels(_, binding) => binding.clock_restarts(),
            SampleBinding::Joints(_, binding) => binding.clock_restarts(),
            SampleBinding::Frames(..) => 0,
        }
    }
}
