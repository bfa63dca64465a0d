//! Errors of a store on one line: what was asked, what came, what to do.

use std::error::Error;
use std::io;

use object_store::Error as StoreError;

use super::refusal;
use super::uri::{Scheme, Uri};

/// The kind of request to a store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Asked {
    Read,
    List,
    Write,
}

/// The longest word of a store that is passed on.
const SHOWN: usize = 160;

/// A store's error for a person. Nothing of the request is in it but the URI that was given: no header, no query, no credential.
pub(super) fn told(uri: &Uri, asked: Asked, error: &StoreError) -> io::Error {
    let came = came(error);
    let has = |text: &str| came.contains(text);
    let place = format!("the {} {:?}", uri.scheme.bucket(), uri.bucket);
    let (kind, what) = match error {
        _ if has("NoSuchBucket") || has("ContainerNotFound") || has("The specified bucket does not exist") => (
            io::ErrorKind::InvalidInput, // `NotFound` is said of an object alone
            format!("there is no {} {:?}: correct its name, or make it", uri.scheme.bucket(), uri.bucket),
        ),
        StoreError::NotFound { .. } if asked == Asked::Write => {
            (io::ErrorKind::Other, format!("{came}: is {place} there?"))
        }
        StoreError::NotFound { .. } => (io::ErrorKind::NotFound, "not found".to_owned()),
        StoreError::PermissionDenied { .. } | StoreError::Unauthenticated { .. } => {
            let right = match asked {
                Asked::Read => "read",
                Asked::List => "list",
                Asked::Write => "write to",
            };
            let what = format!("{came}: these credentials may not {right} {place}: {}", credentials(uri.scheme));
            (io::ErrorKind::PermissionDenied, what)
        }
        StoreError::Precondition { .. } | StoreError::NotModified { .. } if asked != Asked::Write => {
            (io::ErrorKind::InvalidData, CHANGED.to_owned())
        }
        StoreError::AlreadyExists { .. } | StoreError::Precondition { .. } => {
            (io::ErrorKind::AlreadyExists, "is there already".to_owned())
        }
        _ if no_credentials(error) => {
            let what = format!("no credentials were found for {place}: {}", credentials(uri.scheme));
            (io::ErrorKind::PermissionDenied, what)
        }
        _ if has("Received redirect without LOCATION")
            || has("PermanentRedirect")
            || has("AuthorizationHeaderMalformed") =>
        {
            (io::ErrorKind::InvalidInput, format!("{place} is in another region: set AWS_REGION to it"))
        }
        // No byte is asked for that was not there when the file was found.
        _ if asked == Asked::Read && has("the answer was 416") => (io::ErrorKind::InvalidData, CHANGED.to_owned()),
        _ if has("non-partial response") || has("Range request not supported") => {
            (io::ErrorKind::Unsupported, NO_RANGES.to_owned())
        }
        _ => {
            let remedy = match asked {
                Asked::Write => "nothing was written; run again, and check the endpoint and the network if it stays so",
                _ => "run again, and check the endpoint and the network if it stays so",
            };
            (io::ErrorKind::Other, format!("the store could not be used: {came}: {remedy}"))
        }
    };
    refusal(kind, what)
}

/// Settings of the environment that make no store, for a person.
pub(super) fn of_settings(uri: &Uri, error: &StoreError) -> io::Error {
    let what = format!("no store can be made of these settings: {}: {}", came(error), credentials(uri.scheme));
    refusal(io::ErrorKind::InvalidInput, what)
}

/// The error of a file that is no longer the one whose first bytes were read.
pub(super) const CHANGED: &str =
    "it was changed while it was read: nothing is made of a mixture; run again when its writer has ended";

/// The error of a web server that has no ranges.
pub(super) const NO_RANGES: &str =
    "the server sends whole files only and no ranges of them: download it and give the path";

/// Where the credentials of a store come from.
fn credentials(scheme: Scheme) -> &'static str {
    match scheme {
        Scheme::S3 => {
            "set AWS_PROFILE, or AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY; AWS_SKIP_SIGNATURE=true for a public bucket"
        }
        Scheme::Gs => {
            "run `gcloud auth application-default login`, or set GOOGLE_APPLICATION_CREDENTIALS; GOOGLE_SKIP_SIGNATURE=true for a public bucket"
        }
        Scheme::Az => {
            "set AZURE_STORAGE_ACCOUNT and AZURE_STORAGE_KEY, or AZURE_USE_AZURE_CLI=true after `az login`; AZURE_SKIP_SIGNATURE=true for a public container"
        }
        Scheme::Http | Scheme::Https => "only what a server gives to everyone is read",
    }
}

fn chain(error: &StoreError) -> impl Iterator<Item = &(dyn Error + 'static)> {
    std::iter::successors(Some(error as &(dyn Error + 'static)), |&error| error.source())
}

/// Whether the machine was asked for credentials, because nothing else has any, and has none.
fn no_credentials(error: &StoreError) -> bool {
    let of_machine = ["169.254.169.254", "metadata.google.internal", "/latest/api/token", "computeMetadata"];
    chain(error).any(|error| {
        let text = error.to_string();
        of_machine.iter().any(|name| text.contains(name))
    })
}

/// The answer of the store: the status and its own code where there is one, else the innermost reason.
fn came(error: &StoreError) -> String {
    let mut innermost = String::new();
    for error in chain(error) {
        let text = error.to_string();
        if let Some((_, answer)) = text.split_once("status code: ") {
            let status = answer.split([':', '\n']).next().unwrap_or(answer);
            let code = between(answer, "<Code>", "</Code>").map(|code| format!(" ({code})")).unwrap_or_default();
            return short(&format!("the answer was {status}{code}"));
        }
        innermost = text;
    }
    short(&innermost)
}

fn between<'t>(text: &'t str, begin: &str, end: &str) -> Option<&'t str> {
    let (_, rest) = text.split_once(begin)?;
    Some(rest.split_once(end)?.0)
}

/// On one line, not too long, and without what would steer a terminal.
fn short(text: &str) -> String {
    let mut line = String::new();
    for word in text.split_whitespace() {
        line.extend((!line.is_empty()).then_some(' '));
        line.extend(word.chars().filter(|letter| !letter.is_control()));
        if let Some((end, _)) = line.char_indices().nth(SHOWN) {
            line.truncate(end);
            return line + "...";
        }
    }
    line
}
