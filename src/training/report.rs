//! Report on a training run, with the scores of its model on data that it has not seen.

use std::time::Duration;

use serde::Serialize;
use serde_json::{Value, json};

use super::{Request, TrainingError};
use crate::eval::{Part, Score, Scoring, Split, Tally};
use crate::fusion::{TouchOutput, Windows};
use crate::observer::{self, Observer};
use crate::train::{
    Dataset, Kind, LossTerms, Network, Progress, TouchCalibration, TrainConfig, TriedLevel, Validation,
};

/// Steps of which the curve keeps the mean, at most so many points in all.
const MAX_POINTS: u64 = 500;

/// Windows run at once over the test part.
const TEST_BATCH: usize = 4096;

/// A session that was trained on.
#[derive(Debug, Clone, Serialize)]
pub struct SessionNotes {
    /// Its name.
    pub name: String,
    /// Position of its bag among those that were given.
    #[serde(skip)]
    pub bag_idx: usize,
    /// Its region, where the model serves several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<String>,
    /// The wearer, where the recording says so.
    pub user: Option<String>,
    /// The glove, where the recording says so.
    pub glove: Option<String>,
    /// Whether it is no recording but made by a simulator.
    pub synthetic: bool,
    /// Frames that could be used.
    pub frames: usize,
    /// Frames that could be used but for the truth, which was not measured there.
    pub frames_without_truth: usize,
}

/// A point of the training curve: the mean over the steps since the one before.
#[derive(Debug, Clone, Serialize)]
struct Point {
    step: u64,
    learning_rate: f64,
    loss: LossTerms,
}

/// A look at the validation part.
#[derive(Debug, Clone, Serialize)]
struct Look {
    step: u64,
    #[serde(flatten)]
    validation: Validation,
}

/// One run; a sweep has several.
#[derive(Debug, Clone, Serialize)]
pub struct Run {
    /// Weight of the auxiliary loss.
    pub lambda: f32,
    settings: Option<TrainConfig>,
    /// The step whose network is kept.
    pub best_step: u64,
    /// Its scores on the validation part, where there is one.
    pub best_validation: Option<Validation>,
    /// Probabilities of touch at which there is contact, where the network has an output for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    touch: Option<TouchOutput>,
    /// Scores of every contact threshold that was tried on the validation part.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    touch_levels: Vec<TriedLevel>,
    curve: Vec<Point>,
    validation: Vec<Look>,
    #[serde(skip)]
    since: Vec<LossTerms>,
    #[serde(skip)]
    network: Option<Network>,
}

/// How the model does on the test part.
#[derive(Debug, Clone, Serialize)]
pub struct Test {
    /// Windows of it.
    pub windows: usize,
    /// Score of the force, corrected for pose where the network does so.
    #[serde(rename = "final")]
    pub corrected: Score,
    /// Score of the base force, where the network gives one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base: Option<Score>,
}

/// Everything that is said about a training run.
#[derive(Debug, Serialize)]
pub struct Report {
    synthetic: bool,
    tool_version: &'static str,
    command: Vec<String>,
    kind: Kind,
    data_fingerprint: String,
    window: usize,
    stride: usize,
    held_touches: usize,
    split: Split,
    windows: [usize; 3],
    sessions: Vec<SessionNotes>,
    threads: usize,
    training_s: f64,
    chosen: usize,
    runs: Vec<Run>,
    test: Option<Test>,
}

impl Report {
    pub(super) fn new(request: &Request, dataset: &Dataset, notes: &[SessionNotes]) -> Self {
        Report {
            synthetic: notes.iter().any(|notes| notes.synthetic),
            tool_version: env!("CARGO_PKG_VERSION"),
            command: request.command.clone(),
            kind: request.train.kind,
            data_fingerprint: dataset.fingerprint(),
            window: dataset.spec().window,
            stride: dataset.spec().stride,
            held_touches: request.held_touches,
            split: request.split,
            windows: Part::ALL.map(|part| dataset.n_windows(part)),
            sessions: notes.to_vec(),
            threads: request.threads,
            training_s: 0.0,
            chosen: 0,
            runs: Vec::new(),
            test: None,
        }
    }

    /// Takes a step of the run with this lambda.
    pub(super) fn handle_step(&mut self, lambda: f32, progress: &Progress) {
        let run = self.run(lambda);
        run.since.push(progress.loss);
        if progress.step.is_multiple_of(progress.steps.div_ceil(MAX_POINTS)) || progress.step == progress.steps {
            let n = run.since.len() as f32;
            let mean = |term: fn(&LossTerms) -> f32| run.since.iter().map(term).sum::<f32>() / n;
            let loss = LossTerms {
                force: mean(|loss| loss.force),
                base: mean(|loss| loss.base),
                artifact: mean(|loss| loss.artifact),
                touch: mean(|loss| loss.touch),
                tangential: mean(|loss| loss.tangential),
                total: mean(|loss| loss.total),
            };
            run.curve.push(Point { step: progress.step, learning_rate: progress.learning_rate, loss });
            run.since.clear();
        }
        if let Some(validation) = &progress.validation {
            run.validation.push(Look { step: progress.step, validation: validation.clone() });
        }
    }

    /// Takes what a run gave.
    pub(super) fn handle_outcome(
        &mut self,
        lambda: f32,
        cfg: &TrainConfig,
        outcome: crate::train::Outcome,
        touch: Option<TouchCalibration>,
    ) {
        let run = self.run(lambda);
        run.settings = Some(cfg.clone());
        run.best_step = outcome.best_step;
        run.best_validation = outcome.best_validation;
        run.network = Some(outcome.best);
        if let Some(TouchCalibration { output, tried }) = touch {
            run.touch = Some(output);
            run.touch_levels = tried;
        }
    }

