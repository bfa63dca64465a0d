//! Measurement of joint angles, with its errors.

use super::super::hand::{CAMERA_BIAS_RAD, CAMERA_NOISE_RAD, HandPose, MotionCapture, SeenBadly};
use super::{Tracking, TrackingErrors, User};
use crate::random::Noise;

/// A tracker of joint angles.
#[derive(Debug)]
pub(super) struct Tracker {
    markers: Option<MotionCapture>,
    errors: Option<SeenBadly>,
}

impl Tracker {
    pub(super) fn new(user: &User) -> Self {
        let TrackingErrors { bias_deg, noise_deg, .. } = user.spec.conditions.tracking;
        let (bias_rad, noise_rad) = (bias_deg.map(f64::to_radians), noise_deg.map(f64::to_radians));
        let errors = |bias_rad, noise_rad| SeenBadly::new(bias_rad, noise_rad, user.of_session("camera"));
        match user.spec.tracking {
            Tracking::Markers => Tracker {
                markers: Some(MotionCapture::new(&mut user.of_session("markers"))),
                errors: bias_rad.or(noise_rad).map(|_| errors(bias_rad.unwrap_or(0.0), noise_rad.unwrap_or(0.0))),
            },
            Tracking::Camera => Tracker {
                markers: None,
                errors: Some(errors(bias_rad.unwrap_or(CAMERA_BIAS_RAD), noise_rad.unwrap_or(CAMERA_NOISE_RAD))),
            },
        }
    }

    /// Measured angles, `dt_s` after the previous ones. `[joints]`, rad.
    pub(super) fn measure(&mut self, dt_s: f64, pose: &HandPose, noise: &mut Noise) -> Vec<f64> {
        let mut angles = self.markers.as_ref().map_or_else(|| pose.angles(), |markers| markers.measure(pose, noise));
        self.errors.iter_mut().for_each(|errors| errors.put_on(dt_s, &mut angles));
        angles
    }
}
