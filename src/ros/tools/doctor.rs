//! Examines a graph, the machine, and what a node with given parameters would find: `tpf doctor`.

mod clock;
mod network;
mod subject;
mod surroundings;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::Serialize;

use self::clock::ClockWatch;
use self::subject::Subject;
use super::listener::{Delivery, Listener, Listening, SubscribedTopic};
use super::monitored::Monitored;
use crate::config::{Config, NodeName, ParamTree};
use crate::leave;
use crate::msg::{ContactArray, WireType};
use crate::ros::node::DIAGNOSTICS_TYPE;
use crate::ros::wire::args::RosArgs;
use crate::ros::wire::clock::system_now;
use crate::ros::wire::environment::{Environment, Middleware, ServiceStyle};
use crate::ros::wire::error::NodeError;
use crate::ros::wire::middleware::TopicType;

pub use surroundings::Topic;

/// How long the graph is found before nodes of this package are listened to.
const DISCOVERY: Duration = Duration::from_millis(1500);

/// Least time to listen to inputs, so that a problem can last.
const LEAST: Duration = Duration::from_secs(3);

/// Longest wait for the next message.
const NAP: Duration = Duration::from_millis(50);

/// The environment variables that are told, and what follows from those that are not set.
const VARIABLES: [&str; 14] = [
    "RMW_IMPLEMENTATION",
    "ROS_DOMAIN_ID",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_SECURITY_ENABLE",
    "ROS_SECURITY_STRATEGY",
    "ROS_SECURITY_KEYSTORE",
    "ROS_SECURITY_ENCLAVE_OVERRIDE",
    "ZENOH_SESSION_CONFIG_URI",
    "ZENOH_CONFIG_OVERRIDE",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "CYCLONEDDS_URI",
];

/// Variables that other nodes follow and ours doesn't.
const NOT_FOLLOWED: [&str; 3] = ["FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "CYCLONEDDS_URI"];

/// How good a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// It was checked, and is as it should be.
    Ok,
    /// It may be wrong, or could not be checked.
    Warning,
    /// It is wrong.
    Problem,
}

/// The result of one check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The checked part, in a word.
    pub part: String,
    /// How good it is.
    pub level: Level,
    /// The result, its meaning, and, unless it is OK, what to do.
    pub text: String,
}

/// The results of all checks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Examination {
    /// In the order of the checks.
    pub findings: Vec<Finding>,
    /// Full names of the other nodes, sorted.
    pub nodes: Vec<String>,
    /// The topics of the other nodes, sorted.
    pub topics: Vec<Topic>,
}

/// The node, graph and machine to examine.
pub struct Request<'a> {
    /// The name under which the graph is joined.
    pub name: &'a NodeName,
    /// Arguments of ROS 2, with the remaps of the node that would run.
    pub args: &'a RosArgs,
    /// The settings from the environment.
    pub environment: &'a Environment,
    /// The value of an environment variable that is set.
    pub var: &'a dyn Fn(&str) -> Option<String>,
    /// The node that would run: its configuration and parameters, and a calibration file that replaces that of the
    /// parameters. Without it, only graph and machine are examined.
    pub node: Option<(Config, ParamTree, Option<PathBuf>)>,
    /// How long the graph is listened to; at least 3 s with a node.
    pub duration: Duration,
}

impl Finding {
    fn new(part: &str, level: Level, text: impl Into<String>) -> Self {
        Finding { part: part.to_owned(), level, text: text.into() }
    }
}

impl Examination {
    /// The worst of the findings.
    pub fn worst(&self) -> Level {
        self.findings.iter().map(|finding| finding.level).max().unwrap_or(Level::Ok)
    }

    /// Number of findings of a level.
    pub fn count(&self, level: Level) -> usize {
        self.findings.iter().filter(|finding| finding.level == level).count()
    }
}

