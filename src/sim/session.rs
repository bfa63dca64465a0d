//! The records of a synthetic session, sample by sample.

mod channel;
mod check;
mod error;
mod live;
mod tracker;

use std::collections::BTreeMap;
use std::sync::Arc;

use channel::{Channel, Kind, RATE_HZ, Sampling};
pub use error::SimError;
pub use live::{Fault, LiveSession, Prompt};
use tracker::Tracker;

use super::drag::Drag;
use super::glove::{GloveDesign, WornGlove};
use super::hand::{Finger, Hand, JOINTS};
use super::load_cell::LoadCell;
use super::manipulation::{Repertoire, Touching};
use super::performance::{Annotation, HandState, Performance, Performer};
use super::spec::{Activity, Axes, Conditions, Fingers, SessionSpec, Tracking, TrackingErrors};
use super::touch::ForceStyle;
use crate::protocol::{Name, Plan, Protocol};
use crate::random::Noise;
use crate::units::{NANOS_PER_SEC, Stamp};

/// The user in a session.
struct User {
    spec: SessionSpec,
    hand: Hand,
    style: ForceStyle,
}

impl User {
    fn new(spec: &SessionSpec) -> Self {
        let of_user = |what: &str| Noise::named(&format!("{}, {what}", spec.user_name()));
        User {
            hand: Hand::new(&mut of_user("hand")),
            style: ForceStyle::new(&mut of_user("force")),
            spec: spec.clone(),
        }
    }

    /// Content of this user's free manipulation.
    fn repertoire(&self) -> Repertoire<'_> {
        let Conditions { touching, fingers, episodes, start, .. } = &self.spec.conditions;
        let touching = match (touching, fingers) {
            (None, Fingers::All) => Touching::Any(Box::new(self.of_session("fingers"))),
            (finger, _) => Touching::One(finger.unwrap_or_default()),
        };
        Repertoire { episodes, start: *start, touching }
    }

    fn of_session(&self, what: &str) -> Noise {
        Noise::named(&format!("{}, {what}", self.spec.session_name()))
    }
}

/// One message of the recording. Stamps are measurement times, `received` is the arrival time.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// A sample of the glove.
    Taxels {
        /// By the synchronized clock of the glove, which is a few milliseconds off.
        stamp: Stamp,
        /// Arrival.
        received: Stamp,
        /// Counts samples, including those that never arrive.
        sequence: u32,
        /// `[taxels]`, counts, or `[taxels, 3]`: x, y, z of each; `[fingers, taxels]` if all fingertips have taxels, fingers as in [`Finger::ALL`].
        values: Vec<f32>,
    },
    /// A sample of the motion capture.
    Joints {
        /// Measurement time.
        stamp: Stamp,
        /// Arrival.
        received: Stamp,
        /// `[joints]`, those of [`JOINTS`].
        names: Arc<[String]>,
        /// `[joints]`, rad.
        positions: Vec<f64>,
    },
    /// A sample of the load cell, untared.
    Truth {
        /// Measurement time.
        stamp: Stamp,
        /// Arrival.
        received: Stamp,
        /// N, x y z; z is the normal force, positive under pressure.
        force: [f64; 3],
        /// N m, x y z.
        torque: [f64; 3],
        /// The finger above it; `None` if only one is possible.
        under: Option<Finger>,
    },
    /// The user's task from now on.
    Stage {
        /// Start of the task; also its arrival.
        stamp: Stamp,
        /// 1 to 3; 0 when the session is over.
        stage: u8,
        /// In snake_case; empty outside of the protocol.
        substage: Name,
        /// In snake_case; empty when free.
        pose: Name,
        /// Counted from 0 within the substage.
        repetition: u16,
        /// True if nothing touches the fingertip.
        zero_load: bool,
    },
}

impl Record {
    /// Measurement time.
    pub fn stamp(&self) -> Stamp {
        match *self {
            Record::Taxels { stamp, .. }
            | Record::Joints { stamp, .. }
            | Record::Truth { stamp, .. }
            | Record::Stage { stamp, .. } => stamp,
        }
    }

    /// Arrival time, by which records are ordered.
    pub fn received(&self) -> Stamp {
        match *self {
            Record::Taxels { received, .. } | Record::Joints { received, .. } | Record::Truth { received, .. } => {
                received
            }
            Record::Stage { stamp, .. } => stamp,
        }
    }
}

const EPOCH_S: i64 = 1_760_000_000; // any time will do, as long as it is always the same

