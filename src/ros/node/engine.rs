//! The thread that reads inputs and runs the core. It never publishes and never waits for the publisher.

mod report;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::{Duration, Instant};

use futures::{FutureExt, StreamExt};
use ros2_client::QosProfile;
use tokio::sync::{mpsc, oneshot};

use super::calibrator::Sample;
use super::diagnostics::Budget;
use super::order::Order;
use super::outbox::{Origin, OutIdx, Outbox};
use super::visuals::Selection;
use super::watchdog::{Silence, Watchdog};
use super::watched::Watched;
use crate::config::Config;
use crate::fusion::{ContactThresholds, Contract, Event, Fusion, FusionError, SetupError, Tick};
use crate::msg::binding::SampleBinding;
use crate::msg::{Outgoing, Slot, to_cdr};
use crate::ros::wire::args::Severity;
use crate::ros::wire::clock::Clock;
use crate::ros::wire::graph::Wanted;
use crate::ros::wire::middleware::{Arrival, Fault, Neighbours, Subscription};
use crate::units::{Stamp, nanos};
use crate::zero::Donning;

/// Most messages of frames that don't change and are kept for the recording: as many as their subscription keeps.
const MAX_UNRECORDED_FRAMES: usize = 100;

/// A record for the recording, in the order of handling.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// An input message.
    Input {
        /// Index into [`Names::inputs`](super::Names::inputs).
        input: usize,
        /// Its receipt time.
        received: Stamp,
        /// The message.
        cdr: Vec<u8>,
    },
    /// An output message. It is recorded even while the node is inactive and does not publish it.
    Output {
        /// Which output.
        slot: Slot,
        /// Receipt time of the input that completed it.
        received: Stamp,
        /// The message.
        cdr: Vec<u8>,
    },
}

/// Commands to the engine from the rest of the node.
pub(super) enum Command {
    /// Run these models and baselines.
    Configure(Box<Configured>),
    /// Run nothing.
    CleanUp,
    /// True to publish.
    Active(bool),
    /// Contact thresholds, one per region.
    Thresholds(Vec<ContactThresholds>),
    /// The result of a calibration and its origin; replies true if it is in use.
    Calibrated(Box<Donning>, String, oneshot::Sender<Result<(), String>>),
    /// Replies with the calibration as it is now, and its origin, if there is a core.
    Known(oneshot::Sender<(Donning, Option<String>)>),
    /// Send a copy of each sample to this channel, until its receiver is dropped.
    Tap(mpsc::UnboundedSender<Sample>),
    /// Stop.
    Stop,
}

/// The engine's data while the node is configured.
pub(super) struct Configured {
    pub(super) fusion: Fusion,
    /// The backend of each model, for log messages.
    pub(super) models: Vec<(String, String)>,
    /// Origin of the baseline; `None` if there is no baseline.
    pub(super) calibration: Option<String>,
}

/// A topic that feeds the core.
pub(super) struct InputTopic {
    /// The requirements of each source for this topic.
    pub(super) wanted: Vec<Wanted>,
    pub(super) subscription: Subscription,
    /// One per source that reads from it.
    pub(super) bindings: Vec<SampleBinding>,
}

/// Destination of the engine's messages.
#[derive(Debug, Clone)]
pub(super) struct Outputs {
    pub(super) wrenches: Vec<OutIdx>,
    pub(super) contacts: OutIdx,
    pub(super) diagnostics: OutIdx,
    /// Topics of estimates, and the QoS offered on them.
    pub(super) offers: Vec<(String, QosProfile)>,
}

/// Time limit for handling the messages received before the end.
const LAST_INPUTS_LIMIT: Duration = Duration::from_millis(100);

pub(super) struct Engine {
    pub(super) cfg: Config,
    pub(super) clock: Arc<Clock>,
    pub(super) outbox: Outbox,
    pub(super) outputs: Outputs,
    pub(super) recorder: Option<SyncSender<Record>>,
    pub(super) neighbours: Option<Neighbours>,
    /// Chooses the frames of pictures, if there are any.
    pub(super) selection: Option<Selection>,
}

