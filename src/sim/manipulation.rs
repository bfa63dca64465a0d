//! Free manipulation: a wearer's actions without a protocol, and thus the input of a model or filter in daily use.
//!
//! The protocol's touches are firm and short, and half of its time is in the air. A working hand holds an object
//! lightly for a minute while its fingers move, grasps for minutes without letting go, closes slowly, rests, and may
//! touch something before the recording begins. Each of these is an [`Episode`]; a session is a sequence of them.
//!
//! Lengths and forces are chosen to challenge a model, not measured on people: there is no public record of them.

use super::hand::{Finger, Hand, TERMINAL_POSES};
use super::performance::{Actor, Annotation, Performance};
use super::touch::ForceStyle;
use crate::random::Noise;

/// The shortest session of free manipulation, minutes: it contains each kind of episode once, whatever its length.
pub const MIN_MANIPULATION_MINUTES: f64 = 10.0;
/// The shortest session of free manipulation without grasps, minutes.
pub const MIN_MINUTES_WITHOUT_GRASP: f64 = 2.0;
/// The longest, minutes.
pub const MAX_MANIPULATION_MINUTES: f64 = 120.0;

/// Fraction of the sessions in which the finger touches something from the first sample on.
const STARTS_IN_CONTACT: f64 = 0.25;

/// A part of a session of free manipulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Episode {
    /// All fingers move in the air.
    Air,
    /// One pose is held in the air.
    StillAir,
    /// A touch of 3 to 20 gF, held for 10 to 90 s while the finger moves.
    LightHold,
    /// The same, while the finger stays still.
    StillHold,
    /// An object is held and turned for minutes, without a moment in the air.
    Grasp,
    /// Force rises slowly from zero, and is released.
    Ramp,
    /// Short touches, one after the other, some of them light.
    Touches,
}

impl Episode {
    /// All kinds.
    pub const ALL: [Episode; 7] = [
        Episode::Air,
        Episode::StillAir,
        Episode::LightHold,
        Episode::StillHold,
        Episode::Grasp,
        Episode::Ramp,
        Episode::Touches,
    ];

    /// Its name in the annotations: a substage outside of the protocol.
    pub fn name(self) -> &'static str {
        match self {
            Episode::Air => "air",
            Episode::StillAir => "still_air",
            Episode::LightHold => "light_hold",
            Episode::StillHold => "still_hold",
            Episode::Grasp => "grasp",
            Episode::Ramp => "ramp",
            Episode::Touches => "touches",
        }
    }

    /// True if it has no touch.
    pub fn is_air(self) -> bool {
        matches!(self, Episode::Air | Episode::StillAir)
    }

    /// True if the touch lasts from its beginning to its end, so that a session can begin within it.
    pub fn is_held(self) -> bool {
        matches!(self, Episode::LightHold | Episode::StillHold | Episode::Grasp)
    }

    /// Maximum duration, s. A session of `total_s` has no grasp that fills it.
    fn duration_s(self, total_s: f64, noise: &mut Noise) -> f64 {
        match self {
            Episode::Air => noise.uniform(5.0, 25.0),
            Episode::StillAir => noise.uniform(15.0, 60.0),
            Episode::LightHold | Episode::StillHold => noise.log_uniform(10.0, 90.0) + 2.0 * MARGIN_S,
            Episode::Grasp => noise.uniform(60.0, 240.0).min(total_s / 4.0),
            Episode::Ramp => noise.uniform(15.0, 60.0),
            Episode::Touches => noise.uniform(8.0, 25.0),
        }
    }
}

/// True if a session of free manipulation begins with a touch that started before the recording.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Start {
    /// In one of four sessions.
    #[default]
    Either,
    /// It begins in the air.
    InAir,
    /// It begins with a touch.
    InContact,
}

impl Start {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Start::Either => "either",
            Start::InAir => "in-air",
            Start::InContact => "in-contact",
        }
    }
}

/// Content of a session of free manipulation.
#[derive(Debug)]
pub(crate) struct Repertoire<'a> {
    /// Kinds of episodes; empty for all. Air comes first and between touches whatever they are.
    pub(crate) episodes: &'a [Episode],
    /// Its beginning.
    pub(crate) start: Start,
    /// The finger that touches.
    pub(crate) touching: Touching,
}

/// Choice of the finger that touches.
#[derive(Debug)]
pub(crate) enum Touching {
    /// Always the same.
    One(Finger),
    /// Any finger, a different one each episode.
    Any(Box<Noise>),
}

