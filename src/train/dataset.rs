//! Sessions in memory, and the windows cut from them.
//!
//! A window is only an index until its batch is assembled: overlapping windows share their frames.

use std::ops::Range;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::error::DatasetError;
use crate::eval::Part;
use crate::fusion::PoseRange;

mod batch;
mod session;

pub use batch::{Batch, smoothed_change};
pub use session::{Session, SessionFrames};

/// Touch is true force at or above this, gF (paper, Sec. VI-A: all zero-load truth lies below).
pub const TOUCH_GF: f32 = 2.5;

/// The largest true force is at least this, gF: noise of a force sensor that nobody presses is less.
const LEAST_PRESS_GF: f32 = 10.0;

/// Settings for cutting windows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowSpec {
    /// Frames per window; the paper's is 64.
    pub window: usize,
    /// Frames from one training window to the next; the paper's is 1.
    pub stride: usize,
    /// Frames from one window to the next when models are evaluated.
    pub eval_stride: usize,
    /// Frames at the end of a window whose true force is a target.
    #[serde(default = "one")]
    pub outputs: usize,
    /// True if the network takes joint angles.
    pub needs_pose: bool,
}

fn one() -> usize {
    1
}

impl Default for WindowSpec {
    fn default() -> Self {
        WindowSpec { window: 64, stride: 1, eval_stride: 1, outputs: 1, needs_pose: true }
    }
}

/// A window: the session, and its last frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct WindowIdx {
    session: u32,
    end: u32,
}

/// Sessions, and the windows of each part of the split.
#[derive(Debug, Clone)]
pub struct Dataset {
    spec: WindowSpec,
    sessions: Arc<[Session]>,
    parts: [Vec<WindowIdx>; 3],
    train_frames: Vec<Vec<bool>>,
}

impl Dataset {
    /// Cuts the windows of sessions.
    ///
    /// # Errors
    /// [`DatasetError`] when settings are out of range, sessions don't fit together, have no joints though the network
    /// needs them, leave a part without windows, or contain only touch or only air.
    pub fn new(sessions: Vec<Session>, spec: WindowSpec) -> Result<Self, DatasetError> {
        Dataset::of(sessions.into(), spec)
    }

    fn of(sessions: Arc<[Session]>, spec: WindowSpec) -> Result<Self, DatasetError> {
        let positive = |key, got: usize| match got {
            0 => Err(DatasetError::Setting { key, got: got.to_string(), expected: "at least 1 frame" }),
            _ => Ok(()),
        };
        positive("window", spec.window)?;
        positive("stride", spec.stride)?;
        positive("eval_stride", spec.eval_stride)?;
        positive("outputs", spec.outputs)?;
        check_widths(&sessions, spec.needs_pose)?;

        let mut parts = [Vec::new(), Vec::new(), Vec::new()];
        let mut train_frames = Vec::with_capacity(sessions.len());
        for (session_idx, session) in sessions.iter().enumerate() {
            let of_frame = &session.frames().part;
            for part in Part::ALL {
                let stride = if part == Part::Train { spec.stride } else { spec.eval_stride };
                let ends = window_ends(session, of_frame, part, spec.window);
                let windows =
                    ends.step_by(stride).map(|end| WindowIdx { session: session_idx as u32, end: end as u32 });
                parts[part as usize].extend(windows);
            }
            train_frames.push(of_frame.iter().map(|part| *part == Part::Train).collect());
        }
        let dataset = Dataset { spec, sessions, parts, train_frames };
        dataset.check_windows()?;
        Ok(dataset)
    }

    /// The same sessions in longer windows, with all last frames of each window as targets.
    ///
    /// # Errors
    /// [`DatasetError`] when no run of frames is long enough.
    pub fn with_outputs(&self, outputs: usize) -> Result<Self, DatasetError> {
        let window = self.spec.window + outputs - 1;
        let spec = WindowSpec { window, stride: outputs.div_ceil(2), outputs, ..self.spec };
        Dataset::of(Arc::clone(&self.sessions), spec)
    }

