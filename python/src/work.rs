//! Long work off the interpreter's lock. It goes on in a thread of its own; the thread that called waits, tells Python
//! notes and progress, and looks for Ctrl-C, which only that thread can see.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;
use tactile_pose_fusion::observer::{Observer, cancelled_by};
use tactile_pose_fusion::train::Progress;

use crate::error::{Refusal, raise};

/// Between looks at notes, progress and Ctrl-C.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// What the work tells, until it is told to Python.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    notes: Mutex<Vec<String>>,
    steps: Mutex<Vec<String>>,
    done: AtomicU64,
    total: AtomicU64,
    /// Also ends waiting for a store.
    is_cancelled: Arc<AtomicBool>,
}

impl Observer for Watch {
    fn note(&self, text: &str) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(text.to_owned());
    }

    fn progress(&self, done: u64, total: u64) {
        self.total.store(total, Ordering::Relaxed);
        self.done.store(done, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

impl Watch {
    /// Takes a step of a training: the last one is its progress, and those with a look at the validation part are told.
    pub(crate) fn step(&self, step: &Progress) {
        self.progress(step.step, step.steps);
        if step.validation.is_some()
            && let Ok(step) = serde_json::to_string(step)
        {
            self.steps.lock().unwrap_or_else(PoisonError::into_inner).push(step);
        }
    }

    /// Tells Python what is new, and gives its answer: an error is Ctrl-C, or what a callback raised.
    fn tell(&self, watcher: &Bound<'_, PyAny>) -> PyResult<()> {
        let notes = std::mem::take(&mut *self.notes.lock().unwrap_or_else(PoisonError::into_inner));
        for note in notes {
            watcher.call_method1("note", (note,))?;
        }
        let steps = std::mem::take(&mut *self.steps.lock().unwrap_or_else(PoisonError::into_inner));
        for step in steps {
            watcher.call_method1("step", (step,))?;
        }
        let (done, total) = (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed));
        if total > 0 {
            watcher.call_method1("progress", (done, total))?;
        }
        watcher.py().check_signals()
    }
}

/// Does work. `watcher` is a Python object with `note(text)`, `progress(done, total)` and `step(json)`; what it raises
/// ends the work.
///
/// # Errors
/// The exception of the work's own error, of Ctrl-C, or of the watcher.
pub(crate) fn run<T: Send, E: Refusal + Send>(
    watcher: &Bound<'_, PyAny>,
    work: impl FnOnce(&Watch) -> Result<T, E> + Send,
) -> PyResult<T> {
    wait_for(watcher.py(), &mut |watch| watch.tell(watcher), work)
}

/// Does work that tells nothing, and may take a while where a file is not on this machine.
///
/// # Errors
/// The exception of the work's own error, or of Ctrl-C.
pub(crate) fn quietly<T: Send, E: Refusal + Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, E> + Send,
) -> PyResult<T> {
    wait_for(py, &mut |_| py.check_signals(), |_| work())
}

fn wait_for<T: Send, E: Refusal + Send>(
    py: Python<'_>,
    tell: &mut dyn FnMut(&Watch) -> PyResult<()>,
    work: impl FnOnce(&Watch) -> Result<T, E> + Send,
) -> PyResult<T> {
    let watch = Watch::default();
    let (done, is_done) = channel();
    let (result, raised) = std::thread::scope(|scope| -> PyResult<_> {
        let watch = &watch;
        let body = move || {
            let result = cancelled_by(Some(Arc::clone(&watch.is_cancelled)), || work(watch));
            let _ = done.send(()); // whoever waits also looks whether this thread is there
            result
        };
        let thread = std::thread::Builder::new().name("tpf-work".to_owned()).spawn_scoped(scope, body)?;
        let mut raised = None;
        let is_done = Mutex::new(is_done);
        loop {
            let waited = py.detach(|| is_done.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LOOK_EVERY));
            if raised.is_none()
                && let Err(error) = tell(watch)
            {
                watch.is_cancelled.store(true, Ordering::Relaxed);
                raised = Some(error);
            }
            if waited != Err(RecvTimeoutError::Timeout) {
                break;
            }
        }
        Ok((py.detach(|| thread.join()), raised))
    })?;
    match (result, raised) {
        (Err(panic), _) => std::panic::resume_unwind(panic),
        (_, Some(error)) => Err(error),
        (Ok(result), None) => result.map_err(|error| raise(&error)),
    }
}
