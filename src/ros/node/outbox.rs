//! Publishing on a separate thread: a slow subscriber delays only the publishing.

use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::diagnostics::Latencies;
use super::interfaces::Log;
use super::visuals::{Drawing, Shown};
use crate::msg::to_cdr;
use crate::ros::wire::args::Severity;
use crate::ros::wire::clock::{Clock, system_now};
use crate::ros::wire::error::NodeError;
use crate::ros::wire::middleware::{Publisher, Settle};
use crate::ros::wire::threads;
use crate::units::{Stamp, nanos};

/// Maximum number of messages waiting to be published: a second of a fast glove with five regions.
const CAPACITY: usize = 8192;

/// Maximum number of lines waiting for a terminal.
const MAX_LINES: usize = 1024;

/// Time limit for a terminal to show the last lines.
const TERMINAL_LIMIT: Duration = Duration::from_millis(100);

/// Time limit for reliable subscribers to take the last messages.
const SETTLING_LIMIT: Duration = Duration::from_millis(150);

/// Index of a publisher.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct OutIdx(pub(super) usize);

enum Out {
    Message { to: OutIdx, cdr: Vec<u8>, of: Option<Origin> },
    Picture(Box<Shown>),
    Log { severity: Severity, text: String },
    End,
}

/// Stamp of an estimate's data, and receipt time of the message that completed it, by the system clock.
#[derive(Debug, Clone, Copy)]
pub(super) struct Origin {
    pub(super) stamp: Stamp,
    pub(super) received: Stamp,
}

/// Queue of messages and log lines to publish. Adding to it never waits.
#[derive(Debug, Clone)]
pub(super) struct Outbox {
    sender: SyncSender<Out>,
    stats: Arc<Stats>,
    log: LogConfig,
}

/// A log line and its destination.
#[derive(Debug, Clone, Copy)]
pub(super) struct LogConfig {
    pub(super) level: Severity,
    pub(super) stderr: bool,
}

/// The publisher of log lines, and the node name in them.
pub(super) struct Rosout {
    pub(super) publisher: Publisher,
    pub(super) logger: String,
}

/// Counters of the queue, by outcome.
#[derive(Debug, Default)]
pub(super) struct Stats {
    /// Messages dropped because the queue was full.
    pub(super) dropped: AtomicU64,
    /// Messages that the middleware refused: a reliable subscriber has not acknowledged earlier ones.
    pub(super) failed: AtomicU64,
    /// Estimates that waited in the node longer than the age limit of their data: too old to publish.
    pub(super) waited: AtomicU64,
    /// Pictures that the middleware refused. They are not estimates, so nothing is wrong then.
    pub(super) pictures_failed: AtomicU64,
    /// Messages that were sent.
    pub(super) published: AtomicU64,
    latencies: Mutex<[Latencies; 2]>,
}

impl Stats {
    /// Latencies since the last call: from the stamp, and from receipt.
    pub(super) fn take_latencies(&self) -> [Option<super::diagnostics::Percentiles>; 2] {
        let mut latencies = self.latencies.lock().unwrap_or_else(PoisonError::into_inner);
        let [stamp, received] = &mut *latencies;
        [stamp.take(), received.take()]
    }
}

/// The publishing thread.
pub(super) struct PublishThread {
    sender: SyncSender<Out>,
    thread: JoinHandle<()>,
}

/// Publishers of pictures, and what draws them.
pub(super) struct Pictures {
    /// Of the markers of all regions, then of the image of each.
    pub(super) publishers: Vec<Publisher>,
    pub(super) drawing: Drawing,
    /// True if they are published even if nobody subscribes.
    pub(super) always: bool,
}

/// Starts publishing.
pub(super) fn start(
    publishers: Vec<Publisher>,
    pictures: Option<Pictures>,
    rosout: Option<Rosout>,
    log: LogConfig,
    clock: Arc<Clock>,
    max_wait: Option<Duration>,
    settle: Settle,
) -> Result<(Outbox, PublishThread), NodeError> {
    let (sender, receiver) = sync_channel(CAPACITY);
    let stats = Arc::new(Stats::default());
    let outbox = Outbox { sender: sender.clone(), stats: Arc::clone(&stats), log };
    let stderr = log.stderr.then(Terminal::open).transpose()?;
    let work =
        move || Publishing { publishers, pictures, rosout, stderr, stats, clock, max_wait, settle }.run(&receiver);
    let thread = threads::spawn("publish", work)?;
    Ok((outbox, PublishThread { sender, thread }))
}

