//! Runs the stages of a replay, in turn or on threads of their own with bounded queues between them.

use std::num::NonZero;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Condvar, Mutex, PoisonError};

use super::error::ReplayError;
use super::stages::{CoreStage, Fused, Read, Reading, Writing};
use crate::bag::BagError;
use crate::observer::{cancel_flag, cancelled_by};

/// Queue of portions for the core: enough for the time in which the models process thousands of frames.
const QUEUED: usize = 32;

/// Queue of portions to be written.
const QUEUED_FUSED: usize = 4;

/// Limit on the bytes of messages that were read and are still in work. A message that is larger waits until it is
/// alone.
const BYTES_IN_FLIGHT: usize = 12 << 20;

/// Runs all stages to the end and returns those that know the result. With more than one job the stages overlap. The
/// output is the same.
pub(super) fn run(
    mut reading: Reading,
    core: &mut CoreStage<'_>,
    mut writing: Writing,
    jobs: NonZero<usize>,
    progress: &dyn Fn(u64),
) -> Result<(Reading, Writing), ReplayError> {
    if jobs.get() > 1 {
        return overlapped(reading, core, writing, progress);
    }
    while let Some(Read { portion, bytes_read }) = reading.next()? {
        progress(bytes_read);
        writing.write(&core.take(portion)?)?;
    }
    writing.write(&core.end()?)?;
    Ok((reading, writing))
}

fn overlapped(
    reading: Reading,
    core: &mut CoreStage<'_>,
    writing: Writing,
    progress: &dyn Fn(u64),
) -> Result<(Reading, Writing), ReplayError> {
    let in_flight = InFlight::default();
    let (to_core, from_reading) = sync_channel(QUEUED);
    let (to_writing, from_core) = sync_channel(QUEUED_FUSED);
    let cancel = cancel_flag();
    std::thread::scope(|scope| {
        let reading = scope.spawn(|| cancelled_by(cancel, || read(reading, to_core, &in_flight)));
        let writing = scope.spawn(|| write(writing, from_core));
        let fused = fuse(core, from_reading, to_writing, progress);
        // A thread ends when the other end of its queue is dropped, which has happened by now.
        let reading = reading.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        let writing = writing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        // The writing stage handles earlier portions than the core, so its error comes first.
        let writing = writing?;
        fused?;
        Ok((reading, writing))
    })
}

type Sent<'f> = Result<(Read, Held<'f>), BagError>;

fn read<'f>(mut reading: Reading, to_core: SyncSender<Sent<'f>>, in_flight: &'f InFlight) -> Reading {
    while let Some(read) = reading.next().transpose() {
        let failed = read.is_err();
        let sent = read.map(|read| {
            let held = in_flight.hold(read.portion.n_bytes());
            (read, held)
        });
        if to_core.send(sent).is_err() || failed {
            break;
        }
    }
    reading
}

fn fuse<'f>(
    core: &mut CoreStage<'_>,
    from_reading: Receiver<Sent<'f>>,
    to_writing: SyncSender<(Fused, Option<Held<'f>>)>,
    progress: &dyn Fn(u64),
) -> Result<(), ReplayError> {
    for sent in from_reading {
        let (Read { portion, bytes_read }, held) = sent?;
        progress(bytes_read);
        if to_writing.send((core.take(portion)?, Some(held))).is_err() {
            return Ok(()); // the writing stage reports why
        }
    }
    let _ = to_writing.send((core.end()?, None));
    Ok(())
}

fn write(mut writing: Writing, from_core: Receiver<(Fused, Option<Held<'_>>)>) -> Result<Writing, BagError> {
    for (fused, _held) in from_core {
        writing.write(&fused)?;
    }
    Ok(writing)
}

/// Counts the bytes in work.
#[derive(Default)]
struct InFlight {
    bytes: Mutex<usize>,
    fewer: Condvar,
}

/// Bytes in work, until it is dropped.
struct Held<'f> {
    of: &'f InFlight,
    bytes: usize,
}

impl InFlight {
    /// Waits until there is room for this number of bytes.
    fn hold(&self, bytes: usize) -> Held<'_> {
        let held = self.bytes.lock().unwrap_or_else(PoisonError::into_inner);
        let full = |held: &mut usize| *held > 0 && held.saturating_add(bytes) > BYTES_IN_FLIGHT;
        *self.fewer.wait_while(held, full).unwrap_or_else(PoisonError::into_inner) += bytes;
        Held { of: self, bytes }
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        *self.of.bytes.lock().unwrap_or_else(PoisonError::into_inner) -= self.bytes;
        self.of.fewer.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_in_flight_are_bounded_and_one_large_message_passes_alone() {
        let in_flight = InFlight::default();
        let large = in_flight.hold(2 * BYTES_IN_FLIGHT);
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| {
                let _held = in_flight.hold(1);
                *in_flight.bytes.lock().unwrap()
            });
            drop(large);
            assert_eq!(waiting.join().unwrap(), 1);
        });
        assert_eq!(*in_flight.bytes.lock().unwrap(), 0);
    }
}
