//! Names on Zenoh: keys of data and services, liveliness tokens, and the attachment of each message.

use std::time::Duration;

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Liveliness, Reliability};
use xxhash_rust::xxh3::xxh3_128;

/// The enclave of a node without security.
const ENCLAVE: &str = "/";

/// The kind of an entity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Publisher,
    Subscription,
    Server,
}

/// The keys of one node and of its entities.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct NodeKeys {
    domain_id: u16,
    session: String,
    node: String,
}

impl NodeKeys {
    /// The keys of a node in a session, by its namespace and name.
    pub(super) fn new(domain_id: u16, session: &str, namespace: &str, name: &str) -> Self {
        let node = format!("{}/{}/{}", mangled(ENCLAVE), mangled(namespace), mangled(name));
        NodeKeys { domain_id, session: session.to_owned(), node }
    }

    /// The liveliness token of the node, whose id is 0 because a session has one.
    pub(super) fn node(&self) -> String {
        format!("@ros2_lv/{}/{}/0/0/NN/{}", self.domain_id, self.session, self.node)
    }

    /// The liveliness token of an entity, by the absolute name of its topic or service.
    pub(super) fn entity(
        &self,
        id: u64,
        kind: Kind,
        name: &str,
        type_name: &str,
        hash: &str,
        qos: &QosProfile,
    ) -> String {
        let kind = match kind {
            Kind::Publisher => "MP",
            Kind::Subscription => "MS",
            Kind::Server => "SS",
        };
        let NodeKeys { domain_id, session, node } = self;
        let (name, ty, qos) = (mangled(name), dds_type(type_name), qos_text(qos));
        format!("@ros2_lv/{domain_id}/{session}/0/{id}/{kind}/{node}/{name}/{ty}/{hash}/{qos}")
    }

    /// The key of a topic's messages, or of a service's requests.
    pub(super) fn data(&self, name: &str, type_name: &str, hash: &str) -> String {
        format!("{}/{}/{}/{hash}", self.domain_id, name.trim_matches('/'), dds_type(type_name))
    }
}

/// The identifier of the entity with a liveliness token.
pub(super) fn gid(token: &str) -> [u8; 16] {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

/// The attachment of each message, request and response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Attachment {
    /// Sequence number of the sender, from 1.
    pub(super) sequence: i64,
    /// ns, by the sender's clock.
    pub(super) sent: i64,
    /// Gid of the sender; in a response, of the client.
    pub(super) gid: [u8; 16],
}

impl Attachment {
    /// 8 bytes, 8 bytes, the length of the gid, the gid.
    pub(super) fn to_bytes(self) -> Vec<u8> {
        let gid_len = [self.gid.len() as u8];
        [&self.sequence.to_le_bytes()[..], &self.sent.to_le_bytes(), &gid_len, &self.gid].concat()
    }

    /// Reads an attachment; `None` if the bytes are not one.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk()?;
        let (sent, rest) = rest.split_first_chunk()?;
        let (&gid_len, gid) = rest.split_first()?;
        let gid: [u8; 16] = gid.try_into().ok()?;
        let attachment = Attachment { sequence: i64::from_le_bytes(*sequence), sent: i64::from_le_bytes(*sent), gid };
        (usize::from(gid_len) == gid.len()).then_some(attachment)
    }
}

/// A name as one part of a key.
fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

/// A type as DDS names it: `std_msgs/msg/String` is `std_msgs::msg::dds_::String_`.
fn dds_type(type_name: &str) -> String {
    let (folder, name) = type_name.rsplit_once('/').unwrap_or(("", type_name));
    format!("{}::dds_::{name}_", folder.replace('/', "::"))
}

/// Policies by the numbers of rmw. A policy is left out if it is rmw_zenoh's default, except the depth.
fn qos_text(qos: &QosProfile) -> String {
    let reliability = match qos.reliability {
        Reliability::Reliable { .. } => "",
        Reliability::BestEffort => "2",
    };
    let durability = match qos.durability {
        Durability::Volatile => "",
        Durability::TransientLocal => "1",
    };
    let history = match qos.history {
        History::KeepLast { depth } => format!(",{depth}"),
        History::KeepAll => "2,0".to_owned(),
    };
    let liveliness = match qos.liveliness {
        Liveliness::Automatic => "",
        Liveliness::ManualByTopic => "3",
    };
    let span = |span: Option<Duration>| {
        span.map_or_else(|| ",".to_owned(), |span| format!("{},{}", span.as_secs(), span.subsec_nanos()))
    };
    let (deadline, lifespan, lease) = (span(qos.deadline), span(qos.lifespan), span(qos.liveliness_lease));
    format!("{reliability}:{durability}:{history}:{deadline}:{lifespan}:{liveliness},{lease}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::wire::qos::{reliable_qos, service_qos};

    /// From the examples of rmw_zenoh's design document.
    const SESSION: &str = "8b20917502ee955ac4476e0266340d5c";
    const STRING_HASH: &str = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";

    #[test]
    fn keys_are_those_of_the_design_document() {
        let keys = NodeKeys::new(0, SESSION, "/", "talker");
        assert_eq!(keys.node(), format!("@ros2_lv/0/{SESSION}/0/0/NN/%/%/talker"));
        let qos = reliable_qos(7, Durability::Volatile);
        assert_eq!(
            keys.entity(10, Kind::Publisher, "/chatter", "std_msgs/msg/String", STRING_HASH, &qos),
            format!(
                "@ros2_lv/0/{SESSION}/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{STRING_HASH}/::,7:,:,:,,"
            )
        );
        assert_eq!(
            keys.data("/robot1/chatter", "std_msgs/msg/String", STRING_HASH),
            format!("0/robot1/chatter/std_msgs::msg::dds_::String_/{STRING_HASH}")
        );
        let server = NodeKeys::new(2, SESSION, "/left/hand", "server").entity(
            3,
            Kind::Server,
            "/add_two_ints",
            "example_interfaces/srv/AddTwoInts",
            "RIHS01_0",
            &service_qos(),
        );
        assert_eq!(
            server,
            format!(
                "@ros2_lv/2/{SESSION}/0/3/SS/%/%left%hand/server/%add_two_ints/example_interfaces::srv::dds_::AddTwoInts_/RIHS01_0/::,10:,:,:,,"
            )
        );
    }

    #[test]
    fn policies_other_than_the_default_are_numbers() {
        let qos = QosProfile {
            history: History::KeepAll,
            lifespan: Some(Duration::new(10, 5)),
            durability: Durability::TransientLocal,
            ..QosProfile::subscription_default()
        };
        assert_eq!(qos_text(&qos), "2:1:2,0:,:10,5:,,");
    }

    #[test]
    fn an_attachment_is_33_bytes() {
        let attachment = Attachment { sequence: 1, sent: -2, gid: [7; 16] };
        let bytes = attachment.to_bytes();
        assert_eq!((bytes.len(), bytes[0], bytes[8], bytes[16]), (33, 1, 0xfe, 16));
        assert_eq!(Attachment::from_bytes(&bytes), Some(attachment));
        assert_eq!(Attachment::from_bytes(&bytes[..32]), None);
        assert_eq!(Attachment::from_bytes(&[]), None);
    }
}
