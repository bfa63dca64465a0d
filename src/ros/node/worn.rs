//! The calibration as it is while the glove is worn, in a file: a node that starts again goes on from there.
//!
//! `~/tare` and the artifact filter change the calibration, and `calibration.file` has only what `~/calibrate` found.

use std::rc::Rc;
use std::time::Duration;

use tokio::sync::oneshot;

use super::engine::Command;
use super::shared::Shared;
use crate::ros::wire::args::Severity;
use crate::ros::wire::threads::Vital;
use crate::zero::{Zero, ZeroFrom};

/// How often the file is written. More would wear out the storage of a robot, and gains change over minutes.
const PERIOD: Duration = Duration::from_secs(30);

/// Time limit for one writing while the node runs.
pub(super) const LIMIT: Duration = Duration::from_secs(5);

/// The same at the end, where a disk that hangs must not keep the node in the graph. There is one from before then.
pub(super) const LAST_LIMIT: Duration = Duration::from_millis(80);

/// Keeps the calibration from time to time, without end.
pub(super) async fn keep_on(shared: Rc<Shared>) {
    let _vital = Vital::new("calibration.worn_file");
    loop {
        tokio::time::sleep(PERIOD).await;
        keep(&shared, LIMIT).await;
    }
}

/// Keeps the calibration in use, if there is one and a file for it. A failure is logged once.
///
/// `limit`: for the engine to answer, and again for the writing.
pub(super) async fn keep(shared: &Shared, limit: Duration) {
    let Some(path) = shared.parameters.borrow().config().calibration.worn_file.clone() else { return };
    let cfg = shared.parameters.borrow().config().clone();
    let (reply, known) = oneshot::channel();
    if shared.commands.send(Command::Known(reply)).is_err() {
        return;
    }
    let Ok(Ok((donning, Some(from)))) = tokio::time::timeout(limit, known).await else { return };
    let mut calibration =
        Zero::new(ZeroFrom::Live { frames: 0 }, donning).to_calibration(&cfg, &shared.known.borrow().hashes);
    calibration.recorded = format!("{from}; kept while the glove was worn");
    let shown = path.display().to_string();
    let writing = tokio::task::spawn_blocking(move || calibration.replace(&path));
    let failure = match tokio::time::timeout(limit, writing).await {
        Ok(Ok(Ok(()))) => None,
        Ok(Ok(Err(error))) => Some(error.to_string()),
        Ok(Err(error)) => Some(error.to_string()),
        Err(_) => Some(format!("{shown}: it takes too long to write")),
    };
    if let Some(why) = failure
        && !shared.worn_failed.replace(true)
    {
        shared.outbox.log(Severity::Warn, format!("calibration.worn_file is not kept: {why}"));
    }
}
