//! Ends this process: after a signal, a time limit, or the failure of a part that it needs.
//!
//! A first SIGINT, SIGTERM or SIGHUP is recorded. Work checks [`asked`] and ends in order. A second signal ends the
//! process at once. A program that talks to a graph also calls [`in_time`], so that it ends soon even while it waits
//! for something.

use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, Once, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// Time in which a process with [`in_time`] must end by itself.
const LIMIT: Duration = Duration::from_millis(1800);

/// Polling interval.
const SLICE: Duration = Duration::from_millis(20);

/// A second signal within this time is the same one, passed on by a shell or a launcher.
const ECHO: Duration = Duration::from_millis(100);

/// Exit code if the process is ended without a signal.
const FAILED: i32 = 1;

static ASKED: AtomicBool = AtomicBool::new(false);
static WHEN_ASKED: Condvar = Condvar::new();
static WAITING: Mutex<()> = Mutex::new(());
/// Exit code if the process is ended by force: 128 plus the number of the first signal.
static CODE: AtomicI32 = AtomicI32::new(FAILED);
static FAILURE: OnceLock<String> = OnceLock::new();
static N_KEPT: AtomicUsize = AtomicUsize::new(0);
static LAST: Mutex<Option<fn()>> = Mutex::new(None);

/// From now on, a signal to end is recorded and doesn't end the process at once.
pub fn listen() {
    static LISTENING: Once = Once::new();
    LISTENING.call_once(|| {
        if let Err(error) = start_listening() {
            say(&format!("signals end this run at once, and may leave a hidden temporary file: {error}"));
        }
    });
}

/// True if this process should end.
pub fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// Flag that is set when this process should end, for work that polls.
pub fn flag() -> &'static AtomicBool {
    &ASKED
}

/// Asks this process to end, because a part that it needs has failed. If it is called again, the first reason stays.
pub fn fail(why: String) {
    let _ = FAILURE.set(why);
    ask(FAILED);
}

/// The failure that ends this process.
pub fn failure() -> Option<&'static str> {
    FAILURE.get().map(String::as_str)
}

/// Asks this process to end after a while.
///
/// # Errors
/// If no thread can be started.
pub fn after(time: Duration) -> std::io::Result<()> {
    let wait = move || {
        std::thread::sleep(time);
        ask(FAILED);
    };
    std::thread::Builder::new().name("time".into()).spawn(wait).map(drop)
}

/// From now on, this process ends within two seconds after it is asked to, even if it waits for a network, a subscriber
/// or a request. Work that must be completed calls [`keep`].
///
/// # Errors
/// If no thread can be started.
pub fn in_time() -> std::io::Result<()> {
    static LIMITED: AtomicBool = AtomicBool::new(false);
    if LIMITED.swap(true, Ordering::Relaxed) {
        return Ok(());
    }
    std::thread::Builder::new().name("leave".into()).spawn(end_in_time).map(drop)
}

/// While it exists, only a second signal ends the process.
#[derive(Debug)]
pub struct Kept(());

/// Suspends the time limit of [`in_time`], for example until a recording is complete.
pub fn keep() -> Kept {
    N_KEPT.fetch_add(1, Ordering::Relaxed);
    Kept(())
}

impl Drop for Kept {
    fn drop(&mut self) {
        N_KEPT.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Sets a cleanup for when the process is ended by force, such as restoring the terminal.
pub fn before_the_end(last: Option<fn()>) {
    *LAST.lock().unwrap_or_else(PoisonError::into_inner) = last;
}

fn start_listening() -> std::io::Result<()> {
    let mut heeded = vec![SIGINT, SIGTERM];
    if !hangups_are_ignored() {
        heeded.push(SIGHUP);
    }
    let mut signals = Signals::new(heeded)?;
    let listening = move || {
        let mut first = None::<Instant>;
        for signal in signals.forever() {
            match first {
                None => {
                    first = Some(Instant::now());
                    ask(128 + signal);
                }
                Some(at) if at.elapsed() < ECHO => {}
                Some(_) => end(128 + signal),
            }
        }
    };
    std::thread::Builder::new().name("signals".into()).spawn(listening).map(drop)
}

/// True if SIGHUP is ignored, because this process was started by `nohup` or similar. Closing the terminal then doesn't
/// end it.
fn hangups_are_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    ignored.is_some_and(|mask| u64::from_str_radix(mask.trim(), 16).is_ok_and(|mask| mask >> (SIGHUP - 1) & 1 == 1))
}

fn ask(code: i32) {
    let _waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
    if !ASKED.swap(true, Ordering::Relaxed) {
        CODE.store(code, Ordering::Relaxed);
        WHEN_ASKED.notify_all();
    }
}

fn end_in_time() {
    let waiting = WAITING.lock().unwrap_or_else(PoisonError::into_inner);
    drop(WHEN_ASKED.wait_while(waiting, |()| !asked()));
    // In slices, so that time in which the process was stopped doesn't count.
    (0..LIMIT.as_millis() / SLICE.as_millis()).for_each(|_| std::thread::sleep(SLICE));
    while N_KEPT.load(Ordering::Relaxed) > 0 {
        std::thread::sleep(SLICE);
    }
    // On a separate thread, because the write to the terminal may block.
    let _ = std::thread::Builder::new().spawn(|| {
        failure().iter().for_each(|why| say(why));
        say(&format!("ended after {LIMIT:?}, because something that this process waits for did not end by itself"));
    });
    std::thread::sleep(SLICE);
    end(CODE.load(Ordering::Relaxed));
}

/// Ends the process without waiting for anything.
fn end(code: i32) -> ! {
    if let Ok(mut last) = LAST.try_lock()
        && let Some(last) = last.take()
    {
        last();
    }
    signal_hook::low_level::exit(code)
}

/// Prints a message to the user. Errors of stderr are ignored.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
