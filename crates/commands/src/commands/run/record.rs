//! The recording of a live run: inputs in the order in which they were handled, and the estimates that they gave.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, BagError, BagWriter, Finished, NewChannel, OutChannel, WriteOptions};
use tactile_pose_fusion::location;
use tactile_pose_fusion::msg::definition::Definitions;
use tactile_pose_fusion::msg::{ContactArray, Slot, WrenchStamped, type_hash};
use tactile_pose_fusion::ros::{InputName, Names, Record};

use super::super::{FLUSH_EVERY, Failure};

/// Messages that may wait for the disk: some seconds of a fast glove with five regions.
const CAPACITY: usize = 65_536;

/// How often it is looked whether it is over.
const LOOK: Duration = Duration::from_millis(50);

/// A recording under way, on a thread of its own.
pub(super) struct RunRecording {
    thread: JoinHandle<Result<Finished, BagError>>,
    /// Whether what was sent so far is all.
    over: Arc<AtomicBool>,
    /// Where it is until it is complete.
    unfinished: PathBuf,
}

struct Channels {
    inputs: Vec<OutChannel>,
    wrenches: Vec<OutChannel>,
    contacts: OutChannel,
}

/// Begins a recording; what is sent is written.
pub(super) fn start(
    out: &Path,
    names: &Names,
    definitions: &Definitions,
) -> Result<(SyncSender<Record>, RunRecording), Failure> {
    location::only_here(out).map_err(|error| Failure(format!("{}: {error}", out.display())))?;
    let mut bag = BagWriter::create(out, WriteOptions::default())?;
    let mut inputs = Vec::new();
    for InputName { topic, type_name, .. } in &names.inputs {
        let channel = NewChannel {
            topic,
            type_name,
            schema_text: &definitions.schema_text(type_name)?,
            qos_yaml: BEST_EFFORT_QOS,
            type_hash: &type_hash(&definitions.tree(type_name)?),
        };
        inputs.push(bag.add_live_input(channel)?);
    }
    let wrenches = names.estimates.wrenches.iter().map(|topic| bag.add_topic::<WrenchStamped>(topic));
    let wrenches = wrenches.collect::<Result<_, _>>()?;
    let contacts = bag.add_topic::<ContactArray>(&names.estimates.contacts)?;
    let unfinished = bag.keep_unfinished();
    let (sender, receiver) = sync_channel(CAPACITY);
    let channels = Channels { inputs, wrenches, contacts };
    let over = Arc::new(AtomicBool::new(false));
    let is_over = Arc::clone(&over);
    let work = move || write(bag, &channels, &receiver, &is_over);
    let thread = std::thread::Builder::new().name("record".into()).spawn(work)?;
    Ok((sender, RunRecording { thread, over, unfinished }))
}

impl RunRecording {
    /// Completes it with what was sent so far, also where who sends hangs.
    pub(super) fn finish(self) -> Result<Finished, Failure> {
        self.over.store(true, Ordering::Release);
        let why = match self.thread.join() {
            Ok(Ok(finished)) => return Ok(finished),
            Ok(Err(error)) => error.to_string(),
            Err(_) => "the recording ended early".to_owned(),
        };
        let unfinished = self.unfinished.display();
        Err(Failure(format!("{why}; what was recorded until then is in {unfinished}: rename it to end in .mcap")))
    }
}

fn write(
    mut bag: BagWriter,
    channels: &Channels,
    records: &Receiver<Record>,
    over: &AtomicBool,
) -> Result<Finished, BagError> {
    let mut flushed = Instant::now();
    loop {
        let is_over = over.load(Ordering::Acquire);
        let record = match records.recv_timeout(LOOK) {
            Ok(record) => record,
            Err(RecvTimeoutError::Timeout) if !is_over => continue,
            Err(_) => break,
        };
        let (channel, received, cdr) = match record {
            Record::Input { input, received, cdr } => (channels.inputs[input], received, cdr),
            Record::Output { slot: Slot::Wrench(region), received, cdr } => {
                (channels.wrenches[region.position()], received, cdr)
            }
            Record::Output { slot: Slot::Contacts, received, cdr } => (channels.contacts, received, cdr),
        };
        bag.write(channel, 0, received, received, &cdr)?;
        if flushed.elapsed() >= FLUSH_EVERY {
            flushed = Instant::now();
            bag.flush()?;
        }
    }
    bag.finish()
}
