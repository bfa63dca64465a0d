//! Statistics of some bags in a file, and files of all bags merged to what one run over them gives.

mod error;
mod file;
mod fingerprint;
mod merge;
mod table;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

pub use self::error::MergeError;
pub use self::merge::{Expected, merge};

use self::file::PartialFile;
use self::fingerprint::Fingerprint;
use super::{EvaluateError, Request, Series, SessionToScore, parts};
use crate::config::Config;
use crate::location;
use crate::observer::{Observer, check};
use crate::sessions::{Shard, fingerprint};

/// Where the statistics of some bags go, and which of all bags they are.
#[derive(Debug, Clone, Copy)]
pub struct PartialOut<'a> {
    /// The file to write, in place of what is there.
    pub path: &'a Path,
    /// The bags and folders that the command line names: merged results show it.
    pub named: &'a [String],
    /// Its options that decide scores.
    pub options: &'a [String],
    /// Which share of all bags they are, and how many there are in all; `None` for bags that were chosen in another way.
    pub shard: Option<(Shard, usize)>,
}

/// The bags of a partial, scored or not.
#[derive(Debug, Serialize)]
pub struct Partial {
    /// The file.
    pub partial: String,
    /// In the order in which they were scored.
    pub bags: Vec<PartialBag>,
}

/// A bag of a partial.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PartialBag {
    /// As it was given.
    pub bag: String,
    /// SHA-256 of its files; absent where they can't be read.
    pub sha256: Option<String>,
    /// Why it was not scored, in one line; absent where it was.
    pub error: Option<String>,
    /// Whether some of it was lost.
    pub has_losses: bool,
    /// Warnings for a person.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

impl Partial {
    /// Whether something of the input is in no statistic.
    pub fn has_lost(&self) -> bool {
        self.bags.iter().any(|bag| bag.error.is_some() || bag.has_losses)
    }
}

/// Scores bags and writes their statistics. A bag that can't be scored is in the file, with the reason. No bag at all gives a
/// file as well: that of one shard of more than there are bags.
///
/// # Errors
/// [`EvaluateError`] when a model can't be loaded, the file can't be written, or the observer cancels; there is no file then.
pub fn run_partial(
    cfg: Config,
    request: &Request<'_>,
    out: PartialOut<'_>,
    observer: &dyn Observer,
    mut each: impl FnMut(&[Series], &SessionToScore) -> Result<(), Box<dyn std::error::Error + Send + Sync>>,
) -> Result<Partial, EvaluateError> {
    let made_with = Fingerprint::of(&cfg, request)?;
    let mut file = PartialFile::create(out.path)?;
    let mut bags = Vec::new();
    let head = if request.bags.is_empty() {
        None
    } else {
        let head = parts(cfg, request, observer, &mut each, &mut |nth, mut part| {
            part.sha256 = part.sha256.or_else(|| fingerprint(Path::new(&part.bag)).ok());
            bags.push(file.write(nth, &part)?);
            Ok(())
        })?;
        Some(head)
    };
    check(observer)?;
    file.finish(out, made_with, head)?;
    Ok(Partial { partial: out.path.display().to_string(), bags })
}

/// The command line that scores what is named, with these options.
pub fn command(named: &[String], options: &[String]) -> Vec<String> {
    let words = ["tpf", "eval"].map(str::to_owned).into_iter();
    words.chain(named.iter().cloned()).chain(options.iter().cloned()).collect()
}

/// Paths in words, the first few of them.
fn few(names: &[String]) -> String {
    const SHOWN: usize = 5;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    match names.len().checked_sub(SHOWN).filter(|n| *n > 0) {
        Some(n) => format!("{shown} and {n} more"),
        None => shown,
    }
}

/// SHA-256 in hexadecimal.
fn hex(hash: impl AsRef<[u8]>) -> String {
    hash.as_ref().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 of a file.
fn sha256_of(path: &Path) -> Result<String, EvaluateError> {
    use sha2::{Digest, Sha256};
    let bytes = location::read(path).map_err(|error| EvaluateError::File { path: PathBuf::from(path), error })?;
    Ok(hex(Sha256::digest(bytes)))
}

/// Whether a file is there. A store that can't be asked is an error, and not an absent file.
fn is_there(path: &Path) -> Result<bool, EvaluateError> {
    location::exists(path).map_err(|error| EvaluateError::File { path: path.to_owned(), error })
}
