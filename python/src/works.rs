//! What `tpf` does with bags, as functions.

use std::num::{NonZero, NonZeroUsize};
use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use tactile_pose_fusion::calibrate::{self as calibrating, CalibrateError, Calibrated};
use tactile_pose_fusion::calibration::Calibration;
use tactile_pose_fusion::characterization;
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::eval::{Split, SplitBy};
use tactile_pose_fusion::evaluate::{self as evaluating, JudgeTouch, Request};
use tactile_pose_fusion::export::{self as exporting, Targets};
use tactile_pose_fusion::fusion::TouchLevels;
use tactile_pose_fusion::glove::replace_model;
use tactile_pose_fusion::observer::Observer;
use tactile_pose_fusion::recording::ToldTouch;
use tactile_pose_fusion::replay::{self as replaying, Options, Recording};
use tactile_pose_fusion::sessions::{InAir, KnownForces, find_bags};
use tactile_pose_fusion::sim::{Activity, Axes, Conditions, FULL_MINUTES, SessionSpec, Tracking};
use tactile_pose_fusion::synthetic;
use tactile_pose_fusion::units::Newton;
use tactile_pose_fusion::zero::Wanted;

use crate::error::{Kind, exception, raise};
use crate::estimates::{Estimates, Track, take};
use crate::parameters::Parameters;
use crate::work;

/// A calibration file, or the first seconds, or what there is.
fn zero<'a>(calibration: &'a Option<PathBuf>, first_s: Option<f64>) -> PyResult<Wanted<'a>> {
    match (calibration, first_s) {
        (Some(_), Some(_)) => {
            let line = "calibration and calibrate_first_s stand for each other; give one".to_owned();
            Err(exception(Kind::Parameter, line))
        }
        (Some(file), None) => Ok(Wanted::File(file)),
        (None, Some(seconds)) => Ok(Wanted::First(positive("calibrate_first_s", seconds)?)),
        (None, None) => Ok(Wanted::Any),
    }
}

/// Spans in which nothing touches the glove, or a true force, N, below which nothing does.
pub(crate) fn told_in_air(spans: Option<&str>, below_n: Option<f64>) -> PyResult<Option<InAir>> {
    let refuse = |line: String| exception(Kind::Parameter, line);
    match (spans, below_n) {
        (None, None) => Ok(None),
        (Some(spans), None) => spans.parse().map(Some).map_err(|line: String| refuse(format!("in_air: {line}"))),
        (None, Some(limit)) if limit > 0.0 && limit.is_finite() => Ok(Some(InAir::Below(Newton(limit)))),
        (None, Some(limit)) => Err(refuse(format!("zero_load_below_n: expected a force above 0 N, got {limit}"))),
        (Some(_), Some(_)) => Err(refuse("in_air and zero_load_below_n stand for each other; give one".to_owned())),
    }
}

fn positive(name: &str, seconds: f64) -> PyResult<f64> {
    match seconds > 0.0 && seconds <= 3600.0 {
        true => Ok(seconds),
        false => Err(exception(Kind::Parameter, format!("{name}: {seconds} s is outside of (0, 3600]"))),
    }
}

/// The parameters with another model, if one is named, and notes on what it changes.
fn with_model(parameters: &Parameters, model: Option<&Path>) -> PyResult<(Config, Vec<String>)> {
    let mut cfg = parameters.config();
    let notes = match model {
        Some(model) => replace_model(&mut cfg, model.to_path_buf()).map_err(|error| raise(&error))?,
        None => Vec::new(),
    };
    Ok((cfg, notes))
}

fn cores() -> NonZero<usize> {
    std::thread::available_parallelism().unwrap_or(NonZero::<usize>::MIN)
}

pub(crate) fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| exception(Kind::Other, error.to_string()))
}

