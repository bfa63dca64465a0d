//! Presses of the load cell at the start of a donning, from which the gain of its forces is fitted later.

use crate::protocol::{Annotation, Annotations, KnownTouches};
use crate::units::{NANOS_PER_SEC, Newton, Stamp};

/// Tries for each press that is asked for. After them the session begins without the missing presses.
const TRIES: u16 = 2;

/// Presses of a known force, one after the other. Pure: time is an argument.
///
/// The user first lets go, which gives the zero of each force sensor. Then the user presses any of them until the force was held
/// for long enough, or until the time is over, in which case the press is asked for once more.
#[derive(Debug, Clone)]
pub struct TouchGuide {
    asked: KnownTouches,
    let_go_s: f64,
    tries: u16,
    held: u16,
    began: Option<Stamp>,
    pressing: bool,
    skipped: bool,
    /// Per force sensor: sum and number of its readings while nothing pressed it.
    at_rest: Vec<(f64, u32)>,
    /// Per force sensor: since when it reads enough.
    since: Vec<Option<Stamp>>,
    annotations: Vec<Annotation>,
}

impl TouchGuide {
    /// The presses before they begin. `let_go_s`: time to release the force sensor before each of them, s.
    pub fn new(asked: &KnownTouches, let_go_s: f64, n_sensors: usize) -> Self {
        TouchGuide {
            asked: asked.clone(),
            let_go_s,
            tries: 0,
            held: 0,
            began: None,
            pressing: false,
            skipped: false,
            at_rest: vec![(0.0, 0); n_sensors],
            since: vec![None; n_sensors],
            annotations: Vec::new(),
        }
    }

    /// True if an earlier part of the same session has these presses, and the force sensor felt one.
    pub fn were_done(asked: &KnownTouches, annotations: &Annotations) -> bool {
        let told = annotations.all().iter().filter(|annotation| annotation.substage == KnownTouches::SUBSTAGE);
        let presses = told.rev().take_while(|annotation| annotation.pose != KnownTouches::UNFELT);
        presses.filter(|annotation| annotation.pose == KnownTouches::PRESS).count() >= usize::from(asked.presses)
    }

    /// Advances to the time `now`. True if there is more to press.
    pub fn handle_time(&mut self, now: Stamp) -> bool {
        if self.is_over() {
            return false;
        }
        let began = *self.began.get_or_insert(now);
        let since = |from: Stamp| now.nanos_since(from) as f64 / NANOS_PER_SEC as f64;
        if !self.pressing {
            let is_silent = self.at_rest.iter().all(|(_, n)| *n == 0);
            if is_silent && since(began) >= self.let_go_s + self.asked.seconds {
                (self.tries, self.began) = (self.tries + 1, Some(now)); // the force sensor has stopped
            } else if !is_silent && since(began) >= self.let_go_s {
                (self.pressing, self.began) = (true, Some(now));
                let (substage, pose) = (KnownTouches::SUBSTAGE.to_owned(), KnownTouches::PRESS.to_owned());
                self.annotations.push(Annotation {
                    substage,
                    pose,
                    repetition: self.tries,
                    ..Annotation::outside(now)
                });
            }
            return !self.is_over();
        }
        let is_held = self.since.iter().flatten().any(|from| since(*from) >= self.asked.hold_s);
        if is_held || since(began) >= self.asked.seconds {
            self.tries += 1;
            self.held += u16::from(is_held);
            (self.pressing, self.began) = (false, Some(now));
            self.since.fill(None);
            self.at_rest.fill((0.0, 0));
            let mut over = Annotation::outside(now);
            if self.is_unfelt() {
                (over.substage, over.pose) = (KnownTouches::SUBSTAGE.to_owned(), KnownTouches::UNFELT.to_owned());
            }
            self.annotations.push(over);
        }
        !self.is_over()
    }

    /// Adds a reading of a force sensor. Readings of unknown sensors are ignored.
    pub fn handle_force(&mut self, sensor: usize, force: Newton, now: Stamp) {
        let (Some((sum, n)), Some(since)) = (self.at_rest.get_mut(sensor), self.since.get_mut(sensor)) else { return };
        if !force.0.is_finite() {
            return;
        }
        if !self.pressing {
            // The hand may still be on its way off at first.
            let settled = self
                .began
                .is_some_and(|began| now.nanos_since(began) as f64 >= 0.5 * self.let_go_s * NANOS_PER_SEC as f64);
            if settled {
                (*sum, *n) = (*sum + force.0, *n + 1);
            }
            return;
        }
        let zero = if *n > 0 { *sum / f64::from(*n) } else { 0.0 };
        match force.0 - zero >= self.asked.at_least {
            true => {
                since.get_or_insert(now);
            }
            false => *since = None,
        }
    }

    /// Ends it without the presses that are left.
    pub fn skip(&mut self, now: Stamp) {
        if !self.is_over() {
            self.skipped = true;
            self.annotations.push(Annotation::outside(now));
        }
    }

    /// The current instruction to the user.
    pub fn prompt(&self) -> &str {
        if self.pressing { &self.asked.ask } else { "Let go of the load cell" }
    }

    /// True while the user should press.
    pub fn is_pressing(&self) -> bool {
        self.pressing
    }

