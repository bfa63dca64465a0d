//! A synthetic glove on a synthetic hand over a synthetic load cell that publish as drivers do, and a user who reads the
//! prompts of `tpf collect`.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use tactile_pose_fusion::leave;
use tactile_pose_fusion::msg::{Stage, TFMessage, TaxelArray, Text, WireType, WrenchStamped, from_cdr};
use tactile_pose_fusion::ros::{Delivery, Listener, TopicType, system_now};
use tactile_pose_fusion::sim::hand::Finger;
use tactile_pose_fusion::sim::{Activity, Fault, Fingers, LiveSession, Prompt, SYNTHETIC_TOPIC};
use tactile_pose_fusion::synthetic::{
    HandForm, Message, STAGE, STATIC_FRAMES, TAXELS, message, static_frames, truth_topic,
};

use super::super::live::RosArguments;
use super::super::{Failure, Outcome, interrupt, print, protocol, say, tell};

/// The node that the synthetic glove is, unless it is given another name.
const NODE: &str = "/synthetic_glove";

/// Between looking for what is due: a tenth of a sample.
const NAP: Duration = Duration::from_millis(1);

/// A message that is due for longer is not sent, s: somewhat more than what a busy machine takes.
const LATE_S: f64 = 0.2;

/// How often it says that it is synthetic.
const SAY_EVERY: Duration = Duration::from_secs(1);

/// What only a glove that is there has.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Live")]
pub(super) struct LiveArgs {
    /// Publish a synthetic glove, hand and load cell until interrupted or for --minutes, with a user who does what `tpf collect`
    /// asks for
    #[arg(long, conflicts_with = "output")]
    live: bool,
    /// With --live: which user
    #[arg(long, value_name = "N", default_value_t = 1, requires = "live")]
    user: u32,
    /// With --live: which donning
    #[arg(long, value_name = "N", default_value_t = 1, requires = "live")]
    donning: u32,
    /// With --live: the protocol that the user knows, if it is not the paper's
    #[arg(long, value_name = "FILE", requires = "live")]
    protocol: Option<PathBuf>,
    /// With --live: a user who goes through the protocol, in --minutes, without looking at any prompt
    #[arg(long, requires = "live")]
    ignore_prompts: bool,
    /// With --live: something that is wrong: dead-taxel, swapped-joints, untared-load-cell
    #[arg(long, value_name = "FAULT", requires = "live", value_parser = fault)]
    fault: Vec<Fault>,
    #[command(flatten)]
    ros: RosArguments,
}

impl LiveArgs {
    pub(super) fn is_asked_for(&self) -> bool {
        self.live
    }
}

