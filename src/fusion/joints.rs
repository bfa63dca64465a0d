//! Joint angles over time: each joint by its name, its own timeline, read at the stamps of frames.

use std::collections::VecDeque;

use serde::Serialize;

use super::config::{JointSource, SHORTEST_HOLD, Timing, USUAL_POSE_AGE};
use super::event::JointSample;
use crate::units::{Stamp, nanos};

/// States kept per joint. At 1 kHz this is a second of lead or lag between joints and taxels.
const CAPACITY: usize = 1024;

/// Steps between states that the period is taken from: a gap or two among them don't move it.
const PERIOD_STEPS: usize = 15;

/// Fewer steps than this tell no period.
const MIN_PERIOD_STEPS: usize = 4;

/// Periods of its source for which a pose is as usual: the one that it stands for, and another for jitter.
const USUAL_PERIODS: i64 = 2;

/// Unless it is set, a pose is held for as many periods of its source, where that is longer.
const HELD_PERIODS: i64 = 3;

/// Unless it is set, no pose is held for longer.
const LONGEST_HOLD_NS: i64 = 500_000_000;

/// Counters of a source's joint messages, by outcome. Every message is counted in exactly one of the fields after
/// `messages`, up to `malformed`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct JointCounters {
    /// Messages received.
    pub messages: u64,
    /// Messages with at least one angle that was taken.
    pub used: u64,
    /// Messages that name none of the joints that regions use.
    pub unknown: u64,
    /// Messages with the stamp of the one before.
    pub duplicate: u64,
    /// Messages older than what has been taken.
    pub out_of_order: u64,
    /// Messages none of whose angles is finite.
    pub nothing_finite: u64,
    /// Messages with more names than positions or the reverse.
    pub malformed: u64,
    /// Messages with an angle that is NaN, infinite, or beyond what 32 bits hold, of a joint that regions use: all those
    /// counted in `nothing_finite`, and others whose finite angles were taken.
    pub non_finite: u64,
    /// Used messages that lack some of the joints that regions use.
    pub partial: u64,
    /// Times the stamps jumped back, which forgets the angles before.
    pub time_jumps: u64,
}

/// A joint's angle at a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointAngle {
    /// rad.
    pub angle: f64,
    /// Zero when it was measured at the frame or interpolated, else how long ago it was measured, ns.
    pub age_ns: i64,
    /// Whether it is recent enough to stand for the frame.
    pub trust: PoseTrust,
}

/// How far an angle may stand for a frame. The worst of several is the largest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum PoseTrust {
    /// Measured, interpolated, or as old as its source's rate makes it.
    #[default]
    Fresh,
    /// Older than its source's rate explains: messages are missing, and the last angle is held.
    Held,
    /// Too old, or never seen.
    Stale,
}

#[derive(Debug, Clone)]
struct Timeline {
    name: String,
    states: VecDeque<State>,
}

#[derive(Debug, Clone, Copy)]
struct State {
    stamp: Stamp,
    angle: f64,
    /// Usual step between the states up to this one, once there are enough. It depends on them alone, so whoever reads the
    /// angle at a stamp finds the same period whatever has arrived since.
    period_ns: Option<i64>,
}

/// The angles of all joints that any region uses.
///
/// An angle is held until the next one comes, for [`Timing::max_pose_age`](super::Timing::max_pose_age). Unless that is set,
/// it is held for three of the joint's own measured periods, at least 200 ms and at most 500 ms. It is [`PoseTrust::Held`]
/// rather than fresh when it is older than two periods and 50 ms.
#[derive(Debug, Clone)]
pub struct JointTimelines {
    timelines: Vec<Timeline>,
    sources: Vec<JointSource>,
    counters: Vec<JointCounters>,
    joint_slack_ns: i64,
    max_pose_age_ns: Option<i64>,
    time_jump_ns: i64,
}

enum Taken {
    Yes,
    AfterJump,
    Duplicate,
    OutOfOrder,
    NonFinite,
}

impl JointTimelines {
    /// Empty timelines of the joints `names`, each named once.
    pub fn new(names: Vec<String>, sources: Vec<JointSource>, timing: &Timing) -> Self {
        JointTimelines {
            timelines: names
                .into_iter()
                .map(|name| Timeline { name, states: VecDeque::with_capacity(CAPACITY) })
                .collect(),
            counters: vec![JointCounters::default(); sources.len()],
            sources,
            joint_slack_ns: nanos(timing.joint_slack),
            max_pose_age_ns: timing.max_pose_age.map(nanos),
            time_jump_ns: nanos(timing.time_jump),
        }
    }

