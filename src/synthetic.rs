//! Writes sessions of a synthetic glove to bags: messages of a glove driver, a hand tracker, a load cell and a
//! protocol.

mod device_messages;
mod hand_forms;
mod hand_message;
mod shipped;

use std::collections::BTreeMap;
use std::path::Path;

use crate::bag::{BEST_EFFORT_QOS, BagError, BagMetadata, BagWriter, NewChannel, OutChannel, WriteOptions};
use crate::msg::{
    Duration, Header, Stage, TFMessage, TaxelArray, Vector3, WireType, Wrench, WrenchStamped, to_cdr_into, type_hash,
};
use crate::observer::{Cancelled, Observer, check};
use crate::recording::SESSION_NOTES;
use crate::sim::hand::Finger;
use crate::sim::{Fingers, Record, SessionSpec, SimError, simulate};
use crate::units::Stamp;
pub use device_messages::{HandJointPose, HandJointPoses, ManusErgonomics, ManusGlove, ManusRawNode};
pub use hand_forms::{HandForm, static_frames};
pub use hand_message::HandMessage;
pub use shipped::{SHIPPED, SHIPPED_HAND1, Shipped, ShippedHand};

/// Topic of the taxels.
pub const TAXELS: &str = "/glove/taxels";
/// Topic of the joint angles.
pub const JOINTS: &str = "/hand/joint_states";
/// Topic of the poses of the hand's points, in place of [`JOINTS`].
pub const POSES: &str = "/hand/poses";
/// Topic of the positions of the hand's points alone, in place of [`JOINTS`].
pub const KEYPOINTS: &str = "/hand/keypoints";
/// Topic of the hand's named points, in place of [`JOINTS`].
pub const NAMED_POSES: &str = "/hand/named_poses";
/// Topic of the hand as a Manus glove sends it, in place of [`JOINTS`].
pub const MANUS_GLOVE: &str = "/manus_glove_0";
/// Topic of the hand's points as frames, in place of [`JOINTS`].
pub const FRAMES: &str = "/tf";
/// Topic of those of its frames that never move.
pub const STATIC_FRAMES: &str = "/tf_static";
/// Topic of the true force for a glove with taxels on one finger.
pub const TRUTH: &str = "/load_cell/wrench";

/// Topic of the true force, by the finger above the load cell. `None` if there is only one such finger.
pub fn truth_topic(under: Option<Finger>) -> String {
    under.map_or_else(|| TRUTH.to_owned(), |finger| format!("/load_cell/{}/wrench", finger.name()))
}
/// Topic of the annotations.
pub const STAGE: &str = "/stage";

