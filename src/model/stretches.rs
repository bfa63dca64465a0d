//! Windows that overlap, run as stretches: the same forces in less time, for replay and evaluation.

use std::ops::Range;
use std::sync::Mutex;

use super::contract::Terms;
use super::network::{Network, Outputs};
use super::onnx::GraphProto;
use super::paper;
use super::session::{Session, check};
use crate::fusion::{Contract, Forces, RegressError, Regressor, SharedWindows};

/// Windows of one call from which on stretches gain much.
pub(super) const MIN_WINDOWS: usize = 256;

/// Frames of a stretch that windows may begin in.
const SPAN: usize = 256;

/// Windows of one call that gains all there is to gain: it holds enough stretches for many threads.
pub(super) const WINDOWS_AT_ONCE: usize = MOST_THREADS * SPAN;

/// Threads beyond which there is nothing to gain.
pub(super) const MOST_THREADS: usize = 16;

/// Steps from window to window that a stretch goes on over; a longer one costs more than a stretch that begins anew.
const MAX_STEP: usize = 4;

/// Windows of the trial.
const N_TRIAL: usize = 256;

/// A stretch adds in another order than a runtime does.
const TOLERANCE: f32 = 1e-4; // of the largest force of the trial

/// The largest force of the trial counts as at least this, in the model's unit.
const SMALLEST_SCALE: f32 = 0.1;

/// Readings of the trial, one scale after the other: at rest, small, and as large as sensors count.
const TRIAL_SCALES: [f32; 4] = [0.0, 1.0, 50.0, 2000.0];

/// A model whose windows are run in stretches.
///
/// # Invariant
/// A window has the same force, bit by bit, whichever windows are run with it and on however many threads:
/// `model_stretches::any_company_and_any_number_of_threads_give_the_same_bits`.
#[derive(Debug)]
pub(super) struct Stretches {
    contract: Contract,
    label: String,
    network: Network,
    n_threads: usize,
}

/// A stretch that waits for a thread, and the place of its forces.
struct Job<'a> {
    windows: SharedWindows<'a>,
    force: &'a mut [f32],
    /// Empty for a model without a base.
    base: &'a mut [f32],
}

impl Stretches {
    /// A model in stretches on so many threads, if it is the paper's network; `None` if it isn't.
    ///
    /// # Errors
    /// Why it can't be run so, where one would expect it: it gives other forces then.
    pub(super) fn of(
        windowed: &mut Session,
        graph: &GraphProto,
        terms: &Terms,
        n_threads: usize,
    ) -> Result<Option<Self>, String> {
        let contract = windowed.contract().clone();
        let found = paper::find(graph, terms);
        let network = found.and_then(|paper| Network::new(&paper, contract.n_taxels, contract.n_joints));
        let Some(network) = network else { return Ok(None) };
        let mut stretches = Stretches { contract, label: windowed.label().to_owned(), network, n_threads };
        let trial = Trial::new(&stretches.contract);
        let (mut alone, mut together) = (Forces::default(), Forces::default());
        let ran = windowed.run(trial.windows(), &mut alone);
        ran.and_then(|()| stretches.run(trial.windows(), &mut together)).map_err(|error| error.to_string())?;
        differ(&alone, &together).map(|()| Some(stretches))
    }
}

impl Regressor for Stretches {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        check(windows, &self.contract).map_err(|said| RegressError(format!("model {}: {said}", self.label)))?;
        let n = windows.starts.len();
        // What isn't written to is no force.
        *out = Forces { force: vec![f32::NAN; n], base: vec![f32::NAN; if self.contract.has_base { n } else { 0 }] };
        let (mut force, mut base) = (out.force.as_mut_slice(), out.base.as_mut_slice());
        let jobs = parts(windows.starts).map(|part| {
            let n = part.len();
            let windows = SharedWindows { starts: &windows.starts[part], ..windows };
            Job { windows, force: take(&mut force, n), base: take(&mut base, n) }
        });
        self.run_side_by_side(jobs.collect());
        Ok(())
    }
}

impl Stretches {
    /// Runs every job once.
    fn run_side_by_side(&self, jobs: Vec<Job<'_>>) {
        let n_threads = self.n_threads.min(jobs.len());
        let waiting = Mutex::new(jobs.into_iter());
        let work = || {
            let mut outputs = Outputs::default();
            let next = || waiting.lock().ok().and_then(|mut waiting| waiting.next());
            while let Some(job) = next() {
                self.run_stretch(job, &mut outputs);
            }
        };
        std::thread::scope(|scope| {
            (1..n_threads).for_each(|_| {
                scope.spawn(work);
            });
            work();
        });
    }

