//! The configuration of a session: rmw_zenoh's default or a file, plus overrides.

use ::zenoh::{Config, Result};

use crate::ros::wire::environment::ZenohVars;

/// rmw_zenoh's session settings: a peer that finds others through the router of its own host.
///
/// # Source
/// DEFAULT_RMW_ZENOH_SESSION_CONFIG.json5.
const AS_RMW_ZENOH: &str = r#"{
    mode: "peer",
    connect: {
        timeout_ms: { router: -1, peer: -1, client: 0 },
        endpoints: ["tcp/localhost:7447"],
        exit_on_failure: { router: false, peer: false, client: true },
    },
    listen: { endpoints: ["tcp/localhost:0"] },
    scouting: {
        multicast: { enabled: false },
        gossip: {
            enabled: true,
            target: { router: ["router", "peer"], peer: ["router"] },
            autoconnect: { router: [], peer: ["router", "peer"] },
            autoconnect_strategy: { peer: { to_router: "always", to_peer: "greater-zid" } },
        },
    },
    timestamping: { enabled: { router: true, peer: true, client: true } },
    queries_default_timeout: 600000,
}"#;

/// The configuration from the environment.
///
/// # Errors
/// A file or an override that can't be read, by the name of its variable.
pub(super) fn of(vars: &ZenohVars) -> Result<Config> {
    let mut config = match &vars.config {
        Some(path) => {
            Config::from_file(path).map_err(|error| format!("ZENOH_SESSION_CONFIG_URI={}: {error}", path.display()))?
        }
        None => Config::from_json5(AS_RMW_ZENOH)?,
    };
    for entry in vars.overrides.split(';').map(str::trim).filter(|entry| !entry.is_empty()) {
        let refused = |why: &dyn std::fmt::Display| format!("ZENOH_CONFIG_OVERRIDE: {entry:?}: {why}");
        let (key, value) = entry.split_once('=').ok_or_else(|| refused(&"expected key=value"))?;
        config.insert_json5(key.trim(), value.trim()).map_err(|error| refused(&error))?;
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn overridden(overrides: &str) -> Result<Config> {
        of(&ZenohVars { config: None, overrides: overrides.to_owned() })
    }

    #[test]
    fn what_is_set_over_the_configuration_counts() {
        let endpoints = |config: Config| config.get_json("connect/endpoints").unwrap();
        assert_eq!(endpoints(overridden("").unwrap()), r#"["tcp/localhost:7447"]"#);
        let config = overridden(r#"mode="client"; connect/endpoints=["tcp/10.0.0.1:7447"];"#).unwrap();
        assert_eq!(config.get_json("mode").unwrap(), r#""client""#);
        assert_eq!(endpoints(config), r#"["tcp/10.0.0.1:7447"]"#);
    }

    #[test]
    fn what_can_not_be_read_is_refused_by_name() {
        for overrides in ["mode", "mode=\"nobody\"", "mood=1"] {
            let error = overridden(overrides).unwrap_err().to_string();
            assert!(error.starts_with("ZENOH_CONFIG_OVERRIDE: \"mo"), "{error}");
        }
        let missing = ZenohVars { config: Some("/nowhere.json5".into()), overrides: String::new() };
        assert!(of(&missing).unwrap_err().to_string().starts_with("ZENOH_SESSION_CONFIG_URI=/nowhere.json5: "));
    }
}
