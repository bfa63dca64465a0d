//! Joint angles over time: each joint by its name, its own timeline, read at the stamps of frames.

use std::collections::VecDeque;

use serde::Serialize;

use super::config::{JointSource, Timing};
use super::event::JointSample;
use crate::units::{Stamp, nanos};

/// States kept per joint. At 1 kHz this is a second of lead or lag between joints and taxels.
const CAPACITY: usize = 1024;

/// What became of a source's messages of joint angles. Every message is counted in exactly one of the fields after
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
    /// Messages whose angles are all NaN, infinite, or beyond what 32 bits hold.
    pub non_finite: u64,
    /// Messages with more names than positions or the reverse.
    pub malformed: u64,
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
    pub fresh: bool,
}

#[derive(Debug, Clone)]
struct Timeline {
    name: String,
    states: VecDeque<(Stamp, f64)>,
}

/// The angles of all joints that any region uses.
#[derive(Debug, Clone)]
pub struct JointTimelines {
    timelines: Vec<Timeline>,
    sources: Vec<JointSource>,
    counters: Vec<JointCounters>,
    joint_slack_ns: i64,
    max_pose_age_ns: i64,
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
            max_pose_age_ns: nanos(timing.max_pose_age),
            time_jump_ns: nanos(timing.time_jump),
        }
    }

    /// Takes the angles of a message that regions use, and counts what became of it.
    pub fn handle(&mut self, sample: &JointSample<'_>) {
        let source = &self.sources[sample.source.0];
        let counters = &mut self.counters[sample.source.0];
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
        match (n_taken, n_duplicate, n_late, n_non_finite) {
            (0, 0, 0, 0) => counters.unknown += 1,
            (0, 0, 0, _) => counters.non_finite += 1,
            (0, 0, _, _) => counters.out_of_order += 1,
            (0, _, _, _) => counters.duplicate += 1,
            _ => {
                counters.used += 1;
                counters.partial += u64::from(n_taken < self.timelines.len());
            }
        }
    }

    /// Whether no later message can change the angle of `joint_idx` at `stamp`: a state at or after it is here.
    pub fn is_settled(&self, joint_idx: usize, stamp: Stamp) -> bool {
        self.timelines[joint_idx].states.back().is_some_and(|&(newest, _)| newest >= stamp)
    }

    /// The angle of a joint at a frame: interpolated between the states around it where the later one lies within the
    /// slack, else the last state, held. `None` when the joint has never been seen before the frame.
    ///
    /// Which of the two it is depends on stamps alone, so arrival order can't reach it.
    pub fn angle_at(&self, joint_idx: usize, stamp: Stamp) -> Option<JointAngle> {
        let states = &self.timelines[joint_idx].states;
        let after = states.partition_point(|&(state_stamp, _)| state_stamp <= stamp);
        let (before_stamp, before) = *states.get(after.checked_sub(1)?)?;
        let age_ns = stamp.nanos_since(before_stamp);
        if age_ns == 0 {
            return Some(JointAngle { angle: before, age_ns, fresh: true });
        }
        if let Some(&(after_stamp, later)) = states.get(after) {
            let span_ns = after_stamp.nanos_since(before_stamp);
            if after_stamp.nanos_since(stamp) <= self.joint_slack_ns && span_ns <= self.max_pose_age_ns {
                let angle = before + (later - before) * (age_ns as f64 / span_ns as f64);
                return Some(JointAngle { angle, age_ns: 0, fresh: true });
            }
        }
        Some(JointAngle { angle: before, age_ns, fresh: age_ns <= self.max_pose_age_ns })
    }

    /// Joints that have never been seen, by name.
    pub fn missing(&self) -> impl Iterator<Item = &str> {
        self.timelines.iter().filter(|timeline| timeline.states.is_empty()).map(|timeline| timeline.name.as_str())
    }

    /// What became of the messages, per source.
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
        if let Some(&(newest, _)) = self.states.back() {
            let ahead_ns = stamp.nanos_since(newest);
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
        self.states.push_back((stamp, angle));
        taken
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
            max_pose_age: Duration::from_millis(age_ms),
            time_jump: Duration::from_millis(200),
        };
        let source = JointSource { name: "hand".into(), stamp_offset_ns: 0, scale: 1.0 };
        JointTimelines::new(vec!["dip".into(), "pip".into()], vec![source], &timing)
    }

    fn send(timelines: &mut JointTimelines, at_ms: i64, names: &[&str], positions: &[f64]) {
        let names: Vec<String> = names.iter().map(|name| name.to_string()).collect();
        let stamp = Stamp(at_ms * MS);
        let source = JointSourceIdx(0);
        timelines.handle(&JointSample { source, stamp, names: &names, positions, received: stamp });
    }

    #[test]
    fn an_angle_is_interpolated_between_the_states_around_it() {
        let mut joints = timelines(10, 50);
        send(&mut joints, 0, &["pip", "dip"], &[9.0, 1.0]);
        send(&mut joints, 8, &["dip", "pip"], &[2.0, 9.0]);
        let angle = joints.angle_at(0, Stamp(2 * MS)).unwrap();
        assert_eq!(angle, JointAngle { angle: 1.25, age_ns: 0, fresh: true });
    }

    #[test]
    fn a_state_beyond_the_slack_is_not_used_even_when_it_is_here() {
        let mut joints = timelines(10, 50);
        send(&mut joints, 0, &["dip"], &[1.0]);
        send(&mut joints, 30, &["dip"], &[2.0]);
        let held = joints.angle_at(0, Stamp(15 * MS)).unwrap();
        assert_eq!(held, JointAngle { angle: 1.0, age_ns: 15 * MS, fresh: true });
        let near = joints.angle_at(0, Stamp(20 * MS)).unwrap();
        assert_eq!(near.age_ns, 0);
    }

    #[test]
    fn a_held_angle_grows_stale_and_an_unseen_joint_has_none() {
        let mut joints = timelines(10, 50);
        send(&mut joints, 0, &["dip"], &[1.0]);
        assert!(joints.angle_at(0, Stamp(50 * MS)).unwrap().fresh);
        assert!(!joints.angle_at(0, Stamp(51 * MS)).unwrap().fresh);
        assert_eq!(joints.angle_at(1, Stamp(50 * MS)), None);
        assert_eq!(joints.missing().collect::<Vec<_>>(), ["pip"]);
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
        send(&mut joints, -500, &["dip"], &[1.0]); // used, after a jump of time
        let expected = JointCounters {
            messages: 9,
            used: 3,
            unknown: 1,
            duplicate: 1,
            out_of_order: 1,
            non_finite: 2,
            malformed: 1,
            partial: 2,
            time_jumps: 1,
        };
        assert_eq!(joints.counters()[0], expected);
    }
}
