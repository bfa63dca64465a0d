//! Windows that overlap, run as one stretch: the same forces in less time, for replay and evaluation.

use super::contract::Terms;
use super::error::one_line;
use super::info::RuntimeName;
use super::paper;
use super::sequence;
use super::session::{Runtime, Session};
use super::{onnx::GraphProto, onnxruntime, rten};
use crate::fusion::{Contract, Forces, RegressError, Regressor, Windows};

/// Windows of a stretch: with fewer a node costs more than what it computes, with more their states leave the caches.
pub(super) const WINDOWS: usize = 512;

/// Overlapping windows from which on a stretch that is filled up is faster than the windows one by one.
pub(super) const MIN_WINDOWS: usize = 256;

/// Stretches that grow side by side: the regions that share a model.
const MAX_OPEN: usize = 64;

/// A stretch adds in another order than a window alone, as batches of other sizes do.
const TOLERANCE: f32 = 1e-4; // of the largest force of the trial

/// The largest force of the trial counts as at least this, in the model's unit.
const SMALLEST_SCALE: f32 = 0.1;

/// Readings of the trial, one scale after the other: at rest, small, and as large as sensors count.
const TRIAL_SCALES: [f32; 4] = [0.0, 1.0, 50.0, 2000.0];

/// A model that runs stretches where windows overlap, and windows elsewhere.
#[derive(Debug)]
pub(super) struct Stretches {
    windowed: Session,
    stretch: Stretch,
    tactile: Vec<f32>,
    pose: Vec<f32>,
}

/// The network over a stretch.
#[derive(Debug)]
pub(super) struct Stretch {
    runtime: Box<dyn Runtime>,
    tactile: Vec<f32>,
    pose: Vec<f32>,
    /// Forces, and base forces where they are used.
    outputs: Vec<Vec<f32>>,
}

impl Stretch {
    /// The network of a model over stretches, if it is the paper's; `None` if it isn't.
    ///
    /// # Errors
    /// Why it can't be used: this runtime doesn't take it, or it gives other forces.
    pub(super) fn of(
        windowed: &mut Session,
        graph: &GraphProto,
        terms: &Terms,
        runtime: RuntimeName,
    ) -> Result<Option<Self>, String> {
        let Some(paper) = paper::find(graph, terms).filter(sequence::fits) else { return Ok(None) };
        let contract = windowed.contract().clone();
        let bytes = sequence::model(&paper, WINDOWS, contract.has_base);
        let of_stretch = stretch_terms(terms, &contract);
        let runtime: Box<dyn Runtime> = match runtime {
            RuntimeName::OnnxRuntime => Box::new(onnxruntime::open_as_it_is(&bytes, &of_stretch)?),
            RuntimeName::Rten => Box::new(rten::open(&bytes, &of_stretch)?),
        };
        let outputs = vec![Vec::new(); if contract.has_base { 2 } else { 1 }];
        let mut stretch = Stretch { runtime, tactile: Vec::new(), pose: Vec::new(), outputs };
        let trial = Trial::new(&contract);
        let mut alone = Forces::default();
        windowed.run(trial.windows(), &mut alone).map_err(|error| error.to_string())?;
        let mut together = sized(trial.windows().n, contract.has_base);
        let chain: Vec<usize> = (0..trial.windows().n).collect();
        stretch.run(&contract, trial.windows(), &chain, &mut together)?;
        differ(&alone, &together)?;
        Ok(Some(stretch))
    }

