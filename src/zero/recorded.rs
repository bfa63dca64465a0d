//! Finds the zero of a recording: in a file, from its annotations, or from its first seconds.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::{
    ArtifactCollector, ArtifactTimes, Donning, KnownModels, LoadCheck, Zero, ZeroError, ZeroFrom, forgiven, from_file,
    limits,
};
use crate::bag::{BagReader, Baselines, Input, Inputs, Rest, ZeroLoad, annotated_rest, collect_baselines};
use crate::config::Config;
use crate::fusion::Event;
use crate::recording::{PoseDegrader, input_topics};

/// Minimum share of the requested seconds with data. Some frames may be missing, but not a large part.
const SHORTEST: f64 = 0.5;

/// Most time at rest that an artifact is fitted to where it was named: later, the glove has slipped.
const LONGEST_FIT: Duration = Duration::from_secs(600);

/// Source of the zero that the user asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wanted<'a> {
    /// A calibration file.
    File(&'a Path),
    /// The first seconds, s.
    First(f64),
    /// The first that exists: annotations, the file of the parameters, the first seconds.
    Any,
}

/// Finds the zero of a recording: from the requested source, or else annotations, `calibration.file`, or the first
/// `calibration.duration_s` seconds, in this order.
///
/// # Errors
/// [`ZeroError`] if the recording can't be read, if its part at zero load is too short or has a dead taxel, or if a
/// file is refused.
pub fn find(wanted: Wanted<'_>, cfg: &Config, bags: &[PathBuf], models: &KnownModels) -> Result<Zero, ZeroError> {
    find_with(wanted, cfg, bags, models, None)
}

/// Like [`find`], with degraded joint angles.
///
/// # Errors
/// As for [`find`].
pub fn find_with(
    wanted: Wanted<'_>,
    cfg: &Config,
    bags: &[PathBuf],
    models: &KnownModels,
    pose: Option<PoseDegrader>,
) -> Result<Zero, ZeroError> {
    let is_annotated =
        || Ok::<_, ZeroError>(Inputs::new(input_topics(cfg), &mut BagReader::open(bags)?)?.has_annotations());
    match (wanted, &cfg.calibration.file) {
        (Wanted::File(file), _) => of_file(file, cfg, bags, models, is_annotated()?),
        (Wanted::First(seconds), _) => {
            let zero = from_bag(cfg, bags, ZeroLoad::First(seconds), models, pose)?;
            match &zero.from {
                ZeroFrom::First { seconds: got } if got.iter().all(|got_s| *got_s < SHORTEST * seconds) => {
                    let got_s = got.iter().copied().fold(0.0, f64::max);
                    Err(ZeroError::PastTheEnd { seconds, got_s })
                }
                _ => Ok(zero),
            }
        }
        (Wanted::Any, _) if is_annotated()? => from_bag(cfg, bags, ZeroLoad::Annotated, models, pose),
        (Wanted::Any, Some(file)) => of_file(file, cfg, bags, models, false),
        (Wanted::Any, None) => {
            let seconds = cfg.calibration.duration.as_secs_f64();
            let mut zero = from_bag(cfg, bags, ZeroLoad::First(seconds), models, pose)?;
            zero.notes.push(format!(
                "no stage annotations on {} and no calibration file: taking the first {seconds} s as zero load",
                cfg.stage_topic
            ));
            Ok(zero)
        }
    }
}

/// The zero from a file. If the recording has times without load, the model must confirm the zero there.
fn of_file(
    file: &Path,
    cfg: &Config,
    bags: &[PathBuf],
    models: &KnownModels,
    is_annotated: bool,
) -> Result<Zero, ZeroError> {
    let mut zero = from_file(file, cfg, models)?;
    if is_annotated {
        let mut reader = BagReader::open(bags)?;
        let mut inputs = Inputs::new(input_topics(cfg), &mut reader)?;
        inputs.read_only_these(&mut reader);
        let rest = annotated_rest(&mut reader, &mut inputs)?;
        zero.check = Some(check(&zero.from, cfg, vec![rest; cfg.fusion().tactile_sources().len()]));
    }
    Ok(zero)
}

