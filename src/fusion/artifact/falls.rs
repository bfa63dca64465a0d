//! Falls of a touch that are spread over a few measurements, told from how much it goes up and down anyhow.
//!
//! A touch ends within a tenth of a second. An error of the artifact takes longer, so the difference to what was read shortly before
//! is nearly free of it, however uncertain the artifact is.

/// Measurements that are compared: the present one, and the mean of the oldest two of so many before it.
const N_BEFORE: usize = 4;
const N_OLDEST: usize = 2;

/// A fall by this share of a touch ends it, in part or wholly. One that is spread over measurements must be of so many deviations of
/// the usual ones; chosen on validation data (docs/validation).
pub(super) const ENDING_SHARE: f64 = 0.5;
const FALL_DEVIATIONS: f64 = 5.0;

/// Share by which the usual fall follows each measurement, 2 s of them; its variance at first, and at least, gF^2.
const FOLLOWS: f64 = 0.025;
const VARIANCE_AT_FIRST: f64 = 25.0;
const LEAST_VARIANCE: f64 = 0.25;

/// Compares what a touch reads with what it read before.
#[derive(Debug, Clone)]
pub(super) struct Falls {
    /// The readings before, the oldest first, gF, and how many of them are known.
    before: [f64; N_BEFORE],
    n_before: usize,
    /// Mean square of the falls, and rises, within this time, gF^2.
    variance: f64,
}

impl Default for Falls {
    fn default() -> Self {
        Falls { before: [0.0; N_BEFORE], n_before: 0, variance: VARIANCE_AT_FIRST }
    }
}

impl Falls {
    /// Says that the next reading does not follow on the last one.
    pub(super) fn restart(&mut self) {
        self.n_before = 0;
    }

    /// Takes what the taxels read of a touch now, gF. True if a touch that was there before has ended.
    pub(super) fn handle_reading(&mut self, reading_gf: f64, is_touched: bool) -> bool {
        let mut ended = false;
        if self.n_before == N_BEFORE {
            let before = self.before[..N_OLDEST].iter().sum::<f64>() / N_OLDEST as f64;
            let fall = before - reading_gf;
            let usual = self.variance.max(LEAST_VARIANCE).sqrt();
            if is_touched && fall > FALL_DEVIATIONS * usual && fall > ENDING_SHARE * before {
                ended = true;
            } else {
                self.variance += FOLLOWS * (fall * fall - self.variance);
            }
            self.before.rotate_left(1);
            self.n_before -= 1;
        }
        self.before[self.n_before] = reading_gf;
        self.n_before += 1;
        ended
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Measurements, from 1 on, at which a touch of this course ends.
    fn ends(course: impl Fn(usize) -> f64) -> Vec<usize> {
        let mut falls = Falls::default();
        let mut ended = |at: &usize| {
            let ended = falls.handle_reading(course(*at), true);
            if ended {
                falls.restart();
            }
            ended
        };
        (1..=200).filter(|at| ended(at)).collect()
    }

    /// Noise of about 1 gF that is the same in every run.
    fn noise(at: usize) -> f64 {
        ((at * 7919) % 101) as f64 / 29.0 - 1.7
    }

    #[test]
    fn a_fall_ends_a_touch_once_at_once_or_over_two_measurements() {
        assert_eq!(ends(|at| if at <= 100 { 10.0 + noise(at) } else { noise(at) }), [101]);
        let spread = |at: usize| [10.0, 5.5, 1.0][at.clamp(100, 102) - 100] + 0.5 * noise(at);
        assert_eq!(ends(spread), [102]);
    }

    #[test]
    fn what_goes_up_and_down_anyhow_or_falls_slowly_does_not_end() {
        assert!(ends(|at| 120.0 + 100.0 * (at as f64 / 10.0).sin()).is_empty());
        assert!(ends(|at| 10.0 + 3.0 * noise(at)).is_empty());
        assert!(ends(|at| 40.0 - 0.2 * at as f64 + noise(at)).is_empty());
        assert!(ends(|at| if at <= 100 { 100.0 } else { 60.0 }).is_empty(), "a touch that loses less than half stays");
        let mut falls = Falls::default();
        assert!(
            (1..=200).all(|at| !falls.handle_reading(if at <= 100 { 10.0 } else { 0.0 }, false)),
            "no touch, no end"
        );
    }

    #[test]
    fn readings_on_both_sides_of_a_gap_are_not_compared() {
        let mut falls = Falls::default();
        (0..100).for_each(|_| assert!(!falls.handle_reading(50.0, true)));
        falls.restart();
        assert!((0..100).all(|_| !falls.handle_reading(0.0, true)));
    }
}
