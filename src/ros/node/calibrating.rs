//! A calibration of the running node, which `~/calibrate` and `~/tare` share.

use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::Instant;

use super::calibrator::{Calibrator, IN_AIR, Purpose, Sample, TOUCH};
use super::engine::Command;
use super::loading;
use super::shared::Shared;
use crate::config::Config;
use crate::msg::{CalibrateFeedback, CalibrateResult, Duration as WireDuration};
use crate::ros::wire::args::Severity;
use crate::sessions::{KnownForces, RegionTouches, TruthReading, live_force_gains};
use crate::units::nanos;
use crate::zero::{Donning, Zero, ZeroFrom};

/// How often the progress of a calibration is checked; a calibration takes seconds.
pub(super) const POLL: Duration = Duration::from_millis(20);

/// How often feedback is sent.
const FEEDBACK: Duration = Duration::from_millis(500);

/// Why a calibration is not in use.
type Refused = String;

/// Collects samples for a while, judges them, and applies the calibration in the engine. The result reports the
/// outcome.
pub(super) async fn calibrate(
    shared: &Shared,
    purpose: Purpose,
    duration: Duration,
    feedback: impl FnMut(CalibrateFeedback),
    cancelled: impl Fn() -> bool,
) -> CalibrateResult {
    let refused = |message: String| CalibrateResult { message, ..CalibrateResult::default() };
    if shared.calibrating.replace(true) {
        return refused("a calibration is under way already; wait until it is over".to_owned());
    }
    let result = collect_and_apply(shared, purpose, duration, feedback, &cancelled).await.unwrap_or_else(refused);
    shared.truth_tap.replace(None);
    shared.calibrating.set(false);
    let severity = if result.success { Severity::Info } else { Severity::Warn };
    shared.outbox.log(severity, result.message.as_str());
    result
}

async fn collect_and_apply(
    shared: &Shared,
    purpose: Purpose,
    duration: Duration,
    mut feedback: impl FnMut(CalibrateFeedback),
    cancelled: &dyn Fn() -> bool,
) -> Result<CalibrateResult, Refused> {
    let cfg = shared.parameters.borrow().config().clone();
    let (tap, mut samples) = mpsc::unbounded_channel();
    let (truth_tap, mut readings) = mpsc::unbounded_channel();
    let touch_duration = if purpose == Purpose::Calibrate { cfg.calibration.touch_duration } else { Duration::ZERO };
    if !touch_duration.is_zero() {
        shared.truth_tap.replace(Some(truth_tap));
    }
    let gone = || "the thread that estimates has ended; restart the node".to_owned();
    shared.commands.send(Command::Tap(tap)).map_err(|_| gone())?;
    let mut calibrator = Calibrator::new(&cfg, purpose, duration);
    collect(&mut samples, &mut calibrator, duration, cancelled, &mut |calibrator, left| {
        feedback(CalibrateFeedback { instruction: IN_AIR.to_owned(), ..calibrator.feedback(left) });
    })
    .await?;
    let ((donning, mut result), mut calibrator) = judge(shared, calibrator, cfg.clone(), purpose).await?;
    let Some(mut donning) = donning else { return Ok(result) };
    let what = if purpose == Purpose::Tare { "tared" } else { "calibrated" };
    let mut from = format!("{what} live from {} frames", result.frames);
    let mut uncorrected = None;
    if !touch_duration.is_zero() {
        shared.outbox.log(Severity::Info, format!("now {TOUCH}; {:.0} s", touch_duration.as_secs_f64()));
        let mut instruct = |left| {
            feedback(CalibrateFeedback {
                instruction: TOUCH.to_owned(),
                time_left: WireDuration::from_nanos(nanos(left)),
                ..CalibrateFeedback::default()
            });
        };
        instruct(touch_duration);
        collect(&mut samples, &mut calibrator, touch_duration, cancelled, &mut |_, left| instruct(left)).await?;
        let readings: Vec<TruthReading> = std::iter::from_fn(|| readings.try_recv().ok()).collect();
        match fit_gains(calibrator, readings, cfg.clone(), donning.clone(), duration).await {
            Ok(found) => {
                donning.force_gains = vec![None; cfg.fusion().regions().len()];
                for found in &found {
                    donning.force_gains[found.region] = Some(found.gain);
                    from.push_str(&format!("; {}", found.text(&cfg)));
                }
            }
            Err(reason) => uncorrected = Some(format!("the forces of this donning are not corrected: {reason}")),
        }
    }
    let (reply, installed) = oneshot::channel();
    let told = shared.commands.send(Command::Calibrated(Box::new(donning.clone()), from.clone(), reply));
    let installed = if told.is_ok() { installed.await.unwrap_or_else(|_| Err(gone())) } else { Err(gone()) };
    if let Err(message) = installed {
        return Ok(CalibrateResult { success: false, message, ..result });
    }
    if let Some(uncorrected) = &uncorrected {
        shared.outbox.log(Severity::Warn, uncorrected.as_str());
    }
    let noted = Some(std::mem::take(&mut result.message)).filter(|noted| !noted.is_empty());
    let parts: Vec<String> = [Some(from.clone()), noted, uncorrected].into_iter().flatten().collect();
    result.message = parts.join("; ");
    if purpose == Purpose::Calibrate {
        save(shared, &cfg, donning, from, &mut result);
    }
    Ok(result)
}