/// Replays a recording into memory.
#[pyfunction]
pub(crate) fn replay(
    bags: Vec<PathBuf>,
    parameters: &Parameters,
    model: Option<PathBuf>,
    calibration: Option<PathBuf>,
    calibrate_first_s: Option<f64>,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<(Estimates, String, Vec<String>)> {
    let (mut cfg, notes) = with_model(parameters, model.as_deref())?;
    cfg.models_mut().iter_mut().for_each(|model| model.spec.threads = cores());
    let names: Vec<String> = cfg.fusion().regions().iter().map(|region| region.name.clone()).collect();
    let recording = Recording { bags: &bags, zero: zero(&calibration, calibrate_first_s)? };
    let mut tracks = vec![Track::default(); names.len()];
    let seen = work::run(watcher, |observer| {
        notes.iter().for_each(|note| observer.note(note));
        replaying::for_each(cfg, recording, observer, |tick| take(&mut tracks, tick))
    })?;
    Ok((Estimates::new(tracks, names), seen.zero.to_string(), seen.warnings))
}

/// Replays a recording into a bag; returns the summary as JSON, and warnings.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // called by our own Python half alone
pub(crate) fn replay_to(
    bags: Vec<PathBuf>,
    output: PathBuf,
    parameters: &Parameters,
    model: Option<PathBuf>,
    calibration: Option<PathBuf>,
    calibrate_first_s: Option<f64>,
    overwrite: bool,
    merge: bool,
    batch: Option<usize>,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<(String, Vec<String>)> {
    let (cfg, notes) = with_model(parameters, model.as_deref())?;
    let recording = Recording { bags: &bags, zero: zero(&calibration, calibrate_first_s)? };
    let checked = |batch: usize| {
        let frames = NonZeroUsize::new(batch).filter(|frames| frames.get() <= 4096);
        let refused = || exception(Kind::Parameter, format!("batch: expected 1 to 4096 frames, got {batch}"));
        frames.ok_or_else(refused)
    };
    let batch = batch.map(checked).transpose()?;
    let options = Options { overwrite, merge, batch, ..Options::new(output) };
    let replayed = work::run(watcher, |observer| {
        notes.iter().for_each(|note| observer.note(note));
        replaying::run(cfg, recording, &options, observer)
    })?;
    Ok((json(&replayed.summary())?, replayed.warnings()))
}

/// What is scored, as Python says it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Scoring {
    model: Option<PathBuf>,
    compare: Vec<PathBuf>,
    /// `stage`, `session` or nothing, which scores every frame.
    split: Option<String>,
    test_share: f64,
    held_out: bool,
    known_touches: Option<usize>,
    in_air: Option<String>,
    zero_load_below_n: Option<f64>,
    /// `as_the_node`, `force` or a probability.
    touch: Option<f64>,
    touch_by_force: bool,
    truth: Option<String>,
    calibration: Option<PathBuf>,
    calibrate_first_s: Option<f64>,
    jobs: Option<usize>,
}

/// Scores bags; returns everything as JSON, and warnings.
#[pyfunction]
pub(crate) fn evaluate(
    bags: Vec<PathBuf>,
    parameters: &Parameters,
    scoring: Scoring,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<(String, Vec<String>)> {
    let cfg = parameters.with_truth(scoring.truth.as_deref())?;
    let touch = match (scoring.touch_by_force, scoring.touch) {
        (true, _) => JudgeTouch::Force,
        (false, Some(on)) if on > 0.0 && on < 1.0 => JudgeTouch::Levels(TouchLevels::from_on(on)),
        (false, Some(on)) => {
            let line = format!("touch: expected \"force\" or a probability between 0 and 1, got {on}");
            return Err(exception(Kind::Parameter, line));
        }
        (false, None) => JudgeTouch::AsTheNode,
    };
    let split = scoring.split.as_deref().map(|by| split(by, scoring.test_share)).transpose()?;
    let zero = zero(&scoring.calibration, scoring.calibrate_first_s)?;
    let in_air = told_in_air(scoring.in_air.as_deref(), scoring.zero_load_below_n)?;
    let evaluated = work::run(watcher, |observer| {
        let bags = find_bags(&bags, observer)?;
        let every = Request::new(&bags);
        let request = Request {
            model: scoring.model.as_deref(),
            compare: &scoring.compare,
            split,
            zero,
            needs_truth: scoring.truth.is_some(),
            held_out: scoring.held_out,
            in_air: in_air.as_ref(),
            known_touches: scoring.known_touches,
            touch,
            jobs: scoring.jobs.map_or(every.jobs, |jobs| jobs.max(1)),
            ..every
        };
        evaluating::run(cfg, &request, observer)
    })?;
    let warnings = evaluated.sessions.iter().flat_map(|session| session.warnings.iter().cloned());
    let failed = evaluated.failed.iter().map(|failed| format!("not scored: {}", failed.error));
    let warnings = warnings.chain(failed).collect();
    Ok((json(&evaluated)?, warnings))
}

fn split(by: &str, test_share: f64) -> PyResult<Split> {
    let by = match by {
        "stage" => SplitBy::Stage,
        "session" => SplitBy::Session,
        other => {
            let line = format!("split: expected \"stage\", \"session\" or None, got {other:?}");
            return Err(exception(Kind::Parameter, line));
        }
    };
    Split::new(by, 0.0, test_share).map_err(|error| exception(Kind::Parameter, error.to_string()))
}

/// A gain as Python takes it: region, factor, its bounds, touches that it was fitted to.
type Gain = (String, f64, f64, f64, usize);

/// A touch as Python tells it: region, force in N, from and to in s.
type Told = (Option<String>, f64, f64, f64);

/// Writes a calibration file; returns where the zero is from, and by region the gain, its bounds and its touches.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // called by our own Python half alone
pub(crate) fn calibrate(
    bags: Vec<PathBuf>,
    output: PathBuf,
    parameters: &Parameters,
    model: Option<PathBuf>,
    calibrate_first_s: Option<f64>,
    by_sensor: bool,
    told: Vec<Told>,
    in_air: Option<String>,
    zero_load_below_n: Option<f64>,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<(String, Vec<Gain>)> {
    let (cfg, notes) = with_model(parameters, model.as_deref())?;
    let regions: Vec<String> = cfg.fusion().regions().iter().map(|region| region.name.clone()).collect();
    let known_forces = match (by_sensor, told.is_empty()) {
        (true, _) => Some(KnownForces::Sensor),
        (false, true) => None,
        (false, false) => Some(KnownForces::Told(told_touches(&regions, told)?)),
    };
    let first_s = calibrate_first_s.map(|seconds| positive("calibrate_first_s", seconds)).transpose()?;
    let in_air = told_in_air(in_air.as_deref(), zero_load_below_n)?;
    let in_air = in_air.as_ref();
    let request = calibrating::Request { first_s, in_air, known_forces, ..calibrating::Request::new(&bags) };
    work::quietly(watcher.py(), || Calibration::check_new(&output))?;
    let Calibrated { calibration, from, touches } = work::run::<_, CalibrateError>(watcher, |observer| {
        notes.iter().for_each(|note| observer.note(note));
        calibrating::run(cfg, &request, observer)
    })?;
    work::quietly(watcher.py(), || calibration.save(&output))?;
    let gains = touches.iter().map(|found| {
        let gain = &found.gain;
        (regions[found.region].clone(), gain.gain, gain.low, gain.high, found.touches.len())
    });
    Ok((from.to_string(), gains.collect()))
}

fn told_touches(regions: &[String], told: Vec<Told>) -> PyResult<Vec<(String, ToldTouch)>> {
    let only = if let [only] = regions { Some(only) } else { None };
    let touch = |(region, force_n, from_s, to_s): Told| {
        let region = region.or_else(|| only.cloned()).ok_or_else(|| {
            exception(Kind::Parameter, "touches: the parameters have several regions; name one for each".to_owned())
        })?;
        if !(force_n > 0.0 && from_s >= 0.0 && from_s < to_s) {
            let line = format!(
                "touches: expected a force above 0 N and times in order, got {force_n} N, {from_s} to {to_s} s"
            );
            return Err(exception(Kind::Parameter, line));
        }
        Ok((region, ToldTouch { force: Newton(force_n), from_s, to_s }))
    };
    told.into_iter().map(touch).collect()
}

/// Characterizes a glove; returns everything as JSON, and warnings.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // called by our own Python half alone
pub(crate) fn characterize(
    bags: Vec<PathBuf>,
    parameters: &Parameters,
    in_air: Option<String>,
    zero_load_below_n: Option<f64>,
    truth: Option<String>,
    min_gain: Option<f64>,
    calibration: Option<PathBuf>,
    calibrate_first_s: Option<f64>,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<(String, Vec<String>)> {
    let cfg = parameters.with_truth(truth.as_deref())?;
    let in_air = told_in_air(in_air.as_deref(), zero_load_below_n)?;
    let min_gain = min_gain.unwrap_or(characterization::MIN_GAIN);
    if !(0.0..1.0).contains(&min_gain) {
        return Err(exception(Kind::Parameter, format!("min_gain: {min_gain} is outside of [0, 1)")));
    }
    let zero = zero(&calibration, calibrate_first_s)?;
    let found = work::run(watcher, |observer| {
        let bags = find_bags(&bags, observer)?;
        let in_air = in_air.as_ref();
        let request = characterization::Request { zero, in_air, min_gain, needs_truth: truth.is_some(), bags: &bags };
        characterization::run(&cfg, &request, observer)
    })?;
    let losses = found.sessions.iter().flat_map(|session| &session.losses);
    Ok((json(&found)?, losses.map(|loss| format!("input lost: {loss}")).collect()))
}

/// What is exported, as Python says it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Exporting {
    lerobot: Option<PathBuf>,
    parquet: Option<PathBuf>,
    csv: Option<PathBuf>,
    overwrite: bool,
    fps: u32,
    tactile_window_ms: u32,
    task: Option<String>,
    model: Option<PathBuf>,
    truth: Option<String>,
    calibration: Option<PathBuf>,
    calibrate_first_s: Option<f64>,
    in_air: Option<String>,
    zero_load_below_n: Option<f64>,
}

/// Writes datasets and tables; returns the summary as JSON, and warnings.
#[pyfunction]
#[allow(clippy::result_large_err)] // of the library; nothing hot
pub(crate) fn export(
    bags: Vec<PathBuf>,
    parameters: &Parameters,
    wanted: Exporting,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<(String, Vec<String>)> {
    for (name, value) in [("fps", wanted.fps), ("tactile_window_ms", wanted.tactile_window_ms)] {
        if !(1..=10_000).contains(&value) {
            return Err(exception(Kind::Parameter, format!("{name}: expected 1 to 10000, got {value}")));
        }
    }
    let cfg = parameters.with_truth(wanted.truth.as_deref())?;
    let zero = zero(&wanted.calibration, wanted.calibrate_first_s)?;
    let in_air = told_in_air(wanted.in_air.as_deref(), wanted.zero_load_below_n)?;
    let targets = Targets {
        lerobot: wanted.lerobot.as_deref(),
        parquet: wanted.parquet.as_deref(),
        csv: wanted.csv.as_deref(),
        overwrite: wanted.overwrite,
    };
    let summary = work::run(watcher, |observer| {
        let bags = find_bags(&bags, observer)?;
        let usual = exporting::Request::new(&bags, targets);
        let request = exporting::Request {
            fps: wanted.fps,
            tactile_window_ms: wanted.tactile_window_ms,
            task: wanted.task.as_deref().unwrap_or(usual.task),
            model: wanted.model.as_deref(),
            zero,
            in_air: in_air.as_ref(),
            needs_truth: wanted.truth.is_some(),
            ..usual
        };
        exporting::run(&cfg, &request, observer)
    })?;
    Ok((json(&summary)?, summary.notes()))
}

/// Writes one session of a synthetic glove; returns the number of its messages.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // called by our own Python half alone
pub(crate) fn simulate(
    output: PathBuf,
    glove: u8,
    user: u32,
    session: u32,
    seed: u64,
    minutes: Option<f64>,
    activity: &str,
    tracking: &str,
    axes: usize,
    overwrite: bool,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<u64> {
    let spec = SessionSpec {
        glove,
        user,
        session,
        seed,
        minutes: minutes.unwrap_or(FULL_MINUTES),
        activity: of_name("activity", activity, &[Activity::Protocol, Activity::Manipulation], Activity::name)?,
        tracking: of_name("tracking", tracking, &[Tracking::Markers, Tracking::Camera], Tracking::name)?,
        conditions: Conditions {
            axes: [Axes::One, Axes::Three]
                .into_iter()
                .find(|known| known.n() == axes)
                .ok_or_else(|| exception(Kind::Parameter, format!("axes: expected 1 or 3, got {axes}")))?,
            ..Conditions::default()
        },
    };
    work::run(watcher, |observer| synthetic::write(&spec, &output, overwrite, observer))
}

/// What has a name, of all that there are.
pub(crate) fn of_name<T: Copy>(what: &str, name: &str, all: &[T], name_of: fn(T) -> &'static str) -> PyResult<T> {
    let found = all.iter().copied().find(|one| name_of(*one) == name);
    let names: Vec<&str> = all.iter().map(|one| name_of(*one)).collect();
    found.ok_or_else(|| {
        exception(Kind::Parameter, format!("{what}: expected one of {}, got {name:?}", names.join(", ")))
    })
}