/// The engine's state while messages are handled.
struct Running {
    engine: Engine,
    watched: Watched,
    bindings: Vec<Vec<SampleBinding>>,
    core: Option<Configured>,
    outgoing: Option<Outgoing>,
    active: bool,
    watchdog: Watchdog,
    order: Order,
    budgets: BTreeMap<String, Budget>,
    /// Tactile sources that were reported stale.
    said_stale: BTreeSet<usize>,
    /// Time of the last report that no source sends anything.
    silent_said: Option<Duration>,
    tap: Option<mpsc::UnboundedSender<Sample>>,
    received: Stamp,
    unrecorded: u64,
    /// Estimates that were not published by the last report: outdated, and waited for too long.
    n_late: [u64; 2],
    /// Messages of frames that don't change, before there was a core, with input and receipt.
    unrecorded_frames: VecDeque<(usize, Stamp, Vec<u8>)>,
    cdr: Vec<u8>,
}

impl Engine {
    /// Reads inputs and computes estimates until it is stopped.
    pub(super) async fn run(self, inputs: Vec<InputTopic>, mut commands: mpsc::UnboundedReceiver<Command>) {
        let mut running = Running {
            watchdog: Watchdog::new(
                self.cfg.fusion().tactile_sources().len(),
                self.cfg.live.tactile_timeout,
                self.cfg.fusion().timing().joint_slack,
            ),
            order: Order::new(
                self.cfg.fusion().tactile_sources().len(),
                nanos(self.cfg.fusion().timing().max_age.unwrap_or(self.cfg.live.tactile_timeout)),
            ),
            watched: Watched::new(&self.cfg, inputs.iter().flat_map(|input| input.wanted.clone())),
            bindings: inputs.iter().map(|input| input.bindings.clone()).collect(),
            core: None,
            outgoing: None,
            active: false,
            budgets: BTreeMap::new(),
            said_stale: BTreeSet::new(),
            silent_said: None,
            tap: None,
            received: Stamp(0),
            unrecorded: 0,
            n_late: [0; 2],
            unrecorded_frames: VecDeque::new(),
            cdr: Vec::new(),
            engine: self,
        };
        let streams = inputs
            .iter()
            .enumerate()
            .map(|(idx, input)| input.subscription.arrivals().map(move |incoming| (idx, incoming)));
        let mut incoming = futures::stream::select_all(streams);
        // Short enough that the watchdog is accurate to a tenth of its limit.
        let timeout = running.engine.cfg.live.tactile_timeout;
        let mut watch = tokio::time::interval((timeout / 10).max(Duration::from_millis(1)));
        watch.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut report = tokio::time::interval(Duration::from_secs(1));
        report.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                biased;
                command = commands.recv() => match command {
                    None | Some(Command::Stop) => break,
                    Some(command) => running.handle_command(command),
                },
                _ = report.tick() => running.report(),
                _ = watch.tick() => running.watch(),
                Some((idx, message)) = incoming.next() => running.handle_incoming(idx, message),
            }
        }
        // The recording also holds all messages received by then.
        let leaving = Instant::now();
        while leaving.elapsed() < LAST_INPUTS_LIMIT
            && let Some(Some((idx, message))) = incoming.next().now_or_never()
        {
            running.handle_incoming(idx, message);
        }
        running.end();
    }
}

