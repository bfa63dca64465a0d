//! Sessions side by side on the cores, taken in the order of the bags.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use super::EvaluateError;
use super::plan::{Plan, SessionToScore};
use crate::bag::stored_bytes;
use crate::observer::{cancel_flag, cancelled_by, check};
use crate::sessions::ModelRun;

/// From one look at the progress to the next.
const PROGRESS_EVERY: Duration = Duration::from_millis(100);

/// Takes every bag through the plan with so many workers, and hands each session, or why there is none, to `take`: in
/// the order of the bags, so that what comes out doesn't depend on who was faster.
pub(super) fn run(
    plan: &Plan<'_>,
    first: Vec<ModelRun>,
    bags: &[PathBuf],
    jobs: usize,
    mut take: impl FnMut(usize, Result<SessionToScore, EvaluateError>) -> Result<(), EvaluateError>,
) -> Result<(), EvaluateError> {
    let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
    let first = Mutex::new(Some(first));
    // A bag that can't be opened says so when it is its turn.
    let total = bags.iter().map(|bag| stored_bytes(bag).unwrap_or(0)).sum();
    let cancel = cancel_flag();
    std::thread::scope(|scope| {
        let (sender, sessions) = channel();
        for _ in 0..jobs.clamp(1, bags.len().max(1)) {
            let (sender, next, done, first, cancel) = (sender.clone(), &next, &done, &first, cancel.clone());
            scope.spawn(move || {
                let cores = first.lock().ok().and_then(|mut first| first.take());
                cancelled_by(cancel, || work(plan, cores, bags, next, done, &sender));
            });
        }
        drop(sender);
        let mut early = BTreeMap::new();
        let mut turn = 0;
        loop {
            match sessions.recv_timeout(PROGRESS_EVERY) {
                Ok((idx, session)) => {
                    early.insert(idx, session);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
            plan.observer.progress(done.load(Ordering::Relaxed), total);
            while let Some(session) = early.remove(&turn) {
                let taken = check(plan.observer).map_err(EvaluateError::from).and_then(|()| take(turn, session));
                if taken.is_err() {
                    next.store(bags.len(), Ordering::Relaxed); // no worker begins another bag
                    return taken;
                }
                turn += 1;
            }
        }
    })
}

type Sent = (usize, Result<SessionToScore, EvaluateError>);

fn work(
    plan: &Plan<'_>,
    mut cores: Option<Vec<ModelRun>>,
    bags: &[PathBuf],
    next: &AtomicUsize,
    done: &AtomicU64,
    sender: &Sender<Sent>,
) {
    loop {
        let idx = next.fetch_add(1, Ordering::Relaxed);
        let Some(bag) = bags.get(idx) else { return };
        // A bag that failed took the models with it.
        let loaded = cores.take().map_or_else(|| plan.load(), Ok);
        let session = loaded.and_then(|loaded| plan.session(bag, loaded, done)).map(|(session, again)| {
            cores = Some(again);
            session
        });
        if sender.send((idx, session)).is_err() {
            return;
        }
    }
}
