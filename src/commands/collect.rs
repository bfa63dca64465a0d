//! `tpf collect`: leads a person through the collection protocol, and records it.

mod desk;
mod folder;
mod screen;
mod view;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use super::live::{LiveParams, RosArguments, now};
use super::{Failure, Outcome, interrupt, print, say};
use crate::collect::{Command, Happened, Preflight, Session, StageQuality, State};
use crate::config::Config;
use crate::protocol::Protocol;
use crate::units::{Newton, Stamp};
use desk::Desk;
use folder::{About, Folder};
use screen::{Key, Screen};
use view::{Mood, View, clock};

/// The node that collects, unless it is given another name.
const NODE: &str = "/tpf_collect";

/// Length of the protocol that --short stands for, minutes.
const SHORT_MINUTES: f64 = 10.0;

/// How often the screen is drawn, and time is looked at.
const FRAME: Duration = Duration::from_millis(40);

/// How much of a recording may be lost when the process is killed.
const FLUSH_EVERY: Duration = Duration::from_secs(1);

/// Most items whose faults are shown at once.
const MAX_NOTES: usize = 4;

/// Leads a person with a glove through the collection protocol and records taxels, joint angles, force and annotations.
#[derive(Debug, clap::Args)]
#[command(after_help = "tpf collect --params-file glove.yaml -o anna_1 --user anna --donning 1\n\
                        tpf collect --params-file glove.yaml -o anna_1 --user anna --resume")]
pub(super) struct Args {
    #[command(flatten)]
    params: LiveParams,
    /// Folder for this session; DIR.mcap is in it when everything was done
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// A protocol of your own; the paper's is built in (params/protocol.yaml)
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    protocol: Option<PathBuf>,
    /// The same protocol in ten minutes: fewer repetitions
    #[arg(long, conflicts_with_all = ["minutes", "resume"])]
    short: bool,
    /// The same protocol in about so many minutes
    #[arg(long, value_name = "M", conflicts_with = "resume", value_parser = minutes)]
    minutes: Option<f64>,
    /// Who wears the glove, instead of `user` in the parameters
    #[arg(long, value_name = "NAME")]
    user: Option<String>,
    /// Which donning of the glove by this user
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "resume")]
    donning: u32,
    /// Orders poses: the same seed, user and donning, the same order
    #[arg(long, value_name = "S", default_value_t = 1, conflicts_with = "resume")]
    seed: u64,
    /// Go on with a session that was broken off
    #[arg(long)]
    resume: bool,
    /// With --resume: make the bag of what has been recorded, without doing the rest
    #[arg(long, requires = "resume")]
    finish: bool,
    /// Prompts as lines instead of a screen, without waiting between stages; what the checks find ends it
    #[arg(long)]
    plain: bool,
    /// Begin in spite of what the checks find
    #[arg(long)]
    accept_checks: bool,
    #[command(flatten)]
    ros: RosArguments,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let (mut cfg, _) = args.params.load()?;
    if let Some(user) = &args.user {
        cfg.user = Some(user.clone());
    }
    if cfg.use_sim_time {
        return Err(Failure(
            "use_sim_time is true, and a collection goes by the clock of the room; set it to false".to_owned(),
        ));
    }
    let place = args.ros.place(NODE)?;
    let begun = match args.resume {
        true => Begun::again(args, &cfg)?,
        false => Begun::anew(args, &cfg)?,
    };
    if args.finish {
        return begun.complete(&cfg);
    }
    interrupt::listen();
    let mut desk = Desk::open(&cfg, &place)?;
    let mut screen = Screen::open(args.plain)?;
    let mut collection = Collection::new(args, &cfg, begun);
    let ended = collection.run(&mut desk, &mut screen);
    screen.close();
    let unreadable = std::mem::take(&mut desk.unreadable);
    desk.close()?;
    for (topic, (n, first)) in &unreadable {
        say(&format!("topic {topic}: {n} messages could not be read: {first}"));
    }
    let end = ended?;
    let Some(begun) = collection.begun.take() else { return Ok(Outcome::Done) };
    match end {
        End::Complete => {
            begun.complete(&cfg)?;
            Ok(if unreadable.is_empty() { Outcome::Done } else { Outcome::InputLost })
        }
        End::Quit => {
            let left = clock(collection.session.left_s());
            print(&format!("{}: {left} are left; go on with --resume\n", args.output.display()))?;
            Ok(Outcome::NotMet)
        }
        End::NotBegun(problems) => {
            problems.iter().for_each(|problem| say(problem));
            let failed = if problems.len() == 1 {
                "a check failed".to_owned()
            } else {
                format!("{} checks failed", problems.len())
            };
            Err(Failure(format!("{failed} and nothing was recorded; --accept-checks begins all the same")))
        }
    }
}

