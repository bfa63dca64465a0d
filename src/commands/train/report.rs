//! What a training run was, and how its model does on what it has not seen.

use std::fmt::Write as _;
use std::time::Duration;

use serde::Serialize;
use serde_json::{Value, json};

use super::{Failure, Files, SessionNotes};
use crate::eval::{Part, Score, Scoring, Split, Tally};
use crate::fusion::{TouchOutput, Windows};
use crate::train::{
    Dataset, Kind, LossTerms, Network, Progress, TouchCalibration, TrainConfig, TriedLevel, Validation,
};

/// Steps of which the curve keeps the mean, at most so many points in all.
const MAX_POINTS: u64 = 500;

/// Windows run at once over the test part.
const TEST_BATCH: usize = 4096;

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
struct Run {
    lambda: f32,
    settings: Option<TrainConfig>,
    best_step: u64,
    best_validation: Option<Validation>,
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
struct Test {
    windows: usize,
    #[serde(rename = "final")]
    corrected: Score,
    #[serde(skip_serializing_if = "Option::is_none")]
    base: Option<Score>,
}

/// Everything that is said about a training run.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    synthetic: bool,
    tool_version: &'static str,
    command: Vec<String>,
    kind: Kind,
    data_fingerprint: String,
    window: usize,
    stride: usize,
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
    pub(super) fn new(kind: Kind, dataset: &Dataset, split: Split, notes: &[SessionNotes], threads: usize) -> Self {
        Report {
            synthetic: notes.iter().any(|notes| notes.synthetic),
            tool_version: env!("CARGO_PKG_VERSION"),
            command: std::env::args().collect(),
            kind,
            data_fingerprint: dataset.fingerprint(),
            window: dataset.spec().window,
            stride: dataset.spec().stride,
            split,
            windows: Part::ALL.map(|part| dataset.n_windows(part)),
            sessions: notes.to_vec(),
            threads,
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
    pub(super) fn finish(&mut self, dataset: &Dataset, took: Duration) -> Result<(), Failure> {
        self.training_s = took.as_secs_f64();
        let loss = |run: &Run| run.best_validation.as_ref().map_or(f64::INFINITY, |validation| validation.loss);
        let best = (0..self.runs.len()).min_by(|a, b| loss(&self.runs[*a]).total_cmp(&loss(&self.runs[*b])));
        self.chosen = best.unwrap_or_default();
        if dataset.n_windows(Part::Test) > 0 {
            self.test = Some(test(self.best()?, dataset, self.touch())?);
        }
        Ok(())
    }

    /// The network of the chosen run.
    pub(super) fn best(&self) -> Result<&Network, Failure> {
        let network = self.runs.get(self.chosen).and_then(|run| run.network.as_ref());
        network.ok_or_else(|| Failure("no run was finished".to_owned()))
    }

    /// When the touch output of the chosen network is contact.
    pub(super) fn touch(&self) -> Option<TouchOutput> {
        self.runs.get(self.chosen).and_then(|run| run.touch)
    }

    /// What it was trained on, in the order of the bags.
    pub(super) fn sessions(&self) -> &[SessionNotes] {
        &self.sessions
    }

    /// The metrics for the model's own metadata.
    pub(super) fn metrics(&self) -> Result<Value, Failure> {
        let Some(test) = &self.test else { return Ok(json!({})) };
        let mut metrics = json!({
            "synthetic": self.synthetic,
            "ba": test.corrected.ba.value(),
            "f1": test.corrected.f1.value(),
            "mdf_gf": test.corrected.mdf.value(),
            "mae_gf": test.corrected.mae_gf.value(),
            "r2": test.corrected.r2.value(),
            "windows": test.windows,
        });
        if let Some(map) = metrics.as_object_mut() {
            map.retain(|_, value| !value.is_null());
        }
        Ok(metrics)
    }

    pub(super) fn to_json(&self) -> Result<String, Failure> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// What a person wants to know at the end.
    pub(super) fn text(&self, files: &Files) -> String {
        let mut text = String::new();
        let synthetic = if self.synthetic { " (synthetic data)" } else { "" };
        for (idx, run) in self.runs.iter().enumerate().filter(|_| self.runs.len() > 1) {
            let loss =
                run.best_validation.as_ref().map_or("-".to_owned(), |validation| format!("{:.4}", validation.loss));
            let chosen = if idx == self.chosen { "  chosen" } else { "" };
            let _ = writeln!(text, "lambda {}: validation loss {loss} at step {}{chosen}", run.lambda, run.best_step);
        }
        if let Some(test) = &self.test {
            if let Some(TouchOutput { levels, false_per_min }) = self.touch() {
                let rate = false_per_min
                    .map(|rate| format!(", {rate:.1} false touches/min in the air of the validation part"));
                let (on, off) = (levels.on, levels.off);
                let _ = writeln!(
                    text,
                    "contact from a probability of {on:.2}, ends below {off:.2}{}",
                    rate.unwrap_or_default()
                );
            }
            let _ = writeln!(text, "held-out test, {} frames{synthetic}:", test.windows);
            let _ = writeln!(text, "  final {}", line(&test.corrected));
            if let Some(base) = &test.base {
                let _ = writeln!(text, "  base  {}", line(base));
            }
        }
        let _ = writeln!(text, "model   {}", files.model.display());
        let _ = writeln!(text, "report  {}", files.report.display());
        text
    }
}

/// A minimal detectable force with its unit, where it is a number.
fn mdf(mdf: &crate::eval::Mdf) -> String {
    let text = mdf.to_string();
    if text.ends_with(|last: char| last.is_ascii_digit()) { text + " gF" } else { text }
}

fn line(score: &Score) -> String {
    let number = |metric: crate::eval::Metric, scale: f64, digits: usize| {
        metric.value().map_or("-".to_owned(), |value| format!("{:.digits$}", value * scale))
    };
    format!(
        "BA {} %  F1 {} %  MDF {}  MAE {} gF  R2 {}",
        number(score.ba, 100.0, 2),
        number(score.f1, 100.0, 2),
        mdf(&score.mdf),
        number(score.mae_gf, 1.0, 2),
        number(score.r2, 1.0, 3)
    )
}

/// Scores a network on the test part by the same tallies as `tpf eval`.
fn test(network: &Network, dataset: &Dataset, touch: Option<TouchOutput>) -> Result<Test, Failure> {
    let scoring = Scoring::default();
    let (mut corrected, mut base) = (Tally::new(scoring), Tally::new(scoring));
    let windows: Vec<usize> = (0..dataset.n_windows(Part::Test)).collect();
    let mut has_base = false;
    for windows in windows.chunks(TEST_BATCH) {
        super::interrupt::check()?;
        let batch = dataset.batch(Part::Test, windows, None);
        let forces = network.predict(Windows { n: batch.n, tactile: &batch.tactile, pose: &batch.pose })?;
        for (idx, (truth, force)) in batch.truth_gf.iter().zip(&forces.force).enumerate() {
            let touched = touch.zip(forces.touch.get(idx)).map(|(touch, p)| f64::from(*p) >= touch.levels.on);
            corrected.add_judged(f64::from(*truth), Some(f64::from(*force)), touched);
        }
        has_base |= !forces.base.is_empty();
        for (truth, force) in batch.truth_gf.iter().zip(&forces.base) {
            base.add(f64::from(*truth), Some(f64::from(*force)));
        }
    }
    let base = has_base.then(|| base.score());
    Ok(Test { windows: windows.len(), corrected: corrected.score(), base })
}
