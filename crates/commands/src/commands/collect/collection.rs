//! A collection as it goes on, from the checks to its end.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use tactile_pose_fusion::collect::{Command, Happened, LedSession, Preflight, StageQuality, State, TouchGuide, done};
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::protocol::Annotation;
use tactile_pose_fusion::ros::system_now;
use tactile_pose_fusion::units::Stamp;

use super::super::{FLUSH_EVERY, Failure, Outcome, interrupt, say};
use super::Args;
use super::begun::Begun;
use super::desk::Desk;
use super::folder::About;
use super::screen::{Key, Screen};
use crate::report::collection::{Mood, View};

/// How often the screen is drawn, and time is looked at.
const FRAME: Duration = Duration::from_millis(40);

/// Most items whose faults are shown at once.
const MAX_NOTES: usize = 4;

/// How a collection ended for now.
pub(super) enum End {
    Complete,
    Quit,
    NotBegun(Vec<String>),
    /// None of the known touches was felt.
    Unfelt(String),
}

/// The phase of a collection.
enum Phase {
    Checking(Box<Preflight>),
    /// The checks found something.
    Found(Vec<String>),
    /// The load cell is pressed with known forces.
    Touching,
    /// The force sensor showed none of the presses.
    Unfelt(String),
    Going,
}

/// A collection that goes on: time, messages and keys in; prompts, annotations and a recording out.
pub(super) struct Collection {
    title: String,
    notes: BTreeMap<String, String>,
    begun: Begun,
    session: LedSession,
    quality: StageQuality,
    /// Annotations of items that an earlier run began and did not end.
    broken: Vec<Stamp>,
    /// Known touches, until they are over.
    touches: Option<TouchGuide>,
    accept_checks: bool,
    automatic: bool,
    /// A stage was ended, and what was flagged in it can be done again until the next one begins.
    stage_over: bool,
    messages: Vec<String>,
}

impl Collection {
    pub(super) fn new(args: &Args, begun: Begun) -> Self {
        let About { glove, user, donning, seed, .. } = &begun.about;
        let notes = [
            ("glove", glove.clone()),
            ("user", user.clone()),
            ("donning", donning.to_string()),
            ("protocol", begun.protocol.name.clone()),
            ("seed", seed.to_string()),
            ("tool_version", env!("CARGO_PKG_VERSION").to_owned()),
        ];
        let plan = begun.about.plan(&begun.protocol);
        let (done, broken) = done(&begun.annotations, &begun.protocol, &plan);
        Collection {
            title: begun.about.line(),
            notes: notes.into_iter().map(|(key, value)| (key.to_owned(), value)).collect(),
            session: LedSession::new(begun.protocol.clone(), plan, done),
            quality: StageQuality::new(&begun.protocol.levels),
            begun,
            broken,
            touches: None,
            accept_checks: args.accept_checks,
            automatic: args.plain,
            stage_over: false,
            messages: Vec::new(),
        }
    }

    pub(super) fn run(&mut self, desk: &mut Desk, screen: &mut Screen) -> Result<End, Failure> {
        self.automatic |= !screen.has_keys();
        let mut phase = Phase::Checking(Box::new(self.preflight(desk)));
        let mut flushed = Instant::now();
        loop {
            self.listen(desk)?;
            let now = system_now();
            phase = match phase {
                Phase::Checking(mut checks) => {
                    let all_heard = desk.senses.all_heard();
                    let more = checks.handle_time(now, all_heard, &mut || desk.senses.take_window(now));
                    while let Some(annotation) = checks.poll() {
                        desk.tell(annotation, now)?;
                    }
                    let problems: Vec<String> = checks.problems().iter().map(ToString::to_string).collect();
                    match more {
                        true => Phase::Checking(checks),
                        false if problems.is_empty() || self.accept_checks => {
                            self.messages = problems;
                            self.begin(desk, now)?
                        }
                        false if self.automatic => return Ok(End::NotBegun(problems)),
                        false => Phase::Found(problems),
                    }
                }
                other => other,
            };
            if matches!(phase, Phase::Touching) {
                phase = self.go_on_touching(desk, now)?;
            }
            phase = match phase {
                Phase::Unfelt(note) if self.accept_checks => {
                    self.note(note);
                    Phase::Going
                }
                Phase::Unfelt(note) if self.automatic => return Ok(End::Unfelt(note)),
                other => other,
            };
            if matches!(phase, Phase::Going) {
                self.session.handle_time(now);
                self.drain(desk, now)?;
                if self.automatic {
                    match self.session.state() {
                        State::Waiting => self.go(now),
                        State::Over => return Ok(End::Complete),
                        _ => {}
                    }
                }
                if flushed.elapsed() >= FLUSH_EVERY {
                    flushed = Instant::now();
                    desk.flush()?;
                }
            }
            screen.show(&self.view(&phase, desk, now))?;
            let key = if interrupt::happened() { Some(Key::Quit) } else { screen.key()? };
            let Some(key) = key else { continue };
            if key == Key::Quit {
                self.touches.iter_mut().for_each(|guide| guide.skip(now));
                self.go_on_touching(desk, now)?;
                self.session.handle_command(Command::Pause, now);
                self.drain(desk, now)?;
                return Ok(match phase {
                    Phase::Touching | Phase::Unfelt(_) | Phase::Going => End::Quit,
                    Phase::Checking(_) => End::NotBegun(vec!["the checks were not ended".to_owned()]),
                    Phase::Found(problems) => End::NotBegun(problems),
                });
            }
            phase = match (phase, key) {
                (Phase::Found(_), Key::Go | Key::Repeat) => Phase::Checking(Box::new(self.preflight(desk))),
                (Phase::Found(problems), Key::Anyway) => {
                    self.messages = problems;
                    self.begin(desk, now)?
                }
                (Phase::Touching, Key::Skip) => {
                    self.touches.iter_mut().for_each(|guide| guide.skip(now));
                    self.go_on_touching(desk, now)?
                }
                (Phase::Unfelt(_), Key::Go | Key::Repeat) => {
                    self.touches = self.guide(desk);
                    Phase::Touching
                }
                (Phase::Unfelt(note), Key::Anyway) => {
                    self.note(note);
                    Phase::Going
                }
                (Phase::Going, Key::Go) if *self.session.state() == State::Over => return Ok(End::Complete),
                (Phase::Going, key) => {
                    self.handle_key(key, now);
                    Phase::Going
                }
                (other, _) => other,
            };
        }
    }

