//! Noise of joint angles, measured by the angles alone, and smoothing of as much as it asks for.
//!
//! A hand turns steadily for a tenth of a second; the errors of a camera that looks at it do not. How far an angle lies from
//! the line through the two before it therefore tells the noise of a tracker, whatever touches the glove.

/// Time between the three angles that noise is measured by, s. It is longer than the period of a camera, whose angles are
/// held from one to the next.
const STEP_S: f64 = 0.05;

/// Median of the distance of an angle from the line through the two before it, in deviations of the noise.
const MEDIAN: f64 = 0.6745 * 2.449_489_742_783_178; // of a normal error; sqrt(1 + 4 + 1) for three independent ones

/// How fast the measured noise follows, 1/s: it is multiplied or divided by e in a second, and so finds the median. The first
/// second finds where it begins, in steps of the logarithm of one over the number of angles (Robbins and Monro, 1951).
const FOLLOWS_PER_S: f64 = 1.0;

/// The least noise, rad: that of markers.
const LEAST: f64 = 0.1 * RAD_PER_DEG;

/// Angles with much noise are smoothed with this time constant, s, and those with this noise, rad, with half of it. With
/// markers it is far below a frame.
const SMOOTHING_S: f64 = 0.06;
const HALF_SMOOTHED: f64 = 1.5 * RAD_PER_DEG;

const RAD_PER_DEG: f64 = std::f64::consts::PI / 180.0;

/// Measures the noise of joint angles and smooths them. It forgets nothing when frames are lost: the tracker stays the same.
#[derive(Debug, Clone)]
pub(super) struct JointNoise {
    frame_s: f64,
    /// Frames between the angles that are compared.
    step: usize,
    /// `[2 steps, joints]`, a ring of the angles before, rad, and how many frames of it are known.
    past: Vec<f64>,
    next: usize,
    n_past: usize,
    /// Frames that told of noise so far.
    n_told: u32,
    /// `[joints]`, rad.
    deviation: Vec<f64>,
    smoothed: Vec<f64>,
}

impl JointNoise {
    pub(super) fn new(n_joints: usize, rate_hz: f64) -> Self {
        let step = (STEP_S * rate_hz).round().max(1.0) as usize;
        JointNoise {
            frame_s: 1.0 / rate_hz,
            step,
            past: vec![0.0; 2 * step * n_joints],
            next: 0,
            n_past: 0,
            n_told: 0,
            deviation: vec![LEAST; n_joints],
            smoothed: vec![0.0; n_joints],
        }
    }

    /// Takes the angles of a frame, `n_frames` after the last one; `begins` if nothing is known before it.
    pub(super) fn advance(&mut self, pose: &[f32], n_frames: i32, begins: bool) {
        let n_joints = self.deviation.len();
        if begins || n_frames != 1 {
            self.n_past = 0;
        }
        let row = |frame: usize| frame * n_joints;
        let (oldest, middle) = (row(self.next), row((self.next + self.step) % (2 * self.step)));
        // Angles that are the same for so long, all of them, are held: the tracker says nothing.
        let differs = |(joint, angle): (usize, &f32)| {
            let before = self.past[middle + joint];
            f64::from(*angle) != before || before != self.past[oldest + joint]
        };
        let tells = self.n_past == 2 * self.step && pose.iter().enumerate().any(differs);
        self.n_told = self.n_told.saturating_add(u32::from(tells));
        let follows = (FOLLOWS_PER_S * self.frame_s).max(1.0 / f64::from(self.n_told.max(1))).exp();
        for (joint, angle) in pose.iter().enumerate() {
            let angle = f64::from(*angle);
            let deviation = &mut self.deviation[joint];
            if tells {
                let off = (angle - 2.0 * self.past[middle + joint] + self.past[oldest + joint]).abs() / MEDIAN;
                *deviation = if off > *deviation { *deviation * follows } else { (*deviation / follows).max(LEAST) };
            }
            self.past[oldest + joint] = angle;
            let left = if begins { 0.0 } else { (-f64::from(n_frames) * self.frame_s / smoothing_s(*deviation)).exp() };
            self.smoothed[joint] = angle + (self.smoothed[joint] - angle) * left;
        }
        self.next = (self.next + 1) % (2 * self.step);
        self.n_past = (self.n_past + 1).min(2 * self.step);
    }

