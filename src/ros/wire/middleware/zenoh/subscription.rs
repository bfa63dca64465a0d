//! Subscriptions: the last messages of a topic until they are read, and a count of the lost ones.

use std::any::Any;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};

use ::zenoh::liveliness::LivelinessToken;
use ::zenoh::sample::{Sample, SampleKind};
use ::zenoh::{Result, Session, Wait};
use futures::stream::{LocalBoxStream, StreamExt, unfold};
use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Reliability};
use tokio::sync::Notify;
use zenoh_ext::{AdvancedSubscriberBuilderExt, HistoryConfig, RecoveryConfig};

use super::Entity;
use super::keys::Attachment;
use crate::ros::wire::clock::system_now;
use crate::ros::wire::middleware::{Arrival, Fault, Subscribe};

/// Messages kept by an unlimited history: the largest depth that parameters may set.
const KEEP_ALL: usize = 100_000;

/// Maximum number of publishers whose messages are counted at a time.
const MAX_PUBLISHERS: usize = 64;

/// Messages that a history keeps.
pub(super) fn depth(qos: &QosProfile) -> usize {
    match qos.history {
        History::KeepLast { depth } => depth.max(1),
        History::KeepAll => KEEP_ALL,
    }
}

pub(super) struct Subscription {
    inbox: Arc<Inbox>,
    _subscriber: Box<dyn Any + Send>,
    _token: LivelinessToken,
}

/// Messages that were not read yet.
struct Inbox {
    depth: usize,
    waiting: Mutex<Waiting>,
    ready: Notify,
}

#[derive(Debug, Default)]
struct Waiting {
    arrivals: VecDeque<Arrival>,
    /// Messages that were not read in time, or that never arrived.
    lost: u64,
    /// The last message of each publisher, by its gid.
    last: BTreeMap<[u8; 16], i64>,
}

/// Declares the subscriber of an entity in the graph.
pub(super) fn declare(session: &Session, entity: Entity, qos: &QosProfile) -> Result<Subscription> {
    let inbox = Arc::new(Inbox { depth: depth(qos), waiting: Mutex::default(), ready: Notify::new() });
    let into = Arc::clone(&inbox);
    let subscriber = session.declare_subscriber(entity.key).callback(move |sample| into.handle_sample(&sample));
    let subscriber: Box<dyn Any + Send> = match qos.durability {
        Durability::Volatile => Box::new(subscriber.wait()?),
        Durability::TransientLocal => {
            let history = HistoryConfig::default().detect_late_publishers().max_samples(depth(qos));
            let late = subscriber.history(history).subscriber_detection();
            match qos.reliability {
                Reliability::BestEffort => Box::new(late.wait()?),
                Reliability::Reliable { .. } => Box::new(late.recovery(RecoveryConfig::default().heartbeat()).wait()?),
            }
        }
    };
    Ok(Subscription { inbox, _subscriber: subscriber, _token: entity.token })
}

impl Subscribe for Subscription {
    fn arrivals(&self) -> LocalBoxStream<'_, std::result::Result<Arrival, Fault>> {
        unfold(&*self.inbox, |inbox| async move { Some((inbox.next().await, inbox)) }).boxed_local()
    }
}

impl Inbox {
    fn handle_sample(&self, sample: &Sample) {
        if sample.kind() != SampleKind::Put {
            return;
        }
        let attachment = sample.attachment().and_then(|bytes| Attachment::from_bytes(&bytes.to_bytes()));
        let (cdr, received) = (sample.payload().to_bytes().into_owned(), system_now());
        let arrival = Arrival { cdr, received, publisher: None };
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).handle(arrival, attachment, self.depth);
        self.ready.notify_one();
    }

    async fn next(&self) -> std::result::Result<Arrival, Fault> {
        loop {
            let next = self.waiting.lock().unwrap_or_else(PoisonError::into_inner).poll();
            match next {
                Some(next) => return next,
                None => self.ready.notified().await,
            }
        }
    }
}

impl Waiting {
    fn handle(&mut self, arrival: Arrival, attachment: Option<Attachment>, depth: usize) {
        if let Some(Attachment { sequence, gid, .. }) = attachment {
            if self.last.len() >= MAX_PUBLISHERS && !self.last.contains_key(&gid) {
                self.last.clear();
            }
            let last = self.last.entry(gid).or_insert(sequence);
            let missing = sequence.saturating_sub(*last).saturating_sub(1);
            self.lost = self.lost.saturating_add(u64::try_from(missing).unwrap_or(0));
            *last = sequence.max(*last);
        }
        if self.arrivals.len() >= depth {
            self.arrivals.pop_front();
            self.lost = self.lost.saturating_add(1);
        }
        self.arrivals.push_back(arrival);
    }

    fn poll(&mut self) -> Option<std::result::Result<Arrival, Fault>> {
        if let n_messages @ 1.. = std::mem::take(&mut self.lost) {
            let text = "messages were lost on the way or not read in time".to_owned();
            return Some(Err(Fault { n_messages, reason: "lost", text }));
        }
        self.arrivals.pop_front().map(Ok)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Stamp;

    fn arrival(number: u8) -> Arrival {
        Arrival { cdr: vec![number], received: Stamp(0), publisher: None }
    }

    fn of(publisher: u8, sequence: i64) -> Option<Attachment> {
        Some(Attachment { sequence, sent: 0, gid: [publisher; 16] })
    }

    #[test]
    fn what_is_lost_is_counted_by_publisher() {
        let mut waiting = Waiting::default();
        for (publisher, sequence) in [(1, 5), (2, 1), (1, 6), (2, 4), (1, 7), (1, 3)] {
            waiting.handle(arrival(0), of(publisher, sequence), 10);
        }
        assert_eq!(waiting.poll().unwrap().unwrap_err().n_messages, 2, "2 and 3 of the second never came");
        assert_eq!(std::iter::from_fn(|| waiting.poll()).filter(|next| next.is_ok()).count(), 6);
    }

    #[test]
    fn the_oldest_goes_where_nobody_reads() {
        let mut waiting = Waiting::default();
        for number in 0..5 {
            waiting.handle(arrival(number), None, 2);
        }
        assert_eq!(waiting.poll().unwrap().unwrap_err().n_messages, 3);
        assert_eq!(waiting.poll().unwrap().unwrap().cdr, [3]);
        assert_eq!(waiting.poll().unwrap().unwrap().cdr, [4]);
        assert_eq!(waiting.poll(), None);
    }

    #[test]
    fn numbers_that_no_publisher_would_send_do_no_harm() {
        let mut waiting = Waiting::default();
        for (publisher, sequence) in (0..100).flat_map(|publisher| [(publisher, i64::MIN), (publisher, i64::MAX)]) {
            waiting.handle(arrival(0), of(publisher, sequence), 10);
        }
        assert!(waiting.last.len() <= MAX_PUBLISHERS && waiting.arrivals.len() == 10);
    }
}