    fn preflight(&self, desk: &Desk) -> Preflight {
        Preflight::new(self.session.protocol(), desk.senses.layout())
    }

    /// The checks are over: from here on it is recorded.
    fn begin(&mut self, desk: &mut Desk, now: Stamp) -> Result<Phase, Failure> {
        desk.record(self.begun.begin_part()?, &self.notes)?;
        for stamp in self.broken.drain(..) {
            desk.tell(Annotation::outside(stamp), now)?;
        }
        self.touches = self.guide(desk);
        Ok(if self.touches.is_some() { Phase::Touching } else { Phase::Going })
    }

    /// What leads through the known touches, if they are still to be done.
    fn guide(&self, desk: &Desk) -> Option<TouchGuide> {
        let n_sensors = desk.senses.layout().force.len();
        let protocol = self.session.protocol();
        let asked = protocol.known_touches.as_ref();
        let asked = asked.filter(|asked| n_sensors > 0 && !TouchGuide::were_done(asked, &self.begun.annotations))?;
        Some(TouchGuide::new(asked, protocol.let_go_s + protocol.lead_s, n_sensors))
    }

    /// Goes on with the known touches; once they are over, with the session.
    fn go_on_touching(&mut self, desk: &mut Desk, now: Stamp) -> Result<Phase, Failure> {
        let Some(guide) = &mut self.touches else { return Ok(Phase::Going) };
        let is_more = guide.handle_time(now);
        while let Some(annotation) = guide.poll() {
            desk.tell(annotation, now)?;
        }
        if is_more {
            return Ok(Phase::Touching);
        }
        let (held, asked) = guide.progress();
        let (is_enough, is_unfelt) = (guide.is_enough(), guide.is_unfelt());
        self.touches = None;
        desk.flush()?;
        if is_unfelt {
            return Ok(Phase::Unfelt(format!(
                "none of {asked} known touches was felt: if you pressed, look at the field, sign and unit of the force sensor in the parameters"
            )));
        }
        self.note(match is_enough {
            true => {
                format!(
                    "{held} known touches: tpf calibrate --touches corrects the forces of this donning by them, and by all other touches that are held in the session"
                )
            }
            false => format!(
                "{held} of {asked} known touches were held; at least three are needed to correct the forces of this donning"
            ),
        });
        Ok(Phase::Going)
    }

    fn note(&mut self, note: String) {
        if self.automatic {
            say(&note);
        }
        self.messages.push(note);
    }

    fn handle_key(&mut self, key: Key, now: Stamp) {
        let waiting = matches!(self.session.state(), State::Waiting);
        match key {
            Key::Go if waiting => self.go(now),
            Key::Go => self.session.handle_command(Command::Pause, now),
            Key::Repeat => self.session.handle_command(Command::Repeat, now),
            Key::Skip => self.session.handle_command(Command::Skip, now),
            Key::Again if waiting || *self.session.state() == State::Over => {
                self.session.handle_redo(&self.quality.flagged(), now);
                self.messages.clear();
            }
            Key::Again | Key::Anyway | Key::Quit => {}
        }
    }

