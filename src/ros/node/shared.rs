//! Data shared by the services, the action and the lifecycle.

use std::cell::{Cell, RefCell};
use std::path::PathBuf;
use std::sync::Arc;

use tokio::sync::mpsc;

use super::engine::Command;
use super::lifecycle::{Lifecycle, State};
use super::outbox::{OutIdx, Outbox};
use super::parameters::Parameters;
use crate::ros::wire::clock::Clock;
use crate::sessions::TruthReading;
use crate::zero::KnownModels;

/// Data shared by the services.
pub(super) struct Shared {
    pub(super) parameters: RefCell<Parameters>,
    pub(super) managed: Managed,
    pub(super) commands: mpsc::UnboundedSender<Command>,
    pub(super) outbox: Outbox,
    pub(super) clock: Arc<Clock>,
    pub(super) parameter_events: OutIdx,
    /// The models in use, as a calibration must fit them.
    pub(super) known: RefCell<KnownModels>,
    /// True while a calibration is in progress.
    pub(super) calibrating: Cell<bool>,
    /// Takes the readings of the force sensors while a calibration collects them.
    pub(super) truth_tap: RefCell<Option<mpsc::UnboundedSender<TruthReading>>>,
    /// True if `calibration.worn_file` could not be written.
    pub(super) worn_failed: Cell<bool>,
    pub(super) node_name: String,
    /// The folder from which calibrations may be loaded while the node runs; `None` if it was started without one.
    pub(super) calibration_folder: Option<PathBuf>,
}

/// The lifecycle of a node, and the data that its transitions need.
pub(super) struct Managed {
    pub(super) life: RefCell<Lifecycle>,
    pub(super) events: OutIdx,
    /// The calibration that was named at the start, until a request names another.
    pub(super) calibration: RefCell<Option<PathBuf>>,
}

impl Managed {
    pub(super) fn new(events: OutIdx, calibration: Option<PathBuf>) -> Self {
        Managed { life: RefCell::default(), events, calibration: RefCell::new(calibration) }
    }

    /// The current state.
    pub(super) fn state(&self) -> State {
        self.life.borrow().state()
    }
}
