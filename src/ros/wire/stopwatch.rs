//! A timer that also counts time while this process, or the whole machine, is suspended.

use std::time::{Duration, Instant};

/// Measures elapsed time, also while the process is stopped and, on Linux, while the machine is suspended, which
/// `Instant` leaves out there.
#[derive(Debug, Clone, Copy)]
pub(in crate::ros) struct Stopwatch {
    begun: Instant,
    uptime: Option<Duration>,
}

impl Stopwatch {
    pub(in crate::ros) fn start() -> Self {
        Stopwatch { begun: Instant::now(), uptime: uptime() }
    }

    pub(in crate::ros) fn elapsed(&self) -> Duration {
        let with_suspends = self.uptime.zip(uptime()).map(|(begun, now)| now.saturating_sub(begun));
        self.begun.elapsed().max(with_suspends.unwrap_or_default())
    }
}

/// Time since the machine was started, including suspends, to a hundredth of a second.
fn uptime() -> Option<Duration> {
    if !cfg!(target_os = "linux") {
        return None;
    }
    let text = std::fs::read_to_string("/proc/uptime").ok()?;
    Duration::try_from_secs_f64(text.split_whitespace().next()?.parse().ok()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_goes_by() {
        let watch = Stopwatch::start();
        std::thread::sleep(Duration::from_millis(60));
        let elapsed = watch.elapsed();
        assert!((Duration::from_millis(60)..Duration::from_secs(5)).contains(&elapsed), "{elapsed:?}");
        assert_eq!(uptime().is_some(), cfg!(target_os = "linux"));
        let suspended = Stopwatch { uptime: uptime().map(|now| now.saturating_sub(Duration::from_secs(1))), ..watch };
        assert_eq!(suspended.elapsed() >= Duration::from_millis(900), cfg!(target_os = "linux"));
    }
}