impl Running {
    fn handle_command(&mut self, command: Command) {
        match command {
            Command::Configure(core) => {
                self.outgoing = Some(outgoing(&core.fusion));
                self.watched.begin(self.engine.clock.running());
                self.watchdog.begin(self.engine.clock.running());
                self.core = Some(*core);
                // What is recorded from now on is replayed with the frames that hold by now.
                for (input, received, cdr) in std::mem::take(&mut self.unrecorded_frames) {
                    self.record(Record::Input { input, received, cdr });
                }
            }
            Command::CleanUp => {
                self.core = None;
                self.outgoing = None;
            }
            Command::Active(active) => self.active = active,
            Command::Thresholds(thresholds) => {
                if let Err(error) = self.take_thresholds(&thresholds) {
                    self.engine
                        .outbox
                        .log(Severity::Error, format!("{error}; the contact thresholds stay as they were"));
                }
            }
            Command::Calibrated(donning, from, reply) => {
                let _ = reply.send(self.install(&donning, from)); // the receiver may be gone
            }
            Command::Known(reply) => {
                let known = |core: &Configured| (Donning::of(&core.fusion), core.calibration.clone());
                let _ = reply.send(self.core.as_ref().map(known).unwrap_or_default()); // the receiver may be gone
            }
            Command::Tap(tap) => self.tap = Some(tap),
            Command::Stop => {}
        }
    }

    fn take_thresholds(&mut self, thresholds: &[ContactThresholds]) -> Result<(), SetupError> {
        self.engine.cfg.set_thresholds(thresholds)?;
        if let Some(core) = &mut self.core {
            core.fusion.handle_thresholds(thresholds)?;
            self.outgoing = Some(outgoing(&core.fusion));
        }
        Ok(())
    }

    fn install(&mut self, donning: &Donning, from: String) -> Result<(), String> {
        let core = self.core.as_mut().ok_or("the node is not configured any more; configure it and calibrate again")?;
        donning.install(&mut core.fusion).map_err(|error| error.to_string())?;
        core.calibration = Some(from);
        self.watched.handle_zero(core.fusion.contracts().map(|contract| contract.window.get()));
        Ok(())
    }

    fn handle_incoming(&mut self, input: usize, incoming: Result<Arrival, Fault>) {
        let Arrival { cdr, received: arrived, publisher } = match incoming {
            Ok(arrival) => arrival,
            Err(fault) => {
                for part in 0..self.bindings[input].len() {
                    self.count(self.source_of(input, part), fault.n_messages, fault.reason, &fault.text);
                }
                return;
            }
        };
        let stamp = if self.engine.clock.is_sim() { self.engine.clock.now() } else { arrived };
        // Receipt times only increase, so that a recording replays in the order of handling.
        self.received = stamp.max(self.received.offset(1));
        // Without a core the message is not handled, and replay must not handle it either.
        if self.engine.recorder.is_some() {
            let tells_frames = |binding: &SampleBinding| matches!(binding, SampleBinding::Frames(..));
            if self.core.is_some() {
                self.record(Record::Input { input, received: self.received, cdr: cdr.clone() });
            } else if self.bindings[input].iter().any(tells_frames) {
                self.unrecorded_frames.push_back((input, self.received, cdr.clone()));
                if self.unrecorded_frames.len() > MAX_UNRECORDED_FRAMES {
                    self.unrecorded_frames.pop_front();
                }
            }
        }
        for part in 0..self.bindings[input].len() {
            let restarts = self.bindings[input][part].clock_restarts();
            self.handle_part(input, part, &cdr, arrived, publisher);
            if self.bindings[input][part].clock_restarts() > restarts {
                let topic = self.watched.inputs[self.source_of(input, part)].topic();
                let text =
                    format!("topic {topic}: the device's clock was set or started anew; its stamps are mapped anew");
                self.engine.outbox.log(Severity::Warn, text);
            }
        }
    }

    /// Gives a record to the recorder, if there is one.
    fn record(&mut self, record: Record) {
        let Some(Err(error)) = self.engine.recorder.as_ref().map(|recorder| recorder.try_send(record)) else { return };
        self.unrecorded += 1;
        if self.unrecorded == 1 {
            let text = match error {
                TrySendError::Full(_) => {
                    "the recorder can't keep up: from here on the recording lacks messages and won't replay alike"
                }
                TrySendError::Disconnected(_) => {
                    "the recording has ended because it can't be written; what is on the disk is kept, and the node goes on"
                }
            };
            self.engine.outbox.log(Severity::Error, text);
        }
    }

