//! First run of a model that isn't one of our networks. It runs in a separate process, because it may crash.
//!
//! A runtime can end its process when a graph has 100,000 nodes in a chain or a tensor of 384 GB. The memory that a
//! graph needs can't be derived from its nodes, because sizes may depend on readings. The model is therefore tried with
//! limited memory and time, on batches and readings that are larger than real ones. The trial process is this program,
//! started again.

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

/// Command-line argument that makes this program try a model. The next argument is the request.
pub const ARGUMENT: &str = "--try-model";

/// Limit on the address space of the trial process. The paper's network needs a fiftieth of it, the runtime's library
/// included.
const MAX_MEMORY_KIB: u64 = 4 << 20;

/// Time limit of the first run. The paper's network needs a fiftieth of a second.
const MAX_TIME: Duration = Duration::from_secs(20);

/// Polling interval for the trial process.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// Stack of the trial thread: smaller than the stack of any thread that loads models.
const STACK: usize = 1 << 20;

/// Windows per call: the largest number that a runtime ever gets.
const N_WINDOWS: usize = 64;

/// Set in the environment of a trial process, so that neither it nor its children start another trial.
const IN_TRIAL: &str = "TPF_MODEL_TRIAL";

/// Program to start for a trial, and its arguments before [`ARGUMENT`]. Empty if none was set.
static PROGRAM: OnceLock<(PathBuf, Vec<OsString>)> = OnceLock::new();

/// Models that were already tried, as SHA-256, backend and tensor names.
static TRIED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// The model to try.
#[derive(Debug, Serialize, Deserialize)]
struct Request {
    path: PathBuf,
    backend: BackendChoice,
    names: TensorNames,
}

/// From now on, models are tried in processes of this program. Its `main` must pass the argument after [`ARGUMENT`] to
/// [`answer`].
pub fn call_this_program() {
    // If the path of the executable is unknown, models are loaded without a trial, as in a library.
    if let Ok(program) = std::env::current_exe() {
        call(program, Vec::new());
    }
}

/// From now on, models are tried in processes of this program, unless another one was set before. It is started with
/// `args`, [`ARGUMENT`] and a text. It must pass the text to [`answer`]. If that returns an error, it must print it to
/// stdout and exit with 1.
pub fn call(program: PathBuf, args: Vec<OsString>) {
    PROGRAM.get_or_init(|| (program, args));
}

/// Tries a model in the trial process. The error is one line.
///
/// # Errors
/// The error of [`load`](super::load), or of a run on many windows.
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
    let frames = SCALES.iter().map(|scale| Frames::new(&contract, scale, N_WINDOWS + contract.window.get() - 1));
    for frames in frames {
        // A model may fail on readings that no sensor sends.
        let _ = model.regressor.run(frames.windows(&starts), &mut Forces::default());
    }
    Ok(())
}

/// Tries a model in a separate process, once per model. `Some` is the reason why a trial was not possible.
///
/// # Errors
/// [`ModelError::FirstRun`] with the message of that process, or how it ended.
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

/// Runs the program under the limits. Returns its exit status, if it ended in time, and its output.
fn called(program: &Path, args: &[OsString], request: &str) -> std::io::Result<(Option<ExitStatus>, String)> {
    // A stricter limit that is already set stays in force.
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

/// Waits for a process to end. After the time limit it is killed, and the result is `None`.
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
