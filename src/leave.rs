//! When this process is to end, and that it then does: a signal, its time that is over, or a part that it can't do without.
//!
//! A first SIGINT, SIGTERM or SIGHUP is noted, and whoever works looks at [`asked`] and ends in order. A second one ends the
//! process at once. What talks to a graph asks for [`in_time`] besides: whatever it waits for then, it doesn't wait for long.

use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, Once, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// How long a process with [`in_time`] has to end by itself.
const LIMIT: Duration = Duration::from_millis(1800);

/// Between looks at whether it is time.
const SLICE: Duration = Duration::from_millis(20);

/// A signal that comes so soon after the first is the same one, passed on by a shell or a launcher.
const ECHO: Duration = Duration::from_millis(100);

/// Exit code of a process that had to be ended without a signal.
const FAILED: i32 = 1;

static ASKED: AtomicBool = AtomicBool::new(false);
static WHEN_ASKED: Condvar = Condvar::new();
static WAITING: Mutex<()> = Mutex::new(());
/// Exit code when it must be ended: 128 and the number of the first signal.
static CODE: AtomicI32 = AtomicI32::new(FAILED);
static FAILURE: OnceLock<String> = OnceLock::new();
static N_KEPT: AtomicUsize = AtomicUsize::new(0);
static LAST: Mutex<Option<fn()>> = Mutex::new(None);

/// From now on a signal to end is noted instead of ending the process at once.
pub fn listen() {
    static LISTENING: Once = Once::new();
    LISTENING.call_once(|| {
        if let Err(error) = start_listening() {
            say(&format!("signals end this run at once, and may leave a hidden temporary file: {error}"));
        }
    });
}

/// True if this process is to end.
pub fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}

/// Flag that is set when this process is to end, for work that polls.
pub fn flag() -> &'static AtomicBool {
    &ASKED
}

/// Asks this process to end, because something that it can't do without has failed. The first reason counts.
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

/// From now on this process ends within two seconds after it was asked to, even where a network, a subscriber or a request
/// holds it. Work that must not be cut off calls [`keep`].
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

/// As long as it is there, only a second signal ends the process.
#[derive(Debug)]
pub struct Kept(());

/// Keeps the process from being ended by its limit of time: what a recording needs to become complete.
pub fn keep() -> Kept {
    N_KEPT.fetch_add(1, Ordering::Relaxed);
    Kept(())
}

impl Drop for Kept {
    fn drop(&mut self) {
        N_KEPT.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Cleanup before the process is ended at once, such as giving back a terminal.
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

/// True if this process was started by `nohup` or the like: then a terminal that is closed doesn't concern it.
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
    // In slices, so that time in which the process itself was stopped doesn't count.
    (0..LIMIT.as_millis() / SLICE.as_millis()).for_each(|_| std::thread::sleep(SLICE));
    while N_KEPT.load(Ordering::Relaxed) > 0 {
        std::thread::sleep(SLICE);
    }
    // On a thread of its own, because it may be a terminal that holds the process.
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

/// Prints a message to the user at the terminal; a closed stderr is ignored.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
