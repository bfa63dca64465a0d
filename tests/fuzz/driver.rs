//! Runs a target on inputs made from its seeds.
//!
//! An input whose answer is of a new kind becomes a seed itself, which takes the place of coverage: that would need a
//! nightly compiler.

use std::collections::BTreeSet;
use std::fs;
use std::hash::{DefaultHasher, Hasher as _};
use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::mutate::Random;

/// Longest that one input may take, with a machine that does other things besides.
const MAX_TIME: Duration = Duration::from_secs(10);
/// The same, where it doesn't compute, but waits for something.
const MAX_WAIT: Duration = Duration::from_secs(600);
/// Most memory that one input may take, and per byte of it: a YAML tree is much larger than its text.
const MAX_BYTES: u64 = 48 << 20;
const MAX_BYTES_PER_BYTE: u64 = 1000;
/// Longest input that becomes a seed.
const MAX_SEED_BYTES: usize = 64 << 10;
const MAX_SEEDS: usize = 2000;
/// Seed of the inputs of `cargo test`.
const SEED: u64 = 20_261_122;

/// One function of bytes, and how its inputs are made.
pub struct Target {
    pub name: &'static str,
    /// Whole inputs, most of which are understood.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Another input out of one seed and parts of a second.
    pub mutate: fn(&mut Random, &[u8], &[u8]) -> Vec<u8>,
    /// Panics where a promise is broken.
    pub run: fn(&[u8]) -> Answer,
    /// Smallest share of inputs that must be understood: less would mean that nothing behind the first check is tried.
    pub min_understood: f64,
}

/// What became of an input.
pub struct Answer {
    understood: bool,
    /// What tells this answer from others, for the choice of new seeds.
    kind: u64,
}

impl Answer {
    pub fn understood(kind: &impl std::hash::Hash) -> Self {
        Answer { understood: true, kind: hash(kind) }
    }

    /// Refused with this text, whose numbers and quoted names tell nothing new.
    pub fn refused(text: &str) -> Self {
        let mut kind = String::new();
        for (idx, part) in text.split(['"', '\'', '`']).enumerate() {
            if idx % 2 == 0 {
                kind.extend(part.chars().filter(|c| c.is_ascii_alphabetic() || *c == ' ').take(120));
            }
        }
        Answer { understood: false, kind: hash(&kind) }
    }
}

fn hash(value: &impl std::hash::Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}

/// Runs `n` inputs; as long as `TPF_FUZZ_MINUTES` says, or the file `TPF_FUZZ_INPUT` alone, where they are set.
pub fn run(target: &Target, n: u64) {
    run_part(target, n, 0);
}

/// The same for one of several parts of the inputs, which run at the same time.
pub fn run_part(target: &Target, n: u64, part: u64) {
    if let Some(path) = std::env::var_os("TPF_FUZZ_INPUT") {
        let input = fs::read(&path).expect("TPF_FUZZ_INPUT is a file");
        let understood = (target.run)(&input).understood;
        say(&format!("{}: {} bytes, understood: {understood}", target.name, input.len()));
        return;
    }
    for path in kept(target.name) {
        (target.run)(&fs::read(path).unwrap());
    }
    let number = |key| std::env::var(key).ok().map(|text: String| text.parse::<f64>().expect(key));
    let minutes = number("TPF_FUZZ_MINUTES");
    let seed = number("TPF_FUZZ_SEED").map_or(SEED, |seed| seed as u64).wrapping_add(part);
    let until = minutes.map(|minutes| Instant::now() + Duration::from_secs_f64(60.0 * minutes));
    let mut fuzzer = Fuzzer::new(target, seed, minutes.is_some());
    let started = Instant::now();
    while until.map_or(fuzzer.n < n, |until| Instant::now() < until) {
        fuzzer.step();
    }
    if minutes.is_some() {
        fuzzer.tell(started.elapsed());
    }
    let share = fuzzer.n_understood as f64 / fuzzer.n as f64;
    assert!(share >= target.min_understood, "only {share:.3} of the inputs are understood");
}

/// Inputs that broke something once, each named by what it broke.
fn kept(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/fuzz").join(target);
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

struct Fuzzer<'t> {
    target: &'t Target,
    random: Random,
    seeds: Vec<Vec<u8>>,
    /// Inputs with answers of a new kind: those that were understood, and those that were refused.
    found: [Vec<Vec<u8>>; 2],
    kinds: BTreeSet<u64>,
    n: u64,
    n_understood: u64,
    slowest: Duration,
    most_bytes: u64,
    running: Arc<Running>,
    /// Where each input is kept before it is run, so that a crash of the whole process leaves it.
    current: Option<PathBuf>,
    seed: u64,
}

/// What the watchdog looks at.
#[derive(Default)]
struct Running {
    input: Mutex<Option<(Instant, Vec<u8>)>>,
    over: AtomicBool,
}

impl Drop for Fuzzer<'_> {
    fn drop(&mut self) {
        self.running.over.store(true, Ordering::Relaxed);
    }
}