    /// The same sessions, with every frame evaluated.
    ///
    /// # Errors
    /// Only those of the original dataset.
    pub fn with_every_frame(&self) -> Result<Self, DatasetError> {
        Dataset::of(Arc::clone(&self.sessions), WindowSpec { eval_stride: 1, ..self.spec })
    }

    /// The settings for cutting windows.
    pub fn spec(&self) -> &WindowSpec {
        &self.spec
    }

    /// The sessions.
    pub fn sessions(&self) -> &[Session] {
        &self.sessions
    }

    /// Number of windows of a part.
    pub fn n_windows(&self, part: Part) -> usize {
        self.parts[part as usize].len()
    }

    /// Taxels per frame.
    pub fn n_taxels(&self) -> usize {
        self.sessions.first().map_or(0, Session::n_taxels)
    }

    /// Joint angles per frame.
    pub fn n_joints(&self) -> usize {
        self.sessions.first().map_or(0, Session::n_joints)
    }

    /// Axes of the true force: 1 or 3.
    pub fn n_axes(&self) -> usize {
        self.sessions.first().map_or(1, Session::n_axes)
    }

    /// The last frame of a window: its session, and its index there.
    pub fn window_end(&self, part: Part, window: usize) -> Option<(usize, usize)> {
        let idx = self.parts[part as usize].get(window)?;
        Some((idx.session as usize, idx.end as usize))
    }

    /// True forces of a part's windows, gF.
    pub fn truth_gf(&self, part: Part) -> Vec<f32> {
        self.parts[part as usize].iter().map(|idx| self.session(idx).frames().truth_gf[idx.end as usize]).collect()
    }

    /// Root mean square of the taxels in the training part: the default of their scale.
    pub fn tactile_scale(&self) -> f32 {
        let n_taxels = self.n_taxels();
        let (mut sum, mut count) = (0.0, 0u64);
        for (session, train) in self.sessions.iter().zip(&self.train_frames) {
            let frames = session.frames().tactile.chunks_exact(n_taxels.max(1));
            for frame in frames.zip(train).filter_map(|(frame, train)| train.then_some(frame)) {
                sum += frame.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>();
                count += frame.len() as u64;
            }
        }
        let scale = (sum / count.max(1) as f64).sqrt() as f32;
        // Taxels that never change have no scale; 1 leaves them unchanged.
        if scale.is_finite() && scale > f32::MIN_POSITIVE { scale } else { 1.0 }
    }

    /// Per joint, the span of the angles in the training part, rad.
    pub fn pose_range(&self) -> Vec<PoseRange> {
        pose_range(&self.sessions)
    }

    /// Assembles windows of a part. `smoothing_frames` is the width of the Gaussian of the auxiliary target.
    ///
    /// # Panics
    /// When an index is not below [`n_windows`](Self::n_windows).
    pub fn batch(&self, part: Part, windows: &[usize], smoothing_frames: Option<f32>) -> Batch {
        let windows: Vec<WindowIdx> = windows.iter().map(|window| self.parts[part as usize][*window]).collect();
        batch::assemble(self, &windows, smoothing_frames)
    }