fn from_bag(
    cfg: &Config,
    bags: &[PathBuf],
    zero_load: ZeroLoad,
    models: &KnownModels,
    pose: Option<PoseDegrader>,
) -> Result<Zero, ZeroError> {
    let mut reader = BagReader::open(bags)?;
    Inputs::new(input_topics(cfg), &mut reader)?; // refuses a recording that lacks a topic
    let mut inputs = Inputs::new(input_topics(cfg).taxels_alone(), &mut reader)?;
    inputs.read_only_these(&mut reader);
    let limits = limits(&cfg.calibration);
    let Baselines { baselines, spans_s: seconds, rest, goes_on } =
        collect_baselines(&mut reader, &mut inputs, cfg.fusion(), zero_load, &limits)?;
    let is_all = matches!(zero_load, ZeroLoad::First(_)) && !goes_on.contains(&true);
    let all_s = seconds.iter().copied().fold(0.0, f64::max);
    let from = match zero_load {
        ZeroLoad::Annotated => ZeroFrom::Annotations { seconds },
        ZeroLoad::First(_) => ZeroFrom::First { seconds },
    };
    let mut donning = Donning { baselines, ..Donning::default() };
    let notes = fit_artifacts(&mut donning, cfg, bags, models, (zero_load, &rest), pose)?;
    let check = Some(check(&from, cfg, rest));
    let mut notes: Vec<String> = notes.into_iter().collect();
    if is_all {
        notes.push(format!(
            "all {all_s:.1} s of the taxels are taken as zero load, so no touch in this recording can be told; if something is touched in it, give a shorter time by --calibrate-first"
        ));
    }
    Ok(Zero { check, notes, ..Zero::new(from, donning) })
}

/// Fits the artifacts to the first seconds at rest, as many as were asked for, for models with an artifact model. Returns a note, if
/// there is one.
fn fit_artifacts(
    donning: &mut Donning,
    cfg: &Config,
    bags: &[PathBuf],
    models: &KnownModels,
    (zero_load, rest): (ZeroLoad, &[Vec<Rest>]),
    mut pose: Option<PoseDegrader>,
) -> Result<Option<String>, ZeroError> {
    let artifacts = models.artifacts_of_regions(cfg);
    if artifacts.iter().all(Option::is_none) {
        return Ok(None);
    }
    let most = match zero_load {
        ZeroLoad::First(_) => LONGEST_FIT, // `rest` ends with these seconds
        ZeroLoad::Annotated => cfg.calibration.duration,
    };
    let times = ArtifactTimes { most, least_s: cfg.calibration.min_duration.as_secs_f64() };
    let mut collector = ArtifactCollector::new(cfg.fusion(), &artifacts, &donning.baselines, rest, times)?;
    let mut reader = BagReader::open(bags)?;
    let mut inputs = Inputs::new(input_topics(cfg), &mut reader)?;
    inputs.read_only_these(&mut reader);
    'bag: while let Some(message) = reader.next_message()? {
        for part in inputs.parts(message.channel)? {
            let Input::Event(event) = inputs.decode(&message, part) else { continue };
            let event = match (event, &mut pose) {
                (Event::Joints(sample), Some(degrader)) => degrader.handle(sample).map(Event::Joints),
                (event, _) => Some(event),
            };
            if let Some(event) = event {
                collector.handle(event)?;
            }
            if !collector.wants_more() {
                break 'bag;
            }
        }
    }
    match collector.finish(&[]) {
        Ok(artifacts) => donning.artifacts = artifacts,
        Err(error) => return forgiven(cfg, error),
    }
    Ok(None)
}

fn check(from: &ZeroFrom, cfg: &Config, rest: Vec<Vec<Rest>>) -> LoadCheck {
    LoadCheck::new(from.clone(), rest, limits(&cfg.calibration))
}