impl Outbox {
    /// Adds a message; if too many wait it is dropped and counted.
    pub(super) fn send(&self, to: OutIdx, cdr: Vec<u8>, of: Option<Origin>) {
        if self.sender.try_send(Out::Message { to, cdr, of }).is_err() {
            self.stats.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Adds a frame to draw; if too many messages wait it is dropped.
    pub(super) fn show(&self, shown: Shown) {
        if self.sender.try_send(Out::Picture(Box::new(shown))).is_err() {
            self.stats.pictures_failed.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Logs a line to stderr or `/rosout`.
    pub(super) fn log(&self, severity: Severity, text: impl Into<String>) {
        if severity < self.log.level {
            return;
        }
        let text = text.into();
        // The other thread writes it: a terminal that hangs must not block the thread that reads inputs.
        if self.sender.try_send(Out::Log { severity, text }).is_err() {
            self.stats.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The counters of the queue.
    pub(super) fn stats(&self) -> &Stats {
        &self.stats
    }
}

impl PublishThread {
    /// Publishes everything queued so far, and ends, within a limit. The publishers are then dropped, unless one hangs.
    pub(super) fn end(self, limit: Duration) {
        // If the queue is full there is no room for the end marker, and the thread has more work than time.
        if self.sender.try_send(Out::End).is_ok() {
            threads::ends_within(&self.thread, limit);
        }
    }
}

/// Data of the publishing thread.
struct Publishing {
    publishers: Vec<Publisher>,
    pictures: Option<Pictures>,
    rosout: Option<Rosout>,
    stderr: Option<Terminal>,
    stats: Arc<Stats>,
    clock: Arc<Clock>,
    /// Time limit of an estimate in the node.
    max_wait: Option<Duration>,
    settle: Settle,
}

/// The thread that writes to stderr: a terminal that hangs (Ctrl-S, a pager) blocks nothing else.
struct Terminal {
    lines: SyncSender<String>,
    thread: JoinHandle<()>,
}

impl Terminal {
    fn open() -> Result<Self, NodeError> {
        let (lines, receiver) = sync_channel::<String>(MAX_LINES);
        let thread = threads::spawn("stderr", move || {
            for line in receiver {
                let _ = writeln!(std::io::stderr(), "{line}"); // stderr may be closed
            }
        })?;
        Ok(Terminal { lines, thread })
    }

    fn close(self) {
        drop(self.lines);
        threads::ends_within(&self.thread, TERMINAL_LIMIT);
    }
}

impl Publishing {
    fn run(mut self, receiver: &Receiver<Out>) {
        while let Ok(out) = receiver.recv() {
            match out {
                Out::End => break,
                Out::Log { severity, text } => self.log(severity, &text),
                Out::Message { to, cdr, of } => self.publish(to, cdr, of),
                Out::Picture(shown) => self.show(&shown),
            }
        }
        (self.settle)(SETTLING_LIMIT);
        if let Some(stderr) = self.stderr {
            stderr.close();
        }
    }

    fn log(&self, severity: Severity, text: &str) {
        if let Some(stderr) = &self.stderr
            && stderr.lines.try_send(format!("[{}] {text}", name(severity))).is_err()
        {
            self.stats.dropped.fetch_add(1, Ordering::Relaxed);
        }
        if let Some(rosout) = &self.rosout {
            let log = Log::new(self.clock.now().into(), severity, &rosout.logger, text);
            let _ = rosout.publisher.publish(to_cdr(&log)); // a slow subscriber loses it; stderr has it too
        }
    }

    /// Draws a frame for those who subscribe to pictures.
    fn show(&mut self, shown: &Shown) {
        let Some(Pictures { publishers, drawing, always }) = &mut self.pictures else { return };
        drawing.handle(shown);
        let is_wanted = |publisher: &Publisher| *always || publisher.has_subscribers();
        let publish = |publisher: &Publisher, cdr| {
            if publisher.publish(cdr).is_err() {
                self.stats.pictures_failed.fetch_add(1, Ordering::Relaxed);
            }
        };
        let [markers, images @ ..] = publishers.as_slice() else { return };
        if is_wanted(markers) {
            publish(markers, to_cdr(&drawing.markers(shown)));
        }
        for region in &shown.regions {
            let image = &images[region.estimate.region.position()];
            if is_wanted(image) {
                publish(image, to_cdr(&drawing.image(region, shown.stamp)));
            }
        }
    }

    fn publish(&self, to: OutIdx, cdr: Vec<u8>, of: Option<Origin>) {
        let Some(publisher) = self.publishers.get(to.0) else { return };
        // The process was stopped, or a subscriber blocked this thread: the queued estimates are out of date.
        let waited_ns = of.map_or(0, |origin| system_now().nanos_since(origin.received));
        if self.max_wait.is_some_and(|max_wait| waited_ns > nanos(max_wait)) {
            self.stats.waited.fetch_add(1, Ordering::Relaxed);
            return;
        }
        if publisher.publish(cdr).is_err() {
            self.stats.failed.fetch_add(1, Ordering::Relaxed);
            return;
        }
        self.stats.published.fetch_add(1, Ordering::Relaxed);
        if let Some(origin) = of {
            let mut latencies = self.stats.latencies.lock().unwrap_or_else(PoisonError::into_inner);
            latencies[0].handle(self.clock.now().nanos_since(origin.stamp));
            latencies[1].handle(system_now().nanos_since(origin.received));
        }
    }
}

fn name(severity: Severity) -> &'static str {
    match severity {
        Severity::Debug => "DEBUG",
        Severity::Info => "INFO",
        Severity::Warn => "WARN",
        Severity::Error => "ERROR",
        Severity::Fatal => "FATAL",
    }
}
