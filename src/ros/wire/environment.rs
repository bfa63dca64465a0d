//! The environment variables that every ROS 2 process reads.

use std::path::PathBuf;

use super::security::{Enclave, Security};

/// The environment variables that this node supports.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Environment {
    /// `ROS_DOMAIN_ID`.
    pub domain_id: u16,
    /// True if other hosts are out of reach: `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST` or `ROS_LOCALHOST_ONLY=1`.
    pub localhost_only: bool,
    /// The middleware, from `RMW_IMPLEMENTATION`.
    pub middleware: Middleware,
    /// DDS security, if `ROS_SECURITY_ENABLE=true` and this build has it.
    pub security: Option<Security>,
    /// `AMENT_PREFIX_PATH`: where installed packages keep their message definitions.
    pub prefixes: Vec<PathBuf>,
    /// Notes for the user, one line each.
    pub notes: Vec<String>,
}

/// The middleware that carries messages between nodes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Middleware {
    /// DDS, and which vendor's mapping of services.
    Dds(ServiceStyle),
    /// Zenoh, compatible with rmw_zenoh.
    #[cfg(feature = "zenoh")]
    Zenoh(ZenohVars),
}

/// The variables that only rmw_zenoh reads.
#[cfg(feature = "zenoh")]
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ZenohVars {
    /// `ZENOH_SESSION_CONFIG_URI`: a configuration file instead of rmw_zenoh's.
    pub config: Option<PathBuf>,
    /// `ZENOH_CONFIG_OVERRIDE`: `key=value;...` over that.
    pub overrides: String,
}

/// How requests and replies are matched on the wire. DDS vendors differ in this.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ServiceStyle {
    /// Fast DDS, the default of ROS 2, and Connext.
    Enhanced,
    /// Cyclone DDS.
    Cyclone,
}

/// A variable with a value that this node doesn't support.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{variable}={value}: {reason}")]
pub struct EnvironmentError {
    variable: &'static str,
    value: String,
    reason: &'static str,
}

/// The last domain with valid ports: RTPS 2.5, 9.6.2.3 has them at 7400 + 250 x domain.
const MAX_DOMAIN_ID: u16 = 232;

impl Environment {
    /// Reads the variables through `var`, which returns the value of a variable that is set. `--enclave` gives the
    /// process this enclave.
    ///
    /// # Errors
    /// [`EnvironmentError`] for a value that can't be read, or asks for something that this node doesn't have.
    pub fn from_vars(var: impl Fn(&str) -> Option<String>, enclave: &Enclave) -> Result<Self, EnvironmentError> {
        let set = |variable: &str| var(variable).filter(|value| !value.is_empty());
        let refuse = |variable, value: &str, reason| EnvironmentError { variable, value: value.to_owned(), reason };
        let domain_id = match set("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => match text.parse() {
                Ok(id @ 0..=MAX_DOMAIN_ID) => id,
                _ => return Err(refuse("ROS_DOMAIN_ID", &text, "expected a number from 0 to 232")),
            },
        };
        let mut notes = Vec::new();
        // rcl: ROS_LOCALHOST_ONLY, though deprecated, wins where it is 1.
        let localhost_by = if set("ROS_LOCALHOST_ONLY").as_deref() == Some("1") {
            Some(("ROS_LOCALHOST_ONLY", "1"))
        } else {
            match set("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref() {
                None | Some("SUBNET" | "SYSTEM_DEFAULT") => None,
                Some("LOCALHOST") => Some(("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")),
                Some(text @ "OFF") => {
                    let reason = "discovery can't be switched off here; use LOCALHOST, or a ROS_DOMAIN_ID of its own";
                    return Err(refuse("ROS_AUTOMATIC_DISCOVERY_RANGE", text, reason));
                }
                Some(text) => {
                    let reason = "expected SUBNET, LOCALHOST, OFF or SYSTEM_DEFAULT";
                    return Err(refuse("ROS_AUTOMATIC_DISCOVERY_RANGE", text, reason));
                }
            }
        };
        if let Some(peers) = set("ROS_STATIC_PEERS") {
            let reason = "peers can't be named one by one here; leave it out and reach them by multicast";
            return Err(refuse("ROS_STATIC_PEERS", &peers, reason));
        }
        let middleware = match set("RMW_IMPLEMENTATION").as_deref() {
            None | Some("rmw_fastrtps_cpp" | "rmw_fastrtps_dynamic_cpp" | "rmw_connextdds") => {
                Middleware::Dds(ServiceStyle::Enhanced)
            }
            Some("rmw_cyclonedds_cpp") => Middleware::Dds(ServiceStyle::Cyclone),
            #[cfg(feature = "zenoh")]
            Some("rmw_zenoh_cpp") => Middleware::Zenoh(ZenohVars {
                config: set("ZENOH_SESSION_CONFIG_URI").map(PathBuf::from),
                overrides: set("ZENOH_CONFIG_OVERRIDE").unwrap_or_default(),
            }),
            #[cfg(not(feature = "zenoh"))]
            Some(text @ "rmw_zenoh_cpp") => {
                let reason = "this build speaks DDS only; build it with --features zenoh, or use a DDS middleware";
                return Err(refuse("RMW_IMPLEMENTATION", text, reason));
            }
            Some(text) => {
                let reason = "expected rmw_fastrtps_cpp, rmw_cyclonedds_cpp, rmw_connextdds or rmw_zenoh_cpp";
                return Err(refuse("RMW_IMPLEMENTATION", text, reason));
            }
        };
        #[cfg(feature = "zenoh")]
        if let (Some((variable, value)), Middleware::Zenoh(_)) = (localhost_by, &middleware) {
            let reason = "with RMW_IMPLEMENTATION=rmw_zenoh_cpp: whom a Zenoh router reaches is in its configuration; \
                          unset it, and have the router listen on localhost alone";
            return Err(refuse(variable, value, reason));
        }
        let security = match set("ROS_SECURITY_ENABLE").as_deref() {
            Some("true") => Some(security(set, enclave)?),
            _ => None,
        };
        let security = match (security, no_security(&middleware)) {
            (Some(security), Some(reason)) if security.enforce => {
                return Err(EnvironmentError {
                    variable: "ROS_SECURITY_STRATEGY",
                    value: "Enforce".to_owned(),
                    reason,
                });
            }
            (Some(_), Some(reason)) => {
                notes.push(format!(
                    "ROS_SECURITY_ENABLE=true: {reason}; it talks in the clear, which Permissive allows"
                ));
                None
            }
            (security, _) => security,
        };
        let prefixes =
            set("AMENT_PREFIX_PATH").map(|paths| std::env::split_paths(&paths).collect()).unwrap_or_default();
        let localhost_only = localhost_by.is_some();
        Ok(Environment { domain_id, localhost_only, middleware, security, prefixes, notes })
    }
}

