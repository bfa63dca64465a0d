//! Windows that wait for their model. Frames that they share are kept once.

use std::collections::VecDeque;

use super::features::NewestWindow;
use super::regressor::{ForceAxes, ForceUnit, Forces, FrameSequence, RegressError, Regressor, SharedWindows, WindowId};
use crate::units::Newton;

/// Windows of one model that wait to be run, region by region in the order of their frames.
#[derive(Debug)]
pub(super) struct ModelQueue {
    pub(super) regressor: Box<dyn Regressor>,
    lanes: Vec<Lane>,
    starts: Vec<usize>,
    ids: Vec<WindowId>,
    tactile: Vec<f32>,
    pose: Vec<f32>,
    forces: Forces,
}

/// Model output for one window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answer {
    pub(super) force: ModelForce,
    /// Of the tactile branch alone.
    pub(super) base: Option<ModelForce>,
    /// Probability of touch.
    pub(super) touch: Option<f64>,
}

/// A force as a model gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ModelForce {
    /// The normal force.
    Normal(Newton),
    /// x, y, z in the patch's own frame.
    Patch([Newton; 3]),
}

impl ModelForce {
    /// That of the window at `idx`.
    fn at(forces: &[f32], idx: usize, axes: ForceAxes, unit: ForceUnit) -> Option<Self> {
        let start = idx * axes.n();
        match (axes, forces.get(start..start + axes.n())?) {
            (ForceAxes::Patch, &[x, y, z]) => Some(ModelForce::Patch([x, y, z].map(|force| unit.to_newton(force)))),
            (_, forces) => forces.first().map(|&force| ModelForce::Normal(unit.to_newton(force))),
        }
    }
}

/// The frames of one region, and the windows in them that wait.
///
/// # Invariant
/// Frames are only added, and a window holds only frames that were added one after the other. What makes a region forget
/// its frames (a gap, a jump of time, a new baseline) therefore leads to windows further on in the same sequence:
/// `fusion_windows::a_window_follows_another_only_if_all_its_frames_but_one_are_the_same`.
#[derive(Debug, Default)]
struct Lane {
    sequence: FrameSequence,
    /// Frames before the first one that is still kept.
    n_gone: usize,
    n_frames: usize,
    tactile: Vec<f32>,
    pose: Vec<f32>,
    /// The first frame of each window, counted from the begin of the lane.
    starts: VecDeque<usize>,
    /// Windows of the next run.
    n_due: usize,
    /// Place of the next force to hand out.
    next_force: usize,
}

impl ModelQueue {
    pub(super) fn new(regressor: Box<dyn Regressor>) -> Self {
        let (starts, ids, tactile, pose) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        ModelQueue { regressor, lanes: Vec::new(), starts, ids, tactile, pose, forces: Forces::default() }
    }

    /// A lane for one more region.
    pub(super) fn add_lane(&mut self) -> usize {
        self.lanes.push(Lane::default());
        self.lanes.len() - 1
    }

    /// Queues the newest window of a lane's region.
    pub(super) fn push(&mut self, lane: usize, newest: NewestWindow<'_>) {
        let window = self.regressor.contract().window.get();
        self.lanes[lane].push(newest, window);
    }

    /// Says that the next run takes one more window of a lane.
    pub(super) fn make_due(&mut self, lane: usize) {
        self.lanes[lane].n_due += 1;
    }

    /// Runs what is due and forgets it; [`ModelQueue::pop`] gives the forces one by one.
    pub(super) fn run(&mut self) -> Result<(), RegressError> {
        let ModelQueue { regressor, lanes, starts, ids, tactile, pose, forces } = self;
        let window = regressor.contract().window.get();
        starts.clear();
        ids.clear();
        tactile.clear();
        pose.clear();
        forces.clear();
        let mut n_frames = 0;
        for lane in lanes {
            lane.next_force = starts.len();
            let Some((first, last)) = lane.n_due.checked_sub(1).and_then(|last| lane.due(last)) else { continue };
            let frames = first..last + window;
            tactile.extend_from_slice(lane.frames(&lane.tactile, frames.clone()));
            pose.extend_from_slice(lane.frames(&lane.pose, frames.clone()));
            for start in lane.starts.drain(..lane.n_due) {
                starts.push(n_frames + start - first);
                ids.push(lane.sequence.window(start));
            }
            n_frames += frames.len();
            lane.n_due = 0;
            lane.forget(window);
        }
        if starts.is_empty() {
            return Ok(());
        }
        regressor.run(SharedWindows { starts, ids, tactile, pose }, forces)
    }

    /// The model's answer for the next window of a lane, of those that were run.
    pub(super) fn pop(&mut self, lane: usize) -> Option<Answer> {
        let (unit, axes) = (self.regressor.contract().unit, self.regressor.contract().axes);
        let idx = self.lanes[lane].next_force;
        self.lanes[lane].next_force += 1;
        let force = ModelForce::at(&self.forces.force, idx, axes, unit)?;
        let base = ModelForce::at(&self.forces.base, idx, axes, unit);
        Some(Answer { force, base, touch: self.forces.touch.get(idx).map(|&touch| f64::from(touch)) })
    }
}

impl Lane {
    fn push(&mut self, newest: NewestWindow<'_>, window: usize) {
        let n_known = window - newest.n_new.min(window);
        let new = |values| {
            let values: &[f32] = values;
            &values[values.len() / window * n_known..]
        };
        self.tactile.extend_from_slice(new(newest.tactile));
        self.pose.extend_from_slice(new(newest.pose));
        self.n_frames += window - n_known;
        self.starts.push_back(self.n_gone + self.n_frames - window);
    }

    /// First frames of the first window that waits, and of the one at `last`.
    fn due(&self, last: usize) -> Option<(usize, usize)> {
        Some((*self.starts.front()?, *self.starts.get(last)?))
    }

    fn frames<'v>(&self, values: &'v [f32], frames: std::ops::Range<usize>) -> &'v [f32] {
        let width = values.len() / self.n_frames;
        &values[(frames.start - self.n_gone) * width..(frames.end - self.n_gone) * width]
    }

    /// Lets go of the frames that no window holds any more, those that wait and the next one.
    fn forget(&mut self, window: usize) {
        let newest = self.n_gone + self.n_frames - window;
        let n = self.starts.front().map_or(newest, |&start| start) - self.n_gone;
        for values in [&mut self.tactile, &mut self.pose] {
            let width = values.len() / self.n_frames;
            values.drain(..n * width);
        }
        self.n_gone += n;
        self.n_frames -= n;
    }
}
