//! DDS security as SROS2 configures it: which enclave's keys a participant joins with, by the rules of rcl and
//! rmw_dds_common.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::config::{NameError, NodeName};

/// The files of an enclave, by their names in rmw_dds_common.
const FILES: [&str; 6] =
    ["identity_ca.cert.pem", "cert.pem", "key.pem", "permissions_ca.cert.pem", GOVERNANCE, "permissions.p7s"];

/// The governance document of the domain.
const GOVERNANCE: &str = "governance.p7s";

/// Revoked certificates; optional in an enclave.
const REVOCATIONS: &str = "crl.pem";

/// Kinds of protection for which a payload's length matters: RustDDS 0.15 takes the padding that other vendors put
/// after it as part of it.
const PROTECTED_PAYLOADS: [&str; 2] = ["<data_protection_kind>ENCRYPT", "<data_protection_kind>SIGN"];

/// The requested DDS security.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Security {
    /// `ROS_SECURITY_STRATEGY=Enforce`: don't join without security.
    pub enforce: bool,
    /// `ROS_SECURITY_KEYSTORE`: the keystore that `ros2 security create_keystore` made.
    pub keystore: Option<PathBuf>,
    /// The enclave whose keys to use.
    pub enclave: Enclave,
}

/// The name of the enclave with a process's keys, such as `/lab/glove`; `/` if none is given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Enclave(String);

/// An enclave found in the keystore, complete with all its files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    /// The folder of the files.
    pub folder: PathBuf,
    /// Notes for the user.
    pub note: Option<String>,
}

/// The reason why there are no keys to join with. Each text says what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum SecurityError {
    #[error(
        "ROS_SECURITY_KEYSTORE is not set; set it to the folder that `ros2 security create_keystore` or \
         tests/ros/keystore made"
    )]
    NoKeystore,
    #[error(
        "enclave {enclave}: {} is not there; make it by `ros2 security create_enclave`, or name another by \
         --ros-args --enclave or ROS_SECURITY_ENCLAVE_OVERRIDE", folder.display()
    )]
    NoEnclave { enclave: Enclave, folder: PathBuf },
    #[error(
        "enclave {enclave}: {} lacks {}; make them by `ros2 security create_enclave`, or name another enclave by \
         --ros-args --enclave or ROS_SECURITY_ENCLAVE_OVERRIDE", folder.display(), files.join(", ")
    )]
    Incomplete { enclave: Enclave, folder: PathBuf, files: Vec<&'static str> },
    #[error(
        "enclave {enclave}: {}: this build can't refuse revoked certificates; make a new CA and keystore without them, \
         and take this file out", file.display()
    )]
    Revocations { enclave: Enclave, file: PathBuf },
}

impl Enclave {
    /// The enclave of an absolute name.
    ///
    /// # Errors
    /// [`NameError`] when it isn't absolute, or a part is not a valid ROS 2 name: it would lead out of the keystore.
    pub fn parse(name: &str) -> Result<Self, NameError> {
        if name != "/" {
            NodeName::parse(name)?; // rcl: the same rules
        }
        Ok(Enclave(name.to_owned()))
    }
}

impl Default for Enclave {
    fn default() -> Self {
        Enclave("/".to_owned())
    }
}

