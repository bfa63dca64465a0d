//! Runs the lifecycle: configures, activates, deactivates and so on.

use std::cell::RefCell;
use std::path::PathBuf;

use super::args::Severity;
use super::engine::Command;
use super::interfaces::TransitionEvent;
use super::lifecycle::{Lifecycle, State, Transition, Work};
use super::loading::{self, Loaded};
use super::node::NodeError;
use super::outbox::OutIdx;
use super::serving::Shared;
use crate::msg::to_cdr;

/// The lifecycle of a node, and the data that its transitions need.
pub(super) struct Managed {
    pub(super) life: RefCell<Lifecycle>,
    events: OutIdx,
    calibration: Option<PathBuf>,
}

impl Managed {
    pub(super) fn new(events: OutIdx, calibration: Option<PathBuf>) -> Self {
        Managed { life: RefCell::default(), events, calibration }
    }

    /// Configures and activates, unless a lifecycle manager does it.
    ///
    /// # Errors
    /// The reason why it can't be configured.
    pub(super) async fn autostart(&self, shared: &Shared) -> Result<(), NodeError> {
        if !shared.parameters.borrow().config().live.autostart {
            shared.outbox.log(Severity::Info, "autostart is false: waiting for a lifecycle manager");
            return Ok(());
        }
        for label in ["configure", "activate"] {
            self.change(shared, 0, label).await.map_err(NodeError::Configure)?;
        }
        Ok(())
    }

    /// Runs a transition.
    ///
    /// # Errors
    /// The reason why it is not possible or failed; the state has not changed.
    pub(super) async fn change(&self, shared: &Shared, id: u8, label: &str) -> Result<(), String> {
        let begun = self.life.borrow_mut().handle_request(id, label);
        let (work, step) = begun.map_err(|error| error.to_string())?;
        self.publish(shared, &step);
        let done = self.work(shared, work).await;
        let outcome = self.life.borrow_mut().handle_outcome(done.is_ok());
        if let Some(step) = outcome {
            self.publish(shared, &step);
        }
        if done.is_ok() {
            shared.outbox.log(Severity::Info, self.state().label());
        }
        done
    }

    /// The current state.
    pub(super) fn state(&self) -> State {
        self.life.borrow().state()
    }

    async fn work(&self, shared: &Shared, work: Work) -> Result<(), String> {
        match work {
            Work::Configure => {
                let cfg = shared.parameters.borrow().config().clone();
                let calibration = self.calibration.clone();
                // Models take a while to load; services are answered in the meantime.
                let loading = tokio::task::spawn_blocking(move || loading::load(&cfg, calibration.as_deref()));
                let Loaded { core, hashes, notes } = loading.await.map_err(|error| error.to_string())??;
                notes.into_iter().for_each(|(severity, text)| shared.outbox.log(severity, text));
                *shared.hashes.borrow_mut() = hashes;
                self.tell(shared, Command::Configure(Box::new(core)))
            }
            Work::CleanUp => self.tell(shared, Command::CleanUp),
            Work::Activate => self.tell(shared, Command::Active(true)),
            Work::Deactivate => self.tell(shared, Command::Active(false)),
            Work::ShutDown => {
                self.tell(shared, Command::Active(false))?;
                self.tell(shared, Command::CleanUp)
            }
        }
    }

    fn tell(&self, shared: &Shared, command: Command) -> Result<(), String> {
        shared.commands.send(command).map_err(|_| "the thread that estimates has ended; restart the node".to_owned())
    }

    fn publish(&self, shared: &Shared, step: &Transition) {
        let event = TransitionEvent::new(shared.clock.now().0, step);
        shared.outbox.send(self.events, to_cdr(&event), None);
    }
}
