//! The profiles of the AWS tools, which object_store doesn't read: `~/.aws/credentials` and `~/.aws/config`.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use super::refusal;

/// The settings of a profile, by key: those of the credentials file count before those of the config file.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Profile(BTreeMap<String, String>);

/// Keys of a profile that lead to credentials only by the tools of AWS.
const BY_TOOLS: [&str; 4] = ["sso_session", "sso_start_url", "credential_process", "role_arn"];

impl Profile {
    /// The profile that `AWS_PROFILE` names, or `default`. Empty where there is none and none is asked for.
    ///
    /// # Errors
    /// One line where the profile that is asked for isn't there, a file can't be read, or only the tools of AWS can make
    /// credentials of it.
    pub(super) fn of_environment() -> io::Result<Self> {
        let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
        let home = set("HOME").map(PathBuf::from).unwrap_or_default();
        let file = |name: &str, usual: &str| set(name).map_or_else(|| home.join(usual), PathBuf::from);
        let credentials = file("AWS_SHARED_CREDENTIALS_FILE", ".aws/credentials");
        let config = file("AWS_CONFIG_FILE", ".aws/config");
        let asked = set("AWS_PROFILE").or_else(|| set("AWS_DEFAULT_PROFILE"));
        let name = asked.as_ref().map_or_else(|| "default".to_owned(), |name| name.to_string_lossy().into_owned());
        let mut keys = BTreeMap::new();
        let mut is_there = false;
        // What stands in the credentials file counts, so it comes last.
        for (path, sections) in
            [(&config, [format!("profile {name}"), name.clone()]), (&credentials, [name.clone(), name.clone()])]
        {
            let text = text(path)?;
            let sections: &[String] = if path == &config && name != "default" { &sections[..1] } else { &sections };
            if let Some(found) = sections.iter().find_map(|section| of_section(&text, section)) {
                is_there = true;
                keys.extend(found);
            }
        }
        if !is_there && asked.is_some() {
            let what = format!(
                "the profile {name:?} (AWS_PROFILE) is in neither {} nor {}",
                credentials.display(),
                config.display()
            );
            return Err(refusal(io::ErrorKind::InvalidInput, what));
        }
        let profile = Profile(keys);
        let of_container = ["AWS_CONTAINER_CREDENTIALS_RELATIVE_URI", "AWS_CONTAINER_CREDENTIALS_FULL_URI"];
        if profile.keys().is_none()
            && of_container.iter().all(|name| set(name).is_none())
            && let Some(key) = BY_TOOLS.iter().find(|key| profile.get(key).is_some())
        {
            let what = format!(
                "the profile {name:?} has {key} and no keys: run `eval \"$(aws configure export-credentials --profile {name} --format env)\"` first"
            );
            return Err(refusal(io::ErrorKind::InvalidInput, what));
        }
        Ok(profile)
    }

    /// The access key and its secret.
    pub(super) fn keys(&self) -> Option<(&str, &str)> {
        self.get("aws_access_key_id").zip(self.get("aws_secret_access_key"))
    }

    /// The value of a key.
    pub(super) fn get(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }
}

fn text(path: &Path) -> io::Result<String> {
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(text),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(String::new()),
        Err(error) => Err(refusal(error.kind(), format!("{}: {error}", path.display()))),
    }
}

/// The settings in a section of an INI file; nested ones, which are indented, are passed over.
fn of_section(text: &str, section: &str) -> Option<BTreeMap<String, String>> {
    let mut keys = None::<BTreeMap<String, String>>;
    let mut is_inside = false;
    for line in text.lines() {
        let trimmed = line.trim();
        if let Some(name) = trimmed.strip_prefix('[').and_then(|rest| rest.split_once(']')).map(|(name, _)| name) {
            is_inside = name.split_whitespace().eq(section.split_whitespace());
            if is_inside {
                keys.get_or_insert_default();
            }
            continue;
        }
        let is_comment = trimmed.starts_with(['#', ';']);
        if !is_inside || is_comment || line.starts_with([' ', '\t']) {
            continue;
        }
        if let (Some(keys), Some((key, value))) = (&mut keys, trimmed.split_once('=')) {
            keys.insert(key.trim().to_ascii_lowercase(), value.trim().to_owned());
        }
    }
    keys
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_is_read_as_the_tools_of_aws_read_it() {
        let text = "[default]\naws_access_key_id=A\n\n# [glove]\n[profile  glove]\nregion = eu-central-1\ns3 =\n  addressing_style = path\n; x = y\nAWS_Secret_Access_Key = a=b\n[other]\nregion=us-east-1\n";
        let keys = of_section(text, "profile glove").unwrap();
        assert_eq!(keys.get("region").map(String::as_str), Some("eu-central-1"));
        assert_eq!(keys.get("aws_secret_access_key").map(String::as_str), Some("a=b"));
        assert!(!keys.contains_key("addressing_style") && !keys.contains_key("aws_access_key_id"));
        assert_eq!(of_section(text, "glove"), None);
        assert_eq!(of_section(text, "default").unwrap().len(), 1);
    }
}