/// A collection before it is gone on with: on the disk, or not yet.
struct Begun {
    about: About,
    protocol: Protocol,
    protocol_text: String,
    output: PathBuf,
    folder: Option<Folder>,
    parts: Vec<PathBuf>,
}

/// How a collection ended for now.
enum End {
    Complete,
    Quit,
    NotBegun(Vec<String>),
}

impl Begun {
    fn anew(args: &Args, cfg: &Config) -> Result<Self, Failure> {
        if args.output.exists() {
            // Refused by the folder with the reason, before anyone puts on a glove.
            let protocol = Protocol::paper();
            let about = About::new(&protocol, None, 0, cfg, 0);
            Folder::create(&args.output, about, "", protocol)?;
        }
        let (protocol, protocol_text) = match &args.protocol {
            Some(path) => {
                let text = std::fs::read_to_string(path).unwrap_or_default(); // read once more, with its errors
                (Protocol::load(path)?, text)
            }
            None => (Protocol::paper(), Protocol::PAPER.to_owned()),
        };
        let minutes = args.minutes.or(args.short.then_some(SHORT_MINUTES));
        let about = About::new(&protocol, minutes, args.seed, cfg, args.donning);
        let output = args.output.clone();
        Ok(Begun { about, protocol, protocol_text, output, folder: None, parts: Vec::new() })
    }

    fn again(args: &Args, cfg: &Config) -> Result<Self, Failure> {
        let folder = Folder::open(&args.output)?;
        folder.check_same(cfg)?;
        let parts = folder.parts()?;
        let (about, protocol) = (folder.about.clone(), folder.protocol.clone());
        Ok(Begun {
            about,
            protocol,
            protocol_text: String::new(),
            output: args.output.clone(),
            folder: Some(folder),
            parts,
        })
    }

    /// The folder, which is made when something is to be put into it.
    fn folder(&mut self) -> Result<&Folder, Failure> {
        let folder = match self.folder.take() {
            Some(folder) => folder,
            None => Folder::create(&self.output, self.about.clone(), &self.protocol_text, self.protocol.clone())?,
        };
        Ok(self.folder.insert(folder))
    }

    fn complete(mut self, cfg: &Config) -> Result<Outcome, Failure> {
        let folder = self.folder()?;
        let parts = folder.parts()?;
        if parts.is_empty() {
            return Err(Failure(format!("{}: nothing has been recorded yet", self.output.display())));
        }
        let finished = folder.complete(&parts, &cfg.stage_topic)?;
        finished.notes.iter().for_each(|note| say(note));
        print(&format!("{}: {} messages\n", finished.path.display(), finished.n_messages))?;
        Ok(Outcome::Done)
    }
}

/// What goes on.
enum Phase {
    Checking(Box<Preflight>),
    /// The checks found something.
    Found(Vec<String>),
    Going,
}

