//! The first run of a model that isn't the paper's network: in a separate process, which may crash.
//!
//! A runtime that is given a chain of 100,000 nodes, or a tensor of 384 GB, ends its process. The resources of a graph
//! can't be derived from its nodes, since sizes may depend on readings; so it is tried, with limited memory and time,
//! with batches and readings larger than any that come. The trial process is this program, started again.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::error::{ModelError, one_line};
use super::trial::{Frames, SCALES};
use super::{BackendChoice, ModelSpec, TensorNames};
use crate::fusion::Forces;

/// The argument that asks this program to try a model; what comes behind it says which.
pub const ARGUMENT: &str = "--try-model";

/// Address space of the process that tries. The paper's network takes a fiftieth of it, the runtime's library included.
const MAX_MEMORY_KIB: u64 = 4 << 20;

/// Time that the first run may take; the paper's network takes a fiftieth of a second.
const MAX_TIME: Duration = Duration::from_secs(20);

/// Polling interval for the trial process.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// Stack of the thread that tries: less than any thread has that loads models.
const STACK: usize = 1 << 20;

/// Windows that are run at once: as many as a runtime is ever given.
const N_WINDOWS: usize = 64;

/// Set in the environment of a trial process: neither it nor what it starts tries a model in a further process.
const IN_TRIAL: &str = "TPF_MODEL_TRIAL";

/// The program to start and its arguments before [`ARGUMENT`], if there is one.
static PROGRAM: OnceLock<(PathBuf, Vec<OsString>)> = OnceLock::new();

/// Models that were tried, by their SHA-256, backend and names of tensors.
static TRIED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// What to try.
#[derive(Debug, Serialize, Deserialize)]
struct Request {
    path: PathBuf,
    backend: BackendChoice,
    names: TensorNames,
}

/// Tries models in processes of this program from now on. Its `main` must give what follows [`ARGUMENT`] to [`answer`].
pub fn call_this_program() {
    // Without a name of its own it can't be called, and models are loaded as a library loads them.
    if let Ok(program) = std::env::current_exe() {
        call(program, Vec::new());
    }
}

/// Tries models in processes of this program from now on, unless one was named before. With these arguments and two more,
/// [`ARGUMENT`] and a text, it gives that text to [`answer`], writes what that says to stdout, and leaves with 1 at an error.
pub fn call(program: PathBuf, args: Vec<OsString>) {
    PROGRAM.get_or_init(|| (program, args));
}

/// Tries a model as the process that was called for it: `Err` with one line where it can't be used.
///
/// # Errors
/// What [`load`](super::load) says, or that the model fails on many windows.
pub fn answer(request: &str) -> Result<(), String> {
    let Request { path, backend, names } =
        serde_json::from_str(request).map_err(|error| format!("{ARGUMENT}: {error}"))?;
    let spec = ModelSpec { backend, names, ..ModelSpec::new(path) };
    let thread = std::thread::Builder::new().stack_size(STACK).spawn(move || run(&spec));
    let thread = thread.map_err(|error| format!("{ARGUMENT}: {error}"))?;
    thread.join().unwrap_or_else(|_| Err(format!("{ARGUMENT}: the model ended its thread")))
}

fn run(spec: &ModelSpec) -> Result<(), String> {
    let mut model = super::load(spec).map_err(|refused| refused.to_string())?;
    let contract = model.info.contract.clone();
    let starts: Vec<usize> = (0..N_WINDOWS).collect();
    let frames = SCALES.iter().map(|scale| Frames::new(&contract, scale, N_WINDOWS + contract.window - 1));
    for frames in frames {
        // A model may refuse readings that no sensor sends.
        let _ = model.regressor.run(frames.windows(&starts), &mut Forces::default());
    }
    Ok(())
}

/// Tries a model in a separate process, once; `Some` gives the reason why that was not possible.
///
/// # Errors
/// [`ModelError::FirstRun`] with what that process said, or how it ended.
pub(super) fn check(spec: &ModelSpec, sha256: &str) -> Result<Option<String>, ModelError> {
    let Some((program, args)) = PROGRAM.get() else { return Ok(None) };
    if std::env::var_os(IN_TRIAL).is_some() {
        return Ok(None);
    }
    let request = Request { path: spec.path.clone(), backend: spec.backend, names: spec.names.clone() };
    let Ok(request) = serde_json::to_string(&request) else {
        return Ok(Some("its path is no text".to_owned()));
    };
    let key = format!("{sha256} {request}");
    if TRIED.lock().is_ok_and(|tried| tried.contains(&key)) {
        return Ok(None);
    }
    let refused = |line: String| ModelError::FirstRun { line };
    let died = |how: String| {
        let path = one_line(&spec.path.display().to_string());
        let (gib, s) = (MAX_MEMORY_KIB >> 20, MAX_TIME.as_secs());
        refused(format!(
            "{path}: a first run of it {how}; expected a model that runs within {gib} GiB and {s} s: export it again"
        ))
    };
    match called(program, args, &request) {
        Ok((Some(status), _)) if status.success() => {}
        Ok((Some(status), said)) => match (status.code(), said.lines().next()) {
            (Some(1), Some(line)) => return Err(refused(line.to_owned())),
            (Some(126 | 127), _) => return Ok(Some(format!("{} can't be called", program.display()))),
            _ => return Err(died(format!("ended its process ({status})"))),
        },
        Ok((None, _)) => return Err(died("did not come to an end".to_owned())),
        Err(error) => return Ok(Some(one_line(&error.to_string()))),
    }
    if let Ok(mut tried) = TRIED.lock() {
        tried.insert(key);
    }
    Ok(None)
}

/// Calls the program under limits: how it ended, if it did in time, and what it said.
fn called(program: &Path, args: &[OsString], request: &str) -> std::io::Result<(Option<ExitStatus>, String)> {
    // A limit that is stricter already stays.
    let limits = format!("ulimit -c 0; ulimit -v {MAX_MEMORY_KIB}; exec \"$0\" \"$@\"");
    let mut child = Command::new("/bin/sh")
        .args(["-c", &limits])
        .arg(program)
        .args(args)
        .args([ARGUMENT, request])
        .env(IN_TRIAL, "1")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let status = ended(&mut child)?;
    let mut said = String::new();
    if let (Some(_), Some(stdout)) = (status, &mut child.stdout) {
        stdout.take(1 << 16).read_to_string(&mut said)?;
    }
    Ok((status, said))
}

/// How a process ended; where it takes too long it is ended, which is `None`.
fn ended(child: &mut Child) -> std::io::Result<Option<ExitStatus>> {
    let begin = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if begin.elapsed() > MAX_TIME {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(LOOK_EVERY);
    }
}
