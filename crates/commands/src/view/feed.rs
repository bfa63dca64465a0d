//! Updates for the pages of a running node, as they come.

use std::convert::Infallible;
use std::sync::Arc;

use axum::response::sse::Event as Sent;
use futures::Stream;
use serde::Serialize;
use tokio::sync::broadcast::{self, error::RecvError};

use super::setup::Setup;

/// Updates that a page may be behind before it misses some.
const QUEUE: usize = 64;

/// Sends updates to the pages of a running node.
#[derive(Debug, Clone)]
pub struct Feed {
    setup: Arc<Setup>,
    sender: broadcast::Sender<Arc<str>>,
}

/// How a node is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum State {
    /// Nothing has come yet.
    Waiting,
    /// It publishes.
    Present,
    /// It published, and does so no more.
    Silent,
    /// It is no longer in the graph.
    Gone,
}

/// The data since the last update, and how the node is now.
#[derive(Debug, Serialize)]
pub(super) struct Update<'a> {
    pub(super) state: State,
    /// s since the last contacts came; none before the first.
    pub(super) age_s: Option<f64>,
    pub(super) rate_hz: f64,
    /// Stamp to arrival, ms: median and 99th percentile.
    pub(super) latency_ms: Option<(f64, f64)>,
    /// `[regions]`.
    pub(super) regions: Vec<RegionUpdate>,
    pub(super) diagnostics: Vec<(&'a str, &'a str, &'a str)>,
    /// Age of the diagnostics, s, where it is too high.
    pub(super) diagnostics_late_s: Option<f64>,
    /// Frames that were left out, and messages that were dropped, since the start.
    pub(super) skipped: u64,
    pub(super) notes: Vec<String>,
}

/// A region since the last update.
///
/// # Shapes
/// `[frames]`; `reading`: `[taxels]`, none where no taxels come.
#[derive(Debug, Default, Serialize)]
pub(super) struct RegionUpdate {
    /// s since the Unix epoch.
    pub(super) t: Vec<f64>,
    pub(super) force: Vec<f64>,
    pub(super) force_base: Vec<f64>,
    pub(super) artifact: Vec<f64>,
    pub(super) touch: Vec<f64>,
    pub(super) pose_age: Vec<f64>,
    pub(super) artifact_change: Vec<f64>,
    pub(super) contact: Vec<bool>,
    pub(super) flags: Vec<u32>,
    pub(super) adaptation: Vec<u8>,
    pub(super) reading: Option<Vec<f32>>,
}

impl Feed {
    /// A feed for pages of a node.
    pub(super) fn new(setup: Setup) -> Self {
        Feed { setup: Arc::new(setup), sender: broadcast::channel(QUEUE).0 }
    }

    /// Tells all pages that are open, which may be none.
    pub(super) fn tell(&self, update: &Update<'_>) {
        if let Ok(text) = serde_json::to_string(update) {
            let _ = self.sender.send(text.into());
        }
    }

    pub(super) fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The updates from now on. A page that is too slow misses some, and never holds others up.
    pub(super) fn updates(&self) -> impl Stream<Item = Result<Sent, Infallible>> + use<> {
        futures::stream::unfold(self.sender.subscribe(), |mut receiver| async move {
            let sent = match receiver.recv().await {
                Ok(update) => Sent::default().data(&*update),
                Err(RecvError::Lagged(n)) => Sent::default().event("missed").data(n.to_string()),
                Err(RecvError::Closed) => return None,
            };
            Some((Ok(sent), receiver))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::setup::Kind;

    #[test]
    fn a_page_that_is_too_slow_misses_the_oldest_updates_and_holds_nobody_up() {
        let feed = Feed::new(Setup::new("node".to_owned(), Kind::Live, String::new(), Vec::new()));
        let updates = feed.updates();
        for number in 0..QUEUE + 10 {
            assert!(feed.sender.send(number.to_string().into()).is_ok());
        }
        drop(feed);
        let events: Vec<String> = futures::executor::block_on(async {
            futures::StreamExt::collect::<Vec<_>>(updates).await.into_iter().map(|event| format!("{event:?}")).collect()
        });
        assert_eq!(events.len(), QUEUE + 1, "how many were missed, and the newest");
        assert!(events[0].contains("missed"), "{}", events[0]);
    }
}