impl Touching {
    fn next(&mut self) -> Finger {
        match self {
            Touching::One(finger) => *finger,
            Touching::Any(noise) => {
                let chosen = noise.uniform(0.0, Finger::ALL.len() as f64) as usize;
                Finger::ALL.get(chosen).copied().unwrap_or_default()
            }
        }
    }
}

/// Time between the annotation and the touch, and between the touch and the next annotation, s.
const MARGIN_S: f64 = 0.4;

/// Time in the air after an episode of touch, s: a hand that lets go moves to the next object.
const ON_THE_WAY_S: (f64, f64) = (1.0, 6.0);

impl Performance {
    /// A session of free manipulation that lasts `total_s`.
    pub(crate) fn manipulation(
        hand: &Hand,
        style: &ForceStyle,
        total_s: f64,
        repertoire: Repertoire<'_>,
        noise: &mut Noise,
    ) -> Self {
        let Repertoire { episodes, start, mut touching } = repertoire;
        let mut performance = Performance::idle(hand, touching.next(), noise);
        let begins_touching = match (noise.uniform(0.0, 1.0) < STARTS_IN_CONTACT, start) {
            (by_chance, Start::Either) => by_chance,
            (_, Start::InAir) => false,
            (_, Start::InContact) => true,
        };
        let kinds = Episode::ALL.into_iter().filter(|kind| episodes.is_empty() || episodes.contains(kind));
        let kinds: Vec<Episode> = kinds.collect();
        let held = kinds.iter().copied().find(|kind| kind.is_held());
        let mut actor = Actor { hand, style, noise, pose_s: 0.0, performance: &mut performance };
        let mut at_s = 0.0;
        let mut repetitions = [0_u16; Episode::ALL.len()];
        // Air first, so that a zero can be found; or a touch that started before the recording.
        let first = held.filter(|_| begins_touching).unwrap_or(Episode::Air);
        let mut waiting: Vec<Episode> = kinds.iter().copied().filter(|episode| *episode != first).collect();
        actor.noise.shuffle(&mut waiting);
        waiting.push(first); // the last one is the next
        while at_s < total_s {
            let Some(episode) = waiting.pop() else {
                waiting.extend(&kinds);
                actor.noise.shuffle(&mut waiting);
                continue;
            };
            let until_s = (at_s + episode.duration_s(total_s, actor.noise)).min(total_s);
            let repetition = &mut repetitions[episode as usize];
            actor.performance.annotate_episode(episode, *repetition, at_s);
            *repetition += 1;
            actor.go_through(episode, at_s, until_s, at_s == 0.0);
            at_s = until_s;
            if !episode.is_air() && at_s < total_s {
                let until_s = (at_s + actor.noise.uniform(ON_THE_WAY_S.0, ON_THE_WAY_S.1)).min(total_s);
                actor.performance.annotate_episode(Episode::Air, repetitions[Episode::Air as usize], at_s);
                repetitions[Episode::Air as usize] += 1;
                // Halfway, so that it is tared in the air under either finger.
                actor.performance.move_load_cell(0.5 * (at_s + until_s), touching.next());
                actor.go_through(Episode::Air, at_s, until_s, false);
                at_s = until_s;
            }
        }
        performance.end(total_s);
        performance
    }

    fn annotate_episode(&mut self, episode: Episode, repetition: u16, at_s: f64) {
        self.annotate_as(Annotation {
            at_s,
            stage: 0,
            substage: episode.name().into(),
            pose: "".into(),
            repetition,
            zero_load: episode.is_air(),
        });
    }
}

