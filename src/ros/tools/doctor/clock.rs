//! The system's clock: whether it jumps, and whether something keeps it right.

use std::path::Path;
use std::time::{Duration, Instant};

use super::{Finding, Level};
use crate::ros::wire::clock::system_now;
use crate::units::{NANOS_PER_SEC, Stamp};

/// Smallest step that is a jump, ns: a clock that is slewed changes by half a millisecond per second.
const JUMP_NS: i64 = 10_000_000;

/// 2020-01-01, ns: any earlier time is that of a machine that lost its time.
const SANE: Stamp = Stamp(1_577_836_800 * NANOS_PER_SEC);

/// Marks that services leave: a file, what it means, and whether it says that the clock is synchronized.
const MARKS: [(&str, &str, bool); 6] = [
    ("run/systemd/timesync/synchronized", "systemd-timesyncd has synchronized it", true),
    ("run/chrony/chronyd.pid", "chronyd runs; `chronyc tracking` shows if it is synchronized", false),
    ("run/chronyd.pid", "chronyd runs; `chronyc tracking` shows if it is synchronized", false),
    ("run/ntpd.pid", "ntpd runs; `ntpq -p` shows if it is synchronized", false),
    ("run/ptp4l", "ptp4l runs; `pmc -u 'GET TIME_STATUS_NP'` shows if it is synchronized", false),
    ("run/phc2sys.pid", "phc2sys runs; its log shows if it is synchronized", false),
];

/// Compares the system's clock with one that never jumps.
pub(super) struct ClockWatch {
    began: Instant,
    last: (Duration, Stamp),
    /// The largest jump, ns.
    jump_ns: i64,
}

impl ClockWatch {
    pub(super) fn start() -> Self {
        ClockWatch { began: Instant::now(), last: (Duration::ZERO, system_now()), jump_ns: 0 }
    }

    /// Compares now.
    pub(super) fn look(&mut self) {
        // The system's clock is read between two readings of the other; if they are far apart, it tells nothing.
        let (before, system, after) = (self.began.elapsed(), system_now(), self.began.elapsed());
        if after.saturating_sub(before) < Duration::from_nanos(JUMP_NS.unsigned_abs() / 4) {
            self.handle(before, system);
        }
    }

    fn handle(&mut self, running: Duration, system: Stamp) {
        let (running_before, system_before) = self.last;
        let passed_ns = running.saturating_sub(running_before).as_nanos() as i64;
        let jump_ns = system.nanos_since(system_before) - passed_ns;
        if jump_ns.abs() > self.jump_ns.abs() {
            self.jump_ns = jump_ns;
        }
        self.last = (running, system);
    }

    /// The findings, by the marks below a root folder.
    pub(super) fn findings(&self, root: &Path) -> Vec<Finding> {
        let mut findings = Vec::new();
        let watched_s = self.last.0.as_secs_f64();
        if self.last.1 < SANE {
            let text = "the system's time is before 2020: stamps are useless; set the clock".to_owned();
            findings.push(Finding::new("clock", Level::Problem, text));
        }
        findings.push(if self.jump_ns.abs() >= JUMP_NS {
            let jump_ms = self.jump_ns as f64 * 1e-6;
            let text = format!(
                "the system's clock jumped by {jump_ms:.1} ms within {watched_s:.0} s: data before and after don't fit together; let a service slew it (chronyd, systemd-timesyncd), and set it by nobody else"
            );
            Finding::new("clock", Level::Problem, text)
        } else {
            Finding::new("clock", Level::Ok, format!("no jump within {watched_s:.0} s"))
        });
        findings.push(match MARKS.iter().find(|(file, ..)| root.join(file).exists()) {
            Some((_, text, true)) => Finding::new("clock", Level::Ok, *text),
            Some((_, text, false)) => Finding::new("clock", Level::Warning, format!("not checked if synchronized: {text}")),
            None => Finding::new(
                "clock",
                Level::Warning,
                "not checked if synchronized: no sign of a service that does it, as in a container; needed if the drivers run on other machines: run chronyd or ptp4l there and here",
            ),
        });
        findings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch() -> ClockWatch {
        ClockWatch { began: Instant::now(), last: (Duration::ZERO, Stamp(SANE.0 + 1)), jump_ns: 0 }
    }

    fn at(seconds: f64) -> Stamp {
        Stamp(SANE.0 + 1 + (seconds * 1e9) as i64)
    }

    #[test]
    fn a_jump_is_told_either_way_and_a_slewed_clock_is_none() {
        let root = tempfile::tempdir().unwrap();
        for (system, level) in
            [([1.0, 2.001, 3.0], Level::Ok), ([1.0, 2.5, 3.5], Level::Problem), ([1.0, 1.2, 2.2], Level::Problem)]
        {
            let mut watch = watch();
            for (second, system) in (1..).zip(system) {
                watch.handle(Duration::from_secs(second), at(system));
            }
            let found = watch.findings(root.path());
            assert_eq!(found[0].level, level, "{found:?}");
        }
    }

    #[test]
    fn who_keeps_the_clock_is_told_and_ok_is_said_only_of_what_is_known() {
        let root = tempfile::tempdir().unwrap();
        let last = |root: &Path| watch().findings(root).pop().unwrap();
        let unknown = last(root.path());
        assert!(unknown.level == Level::Warning && unknown.text.starts_with("not checked"), "{unknown:?}");
        std::fs::create_dir_all(root.path().join("run/systemd/timesync")).unwrap();
        std::fs::write(root.path().join("run/systemd/timesync/synchronized"), "").unwrap();
        assert_eq!(last(root.path()).level, Level::Ok);
        let mut lost = watch();
        lost.handle(Duration::from_secs(1), Stamp(5));
        assert!(lost.findings(root.path())[0].text.starts_with("the system's time is before 2020"));
    }
}
