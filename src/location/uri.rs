//! Paths and URIs told apart.

use std::borrow::Cow;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::refusal;

/// The place that a path or URI stands for.
pub(super) enum Where<'a> {
    /// A path of this machine.
    Here(Cow<'a, Path>),
    /// Something elsewhere, or why the URI is none.
    Remote(io::Result<Uri>),
}

/// The kind of store that a URI leads to, by its scheme.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Scheme {
    S3,
    Gs,
    Az,
    Http,
    Https,
}

/// A URI of an object or of a folder of objects.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Uri {
    pub(super) scheme: Scheme,
    /// The bucket or container, or a web server's name and port.
    pub(super) bucket: String,
    /// Name of the object, without a `/` at either end; empty of the bucket itself.
    pub(super) key: String,
}

/// Schemes after whose names no folder of this machine is called.
const SCHEMES: [&str; 6] = ["s3", "s3a", "gs", "az", "http", "https"];

/// Tells what a path is.
pub(super) fn of(path: &Path) -> Where<'_> {
    // Python's pathlib makes one slash of two.
    let parts = path.to_str().and_then(|text| {
        text.split_once("://").or_else(|| text.split_once(":/").filter(|(scheme, _)| SCHEMES.contains(scheme)))
    });
    // Its third slash is gone, too.
    if let Some(rest) = path.to_str().and_then(|text| text.strip_prefix("file:/")).filter(|rest| !rest.starts_with('/'))
    {
        return here(&format!("/{rest}"));
    }
    let Some((scheme, rest)) = parts.filter(|(scheme, _)| is_scheme(scheme)) else {
        return Where::Here(Cow::Borrowed(path));
    };
    let scheme = match scheme.to_ascii_lowercase().as_str() {
        "file" => return here(rest),
        "s3" | "s3a" => Scheme::S3,
        "gs" => Scheme::Gs,
        "az" => Scheme::Az,
        "http" => Scheme::Http,
        "https" => Scheme::Https,
        other => {
            let expected = "a path, or a URI that begins with file://, s3://, gs://, az://, http:// or https://";
            return Where::Remote(Err(invalid(format!("{other}:// is not known: expected {expected}"))));
        }
    };
    Where::Remote(Uri::new(scheme, rest))
}

/// A text in which a URI has `***` in place of a user, a password or a query, wherever it begins; `None` where it has none of
/// them.
pub(super) fn without_secrets(text: &str) -> Option<String> {
    let is_scheme = |letter: char| letter.is_ascii_alphanumeric() || "+-.".contains(letter);
    let scheme_at = |end: usize| text[..end].rfind(|letter| !is_scheme(letter)).map_or(0, |at| at + 1);
    // One slash, as pathlib leaves it, makes a URI only behind a scheme that we know.
    let is_known = |end: &usize| {
        let before = text[..*end].to_ascii_lowercase();
        let begins = |scheme: &str| {
            before
                .strip_suffix(scheme)
                .is_some_and(|before| before.is_empty() || before.ends_with('=') || before == "-o")
        };
        text[*end..].starts_with("://") || SCHEMES.iter().any(|scheme| begins(scheme))
    };
    let end = text.match_indices(":/").map(|(end, _)| end).find(|end| scheme_at(*end) < *end && is_known(end))?;
    let slashes = if text[end..].starts_with("://") { 3 } else { 2 };
    let (begin, rest) = text.split_at(end + slashes);
    let (authority, path) = rest.split_at(rest.find('/').unwrap_or(rest.len()));
    let host = authority.rsplit_once('@').map(|(_, host)| format!("***@{host}"));
    let is_web = ["http", "https"].iter().any(|web| text[..end].to_ascii_lowercase().ends_with(web));
    // Without a path, a query stands right behind the host.
    let mut shown = host.as_deref().unwrap_or(authority).to_owned() + path;
    let query = shown.find(['?', '#']).filter(|_| is_web);
    if host.is_none() && query.is_none() {
        return None;
    }
    if let Some(at) = query {
        shown.truncate(at + 1);
        shown.push_str("***");
    }
    Some(format!("{begin}{shown}"))
}