/// The requested security; rcl accepts a strategy by its exact name and takes any other as Permissive.
fn security(set: impl Fn(&str) -> Option<String>, enclave: &Enclave) -> Result<Security, EnvironmentError> {
    let variable = "ROS_SECURITY_ENCLAVE_OVERRIDE";
    let enclave = match set(variable) {
        None => enclave.clone(),
        Some(value) => {
            let reason = "expected the name of an enclave, such as /lab/glove";
            Enclave::parse(&value).map_err(|_| EnvironmentError { variable, value, reason })?
        }
    };
    Ok(Security {
        enforce: set("ROS_SECURITY_STRATEGY").as_deref() == Some("Enforce"),
        keystore: set("ROS_SECURITY_KEYSTORE").map(PathBuf::from),
        enclave,
    })
}

/// The reason why a process can't have security, if it can't.
fn no_security(middleware: &Middleware) -> Option<&'static str> {
    match middleware {
        #[cfg(feature = "zenoh")]
        Middleware::Zenoh(_) => {
            Some("SROS2's keys are for DDS, and this node is on Zenoh, which it speaks in the clear")
        }
        Middleware::Dds(_) if cfg!(not(feature = "security")) => {
            Some("this build has no DDS security; build it with --features security")
        }
        Middleware::Dds(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(vars: &[(&str, &str)]) -> Result<Environment, String> {
        let var = |wanted: &str| vars.iter().find(|(name, _)| *name == wanted).map(|(_, value)| (*value).to_owned());
        Environment::from_vars(var, &Enclave::default()).map_err(|error| error.to_string())
    }

    #[test]
    fn the_variables_of_ros_2_are_followed() {
        let default = read(&[]).unwrap();
        assert_eq!((default.domain_id, default.localhost_only), (0, false));
        assert_eq!(default.middleware, Middleware::Dds(ServiceStyle::Enhanced));
        assert_eq!(read(&[("ROS_DOMAIN_ID", "42")]).unwrap().domain_id, 42);
        assert_eq!(read(&[("ROS_DOMAIN_ID", "")]).unwrap().domain_id, 0);
        assert!(read(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")]).unwrap().localhost_only);
        assert!(!read(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")]).unwrap().localhost_only);
        assert!(
            read(&[("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")]).unwrap().localhost_only
        );
        let cyclone = read(&[("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")]).unwrap();
        assert_eq!(cyclone.middleware, Middleware::Dds(ServiceStyle::Cyclone));
        assert_eq!(
            read(&[("AMENT_PREFIX_PATH", "/a:/b")]).unwrap().prefixes,
            [PathBuf::from("/a"), PathBuf::from("/b")]
        );
    }

    #[test]
    fn what_can_not_be_followed_is_refused_with_what_to_do() {
        for (vars, begin) in [
            (&[("ROS_DOMAIN_ID", "233")][..], "ROS_DOMAIN_ID=233: expected a number from 0 to 232"),
            (&[("ROS_DOMAIN_ID", "-1")], "ROS_DOMAIN_ID=-1: expected"),
            (
                &[("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")],
                "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF: discovery can't be switched off",
            ),
            (&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "near")], "ROS_AUTOMATIC_DISCOVERY_RANGE=near: expected SUBNET"),
            (&[("ROS_STATIC_PEERS", "10.0.0.1")], "ROS_STATIC_PEERS=10.0.0.1: peers can't be named"),
            (&[("RMW_IMPLEMENTATION", "rmw_other_cpp")], "RMW_IMPLEMENTATION=rmw_other_cpp: expected rmw_fastrtps_cpp"),
            (
                &[("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_ENCLAVE_OVERRIDE", "glove")],
                "ROS_SECURITY_ENCLAVE_OVERRIDE=glove: expected the name of an enclave",
            ),
        ] {
            let error = read(vars).unwrap_err();
            assert!(error.starts_with(begin), "{error}");
        }
    }

    const ENFORCE: [(&str, &str); 2] = [("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_STRATEGY", "Enforce")];

    #[cfg(feature = "security")]
    #[test]
    fn security_is_asked_for_as_rcl_reads_it() {
        let enforced = read(&[&ENFORCE[..], &[("ROS_SECURITY_KEYSTORE", "/keys")]].concat()).unwrap();
        let security = Security { enforce: true, keystore: Some("/keys".into()), enclave: Enclave::default() };
        assert_eq!((enforced.security, enforced.notes), (Some(security), Vec::new()));
        let other = read(&[ENFORCE[0], ("ROS_SECURITY_STRATEGY", "enforce")]).unwrap().security;
        assert!(other.is_some_and(|security| !security.enforce && security.keystore.is_none()));
        assert_eq!(read(&[("ROS_SECURITY_ENABLE", "1"), ENFORCE[1]]).unwrap().security, None);
        let var = |name: &str| match name {
            "ROS_SECURITY_ENABLE" => Some("true".to_owned()),
            "ROS_SECURITY_ENCLAVE_OVERRIDE" => Some("/over".to_owned()),
            _ => None,
        };
        let overridden = Environment::from_vars(var, &Enclave::parse("/under").unwrap()).unwrap();
        assert_eq!(overridden.security.map(|security| security.enclave.to_string()).as_deref(), Some("/over"));
    }

    #[cfg(not(feature = "security"))]
    #[test]
    fn a_build_without_security_refuses_to_enforce_it_and_tells_what_is_permitted() {
        let refused = read(&ENFORCE).unwrap_err();
        let expected =
            "ROS_SECURITY_STRATEGY=Enforce: this build has no DDS security; build it with --features security";
        assert_eq!(refused, expected);
        let permissive = read(&[ENFORCE[0], ("ROS_SECURITY_STRATEGY", "Permissive")]).unwrap();
        assert_eq!((permissive.security, permissive.notes.len()), (None, 1));
    }

    #[cfg(feature = "zenoh")]
    #[test]
    fn on_zenoh_security_is_not_enforced_but_refused() {
        let zenoh = ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp");
        let refused = read(&[&ENFORCE[..], &[zenoh]].concat()).unwrap_err();
        assert!(refused.starts_with("ROS_SECURITY_STRATEGY=Enforce: SROS2's keys are for DDS"), "{refused}");
        assert_eq!(read(&[ENFORCE[0], zenoh]).unwrap().notes.len(), 1);
    }

    #[cfg(not(feature = "zenoh"))]
    #[test]
    fn zenoh_is_refused_by_a_build_without_it() {
        let error = read(&[("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")]).unwrap_err();
        assert!(error.contains("this build speaks DDS only; build it with --features zenoh"), "{error}");
    }

    #[cfg(feature = "zenoh")]
    #[test]
    fn on_zenoh_what_its_router_decides_is_refused() {
        let zenoh = ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp");
        assert_eq!(read(&[zenoh]).unwrap().middleware, Middleware::Zenoh(ZenohVars::default()));
        for localhost in [("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")] {
            let error = read(&[zenoh, localhost]).unwrap_err();
            assert!(error.starts_with(localhost.0) && error.contains("Zenoh router"), "{error}");
        }
    }
}
