//! `tpf simulate`: sessions of a synthetic glove, one bag each, by the paper's protocol; or a synthetic glove that is there.

mod conditions;
#[cfg(feature = "ros")]
mod live;

use std::path::PathBuf;

use tactile_pose_fusion::files;
use tactile_pose_fusion::hand::NamedLayout;
use tactile_pose_fusion::sim::{Activity, FULL_MINUTES, SessionSpec, Tracking, simulate};
use tactile_pose_fusion::synthetic::{self, HandForm};

use super::{Failure, Outcome, counted, interrupt, print, tell};
use crate::report::progress::Shown;
use conditions::{ConditionArgs, GloveArg};

/// Writes sessions of a synthetic glove: taxels, joint angles, force truth and stage annotations.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Which synthetic glove: 1 capacitive, 2 dull to touch, 3 sensitive with strong artifacts, each with taxels on the index
    /// fingertip; hand1, hand2, hand3: the same with taxels on all five
    #[arg(long, value_name = "GLOVE", value_parser = conditions::glove)]
    glove: GloveArg,
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
    /// slow ramps, slips, now and then a start in contact; 10 to 120 minutes, from 2 minutes on where --episodes has no grasp)
    #[arg(long, value_name = "WHAT", default_value = "protocol", value_parser = activity)]
    activity: Activity,
    /// How joint angles are measured: markers (100 Hz, as the paper), or camera (30 Hz, late, noisy, off by 10 degrees)
    #[arg(long, value_name = "HOW", default_value = "markers", value_parser = tracking)]
    tracking: Tracking,
    /// Form of the hand's messages. angles: sensor_msgs/JointState on /hand/joint_states. openxr (26 points), openxr25
    /// (without the palm), mano21 (21): geometry_msgs/PoseArray on /hand/poses. keypoints26, keypoints21: the positions of these points
    /// in a std_msgs/Float64MultiArray on /hand/keypoints. named: HandJointPoses of IsaacTeleop on /hand/named_poses. manus:
    /// ManusGlove on /manus_glove_0. transforms: /tf, a frame for each point of openxr25
    #[arg(long, value_name = "FORM", default_value = "angles", value_parser = hand_form)]
    hand: HandForm,
    /// Length of a session, 27.7 if not given; less than the whole protocol has fewer repetitions, never fewer substages.
    /// With --live: end after so long
    #[arg(long, value_name = "M")]
    minutes: Option<f64>,
    /// Folder for the bags, made if it isn't there
    #[cfg_attr(feature = "ros", arg(short, long, value_name = "DIR", required_unless_present = "live"))]
    #[cfg_attr(not(feature = "ros"), arg(short, long, value_name = "DIR", required = true))]
    output: Option<PathBuf>,
    #[command(flatten)]
    conditions: ConditionArgs,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    live: live::LiveArgs,
}

impl Args {
    /// A session of a user, as the options say.
    fn spec(&self, user: u32, session: u32, minutes: Option<f64>) -> SessionSpec {
        SessionSpec {
            glove: self.glove.number,
            user,
            session,
            seed: self.seed,
            minutes: minutes.unwrap_or(FULL_MINUTES),
            activity: self.activity,
            tracking: self.tracking,
            conditions: self.conditions.of_session(self.glove, self.activity, session),
        }
    }
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    #[cfg(feature = "ros")]
    if args.live.is_asked_for() {
        return live::run(args);
    }
    let Some(output) = &args.output else { return Err(Failure("--output is missing".to_owned())) };
    let specs = (1..=args.users).flat_map(|user| (1..=args.sessions).map(move |session| (user, session)));
    let specs: Vec<SessionSpec> = specs.map(|(user, session)| args.spec(user, session, args.minutes)).collect();
    if let Some(spec) = specs.first() {
        simulate(spec)?; // what is wrong with one is wrong with all, and is told before a folder is made
    }
    files::make_folder(output)
        .map_err(|error| Failure(format!("{}: cannot make the folder: {error}", output.display())))?;
    tell("the data is synthetic: a physical model of a glove on a hand, no recording");
    let mut text = String::new();
    for spec in &specs {
        let name = format!("{}_user{:02}_session{}", args.glove, spec.user, spec.session);
        let path = output.join(name);
        let n_messages = synthetic::write_as(spec, args.hand, &path, false, &Shown::steps("simulate"))?;
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

fn hand_form(text: &str) -> Result<HandForm, String> {
    match text {
        "angles" => Ok(HandForm::Angles),
        "openxr" => Ok(HandForm::Poses(NamedLayout::OpenXr)),
        "openxr25" => Ok(HandForm::Poses(NamedLayout::OpenXr25)),
        "mano21" => Ok(HandForm::Poses(NamedLayout::Mano21)),
        "keypoints21" => Ok(HandForm::Keypoints(NamedLayout::Mano21)),
        "keypoints26" => Ok(HandForm::Keypoints(NamedLayout::OpenXr)),
        "named" => Ok(HandForm::Named),
        "manus" => Ok(HandForm::Manus),
        "transforms" => Ok(HandForm::Transforms),
        other => Err(format!(
            "expected angles, openxr, openxr25, mano21, keypoints21, keypoints26, named, manus or transforms, got {other:?}"
        )),
    }
}
