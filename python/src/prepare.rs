//! What comes before forces: what is in a bag, a parameter file for it, a model.

use std::path::PathBuf;

use pyo3::prelude::*;
use tactile_pose_fusion::eval::{Split, SplitBy};
use tactile_pose_fusion::fusion::ForceAxes;
use tactile_pose_fusion::init as initializing;
use tactile_pose_fusion::init::{Answer, Ask, BestGuess, InitFileError, Question};
use tactile_pose_fusion::inspect::{self as inspecting, BagReport, InspectError, Inspected};
use tactile_pose_fusion::observer::Observer;
use tactile_pose_fusion::sessions::find_bags;
use tactile_pose_fusion::train::{GraphForm, Kind as Network, LossConfig, Schedule, TrainConfig};
use tactile_pose_fusion::training::{self, HoldOut, Request, TrainingError};

use crate::error::{Kind, Refusal, exception};
use crate::parameters::Parameters;
use crate::work::{self, Watch};
use crate::works::{json, of_name, told_in_air};

/// Reads bags and models; returns a report each as JSON.
#[pyfunction]
pub(crate) fn inspect(
    paths: Vec<PathBuf>,
    message_definitions: Option<PathBuf>,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<String> {
    let found = work::run(watcher, |watch| -> Result<Vec<Inspected>, InspectError> {
        let (paths, notes) = inspecting::recordings(&paths);
        notes.iter().for_each(|note| watch.note(note));
        let reports = paths.iter().map(|path| inspecting::inspect(path, message_definitions.as_deref(), watch));
        reports.collect()
    })?;
    json(&found)
}

/// Asks a Python function, which gives the index of an answer or `None`.
struct Person<'py>(&'py Py<PyAny>, &'py mut Option<PyErr>);

impl Ask for Person<'_> {
    fn ask(&mut self, question: &Question) -> Answer {
        let Question { words, options, likeliest, because } = question;
        let answer = Python::attach(|py| {
            let answer = self.0.call1(py, (words, options.clone(), *likeliest, because))?;
            answer.extract::<Option<usize>>(py)
        });
        match answer {
            Ok(Some(idx)) if idx < options.len() => Answer::Chosen(idx),
            Ok(None) => Answer::Likeliest,
            Ok(Some(idx)) => {
                let line = format!("answer: expected 0 to {}, got {idx}", options.len() - 1);
                *self.1 = Some(exception(Kind::Parameter, line));
                Answer::Nobody
            }
            Err(error) => {
                *self.1 = Some(error);
                Answer::Nobody
            }
        }
    }
}

/// What happened on the way to a parameter file.
enum InitFailure {
    Inspect(InspectError),
    File(InitFileError),
}

impl std::fmt::Display for InitFailure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            InitFailure::Inspect(error) => error.fmt(f),
            InitFailure::File(error) => error.fmt(f),
        }
    }
}

impl Refusal for InitFailure {
    fn kind(&self) -> Kind {
        match self {
            InitFailure::Inspect(error) => error.kind(),
            InitFailure::File(InitFileError::Model(_)) => Kind::Model,
            InitFailure::File(InitFileError::Init(_)) => Kind::Bag,
            InitFailure::File(_) => Kind::Other,
        }
    }
}

/// What a parameter file holds: its regions, its topics, whether it names a true force.
type Initialized = (Vec<String>, Vec<String>, bool);

/// Writes a parameter file; returns what it holds, and warnings.
#[pyfunction]
pub(crate) fn init(
    bags: Vec<PathBuf>,
    output: PathBuf,
    model: Option<PathBuf>,
    answer: Option<Py<PyAny>>,
    message_definitions: Option<PathBuf>,
    overwrite: bool,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<(Initialized, Vec<String>)> {
    let request = initializing::Request {
        output: &output,
        model: model.as_deref(),
        message_definitions: message_definitions.as_deref(),
        remarks: &[],
        overwrite,
    };
    let mut raised = None;
    let written = work::run(watcher, |watch| {
        request.check().map_err(InitFailure::File)?;
        let mut reports = Vec::new();
        for path in inspecting::all_recordings(&bags) {
            let report = BagReport::read(&path, message_definitions.as_deref(), watch);
            reports.push(report.map_err(InitFailure::Inspect)?);
        }
        let losses = reports.iter().flat_map(|report| &report.losses);
        losses.for_each(|loss| watch.note(&format!("input lost: {loss}")));
        match &answer {
            Some(answer) => initializing::write(&reports, &request, &mut Person(answer, &mut raised)),
            None => initializing::write(&reports, &request, &mut BestGuess),
        }
        .map_err(InitFailure::File)
    });
    if let Some(error) = raised {
        return Err(error);
    }
    let written = written?;
    let document = written.document;
    Ok(((document.regions, document.topics, document.has_truth), written.notes))
}

/// What is trained, as Python says it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Training {
    kind: String,
    regions: Vec<String>,
    truth: Option<String>,
    steps: Option<u64>,
    epochs: Option<f64>,
    batch: Option<usize>,
    learning_rate: Option<f64>,
    light_touches: Option<f32>,
    held_touches: Option<usize>,
    axes: usize,
    stride: usize,
    seed: u64,
    threads: Option<usize>,
    lambdas: Vec<f32>,
    base_weight: Option<f32>,
    offset_gf: Option<f32>,
    split: String,
    test_share: f64,
    validation_share: f64,
    hold_out: Option<String>,
    in_air: Option<String>,
    zero_load_below_n: Option<f64>,
    plain_graph: bool,
    resume: bool,
    overwrite: bool,
}

