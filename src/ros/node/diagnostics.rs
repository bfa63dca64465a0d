//! The numbers behind `/diagnostics`: rates, ages, jitter, latency, and their budgets. Pure: time is an argument, as
//! the span since any fixed moment.

use std::collections::VecDeque;
use std::time::Duration;

/// Status level. The numbers are those of `diagnostic_msgs/msg/DiagnosticStatus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Normal.
    Ok = 0,
    /// Something is wrong.
    Warn = 1,
    /// Something has been wrong for longer than its limit.
    Error = 2,
    /// There is no data.
    Stale = 3,
}

/// Status of one part of the node.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// Name of the part.
    pub name: String,
    /// Its level.
    pub level: Level,
    /// Summary in a few words.
    pub message: String,
    /// Keys and values.
    pub values: Vec<(String, String)>,
}

/// Longest window over which a rate is computed.
const RATE_WINDOW: Duration = Duration::from_secs(2);

/// Maximum number of arrivals kept for a rate: 2 s at 4 kHz.
const MAX_ARRIVALS: usize = 8192;

/// Rate, jitter and age of a stream.
#[derive(Debug, Clone, Default)]
pub struct RateMeter {
    arrivals: VecDeque<Duration>,
    last: Option<Duration>,
    n_total: u64,
}

impl RateMeter {
    /// Records an arrival.
    pub fn handle_arrival(&mut self, now: Duration) {
        self.n_total += 1;
        self.last = Some(now);
        if self.arrivals.len() == MAX_ARRIVALS {
            self.arrivals.pop_front();
        }
        self.arrivals.push_back(now);
    }

    /// Drops arrivals that are too old for the current rate.
    pub fn poll(&mut self, now: Duration) {
        while self.arrivals.front().is_some_and(|first| now.saturating_sub(*first) > RATE_WINDOW) {
            self.arrivals.pop_front();
        }
    }

    /// Arrivals per second over the last two seconds; `None` below two arrivals.
    pub fn rate_hz(&self) -> Option<f64> {
        let span = self.arrivals.back()?.saturating_sub(*self.arrivals.front()?).as_secs_f64();
        (span > 0.0).then(|| (self.arrivals.len() - 1) as f64 / span)
    }

    /// Standard deviation of the time between arrivals, ms.
    pub fn jitter_ms(&self) -> Option<f64> {
        let steps =
            || self.arrivals.iter().zip(self.arrivals.iter().skip(1)).map(|(a, b)| (*b - *a).as_secs_f64() * 1e3);
        let n = steps().count();
        if n == 0 {
            return None;
        }
        let mean = steps().sum::<f64>() / n as f64;
        Some((steps().map(|step| (step - mean).powi(2)).sum::<f64>() / n as f64).sqrt())
    }

    /// Time since the last arrival.
    pub fn age(&self, now: Duration) -> Option<Duration> {
        self.last.map(|last| now.saturating_sub(last))
    }

    /// Total number of arrivals.
    pub fn n_total(&self) -> u64 {
        self.n_total
    }
}

/// Maximum number of latencies kept between two reports: 16 s at 1 kHz.
const MAX_LATENCIES: usize = 16_384;

/// Latencies since the last report.
#[derive(Debug, Clone, Default)]
pub struct Latencies {
    nanos: Vec<i64>,
}

/// Latencies of a time window, ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
}

impl Latencies {
    /// Records a latency. Latencies beyond the maximum number are dropped.
    pub fn handle(&mut self, nanos: i64) {
        if self.nanos.len() < MAX_LATENCIES {
            self.nanos.push(nanos);
        }
    }

    /// The latencies since the last call; `None` if there were none.
    pub fn take(&mut self) -> Option<Percentiles> {
        self.nanos.sort_unstable();
        // Nearest rank: the smallest value with at least that share at or below it.
        let rank = |share: f64| ((share * self.nanos.len() as f64).ceil() as usize).saturating_sub(1);
        let ms = |idx: usize| self.nanos.get(idx).map(|nanos| *nanos as f64 * 1e-6);
        let taken = Some(Percentiles { p50: ms(rank(0.5))?, p99: ms(rank(0.99))?, max: ms(self.nanos.len() - 1)? });
        self.nanos.clear();
        taken
    }
}

/// A limit that may be exceeded for a while.
#[derive(Debug, Clone)]
pub struct Budget {
    sustained: Duration,
    over_since: Option<Duration>,
}

impl Budget {
    /// A budget that becomes an error after it was exceeded for `sustained`.
    pub fn new(sustained: Duration) -> Self {
        Budget { sustained, over_since: None }
    }

    /// Records whether the budget is kept at `now`.
    pub fn handle(&mut self, now: Duration, kept: bool) -> Level {
        if kept {
            self.over_since = None;
            return Level::Ok;
        }
        let since = *self.over_since.get_or_insert(now);
        if now.saturating_sub(since) >= self.sustained { Level::Error } else { Level::Warn }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> Duration = Duration::from_millis;

    #[test]
    fn a_rate_is_that_of_the_last_two_seconds() {
        let mut meter = RateMeter::default();
        assert_eq!((meter.rate_hz(), meter.jitter_ms(), meter.age(MS(5))), (None, None, None));
        (0..1000).for_each(|k| meter.handle_arrival(MS(k)));
        (100..500).for_each(|k| meter.handle_arrival(MS(k * 10)));
        meter.poll(MS(4990));
        assert!((meter.rate_hz().unwrap() - 100.0).abs() < 1e-9);
        assert!(meter.jitter_ms().unwrap() < 1e-9);
        assert_eq!((meter.age(MS(5000)), meter.n_total()), (Some(MS(10)), 1400));
        meter.poll(MS(60_000));
        assert_eq!(meter.rate_hz(), None);
    }

    #[test]
    fn jitter_is_the_deviation_of_the_steps() {
        let mut meter = RateMeter::default();
        [0, 8, 20, 28, 40].into_iter().for_each(|at| meter.handle_arrival(MS(at)));
        assert!((meter.jitter_ms().unwrap() - 2.0).abs() < 1e-9); // steps of 8 and 12
    }

    #[test]
    fn percentiles_are_those_of_the_nearest_rank_since_the_last_report() {
        let mut latencies = Latencies::default();
        assert_eq!(latencies.take(), None);
        (1..=100).rev().for_each(|ms| latencies.handle(ms * 1_000_000));
        assert_eq!(latencies.take(), Some(Percentiles { p50: 50.0, p99: 99.0, max: 100.0 }));
        latencies.handle(-2_000_000);
        assert_eq!(latencies.take(), Some(Percentiles { p50: -2.0, p99: -2.0, max: -2.0 }));
        (0..20_000).for_each(|_| latencies.handle(1));
        assert_eq!(latencies.nanos.len(), MAX_LATENCIES);
    }

    #[test]
    fn a_budget_warns_first_and_is_an_error_when_it_lasts() {
        let mut budget = Budget::new(MS(3000));
        let levels: Vec<Level> = [(0, true), (1000, false), (3999, false), (4000, false), (5000, true), (6000, false)]
            .map(|(at, kept)| budget.handle(MS(at), kept))
            .into();
        assert_eq!(levels, [Level::Ok, Level::Warn, Level::Warn, Level::Error, Level::Ok, Level::Warn]);
    }
}