    /// Takes the angles of a message that regions use, and counts what became of it.
    pub fn handle(&mut self, sample: &JointSample<'_>) {
        let source = &self.sources[sample.source.position()];
        let counters = &mut self.counters[sample.source.position()];
        counters.messages += 1;
        if sample.names.len() != sample.positions.len() {
            counters.malformed += 1;
            return;
        }
        let stamp = sample.stamp.offset(source.stamp_offset_ns);
        let (mut n_taken, mut n_duplicate, mut n_late, mut n_non_finite, mut jumped) = (0, 0, 0, 0, false);
        for timeline in &mut self.timelines {
            let Some(position) = sample.names.iter().position(|name| *name == timeline.name) else { continue };
            match timeline.push(stamp, sample.positions[position] * source.scale, self.time_jump_ns) {
                Taken::Yes => n_taken += 1,
                Taken::AfterJump => {
                    n_taken += 1;
                    jumped = true;
                }
                Taken::Duplicate => n_duplicate += 1,
                Taken::OutOfOrder => n_late += 1,
                Taken::NonFinite => n_non_finite += 1,
            }
        }
        counters.time_jumps += u64::from(jumped);
        counters.non_finite += u64::from(n_non_finite > 0);
        match (n_taken, n_duplicate, n_late, n_non_finite) {
            (0, 0, 0, 0) => counters.unknown += 1,
            (0, 0, 0, _) => counters.nothing_finite += 1,
            (0, 0, _, _) => counters.out_of_order += 1,
            (0, _, _, _) => counters.duplicate += 1,
            _ => {
                counters.used += 1;
                counters.partial += u64::from(n_taken < self.timelines.len());
            }
        }
    }

    /// True if no later message can change the angle of `joint_idx` at `stamp`: a state at or after it is here.
    pub fn is_settled(&self, joint_idx: usize, stamp: Stamp) -> bool {
        self.timelines[joint_idx].states.back().is_some_and(|newest| newest.stamp >= stamp)
    }

    /// The angle of a joint at a frame: interpolated between the states around it where the later one lies within the
    /// slack, else the last state, held. `None` when the joint has never been seen before the frame.
    ///
    /// Which of the two it is depends on stamps alone, so arrival order can't reach it.
    pub fn angle_at(&self, joint_idx: usize, stamp: Stamp) -> Option<JointAngle> {
        let states = &self.timelines[joint_idx].states;
        let after = states.partition_point(|state| state.stamp <= stamp);
        let before = *states.get(after.checked_sub(1)?)?;
        let age_ns = stamp.nanos_since(before.stamp);
        if age_ns == 0 {
            return Some(JointAngle { angle: before.angle, age_ns, trust: PoseTrust::Fresh });
        }
        let (usual_ns, longest_ns) = self.limits(before.period_ns);
        if let Some(later) = states.get(after) {
            let span_ns = later.stamp.nanos_since(before.stamp);
            if later.stamp.nanos_since(stamp) <= self.joint_slack_ns && span_ns <= longest_ns {
                let angle = before.angle + (later.angle - before.angle) * (age_ns as f64 / span_ns as f64);
                return Some(JointAngle { angle, age_ns: 0, trust: PoseTrust::Fresh });
            }
        }
        let trust = match age_ns {
            _ if age_ns > longest_ns => PoseTrust::Stale,
            _ if age_ns > usual_ns => PoseTrust::Held,
            _ => PoseTrust::Fresh,
        };
        Some(JointAngle { angle: before.angle, age_ns, trust })
    }

    /// How old an angle is as usual, and how old it may be, by the period of its source.
    fn limits(&self, period_ns: Option<i64>) -> (i64, i64) {
        let periods = |n: i64| period_ns.map_or(0, |period_ns| period_ns.saturating_mul(n));
        let follows = periods(HELD_PERIODS).clamp(nanos(SHORTEST_HOLD), LONGEST_HOLD_NS);
        let longest_ns = self.max_pose_age_ns.unwrap_or(follows);
        (periods(USUAL_PERIODS).max(nanos(USUAL_POSE_AGE)).min(longest_ns), longest_ns)
    }

