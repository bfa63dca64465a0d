//! `tpf simulate`: sessions of a synthetic glove, one bag each, by the paper's protocol; or a synthetic glove that is there.

#[cfg(feature = "ros")]
mod live;

use std::path::{Path, PathBuf};

use super::progress::Progress;
use super::{Failure, Outcome, counted, interrupt, print, say};
use crate::bag::{BagMetadata, BagWriter, OutChannel, WriteOptions};
use crate::msg::{
    Duration, Header, JointState, Stage, TaxelArray, Vector3, WireType, Wrench, WrenchStamped, to_cdr_into,
};
use crate::recording::SESSION_NOTES;
use crate::sim::{Activity, FULL_MINUTES, Record, SessionSpec, Tracking, simulate};
use crate::units::Stamp;

const TAXELS: &str = "/glove/taxels";
const JOINTS: &str = "/hand/joint_states";
const TRUTH: &str = "/load_cell/wrench";
const STAGE: &str = "/stage";

/// Writes sessions of a synthetic glove: taxels, joint angles, force truth and stage annotations.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Which synthetic glove: 1 capacitive, 2 dull to touch, 3 sensitive with strong artifacts
    #[arg(long, value_name = "1|2|3")]
    glove: u8,
    /// Users, from 1
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    users: u32,
    /// Sessions of each user, the glove remounted in between
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1000))]
    sessions: u32,
    /// The same seed gives the same bytes; another one has other users
    #[arg(long, value_name = "S")]
    seed: u64,
    /// What is done: protocol (the paper's), or manipulation (free: light touches held for a minute, grasps without air,
    /// slow ramps, slips, now and then a start in contact; 10 to 120 minutes)
    #[arg(long, value_name = "WHAT", default_value = "protocol", value_parser = activity)]
    activity: Activity,
    /// How joint angles are measured: markers (100 Hz, as the paper), or camera (30 Hz, late, noisy, off by 10 degrees)
    #[arg(long, value_name = "HOW", default_value = "markers", value_parser = tracking)]
    tracking: Tracking,
    /// Length of a session, 27.7 if not given; less than the whole protocol has fewer repetitions, never fewer substages.
    /// With --live: end after so long
    #[arg(long, value_name = "M")]
    minutes: Option<f64>,
    /// Folder for the bags, made if it isn't there
    #[cfg_attr(feature = "ros", arg(short, long, value_name = "DIR", required_unless_present = "live"))]
    #[cfg_attr(not(feature = "ros"), arg(short, long, value_name = "DIR", required = true))]
    output: Option<PathBuf>,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    live: live::LiveArgs,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    #[cfg(feature = "ros")]
    if args.live.is_asked_for() {
        return live::run(args);
    }
    let Some(output) = &args.output else { return Err(Failure("--output is missing".to_owned())) };
    let specs = (1..=args.users).flat_map(|user| (1..=args.sessions).map(move |session| (user, session)));
    let specs: Vec<SessionSpec> = specs
        .map(|(user, session)| SessionSpec {
            glove: args.glove,
            user,
            session,
            seed: args.seed,
            minutes: args.minutes.unwrap_or(FULL_MINUTES),
            activity: args.activity,
            tracking: args.tracking,
        })
        .collect();
    if let Some(spec) = specs.first() {
        simulate(spec)?; // what is wrong with one is wrong with all, and is told before a folder is made
    }
    std::fs::create_dir_all(output)
        .map_err(|error| Failure(format!("{}: cannot make the folder: {error}", output.display())))?;
    say("the data is synthetic: a physical model of a glove on a hand, no recording");
    let mut text = String::new();
    for spec in &specs {
        let name = format!("glove{}_user{:02}_session{}", spec.glove, spec.user, spec.session);
        let path = output.join(name);
        let n_messages = write(spec, &path, false)?;
        text += &format!("{}: {} (synthetic)\n", path.display(), counted(n_messages, "message"));
    }
    print(&text)?;
    Ok(Outcome::Done)
}

