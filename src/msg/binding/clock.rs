//! Maps a device's own clock to the clock of the receiver.
//!
//! A message arrives later than its stamp, by a delay that varies and is never negative. Receipt minus stamp is
//! therefore the offset of the clocks plus a delay, and its lower envelope follows the offset and its drift. The
//! envelope is the edge of the lower convex hull below the mean of the points: the line below all points that is
//! closest to them.
//!
//! # Source
//! S. Moon, P. Skelly, D. Towsley: Estimation and removal of clock skew from network delay measurements, INFOCOM 1999.

use std::collections::VecDeque;

use crate::units::{NANOS_PER_SEC, Stamp};

/// Length of a bin of device time. Only the smallest offset of each bin is kept.
const BIN_NS: i128 = NANOS_PER_SEC as i128;

/// Number of bins that are kept. Over half a minute, the offset of quartz clocks is a straight line.
const BINS: usize = 32;

/// Minimum time span of the points for an estimate of drift. Over a shorter span, the slope comes from a few delays.
const SPAN_FOR_DRIFT_NS: f64 = 3e9;

/// Largest drift that is accepted, as a fraction. Quartz clocks drift by less than 200e-6, the internal oscillators of
/// microcontrollers by 0.01.
const MAX_DRIFT: f64 = 0.02;

/// How fast the applied offset may grow, as a fraction of device time: faster than drift, but without steps.
const GROWTH: f64 = 0.025;

/// How fast the applied offset may shrink, as a fraction of device time: slow enough that stamps keep their order.
const SHRINKAGE: f64 = 0.5;

/// A clock that differs from the receipts by more than this was set or restarted, ns.
const RESTART_NS: i128 = NANOS_PER_SEC as i128;

/// Shortest time in which a counter may wrap, ns, because a stamp can only be matched with its receipt to within
/// [`RESTART_NS`].
pub(super) const LEAST_SPAN_NS: i128 = 4 * NANOS_PER_SEC as i128;

/// Larger than any time of a clock, and small enough that sums don't overflow, ns.
const MOST_NS: i128 = 1 << 96;

/// State of the mapping of a device's clock.
#[derive(Debug, Clone)]
pub(super) struct DeviceClock {
    /// Time after which the device's counter starts again at 0, ns. `None` if it never wraps.
    span_ns: Option<i128>,
    following: Option<Following>,
    restarts: u64,
}

#[derive(Debug, Clone)]
struct Following {
    /// Latest stamp as sent, ns.
    raw: i128,
    /// The same without wraps, ns.
    device: i128,
    /// Offset that is added to device time now, ns.
    offset: i128,
    /// Device time and offset of the smallest offset of each bin, oldest first.
    least: VecDeque<[i128; 2]>,
    envelope: Line,
}

/// A line: an offset at a device time, and its growth.
#[derive(Debug, Clone, Copy)]
struct Line {
    device: i128,
    offset: i128,
    drift: f64,
}

impl Line {
    fn at(&self, device: i128) -> i128 {
        self.offset + (self.drift * (device - self.device) as f64) as i128
    }
}

impl DeviceClock {
    /// A clock whose counter wraps after `span_ns`, if given.
    pub(super) fn new(span_ns: Option<i128>) -> Self {
        DeviceClock { span_ns, following: None, restarts: 0 }
    }

    /// Number of times that the clock was set or restarted.
    pub(super) fn restarts(&self) -> u64 {
        self.restarts
    }

    /// Stamp, on the receiver's clock, of a message with the device time `raw` that was received at `received`. Never
    /// later than `received`.
    pub(super) fn stamp(&mut self, raw: i128, received: Stamp) -> Stamp {
        let raw = raw.clamp(-MOST_NS, MOST_NS);
        let at = i128::from(received.0);
        let stamp = match &mut self.following {
            None => {
                self.following = Some(Following::begin(raw, at));
                at
            }
            Some(following) => match following.step(raw, at, self.span_ns) {
                Some(step) if following.handle(raw, step, at) => following.device_at(step) + following.offset,
                _ => {
                    self.restarts += 1;
                    *following = Following::begin(raw, at);
                    at
                }
            },
        };
        Stamp(stamp.min(at).clamp(i64::MIN.into(), i64::MAX.into()) as i64)
    }
}