    /// Joints that have never been seen, by name.
    pub fn missing(&self) -> impl Iterator<Item = &str> {
        self.timelines.iter().filter(|timeline| timeline.states.is_empty()).map(|timeline| timeline.name.as_str())
    }

    /// Message counters, per source.
    pub fn counters(&self) -> &[JointCounters] {
        &self.counters
    }
}

impl Timeline {
    fn push(&mut self, stamp: Stamp, angle: f64, time_jump_ns: i64) -> Taken {
        // Models take 32 bits: what is larger than those hold would reach them as infinite.
        if !(angle as f32).is_finite() {
            return Taken::NonFinite;
        }
        let mut taken = Taken::Yes;
        if let Some(newest) = self.states.back() {
            let ahead_ns = stamp.nanos_since(newest.stamp);
            if ahead_ns == 0 {
                return Taken::Duplicate;
            }
            if ahead_ns < -time_jump_ns {
                self.states.clear();
                taken = Taken::AfterJump;
            } else if ahead_ns < 0 {
                return Taken::OutOfOrder;
            }
        }
        if self.states.len() == CAPACITY {
            self.states.pop_front();
        }
        let period_ns = self.period_ns(stamp);
        self.states.push_back(State { stamp, angle, period_ns });
        taken
    }

    /// Usual step between the last states, up to one at `stamp` that is to come: the mean of the middle half of them.
    fn period_ns(&self, stamp: Stamp) -> Option<i64> {
        let mut steps = [0; PERIOD_STEPS];
        let mut n_steps = 0;
        let mut later = stamp;
        for (step, state) in steps.iter_mut().zip(self.states.iter().rev()) {
            *step = later.nanos_since(state.stamp);
            later = state.stamp;
            n_steps += 1;
        }
        let steps = &mut steps[..n_steps];
        steps.sort_unstable();
        let middle = &steps[n_steps / 4..n_steps - n_steps / 4];
        // Each is a part of an i64; there are few.
        let sum: i128 = middle.iter().copied().map(i128::from).sum();
        (n_steps >= MIN_PERIOD_STEPS).then(|| (sum / middle.len() as i128) as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fusion::JointSourceIdx;
    use std::time::Duration;

    const MS: i64 = 1_000_000;

    fn timelines(slack_ms: u64, age_ms: u64) -> JointTimelines {
        let timing = Timing {
            max_gap: Duration::from_millis(50),
            joint_slack: Duration::from_millis(slack_ms),
            max_pose_age: Some(Duration::from_millis(age_ms)).filter(|age| !age.is_zero()),
            time_jump: Duration::from_millis(200),
            max_age: None,
        };
        let source = JointSource { name: "hand".into(), stamp_offset_ns: 0, scale: 1.0 };
        JointTimelines::new(vec!["dip".into(), "pip".into()], vec![source], &timing)
    }

    fn send(timelines: &mut JointTimelines, at_ms: i64, names: &[&str], positions: &[f64]) {
        let names: Vec<String> = names.iter().map(|name| name.to_string()).collect();
        let stamp = Stamp(at_ms * MS);
        let source = JointSourceIdx::at(0);
        timelines.handle(&JointSample { source, stamp, names: &names, positions, received: stamp });
    }

    #[test]
    fn an_angle_is_interpolated_between_the_states_around_it() {
        let mut joints = timelines(10, 50);
        send(&mut joints, 0, &["pip", "dip"], &[9.0, 1.0]);
        send(&mut joints, 8, &["dip", "pip"], &[2.0, 9.0]);
        let angle = joints.angle_at(0, Stamp(2 * MS)).unwrap();
        assert_eq!(angle, JointAngle { angle: 1.25, age_ns: 0, trust: PoseTrust::Fresh });
    }

    #[test]
    fn a_state_beyond_the_slack_is_not_used_even_when_it_is_here() {
        let mut joints = timelines(10, 50);
        send(&mut joints, 0, &["dip"], &[1.0]);
        send(&mut joints, 30, &["dip"], &[2.0]);
        let held = joints.angle_at(0, Stamp(15 * MS)).unwrap();
        assert_eq!(held, JointAngle { angle: 1.0, age_ns: 15 * MS, trust: PoseTrust::Fresh });
        let near = joints.angle_at(0, Stamp(20 * MS)).unwrap();
        assert_eq!(near.age_ns, 0);
    }

    #[test]
    fn a_held_angle_grows_stale_and_an_unseen_joint_has_none() {
        let mut joints = timelines(10, 50);
        send(&mut joints, 0, &["dip"], &[1.0]);
        assert_eq!(joints.angle_at(0, Stamp(50 * MS)).unwrap().trust, PoseTrust::Fresh);
        assert_eq!(joints.angle_at(0, Stamp(51 * MS)).unwrap().trust, PoseTrust::Stale);
        assert_eq!(joints.angle_at(1, Stamp(50 * MS)), None);
        assert_eq!(joints.missing().collect::<Vec<_>>(), ["pip"]);
    }

    #[test]
    fn how_long_an_angle_is_held_follows_the_rate_of_its_source_within_bounds() {
        // Period, then until when an angle is as usual and until when it is held, all in ms.
        for (period, usual, longest) in
            [(1, 50, 200), (10, 50, 200), (33, 66, 200), (50, 100, 200), (100, 200, 300), (400, 500, 500)]
        {
            let mut joints = timelines(10, 0);
            (0..20).for_each(|k| send(&mut joints, k * period, &["dip"], &[1.0]));
            let trust = |age: i64| joints.angle_at(0, Stamp((19 * period + age) * MS)).unwrap().trust;
            assert_eq!(trust(usual), PoseTrust::Fresh, "{period} ms");
            let over = if usual < longest { PoseTrust::Held } else { PoseTrust::Stale };
            assert_eq!(trust(usual + 1), over, "{period} ms");
            assert_eq!(
                (trust(longest) < PoseTrust::Stale, trust(longest + 1)),
                (true, PoseTrust::Stale),
                "{period} ms"
            );
        }
    }

    #[test]
    fn the_period_at_a_stamp_depends_on_the_states_up_to_it_and_gaps_and_jitter_do_not_move_it() {
        let mut joints = timelines(10, 0);
        let jitter = [0, 11, -7, 14, -15, 3, -12, 8];
        let mut at = 0;
        let mut stamps = Vec::new();
        for k in 0..40 {
            at += if k == 20 { 300 } else { 33 };
            stamps.push(at + jitter[k % jitter.len()]);
        }
        let mut periods = Vec::new();
        for &stamp in &stamps {
            send(&mut joints, stamp, &["dip"], &[1.0]);
            periods.push(joints.timelines[0].states.back().unwrap().period_ns);
        }
        assert_eq!(periods[..4], [None; 4]);
        assert!(periods[15..].iter().all(|period| (25 * MS..=42 * MS).contains(&period.unwrap())), "{periods:?}");
        let kept: Vec<_> = joints.timelines[0].states.iter().map(|state| state.period_ns).collect();
        assert_eq!(kept, periods, "what comes later changes nothing");
    }

    #[test]
    fn every_message_is_used_or_dropped_for_a_reason() {
        let mut joints = timelines(10, 50);
        send(&mut joints, 0, &["dip", "pip"], &[1.0, 1.0]);
        send(&mut joints, 10, &["dip"], &[1.0]); // used, partial
        send(&mut joints, 10, &["dip"], &[1.0]); // duplicate
        send(&mut joints, 5, &["dip"], &[1.0]); // out of order
        send(&mut joints, 20, &["thumb"], &[1.0]); // unknown
        send(&mut joints, 20, &["dip"], &[f64::NAN]); // non-finite
        send(&mut joints, 20, &["dip"], &[1e39]); // non-finite for a model
        send(&mut joints, 20, &["dip", "pip"], &[1.0]); // malformed
        send(&mut joints, 25, &["dip", "pip"], &[1.0, f64::INFINITY]); // used, partial, and one of them not finite
        send(&mut joints, -500, &["dip"], &[1.0]); // used, after a jump of time
        let expected = JointCounters {
            messages: 10,
            used: 4,
            unknown: 1,
            duplicate: 1,
            out_of_order: 1,
            nothing_finite: 2,
            malformed: 1,
            non_finite: 3,
            partial: 3,
            time_jumps: 1,
        };
        assert_eq!(joints.counters()[0], expected);
    }
}
