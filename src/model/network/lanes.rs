//! Windows that share no frames with each other. Usually each continues a window of an earlier call by one frame.

use std::ops::Range;

use super::{Known, Network, Scratch};
use crate::fusion::{Forces, SharedWindows, WindowId};

/// Maximum number of windows that are kept: enough for a few hands. Each takes a third of a MiB.
pub(in crate::model) const MOST: usize = 32;

/// State of windows that is kept from call to call.
///
/// # Invariant
/// Kept state changes no force. It is used only for windows that follow those that it was computed from (`model_lanes`).
#[derive(Debug, Default)]
pub(in crate::model) struct Lanes {
    /// The most recently used group comes first, because regions of several tactile sources alternate.
    groups: Vec<Group>,
    scratch: Scratch,
    /// New frames, lanes interleaved.
    tactile: Vec<f32>,
    pose: Vec<f32>,
}

/// Windows that come in the same call.
#[derive(Debug, Default)]
struct Group {
    n: usize,
    /// `[n]`, or empty if nobody said where these windows belong.
    ids: Vec<WindowId>,
    known: Known,
    /// `[n, window, taxels]` and `[n, window, joints]`: in debug builds, which check that windows that follow these have
    /// the same frames. Else empty.
    frames: [Vec<f32>; 2],
}

impl Lanes {
    /// Runs up to [`MOST`] windows.
    pub(in crate::model) fn run(&mut self, network: &Network, windows: SharedWindows<'_>, out: &mut Forces) {
        let (n, window) = (windows.starts.len(), network.window);
        let n_new = match self.groups.iter().position(|group| group.goes_on(windows.ids)) {
            Some(idx) => {
                self.groups[..=idx].rotate_right(1);
                1
            }
            None => {
                self.begin(network, n);
                window
            }
        };
        let Lanes { groups, scratch, tactile, pose } = self;
        let Some(group) = groups.first_mut() else { return };
        debug_assert!(n_new == window || group.keeps_its_frames(network, windows), "frames of a sequence changed");
        side_by_side(windows.tactile, windows.starts, window - n_new..window, network.n_columns, tactile);
        side_by_side(windows.pose, windows.starts, window - n_new..window, network.n_joints, pose);
        network.run(&mut group.known, (tactile, pose), n, scratch, out);
        group.ids.clear();
        group.ids.extend_from_slice(windows.ids);
        if cfg!(debug_assertions) {
            let [tactile, pose] = &mut group.frames;
            one_below_the_other(windows.tactile, windows.starts, window, network.n_columns, tactile);
            one_below_the_other(windows.pose, windows.starts, window, network.n_joints, pose);
        }
    }

    /// Begins a group of `n` windows. If there is no room, it replaces the groups that were not used for longest.
    fn begin(&mut self, network: &Network, n: usize) {
        let mut freed = None;
        while self.groups.iter().map(|group| group.n).sum::<usize>() + n > MOST {
            let Some(group) = self.groups.pop() else { break };
            freed = Some(group);
        }
        let mut group = Group { n, ..freed.unwrap_or_default() };
        network.begin(&mut group.known, n, network.window);
        self.groups.insert(0, group);
    }
}

impl Group {
    /// True if these windows are the group's windows, each moved on by one frame.
    fn goes_on(&self, ids: &[WindowId]) -> bool {
        let mut pairs = ids.iter().zip(&self.ids);
        !ids.is_empty() && ids.len() == self.ids.len() && pairs.all(|(id, earlier)| id.follows(earlier))
    }

    /// True if windows that follow the group's have its frames, bit by bit.
    fn keeps_its_frames(&self, network: &Network, windows: SharedWindows<'_>) -> bool {
        let Network { window, n_columns, n_joints, .. } = *network;
        let [tactile, pose] = &self.frames;
        let same = |kept: &[f32], frames: &[f32], width: usize| {
            let kept = kept.chunks_exact((window * width).max(1));
            kept.zip(windows.starts)
                .all(|(kept, start)| same_bits(&kept[width..], &frames[start * width..][..(window - 1) * width]))
        };
        same(tactile, windows.tactile, n_columns) && same(pose, windows.pose, n_joints)
    }
}

/// True if two slices have the same bits. Unlike `==`, this distinguishes 0 from -0 and finds NaN equal to itself.
fn same_bits(a: &[f32], b: &[f32]) -> bool {
    bytemuck::cast_slice::<f32, u32>(a) == bytemuck::cast_slice::<f32, u32>(b)
}

/// Some frames of every window, as `[frames, N, width]`.
fn side_by_side(frames: &[f32], starts: &[usize], of_window: Range<usize>, width: usize, out: &mut Vec<f32>) {
    out.clear();
    for frame in of_window {
        starts.iter().for_each(|start| out.extend_from_slice(&frames[(start + frame) * width..][..width]));
    }
}

/// All frames of every window, as `[N, window, width]`.
fn one_below_the_other(frames: &[f32], starts: &[usize], window: usize, width: usize, out: &mut Vec<f32>) {
    out.clear();
    starts.iter().for_each(|start| out.extend_from_slice(&frames[start * width..][..window * width]));
}
