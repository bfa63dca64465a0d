//! View of a collection at one moment, whatever shows it.

use tactile_pose_fusion::collect::{Layout, LedSession, Preflight, Senses, State, Stream, TouchGuide};
use tactile_pose_fusion::protocol::{Action, ForceLevels};
use tactile_pose_fusion::units::{NANOS_PER_SEC, Newton, Stamp};

/// In what mood a prompt is: it decides its colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mood {
    /// Something is looked at, or got ready for.
    Ready,
    /// In the air: nothing may touch the glove.
    Air,
    /// The load cell is to be touched.
    Touch,
    /// Nothing goes on.
    Waiting,
    /// Something is wrong.
    Wrong,
}

/// A bar: what it is of, how far it is, from 0 to 1, and its value in words.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bar {
    pub(crate) name: String,
    pub(crate) part: f64,
    pub(crate) value: String,
}

/// A stream of a sensor.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Health {
    pub(crate) name: String,
    pub(crate) rate_hz: f64,
    pub(crate) is_silent: bool,
}

/// The substages: stage, name, how many of how many items are done, and whether it is the one that goes on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row {
    pub(crate) stage: u8,
    pub(crate) name: String,
    pub(crate) done: usize,
    pub(crate) items: usize,
    pub(crate) is_current: bool,
}

/// View of a collection at one moment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct View {
    pub(crate) title: String,
    pub(crate) place: String,
    pub(crate) mood: Mood,
    pub(crate) prompt: String,
    pub(crate) next: String,
    /// How much of the step is over, from 0 to 1, and how much is left, s.
    pub(crate) countdown: Option<(f64, f64)>,
    pub(crate) rows: Vec<Row>,
    pub(crate) left: String,
    pub(crate) taxels: Vec<(String, Vec<f64>)>,
    pub(crate) joints: Vec<Bar>,
    /// Force now over its zero, N.
    pub(crate) force: Option<f64>,
    pub(crate) levels: ForceLevels,
    pub(crate) health: Vec<Health>,
    pub(crate) notes: Vec<String>,
    pub(crate) keys: &'static str,
    pub(crate) synthetic: bool,
}

impl View {
    /// The view of a session and the sensors; the caller says what goes on.
    pub(crate) fn new(title: &str, session: &LedSession, senses: &Senses, zero: f64, now: Stamp) -> Self {
        View {
            title: title.to_owned(),
            place: String::new(),
            mood: Mood::Waiting,
            prompt: String::new(),
            next: String::new(),
            countdown: None,
            rows: rows(session),
            left: format!("{} left", clock(session.left_s())),
            taxels: taxels(senses),
            joints: joints(senses),
            force: senses.layout().force.first().and_then(|_| senses.force(0)).map(|Newton(force)| force - zero),
            levels: session.protocol().levels.clone(),
            health: health(senses, now),
            notes: Vec::new(),
            keys: "",
            synthetic: false,
        }
    }

    /// Adds the prompts of a session.
    pub(crate) fn of_session(mut self, session: &LedSession, now: Stamp) -> Self {
        let protocol = session.protocol();
        let wording =
            |item: usize, step: usize| protocol.prompt(&session.plan().trials()[item], session.step(item, step));
        self.countdown = session.span().map(|span| countdown(span, now));
        self.keys = "space pause   r repeat the last   s skip   q quit";
        match *session.state() {
            State::Waiting => {
                self.mood = Mood::Waiting;
                self.prompt = "Press space to go on".to_owned();
                self.keys = "space go on   r repeat the last   q quit, and go on another time";
                self.next = session.current().map(|item| wording(item, 0)).unwrap_or_default();
            }
            State::Getting { item, letting_go: true, .. } => {
                self.mood = Mood::Ready;
                self.prompt = "Let go".to_owned();
                self.next = wording(item, 0);
            }
            State::Getting { item, .. } => {
                self.mood = Mood::Ready;
                self.prompt = "Get ready".to_owned();
                self.next = wording(item, 0);
            }
            State::Doing { item, step, .. } => {
                let trial = &session.plan().trials()[item];
                let zero_load = session.step(item, step).zero_load;
                self.mood = if zero_load { Mood::Air } else { Mood::Touch };
                self.prompt = wording(item, step);
                let has_next_step = trial.steps(protocol).len() > step + 1;
                self.next = match (has_next_step, &trial.action) {
                    (true, _) => wording(item, step + 1),
                    (false, Action::MoveFreely) => String::new(),
                    (false, _) => session.following().map(|next| wording(next, 0)).unwrap_or_default(),
                };
            }
            State::Over => {
                self.prompt = "That was all. Thank you!".to_owned();
                self.keys = "space finish   r repeat the last   q quit, and finish another time";
            }
        }
        if let Some(item) = session.current() {
            let trial = &session.plan().trials()[item];
            let of = |row: &&Row| row.stage == trial.stage && row.name == *trial.substage;
            let (done, items) = self.rows.iter().find(of).map_or((0, 0), |row| (row.done, row.items));
            self.place = format!("stage {}  {}  {} of {items}", trial.stage, trial.substage, (done + 1).min(items));
        }
        self
    }

