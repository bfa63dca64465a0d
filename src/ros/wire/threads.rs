//! Threads that the node can't run without, and waiting for them within the time limit for leaving.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use super::error::NodeError;
use crate::leave;

/// Interval between checks that a thread has ended. A wait counts these, so that time in which the process itself was
/// stopped doesn't count.
const SLICE: Duration = Duration::from_millis(5);

/// Starts a thread that the process can't run without: if it panics, the process ends.
pub(in crate::ros) fn spawn(
    name: &'static str,
    work: impl FnOnce() + Send + 'static,
) -> Result<JoinHandle<()>, NodeError> {
    let vital = Vital::new(name);
    let work = move || {
        let _vital = vital;
        work();
    };
    Builder::new().name(name.into()).spawn(work).map_err(|source| NodeError::System { what: "thread", source })
}

/// A runtime for the tasks of one thread.
pub(in crate::ros) fn runtime() -> Result<tokio::runtime::Runtime, NodeError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.map_err(|source| NodeError::System { what: "runtime", source })
}

/// A part that the process can't run without; held by the thread that does its work.
pub(in crate::ros) struct Vital {
    part: &'static str,
    ended: fn(&str),
}

impl Vital {
    pub(in crate::ros) fn new(part: &'static str) -> Self {
        Vital { part, ended }
    }
}

impl Drop for Vital {
    fn drop(&mut self) {
        if std::thread::panicking() {
            (self.ended)(self.part);
        }
    }
}

/// Asks the process to end because a part of it has ended.
pub(in crate::ros) fn ended(part: &str) {
    leave::fail(has_ended(part));
}

/// The message about a part that has ended.
pub(in crate::ros) fn has_ended(part: &str) -> String {
    format!("the part of this process called {part:?} has ended, so the process ends too; start it anew")
}

/// True if a thread ends within a limit.
pub(in crate::ros) fn ends_within(thread: &JoinHandle<()>, limit: Duration) -> bool {
    for _ in 0..slices(limit) {
        if thread.is_finished() {
            return true;
        }
        std::thread::sleep(SLICE);
    }
    thread.is_finished()
}

/// Runs work on a separate thread and waits for it; true if it finished within a limit. If not, it goes on.
pub(in crate::ros) fn within(limit: Duration, work: impl FnOnce() + Send + 'static) -> bool {
    let (done, is_done) = channel();
    let work = move || {
        work();
        let _ = done.send(()); // nobody waits any more
    };
    if Builder::new().name("bounded".into()).spawn(work).is_err() {
        return false;
    }
    for _ in 0..slices(limit) {
        match is_done.recv_timeout(SLICE) {
            Ok(()) => return true,
            Err(RecvTimeoutError::Disconnected) => return false, // it panicked
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
    false
}

fn slices(limit: Duration) -> u128 {
    limit.as_millis() / SLICE.as_millis()
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::time::Instant;

    use super::*;

    #[test]
    fn a_part_that_panics_is_told_and_one_that_is_done_is_not() {
        static TOLD: Mutex<Vec<String>> = Mutex::new(Vec::new());
        let vital = |part| Vital { part, ended: |part| TOLD.lock().unwrap().push(part.to_owned()) };
        drop(vital("done"));
        let panics = std::thread::spawn(move || {
            let _vital = vital("engine");
            panic!("as a defect does");
        });
        assert!(panics.join().is_err());
        let tasks = tokio::task::LocalSet::new();
        let task = tasks.spawn_local(async move {
            let _vital = vital("services");
            panic!("as a defect does");
        });
        let runtime = runtime().unwrap();
        assert!(tasks.block_on(&runtime, task).is_err(), "tokio keeps a panic to itself");
        assert_eq!(*TOLD.lock().unwrap(), ["engine", "services"]);
    }

    #[test]
    fn work_that_takes_too_long_is_left_alone() {
        let begun = Instant::now();
        assert!(within(Duration::from_secs(5), || {}));
        assert!(!within(Duration::from_millis(50), || std::thread::sleep(Duration::from_secs(3))));
        assert!(!within(Duration::from_secs(5), || panic!("as a defect does")));
        let thread = std::thread::spawn(|| std::thread::sleep(Duration::from_secs(3)));
        assert!(!ends_within(&thread, Duration::from_millis(50)));
        assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
    }
}