impl<'t> Fuzzer<'t> {
    fn new(target: &'t Target, seed: u64, long: bool) -> Self {
        let running = Arc::new(Running::default());
        watch(target.name, Arc::clone(&running));
        let current = long.then(|| in_memory().join(format!("tpf-fuzz-{}.current", target.name)));
        Fuzzer {
            target,
            random: Random::new(seed),
            seeds: (target.seeds)(),
            found: Default::default(),
            kinds: BTreeSet::new(),
            n: 0,
            n_understood: 0,
            slowest: Duration::ZERO,
            most_bytes: 0,
            running,
            current,
            seed,
        }
    }

    fn step(&mut self) {
        // The seeds come first, as they are.
        let input = match self.seeds.get(self.n as usize) {
            Some(seed) => seed.clone(),
            None => {
                let (seed, other) = (self.pick(), self.pick());
                (self.target.mutate)(&mut self.random, &seed, &other)
            }
        };
        if let Some(current) = &self.current {
            fs::write(current, &input).unwrap();
        }
        let started = Instant::now();
        *self.running.input.lock().unwrap() = Some((started, input.clone()));
        let mut answer = None;
        let used = allocation_counter::measure(|| {
            answer = Some(catch_unwind(AssertUnwindSafe(|| (self.target.run)(&input))));
        });
        *self.running.input.lock().unwrap() = None;
        let Some(Ok(answer)) = answer else { fail(self.target.name, &input, "it panicked") };
        if used.bytes_max > MAX_BYTES + MAX_BYTES_PER_BYTE * input.len() as u64 {
            fail(self.target.name, &input, &format!("{} bytes took {} bytes of memory", input.len(), used.bytes_max));
        }
        self.n += 1;
        self.n_understood += u64::from(answer.understood);
        self.slowest = self.slowest.max(started.elapsed());
        self.most_bytes = self.most_bytes.max(used.bytes_max);
        let found = &mut self.found[usize::from(!answer.understood)];
        if self.kinds.insert(answer.kind) && input.len() <= MAX_SEED_BYTES && found.len() < MAX_SEEDS {
            found.push(input);
        }
    }

    /// What the next input is made of: most often something that was understood.
    fn pick(&mut self) -> Vec<u8> {
        let from = match self.random.below(10) {
            0 => &self.found[1],
            1..=5 => &self.found[0],
            _ => &self.seeds,
        };
        self.random.pick(if from.is_empty() { &self.seeds } else { from }).clone()
    }

    fn tell(&self, elapsed: Duration) {
        say(&format!(
            "{}: {} inputs, {:.0} a second, {:.1} % understood, {} kinds of answers, slowest {:.0} ms, most memory {:.1} MiB, seed {}",
            self.target.name,
            self.n,
            self.n as f64 / elapsed.as_secs_f64(),
            100.0 * self.n_understood as f64 / self.n as f64,
            self.kinds.len(),
            self.slowest.as_secs_f64() * 1e3,
            self.most_bytes as f64 / f64::from(1 << 20),
            self.seed
        ));
    }
}

/// Says it past the test runner's capture.
fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Keeps the input, and tells how to run it again.
fn fail(target: &str, input: &[u8], why: &str) -> ! {
    let path = folder().join(format!("{target}-{:016x}", hash(&input)));
    let kept = fs::write(&path, input).map_or_else(|error| error.to_string(), |()| path.display().to_string());
    panic!("{target}: {why}; run it again with: TPF_FUZZ_INPUT={kept} cargo test --test fuzz {target}")
}

/// Where inputs are kept that broke something.
fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// Where files are written fastest, if there is such a place.
fn in_memory() -> PathBuf {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() }
}

/// Ends the process when an input takes too long: nothing else can stop it.
fn watch(target: &'static str, running: Arc<Running>) {
    std::thread::spawn(move || {
        let mut since = (Instant::now(), computed());
        while !running.over.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(200));
            let Some((started, input)) = running.input.lock().unwrap().clone() else { continue };
            if since.0 != started {
                since = (started, computed());
            }
            // On a machine that does other things it may get no turn for long: then it hasn't computed for long either.
            let is_late = started.elapsed() > MAX_TIME && computed().saturating_sub(since.1) > MAX_TIME / 2;
            if is_late || started.elapsed() > MAX_WAIT {
                let _ = catch_unwind(|| fail(target, &input, "it takes too long"));
                std::process::abort();
            }
        }
    });
}

/// How long this process has computed, in all of its threads; as long as can be where the machine doesn't say.
fn computed() -> Duration {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let behind_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let ticks = |field: usize| behind_name.split_whitespace().nth(field).and_then(|ticks| ticks.parse::<u64>().ok());
    // utime and stime, the 14th and 15th field of proc_pid_stat(5), in hundredths of a second.
    ticks(11).zip(ticks(12)).map_or(Duration::MAX, |(user, system)| Duration::from_millis(10 * (user + system)))
}

/// A file that holds the bytes, of a name of its own; each thread has one.
pub fn file_of(name: &str, bytes: &[u8]) -> PathBuf {
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir_in(in_memory()).expect("a temporary folder can be made");
    }
    // Targets run side by side, and some give their files the same names.
    let path = FOLDER.with(|folder| folder.path().join(name));
    fs::write(&path, bytes).unwrap();
    path
}
