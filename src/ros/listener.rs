//! A node that hears topics as bytes, and publishes messages now and then: what a tool beside the live node is made of.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use futures::StreamExt;
use ros2_client::QosProfile;
use ros2_client::qos::Durability;
use tokio::sync::oneshot;

use super::entities::{Graph, reliable_qos};
use super::environment::Environment;
use super::middleware::{Publisher, Subscription, TopicType};
use super::node::{NodeError, runtime};
use super::qos;
use super::remap::{self, NameKind, Remap};
use super::threads;
use super::watched::Watched;
use crate::config::NodeName;
use crate::msg::{WireType, to_cdr};
use crate::units::Stamp;

/// Messages that wait for whoever listens: some seconds of a fast glove.
const CAPACITY: usize = 16_384;

/// How long the thread that listens gets to end.
const LISTEN_LIMIT: Duration = Duration::from_millis(300);

/// A topic that is heard, by the order of subscribing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct HeardTopic(pub usize);

/// A topic that is published.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SpokenTopic(usize);

/// How a topic's messages are delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Best effort, the last 100: fast data. A subscription of it hears publishers of either kind.
    Data,
    /// Reliable, everything in order, without waiting for a reader that is slow: what is said once.
    Words,
    /// As `Words`, and the last of what was said before.
    Latched,
}

/// Something that came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Heard {
    /// On which topic.
    pub topic: HeardTopic,
    /// The message in CDR, or why there is none.
    pub cdr: Result<Vec<u8>, String>,
    /// When it came, by the system's clock.
    pub received: Stamp,
}

/// A node before it listens.
pub struct Listening {
    graph: Graph,
    node: NodeName,
    remaps: Vec<Remap>,
    subscriptions: Vec<Subscription>,
    publishers: Vec<Publisher>,
}

/// A node that listens, on a thread of its own.
pub struct Listener {
    graph: Graph,
    publishers: Vec<Publisher>,
    heard: Receiver<Heard>,
    missed: Arc<AtomicU64>,
    stop: oneshot::Sender<()>,
    thread: std::thread::JoinHandle<()>,
}

impl Listening {
    /// Joins the graph as `node`.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware can't start.
    pub fn join(node: &NodeName, environment: &Environment, remaps: &[Remap]) -> Result<Self, NodeError> {
        Ok(Listening {
            graph: Graph::join(node, environment, remaps)?,
            node: node.clone(),
            remaps: remaps.to_vec(),
            subscriptions: Vec::new(),
            publishers: Vec::new(),
        })
    }

    /// What a person should know about the graph that was joined.
    pub fn note(&self) -> Option<String> {
        self.graph.note()
    }

    /// Subscribes to a topic by its absolute name before remapping.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware refuses it.
    pub fn hear(&mut self, topic: &str, ty: TopicType<'_>, delivery: Delivery) -> Result<HeardTopic, NodeError> {
        let topic = remap::name(&self.remaps, &self.node, NameKind::Topic, topic)?;
        self.subscriptions.push(self.graph.subscription(&topic, ty, &delivery.qos())?);
        Ok(HeardTopic(self.subscriptions.len() - 1))
    }

    /// Publishes a topic by its absolute name before remapping.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware refuses it.
    pub fn speak(&mut self, topic: &str, ty: TopicType<'_>, delivery: Delivery) -> Result<SpokenTopic, NodeError> {
        let topic = remap::name(&self.remaps, &self.node, NameKind::Topic, topic)?;
        self.publishers.push(self.graph.publisher(&topic, ty, &delivery.qos())?);
        Ok(SpokenTopic(self.publishers.len() - 1))
    }

    /// Begins to listen.
    ///
    /// # Errors
    /// [`NodeError`] when there is no thread to be had.
    pub fn start(self) -> Result<Listener, NodeError> {
        let Listening { graph, subscriptions, publishers, .. } = self;
        let (sender, heard) = sync_channel(CAPACITY);
        let (stop, stopped) = oneshot::channel();
        let missed = Arc::new(AtomicU64::new(0));
        let (runtime, counter) = (runtime()?, Arc::clone(&missed));
        let work = move || runtime.block_on(listen(&subscriptions, &sender, &counter, stopped));
        let thread = threads::spawn("listen", work)?;
        Ok(Listener { graph, publishers, heard, missed, stop, thread })
    }
}

impl Listener {
    /// What came next; waits for it at most so long.
    pub fn next(&self, timeout: Duration) -> Option<Heard> {
        self.heard.recv_timeout(timeout).ok()
    }

    /// What has come already.
    pub fn poll(&self) -> Option<Heard> {
        self.heard.try_recv().ok()
    }

    /// Messages that came and were dropped, because whoever listens was too far behind.
    pub fn missed(&self) -> u64 {
        self.missed.load(Ordering::Relaxed)
    }

    /// Publishes a message; whether it went to everyone who is to have it.
    pub fn say<M: WireType>(&self, topic: SpokenTopic, message: &M) -> bool {
        self.say_cdr(topic, to_cdr(message))
    }

    /// As [`say`](Self::say), of a message in little-endian CDR.
    pub fn say_cdr(&self, topic: SpokenTopic, cdr: Vec<u8>) -> bool {
        self.publishers[topic.0].publish(cdr).is_ok()
    }

    /// Looks at who else is in the graph, for what is said of inputs that don't come.
    pub fn look_around(&self, watched: &mut Watched, now: Duration) {
        watched.look_around(now, self.graph.neighbours().as_ref());
    }

    /// Leaves the graph.
    pub fn leave(self) {
        let Listener { graph, publishers, stop, thread, .. } = self;
        let _ = stop.send(()); // the thread may have ended
        threads::ends_within(&thread, LISTEN_LIMIT);
        drop(publishers);
        graph.leave();
    }
}

impl Delivery {
    fn qos(self) -> QosProfile {
        match self {
            Delivery::Data => qos::input_default(),
            Delivery::Words => reliable_qos(1000, Durability::Volatile),
            Delivery::Latched => reliable_qos(1, Durability::TransientLocal),
        }
    }
}

async fn listen(
    subscriptions: &[Subscription],
    sender: &SyncSender<Heard>,
    missed: &AtomicU64,
    stopped: oneshot::Receiver<()>,
) {
    let streams = subscriptions
        .iter()
        .enumerate()
        .map(|(idx, subscription)| subscription.arrivals().map(move |arrival| (HeardTopic(idx), arrival)));
    let mut arrivals = futures::stream::select_all(streams);
    let mut stopped = stopped;
    loop {
        tokio::select! {
            biased;
            _ = &mut stopped => return,
            Some((topic, arrival)) = arrivals.next() => {
                let heard = match arrival {
                    Ok(arrival) => Heard { topic, cdr: Ok(arrival.cdr), received: arrival.received },
                    Err(fault) => Heard { topic, cdr: Err(fault.text), received: super::clock::system_now() },
                };
                if sender.try_send(heard).is_err() {
                    missed.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
    }
}