/// Begins a session.
///
/// # Errors
/// [`SimError`] when there is no such glove or the protocol doesn't fit into the duration.
pub fn simulate(spec: &SessionSpec) -> Result<SimulatedSession, SimError> {
    let glove = design(spec)?;
    let range = spec.minutes_range();
    if !range.contains(&spec.minutes) {
        return Err(SimError::Minutes { got: spec.minutes, activity: spec.activity, range });
    }
    check::check(spec)?;
    Ok(SimulatedSession::new(spec.clone(), glove))
}

fn design(spec: &SessionSpec) -> Result<&'static GloveDesign, SimError> {
    GloveDesign::numbered(spec.glove).ok_or(SimError::Glove { got: spec.glove })
}

/// A session as an iterator over its records, in the order of their arrival.
#[derive(Debug)]
pub struct SimulatedSession {
    spec: SessionSpec,
    plan: Plan,
    performer: Performer,
    annotations: std::vec::IntoIter<Annotation>,
    next_annotation: Option<Annotation>,
    fingertips: Vec<(Finger, WornGlove)>,
    /// Of a hand that drags.
    drag: Option<Drag>,
    tracker: Tracker,
    load_cell: LoadCell,
    names: Arc<[String]>,
    channels: [Channel; 3],
    transport: Noise,
    measurement: Noise,
    on_the_way: BTreeMap<(Stamp, u64), Record>,
    n_sent: u64,
    start: Stamp,
    end_s: f64,
}

impl SimulatedSession {
    fn new(spec: SessionSpec, design: &'static GloveDesign) -> Self {
        let user = User::new(&spec);
        let (plan, performance) = match spec.activity {
            Activity::Protocol => {
                let protocol = Protocol::paper();
                let plan = Plan::new(&protocol, Some(spec.minutes), &format!("{}, plan", spec.session_name()));
                let mut noise = user.of_session("performance");
                let finger = spec.conditions.touching.unwrap_or_default();
                let performance = Performance::new(&protocol, &plan, &user.hand, &user.style, finger, &mut noise);
                (plan, performance)
            }
            Activity::Manipulation => {
                let mut noise = user.of_session("manipulation");
                let total_s = 60.0 * spec.minutes;
                let repertoire = user.repertoire();
                (Plan::default(), Performance::manipulation(&user.hand, &user.style, total_s, repertoire, &mut noise))
            }
        };
        let (days, hours) = (i64::from(spec.user), i64::from(spec.session));
        let start = Stamp((EPOCH_S + days * 86_400 + hours * 3_600).saturating_mul(NANOS_PER_SEC));
        SimulatedSession::begin(user, design, plan, performance, start)
    }

    fn begin(user: User, design: &'static GloveDesign, plan: Plan, performance: Performance, start: Stamp) -> Self {
        let mut annotations = performance.annotations().to_vec().into_iter();
        let mut transport = user.of_session("transport");
        let errors = user.spec.conditions.tracking;
        let joints = match user.spec.tracking {
            Tracking::Markers => Kind::Joints,
            Tracking::Camera => Kind::SeenJoints,
        };
        SimulatedSession {
            end_s: performance.end_s(),
            next_annotation: annotations.next(),
            annotations,
            fingertips: user.spec.fingers().iter().map(|f| (*f, WornGlove::on(*f, design, &user.spec))).collect(),
            drag: (user.spec.conditions.axes == Axes::Three).then(|| Drag::new(user.of_session("drag"))),
            tracker: Tracker::new(&user),
            load_cell: LoadCell::new(user.of_session("load cell")),
            names: JOINTS.iter().map(|joint| (*joint).to_owned()).collect(),
            channels: [Kind::Taxels, joints, Kind::Truth].map(|kind| Channel::new(kind, &errors, &mut transport)),
            transport,
            measurement: user.of_session("measurement"),
            on_the_way: BTreeMap::new(),
            n_sent: 0,
            start,
            plan,
            performer: Performer::new(performance, user.hand.clone(), user.of_session("unsteadiness")),
            spec: user.spec,
        }
    }

    /// Metadata of the recording, to be written beside it. `synthetic` is always `true`.
    pub fn metadata(&self) -> BTreeMap<String, String> {
        let design = GloveDesign::numbered(self.spec.glove);
        let entries = [
            ("synthetic", "true".to_owned()),
            ("glove", self.spec.glove_name()),
            ("principle", design.map_or("", |design| design.principle).to_owned()),
            (
                "taxels",
                (self.fingertips.len()
                    * design.map_or(0, |design| design.taxels.len())
                    * self.spec.conditions.axes.n())
                .to_string(),
            ),
            ("sign", if design.is_some_and(GloveDesign::inverted) { "-1" } else { "1" }.to_owned()),
            ("user", self.spec.user.to_string()),
            ("donning", self.spec.session.to_string()),
            ("seed", self.spec.seed.to_string()),
            ("minutes", self.spec.minutes.to_string()),
            ("tool_version", env!("CARGO_PKG_VERSION").to_owned()),
        ];
        // Default conditions aren't written, so that the bytes of existing sessions don't change.
        let other = [
            ("activity", self.spec.activity.name(), self.spec.activity == Activity::default()),
            ("tracking", self.spec.tracking.name(), self.spec.tracking == Tracking::default()),
        ];
        let other = other.into_iter().filter(|(_, _, usual)| !usual).map(|(key, name, _)| (key, name.to_owned()));
        let entries = entries.into_iter().chain(other).map(|(key, value)| (key.to_owned(), value));
        entries.chain(self.spec.conditions.notes()).collect()
    }

