//! Names on Zenoh: keys of data and services, liveliness tokens, and the attachment of each message.

use std::time::Duration;

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Liveliness, Reliability, WhenFull};
use xxhash_rust::xxh3::xxh3_128;

/// The enclave of a node without security.
const ENCLAVE: &str = "/";

/// The kind of an entity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Publisher,
    Subscription,
    Server,
    Client,
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
            Kind::Client => "SC",
        };
        let NodeKeys { domain_id, session, node } = self;
        let (name, ty, qos) = (mangled(name), dds_type(type_name), qos_text(qos));
        format!("@ros2_lv/{domain_id}/{session}/0/{id}/{kind}/{node}/{name}/{ty}/{hash}/{qos}")
    }

    /// The key expression of all tokens of this domain.
    pub(super) fn all(&self) -> String {
        format!("@ros2_lv/{}/**", self.domain_id)
    }

    /// The key expression of the tokens of a service's servers.
    pub(super) fn servers(&self, service: &str) -> String {
        format!("@ros2_lv/{}/*/*/*/SS/*/*/*/{}/**", self.domain_id, mangled(service))
    }

    /// The key of a topic's messages, or of a service's requests.
    pub(super) fn data(&self, name: &str, type_name: &str, hash: &str) -> String {
        format!("{}/{}/{}/{hash}", self.domain_id, name.trim_matches('/'), dds_type(type_name))
    }
}

/// What a liveliness token tells.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Token {
    pub(super) session: String,
    /// NN for a node, MP, MS, SS or SC for its entities.
    pub(super) kind: String,
    /// Full name of the node.
    pub(super) node: String,
    /// Absolute name of the topic or service; empty for a node, as all below.
    pub(super) name: String,
    pub(super) type_name: String,
    pub(super) hash: String,
    pub(super) qos: QosProfile,
}

impl Token {
    /// Reads a token; `None` if the text is not one.
    pub(super) fn parse(token: &str) -> Option<Self> {
        let mut parts = token.strip_prefix("@ros2_lv/")?.split('/');
        let session = parts.nth(1)?.to_owned();
        let kind = parts.nth(2)?.to_owned();
        let (namespace, node) = (named(parts.nth(1)?), parts.next()?);
        let mut rest = || parts.next().unwrap_or_default();
        let (name, type_name, hash, qos) = (named(rest()), ros_type(rest()), rest().to_owned(), qos_of(rest()));
        let node = format!("{}/{node}", namespace.trim_end_matches('/'));
        Some(Token { session, kind, node, name, type_name, hash, qos })
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

/// The name in a part of a key.
fn named(part: &str) -> String {
    part.replace('%', "/")
}

/// A type by its name in DDS.
fn ros_type(dds: &str) -> String {
    let parts: Vec<&str> = dds.split("::").filter(|part| *part != "dds_").collect();
    parts.join("/").trim_end_matches('_').to_owned()
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

/// The policies in a token. What it leaves out is rmw_zenoh's default.
fn qos_of(text: &str) -> QosProfile {
    let mut parts = text.split(':');
    let mut next = || parts.next().unwrap_or_default();
    let (reliability, durability, history) = (next(), next(), next());
    let span = |text: &str| {
        let (seconds, nanos) = text.split_once(',')?;
        Some(Duration::new(seconds.parse().ok()?, nanos.parse().ok()?))
    };
    let (deadline, lifespan) = (span(next()), span(next()));
    let (liveliness, lease) = next().split_once(',').unwrap_or_default();
    let depth = history.split_once(',').and_then(|(_, depth)| depth.parse().ok()).unwrap_or(42);
    QosProfile {
        reliability: match reliability {
            "2" => Reliability::BestEffort,
            _ => Reliability::Reliable { when_full: WhenFull::Fail },
        },
        durability: if durability == "1" { Durability::TransientLocal } else { Durability::Volatile },
        history: if history.starts_with('2') { History::KeepAll } else { History::KeepLast { depth } },
        deadline,
        lifespan,
        liveliness: if liveliness == "3" { Liveliness::ManualByTopic } else { Liveliness::Automatic },
        liveliness_lease: span(lease),
    }
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
    fn a_token_is_read_as_it_was_written() {
        let keys = NodeKeys::new(3, SESSION, "/left/hand", "talker");
        let node = Token::parse(&keys.node()).unwrap();
        assert_eq!(
            (node.kind.as_str(), node.node.as_str(), node.session.as_str()),
            ("NN", "/left/hand/talker", SESSION)
        );
        let qos = QosProfile {
            lifespan: Some(Duration::new(10, 5)),
            durability: Durability::TransientLocal,
            ..QosProfile::subscription_default()
        };
        for qos in [qos, reliable_qos(7, Durability::Volatile)] {
            let token = keys.entity(4, Kind::Publisher, "/a/chatter", "std_msgs/msg/String", STRING_HASH, &qos);
            let found = Token::parse(&token).unwrap();
            assert_eq!((found.kind.as_str(), found.name.as_str()), ("MP", "/a/chatter"));
            assert_eq!((found.type_name.as_str(), found.hash.as_str()), ("std_msgs/msg/String", STRING_HASH));
            assert_eq!(found.qos, qos);
        }
        assert_eq!(Token::parse("@ros2_lv/0/x"), None);
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