    /// Start and end of the current step.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        let began = self.began?;
        let seconds = if self.pressing { self.asked.seconds } else { self.let_go_s };
        Some((began, began.offset((seconds * NANOS_PER_SEC as f64) as i64)))
    }

    /// Number of presses that were held, and how many are asked for.
    pub fn progress(&self) -> (u16, u16) {
        (self.held, self.asked.presses)
    }

    /// True if every press was asked for and none was felt.
    pub fn is_unfelt(&self) -> bool {
        self.is_over() && !self.skipped && self.held == 0
    }

    /// True if the presses that were held are enough for a gain.
    pub fn is_enough(&self) -> bool {
        self.held >= KnownTouches::FEWEST
    }

    /// The next annotation to publish and record.
    pub fn poll(&mut self) -> Option<Annotation> {
        (!self.annotations.is_empty()).then(|| self.annotations.remove(0))
    }

    fn is_over(&self) -> bool {
        self.skipped || self.held >= self.asked.presses || self.tries >= TRIES * self.asked.presses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked() -> KnownTouches {
        KnownTouches { presses: 3, seconds: 4.0, hold_s: 0.5, at_least: 0.5, ask: "press".to_owned() }
    }

    fn at(seconds: f64) -> Stamp {
        Stamp((seconds * 1e9) as i64)
    }

    /// Goes through it with readings of one sensor: `force` of the seconds since the press was asked for, `None` while it is let go.
    fn lead(guide: &mut TouchGuide, mut force: impl FnMut(Option<f64>) -> f64) -> (f64, Vec<Annotation>) {
        let mut annotations = Vec::new();
        let mut t_s = 0.0;
        while guide.handle_time(at(t_s)) {
            let asked_s = guide.is_pressing().then(|| guide.span().map_or(0.0, |(from, _)| t_s - from.0 as f64 * 1e-9));
            guide.handle_force(0, Newton(force(asked_s)), at(t_s));
            annotations.extend(std::iter::from_fn(|| guide.poll()));
            t_s += 0.01;
            assert!(t_s < 100.0);
        }
        annotations.extend(std::iter::from_fn(|| guide.poll()));
        (t_s, annotations)
    }

    #[test]
    fn presses_that_are_held_are_counted_over_the_zero_of_the_load_cell() {
        // It reads 1.5 N with nothing on it. Each press begins half a second late.
        let mut guide = TouchGuide::new(&asked(), 1.0, 1);
        let (took_s, annotations) = lead(&mut guide, |asked_s| if asked_s > Some(0.5) { 3.5 } else { 1.5 });
        assert_eq!(guide.progress(), (3, 3));
        assert!(guide.is_enough() && (took_s - 6.0).abs() < 0.3, "{took_s}"); // 3 times 1 s, 0.5 s and 0.5 s
        let told: Vec<(&str, u16)> = annotations.iter().map(|told| (told.pose.as_str(), told.repetition)).collect();
        assert_eq!(told, [("press", 0), ("", 0), ("press", 1), ("", 0), ("press", 2), ("", 0)]);
        assert!(annotations.iter().all(|told| told.stage == 0 && !told.zero_load));
        let mut recorded = Annotations::default();
        annotations.into_iter().for_each(|annotation| recorded.handle(annotation));
        assert!(TouchGuide::were_done(&asked(), &recorded));
        assert!(!TouchGuide::were_done(&asked(), &Annotations::default()));
    }

    #[test]
    fn a_press_that_is_too_light_or_let_go_is_asked_for_again_and_not_for_ever() {
        let mut guide = TouchGuide::new(&asked(), 1.0, 1);
        let mut n_readings = 0;
        let (took_s, annotations) = lead(&mut guide, |asked_s| {
            n_readings += 1;
            match asked_s {
                Some(_) if n_readings < 1000 => 0.3, // too light
                Some(_) if n_readings % 20 == 0 => 0.0,
                Some(_) => 2.0, // never held
                None => 0.0,
            }
        });
        assert_eq!(guide.progress(), (0, 3));
        assert!(!guide.is_enough() && (took_s - 30.0).abs() < 0.5, "{took_s}"); // 6 tries of 1 s and 4 s
        assert_eq!(annotations.len(), 12);
        assert_eq!((annotations[9].pose.as_str(), annotations[11].pose.as_str()), ("", KnownTouches::UNFELT));
        assert!(guide.is_unfelt());
        // A session that goes on asks again.
        let mut recorded = Annotations::default();
        annotations.into_iter().for_each(|annotation| recorded.handle(annotation));
        assert!(!TouchGuide::were_done(&asked(), &recorded));
    }

    #[test]
    fn a_force_sensor_that_stopped_does_not_hold_up_the_session() {
        let mut guide = TouchGuide::new(&asked(), 1.0, 1);
        let mut t_s = 0.0;
        while guide.handle_time(at(t_s)) {
            t_s += 0.1;
            assert!(t_s < 40.0, "6 tries of 5 s");
        }
        assert!(guide.progress() == (0, 3) && guide.poll().is_none());
    }

    #[test]
    fn any_force_sensor_may_be_pressed_and_a_skip_ends_it() {
        let mut guide = TouchGuide::new(&asked(), 1.0, 2);
        for step in 0..150 {
            let now = at(f64::from(step) * 0.01);
            guide.handle_time(now);
            guide.handle_force(0, Newton(0.0), now);
            guide.handle_force(1, Newton(f64::NAN), now);
            guide.handle_force(7, Newton(9.0), now);
        }
        assert!(guide.is_pressing());
        for step in 150..250 {
            let now = at(f64::from(step) * 0.01);
            guide.handle_force(1, Newton(2.0), now);
            guide.handle_time(now);
        }
        assert_eq!(guide.progress().0, 1);
        guide.skip(at(2.5));
        assert!(!guide.handle_time(at(2.6)) && !guide.is_enough() && !guide.is_unfelt());
        let mut skipped = TouchGuide::new(&asked(), 1.0, 1);
        skipped.skip(at(0.0));
        assert!(!skipped.handle_time(at(0.1)) && !skipped.is_unfelt(), "nobody was to press");
    }
}