pub(super) fn run(args: &super::Args) -> Result<Outcome, Failure> {
    let live = &args.live;
    let protocol = protocol(live.protocol.as_deref())?;
    let place = live.ros.place(NODE)?;
    let (start, started) = (system_now(), Instant::now());
    let follows = !live.ignore_prompts && args.activity == Activity::Protocol;
    // Who follows prompts takes as long as they take.
    let spec = args.spec(live.user, live.donning, args.minutes.filter(|_| !follows));
    let mut session = LiveSession::new(&spec, protocol, start, follows, &live.fault)?;
    if let Some(minutes) = args.minutes {
        if !(0.01..=1e6).contains(&minutes) {
            return Err(Failure(format!("--minutes: expected 0.01 to 1000000, got {minutes}")));
        }
        leave::after(Duration::from_secs_f64(60.0 * minutes))?;
    }
    let mut listening = place.join()?;
    let known = TopicType::Known;
    // In its namespace, so that two gloves can be told apart; the load cell is the room's.
    let of_glove = |topic: &str| place.topic(topic.trim_start_matches('/'));
    let taxels = listening.add_publisher(&of_glove(TAXELS)?, known(TaxelArray::TYPE_NAME), Delivery::Data)?;
    let tree = args.hand.type_tree();
    // Listeners of tf ask for reliable frames.
    let delivery = if args.hand == HandForm::Transforms { Delivery::Reliable } else { Delivery::Data };
    let joints = listening.add_publisher(&of_glove(args.hand.topic())?, TopicType::Defined(&tree), delivery)?;
    let under = match spec.conditions.fingers {
        Fingers::Index => vec![None],
        Fingers::All => Finger::ALL.into_iter().map(Some).collect(),
    };
    let mut truth = BTreeMap::new();
    for finger in under {
        let topic = truth_topic(finger);
        truth.insert(finger, listening.add_publisher(&topic, known(WrenchStamped::TYPE_NAME), Delivery::Data)?);
    }
    let says = listening.add_publisher(SYNTHETIC_TOPIC, known(Text::TYPE_NAME), Delivery::Reliable)?;
    listening.subscribe(STAGE, known(Stage::TYPE_NAME), Delivery::Latched)?;
    let frames = match args.hand {
        HandForm::Transforms => {
            Some(listening.add_publisher(&of_glove(STATIC_FRAMES)?, known(TFMessage::TYPE_NAME), Delivery::Latched)?)
        }
        _ => None,
    };
    let listener = listening.start()?;
    if let Some(frames) = frames {
        listener.publish(frames, &static_frames(start));
    }
    tell("the data is synthetic: a physical model of a glove on a hand, no recording");
    let (mut n_sent, mut n_late, mut said) = (0_u64, 0_u64, None::<Instant>);
    while !interrupt::happened() {
        let t_s = started.elapsed().as_secs_f64();
        read_prompts(&listener, &mut session, t_s);
        while let Some(record) = session.poll(t_s) {
            // What was due while this process was stopped is over: no sensor says later what it felt then.
            let age_s = start.offset((t_s * 1e9) as i64).nanos_since(record.received()) as f64 * 1e-9;
            if age_s > LATE_S {
                n_late += 1;
                continue;
            }
            n_sent += u64::from(match message(&record, args.hand) {
                Message::Taxels(message) => listener.publish(taxels, &message),
                Message::Hand(message) => {
                    let mut cdr = Vec::new();
                    message.to_cdr_into(&mut cdr);
                    listener.publish_cdr(joints, cdr)
                }
                Message::Truth(under, message) => {
                    truth.get(&under).is_some_and(|truth| listener.publish(*truth, &message))
                }
                Message::Stage(_) => false, // who collects annotates
            });
        }
        if said.is_none_or(|said| said.elapsed() >= SAY_EVERY) {
            said = Some(Instant::now());
            listener.publish(says, &Text { data: format!("synthetic glove {} of tpf simulate", spec.glove_name()) });
        }
        std::thread::sleep(NAP);
    }
    listener.leave();
    if n_late > 0 {
        say(&format!("{n_late} messages were not sent, because this process was stopped when they were due"));
    }
    print(&format!("{n_sent} messages (synthetic)\n"))?;
    Ok(Outcome::Done)
}

fn read_prompts(listener: &Listener, session: &mut LiveSession, t_s: f64) {
    while let Some(incoming) = listener.poll() {
        let Ok(cdr) = incoming.cdr else { continue };
        let Ok(Stage { stage, substage, pose, repetition, header, .. }) = from_cdr::<Stage>(&cdr) else { continue };
        // An annotation that is taken back is of a while ago, and asks for nothing now.
        let age_s = incoming.received.nanos_since(header.stamp.into()) as f64 * 1e-9;
        if age_s < 1.0 {
            session.handle_prompt(&Prompt { stage, substage, pose, repetition }, t_s);
        }
    }
}

fn fault(text: &str) -> Result<Fault, String> {
    match text {
        "dead-taxel" => Ok(Fault::DeadTaxel(2)),
        "swapped-joints" => Ok(Fault::SwappedJoints),
        "untared-load-cell" => Ok(Fault::UntaredLoadCell),
        other => Err(format!("expected dead-taxel, swapped-joints or untared-load-cell, got {other:?}")),
    }
}
