//! Publishers. Transient local ones keep their last messages for late subscribers.

use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use ::zenoh::liveliness::LivelinessToken;
use ::zenoh::qos::{CongestionControl, Reliability};
use ::zenoh::{Result, Session, Wait};
use ros2_client::QosProfile;
use ros2_client::qos::{self, Durability, WhenFull};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt, CacheConfig, MissDetectionConfig};

use super::keys::Attachment;
use super::subscription::depth;
use super::{Entity, Publish};
use crate::ros::wire::clock::system_now;
use crate::ros::wire::middleware::Refused;

/// How often a transient local publisher announces its last sequence number, as in rmw_zenoh.
const HEARTBEAT: Duration = Duration::from_millis(500);

pub(super) struct Publisher {
    by: By,
    gid: [u8; 16],
    sequence: AtomicI64,
    _token: LivelinessToken,
}

enum By {
    Volatile(::zenoh::pubsub::Publisher<'static>),
    TransientLocal(AdvancedPublisher<'static>),
}

/// Declares the publisher of an entity in the graph.
pub(super) fn declare(session: &Session, entity: Entity, qos: &QosProfile) -> Result<Publisher> {
    let (reliability, congestion) = match qos.reliability {
        qos::Reliability::BestEffort => (Reliability::BestEffort, CongestionControl::Drop),
        qos::Reliability::Reliable { when_full: WhenFull::Fail } => (Reliability::Reliable, CongestionControl::Drop),
        qos::Reliability::Reliable { .. } => (Reliability::Reliable, CongestionControl::Block),
    };
    let publisher = session.declare_publisher(entity.key).congestion_control(congestion).reliability(reliability);
    let by = match qos.durability {
        Durability::Volatile => By::Volatile(publisher.wait()?),
        Durability::TransientLocal => {
            let kept = publisher.cache(CacheConfig::default().max_samples(depth(qos))).publisher_detection();
            By::TransientLocal(match reliability {
                Reliability::BestEffort => kept.wait()?,
                Reliability::Reliable => {
                    kept.sample_miss_detection(MissDetectionConfig::default().heartbeat(HEARTBEAT)).wait()?
                }
            })
        }
    };
    Ok(Publisher { by, gid: entity.gid, sequence: AtomicI64::new(1), _token: entity.token })
}

impl Publish for Publisher {
    fn publish(&self, cdr: Vec<u8>) -> std::result::Result<(), Refused> {
        let sequence = self.sequence.fetch_add(1, Ordering::Relaxed);
        let attachment = Attachment { sequence, sent: system_now().0, gid: self.gid }.to_bytes();
        let put = match &self.by {
            By::Volatile(publisher) => publisher.put(cdr).attachment(attachment).wait(),
            By::TransientLocal(publisher) => publisher.put(cdr).attachment(attachment).wait(),
        };
        put.map_err(|_| Refused)
    }

    fn has_subscribers(&self) -> bool {
        let status = match &self.by {
            By::Volatile(publisher) => publisher.matching_status().wait(),
            By::TransientLocal(publisher) => publisher.matching_status().wait(),
        };
        status.is_ok_and(|status| status.matching())
    }
}