struct Collection {
    title: String,
    notes: BTreeMap<String, String>,
    begun: Option<Begun>,
    session: Session,
    quality: StageQuality,
    /// Annotations of items that an earlier run began and did not end.
    broken: Vec<Stamp>,
    accept_checks: bool,
    automatic: bool,
    /// A stage was ended, and what was flagged in it can be done again until the next one begins.
    stage_over: bool,
    messages: Vec<String>,
}

impl Collection {
    fn new(args: &Args, cfg: &Config, begun: Begun) -> Self {
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
        let marks = match &begun.folder {
            Some(folder) => folder.marks(&begun.parts, &cfg.stage_topic).unwrap_or_else(|error| {
                say(&error.to_string());
                Default::default()
            }),
            None => Default::default(),
        };
        let (done, broken) = marks.done(&begun.protocol, &plan);
        Collection {
            title: begun.about.line(),
            notes: notes.into_iter().map(|(key, value)| (key.to_owned(), value)).collect(),
            session: Session::new(begun.protocol.clone(), plan, done),
            quality: StageQuality::new(&begun.protocol.levels),
            begun: Some(begun),
            broken,
            accept_checks: args.accept_checks,
            automatic: args.plain,
            stage_over: false,
            messages: Vec::new(),
        }
    }

    fn run(&mut self, desk: &mut Desk, screen: &mut Screen) -> Result<End, Failure> {
        self.automatic |= !screen.has_keys();
        let mut phase = Phase::Checking(Box::new(self.preflight(desk)));
        let mut flushed = Instant::now();
        loop {
            self.listen(desk)?;
            let now = now();
            phase = match phase {
                Phase::Checking(mut checks) => {
                    let all_heard = desk.senses.all_heard();
                    let more = checks.handle_time(now, all_heard, &mut || desk.senses.take_window(now));
                    while let Some(mark) = checks.poll() {
                        desk.tell(&mark, now)?;
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
                self.session.handle_command(Command::Pause, now);
                self.drain(desk, now)?;
                return Ok(match phase {
                    Phase::Going => End::Quit,
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
        if let Some(begun) = &mut self.begun {
            let parts = begun.parts.clone();
            let bag = begun.folder()?.begin_part(&parts)?;
            desk.record(bag, &self.notes)?;
        }
        for stamp in self.broken.drain(..) {
            desk.tell(&crate::collect::Mark::outside(stamp), now)?;
        }
        Ok(Phase::Going)
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
        if std::mem::take(&mut self.stage_over) {
            self.quality = StageQuality::new(&self.session.protocol().levels);
            self.messages.clear();
        }
        self.session.handle_command(Command::Go, now);
    }

    fn listen(&mut self, desk: &mut Desk) -> Result<(), Failure> {
        let (session, quality) = (&self.session, &mut self.quality);
        desk.listen(FRAME, &mut |sensor, _, force: Newton| {
            if sensor == 0
                && let State::Doing { item, step, .. } = *session.state()
            {
                quality.handle_force(force, session.step(item, step).zero_load);
            }
        })
    }

    fn drain(&mut self, desk: &mut Desk, now: Stamp) -> Result<(), Failure> {
        while let Some(happened) = self.session.poll() {
            match happened {
                Happened::Marked(mark) => desk.tell(&mark, now)?,
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
        if !flagged.is_empty() && !self.automatic {
            notes.push("f does the flagged ones again, space goes on".to_owned());
        }
        notes
    }

    fn view(&self, phase: &Phase, desk: &Desk, now: Stamp) -> View {
        let mut view = View::new(&self.title, &self.session, &desk.senses, self.quality.zero(), now);
        view.synthetic = desk.synthetic;
        view.notes.clone_from(&self.messages);
        match phase {
            Phase::Checking(checks) => view.of_checks(checks, now),
            Phase::Going => view.of_session(&self.session, now),
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

fn minutes(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(minutes) if (0.05..=600.0).contains(&minutes) => Ok(minutes),
        _ => Err(format!("expected 0.05 to 600 minutes, got {text:?}")),
    }
}