    fn run(&mut self, lambda: f32) -> &mut Run {
        let idx = match self.runs.iter().position(|run| run.lambda == lambda) {
            Some(idx) => idx,
            None => {
                self.runs.push(Run {
                    lambda,
                    settings: None,
                    best_step: 0,
                    best_validation: None,
                    curve: Vec::new(),
                    validation: Vec::new(),
                    since: Vec::new(),
                    network: None,
                    touch: None,
                    touch_levels: Vec::new(),
                });
                self.runs.len() - 1
            }
        };
        &mut self.runs[idx]
    }

    /// Chooses among the runs, and puts the chosen one to the test.
    pub(super) fn finish(
        &mut self,
        dataset: &Dataset,
        took: Duration,
        observer: &dyn Observer,
    ) -> Result<(), TrainingError> {
        self.training_s = took.as_secs_f64();
        let loss = |run: &Run| run.best_validation.as_ref().map_or(f64::INFINITY, |validation| validation.loss);
        let best = (0..self.runs.len()).min_by(|a, b| loss(&self.runs[*a]).total_cmp(&loss(&self.runs[*b])));
        self.chosen = best.unwrap_or_default();
        if dataset.n_windows(Part::Test) > 0 {
            self.test = Some(test(self.best()?, dataset, self.touch(), observer)?);
        }
        Ok(())
    }

    /// The network of the chosen run.
    pub(super) fn best(&self) -> Result<&Network, TrainingError> {
        let network = self.runs.get(self.chosen).and_then(|run| run.network.as_ref());
        network.ok_or_else(|| TrainingError::NoRun)
    }

    /// When the touch output of the chosen network is contact.
    pub fn touch(&self) -> Option<TouchOutput> {
        self.runs.get(self.chosen).and_then(|run| run.touch)
    }

    /// Whether some of the data is no recording but made by a simulator.
    pub fn is_synthetic(&self) -> bool {
        self.synthetic
    }

    /// The runs, in the order of their weights.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Which of the runs was chosen.
    pub fn chosen(&self) -> usize {
        self.chosen
    }

    /// How the model does on the test part, where there is one.
    pub fn test(&self) -> Option<&Test> {
        self.test.as_ref()
    }

    /// The sessions that it was trained on, in the order of the bags.
    pub fn sessions(&self) -> &[SessionNotes] {
        &self.sessions
    }

    /// The metrics for the model's own metadata.
    pub(super) fn metrics(&self) -> Value {
        let Some(test) = &self.test else { return json!({}) };
        let mut metrics = json!({
            "synthetic": self.synthetic,
            "ba": test.corrected.ba.value(),
            "f1": test.corrected.f1.value(),
            "mdf_gf": test.corrected.mdf.value(),
            "mae_gf": test.corrected.mae_gf.value(),
            "r2": test.corrected.r2.value(),
            "tangential_mae_gf": test.corrected.tangential.and_then(|score| score.mae_gf.value()),
            "angle_deg": test.corrected.tangential.and_then(|score| score.angle_deg.value()),
            "windows": test.windows,
        });
        if let Some(map) = metrics.as_object_mut() {
            map.retain(|_, value| !value.is_null());
        }
        metrics
    }

    /// The report as JSON.
    ///
    /// # Errors
    /// [`TrainingError::Json`].
    pub fn to_json(&self) -> Result<String, TrainingError> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}

/// Scores a network on the test part by the same tallies as `tpf eval`.
fn test(
    network: &Network,
    dataset: &Dataset,
    touch: Option<TouchOutput>,
    observer: &dyn Observer,
) -> Result<Test, TrainingError> {
    let scoring = Scoring::default();
    let (mut corrected, mut base) = (Tally::new(scoring), Tally::new(scoring));
    let windows: Vec<usize> = (0..dataset.n_windows(Part::Test)).collect();
    let (n_axes, mut has_base) = (network.architecture.n_axes(), false);
    for windows in windows.chunks(TEST_BATCH) {
        observer::check(observer)?;
        let batch = dataset.batch(Part::Test, windows, None);
        let windows = Windows { n: batch.n, tactile: &batch.tactile, pose: &batch.pose };
        let forces = network.predict_in_contact(windows)?;
        for (idx, (truth, force)) in batch.truth_gf.iter().zip(forces.force.chunks(n_axes)).enumerate() {
            let touched = touch.zip(forces.touch.get(idx)).map(|(touch, p)| f64::from(*p) >= touch.levels.on);
            let (truth, force) = (f64::from(*truth), force.iter().copied().map(f64::from).collect::<Vec<f64>>());
            corrected.add_judged(truth, force.first().copied(), touched);
            if let (Some(axes), [normal, first, second]) = (&network.architecture.axes, force.as_slice()) {
                let of = |of: &[f32]| <[f32; 2]>::try_from(of).ok().map(|of| axes.across(of.map(f64::from)));
                let true_tangential = batch.tangential_gf.chunks(2).nth(idx).and_then(of);
                let tangential = axes.across([*first, *second]);
                corrected.add_tangential((truth, true_tangential), (Some(*normal), Some(tangential)));
            }
        }
        has_base |= !forces.base.is_empty();
        for (truth, force) in batch.truth_gf.iter().zip(forces.base.chunks(n_axes)) {
            base.add(f64::from(*truth), force.first().copied().map(f64::from));
        }
    }
    let base = has_base.then(|| base.score());
    Ok(Test { windows: windows.len(), corrected: corrected.score(), base })
}
