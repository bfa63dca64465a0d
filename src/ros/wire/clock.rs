//! The node's time: system time or the time on `/clock`.

use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::msg::{Time, WireType};
use crate::units::Stamp;

/// `rosgraph_msgs/msg/Clock`.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(in crate::ros) struct ClockMessage {
    pub(in crate::ros) clock: Time,
}

impl WireType for ClockMessage {
    const TYPE_NAME: &'static str = "rosgraph_msgs/msg/Clock";
}

/// The clock of a node. Shared by its threads.
#[derive(Debug)]
pub(in crate::ros) struct Clock {
    started: Instant,
    /// Time of `/clock`, ns; `None` if system time is used.
    sim: Option<AtomicI64>,
}

impl Clock {
    pub(in crate::ros) fn new(use_sim_time: bool) -> Self {
        Clock { started: Instant::now(), sim: use_sim_time.then(|| AtomicI64::new(0)) }
    }

    /// Stores the time from `/clock`.
    pub(in crate::ros) fn handle_clock(&self, time: Stamp) {
        if let Some(sim) = &self.sim {
            sim.store(time.0, Ordering::Relaxed);
        }
    }

    /// ROS time. With sim time it is 0 until the first message on `/clock`.
    pub(in crate::ros) fn now(&self) -> Stamp {
        self.sim.as_ref().map_or_else(system_now, |sim| Stamp(sim.load(Ordering::Relaxed)))
    }

    /// True if the time is that of `/clock`.
    pub(in crate::ros) fn is_sim(&self) -> bool {
        self.sim.is_some()
    }

    /// Time since the start, which never jumps.
    pub(in crate::ros) fn running(&self) -> std::time::Duration {
        self.started.elapsed()
    }
}

/// The system's time.
pub fn system_now() -> Stamp {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Stamp(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}
