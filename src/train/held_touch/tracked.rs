//! Joint angles of copies: those of the recording, or as a worse hand tracker would have given them.

use super::n_frames;
use crate::train::dataset::SessionFrames;
use crate::train::random::Random;

/// A worse tracker: the largest noise and bias of its angles as standard deviations, rad, its delay, s, and its rate, 1/s, in
/// most copies; how often it is blind, 1/s, and for how long, s; its last angles count as held for so long, s.
const NOISE_RAD: f32 = 0.087;
const BIAS_RAD: f32 = 0.175;
const DELAY_S: f32 = 0.06;
const SLOW_HZ: f64 = 30.0;
const SLOW_SHARE: f32 = 0.7;
const BLIND_PER_S: f32 = 0.1;
const BLIND_S: (f32, f32) = (0.1, 2.0);
const HELD_POSE_S: f64 = 0.1;

/// How old the angles of a frame are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Age {
    Fresh,
    Held,
    Old,
}

/// Joint angles as a hand tracker gives them.
pub struct Tracked {
    /// `[frames, joints]`, rad.
    pub pose: Vec<f32>,
    /// `[frames]`
    pub age: Vec<Age>,
}

impl Tracked {
    /// Those of the recording.
    pub fn of(frames: &SessionFrames) -> Self {
        Tracked { pose: frames.pose.clone(), age: vec![Age::Fresh; frames.truth_gf.len()] }
    }

    /// Seen by a tracker with noise, bias and delay, which is slow and blind at times.
    pub fn badly(frames: &SessionFrames, joints: usize, rate_hz: f64, random: &mut Random) -> Self {
        let n = frames.truth_gf.len();
        let uniform = |deviation: f32| 3.0f32.sqrt() * deviation;
        let how_bad = random.unit();
        let noise = uniform(NOISE_RAD * how_bad);
        let bias: Vec<f32> = (0..joints).map(|_| random.symmetric(uniform(BIAS_RAD * how_bad))).collect();
        let delay = (DELAY_S * random.unit() * rate_hz as f32) as usize;
        let every = if random.unit() < SLOW_SHARE { (rate_hz / SLOW_HZ).round().max(1.0) as usize } else { 1 };
        let goes_blind = BLIND_PER_S * random.unit() / rate_hz as f32;
        let mut samples = Vec::with_capacity((n / every + 2) * joints);
        for sample in 0..n / every + 2 {
            let seen = (sample * every).saturating_sub(delay).min(n - 1);
            let angles = frames.pose[seen * joints..(seen + 1) * joints].iter().zip(&bias);
            samples.extend(angles.map(|(angle, bias)| angle + bias + random.symmetric(noise)));
        }
        let (mut pose, mut age) = (Vec::with_capacity(n * joints), Vec::with_capacity(n));
        let (mut blind, mut since) = (0, 0);
        for frame in 0..n {
            if blind == 0 && random.unit() < goes_blind {
                blind = n_frames(random, BLIND_S, rate_hz);
            }
            if blind > 0 && frame > 0 {
                (blind, since) = (blind - 1, since + 1);
                age.push(if f64::from(since) > HELD_POSE_S * rate_hz { Age::Old } else { Age::Held });
                pose.extend_from_within((frame - 1) * joints..frame * joints);
                continue;
            }
            since = 0;
            age.push(Age::Fresh);
            let (sample, share) = (frame / every, (frame % every) as f32 / every as f32);
            let angles = samples[sample * joints..].iter().zip(&samples[(sample + 1) * joints..]).take(joints);
            pose.extend(angles.map(|(before, after)| before + share * (after - before)));
        }
        Tracked { pose, age }
    }
}
