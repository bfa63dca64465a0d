//! Compares touches with the instructions, by the force sensor: for each item, and summed up for a stage.

use std::collections::{BTreeMap, VecDeque};

use crate::protocol::{Action, ForceLevels, Trial};
use crate::units::Newton;

/// A touch begins above this and ends below half of it, N: far above a load cell's noise, below any instructed tap.
const TOUCH: f64 = 0.1;

/// Minimum share of an instructed press in which the force must be above the touch threshold.
const PRESSED: f64 = 0.5;

/// Number of readings without load used for the zero: a few seconds.
const ZERO_READINGS: usize = 300;

/// Quality of an item.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ItemQuality {
    /// Peak of each touch, N.
    pub peaks: Vec<f64>,
    /// Problems, one line each.
    pub problems: Vec<String>,
}

/// Quality of a stage.
#[derive(Debug, Clone)]
pub struct StageQuality {
    levels: ForceLevels,
    /// Last readings without load, and their median, N.
    at_rest: VecDeque<f64>,
    zero: f64,
    items: BTreeMap<usize, ItemQuality>,
    doing: Option<Doing>,
}

#[derive(Debug, Clone, Default)]
struct Doing {
    item: usize,
    peaks: Vec<f64>,
    touching: bool,
    most_in_air: f64,
    n_air: u32,
    n_pressed: u32,
    n_asked: u32,
}

impl StageQuality {
    /// A stage before its first item.
    pub fn new(levels: &ForceLevels) -> Self {
        StageQuality {
            levels: levels.clone(),
            at_rest: VecDeque::new(),
            zero: 0.0,
            items: BTreeMap::new(),
            doing: None,
        }
    }

    /// Begins an item; its earlier results are dropped.
    pub fn handle_begin(&mut self, item: usize) {
        self.items.remove(&item);
        self.doing = Some(Doing { item, ..Doing::default() });
    }

    /// Adds a reading of the force sensor, in a step at zero load or not.
    pub fn handle_force(&mut self, force: Newton, zero_load: bool) {
        let over_zero = force.0 - self.zero;
        let Some(doing) = &mut self.doing else { return };
        if zero_load {
            doing.most_in_air = doing.most_in_air.max(over_zero);
            doing.n_air += 1;
            // Readings of an accidental touch must not change the zero.
            if over_zero.abs() < TOUCH || self.at_rest.is_empty() {
                self.at_rest.push_back(force.0);
                if self.at_rest.len() > ZERO_READINGS {
                    self.at_rest.pop_front();
                }
                let mut sorted: Vec<f64> = self.at_rest.iter().copied().collect();
                sorted.sort_by(f64::total_cmp);
                self.zero = sorted[sorted.len() / 2];
            }
            return;
        }
        doing.n_asked += 1;
        let threshold = if doing.touching { 0.5 * TOUCH } else { TOUCH };
        let touching = over_zero >= threshold;
        match (touching, doing.touching, doing.peaks.last_mut()) {
            (true, true, Some(peak)) => *peak = peak.max(over_zero),
            (true, ..) => doing.peaks.push(over_zero),
            _ => {}
        }
        doing.touching = touching;
        doing.n_pressed += u32::from(touching);
    }

    /// Ends the item; returns its quality.
    pub fn handle_end(&mut self, trial: &Trial) -> Option<&ItemQuality> {
        let doing = self.doing.take()?;
        let levels = &self.levels;
        let mut problems = Vec::new();
        if doing.n_air > 0 && doing.most_in_air >= TOUCH {
            problems.push(format!("{:.2} N while nothing was to be touched", doing.most_in_air));
        }
        if doing.n_asked > 0 {
            match &trial.action {
                Action::Taps(_) if doing.peaks.len() != 3 => {
                    problems.push(format!("{} taps, expected 3", doing.peaks.len()));
                }
                Action::Taps(_) => problems.extend(levels_met(&doing.peaks, levels)),
                _ => {
                    let pressed = f64::from(doing.n_pressed) / f64::from(doing.n_asked);
                    if pressed < PRESSED {
                        let (is, least) = (100.0 * pressed, 100.0 * PRESSED);
                        problems.push(format!("pressed {is:.0} % of the time, expected {least:.0} % at least"));
                    }
                }
            }
            let most = doing.peaks.iter().copied().fold(0.0, f64::max);
            if most > levels.most {
                problems.push(format!("{most:.1} N, expected {} N at most", levels.most));
            }
        }
        self.items.insert(doing.item, ItemQuality { peaks: doing.peaks, problems });
        self.items.get(&doing.item)
    }