    fn go(&mut self, now: Stamp) {
        self.messages.clear(); // they are of what was before
        if std::mem::take(&mut self.stage_over) {
            self.quality = StageQuality::new(&self.session.protocol().levels);
        }
        self.session.handle_command(Command::Go, now);
    }

    fn listen(&mut self, desk: &mut Desk) -> Result<(), Failure> {
        let (session, quality, touches) = (&self.session, &mut self.quality, &mut self.touches);
        desk.listen(FRAME, &mut |sensor, force, received| {
            if let Some(guide) = touches {
                guide.handle_force(sensor, force, received);
            } else if sensor == 0
                && let State::Doing { item, step, .. } = *session.state()
            {
                quality.handle_force(force, session.step(item, step).zero_load);
            }
        })
    }

    fn drain(&mut self, desk: &mut Desk, now: Stamp) -> Result<(), Failure> {
        while let Some(happened) = self.session.poll() {
            match happened {
                Happened::Marked(annotation) => desk.tell(annotation, now)?,
                Happened::Began(item) => self.quality.handle_begin(item),
                Happened::Undid(item) => self.quality.handle_undo(item),
                Happened::Did(item) => {
                    let trial = self.session.plan().trials()[item].clone();
                    let has_force = !desk.senses.layout().force.is_empty();
                    let problems = self.quality.handle_end(&trial).map(|quality| quality.problems.clone());
                    if let Some(problem) = problems.unwrap_or_default().first().filter(|_| has_force) {
                        self.messages = vec![format!("{}: {problem} (r repeats it)", trial.substage)];
                        if self.automatic {
                            say(&format!("{}: {problem}", trial.substage));
                        }
                    }
                }
                Happened::StageOver(stage) => {
                    desk.flush()?;
                    self.messages = self.stage_notes(stage);
                    if self.automatic {
                        self.messages.iter().for_each(|message| say(message));
                    }
                    self.stage_over = true;
                }
                Happened::Over => {}
            }
        }
        Ok(())
    }

    /// How a stage went.
    fn stage_notes(&self, stage: u8) -> Vec<String> {
        let trials = self.session.plan().trials();
        let of_stage = || (0..trials.len()).filter(|item| trials[*item].stage == stage);
        let done = of_stage().filter(|item| self.session.is_done(*item)).count();
        let skipped = of_stage().filter(|item| self.session.is_skipped(*item)).count();
        let flagged: Vec<usize> = self.quality.flagged();
        let mut notes =
            vec![format!("stage {stage}: {done} items done, {skipped} skipped, {} of them flagged", flagged.len())];
        let mut by_problem: BTreeMap<String, usize> = BTreeMap::new();
        for item in &flagged {
            let problem = self.quality.items()[item].problems.first().cloned().unwrap_or_default();
            *by_problem.entry(format!("{}: {problem}", trials[*item].substage)).or_default() += 1;
        }
        let shown = by_problem.iter().take(MAX_NOTES).map(|(problem, n)| format!("  {n} x {problem}"));
        notes.extend(shown);
        let n_left: usize = by_problem.values().skip(MAX_NOTES).sum();
        if n_left > 0 {
            notes.push(format!("  and {n_left} more"));
        }
        if !flagged.is_empty() && !self.automatic {
            notes.push("f does the flagged ones again, space goes on".to_owned());
        }
        notes
    }

    /// Makes the bag of what was recorded.
    pub(super) fn complete(&self, cfg: &Config) -> Result<Outcome, Failure> {
        self.begun.complete(cfg)
    }

    /// How long what is left takes, s.
    pub(super) fn left_s(&self) -> f64 {
        self.session.left_s()
    }

    fn view(&self, phase: &Phase, desk: &Desk, now: Stamp) -> View {
        let mut view = View::new(&self.title, &self.session, &desk.senses, self.quality.zero(), now);
        view.synthetic = desk.synthetic;
        view.notes.clone_from(&self.messages);
        match phase {
            Phase::Checking(checks) => view.of_checks(checks, now),
            Phase::Touching => match &self.touches {
                Some(guide) => view.of_known_touches(guide, now),
                None => view,
            },
            Phase::Going => view.of_session(&self.session, now),
            Phase::Unfelt(note) => {
                view.mood = Mood::Wrong;
                view.place = "known touches".to_owned();
                view.prompt = "No known touch was felt".to_owned();
                view.notes = vec![note.clone()];
                view.keys = "r press again   c go on without them   q quit";
                view
            }
            Phase::Found(problems) => {
                view.mood = Mood::Wrong;
                view.place = "checks".to_owned();
                view.prompt = match problems.len() {
                    1 => "A check failed".to_owned(),
                    n => format!("{n} checks failed"),
                };
                view.notes.clone_from(problems);
                view.keys = "r check again   c begin anyway   q quit";
                view
            }
        }
    }
}