    /// Runs windows that follow one another, by their indices: at most [`WINDOWS`].
    fn run(
        &mut self,
        contract: &Contract,
        windows: Windows<'_>,
        chain: &[usize],
        out: &mut Forces,
    ) -> Result<(), String> {
        let window = contract.window;
        let Some(&first) = chain.first() else { return Ok(()) };
        for (stretch, values, width) in
            [(&mut self.tactile, windows.tactile, contract.n_taxels), (&mut self.pose, windows.pose, contract.n_joints)]
        {
            let of = |idx: usize| &values[idx * window * width..(idx + 1) * window * width];
            stretch.clear();
            stretch.extend_from_slice(of(first));
            chain[1..].iter().for_each(|idx| stretch.extend_from_slice(&of(*idx)[(window - 1) * width..]));
            stretch.resize((WINDOWS + window - 1) * width, 0.0);
        }
        self.outputs.iter_mut().for_each(Vec::clear);
        let stretch = Windows { n: 1, tactile: &self.tactile, pose: &self.pose };
        self.runtime.infer(stretch, &mut self.outputs).map_err(|said| one_line(&said))?;
        for (values, forces) in self.outputs.iter().zip([&mut out.force, &mut out.base]) {
            if values.len() != WINDOWS {
                return Err(format!("a stretch of {WINDOWS} windows gave {} forces", values.len()));
            }
            chain.iter().zip(values).for_each(|(idx, value)| forces[*idx] = *value);
        }
        Ok(())
    }
}

impl Stretches {
    /// A model and its network over stretches.
    pub(super) fn new(windowed: Session, stretch: Stretch) -> Self {
        Stretches { windowed, stretch, tactile: Vec::new(), pose: Vec::new() }
    }

    /// Runs windows that no stretch holds.
    fn run_alone(&mut self, windows: Windows<'_>, alone: &[usize], out: &mut Forces) -> Result<(), RegressError> {
        if alone.is_empty() {
            return Ok(());
        }
        let part = |values: &[f32], into: &mut Vec<f32>| {
            let len = values.len() / windows.n;
            into.clear();
            alone.iter().for_each(|idx| into.extend_from_slice(&values[idx * len..(idx + 1) * len]));
        };
        part(windows.tactile, &mut self.tactile);
        part(windows.pose, &mut self.pose);
        let mut forces = Forces::default();
        let windows = Windows { n: alone.len(), tactile: &self.tactile, pose: &self.pose };
        self.windowed.run(windows, &mut forces)?;
        for (from, to) in [(forces.force, &mut out.force), (forces.base, &mut out.base)] {
            alone.iter().zip(from).for_each(|(idx, value)| to[*idx] = value);
        }
        Ok(())
    }
}

impl Regressor for Stretches {
    fn contract(&self) -> &Contract {
        self.windowed.contract()
    }

    fn run(&mut self, windows: Windows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        if windows.n < MIN_WINDOWS {
            return self.windowed.run(windows, out);
        }
        let contract = self.windowed.contract();
        let chains = chains(&windows, contract.n_taxels, contract.n_joints);
        *out = sized(windows.n, contract.has_base);
        let mut alone = Vec::new();
        for chain in &chains {
            for part in chain.chunks(WINDOWS) {
                match part.len() >= MIN_WINDOWS {
                    true => {
                        let ran = self.stretch.run(self.windowed.contract(), windows, part, out);
                        ran.map_err(|said| RegressError(format!("model {}: {said}", self.windowed.label())))?;
                    }
                    false => alone.extend_from_slice(part),
                }
            }
        }
        alone.sort_unstable();
        self.run_alone(windows, &alone, out)
    }
}

/// Room for the forces of so many windows; what isn't written to is no force.
fn sized(n: usize, has_base: bool) -> Forces {
    Forces { force: vec![f32::NAN; n], base: vec![f32::NAN; if has_base { n } else { 0 }] }
}

/// Windows by index, put together where each begins a frame after the one before it.
fn chains(windows: &Windows<'_>, n_taxels: usize, n_joints: usize) -> Vec<Vec<usize>> {
    let (tactile_len, pose_len) = (windows.tactile.len() / windows.n, windows.pose.len() / windows.n);
    let follows = |later: usize, earlier: usize| {
        let overlap = |values: &[f32], len: usize, width: usize| {
            let (earlier, later) =
                (&values[earlier * len..(earlier + 1) * len], &values[later * len..(later + 1) * len]);
            len == 0 || earlier[width..] == later[..len - width]
        };
        overlap(windows.tactile, tactile_len, n_taxels) && overlap(windows.pose, pose_len, n_joints)
    };
    let mut done = Vec::new();
    let mut open: std::collections::VecDeque<Vec<usize>> = std::collections::VecDeque::new();
    for idx in 0..windows.n {
        let found = open.iter().position(|chain| chain.last().is_some_and(|last| follows(idx, *last)));
        // Those that waited longest are looked at first: regions come in turn.
        let mut chain = found.and_then(|found| open.remove(found)).unwrap_or_default();
        chain.push(idx);
        open.push_back(chain);
        if open.len() > MAX_OPEN {
            done.extend(open.pop_front());
        }
    }
    done.extend(open);
    done
}

