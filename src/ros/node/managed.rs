//! Runs the lifecycle: configures, activates, deactivates and so on.

use super::engine::Command;
use super::interfaces::TransitionEvent;
use super::lifecycle::{Transition, Work};
use super::loading::{self, Loaded};
use super::shared::Shared;
use super::worn;
use crate::msg::to_cdr;
use crate::ros::wire::args::Severity;
use crate::ros::wire::error::NodeError;

/// Configures and activates, unless a lifecycle manager does it.
///
/// # Errors
/// The reason why it can't be configured.
pub(super) async fn autostart(shared: &Shared) -> Result<(), NodeError> {
    if !shared.parameters.borrow().config().live.autostart {
        shared.outbox.log(Severity::Info, "autostart is false: waiting for a lifecycle manager");
        return Ok(());
    }
    for label in ["configure", "activate"] {
        change(shared, 0, label).await.map_err(NodeError::Configure)?;
    }
    Ok(())
}

/// Runs a transition.
///
/// # Errors
/// The reason why it is not possible or failed; the state has not changed.
pub(super) async fn change(shared: &Shared, id: u8, label: &str) -> Result<(), String> {
    let begun = shared.managed.life.borrow_mut().handle_request(id, label);
    let (work, step) = begun.map_err(|error| error.to_string())?;
    publish(shared, &step);
    let done = carry_out(shared, work).await;
    let outcome = shared.managed.life.borrow_mut().handle_outcome(done.is_ok());
    if let Some(step) = outcome {
        publish(shared, &step);
    }
    if done.is_ok() {
        shared.outbox.log(Severity::Info, shared.managed.state().label());
    }
    done
}

async fn carry_out(shared: &Shared, work: Work) -> Result<(), String> {
    match work {
        Work::Configure => {
            let cfg = shared.parameters.borrow().config().clone();
            let calibration = shared.managed.calibration.borrow().clone();
            // Models take a while to load; services are answered in the meantime.
            let loading = tokio::task::spawn_blocking(move || loading::load(&cfg, calibration.as_deref()));
            let Loaded { core, known, notes } = loading.await.map_err(|error| error.to_string())??;
            notes.into_iter().for_each(|(severity, text)| shared.outbox.log(severity, text));
            *shared.known.borrow_mut() = known;
            tell(shared, Command::Configure(Box::new(core)))
        }
        Work::CleanUp => {
            worn::keep(shared, worn::LIMIT).await;
            tell(shared, Command::CleanUp)
        }
        Work::Activate => tell(shared, Command::Active(true)),
        Work::Deactivate => tell(shared, Command::Active(false)),
        Work::ShutDown => {
            tell(shared, Command::Active(false))?;
            worn::keep(shared, worn::LIMIT).await;
            tell(shared, Command::CleanUp)
        }
    }
}

fn tell(shared: &Shared, command: Command) -> Result<(), String> {
    shared.commands.send(command).map_err(|_| "the thread that estimates has ended; restart the node".to_owned())
}

fn publish(shared: &Shared, step: &Transition) {
    let event = TransitionEvent::new(shared.clock.now().0, step);
    shared.outbox.send(shared.managed.events, to_cdr(&event), None);
}