fn is_scheme(text: &str) -> bool {
    let begins = text.starts_with(|letter: char| letter.is_ascii_alphabetic());
    begins && text.len() > 1 && text.chars().all(|letter| letter.is_ascii_alphanumeric() || "+-.".contains(letter))
}

fn here(rest: &str) -> Where<'static> {
    let path = rest.strip_prefix("localhost").unwrap_or(rest);
    if !path.starts_with('/') {
        let why = "a file:// URI names a file of this machine, as file:///folder/bag.mcap";
        return Where::Remote(Err(invalid(why.to_owned())));
    }
    match decoded(path) {
        Some(path) => Where::Here(Cow::Owned(PathBuf::from(path))),
        None => Where::Remote(Err(invalid("what stands behind a % is no text: write a % itself as %25".to_owned()))),
    }
}

/// The text behind a URI's `%41`; `None` where it is none.
fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let digit = |byte: u8| char::from(byte).to_digit(16);
        let (high, low) = (digit(rest.next()?)?, digit(rest.next()?)?);
        bytes.push((high * 16 + low) as u8);
    }
    String::from_utf8(bytes).ok()
}

impl Uri {
    fn new(scheme: Scheme, rest: &str) -> io::Result<Self> {
        let is_web = matches!(scheme, Scheme::Http | Scheme::Https);
        let (bucket, key) = rest.split_once('/').unwrap_or((rest, ""));
        // A name of a bag stands in results, where a signature or a password must not.
        if bucket.contains('@') || (is_web && key.contains(['?', '#'])) {
            let why = "a URI with a user, a password or a query is not taken, because the names of bags stand in results: use s3://, gs:// or az:// with credentials of the environment";
            return Err(invalid(why.to_owned()));
        }
        if bucket.is_empty() {
            return Err(invalid(format!("names no {}, as {}", scheme.bucket(), scheme.example())));
        }
        let key = if is_web {
            let why = || invalid("what stands behind a % is no text: write a % itself as %25".to_owned());
            Cow::Owned(decoded(key).ok_or_else(why)?)
        } else {
            Cow::Borrowed(key)
        };
        let mut parts: Vec<&str> = Vec::new();
        for part in key.split('/') {
            match part {
                "" | "." => {}
                ".." => drop(parts.pop()),
                part if part.chars().any(char::is_control) => {
                    return Err(invalid("has a control character in its name".to_owned()));
                }
                part => parts.push(part),
            }
        }
        Ok(Uri { scheme, bucket: bucket.to_owned(), key: parts.join("/") })
    }
}

impl Scheme {
    fn name(self) -> &'static str {
        match self {
            Scheme::S3 => "s3",
            Scheme::Gs => "gs",
            Scheme::Az => "az",
            Scheme::Http => "http",
            Scheme::Https => "https",
        }
    }

    /// The word for the first part of a URI.
    pub(super) fn bucket(self) -> &'static str {
        match self {
            Scheme::S3 | Scheme::Gs => "bucket",
            Scheme::Az => "container",
            Scheme::Http | Scheme::Https => "server",
        }
    }

    fn example(self) -> &'static str {
        match self {
            Scheme::S3 => "s3://bucket/folder/bag.mcap",
            Scheme::Gs => "gs://bucket/folder/bag.mcap",
            Scheme::Az => "az://container/folder/bag.mcap",
            Scheme::Http => "http://server/folder/bag.mcap",
            Scheme::Https => "https://server/folder/bag.mcap",
        }
    }
}

impl fmt::Display for Uri {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}://{}", self.scheme.name(), self.bucket)?;
        if self.key.is_empty() { Ok(()) } else { write!(f, "/{}", self.key) }
    }
}