impl Actor<'_> {
    /// `at_once`: the touch exists from the beginning, not only after the hand has reached for the object.
    fn go_through(&mut self, episode: Episode, start_s: f64, end_s: f64, at_once: bool) {
        let touch = (if at_once { start_s - 1.0 } else { start_s + MARGIN_S }, end_s - MARGIN_S);
        if !episode.is_air() && touch.1 - touch.0 < 1.0 {
            return self.move_freely(start_s, end_s, 0.7); // the session is over before it could be touched
        }
        match episode {
            Episode::Air => self.move_freely(start_s, end_s, 1.0),
            Episode::StillAir => self.keep_still(start_s),
            Episode::LightHold => {
                self.move_freely(start_s, end_s, 0.7);
                self.touch_lightly(touch);
            }
            Episode::StillHold => {
                self.keep_still(start_s);
                self.touch_lightly(touch);
            }
            Episode::Grasp => {
                self.move_freely(start_s, end_s, 0.5);
                let touch = self.style.grasp(touch.0, touch.1, self.noise);
                self.performance.touch(touch);
            }
            Episode::Ramp => {
                match self.noise.uniform(0.0, 1.0) < 0.5 {
                    true => self.keep_still(start_s),
                    false => self.move_freely(start_s, end_s, 0.7),
                }
                let top_gf = self.noise.log_uniform(40.0, 200.0);
                let touch = self.style.ramp(touch.0, touch.1, top_gf, self.noise);
                self.performance.touch(touch);
            }
            Episode::Touches => {
                self.move_freely(start_s, end_s, 0.7);
                let mut at_s = touch.0;
                loop {
                    let until_s = at_s + self.noise.log_uniform(0.3, 4.0);
                    if until_s > touch.1 {
                        break;
                    }
                    let level_gf = self.noise.log_uniform(5.0, 300.0);
                    let touch = self.style.hold_at(at_s, until_s, level_gf, 0.15, self.noise);
                    self.performance.touch(touch);
                    at_s = until_s + self.noise.uniform(0.3, 2.0);
                }
            }
        }
    }

    fn touch_lightly(&mut self, (from_s, until_s): (f64, f64)) {
        let level_gf = self.noise.log_uniform(3.0, 20.0);
        let touch = self.style.hold_at(from_s, until_s, level_gf, 0.1, self.noise);
        self.performance.touch(touch);
    }

    fn keep_still(&mut self, at_s: f64) {
        let free: Vec<&str> = TERMINAL_POSES.iter().filter(|pose| pose.index_free).map(|pose| pose.name).collect();
        let chosen = self.noise.uniform(0.0, free.len() as f64) as usize;
        if let Some(name) = free.get(chosen) {
            self.take_pose(name, at_s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn performance(seed: &str, minutes: f64) -> Performance {
        let mut noise = Noise::named(seed);
        let (hand, style) = (Hand::new(&mut noise), ForceStyle::new(&mut noise));
        let repertoire = Repertoire { episodes: &[], start: Start::Either, touching: Touching::One(Finger::Index) };
        Performance::manipulation(&hand, &style, 60.0 * minutes, repertoire, &mut noise)
    }

    #[test]
    fn nothing_is_touched_while_it_is_annotated_as_air() {
        for seed in ["a", "b", "c", "d", "e", "f"] {
            let performance = performance(seed, 20.0);
            let annotations = performance.annotations();
            for pair in annotations.windows(2).filter(|pair| pair[0].zero_load) {
                let touched =
                    |touch: &&crate::sim::touch::Touch| touch.start_s < pair[1].at_s && touch.end_s > pair[0].at_s;
                assert_eq!(performance.touches().iter().find(touched), None, "{seed} at {} s", pair[0].at_s);
            }
            assert_eq!(annotations.last().map(|last| (last.at_s, last.zero_load)), Some((1200.0, false)));
        }
    }

    #[test]
    fn the_shortest_session_has_every_kind_and_a_long_one_has_them_again() {
        for seed in 0..40 {
            for (minutes, times) in [(MIN_MANIPULATION_MINUTES, 1), (60.0, 4)] {
                let performance = performance(&format!("session {seed}"), minutes);
                for episode in Episode::ALL {
                    let named = |annotation: &&Annotation| &*annotation.substage == episode.name();
                    let n = performance.annotations().iter().filter(named).count();
                    assert!(n >= times, "session {seed}, {minutes} min: {n} of {episode:?}");
                }
            }
        }
    }

    #[test]
    fn some_sessions_begin_with_a_touch_and_a_grasp_never_lets_go() {
        let mut n_begun = 0;
        for seed in 0..40 {
            let performance = performance(&format!("session {seed}"), 10.0);
            n_begun += usize::from(performance.touches()[0].force(0.0).0 > 0.0);
            let annotations = performance.annotations();
            for pair in annotations.windows(2).filter(|pair| &*pair[0].substage == "grasp") {
                let (from_s, until_s) = (pair[0].at_s + 2.0, pair[1].at_s - 2.0);
                let mut at_s = from_s;
                while at_s < until_s {
                    let force = performance.touches().iter().map(|touch| touch.force(at_s).0).sum::<f64>();
                    assert!(force > 10.0, "session {seed} at {at_s} s: {force} gF");
                    at_s += 0.1;
                }
            }
        }
        assert!((4..=18).contains(&n_begun), "{n_begun}");
    }
}