    /// Reads a message for one of the sources that use its topic.
    fn handle_part(&mut self, input: usize, part: usize, cdr: &[u8], arrived: Stamp, publisher: Option<[u8; 16]>) {
        let now = self.engine.clock.running();
        let source = self.source_of(input, part);
        let event = self.bindings[input][part].decode(cdr, self.received);
        match &event {
            Err(error) if error.is_kept() => return,
            Err(error) if error.is_for_another() => {
                return self.watched.inputs[source].handle_for_another(error.reason(), &error.to_string());
            }
            _ => self.watched.inputs[source].handle_arrival(now, publisher),
        }
        let event = match event {
            Ok(event) => event,
            Err(error) => {
                let (reason, text) = (error.reason(), error.to_string());
                return self.count(source, 1, reason, &text);
            }
        };
        if let Some(tap) = &self.tap
            && tap.send(Sample::from(&event)).is_err()
        {
            self.tap = None;
        }
        self.watched.handle(&event);
        if let Event::Tactile(block) = &event {
            self.watchdog.handle_message(block.source.position(), now);
        }
        let Some(core) = &mut self.core else { return };
        match core.fusion.handle(event) {
            Ok(()) => self.drain(arrived),
            Err(failure) => self.give_up(&failure),
        }
    }

    /// Queues the core's outputs for publishing.
    fn drain(&mut self, arrived: Stamp) {
        let (Some(core), Some(outgoing)) = (&mut self.core, &mut self.outgoing) else { return };
        let failure = loop {
            match core.fusion.poll() {
                Ok(None) => return,
                Ok(Some(tick)) => {
                    let was_stale = self.watchdog.handle_frame(tick.source.position(), self.engine.clock.running());
                    if was_stale && self.said_stale.remove(&tick.source.position()) {
                        let name = &self.engine.cfg.fusion().tactile_sources()[tick.source.position()].name;
                        self.engine.outbox.log(Severity::Info, format!("tactile source {name} is back"));
                    }
                    for estimate in &tick.estimates {
                        self.watched.handle_estimate(estimate);
                    }
                    let of = Some(Origin { stamp: tick.stamp, received: arrived });
                    let recorder = self.engine.recorder.as_ref();
                    let newest = self.order.admits(tick.source.position(), tick.stamp, self.engine.clock.now());
                    send(&self.engine, recorder, outgoing, tick, of, self.active && newest, &mut self.cdr);
                    let selection = self.engine.selection.as_mut().filter(|_| self.active && newest);
                    if let Some(mut shown) = selection.and_then(|selection| selection.handle(tick)) {
                        shown.subtract_zero(&core.fusion);
                        self.engine.outbox.show(shown);
                    }
                }
                Err(error) => break error,
            }
        };
        self.give_up(&failure);
    }

    /// Lets go of a core that can't go on.
    fn give_up(&mut self, failure: &FusionError) {
        self.engine.outbox.log(Severity::Error, format!("{failure}; clean up and configure the node again"));
        self.core = None;
        self.outgoing = None;
    }

