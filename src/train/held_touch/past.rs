//! What a filter went through before a frame of a copy that the recording has no time for.

use std::ops::Range;

use super::{log_uniform, n_frames};
use crate::train::random::Random;

/// Time between two starts of the filter, s: some are while something touches.
const STARTS_S: (f32, f32) = (10.0, 200.0);

/// How many starts go on from what the filter knew of the artifact, as from a calibration that is a moment old. The others go back to the
/// calibration of the session.
const KNOWING: f32 = 0.5;

/// How many touches are the end of a grasp.
const GRASPS: f32 = 0.4;

/// Forces of a grasp, gF; how long it goes on, s; how far, as a share, and how slowly, s, its force wanders.
const GRASP_GF: (f32, f32) = (30.0, 300.0);
const GRASP_S: (f32, f32) = (10.0, 900.0);
const GRASP_WANDERS: f32 = 0.5;
const GRASP_WANDERS_S: (f32, f32) = (1.0, 20.0);

/// How long the grasp goes on in the frames of the copy before it ends, s.
const GRASP_ENDS_S: (f32, f32) = (0.2, 5.0);

/// The least time of the recording that a grasp is laid on, forth and back, and the longest one, s.
const AGAIN_S: (f64, f64) = (2.0, 40.0);

/// What the filter went through since the frame before.
#[derive(Debug, Clone, PartialEq)]
pub enum Past {
    /// It starts from the calibration of the donning, whatever touches.
    Start,
    /// It starts from what it knew of the artifact, whatever touches.
    StartKnowing,
    /// Something was grasped.
    Grasp(Grasp),
}

/// A grasp in the last frames of the recording, which are gone through forth and back as often as it takes.
#[derive(Debug, Clone, PartialEq)]
pub struct Grasp {
    pub force_gf: f32,
    /// How the force spreads, `[taxels]`, for each gF.
    pub spread: Vec<f32>,
    /// How many frames it takes.
    pub n_frames: usize,
    /// Over how many frames of the recording it goes.
    pub again: usize,
    /// Frames of a full turn of its force.
    wanders: f32,
}

impl Past {
    /// A start, of either kind.
    pub fn start(random: &mut Random) -> Self {
        if random.unit() < KNOWING { Past::StartKnowing } else { Past::Start }
    }
}

impl Grasp {
    /// A grasp in the air before a frame that has so much air before it. `None` if that is too little, or by chance.
    pub fn before(n_before: usize, rate_hz: f64, spread: Vec<f32>, random: &mut Random) -> Option<(Self, usize)> {
        let again = n_before.min((AGAIN_S.1 * rate_hz) as usize);
        if random.unit() >= GRASPS || (again as f64) < AGAIN_S.0 * rate_hz {
            return None;
        }
        let grasp = Grasp {
            force_gf: log_uniform(random, GRASP_GF),
            spread,
            n_frames: n_frames(random, GRASP_S, rate_hz),
            again,
            wanders: n_frames(random, GRASP_WANDERS_S, rate_hz).max(1) as f32,
        };
        Some((grasp, n_frames(random, GRASP_ENDS_S, rate_hz)))
    }

    /// Frames before `at` in the order of the grasp, each with its force, gF. They begin and end beside `at`.
    pub fn frames(&self, at: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let there_and_back = 2 * self.again;
        let n = self.n_frames.div_ceil(there_and_back) * there_and_back;
        (0..n).map(move |idx| {
            let place = idx % there_and_back;
            let back = if place < self.again { place } else { there_and_back - 1 - place };
            let turn = (std::f32::consts::TAU * (n - 1 - idx) as f32 / self.wanders).sin();
            (at - 1 - back, self.force_gf * (1.0 + GRASP_WANDERS * turn))
        })
    }
}

/// Frames in which the filter starts.
pub fn starts(frames: &Range<usize>, rate_hz: f64, random: &mut Random) -> Vec<usize> {
    let mut starts = Vec::new();
    let mut at = frames.start + n_frames(random, STARTS_S, rate_hz);
    while at < frames.end {
        starts.push(at);
        at += n_frames(random, STARTS_S, rate_hz).max(1);
    }
    starts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::random::Stream;

    const HZ: f64 = 100.0;

    #[test]
    fn a_grasp_goes_forth_and_back_over_the_air_before_it_and_ends_beside_its_frame() {
        let mut random = Random::new(3, Stream::HeldTouch(0));
        let grasps: Vec<(Grasp, usize)> =
            (0..100).filter_map(|_| Grasp::before(1000, HZ, vec![1.0, 2.0], &mut random)).collect();
        assert!((20..60).contains(&grasps.len()), "{} of 100", grasps.len());
        for (grasp, left) in &grasps {
            let frames: Vec<(usize, f32)> = grasp.frames(5000).collect();
            assert!(frames.len() >= grasp.n_frames && frames.len() < grasp.n_frames + 2000 && *left >= 20);
            assert_eq!((frames[0].0, frames[frames.len() - 1].0), (4999, 4999));
            assert!(frames.windows(2).all(|pair| pair[0].0.abs_diff(pair[1].0) <= 1), "no pose jumps");
            assert!(frames.iter().all(|(frame, _)| (4000..5000).contains(frame)));
            assert!(frames.iter().all(|(_, force)| (0.4..=1.6).contains(&(force / grasp.force_gf))));
            assert!((frames[frames.len() - 1].1 - grasp.force_gf).abs() < 1e-3, "the copy goes on with its force");
        }
        let too_little = (0..100).filter_map(|_| Grasp::before(199, HZ, vec![1.0], &mut random));
        assert_eq!(too_little.count(), 0);
    }

    #[test]
    fn starts_are_of_both_kinds() {
        let mut random = Random::new(5, Stream::HeldTouch(0));
        let n_knowing = (0..200).filter(|_| Past::start(&mut random) == Past::StartKnowing).count();
        assert!((60..140).contains(&n_knowing), "{n_knowing} of 200");
    }

    #[test]
    fn starts_are_within_the_air_and_rarer_than_seconds() {
        let mut random = Random::new(4, Stream::HeldTouch(0));
        let starts = starts(&(1000..101_000), HZ, &mut random);
        assert!((5..100).contains(&starts.len()), "{starts:?}");
        assert!(starts.iter().all(|start| (2000..101_000).contains(start)));
        assert!(starts.windows(2).all(|pair| pair[1] - pair[0] >= 1000));
        assert!(super::starts(&(0..900), HZ, &mut random).is_empty());
    }
}