    /// SHA-256 over all data that affects training, in hex.
    pub fn fingerprint(&self) -> String {
        let mut hash = Sha256::new();
        for session in self.sessions.iter() {
            session.hash_into(&mut hash);
        }
        for part in &self.parts {
            hash.update((part.len() as u64).to_le_bytes());
            part.iter().for_each(|idx| hash.update([idx.session.to_le_bytes(), idx.end.to_le_bytes()].concat()));
        }
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn session(&self, idx: &WindowIdx) -> &Session {
        &self.sessions[idx.session as usize]
    }

    /// The frames of a window.
    fn frames_of(&self, idx: &WindowIdx) -> Range<usize> {
        let end = idx.end as usize + 1;
        end - self.spec.window..end
    }

    fn check_windows(&self) -> Result<(), DatasetError> {
        for part in Part::ALL {
            let wanted =
                part == Part::Train || self.sessions.iter().any(|session| session.frames().part.contains(&part));
            if wanted && self.n_windows(part) == 0 {
                return Err(DatasetError::NoWindows { window: self.spec.window, part: part.name() });
            }
        }
        let truth = self.truth_gf(Part::Train);
        let n_touch = truth.iter().filter(|truth| **truth >= TOUCH_GF).count();
        let class = match n_touch {
            0 => "without touch",
            all if all == truth.len() => "touch",
            _ => {
                let largest_gf = truth.iter().copied().fold(0.0, f32::max);
                return match largest_gf < LEAST_PRESS_GF {
                    true => Err(DatasetError::NoPress { largest_gf, least_gf: LEAST_PRESS_GF }),
                    false => Ok(()),
                };
            }
        };
        Err(DatasetError::OneClass { class, threshold_gf: TOUCH_GF })
    }
}

/// Per joint, the span of the angles in the training part of sessions, rad.
pub fn pose_range(sessions: &[Session]) -> Vec<PoseRange> {
    let n_joints = sessions.first().map_or(0, Session::n_joints);
    let mut ranges = vec![PoseRange { min: f64::INFINITY, max: f64::NEG_INFINITY }; n_joints];
    for SessionFrames { pose, part, .. } in sessions.iter().map(Session::frames) {
        let frames = pose.chunks_exact(n_joints.max(1)).zip(part).filter(|(_, part)| **part == Part::Train);
        for (joint, angle) in frames.flat_map(|(frame, _)| frame.iter().enumerate()) {
            let range = &mut ranges[joint];
            range.min = range.min.min(f64::from(*angle));
            range.max = range.max.max(f64::from(*angle));
        }
    }
    ranges
}

fn check_widths(sessions: &[Session], needs_pose: bool) -> Result<(), DatasetError> {
    let first = sessions.first().ok_or(DatasetError::NoSessions)?;
    for session in sessions {
        let name = || session.name().to_string();
        if needs_pose && session.n_joints() == 0 {
            return Err(DatasetError::NoJoints { session: name() });
        }
        for (what, expected, got) in [
            ("taxels", first.n_taxels(), session.n_taxels()),
            ("joints", first.n_joints(), session.n_joints()),
            ("axes of the true force", first.n_axes(), session.n_axes()),
        ] {
            if expected != got {
                let first = first.name().to_string();
                return Err(DatasetError::Width { session: name(), first, what, expected, got });
            }
        }
    }
    Ok(())
}

/// Last frames of the windows that lie in one part and cross no gap.
fn window_ends<'a>(
    session: &'a Session,
    of_frame: &'a [Part],
    part: Part,
    window: usize,
) -> impl Iterator<Item = usize> + 'a {
    let epoch = &session.frames().epoch;
    let mut run = 0;
    (0..session.n_frames()).filter(move |&frame| {
        let goes_on = frame > 0 && epoch[frame] == epoch[frame - 1] && of_frame[frame] == of_frame[frame - 1];
        run = if goes_on { run + 1 } else { 1 };
        of_frame[frame] == part && run >= window
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A second in the air, and a second of so many gF.
    fn dataset(touch_gf: f32) -> Result<Dataset, DatasetError> {
        let n = 200;
        let session = Session::new(SessionFrames {
            name: "session".into(),
            n_taxels: 1,
            tactile: vec![0.0; n],
            truth_gf: (0..n).map(|frame| if frame < 100 { 0.0 } else { touch_gf }).collect(),
            zero_load: (0..n).map(|frame| frame < 100).collect(),
            part: vec![Part::Train; n],
            epoch: vec![1; n],
            ..SessionFrames::default()
        });
        Dataset::new(vec![session?], WindowSpec { needs_pose: false, ..WindowSpec::default() })
    }

    #[test]
    fn noise_of_a_force_sensor_is_no_press() {
        assert!(dataset(10.0).is_ok());
        let refused = dataset(7.0).unwrap_err();
        assert_eq!(refused, DatasetError::NoPress { largest_gf: 7.0, least_gf: 10.0 });
        assert!(matches!(dataset(1.0).unwrap_err(), DatasetError::OneClass { .. }));
    }
}