    /// Reports tactile sources that have stopped, so that no subscriber goes on with their last force.
    fn watch(&mut self) {
        let now = self.engine.clock.running();
        if self.core.is_none() {
            return;
        }
        let mut barked = false;
        while let Some((source_idx, silence, first)) = self.watchdog.poll(now) {
            let source = &self.engine.cfg.fusion().tactile_sources()[source_idx];
            // A source that never sent anything is reported with the other inputs, after time for discovery.
            if first && self.watched.inputs[source_idx].meter().n_total() > 0 {
                self.said_stale.insert(source_idx);
                let what = match silence {
                    Silence::Messages => "nothing came",
                    Silence::Frames => "messages come, but no frame that could be used",
                };
                let timeout = self.engine.cfg.live.tactile_timeout;
                let text = format!("tactile source {}: {what} for {timeout:?}: STALE_TACTILE", source.name);
                self.engine.outbox.log(Severity::Warn, text);
            }
            barked = true;
        }
        // If another source still sends, the contacts of its frames report which sources are missing.
        let regions = self.engine.cfg.fusion().regions();
        if !barked || !regions.iter().all(|region| self.watchdog.is_stale(region.source.position())) {
            return;
        }
        let is_due = |said: Duration| now.saturating_sub(said) * 2 >= self.engine.cfg.live.tactile_timeout;
        if let Some(outgoing) = self.outgoing.as_ref().filter(|_| self.active && self.silent_said.is_none_or(is_due)) {
            self.silent_said = Some(now);
            let time = self.engine.clock.now();
            let stamps = regions.iter().map(|region| self.order.silent(region.source.position(), time));
            let contacts = outgoing.silent(stamps.max().unwrap_or(time));
            // Not recorded: elapsed time is not an event, so replay could not reproduce it.
            self.engine.outbox.send(self.engine.outputs.contacts, to_cdr(&contacts), None);
        }
    }

    /// The index of a source that reads from an input: tactile sources first, then joint sources.
    fn source_of(&self, input: usize, part: usize) -> usize {
        self.watched.source_of(&self.bindings[input][part])
    }

    fn count(&mut self, source: usize, n_messages: u64, reason: &'static str, text: &str) {
        let health = &mut self.watched.inputs[source];
        if health.handle_unreadable(n_messages, reason, text) {
            let topic = health.topic();
            self.engine
                .outbox
                .log(Severity::Warn, format!("topic {topic}: {text}; dropped, as all such messages will be"));
        }
    }

    /// Ends the stream as replay does, so that a recording holds every estimate of its inputs.
    fn end(&mut self) {
        if let Some(core) = &mut self.core
            && self.engine.recorder.is_some()
        {
            core.fusion.handle_end();
            self.said_stale.clear(); // frames that waited for angles say nothing of their source
            self.drain(self.received);
            let Some(outgoing) = &mut self.outgoing else { return };
            let received = outgoing.received();
            let recorder = self.engine.recorder.as_ref();
            let told = outgoing.finish(&mut self.cdr, |slot, cdr| {
                let sent =
                    recorder.map(|recorder| recorder.try_send(Record::Output { slot, received, cdr: cdr.to_vec() }));
                drop(sent); // replay makes it again from the inputs
                Ok::<(), std::convert::Infallible>(())
            });
            match told {
                Ok(()) => {}
                Err(never) => match never {},
            }
        }
    }
}

/// Messages of the regions of a core.
fn outgoing(fusion: &Fusion) -> Outgoing {
    let contracts: Vec<&Contract> = fusion.contracts().collect();
    Outgoing::new(fusion.config(), &contracts)
}

/// Queues the messages of a tick for publishing and for the recording.
fn send(
    engine: &Engine,
    recorder: Option<&SyncSender<Record>>,
    outgoing: &mut Outgoing,
    tick: &Tick,
    of: Option<Origin>,
    active: bool,
    cdr: &mut Vec<u8>,
) {
    let encoded = outgoing.encode(tick, cdr, |slot, cdr| {
        if let Some(recorder) = recorder {
            // Replay makes these again from the inputs, whose loss is counted.
            let _ = recorder.try_send(Record::Output { slot, received: tick.received, cdr: cdr.to_vec() });
        }
        if active {
            let to = match slot {
                Slot::Wrench(region) => engine.outputs.wrenches[region.position()],
                Slot::Contacts => engine.outputs.contacts,
            };
            engine.outbox.send(to, cdr.to_vec(), of);
        }
        Ok::<(), std::convert::Infallible>(())
    });
    match encoded {
        Ok(()) => {}
        Err(never) => match never {},
    }
}
