//! Small sessions with a force that can be learned.
#![allow(dead_code)] // each test binary uses its part

use tactile_pose_fusion::eval::Part;
use tactile_pose_fusion::train::{Dataset, Kind, Schedule, Session, SessionFrames, TrainConfig, WindowSpec};

pub const TAXELS: usize = 3;
pub const JOINTS: usize = 2;
pub const WINDOW: usize = 8;

/// Taps of up to 100 gF while the joints swing, each taxel with its gain; bending moves the taxels too.
pub fn frames(name: &str, n: usize) -> SessionFrames {
    let mut frames =
        SessionFrames { name: name.into(), n_taxels: TAXELS, n_joints: JOINTS, ..SessionFrames::default() };
    for frame in 0..n {
        let at = frame as f32;
        let loaded = frame % 40 >= 20;
        let force = if loaded { 50.0 + 50.0 * (at * 0.3).sin() } else { 0.0 };
        let bends = [0.5 + 0.5 * (at * 0.11).sin(), 0.4 * (at * 0.07).cos()];
        for taxel in 0..TAXELS {
            let gain = 2.0 + taxel as f32;
            frames.tactile.push(gain * force + 30.0 * bends[taxel % JOINTS]);
        }
        frames.pose.extend(bends);
        frames.truth_gf.push(force);
        frames.zero_load.push(!loaded);
        frames.part.push(Part::Train);
        frames.epoch.push(0);
    }
    frames
}

pub fn session(name: &str, n: usize) -> Session {
    Session::new(frames(name, n)).unwrap()
}

/// A session whose frames are for the given parts, one after the other.
pub fn split_session(name: &str, parts: &[(Part, usize)]) -> Session {
    let mut frames = frames(name, parts.iter().map(|(_, n)| n).sum());
    frames.part = parts.iter().flat_map(|(part, n)| std::iter::repeat_n(*part, *n)).collect();
    Session::new(frames).unwrap()
}

/// Everything is trained on, nothing kept apart.
pub fn all_of_it(kind: Kind) -> WindowSpec {
    // The causal network needs as many frames as it sees.
    let window = if kind == Kind::Adaptive { 64 } else { WINDOW };
    WindowSpec { window, needs_pose: kind.uses_pose(), ..WindowSpec::default() }
}

pub fn dataset(kind: Kind, n: usize) -> Dataset {
    Dataset::new(vec![session("a", n)], all_of_it(kind)).unwrap()
}

pub fn config(kind: Kind, steps: u64) -> TrainConfig {
    TrainConfig {
        kind,
        batch: 16,
        schedule: Schedule { steps, warmup_steps: 5, learning_rate: 3e-3, final_learning_rate: 1e-4 },
        validate_every: 4,
        checkpoint_every: 3,
        ..TrainConfig::default()
    }
}
