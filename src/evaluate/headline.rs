//! Headline of an evaluation: the judged series against the first one that it is compared with.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::eval::{Cell, ContactReport, Mdf, Metric, ResultTable};

/// A measure that changes by less than this share of what it was has not changed.
const NOTICED: f64 = 0.01;

/// How a series compares with another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// Some of minimal detectable force, touch error and mean absolute error are better, and none is worse.
    Better,
    /// Some are worse, and none is better.
    Worse,
    /// Some are better and some are worse.
    Mixed,
    /// None has changed by 1 % or more.
    Same,
}

/// Headline of an evaluation: better or worse than the first series, in all and by glove.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Headline {
    /// The first row of the table; absent where what is judged is the only one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// The judged series.
    pub to: String,
    /// On all gloves; absent where there is nothing to compare.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub change: Option<Change>,
    /// By glove.
    pub gloves: Vec<GloveHeadline>,
}

/// The same on one glove.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GloveHeadline {
    /// The glove.
    pub glove: String,
    /// Absent where there is nothing to compare.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub change: Option<Change>,
    /// Scores of the first row; absent without true force, or without such a row.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<Cell>,
    /// Scores of what is judged; absent without true force.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to: Option<Cell>,
    /// False touches a minute in the air, of both; `None` where nothing tells when the glove is in the air.
    pub false_per_min: [Option<f64>; 2],
}

impl Headline {
    /// The headline of these scores; `None` where nothing was judged. Series have a name, and their contacts by glove;
    /// the judged one stands last.
    pub(super) fn of(series: &[(&str, &BTreeMap<String, ContactReport>)], table: &ResultTable) -> Option<Self> {
        let (judged, judged_contacts) = *series.last()?;
        let first = series.first().filter(|_| series.len() > 1);
        let cell = |model: &str, glove_idx: usize| {
            let row = table.rows.iter().find(|row| row.model == model)?;
            row.cells.get(glove_idx).copied().flatten()
        };
        let in_air = |contacts: &BTreeMap<String, ContactReport>, glove: &str| {
            contacts.get(glove)?.in_air.as_ref().and_then(|found| found.total.per_minute.value())
        };
        let gloves = judged_contacts.keys().map(|glove| {
            let of_table = table.gloves.iter().position(|other| other == glove);
            let to = of_table.and_then(|idx| cell(judged, idx));
            let from = of_table.and_then(|idx| cell(first?.0, idx));
            GloveHeadline {
                glove: glove.clone(),
                change: from.as_ref().zip(to.as_ref()).and_then(|(from, to)| change(&steps(from, to))),
                from,
                to,
                false_per_min: [
                    first.and_then(|(_, contacts)| in_air(contacts, glove)),
                    in_air(judged_contacts, glove),
                ],
            }
        });
        let gloves: Vec<GloveHeadline> = gloves.collect();
        let steps: Vec<Step> =
            gloves.iter().filter_map(|glove| glove.from.zip(glove.to)).flat_map(|(a, b)| steps(&a, &b)).collect();
        Some(Headline {
            from: first.map(|(name, _)| (*name).to_owned()),
            to: judged.to_owned(),
            change: change(&steps),
            gloves,
        })
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Better,
    Worse,
    Same,
}

/// How each measure changed that both have.
fn steps(from: &Cell, to: &Cell) -> Vec<Step> {
    let error = |ba: Metric| ba.value().map(|ba| 1.0 - ba);
    let pairs =
        [(force(from.mdf), force(to.mdf)), (error(from.ba), error(to.ba)), (from.mae_gf.value(), to.mae_gf.value())];
    pairs.into_iter().filter_map(|(from, to)| Some(step(from?, to?))).collect()
}

/// The force as far as it is known: a bound is taken as the force, and one that is never reached is beyond all others.
fn force(mdf: Mdf) -> Option<f64> {
    match mdf {
        Mdf::Crossed { force_gf, .. } => Some(force_gf),
        Mdf::AlreadyAboveInFirstBin { centre_gf, .. } => Some(centre_gf),
        Mdf::NeverReached { .. } => Some(f64::INFINITY),
        Mdf::Undefined { .. } => None,
    }
}

/// How a measure changed of which less is better.
fn step(from: f64, to: f64) -> Step {
    // Infinite ones are equal, and their difference is not a number.
    if from == to || (to - from).abs() < NOTICED * from {
        Step::Same
    } else if to < from {
        Step::Better
    } else {
        Step::Worse
    }
}

fn change(steps: &[Step]) -> Option<Change> {
    let has = |step: Step| steps.contains(&step);
    (!steps.is_empty()).then(|| match (has(Step::Better), has(Step::Worse)) {
        (true, false) => Change::Better,
        (false, true) => Change::Worse,
        (true, true) => Change::Mixed,
        (false, false) => Change::Same,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::Coverage;

    fn cell(ba: f64, mdf: Mdf, mae_gf: f64) -> Cell {
        let [ba, mae_gf] = [ba, mae_gf].map(Metric::Value);
        Cell { ba, f1: ba, mdf, mae_gf, r2: ba, coverage: Coverage::default() }
    }

    fn crossed(force_gf: f64) -> Mdf {
        Mdf::Crossed { force_gf, below_gf: 0.0, above_gf: 99.0 }
    }

    #[test]
    fn better_is_better_in_something_and_worse_in_nothing() {
        let base = cell(0.9, crossed(20.0), 10.0);
        let against = |other: Cell| change(&steps(&base, &other));
        assert_eq!(against(cell(0.95, crossed(15.0), 9.0)), Some(Change::Better));
        assert_eq!(against(cell(0.9, crossed(20.0), 9.0)), Some(Change::Better));
        assert_eq!(against(cell(0.85, crossed(20.0), 10.0)), Some(Change::Worse));
        assert_eq!(against(cell(0.95, crossed(20.0), 11.0)), Some(Change::Mixed));
        assert_eq!(against(cell(0.9, crossed(20.1), 9.95)), Some(Change::Same), "by half a percent");
    }

    #[test]
    fn a_force_that_is_a_bound_or_never_reached_is_compared_all_the_same() {
        let never = Mdf::NeverReached { highest_ba: 0.8, at_gf: 45.0 };
        let bound = Mdf::AlreadyAboveInFirstBin { centre_gf: 6.25, ba: 0.95 };
        assert_eq!(step(force(never).unwrap(), force(crossed(50.0)).unwrap()), Step::Better);
        assert_eq!(step(force(never).unwrap(), force(never).unwrap()), Step::Same);
        assert_eq!(step(force(bound).unwrap(), force(crossed(9.0)).unwrap()), Step::Worse);
        assert_eq!(step(0.0, 0.1), Step::Worse);
        assert_eq!(change(&[]), None);
    }
}