fn activity(text: &str) -> Result<Activity, String> {
    let known = [Activity::Protocol, Activity::Manipulation];
    let found = known.into_iter().find(|activity| activity.name() == text);
    found.ok_or_else(|| format!("expected protocol or manipulation, got {text:?}"))
}

fn tracking(text: &str) -> Result<Tracking, String> {
    let known = [Tracking::Markers, Tracking::Camera];
    let found = known.into_iter().find(|tracking| tracking.name() == text);
    found.ok_or_else(|| format!("expected markers or camera, got {text:?}"))
}

/// Writes one session; the number of its messages.
pub(super) fn write(spec: &SessionSpec, path: &Path, overwrite: bool) -> Result<u64, Failure> {
    let session = simulate(spec)?;
    let mut progress = Progress::steps("simulate", session.n_frames());
    let mut bag = BagWriter::create(path, WriteOptions { overwrite, ..WriteOptions::default() })?;
    bag.copy_metadata(&BagMetadata { name: SESSION_NOTES, metadata: &session.metadata() })?;
    let mut topics = Topics {
        taxels: bag.add_topic::<TaxelArray>(TAXELS)?,
        joints: bag.add_topic::<JointState>(JOINTS)?,
        truth: bag.add_topic::<WrenchStamped>(TRUTH)?,
        stage: bag.add_topic::<Stage>(STAGE)?,
        bag,
        cdr: Vec::new(),
    };
    let mut n_frames = 0;
    for record in session {
        interrupt::check()?;
        n_frames += u64::from(matches!(record, Record::Truth { .. }));
        progress.set(n_frames);
        topics.write(record)?;
    }
    Ok(topics.bag.finish()?.n_messages)
}

struct Topics {
    taxels: OutChannel,
    joints: OutChannel,
    truth: OutChannel,
    stage: OutChannel,
    bag: BagWriter,
    cdr: Vec<u8>,
}

impl Topics {
    fn write(&mut self, record: Record) -> Result<(), Failure> {
        let received = record.received();
        match message(&record) {
            Message::Taxels(message) => self.send(self.taxels, received, &message),
            Message::Joints(message) => self.send(self.joints, received, &message),
            Message::Truth(message) => self.send(self.truth, received, &message),
            Message::Stage(message) => self.send(self.stage, received, &message),
        }
    }

    fn send<T: WireType>(&mut self, channel: OutChannel, received: Stamp, message: &T) -> Result<(), Failure> {
        to_cdr_into(message, &mut self.cdr);
        Ok(self.bag.write(channel, 0, received, received, &self.cdr)?)
    }
}

/// A record as it is sent.
enum Message {
    Taxels(TaxelArray),
    Joints(JointState),
    Truth(WrenchStamped),
    Stage(Stage),
}

fn message(record: &Record) -> Message {
    let header = |frame_id: &str| Header { stamp: record.stamp().into(), frame_id: frame_id.to_owned() };
    let vector = |[x, y, z]: [f64; 3]| Vector3 { x, y, z };
    match record {
        Record::Taxels { sequence, values, .. } => {
            let (rows, row_period, values) = (1, Duration::default(), values.clone());
            Message::Taxels(TaxelArray { header: header("index_tip"), sequence: *sequence, rows, row_period, values })
        }
        Record::Joints { names, positions, .. } => {
            let (velocity, effort) = (Vec::new(), Vec::new());
            let (name, position) = (names.to_vec(), positions.clone());
            Message::Joints(JointState { header: header(""), name, position, velocity, effort })
        }
        Record::Truth { force, torque, .. } => {
            let wrench = Wrench { force: vector(*force), torque: vector(*torque) };
            Message::Truth(WrenchStamped { header: header("load_cell"), wrench })
        }
        Record::Stage { stage, substage, pose, repetition, zero_load, .. } => {
            let (stage, repetition, zero_load) = (*stage, *repetition, *zero_load);
            let (substage, pose) = (substage.to_string(), pose.to_string());
            Message::Stage(Stage { header: header(""), stage, substage, pose, repetition, zero_load })
        }
    }
}