    fn run_stretch(&self, job: Job<'_>, outputs: &mut Outputs) {
        let Job { windows: SharedWindows { starts, tactile, pose }, force, base } = job;
        let (Some(&first), Some(&last)) = (starts.first(), starts.last()) else { return };
        let Contract { window, n_taxels, n_joints, .. } = self.contract;
        let frames = |values: &'_ [f32], width: usize| first * width..((last + window) * width).min(values.len());
        self.network.run(&tactile[frames(tactile, n_taxels)], &pose[frames(pose, n_joints)], outputs);
        for (values, forces) in [(&outputs.force, force), (&outputs.base, base)] {
            let given = starts.iter().map(|start| values.get(start - first).copied().unwrap_or(f32::NAN));
            forces.iter_mut().zip(given).for_each(|(force, given)| *force = given);
        }
    }
}

/// Windows by their index, those together that follow one another closely.
fn parts(starts: &[usize]) -> impl Iterator<Item = Range<usize>> {
    let mut from = 0;
    std::iter::from_fn(move || {
        let first = *starts.get(from)?;
        let goes_on = |pair: &&[usize]| pair[1] - pair[0] <= MAX_STEP && pair[1] - first < SPAN;
        let part = from..from + 1 + starts[from..].windows(2).take_while(goes_on).count();
        from = part.end;
        Some(part)
    })
}

/// Takes up to `n` from the front of a slice.
fn take<'a>(rest: &mut &'a mut [f32], n: usize) -> &'a mut [f32] {
    let all = std::mem::take(rest);
    let (taken, left) = all.split_at_mut(n.min(all.len()));
    *rest = left;
    taken
}

/// Whether forces are the same but for rounding; how far apart they are, where they aren't.
fn differ(windows: &Forces, whole: &Forces) -> Result<(), String> {
    let all = |forces: &Forces| forces.force.iter().chain(&forces.base).copied().collect::<Vec<f32>>();
    let (windows, whole) = (all(windows), all(whole));
    let scale = windows.iter().fold(SMALLEST_SCALE, |scale, force| scale.max(force.abs()));
    for (expected, got) in windows.iter().zip(&whole) {
        let distance = (expected - got).abs();
        if distance.is_nan() || distance > TOLERANCE * scale {
            return Err(format!("in stretches it gives {got} where a window alone gives {expected}"));
        }
    }
    Ok(())
}

/// Overlapping windows of made-up frames, the same at every start.
struct Trial {
    starts: Vec<usize>,
    tactile: Vec<f32>,
    pose: Vec<f32>,
}

impl Trial {
    fn new(contract: &Contract) -> Self {
        let mut random = super::probe::Lcg::new();
        let n_frames = N_TRIAL + contract.window - 1;
        let scale = |frame: usize| TRIAL_SCALES[frame * TRIAL_SCALES.len() / n_frames];
        let ranges = contract.pose_range.as_deref().unwrap_or_default();
        let range = |joint: usize| ranges.get(joint).map_or((-0.5, 0.5), |range| (range.min as f32, range.max as f32));
        let tactile = (0..n_frames * contract.n_taxels).map(|at| scale(at / contract.n_taxels) * random.next_unit());
        let tactile = tactile.collect();
        let pose = (0..n_frames * contract.n_joints).map(|at| {
            let (min, max) = range(at % contract.n_joints);
            min + (max - min) * random.next_unit()
        });
        Trial { starts: (0..N_TRIAL).collect(), tactile, pose: pose.collect() }
    }

    fn windows(&self) -> SharedWindows<'_> {
        SharedWindows { starts: &self.starts, tactile: &self.tactile, pose: &self.pose }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_go_together_by_where_they_begin() {
        let parts = |starts: &[usize]| parts(starts).collect::<Vec<_>>();
        assert!(parts(&[]).is_empty());
        assert_eq!(parts(&[5, 5 + SPAN]), [0..1, 1..2]);
        assert_eq!(parts(&[5, 6, 6 + MAX_STEP, 7 + 2 * MAX_STEP]), [0..3, 3..4]);
        let all: Vec<usize> = (0..2 * SPAN + 1).collect();
        assert_eq!(parts(&all), [0..SPAN, SPAN..2 * SPAN, 2 * SPAN..2 * SPAN + 1]);
    }
}