    /// Adds the prompts of the known touches.
    pub(crate) fn of_known_touches(mut self, guide: &TouchGuide, now: Stamp) -> Self {
        let (held, asked) = guide.progress();
        self.mood = if guide.is_pressing() { Mood::Touch } else { Mood::Ready };
        self.place = format!("known touches  {} of {asked}", (held + 1).min(asked));
        self.prompt = guide.prompt().to_owned();
        self.countdown = guide.span().map(|span| countdown(span, now));
        self.keys = "s skip the known touches   q quit";
        self
    }

    /// Adds the prompts of the checks.
    pub(crate) fn of_checks(mut self, checks: &Preflight, now: Stamp) -> Self {
        let (at, n) = checks.progress();
        self.mood = Mood::Ready;
        self.place = format!("checks  {at} of {n}");
        self.prompt = checks.prompt().to_owned();
        self.countdown = checks.span().map(|span| countdown(span, now));
        self.keys = "q quit";
        self
    }
}

fn countdown((from, to): (Stamp, Stamp), now: Stamp) -> (f64, f64) {
    let seconds = |nanos: i64| nanos as f64 / NANOS_PER_SEC as f64;
    let (length_s, left_s) = (seconds(to.nanos_since(from)), seconds(to.nanos_since(now)).max(0.0));
    ((1.0 - left_s / length_s.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0), left_s)
}

/// Minutes and seconds.
pub(crate) fn clock(seconds: f64) -> String {
    let seconds = seconds.ceil().max(0.0) as u64;
    format!("{}:{:02}", seconds / 60, seconds % 60)
}

fn rows(session: &LedSession) -> Vec<Row> {
    let current = session.current().map(|item| &session.plan().trials()[item]);
    let mut rows: Vec<Row> = Vec::new();
    for (item, trial) in session.plan().trials().iter().enumerate() {
        let is_same = |row: &&mut Row| row.stage == trial.stage && row.name == *trial.substage;
        if rows.last_mut().filter(|row| is_same(row)).is_none() {
            let is_current = current.is_some_and(|at| at.stage == trial.stage && at.substage == trial.substage);
            rows.push(Row { stage: trial.stage, name: trial.substage.to_string(), done: 0, items: 0, is_current });
        }
        if let Some(row) = rows.last_mut() {
            row.items += 1;
            row.done += usize::from(session.is_done(item) || session.is_skipped(item));
        }
    }
    rows
}

/// Readings between the least and the most of each taxel so far.
fn taxels(senses: &Senses) -> Vec<(String, Vec<f64>)> {
    let Layout { taxels, .. } = senses.layout();
    let of = |source: usize| {
        let parts =
            senses.taxels(source).iter().zip(&senses.ever().taxels[source]).map(|(reading, spread)| {
                match spread.span() > 0.0 {
                    true => ((reading - spread.min) / spread.span()).clamp(0.0, 1.0),
                    false => 0.0,
                }
            });
        parts.collect()
    };
    taxels.iter().enumerate().map(|(source, (name, _))| (name.clone(), of(source))).collect()
}

/// The joints that regions need: where each is within what it has covered, in degrees.
fn joints(senses: &Senses) -> Vec<Bar> {
    let bar = |name: &String| {
        let spread = senses.ever().joints.get(name).copied().unwrap_or_default();
        let value = match senses.joint(name) {
            Some(angle) => format!(
                "{:4.0}\u{b0} ({:.0} to {:.0})",
                angle.to_degrees(),
                spread.min.to_degrees(),
                spread.max.to_degrees()
            ),
            None => "no messages".to_owned(),
        };
        let angle = senses.joint(name).unwrap_or(spread.min);
        let part = if spread.span() > 0.0 { (angle - spread.min) / spread.span() } else { 0.0 };
        Bar { name: name.clone(), part: part.clamp(0.0, 1.0), value }
    };
    senses.layout().joints.iter().map(bar).collect()
}

fn health(senses: &Senses, now: Stamp) -> Vec<Health> {
    const SILENT_S: f64 = 0.5;
    let of = |stream: Stream| Health {
        name: senses.layout().name(stream).to_owned(),
        rate_hz: senses.rate_hz(stream, now),
        is_silent: senses.age_s(stream, now).is_none_or(|age_s| age_s > SILENT_S),
    };
    senses.layout().streams().into_iter().map(of).collect()
}
