//! Runs the paper's network, or the causal network of adaptive models, in the built-in code: the same forces as a runtime,
//! in less time.
//!
//! Windows that share no frames, such as the newest windows of several regions, become lanes of the network. Many
//! overlapping windows are split into stretches, which run on several threads.

use std::num::NonZeroUsize;
use std::ops::Range;
use std::sync::Mutex;

use super::Own;
use super::comparison::compare;
use super::network::lanes::{self, Lanes};
use super::network::{Known, Network, Scratch};
use super::session::{InferenceSession, check};
use crate::fusion::{Contract, Forces, RegressError, Regressor, SharedWindows};

/// Maximum number of frames of a stretch in which windows may begin.
const SPAN: usize = 256;

/// Number of windows per call beyond which there is no further gain: one stretch for each of 16 threads.
pub(super) const WINDOWS_AT_ONCE: NonZeroUsize = NonZeroUsize::new(16 * SPAN).expect("a span has windows");

/// Maximum step between windows of a stretch, frames. With a larger step, a new stretch is cheaper.
const MAX_STEP: usize = 4;

/// A model that the built-in code runs.
///
/// # Invariant
/// A window's force has the same bits for any other windows in the same call, any earlier calls, and any number of
/// threads: `model_stretches::any_company_and_any_number_of_threads_give_the_same_bits`,
/// `model_lanes::windows_that_come_frame_by_frame_give_the_bits_of_a_stretch`.
#[derive(Debug)]
pub(super) struct Builtin {
    contract: Contract,
    label: String,
    network: Network,
    lanes: Lanes,
    n_threads: usize,
}

/// A stretch that waits for a thread, and the slices for its results.
struct Job<'a> {
    windows: SharedWindows<'a>,
    force: &'a mut [f32],
    /// Empty if the model has no base.
    base: &'a mut [f32],
    /// Empty if the model has no touch output.
    touch: &'a mut [f32],
}

/// Buffers of a thread that runs stretches.
#[derive(Debug, Default)]
struct Worker {
    known: Known,
    scratch: Scratch,
    forces: Forces,
}

impl Builtin {
    /// A model that runs in the built-in code, with up to `n_threads` threads for stretches.
    ///
    /// # Errors
    /// Why the built-in code can't run it: its windows are too short, or its forces differ from those of the runtime.
    pub(super) fn of(runtime: &mut InferenceSession, own: &Own, n_threads: usize) -> Result<Self, String> {
        let contract = runtime.contract().clone();
        let network = match own {
            Own::Paper(paper) => Network::new(paper, contract.n_taxels, contract.n_joints),
            Own::Causal(causal) => Some(Network::causal(causal)),
        };
        let network = network.ok_or_else(|| format!("a window of {} frames is too short for it", contract.window))?;
        let label = runtime.label().to_owned();
        let mut builtin = Builtin { contract, label, network, lanes: Lanes::default(), n_threads };
        compare(&mut builtin, runtime)?;
        Ok(builtin)
    }
}

impl Regressor for Builtin {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        check(windows, &self.contract).map_err(|said| RegressError(format!("model {}: {said}", self.label)))?;
        let n = windows.starts.len();
        if (1..=lanes::MOST).contains(&n) && parts(windows.starts).all(|part| part.len() == 1) {
            self.lanes.run(&self.network, windows, out);
            if !self.contract.has_base {
                out.base.clear();
            }
        } else {
            self.run_in_stretches(windows, out);
        }
        Ok(())
    }
}

impl Builtin {
    fn run_in_stretches(&self, windows: SharedWindows<'_>, out: &mut Forces) {
        let n = windows.starts.len();
        let n_base = if self.contract.has_base { n } else { 0 };
        let n_touch = if self.contract.touch.is_some() { n } else { 0 };
        for (forces, n) in [(&mut out.force, n), (&mut out.base, n_base), (&mut out.touch, n_touch)] {
            forces.clear();
            forces.resize(n, f32::NAN); // an output that is not written stays NaN
        }
        let (mut force, mut base) = (out.force.as_mut_slice(), out.base.as_mut_slice());
        let mut touch = out.touch.as_mut_slice();
        let jobs = parts(windows.starts).map(|part| {
            let n = part.len();
            let windows = SharedWindows { starts: &windows.starts[part], ids: &[], ..windows };
            Job { windows, force: take(&mut force, n), base: take(&mut base, n), touch: take(&mut touch, n) }
        });
        self.run_side_by_side(jobs.collect());
    }

    /// Runs every job once.
    fn run_side_by_side(&self, jobs: Vec<Job<'_>>) {
        let n_threads = self.n_threads.min(jobs.len());
        let waiting = Mutex::new(jobs.into_iter());
        let work = || {
            let mut worker = Worker::default();
            let next = || waiting.lock().ok().and_then(|mut waiting| waiting.next());
            while let Some(job) = next() {
                self.run_stretch(job, &mut worker);
            }
        };
        std::thread::scope(|scope| {
            (1..n_threads).for_each(|_| {
                scope.spawn(work);
            });
            work();
        });
    }

    fn run_stretch(&self, job: Job<'_>, worker: &mut Worker) {
        let Job { windows: SharedWindows { starts, tactile, pose, .. }, force, base, touch } = job;
        let (Some(&first), Some(&last)) = (starts.first(), starts.last()) else { return };
        let Contract { window, n_joints, .. } = self.contract;
        let n_columns = self.contract.n_columns();
        let n_frames = last + window.get() - first;
        let frames = |values: &'_ [f32], width: usize| first * width..((last + window.get()) * width).min(values.len());
        let frames = (&tactile[frames(tactile, n_columns)], &pose[frames(pose, n_joints)]);
        let Worker { known, scratch, forces } = worker;
        self.network.begin(known, 1, n_frames);
        self.network.run(known, frames, last - first + 1, scratch, forces);
        for (values, forces) in [(&forces.force, force), (&forces.base, base), (&forces.touch, touch)] {
            let given = starts.iter().map(|start| values.get(start - first).copied().unwrap_or(f32::NAN));
            forces.iter_mut().zip(given).for_each(|(force, given)| *force = given);
        }
    }
}

/// Groups windows, by index, whose starts are at most `MAX_STEP` apart.
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

/// Removes up to `n` elements from the front of a slice.
fn take<'a>(rest: &mut &'a mut [f32], n: usize) -> &'a mut [f32] {
    let all = std::mem::take(rest);
    let (taken, left) = all.split_at_mut(n.min(all.len()));
    *rest = left;
    taken
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