    /// A joint's smoothed angle, rad, and how far it lags behind a steady movement, s.
    pub(super) fn smoothed(&self, joint: usize) -> (f64, f64) {
        (self.smoothed[joint], smoothing_s(self.deviation[joint]))
    }

    /// Standard deviation of the noise of a joint's angle, rad.
    pub(super) fn deviation(&self, joint: usize) -> f64 {
        self.deviation[joint]
    }
}

fn smoothing_s(deviation: f64) -> f64 {
    let square = deviation * deviation;
    SMOOTHING_S * square / (square + HALF_SMOOTHED * HALF_SMOOTHED)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: f64 = 100.0;

    /// The noise that is measured of an angle over so many frames, degrees.
    fn measured(n: usize, angle: impl FnMut(usize) -> f64) -> f64 {
        let mut noise = JointNoise::new(1, HZ);
        (0..n).map(angle).enumerate().for_each(|(idx, angle)| noise.advance(&[angle as f32], 1, idx == 0));
        noise.deviation(0) / RAD_PER_DEG
    }

    /// About normal, of deviation 1: the sum of twelve uniform numbers.
    fn normal(state: &mut u64) -> f64 {
        let mut unit = || {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*state >> 33) as f64 / f64::from(1u32 << 31)
        };
        (0..12).map(|_| unit()).sum::<f64>() - 6.0
    }

    fn bends(frame: usize) -> f64 {
        0.6 + 0.6 * (std::f64::consts::TAU * frame as f64 / HZ / 2.0).sin()
    }

    /// Angles of a camera at 33 Hz with so much noise, degrees.
    fn camera(noise: f64) -> impl FnMut(usize) -> f64 {
        let (mut state, mut held) = (1, 0.0);
        move |frame| {
            if frame.is_multiple_of(3) {
                held = bends(frame) + noise * RAD_PER_DEG * normal(&mut state);
            }
            held
        }
    }

    #[test]
    fn noise_is_measured_and_movement_is_none() {
        let mut state = 1;
        let noisy = measured(3000, |frame| bends(frame) + 5.0 * RAD_PER_DEG * normal(&mut state));
        assert!((4.0..6.5).contains(&noisy), "{noisy} of 5 degrees");
        let moving = measured(3000, bends);
        assert!(moving < 0.7, "{moving} degrees of a hand that bends in a second and back");
        assert!(measured(3000, |_| 0.4) < 0.11);
    }

    #[test]
    fn the_first_second_tells_it_already() {
        let soon = measured(110, camera(5.0));
        assert!((2.0..10.0).contains(&soon), "{soon} of 5 degrees after a second");
        let moving = measured(110, bends);
        assert!(moving < 0.7, "{moving} degrees of a hand that bends");
    }

    #[test]
    fn a_cameras_held_angles_tell_its_noise_and_a_silent_tracker_nothing() {
        let mut camera = camera(4.0);
        let seen = measured(3000, &mut camera);
        assert!((3.0..6.0).contains(&seen), "{seen} of 4 degrees");
        let lost = measured(6000, |frame| if frame < 3000 { camera(frame) } else { 0.5 });
        assert!(lost > 2.5, "{lost} degrees after half a minute without new angles");
    }

    #[test]
    fn angles_without_noise_are_left_as_they_are() {
        let mut noise = JointNoise::new(1, HZ);
        for frame in 0..500 {
            noise.advance(&[bends(frame) as f32], 1, frame == 0);
            assert!((noise.smoothed(0).0 - bends(frame)).abs() < 3e-3, "frame {frame}: {:?}", noise.smoothed(0));
        }
    }

    #[test]
    fn frames_that_are_missing_are_no_noise() {
        let mut noise = JointNoise::new(1, HZ);
        for frame in (0..5000).step_by(7) {
            noise.advance(&[bends(frame) as f32], 7, frame == 0);
        }
        assert_eq!(noise.deviation(0), LEAST);
    }
}