fn invalid(why: String) -> io::Error {
    refusal(io::ErrorKind::InvalidInput, why)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn remote(text: &str) -> io::Result<String> {
        match of(Path::new(text)) {
            Where::Remote(uri) => uri.map(|uri| uri.to_string()),
            Where::Here(path) => panic!("{text} is {}", path.display()),
        }
    }

    #[test]
    fn one_object_has_one_name() {
        for text in [
            "s3://bucket/a/b.mcap",
            "s3a://bucket//a/./b.mcap",
            "S3://bucket/a/c/../b.mcap",
            "s3://bucket/a/b.mcap/",
            "s3:/bucket/a/b.mcap",
        ] {
            assert_eq!(remote(text).unwrap(), "s3://bucket/a/b.mcap", "{text}");
        }
        assert_eq!(remote("gs://bucket").unwrap(), "gs://bucket");
        assert_eq!(remote("az://container/a%20b?c").unwrap(), "az://container/a%20b?c", "keys are taken as they are");
        assert_eq!(remote("http://host:8080/a%20b.mcap").unwrap(), "http://host:8080/a b.mcap");
    }

    #[test]
    fn file_uris_and_plain_paths_are_paths_of_this_machine() {
        let texts = [
            ("file:///data/a%20b.mcap", "/data/a b.mcap"),
            ("file://localhost/data", "/data"),
            ("file:/data/a%20b.mcap", "/data/a b.mcap"),
            ("data/s3:/a", "data/s3:/a"),
            ("../bag", "../bag"),
            ("C://bag", "C://bag"),
            ("a b://c", "a b://c"),
        ];
        for (text, path) in texts {
            match of(Path::new(text)) {
                Where::Here(found) => assert_eq!(found, Path::new(path)),
                Where::Remote(_) => panic!("{text}"),
            }
        }
    }

    #[test]
    fn a_secret_in_a_uri_is_not_passed_on() {
        let texts = [
            ("https://me:secret@host/a.mcap", Some("https://***@host/a.mcap")),
            ("https://host/a.mcap?X-Amz-Signature=secret", Some("https://host/a.mcap?***")),
            ("s3://bucket/a?b@c", None),
            ("s3://key:secret@bucket/a", Some("s3://***@bucket/a")),
            ("https:/me:secret@host/a.mcap", Some("https:/***@host/a.mcap")),
            ("https://host?sig=secret", Some("https://host?***")),
            ("-ohttps://me:secret@host/a.mcap", Some("-ohttps://***@host/a.mcap")),
            ("--output=HTTPS://host/a?sig=secret", Some("--output=HTTPS://host/a?***")),
            ("model.x.path:=https://me:secret@host/m.onnx", Some("model.x.path:=https://***@host/m.onnx")),
            ("ftp://me:secret@host/a", Some("ftp://***@host/a")),
            ("a:/b@c", None),
            ("plain", None),
        ];
        for (text, shown) in texts {
            assert_eq!(without_secrets(text).as_deref(), shown, "{text}");
        }
    }

    #[test]
    fn what_is_no_uri_is_refused_in_one_line_without_its_secrets() {
        let refused = [
            ("ftp://host/a", "ftp:// is not known: expected a path, or a URI that begins with file://, s3://"),
            ("s3:///a", "names no bucket, as s3://bucket/folder/bag.mcap"),
            ("az://", "names no container"),
            ("file://data/a", "names a file of this machine"),
            ("file:///%zz", "write a % itself as %25"),
            ("https://user:secret@host/a", "a URI with a user, a password or a query is not taken"),
            ("https://host/a?X-Amz-Signature=secret", "a URI with a user, a password or a query is not taken"),
        ];
        for (text, why) in refused {
            let error = remote(text).unwrap_err().to_string();
            assert!(error.contains(why) && !error.contains("secret"), "{text}: {error}");
            assert_eq!(error.lines().count(), 1);
        }
    }
}
