//! The thread that reads inputs and runs the core. It never publishes and never waits for anyone who does.

mod report;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Duration;

use futures::StreamExt;
use tokio::sync::{mpsc, oneshot};

use super::args::Severity;
use super::calibrator::Sample;
use super::clock::Clock;
use super::diagnostics::{Budget, RateMeter};
use super::middleware::{Arrival, Fault, Subscription};
use super::outbox::{Origin, OutIdx, Outbox};
use super::watchdog::Watchdog;
use crate::config::Config;
use crate::fusion::{
    Baseline, Contact, ContactEvent, ContactThresholds, Estimate, Event, Flags, Fusion, TactileSourceIdx, Tick,
};
use crate::msg::binding::SampleBinding;
use crate::msg::{Outgoing, Slot};
use crate::units::{Newton, Stamp};

/// What is recorded, in the order in which it was handled.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// A message came in.
    Input {
        /// Index of the input: tactile sources first, then joint sources.
        input: usize,
        /// When it came.
        received: Stamp,
        /// The message.
        cdr: Vec<u8>,
    },
    /// A message went out, or would have gone if the node were active.
    Output {
        /// Which one.
        slot: Slot,
        /// When the input came that completed it.
        received: Stamp,
        /// The message.
        cdr: Vec<u8>,
    },
}

/// What the engine is told by the rest of the node.
pub(super) enum Command {
    /// These models and baselines are to run.
    Configure(Box<Core>),
    /// Nothing is to run.
    CleanUp,
    /// Whether to publish.
    Active(bool),
    /// Contact thresholds, one a region.
    Thresholds(Vec<ContactThresholds>),
    /// A baseline for each tactile source, and where they are from; answers whether they are in use.
    Baselines(Vec<Baseline>, String, oneshot::Sender<Result<(), String>>),
    /// Send a copy of each sample there, until that end is dropped.
    Tap(mpsc::UnboundedSender<Sample>),
    /// The end.
    Stop,
}

/// What is there while the node is configured.
pub(super) struct Core {
    pub(super) fusion: Fusion,
    /// Minimum detectable force of each region's model, where it is known.
    pub(super) mdf: Vec<Option<Newton>>,
    /// What runs each model, for people.
    pub(super) models: Vec<(String, String)>,
    /// Where the baseline is from; none where there is none.
    pub(super) calibration: Option<String>,
}

/// A topic that feeds the core.
pub(super) struct Input {
    pub(super) topic: String,
    pub(super) subscription: Subscription,
    pub(super) binding: SampleBinding,
}

/// Where the engine's messages go.
#[derive(Debug, Clone)]
pub(super) struct Outputs {
    pub(super) wrenches: Vec<OutIdx>,
    pub(super) contacts: OutIdx,
    pub(super) diagnostics: OutIdx,
}

pub(super) struct Engine {
    pub(super) cfg: Config,
    pub(super) clock: Arc<Clock>,
    pub(super) outbox: Outbox,
    pub(super) outputs: Outputs,
    pub(super) recorder: Option<SyncSender<Record>>,
}

/// What runs while messages come.
struct Running {
    engine: Engine,
    topics: Vec<String>,
    bindings: Vec<SampleBinding>,
    core: Option<Core>,
    outgoing: Option<Outgoing>,
    active: bool,
    watchdog: Watchdog,
    meters: Vec<RateMeter>,
    unreadable: Vec<BTreeMap<&'static str, u64>>,
    budgets: BTreeMap<String, Budget>,
    contacts: Vec<Contact>,
    tap: Option<mpsc::UnboundedSender<Sample>>,
    received: Stamp,
    unrecorded: u64,
    cdr: Vec<u8>,
}

impl Engine {
    /// Reads and estimates until it is told to stop.
    pub(super) async fn run(self, inputs: Vec<Input>, mut commands: mpsc::UnboundedReceiver<Command>) {
        let mut running = Running {
            watchdog: Watchdog::new(self.cfg.fusion.tactile_sources.len(), self.cfg.live.tactile_timeout),
            topics: inputs.iter().map(|input| input.topic.clone()).collect(),
            bindings: inputs.iter().map(|input| input.binding.clone()).collect(),
            core: None,
            outgoing: None,
            active: false,
            meters: vec![RateMeter::default(); inputs.len()],
            unreadable: vec![BTreeMap::new(); inputs.len()],
            budgets: BTreeMap::new(),
            contacts: vec![Contact::default(); self.cfg.fusion.regions.len()],
            tap: None,
            received: Stamp(0),
            unrecorded: 0,
            cdr: Vec::new(),
            engine: self,
        };
        let streams = inputs
            .iter()
            .enumerate()
            .map(|(idx, input)| input.subscription.arrivals().map(move |incoming| (idx, incoming)));
        let mut incoming = futures::stream::select_all(streams);
        // As fine as the watchdog needs to be within a tenth of its limit.
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
        running.end();
    }
}