    /// The trials that the user is asked to do.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The user's intended movements and touches.
    pub fn performance(&self) -> &Performance {
        self.performer.performance()
    }

    /// Approximate number of the session's frames at 100 Hz, for progress.
    pub fn n_frames(&self) -> u64 {
        (self.end_s * RATE_HZ) as u64
    }

    fn stamp(&self, t_s: f64) -> Stamp {
        self.start.offset((t_s * NANOS_PER_SEC as f64).round() as i64)
    }

    /// Takes the sample or annotation that is due first; true if there was one.
    fn advance(&mut self) -> bool {
        let by_time = |a: &&mut Channel, b: &&mut Channel| a.next_s().total_cmp(&b.next_s());
        let Some(channel) = self.channels.iter_mut().min_by(by_time) else { return false };
        let t_s = channel.next_s();
        if let Some(annotation) = self.next_annotation.take_if(|annotation| annotation.at_s <= t_s || t_s >= self.end_s)
        {
            self.next_annotation = self.annotations.next();
            let Annotation { at_s, stage, substage, pose, repetition, zero_load } = annotation;
            let stamp = self.stamp(at_s);
            self.send(stamp, Record::Stage { stamp, stage, substage, pose, repetition, zero_load });
            return true;
        }
        if t_s >= self.end_s {
            return false;
        }
        let (kind, sampling) = (channel.kind, channel.take(&mut self.transport));
        self.sample(kind, &sampling);
        true
    }

    fn sample(&mut self, kind: Kind, sampling: &Sampling) {
        let (stamp, received) = (self.stamp(sampling.stamp_s), self.stamp(sampling.received_s));
        let mut state = self.performer.advance(sampling.at_s);
        if let (Some(drag), Some(contact)) = (&mut self.drag, &mut state.contact) {
            contact.tangential = Some(drag.advance(sampling.at_s, contact));
        }
        let record = match kind {
            Kind::Taxels => {
                let touching = self.performer.performance().finger_at(sampling.at_s);
                let sample = |(finger, tip): &mut (Finger, WornGlove)| {
                    let contact = state.contact.filter(|_| *finger == touching);
                    tip.sample(sampling.dt_s, &HandState { contact, ..state })
                };
                let values = self.fingertips.iter_mut().flat_map(sample).collect();
                Record::Taxels { stamp, received, sequence: sampling.sequence, values }
            }
            Kind::Joints | Kind::SeenJoints => {
                let positions = self.tracker.measure(sampling.dt_s, &state.pose, &mut self.measurement);
                Record::Joints { stamp, received, names: Arc::clone(&self.names), positions }
            }
            Kind::Truth => {
                let reading = self.load_cell.read(sampling.at_s, state.contact);
                let finger = self.performer.performance().finger_at(sampling.at_s);
                let under = (self.spec.conditions.fingers == Fingers::All).then_some(finger);
                Record::Truth { stamp, received, force: reading.force, torque: reading.torque, under }
            }
        };
        if !sampling.lost {
            self.send(received, record);
        }
    }

    fn send(&mut self, received: Stamp, record: Record) {
        self.on_the_way.insert((received, self.n_sent), record);
        self.n_sent += 1;
    }
}

impl Iterator for SimulatedSession {
    type Item = Record;

    fn next(&mut self) -> Option<Record> {
        loop {
            // Nothing that is still to be measured or annotated can arrive before this.
            let annotation_s = self.next_annotation.iter().map(|annotation| annotation.at_s);
            let due_s =
                self.channels.iter().map(|channel| channel.next_s()).chain(annotation_s).fold(f64::INFINITY, f64::min);
            let settled = self.stamp(due_s);
            if let Some(first) = self.on_the_way.first_entry().filter(|first| first.key().0 < settled) {
                return Some(first.remove());
            }
            if !self.advance() {
                return self.on_the_way.pop_first().map(|(_, record)| record);
            }
        }
    }
}