impl Following {
    fn begin(raw: i128, at: i128) -> Self {
        let offset = at - raw;
        let envelope = Line { device: raw, offset, drift: 0.0 };
        Following { raw, device: raw, offset, least: VecDeque::from([[raw, offset]]), envelope }
    }

    /// Time from the latest stamp to this one, ns. Negative if a later message overtook it. `None` if the clock was
    /// set.
    fn step(&self, raw: i128, at: i128, span_ns: Option<i128>) -> Option<i128> {
        let ahead = |step: i128| self.device + step + self.envelope.at(self.device + step) - at;
        let step = raw - self.raw;
        let Some(span) = span_ns else {
            return (step >= -RESTART_NS && ahead(step) <= RESTART_NS).then_some(step);
        };
        let forward = step.rem_euclid(span);
        let too_far = ahead(forward) - RESTART_NS;
        if too_far <= 0 {
            return Some(forward + span * (-too_far).div_euclid(span)); // also wraps during which no message came
        }
        let back = forward - span;
        (back >= -RESTART_NS).then_some(back)
    }

    /// Device time at `step` after the previous stamp. If `step` is positive, the latest stamp is already this one.
    fn device_at(&self, step: i128) -> i128 {
        self.device + step.min(0)
    }

    /// Processes a message. False if the clock differs from its receipts for longer than a delay can last.
    fn handle(&mut self, raw: i128, step: i128, at: i128) -> bool {
        if step < 0 {
            return true;
        }
        self.raw = raw;
        self.device += step;
        self.keep(self.device, at - self.device);
        let wanted = self.envelope.at(self.device) - self.offset;
        let part = |part: f64| (part * step as f64) as i128;
        if wanted - part(GROWTH) > RESTART_NS {
            return false;
        }
        self.offset += wanted.clamp(-part(SHRINKAGE), part(GROWTH));
        true
    }

    /// Keeps an offset if it is the smallest of its bin.
    fn keep(&mut self, device: i128, offset: i128) {
        let bin = |device: i128| device.div_euclid(BIN_NS);
        let n_before = self.least.len();
        self.least.retain(|[kept, _]| bin(*kept) > bin(device) - BINS as i128);
        let mut is_other = self.least.len() != n_before;
        match self.least.back_mut() {
            Some(last) if bin(last[0]) == bin(device) => {
                if offset < last[1] {
                    *last = [device, offset];
                    is_other = true;
                }
            }
            _ => {
                self.least.push_back([device, offset]);
                is_other = true;
            }
        }
        if is_other {
            self.envelope = envelope(&self.least);
        }
    }
}

/// The line below all points that is closest to them on average. It is level if the points span too little time.
fn envelope(points: &VecDeque<[i128; 2]>) -> Line {
    let Some(&[device, offset]) = points.back() else { return Line { device: 0, offset: 0, drift: 0.0 } };
    let relative = |point: &[i128; 2]| [(point[0] - device) as f64, (point[1] - offset) as f64];
    let points: Vec<[f64; 2]> = points.iter().map(relative).collect();
    let drift = slope(&points).clamp(-MAX_DRIFT, MAX_DRIFT);
    let lowest = points.iter().map(|[x, y]| y - drift * x).fold(f64::INFINITY, f64::min);
    Line { device, offset: offset + lowest as i128, drift }
}