impl Running {
    fn handle_command(&mut self, command: Command) {
        match command {
            Command::Configure(core) => {
                self.outgoing = Some(Outgoing::new(core.fusion.config(), &core.mdf));
                self.contacts.fill(Contact::default());
                self.core = Some(*core);
            }
            Command::CleanUp => {
                self.core = None;
                self.outgoing = None;
            }
            Command::Active(active) => self.active = active,
            Command::Thresholds(thresholds) => {
                if let Some(core) = &mut self.core {
                    core.fusion.handle_thresholds(&thresholds);
                    self.outgoing = Some(Outgoing::new(core.fusion.config(), &core.mdf));
                }
                for (region, thresholds) in self.engine.cfg.fusion.regions.iter_mut().zip(thresholds) {
                    region.contact = thresholds;
                }
            }
            Command::Baselines(baselines, from, reply) => {
                let _ = reply.send(self.install(baselines, from)); // who asked may be gone
            }
            Command::Tap(tap) => self.tap = Some(tap),
            Command::Stop => {}
        }
    }

    fn install(&mut self, baselines: Vec<Baseline>, from: String) -> Result<(), String> {
        let core = self.core.as_mut().ok_or("the node is not configured any more; configure it and calibrate again")?;
        for (source_idx, baseline) in baselines.into_iter().enumerate() {
            let installed = core.fusion.handle_baseline(TactileSourceIdx(source_idx), baseline);
            installed.map_err(|error| error.to_string())?;
        }
        core.calibration = Some(from);
        Ok(())
    }

    fn handle_incoming(&mut self, input: usize, incoming: Result<Arrival, Fault>) {
        let now = self.engine.clock.running();
        let Arrival { cdr, received: arrived } = match incoming {
            Ok(arrival) => arrival,
            Err(fault) => return self.count(input, fault.n_messages, fault.reason, &fault.text),
        };
        self.meters[input].handle_arrival(now);
        let stamp = if self.engine.clock.is_sim() { self.engine.clock.now() } else { arrived };
        // Receipts only grow, so that a recording replays in the order in which it was handled.
        self.received = stamp.max(self.received.offset(1));
        // Without a core nothing handles it, and replay must not either.
        if let Some(recorder) = self.engine.recorder.as_ref().filter(|_| self.core.is_some()) {
            let record = Record::Input { input, received: self.received, cdr: cdr.clone() };
            if let Err(error) = recorder.try_send(record) {
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
        }
        let event = match self.bindings[input].decode(&cdr, self.received) {
            Ok(event) => event,
            Err(error) => return self.count(input, 1, error.reason(), &error.to_string()),
        };
        if let Some(tap) = &self.tap
            && tap.send(Sample::from(&event)).is_err()
        {
            self.tap = None;
        }
        if let Event::Tactile(block) = &event
            && self.watchdog.handle_sample(block.source.0, now)
        {
            let name = &self.engine.cfg.fusion.tactile_sources[block.source.0].name;
            self.engine.outbox.log(Severity::Info, format!("tactile source {name} is back"));
        }
        let Some(core) = &mut self.core else { return };
        core.fusion.handle(event);
        self.drain(arrived);
    }

    /// Leaves what the core has ready to be published.
    fn drain(&mut self, arrived: Stamp) {
        let (Some(core), Some(outgoing)) = (&mut self.core, &mut self.outgoing) else { return };
        let failure = loop {
            match core.fusion.poll() {
                Ok(None) => return,
                Ok(Some(tick)) => {
                    for estimate in &tick.estimates {
                        self.contacts[estimate.region] = estimate.contact;
                    }
                    let of = Some(Origin { stamp: tick.stamp, received: arrived });
                    let recorder = self.engine.recorder.as_ref();
                    send(&self.engine, recorder, outgoing, tick, of, self.active, &mut self.cdr);
                }
                Err(error) => break error,
            }
        };
        self.engine.outbox.log(Severity::Error, format!("{failure}; clean up and configure the node again"));
        self.core = None;
        self.outgoing = None;
    }

    /// Says which tactile sources have stopped, so that nobody goes on with their last force.
    fn watch(&mut self) {
        let now = self.engine.clock.running();
        while let Some((source_idx, first)) = self.watchdog.poll(now) {
            let source = &self.engine.cfg.fusion.tactile_sources[source_idx];
            if first {
                let text = format!(
                    "tactile source {}: nothing came for {:?}",
                    source.name, self.engine.cfg.live.tactile_timeout
                );
                self.engine.outbox.log(Severity::Warn, text);
            }
            let Some(outgoing) = &mut self.outgoing else { continue };
            let regions = self.engine.cfg.fusion.regions.iter().enumerate();
            let of_source = regions.filter(|(_, region)| region.source.0 == source_idx);
            let stale = |(region, _)| Estimate {
                region,
                contact: Contact { raw: false, event: ContactEvent::None, ..self.contacts[region] },
                flags: Flags::STALE_TACTILE,
                ..Estimate::default()
            };
            let stamp = self.engine.clock.now();
            let estimates = of_source.map(stale).collect();
            // No frame of the stream, so it counts in none of its epochs.
            let (source, epoch, number) = (TactileSourceIdx(source_idx), 0, 0);
            let tick = Tick { source, stamp, epoch, number, received: stamp, estimates };
            // Not recorded: that time passed is no event, so replay could not say it again.
            send(&self.engine, None, outgoing, &tick, None, self.active, &mut self.cdr);
        }
    }

    fn count(&mut self, input: usize, n_messages: u64, reason: &'static str, text: &str) {
        let counter = self.unreadable[input].entry(reason).or_default();
        *counter += n_messages;
        if *counter == n_messages {
            let topic = &self.topics[input];
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
            self.drain(self.received);
        }
    }
}

/// Leaves the messages of a tick to be published and to be recorded.
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
                Slot::Wrench(region) => engine.outputs.wrenches[region],
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
