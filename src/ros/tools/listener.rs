//! A node that receives topics as bytes and sometimes publishes messages: the base of tools beside the live node.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use futures::StreamExt;
use ros2_client::QosProfile;
use ros2_client::qos::Durability;
use tokio::sync::oneshot;

use crate::config::NodeName;
use crate::msg::{WireType, to_cdr};
use crate::ros::node::Watched;
use crate::ros::wire::entities::{Graph, InputName};
use crate::ros::wire::environment::Environment;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::graph::{Around, Endpoint};
use crate::ros::wire::middleware::{Arrival, Publisher, Subscription, TopicType};
use crate::ros::wire::qos::{self, reliable_qos};
use crate::ros::wire::remap::{self, NameKind, Remap};
use crate::ros::wire::threads::{self, runtime};
use crate::units::Stamp;

/// Messages that may wait for the reader: some seconds of a fast glove.
const CAPACITY: usize = 16_384;

/// Time limit for the listening thread to end.
const LISTEN_LIMIT: Duration = Duration::from_millis(300);

/// Index of a subscribed topic, in the order of subscribing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct SubscribedTopic(pub usize);

/// Index of a published topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PublishedTopic(usize);

/// How a topic's messages are delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// Best effort, the last 100: fast data. Such a subscription matches best effort and reliable publishers.
    Data,
    /// Reliable, everything in order, without waiting for a slow subscriber: for data sent once.
    Reliable,
    /// As `Reliable`, and late subscribers get the last message.
    Latched,
    /// As `Latched`, from several publishers: frames that don't change.
    Frames,
}

/// A received message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Incoming {
    /// Its topic.
    pub topic: SubscribedTopic,
    /// The message in CDR, or the reason why there is none.
    pub cdr: Result<Vec<u8>, String>,
    /// Receipt time, by the system clock.
    pub received: Stamp,
    /// Its sender, if the middleware reports it.
    pub publisher: Option<[u8; 16]>,
}

/// A node before it starts listening.
pub struct Listening {
    graph: Graph,
    node: NodeName,
    remaps: Vec<Remap>,
    subscriptions: Vec<Subscription>,
    publishers: Vec<Publisher>,
}

/// A node that listens, on its own thread.
pub struct Listener {
    graph: Graph,
    publishers: Vec<Publisher>,
    incoming: Receiver<Incoming>,
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

    /// Notes for the user about the graph.
    pub fn note(&self) -> Option<String> {
        self.graph.note()
    }

    /// Publishers of other nodes that have been discovered by now; `None` if the middleware doesn't report them.
    pub fn publishers(&self) -> Option<Vec<Endpoint>> {
        self.graph.neighbours().map(|neighbours| neighbours.publishers())
    }

    /// The other nodes and all of their entities, by now. May wait for answers of the network, up to half a second.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware refuses to tell.
    pub fn around(&mut self) -> Result<Around, NodeError> {
        self.graph.around()
    }

    /// Subscribes to a topic by its absolute name before remapping.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware refuses it.
    pub fn subscribe(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        delivery: Delivery,
    ) -> Result<SubscribedTopic, NodeError> {
        let topic = remap::name(&self.remaps, &self.node, NameKind::Topic, topic)?;
        self.subscriptions.push(self.graph.subscription(&topic, ty, &delivery.qos())?);
        Ok(SubscribedTopic(self.subscriptions.len() - 1))
    }

    /// Publishes a topic by its absolute name before remapping.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware refuses it.
    pub fn add_publisher(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        delivery: Delivery,
    ) -> Result<PublishedTopic, NodeError> {
        let topic = remap::name(&self.remaps, &self.node, NameKind::Topic, topic)?;
        self.publishers.push(self.graph.publisher(&topic, ty, &delivery.qos())?);
        Ok(PublishedTopic(self.publishers.len() - 1))
    }

    /// Starts listening.
    ///
    /// # Errors
    /// [`NodeError`] when no thread can be started.
    pub fn start(self) -> Result<Listener, NodeError> {
        let Listening { graph, subscriptions, publishers, .. } = self;
        let (sender, incoming) = sync_channel(CAPACITY);
        let (stop, stopped) = oneshot::channel();
        let missed = Arc::new(AtomicU64::new(0));
        let (runtime, counter) = (runtime()?, Arc::clone(&missed));
        let work = move || runtime.block_on(listen(&subscriptions, &sender, &counter, stopped));
        let thread = threads::spawn("listen", work)?;
        Ok(Listener { graph, publishers, incoming, missed, stop, thread })
    }
}

impl Listener {
    /// The next message; waits for it up to this limit.
    pub fn next(&self, timeout: Duration) -> Option<Incoming> {
        self.incoming.recv_timeout(timeout).ok()
    }

    /// The messages that have already arrived.
    pub fn poll(&self) -> Option<Incoming> {
        self.incoming.try_recv().ok()
    }

    /// Messages that were dropped because the reader was too far behind.
    pub fn missed(&self) -> u64 {
        self.missed.load(Ordering::Relaxed)
    }

    /// Publishes a message; true if everyone who should get it was sent it.
    pub fn publish<M: WireType>(&self, topic: PublishedTopic, message: &M) -> bool {
        self.publish_cdr(topic, to_cdr(message))
    }

    /// As [`publish`](Self::publish), for a message in little-endian CDR.
    pub fn publish_cdr(&self, topic: PublishedTopic, cdr: Vec<u8>) -> bool {
        self.publishers[topic.0].publish(cdr).is_ok()
    }

    /// The other nodes and all of their entities, by now. May wait for answers of the network, up to half a second.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware refuses to tell.
    pub fn around(&mut self) -> Result<Around, NodeError> {
        self.graph.around()
    }

    /// Lists the other entities in the graph, to explain why inputs are silent.
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
    /// How an input of the node is delivered.
    pub fn of(input: &InputName) -> Self {
        if input.frames.is_empty() { Delivery::Data } else { Delivery::Frames }
    }

    fn qos(self) -> QosProfile {
        match self {
            Delivery::Data => qos::input_default(),
            Delivery::Reliable => reliable_qos(1000, Durability::Volatile),
            Delivery::Latched => reliable_qos(1, Durability::TransientLocal),
            Delivery::Frames => qos::frames(),
        }
    }
}

async fn listen(
    subscriptions: &[Subscription],
    sender: &SyncSender<Incoming>,
    missed: &AtomicU64,
    stopped: oneshot::Receiver<()>,
) {
    let streams = subscriptions
        .iter()
        .enumerate()
        .map(|(idx, subscription)| subscription.arrivals().map(move |arrival| (SubscribedTopic(idx), arrival)));
    let mut arrivals = futures::stream::select_all(streams);
    let mut stopped = stopped;
    loop {
        tokio::select! {
            biased;
            _ = &mut stopped => return,
            Some((topic, arrival)) = arrivals.next() => {
                let incoming = match arrival {
                    Ok(Arrival { cdr, received, publisher }) => Incoming { topic, cdr: Ok(cdr), received, publisher },
                    Err(fault) => {
                        let received = crate::ros::wire::clock::system_now();
                        Incoming { topic, cdr: Err(fault.text), received, publisher: None }
                    }
                };
                if sender.try_send(incoming).is_err() {
                    missed.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
    }
}