impl Training {
    fn request(&self, output: PathBuf) -> PyResult<Request> {
        const KINDS: [Network; 4] = [Network::PoseAware, Network::TactileOnly, Network::EarlyFusion, Network::Adaptive];
        let kind = of_name("kind", &self.kind, &KINDS, Network::name)?;
        if self.steps.is_some() && self.epochs.is_some() {
            let line = "steps and epochs stand for each other; give one".to_owned();
            return Err(exception(Kind::Parameter, line));
        }
        let usual = Request::new(kind, output);
        let train = TrainConfig {
            seed: self.seed,
            batch: self.batch.unwrap_or(usual.train.batch),
            schedule: Schedule {
                steps: self.steps.unwrap_or(usual.train.schedule.steps),
                learning_rate: self.learning_rate.unwrap_or(usual.train.schedule.learning_rate),
                ..usual.train.schedule
            },
            light_touches: self.light_touches.unwrap_or(usual.train.light_touches),
            loss: LossConfig {
                base_weight: self.base_weight.unwrap_or(usual.train.loss.base_weight),
                offset_gf: self.offset_gf.unwrap_or(usual.train.loss.offset_gf),
                lambda: self.lambdas.first().copied().unwrap_or(usual.train.loss.lambda),
                ..usual.train.loss
            },
            ..usual.train.clone()
        };
        let by = of_name("split", &self.split, &[SplitBy::Stage, SplitBy::Session], |by| match by {
            SplitBy::Stage => "stage",
            SplitBy::Session => "session",
        })?;
        let split = Split::new(by, self.validation_share, self.test_share)
            .map_err(|error| exception(Kind::Parameter, error.to_string()))?;
        Ok(Request {
            train,
            epochs: self.epochs,
            lambdas: if self.lambdas.len() > 1 { self.lambdas.clone() } else { Vec::new() },
            held_touches: self.held_touches.unwrap_or(usual.held_touches),
            stride: self.stride,
            axes: match self.axes {
                1 => ForceAxes::Normal,
                3 => ForceAxes::Patch,
                got => return Err(exception(Kind::Parameter, format!("axes: expected 1 or 3, got {got}"))),
            },
            split,
            threads: self.threads.unwrap_or(usual.threads).max(1),
            form: if self.plain_graph { GraphForm::Plain } else { GraphForm::Fast },
            in_air: told_in_air(self.in_air.as_deref(), self.zero_load_below_n)?,
            resume: self.resume,
            overwrite: self.overwrite,
            ..usual
        })
    }
}

/// Trains a model; returns its report as JSON, and the scores of what was held out, as JSON.
#[pyfunction]
pub(crate) fn train(
    bags: Vec<PathBuf>,
    output: PathBuf,
    parameters: &Parameters,
    training: Training,
    watcher: &Bound<'_, PyAny>,
) -> PyResult<(String, Option<String>)> {
    let request = training.request(output)?;
    let hold_out = training.hold_out.as_deref().map(|what| {
        of_name("hold_out", what, &[HoldOut::Users, HoldOut::Donnings], |one| match one {
            HoldOut::Users => "users",
            HoldOut::Donnings => "donnings",
        })
    });
    let hold_out = hold_out.transpose()?;
    let cfg = parameters.with_truth(training.truth.as_deref())?;
    let (report, held_out) = work::run(watcher, |watch: &Watch| -> Result<_, TrainingError> {
        request.check()?;
        if hold_out.is_some() {
            training::check_folds(&request)?;
        }
        let cfg = training::for_regions(cfg, &training.regions, request.train.kind)?;
        if hold_out.is_some() {
            training::check_hold_out(&cfg)?;
        }
        let bags = find_bags(&bags, watch)?;
        let mut on_step = |step: &_| watch.step(step);
        let report = training::run(&cfg, &bags, &request, watch, &mut on_step)?;
        let held_out = hold_out.map(|hold_out| {
            training::hold_out(&cfg, &bags, report.sessions(), hold_out, &request, watch, &mut on_step)
        });
        Ok((report.to_json()?, held_out.transpose()?))
    })?;
    Ok((report, held_out.map(|scores| json(&scores)).transpose()?))
}