impl fmt::Display for Enclave {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Security {
    /// The keys to join with.
    ///
    /// # Errors
    /// [`SecurityError`] when the enclave is missing or incomplete; also when it revokes certificates and security is
    /// enforced.
    pub fn keys(&self) -> Result<Keys, SecurityError> {
        let keystore = self.keystore.as_deref().ok_or(SecurityError::NoKeystore)?;
        let enclave = self.enclave.clone();
        let folder = folder(keystore, &enclave);
        if !folder.is_dir() {
            return Err(SecurityError::NoEnclave { enclave, folder });
        }
        let files: Vec<_> = FILES.into_iter().filter(|name| !folder.join(name).is_file()).collect();
        if !files.is_empty() {
            return Err(SecurityError::Incomplete { enclave, folder, files });
        }
        let mut notes = Vec::new();
        let governance = std::fs::read(folder.join(GOVERNANCE)).unwrap_or_default();
        let governance = String::from_utf8_lossy(&governance); // it is signed in the clear
        if PROTECTED_PAYLOADS.iter().any(|kind| governance.contains(kind)) {
            notes.push(format!(
                "enclave {enclave}: {}: data_protection_kind is not NONE: what other vendors' peers send can't be read \
                 where its length is no multiple of four, requests of services among it; SECURITY.md says how NONE keeps \
                 it as secret",
                folder.join(GOVERNANCE).display()
            ));
        }
        let file = folder.join(REVOCATIONS);
        match file.exists().then_some(SecurityError::Revocations { enclave, file }) {
            Some(revocations) if self.enforce => return Err(revocations),
            revocations => notes.extend(revocations.map(|revocations| revocations.to_string())),
        }
        Ok(Keys { folder, note: (!notes.is_empty()).then(|| notes.join("; ")) })
    }
}

/// The folder where rcl looks for an enclave.
fn folder(keystore: &Path, enclave: &Enclave) -> PathBuf {
    let enclaves = keystore.join("enclaves");
    match enclave.0.trim_start_matches('/') {
        "" => enclaves,
        relative => enclaves.join(relative),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A keystore whose enclave `/lab/glove` has these files.
    fn keystore(files: &[&str]) -> tempfile::TempDir {
        let keystore = tempfile::tempdir().unwrap();
        let enclave = keystore.path().join("enclaves/lab/glove");
        std::fs::create_dir_all(&enclave).unwrap();
        files.iter().for_each(|name| std::fs::write(enclave.join(name), "").unwrap());
        keystore
    }

    fn keys(keystore: Option<&Path>, enclave: &str, enforce: bool) -> Result<Keys, SecurityError> {
        let keystore = keystore.map(Path::to_owned);
        Security { enforce, keystore, enclave: Enclave::parse(enclave).unwrap() }.keys()
    }

    #[test]
    fn an_enclave_is_found_where_rcl_looks_for_it() {
        let whole = keystore(&FILES);
        let keys = keys(Some(whole.path()), "/lab/glove", true).unwrap();
        assert_eq!((keys.folder, keys.note), (whole.path().join("enclaves/lab/glove"), None));
        assert_eq!(folder(Path::new("/k"), &Enclave::default()), Path::new("/k/enclaves"));
    }

    #[test]
    fn what_is_missing_is_named_with_its_folder_and_what_to_do() {
        let text = |result: Result<Keys, SecurityError>| result.unwrap_err().to_string();
        assert!(text(keys(None, "/", true)).starts_with("ROS_SECURITY_KEYSTORE is not set; set it to"));
        let half = keystore(&FILES[..4]);
        let shown = half.path().display();
        assert!(
            text(keys(Some(half.path()), "/other", true))
                .starts_with(&format!("enclave /other: {shown}/enclaves/other is not there; make it by"))
        );
        assert!(text(keys(Some(half.path()), "/lab/glove", false)).starts_with(&format!(
            "enclave /lab/glove: {shown}/enclaves/lab/glove lacks governance.p7s, permissions.p7s; make them by"
        )));
    }

    #[test]
    fn payloads_that_other_vendors_pad_are_told_of() {
        let whole = keystore(&FILES);
        let governance = whole.path().join("enclaves/lab/glove").join(GOVERNANCE);
        for (kind, noted) in [("NONE", false), ("ENCRYPT", true), ("SIGN", true)] {
            std::fs::write(&governance, format!("<data_protection_kind>{kind}</data_protection_kind>")).unwrap();
            let note = keys(Some(whole.path()), "/lab/glove", true).unwrap().note;
            assert_eq!(note.is_some_and(|note| note.contains("data_protection_kind is not NONE")), noted, "{kind}");
        }
    }

    #[test]
    fn revocations_are_refused_where_security_is_enforced_and_told_elsewhere() {
        let revoking = keystore(&[&FILES[..], &[REVOCATIONS]].concat());
        let refused = keys(Some(revoking.path()), "/lab/glove", true).unwrap_err().to_string();
        assert!(refused.contains("crl.pem: this build can't refuse revoked certificates"), "{refused}");
        assert_eq!(keys(Some(revoking.path()), "/lab/glove", false).unwrap().note, Some(refused));
    }

    #[test]
    fn an_enclave_never_leads_out_of_the_keystore() {
        for name in ["", "glove", "/glove/", "//glove", "/../private", "/a b"] {
            assert!(Enclave::parse(name).is_err(), "{name:?}");
        }
    }
}