/// The tensors of the graph over stretches.
fn stretch_terms(terms: &Terms, contract: &Contract) -> Terms {
    let mut of_stretch = Terms { contract: contract.clone(), ..terms.clone() };
    of_stretch.tensors.tactile = sequence::TACTILE.to_owned();
    of_stretch.tensors.pose = terms.tensors.pose.as_ref().map(|_| sequence::POSE.to_owned());
    of_stretch.tensors.force = sequence::FORCE.to_owned();
    of_stretch.tensors.base = contract.has_base.then(|| sequence::BASE.to_owned());
    of_stretch.tensors.residual = None;
    of_stretch
}

/// Whether forces are the same but for rounding; how far apart they are, where they aren't.
fn differ(windows: &Forces, whole: &Forces) -> Result<(), String> {
    let all = |forces: &Forces| forces.force.iter().chain(&forces.base).copied().collect::<Vec<f32>>();
    let (windows, whole) = (all(windows), all(whole));
    let scale = windows.iter().fold(SMALLEST_SCALE, |scale, force| scale.max(force.abs()));
    for (expected, got) in windows.iter().zip(&whole) {
        let distance = (expected - got).abs();
        if distance.is_nan() || distance > TOLERANCE * scale {
            return Err(format!("over a stretch it gives {got} where a window alone gives {expected}"));
        }
    }
    Ok(())
}

/// Overlapping windows of made-up frames, the same at every start.
struct Trial {
    tactile: Vec<f32>,
    pose: Vec<f32>,
}

impl Trial {
    fn new(contract: &Contract) -> Self {
        let mut random = super::probe::Lcg::new();
        let n_frames = MIN_WINDOWS + contract.window - 1;
        let scale = |frame: usize| TRIAL_SCALES[frame * TRIAL_SCALES.len() / n_frames];
        let ranges = contract.pose_range.as_deref().unwrap_or_default();
        let range = |joint: usize| ranges.get(joint).map_or((-0.5, 0.5), |range| (range.min as f32, range.max as f32));
        let frames = |width: usize, value: &mut dyn FnMut(usize, usize) -> f32| -> Vec<f32> {
            let all: Vec<f32> = (0..n_frames)
                .flat_map(|frame| (0..width).map(move |at| (frame, at)))
                .map(|(frame, at)| value(frame, at))
                .collect();
            let of_window = |first: usize| all[first * width..(first + contract.window) * width].iter().copied();
            (0..MIN_WINDOWS).flat_map(of_window).collect()
        };
        let tactile = frames(contract.n_taxels, &mut |frame, _| scale(frame) * random.next_unit());
        let pose = frames(contract.n_joints, &mut |_, joint| {
            let (min, max) = range(joint);
            min + (max - min) * random.next_unit()
        });
        Trial { tactile, pose }
    }

    fn windows(&self) -> Windows<'_> {
        Windows { n: MIN_WINDOWS, tactile: &self.tactile, pose: &self.pose }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_of_several_regions_are_told_apart_and_put_together() {
        // Two regions in turn, windows of three frames of one taxel; the second one has a gap.
        let (a, b) = ([1.0, 2.0, 3.0, 4.0, 5.0], [9.0, 8.0, 7.0, 0.5, 0.6, 0.7]);
        let tactile: Vec<f32> = [&a[0..3], &b[0..3], &a[1..4], &b[3..6], &a[2..5]].concat();
        let windows = Windows { n: 5, tactile: &tactile, pose: &[] };
        let mut found = chains(&windows, 1, 0);
        found.sort();
        assert_eq!(found, [vec![0, 2, 4], vec![1], vec![3]]);
    }
}
