//! The thread that answers services and runs the lifecycle.

use std::cell::{Cell, RefCell};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use futures::StreamExt;
use tokio::sync::{mpsc, oneshot};

use super::calibrate_action;
use super::engine::Command;
use super::known_touches::{self, TruthInput};
use super::managed;
use super::outbox::{OutIdx, Outbox};
use super::parameters::Parameters;
use super::services;
use super::shared::{Managed, Shared};
use super::worn;
use crate::msg::from_cdr;
use crate::ros::wire::clock::{Clock, ClockMessage};
use crate::ros::wire::entities::Graph;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::middleware::Subscription;
use crate::ros::wire::threads::{self, Vital, runtime};

/// The data that serving needs.
pub(super) struct Duties {
    pub(super) managed: Managed,
    pub(super) parameters: Parameters,
    pub(super) commands: mpsc::UnboundedSender<Command>,
    pub(super) outbox: Outbox,
    pub(super) clock: Arc<Clock>,
    pub(super) parameter_events: OutIdx,
    pub(super) node_name: String,
    /// The folder from which calibrations may be loaded while the node runs.
    pub(super) calibration_folder: Option<PathBuf>,
    pub(super) sim_clock: Option<Subscription>,
    /// Force sensors, if calibrations look for touches of them.
    pub(super) truth: Vec<TruthInput>,
}

/// Reports from the thread.
pub(super) enum News {
    /// The services are ready. The receiver of the graph must leave it.
    Serving(Graph),
    /// The node can't be started.
    Failed(NodeError),
}

/// The thread.
pub(super) struct Serving {
    thread: JoinHandle<()>,
    stop: oneshot::Sender<()>,
}

/// Starts to offer services, and configures and activates the node unless a lifecycle manager does it.
pub(super) fn start(graph: Graph, duties: Duties) -> Result<(Serving, Receiver<News>), NodeError> {
    let (sender, news) = channel();
    let (stop, stopped) = oneshot::channel();
    let runtime = runtime()?;
    let thread = threads::spawn("services", move || {
        let served = tokio::task::LocalSet::new().block_on(&runtime, serve(graph, duties, &sender, stopped));
        if let Err(error) = served {
            let _ = sender.send(News::Failed(error)); // the node is leaving already
        }
        // Don't wait for a model that is being loaded.
        runtime.shutdown_background();
    })?;
    Ok((Serving { thread, stop }, news))
}

impl Serving {
    /// The graph, if it arrived only after the node was asked to end.
    pub(super) fn last_news(&self, news: &Receiver<News>) -> Option<Graph> {
        news.try_iter().find_map(|news| match news {
            News::Serving(graph) => Some(graph),
            News::Failed(_) => None,
        })
    }

    /// Stops answering, and waits up to a limit for a request in progress.
    pub(super) fn end(self, limit: Duration) {
        let _ = self.stop.send(()); // the thread may have ended
        threads::ends_within(&self.thread, limit);
    }
}

async fn serve(
    mut graph: Graph,
    duties: Duties,
    news: &Sender<News>,
    stopped: oneshot::Receiver<()>,
) -> Result<(), NodeError> {
    let Duties {
        managed,
        parameters,
        commands,
        outbox,
        clock,
        parameter_events,
        node_name,
        calibration_folder,
        sim_clock,
        truth,
    } = duties;
    let shared = Rc::new(Shared {
        managed,
        parameters: RefCell::new(parameters),
        commands,
        outbox,
        clock: Arc::clone(&clock),
        parameter_events,
        known: RefCell::default(),
        calibrating: Cell::new(false),
        truth_tap: RefCell::new(None),
        worn_failed: Cell::new(false),
        node_name,
        calibration_folder,
    });
    services::start(&mut graph, &shared)?;
    calibrate_action::start(&mut graph, &shared)?;
    truth.into_iter().for_each(|input| known_touches::follow(input, Rc::clone(&shared)));
    let _ = news.send(News::Serving(graph)); // a node that is leaving already drops it
    if let Some(subscription) = sim_clock {
        tokio::task::spawn_local(follow(subscription, clock));
    }
    tokio::task::spawn_local(worn::keep_on(Rc::clone(&shared)));
    let starting = async {
        match managed::autostart(&shared).await {
            Ok(()) => std::future::pending().await,
            Err(error) => error,
        }
    };
    tokio::select! {
        biased;
        _ = stopped => {
            worn::keep(&shared, worn::LAST_LIMIT).await;
            Ok(())
        }
        error = starting => Err(error),
    }
}

/// Sets the clock from the messages on `/clock`.
async fn follow(subscription: Subscription, clock: Arc<Clock>) {
    let _vital = Vital::new("/clock");
    let mut times = subscription.arrivals();
    while let Some(time) = times.next().await {
        if let Ok(time) = time
            && let Ok(message) = from_cdr::<ClockMessage>(&time.cdr)
        {
            clock.handle_clock(message.clock.into());
        }
    }
}