/// Takes samples for a while. `feedback` is given what is left of it.
async fn collect(
    samples: &mut mpsc::UnboundedReceiver<Sample>,
    calibrator: &mut Calibrator,
    duration: Duration,
    cancelled: &dyn Fn() -> bool,
    feedback: &mut dyn FnMut(&Calibrator, Duration),
) -> Result<(), Refused> {
    let started = Instant::now();
    let mut next_feedback = started + FEEDBACK;
    while started.elapsed() < duration && !cancelled() {
        match tokio::time::timeout(POLL, samples.recv()).await {
            Ok(Some(sample)) => calibrator.handle(sample),
            Ok(None) => break,
            Err(_elapsed) => {}
        }
        if Instant::now() >= next_feedback {
            feedback(calibrator, duration.saturating_sub(started.elapsed()));
            next_feedback += FEEDBACK;
        }
    }
    match cancelled() {
        true => Err("cancelled; the baseline is what it was".to_owned()),
        false => Ok(()),
    }
}

/// Judges what was collected in the air. The result has the reason if there is no donning.
async fn judge(
    shared: &Shared,
    calibrator: Calibrator,
    cfg: Config,
    purpose: Purpose,
) -> Result<((Option<Donning>, CalibrateResult), Calibrator), Refused> {
    // A tare keeps the known gains: in a few seconds the hand may not have moved.
    let mut before = Donning::default();
    if purpose == Purpose::Tare {
        let (reply, known) = oneshot::channel();
        if shared.commands.send(Command::Known(reply)).is_ok() {
            (before, _) = known.await.unwrap_or_default();
        }
    }
    let judging = tokio::task::spawn_blocking(move || {
        let (judge, _) = loading::fusion(&cfg)?;
        Ok((calibrator.finish(judge, &before), calibrator))
    });
    judging.await.map_err(|error| error.to_string())?
}

/// Fits the gains of a donning to touches of the force sensors. What was collected begins with `rest` without load.
async fn fit_gains(
    calibrator: Calibrator,
    readings: Vec<TruthReading>,
    cfg: Config,
    donning: Donning,
    rest: Duration,
) -> Result<Vec<RegionTouches>, String> {
    let fitting = tokio::task::spawn_blocking(move || {
        let (core, _) = loading::fusion(&cfg)?;
        let events = calibrator.samples().iter().map(Sample::event);
        live_force_gains(&cfg, core, (&donning, rest), events, &readings, &KnownForces::Sensor)
    });
    fitting.await.map_err(|error| error.to_string())?
}

/// Keeps a calibration that is in use in its file.
fn save(shared: &Shared, cfg: &Config, donning: Donning, from: String, result: &mut CalibrateResult) {
    let zero = Zero::new(ZeroFrom::Live { frames: result.frames }, donning);
    let mut calibration = zero.to_calibration(cfg, &shared.known.borrow().hashes);
    calibration.recorded = from;
    match &cfg.calibration.file {
        None => result.message.push_str("; it is lost when the node ends: calibration.file is not set"),
        Some(path) => match calibration.replace(path) {
            Ok(()) => {
                result.file = path.display().to_string();
                result.message.push_str(&format!("; kept in {}", result.file));
            }
            Err(error) => result.message.push_str(&format!("; in use, but not kept: {error}")),
        },
    }
}