/// The reason why a session is not written.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum SyntheticError {
    #[error(transparent)]
    Sim(#[from] SimError),
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Writes one session and returns the number of messages.
///
/// # Errors
/// [`SyntheticError`] if there is no such session, or if the bag can't be written. There is then no bag.
pub fn write(spec: &SessionSpec, path: &Path, overwrite: bool, observer: &dyn Observer) -> Result<u64, SyntheticError> {
    write_as(spec, HandForm::Angles, path, overwrite, observer)
}

/// Writes one session with another form of the hand data, and returns the number of messages.
///
/// # Errors
/// As for [`write()`].
pub fn write_as(
    spec: &SessionSpec,
    hand: HandForm,
    path: &Path,
    overwrite: bool,
    observer: &dyn Observer,
) -> Result<u64, SyntheticError> {
    let session = simulate(spec)?;
    let total = session.n_frames();
    let mut bag = BagWriter::create(path, WriteOptions { overwrite, ..WriteOptions::default() })?;
    bag.copy_metadata(&BagMetadata { name: SESSION_NOTES, metadata: &session.metadata() })?;
    let mut topics = Topics {
        taxels: bag.add_topic::<TaxelArray>(TAXELS)?,
        joints: bag.add_channel(NewChannel {
            topic: hand.topic(),
            type_name: hand.type_name(),
            schema_text: &hand.schema_text(),
            qos_yaml: BEST_EFFORT_QOS,
            type_hash: &type_hash(&hand.type_tree()),
        })?,
        hand,
        truth: match spec.conditions.fingers {
            Fingers::Index => BTreeMap::from([(None, bag.add_topic::<WrenchStamped>(TRUTH)?)]),
            Fingers::All => BTreeMap::new(), // a finger that is never above the load cell has no topic
        },
        stage: bag.add_topic::<Stage>(STAGE)?,
        bag,
        cdr: Vec::new(),
    };
    let mut n_frames = 0;
    let mut unsent_frames = match hand {
        HandForm::Transforms => Some(topics.bag.add_topic::<TFMessage>(STATIC_FRAMES)?),
        _ => None,
    };
    for record in session {
        if let Some(channel) = unsent_frames.take() {
            topics.send(channel, record.received(), &static_frames(record.stamp()))?;
        }
        check(observer)?;
        n_frames += u64::from(matches!(record, Record::Truth { .. }));
        observer.progress(n_frames, total);
        topics.write(&record)?;
    }
    Ok(topics.bag.finish()?.n_messages)
}

struct Topics {
    taxels: OutChannel,
    joints: OutChannel,
    hand: HandForm,
    truth: BTreeMap<Option<Finger>, OutChannel>,
    stage: OutChannel,
    bag: BagWriter,
    cdr: Vec<u8>,
}

impl Topics {
    fn write(&mut self, record: &Record) -> Result<(), BagError> {
        let received = record.received();
        match message(record, self.hand) {
            Message::Taxels(message) => self.send(self.taxels, received, &message),
            Message::Hand(message) => {
                message.to_cdr_into(&mut self.cdr);
                self.bag.write(self.joints, 0, received, received, &self.cdr)
            }
            Message::Truth(under, message) => {
                let channel = match self.truth.get(&under) {
                    Some(channel) => *channel,
                    None => {
                        let channel = self.bag.add_topic::<WrenchStamped>(&truth_topic(under))?;
                        self.truth.insert(under, channel);
                        channel
                    }
                };
                self.send(channel, received, &message)
            }
            Message::Stage(message) => self.send(self.stage, received, &message),
        }
    }

    fn send<T: WireType>(&mut self, channel: OutChannel, received: Stamp, message: &T) -> Result<(), BagError> {
        to_cdr_into(message, &mut self.cdr);
        self.bag.write(channel, 0, received, received, &self.cdr)
    }
}

/// A record of a simulated session as a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// On [`TAXELS`].
    Taxels(TaxelArray),
    /// On the topic of its form.
    Hand(HandMessage),
    /// On the [`truth_topic`] of the finger above the load cell.
    Truth(Option<Finger>, WrenchStamped),
    /// On [`STAGE`].
    Stage(Stage),
}

/// Converts a record of a simulated session to a message.
pub fn message(record: &Record, hand: HandForm) -> Message {
    let header = |frame_id: &str| Header { stamp: record.stamp().into(), frame_id: frame_id.to_owned() };
    let vector = |[x, y, z]: [f64; 3]| Vector3 { x, y, z };
    match record {
        Record::Taxels { sequence, values, .. } => {
            let (rows, row_period, values) = (1, Duration::default(), values.clone());
            Message::Taxels(TaxelArray { header: header("index_tip"), sequence: *sequence, rows, row_period, values })
        }
        Record::Joints { names, positions, .. } => {
            Message::Hand(HandMessage::new(hand, names, positions, record.stamp()))
        }
        Record::Truth { force, torque, under, .. } => {
            let wrench = Wrench { force: vector(*force), torque: vector(*torque) };
            Message::Truth(*under, WrenchStamped { header: header("load_cell"), wrench })
        }
        Record::Stage { stage, substage, pose, repetition, zero_load, .. } => {
            let (stage, repetition, zero_load) = (*stage, *repetition, *zero_load);
            let (substage, pose) = (substage.to_string(), pose.to_string());
            Message::Stage(Stage { header: header(""), stage, substage, pose, repetition, zero_load })
        }
    }
}
