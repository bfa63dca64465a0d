//! A stream of samples on its way to the recorder: clock, delays and losses.

use super::super::spec::TrackingErrors;
use crate::random::Noise;

pub(super) const RATE_HZ: f64 = 100.0; // Sec. IV: all signals at 100 Hz
const CAMERA_HZ: f64 = 30.0;
const CAMERA_DELAY_S: f64 = 0.06;
const SYNC_ERROR_S: f64 = 0.005; // sd: half a frame between glove and load cell is left after synchronizing them

/// Source of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// The glove.
    Taxels,
    /// Motion capture.
    Joints,
    /// A camera that looks at the hand.
    SeenJoints,
    /// The load cell.
    Truth,
}

/// Times of a sample, s into the session.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampling {
    /// Measurement time.
    pub(super) at_s: f64,
    /// Time since the previous sample.
    pub(super) dt_s: f64,
    /// Stamp by the source.
    pub(super) stamp_s: f64,
    /// Arrival time; samples on a wire stay in order.
    pub(super) received_s: f64,
    /// Number in the source's own count.
    pub(super) sequence: u32,
    /// True if it never arrives.
    pub(super) lost: bool,
}

/// One stream.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    pub(super) kind: Kind,
    period_s: f64,
    phase_s: f64,
    jitter_s: f64,
    stamp_error_s: f64,
    delay_s: (f64, f64), // minimum, and mean of the rest
    n_taken: u32,
    next_s: f64,
    last_s: f64,
    last_received_s: f64,
    still_lost: u32,       // samples of an outage that is going on
    drop_out: Option<f64>, // probability that one begins, if set
}

/// Duration of the drop-outs set by the conditions, s: the time for which fingers hide each other.
const DROP_OUT_S: (f64, f64) = (1.0 / 3.0, 1.0);

impl Channel {
    /// `asked` applies to joint angles only.
    pub(super) fn new(kind: Kind, asked: &TrackingErrors, noise: &mut Noise) -> Self {
        let is_tracker = matches!(kind, Kind::Joints | Kind::SeenJoints);
        let asked = if is_tracker { *asked } else { TrackingErrors::default() };
        // Jitter and delays: a glove over a radio or USB, optical tracking with its processing, a wired load cell.
        let (jitter_s, delay_s, stamp_error_s) = match kind {
            Kind::Taxels => (0.0004, (0.001, 0.001), noise.normal(SYNC_ERROR_S).clamp(-0.012, 0.012)),
            Kind::Joints => (0.0001, (0.004, 0.0007), 0.0),
            // A frame is stamped when its picture has been processed, so its whole delay is in its stamp.
            Kind::SeenJoints => (0.003, (0.002, 0.004), CAMERA_DELAY_S),
            Kind::Truth => (0.00005, (0.0003, 0.0001), 0.0),
        };
        let stamp_error_s = asked.delay_ms.map_or(stamp_error_s, |delay_ms| 1e-3 * delay_ms);
        let rate_hz = asked.rate_hz.unwrap_or(if kind == Kind::SeenJoints { CAMERA_HZ } else { RATE_HZ });
        let period_s = (1.0 + noise.normal(2e-5)) / rate_hz; // quartz: tens of ppm
        let phase_s = noise.uniform(0.2, 0.8) * period_s;
        Channel {
            kind,
            period_s,
            phase_s,
            jitter_s,
            stamp_error_s,
            delay_s,
            n_taken: 0,
            next_s: phase_s,
            last_s: 0.0,
            last_received_s: 0.0,
            still_lost: 0,
            drop_out: asked.drop_outs_per_min.map(|per_min| per_min / 60.0 / rate_hz),
        }
    }

    /// Time of the next sample.
    pub(super) fn next_s(&self) -> f64 {
        self.next_s
    }

    /// Takes the next sample.
    pub(super) fn take(&mut self, noise: &mut Noise) -> Sampling {
        let (at_s, dt_s, sequence) = (self.next_s, self.next_s - self.last_s, self.n_taken);
        let stamp_s = at_s + self.stamp_error_s;
        let received_s = at_s.max(stamp_s) + self.delay_s.0 + noise.exponential(self.delay_s.1);
        self.last_received_s = received_s.max(self.last_received_s);
        let lost = self.loses(noise);
        self.n_taken = self.n_taken.wrapping_add(1);
        let jitter_s = noise.normal(self.jitter_s).clamp(-0.15 * self.period_s, 0.15 * self.period_s);
        self.last_s = self.next_s;
        self.next_s = f64::from(self.n_taken) * self.period_s + self.phase_s + jitter_s;
        Sampling { at_s, dt_s, stamp_s, received_s: self.last_received_s, sequence, lost }
    }

    /// Single samples, short bursts, and rarely an outage longer than the interpolation covers.
    fn loses(&mut self, noise: &mut Noise) -> bool {
        let (single, burst, outage) = match self.kind {
            Kind::Taxels => (8e-4, 5e-5, 1.5e-5),
            Kind::Joints => (4e-4, 2e-5, 0.0), // markers that are hidden for a moment
            Kind::SeenJoints => (1e-2, 5e-3, 1.5e-3), // fingers that hide each other: every 20 s for up to a second
            Kind::Truth => return false,       // wired
        };
        if self.still_lost > 0 {
            self.still_lost -= 1;
            return true;
        }
        let outage = self.drop_out.unwrap_or(outage);
        let draw = noise.uniform(0.0, 1.0);
        let length = match draw {
            _ if draw < outage && self.drop_out.is_some() => noise.uniform(DROP_OUT_S.0, DROP_OUT_S.1) / self.period_s,
            _ if draw < outage => noise.uniform(10.0, 30.0),
            _ if draw < outage + burst => noise.uniform(2.0, 5.0),
            _ if draw < outage + burst + single => 1.0,
            _ => return false,
        };
        self.still_lost = (length as u32).saturating_sub(1);
        true
    }
}
