//! What time it is: that of the system, or that of `/clock`.

use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use crate::units::Stamp;

/// The clock of a node. Shared by its threads.
#[derive(Debug)]
pub(super) struct Clock {
    started: Instant,
    /// ns of `/clock`; none where the time is that of the system.
    sim: Option<AtomicI64>,
}

impl Clock {
    pub(super) fn new(use_sim_time: bool) -> Self {
        Clock { started: Instant::now(), sim: use_sim_time.then(|| AtomicI64::new(0)) }
    }

    /// Takes the time of `/clock`.
    pub(super) fn handle_clock(&self, time: Stamp) {
        if let Some(sim) = &self.sim {
            sim.store(time.0, Ordering::Relaxed);
        }
    }

    /// ROS time. Under sim time it is 0 until `/clock` was heard.
    pub(super) fn now(&self) -> Stamp {
        self.sim.as_ref().map_or_else(system_now, |sim| Stamp(sim.load(Ordering::Relaxed)))
    }

    /// Whether the time is that of `/clock`.
    pub(super) fn is_sim(&self) -> bool {
        self.sim.is_some()
    }

    /// Time since the start, which never jumps.
    pub(super) fn running(&self) -> std::time::Duration {
        self.started.elapsed()
    }
}

/// The system's time.
pub fn system_now() -> Stamp {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Stamp(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}