/// Slope of the edge of the lower convex hull below the mean of the points, which are sorted by x.
fn slope(points: &[[f64; 2]]) -> f64 {
    let [Some(first), Some(last)] = [points.first(), points.last()] else { return 0.0 };
    if last[0] - first[0] < SPAN_FOR_DRIFT_NS {
        return 0.0;
    }
    let mut hull: Vec<[f64; 2]> = Vec::with_capacity(points.len());
    for &[x, y] in points {
        while let [.., [x0, y0], [x1, y1]] = hull[..]
            && (x1 - x0) * (y - y0) <= (y1 - y0) * (x - x0)
        {
            hull.pop();
        }
        hull.push([x, y]);
    }
    let mean = points.iter().map(|[x, _]| x).sum::<f64>() / points.len() as f64;
    let edge = hull.windows(2).find(|edge| edge[1][0] >= mean);
    edge.map_or(0.0, |edge| (edge[1][1] - edge[0][1]) / (edge[1][0] - edge[0][0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i128 = 1_000_000;
    const S: i128 = 1_000 * MS;

    /// Delays as in a network: most are short, a few are long. Deterministic.
    struct Delays(u64);

    impl Delays {
        fn next(&mut self, mean_ms: f64) -> i128 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let uniform = ((self.0 >> 33) as f64 + 0.5) / (1_u64 << 31) as f64;
            (-uniform.ln() * mean_ms * 1e6) as i128
        }
    }

    /// Errors of the stamps of messages at `hz` for `seconds`: mapped stamp minus true time, ns.
    ///
    /// `device` maps true time to device time, both in ns. Every message takes 1 ms plus an average delay of
    /// `jitter_ms`.
    fn errors(
        clock: &mut DeviceClock,
        hz: i128,
        seconds: i128,
        jitter_ms: f64,
        device: impl Fn(i128) -> i128,
    ) -> Vec<i128> {
        let mut delays = Delays(7);
        let begin = 1_700_000_000 * S;
        let mut received = 0;
        let stamp = |k: i128| {
            let sent = begin + k * S / hz;
            received = received.max(sent + MS + delays.next(jitter_ms)); // messages of one stream keep their order
            let stamp = clock.stamp(device(k * S / hz), Stamp(received as i64));
            assert!(i128::from(stamp.0) <= received, "no stamp is later than the message");
            i128::from(stamp.0) - sent
        };
        (0..hz * seconds).map(stamp).collect()
    }

    fn assert_within(errors: &[i128], least_ms: f64, most_ms: f64) {
        let (least, most) = (errors.iter().min().unwrap(), errors.iter().max().unwrap());
        let [least, most] = [least, most].map(|error| *error as f64 / 1e6);
        assert!(least >= least_ms && most <= most_ms, "errors of {least} to {most} ms");
    }

    #[test]
    fn stamps_are_even_and_follow_drift_under_jitter() {
        for drift in [0.0, 50e-6, -50e-6, 0.01, -0.01] {
            let mut clock = DeviceClock::new(None);
            let device = |true_ns: i128| 77 * S + true_ns + (drift * true_ns as f64) as i128;
            let errors = errors(&mut clock, 100, 300, 2.0, device);
            // The smallest delay of 1 ms can't be separated from an offset. The rest is the uncertainty of a hundred
            // delays per second.
            assert_within(&errors[1_000..], 0.0, 2.0);
            let steps: Vec<i128> = errors[1_000..].windows(2).map(|pair| pair[1] - pair[0]).collect();
            assert_within(&steps, -0.3, 0.3); // receipts deviate by tens of ms
            assert_eq!(clock.restarts(), 0, "{drift}");
        }
    }

    #[test]
    fn a_start_in_a_burst_is_forgotten_and_stamps_keep_their_order() {
        let mut clock = DeviceClock::new(None);
        let mut stamps = Vec::new();
        for k in 0..500_i128 {
            let received = (k * 10 * MS).max(1500 * MS); // the first 1.5 s come at once
            stamps.push(clock.stamp(5 * S + k * 10 * MS, Stamp(received as i64)).0);
        }
        assert!(stamps.is_sorted());
        assert_eq!(stamps[499], 499 * 10_000_000);
        assert_eq!(clock.restarts(), 0);
    }

    #[test]
    fn a_link_that_stalls_delays_no_stamps() {
        let mut clock = DeviceClock::new(None);
        for k in 0..3_000_i128 {
            let sent = k * 10 * MS;
            let received = if (1_000..1_300).contains(&k) { 13 * S } else { sent };
            let stamp = clock.stamp(sent, Stamp(received as i64));
            assert!((i128::from(stamp.0) - sent).abs() <= MS, "{k}: {}", stamp.0);
        }
        assert_eq!(clock.restarts(), 0);
    }

    #[test]
    fn a_device_that_starts_anew_is_counted_and_mapped_anew() {
        for span in [None, Some(S * 65_536 / 1_000), Some((1 << 32) * 1_000)] {
            let mut clock = DeviceClock::new(span);
            let device = |true_ns: i128| {
                let since = if true_ns < 40 * S { 20 * S + true_ns } else { true_ns - 40 * S + 100 * MS };
                span.map_or(since, |span| since.rem_euclid(span))
            };
            let errors = errors(&mut clock, 100, 100, 1.0, device);
            assert_eq!(clock.restarts(), 1, "{span:?}");
            assert_within(&errors[1_000..3_999], 0.0, 3.0);
            assert_within(&errors[5_000..], 0.0, 3.0);
        }
    }

    #[test]
    fn a_clock_that_is_set_forward_or_stands_still_is_mapped_anew() {
        let mut clock = DeviceClock::new(None);
        let errors_forward = errors(&mut clock, 100, 60, 1.0, |ns| if ns < 20 * S { ns } else { ns + 3600 * S });
        assert_eq!(clock.restarts(), 1);
        assert_within(&errors_forward[1_000..], 0.0, 20.0);
        let mut clock = DeviceClock::new(None);
        let asleep = errors(&mut clock, 100, 120, 1.0, |ns| if ns < 20 * S { ns } else { ns - 5 * S });
        assert_eq!(clock.restarts(), 1, "as a restart: it goes back by 5 s");
        assert_within(&asleep[3_000..], 0.0, 3.0);
    }

    #[test]
    fn counters_wrap_at_their_own_width() {
        // uint32 us: 71.6 min. uint16 ms: 65.5 s. Both wrap within the data.
        for (span, before, hz, seconds) in
            [((1_i128 << 32) * 1_000, 4_290 * S, 100, 60), (65_536 * MS, 30 * S, 50, 400)]
        {
            let mut clock = DeviceClock::new(Some(span));
            let device = |true_ns: i128| (before + true_ns + true_ns / 20_000).rem_euclid(span);
            let errors = errors(&mut clock, hz, seconds, 1.0, device);
            assert_eq!(clock.restarts(), 0);
            assert_within(&errors[1_000..], 0.0, 2.0);
        }
    }

    #[test]
    fn wraps_that_nobody_heard_of_are_counted_by_the_receipts() {
        let span = 65_536 * MS;
        let mut clock = DeviceClock::new(Some(span));
        for sent in [0, S, 2 * S, 200 * S, 201 * S, 1_000 * S] {
            let stamp = clock.stamp((7 * S + sent).rem_euclid(span), Stamp((sent + MS) as i64));
            assert_eq!(i128::from(stamp.0), sent + MS);
        }
        assert_eq!(clock.restarts(), 0);
    }

    #[test]
    fn a_message_that_was_overtaken_gets_its_own_stamp() {
        for span in [None, Some(65_536 * MS)] {
            let mut clock = DeviceClock::new(span);
            let sent = [0, 10, 20, 40, 30, 50];
            let stamps = sent.map(|ms| clock.stamp(ms * MS, Stamp((100 * MS + ms * MS) as i64)).0);
            assert_eq!(stamps.map(|ns| i128::from(ns) / MS - 100), sent);
            assert_eq!(clock.restarts(), 0);
        }
    }

    #[test]
    fn any_numbers_give_stamps_and_no_panic() {
        let odd = [0, 1, -1, i128::MAX, i128::MIN, i128::from(i64::MAX), i128::from(u64::MAX) * S, S, -S];
        let receipts = [0, i64::MAX, i64::MIN, 1, -1];
        for span in [None, Some(LEAST_SPAN_NS), Some((1 << 32) * S)] {
            let mut clock = DeviceClock::new(span);
            for raw in odd {
                for received in receipts {
                    assert!(clock.stamp(raw, Stamp(received)).0 <= received);
                }
            }
        }
    }
}
