//! Models against metrics in the shape of the paper's Table I.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::curve::Mdf;
use super::metric::Metric;
use super::metrics::{Coverage, Measure, Score};

/// The metrics of one model on one glove.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Balanced accuracy, 0 to 1.
    pub ba: Metric,
    /// F1 of the touch class, 0 to 1.
    pub f1: Metric,
    /// Minimal detectable force.
    pub mdf: Mdf,
    /// Mean absolute error, gF.
    pub mae_gf: Metric,
    /// Coefficient of determination.
    pub r2: Metric,
    /// The frames that they were taken from.
    pub coverage: Coverage,
}

impl From<&Score> for Cell {
    fn from(score: &Score) -> Self {
        Cell {
            ba: score.ba,
            f1: score.f1,
            mdf: score.mdf,
            mae_gf: score.mae_gf,
            r2: score.r2,
            coverage: score.coverage,
        }
    }
}

impl Cell {
    /// The value of a measure, where it has one.
    pub fn value(&self, measure: Measure) -> Option<f64> {
        match measure {
            Measure::Ba => self.ba.value(),
            Measure::F1 => self.f1.value(),
            Measure::Mdf => self.mdf.value(),
            Measure::Mae => self.mae_gf.value(),
            Measure::R2 => self.r2.value(),
        }
    }

    /// As the paper prints it: BA, F1 in percent, MDF and MAE in gF; in words where there is no number.
    pub fn text(&self, measure: Measure) -> String {
        match (measure, self.value(measure)) {
            (Measure::Mdf, _) => self.mdf.to_string(),
            (Measure::Ba | Measure::F1, Some(value)) => format!("{:.2}", 100.0 * value),
            (Measure::Mae, Some(value)) => format!("{value:.2}"),
            (Measure::R2, Some(value)) => format!("{value:.3}"),
            (Measure::Ba, None) => reason(self.ba),
            (Measure::F1, None) => reason(self.f1),
            (Measure::Mae, None) => reason(self.mae_gf),
            (Measure::R2, None) => reason(self.r2),
        }
    }
}

fn reason(metric: Metric) -> String {
    match metric {
        Metric::Value(value) => value.to_string(),
        Metric::Undefined { undefined } => undefined.to_string(),
    }
}

/// One model's row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelRow {
    /// The model.
    pub model: String,
    /// `[gloves of the table]`; absent where the model wasn't scored on that glove.
    pub cells: Vec<Option<Cell>>,
}

/// The gain of a model over another, as the paper states it. A share of 0.1 is 10 %; negative when it got worse.
///
/// # Source
/// Pose-aware tactile gloves, Sec. VI-B: "reduces MDF by 10.4 %, touch detection error by 15 %, MAE by 8.7 %".
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Improvement {
    /// The glove.
    pub glove: String,
    /// The model compared to.
    pub from: String,
    /// The model compared.
    pub to: String,
    /// Share by which MDF fell; absent when either has none, or has it as a bound.
    pub mdf_reduction: Option<f64>,
    /// Share by which `1 - BA` fell; absent when either has none, or there was no error.
    pub touch_error_reduction: Option<f64>,
    /// Share by which MAE fell; absent when either has none, or there was no error.
    pub mae_reduction: Option<f64>,
}

/// Two or more models against the metrics, glove by glove.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ResultTable {
    /// The gloves, in the order of their names.
    pub gloves: Vec<String>,
    /// The models, in the order given.
    pub rows: Vec<ModelRow>,
}

impl ResultTable {
    /// A table of models, each with its scores by glove.
    pub fn new<'a>(models: impl IntoIterator<Item = (&'a str, &'a BTreeMap<String, Score>)>) -> Self {
        let models: Vec<_> = models.into_iter().collect();
        let mut gloves: Vec<String> = models.iter().flat_map(|(_, scores)| scores.keys().cloned()).collect();
        gloves.sort();
        gloves.dedup();
        let row = |(model, scores): (&str, &BTreeMap<String, Score>)| ModelRow {
            model: model.to_owned(),
            cells: gloves.iter().map(|glove| scores.get(glove).map(Cell::from)).collect(),
        };
        let rows = models.into_iter().map(row).collect();
        ResultTable { gloves, rows }
    }

    /// The gain of each model after the first over the first, glove by glove.
    pub fn improvements(&self) -> Vec<Improvement> {
        let Some((first, others)) = self.rows.split_first() else { return Vec::new() };
        let compared = others.iter().flat_map(|other| {
            self.gloves.iter().zip(&first.cells).zip(&other.cells).map(|((glove, from), to)| {
                let reduction = |error: &dyn Fn(&Cell) -> Option<f64>| {
                    let (from, to) = (error(from.as_ref()?)?, error(to.as_ref()?)?);
                    (from > 0.0).then_some((from - to) / from)
                };
                Improvement {
                    glove: glove.clone(),
                    from: first.model.clone(),
                    to: other.model.clone(),
                    mdf_reduction: reduction(&|cell| cell.mdf.value()),
                    touch_error_reduction: reduction(&|cell| cell.ba.value().map(|ba| 1.0 - ba)),
                    mae_reduction: reduction(&|cell| cell.mae_gf.value()),
                }
            })
        });
        compared.collect()
    }
}