    /// Drops an item that was interrupted or no longer counts.
    pub fn handle_undo(&mut self, item: usize) {
        self.doing.take_if(|doing| doing.item == item);
        self.items.remove(&item);
    }

    /// Quality of each item, by its number in the plan.
    pub fn items(&self) -> &BTreeMap<usize, ItemQuality> {
        &self.items
    }

    /// Items with problems.
    pub fn flagged(&self) -> Vec<usize> {
        self.items.iter().filter(|(_, item)| !item.problems.is_empty()).map(|(idx, _)| *idx).collect()
    }

    /// Reading of the force sensor without load, if known, N.
    pub fn zero(&self) -> f64 {
        self.zero
    }
}

/// Checks that three taps are a light, a medium and a heavy one.
fn levels_met(peaks: &[f64], levels: &ForceLevels) -> Option<String> {
    let names = ["light", "medium", "heavy"];
    let off = peaks.iter().zip(levels.taps).zip(names).find(|((peak, (from, to)), _)| !(*from..=*to).contains(*peak));
    off.map(|((peak, (from, to)), name)| format!("{name} tap of {peak:.2} N, expected {from} to {to} N"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::{Protocol, Setting};

    fn trial(action: Action) -> Trial {
        Trial { stage: 2, substage: "x".into(), repetition: 0, duration_s: 4.0, action }
    }

    /// An item with a second in the air at force `in_air`, then these forces, N.
    fn problems(action: Action, in_air: f64, touched: &[f64]) -> Vec<String> {
        let mut quality = StageQuality::new(&Protocol::paper().levels);
        let offset = 0.2; // tared, and warming up
        for (item, extra) in [(0, 0.0), (1, in_air)] {
            quality.handle_begin(item);
            for k in 0..100 {
                quality.handle_force(Newton(offset + if k > 50 { extra } else { 0.0 }), true);
            }
            touched.iter().for_each(|force| quality.handle_force(Newton(offset + force), false));
            quality.handle_end(&trial(action.clone()));
        }
        quality.items()[&1].problems.clone()
    }

    #[test]
    fn taps_are_counted_and_weighed_above_the_zero_of_the_cell() {
        let taps = Action::Taps(Setting::Free);
        let tap = |peak: f64| [0.0, 0.5 * peak, peak, 0.4 * peak, 0.0];
        let three = [tap(0.6), tap(1.8), tap(4.0)].concat();
        assert_eq!(problems(taps.clone(), 0.0, &three), [""; 0]);
        assert_eq!(problems(taps.clone(), 0.0, &three[5..]), ["2 taps, expected 3"]);
        let strong = [tap(2.6), tap(2.7), tap(11.0)].concat();
        let said = problems(taps.clone(), 0.0, &strong);
        assert_eq!(said, ["light tap of 2.60 N, expected 0.2 to 1.5 N", "11.0 N, expected 10 N at most"]);
        assert_eq!(problems(taps, 0.5, &three), ["0.50 N while nothing was to be touched"]);
    }

    #[test]
    fn a_press_that_is_not_held_is_told() {
        let press = Action::Press(Setting::Free);
        assert_eq!(problems(press.clone(), 0.0, &[vec![0.0; 10], vec![1.0; 90]].concat()), [""; 0]);
        let said = problems(press, 0.0, &[vec![0.0; 80], vec![1.0; 20]].concat());
        assert_eq!(said, ["pressed 20 % of the time, expected 50 % at least"]);
    }
}