/// Examines graph, machine and parameters; takes somewhat longer than the requested duration.
///
/// # Errors
/// [`NodeError`] when the graph can't be joined.
pub fn examine(request: Request<'_>) -> Result<Examination, NodeError> {
    let Request { name, args, environment, var, node, duration } = request;
    let mut findings = of_environment(environment, var);
    findings.extend(match &environment.middleware {
        Middleware::Dds(_) => network::examine(environment.localhost_only),
        #[cfg(feature = "zenoh")]
        Middleware::Zenoh(_) => Vec::new(), // it reaches others through its router; the note below says if it doesn't
    });
    let mut clock = ClockWatch::start();
    let mut listening = Listening::join(name, environment, &[])?;
    findings.push(match (listening.note(), &environment.middleware) {
        (None, _) => Finding::new("graph", Level::Ok, format!("joined domain {}", environment.domain_id)),
        (Some(note), Middleware::Dds(_)) => Finding::new("graph", Level::Warning, note), // of security that is permitted
        #[cfg(feature = "zenoh")]
        (Some(note), Middleware::Zenoh(_)) => Finding::new("graph", Level::Problem, note), // nobody is reached
    });
    let mut subject = None;
    if let Some((cfg, tree, calibration)) = node {
        match Subject::new(cfg, &tree, calibration.as_deref(), args, environment, &mut findings) {
            Ok(found) => {
                found.listen(&mut listening)?;
                subject = Some(found);
            }
            Err(error) => findings.push(Finding::new("parameters", Level::Problem, error.to_string())),
        }
    }
    // Which nodes of this package there are is known only after a while.
    let began = Instant::now();
    let mut first = listening.around()?;
    while began.elapsed() < DISCOVERY && !leave::asked() {
        std::thread::sleep(NAP);
        first = listening.around()?;
    }
    let mut own: Vec<&str> = first.fusion_nodes();
    own.dedup();
    let mut monitored = Vec::new();
    for node in own {
        let contacts = format!("{node}/contacts");
        let topic = listening.subscribe(&contacts, TopicType::Known(ContactArray::TYPE_NAME), Delivery::Data)?;
        monitored.push((topic, node.to_owned(), Monitored::new(&contacts, node.to_owned())));
    }
    let diagnostics = listening.subscribe("/diagnostics", TopicType::Known(DIAGNOSTICS_TYPE), Delivery::Data)?;
    let duration = if subject.is_some() { duration.max(LEAST) } else { duration };
    let mut listener = listen(listening.start()?, subject.as_mut(), duration, &mut clock, |topic, cdr| {
        for (contacts, _, node) in &mut monitored {
            if topic == *contacts {
                node.handle_contacts(cdr, system_now());
            } else if topic == diagnostics {
                node.handle_diagnostics(cdr, system_now());
            }
        }
    });
    let around = listener.around();
    listener.leave();
    let around = around?;
    findings.extend(clock.findings(Path::new("/")));
    findings.extend(surroundings::examine(&around, environment.domain_id));
    findings.extend(monitored.iter().flat_map(|(_, name, node)| surroundings::of_node(name, node)));
    if let Some(subject) = &mut subject {
        findings.extend(subject.findings(&around));
    }
    Ok(Examination { findings, topics: surroundings::topics(&around), nodes: around.nodes })
}

/// Listens for a while; gives every message to the subject, and to `on_heard`.
fn listen(
    listener: Listener,
    mut subject: Option<&mut Subject>,
    duration: Duration,
    clock: &mut ClockWatch,
    mut on_incoming: impl FnMut(SubscribedTopic, &[u8]),
) -> Listener {
    let began = Instant::now();
    while began.elapsed() < duration && !leave::asked() {
        clock.look();
        if let Some(subject) = &mut subject {
            subject.judge(&listener);
        }
        let mut next = listener.next(NAP);
        while let Some(incoming) = next {
            if let Some(subject) = &mut subject {
                subject.handle(&incoming);
            }
            if let Ok(cdr) = &incoming.cdr {
                on_incoming(incoming.topic, cdr);
            }
            next = listener.poll();
        }
    }
    listener
}

/// The middleware, domain and range, and the variables that are set.
fn of_environment(environment: &Environment, var: &dyn Fn(&str) -> Option<String>) -> Vec<Finding> {
    let middleware = match &environment.middleware {
        Middleware::Dds(ServiceStyle::Enhanced) => "DDS, with the services of Fast DDS",
        Middleware::Dds(ServiceStyle::Cyclone) => "DDS, with the services of Cyclone DDS",
        #[cfg(feature = "zenoh")]
        Middleware::Zenoh(_) => "Zenoh, as rmw_zenoh_cpp",
    };
    let range = if environment.localhost_only { "this host alone" } else { "this host and others" };
    let secured = match &environment.security {
        Some(security) if security.enforce => ", with security enforced",
        Some(_) => ", with security where there are keys",
        None => "",
    };
    let set = |name: &&str| var(name).filter(|value| !value.is_empty());
    let named = VARIABLES.iter().filter_map(|name| Some(format!("{name}={}", set(name)?))).collect::<Vec<_>>();
    let named = if named.is_empty() { "none of the ROS variables is set".to_owned() } else { named.join(" ") };
    let mut findings = vec![Finding::new(
        "environment",
        Level::Ok,
        format!("domain {}, {middleware}, reaches {range}{secured} ({named})", environment.domain_id),
    )];
    let ignored = NOT_FOLLOWED.iter().filter(|name| set(name).is_some());
    findings.extend(ignored.map(|name| {
        let text = format!(
            "{name} is set: other nodes follow it and this package doesn't, so they may use other addresses or transports; unset it if nodes don't find each other"
        );
        Finding::new("environment", Level::Warning, text)
    }));
    findings.extend(environment.notes.iter().map(|note| Finding::new("environment", Level::Warning, note.clone())));
    findings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::wire::security::Enclave;

    #[test]
    fn the_environment_is_told_with_what_is_not_followed() {
        let var = |name: &str| match name {
            "ROS_DOMAIN_ID" => Some("7".to_owned()),
            "ROS_LOCALHOST_ONLY" => Some("1".to_owned()),
            "CYCLONEDDS_URI" => Some("file:///c.xml".to_owned()),
            _ => None,
        };
        let environment = Environment::from_vars(var, &Enclave::default()).unwrap();
        let found = of_environment(&environment, &var);
        assert_eq!(
            found[0].text,
            "domain 7, DDS, with the services of Fast DDS, reaches this host alone (ROS_DOMAIN_ID=7 ROS_LOCALHOST_ONLY=1 CYCLONEDDS_URI=file:///c.xml)"
        );
        assert_eq!((found.len(), found[1].level), (2, Level::Warning));
        assert!(found[1].text.starts_with("CYCLONEDDS_URI is set"));
    }
}
