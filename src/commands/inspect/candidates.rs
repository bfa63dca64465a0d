//! What of a bag can feed the fusion, the likeliest first.

use serde::Serialize;

use super::force::{self, ForceCandidate, Skin};
use super::joints::{self, JointCandidate};
use super::parameters::text;
use super::stamps::StampStats;
use super::tactile::{self, TactileCandidate};
use super::topic::{Look, Topic};
use crate::bag::TopicStats;

/// The topic on which annotations are looked for unless the parameters say otherwise.
const DEFAULT_STAGE_TOPIC: &str = "/stage";

/// How much speaks for a candidate; the likeliest is least, so that it sorts first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Likelihood {
    /// Type or name say so.
    Likely,
    /// Its form allows it.
    Possible,
    /// Nothing but that it holds numbers.
    Unlikely,
}

impl Likelihood {
    /// One step down.
    pub(super) fn less(self) -> Self {
        match self {
            Likelihood::Likely => Likelihood::Possible,
            Likelihood::Possible | Likelihood::Unlikely => Likelihood::Unlikely,
        }
    }
}

/// All that is known of a topic that could be looked into.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) topic: &'a Topic,
    pub(super) look: &'a Look,
    /// By log time; absent where there is no message.
    pub(super) stats: Option<&'a TopicStats>,
    pub(super) stamps: Option<&'a StampStats>,
}

/// Stage annotations of a recording.
#[derive(Debug, Serialize)]
pub(super) struct StageTopic {
    pub(super) topic: String,
    pub(super) n_messages: u64,
    /// How many of them say that nothing is touched.
    pub(super) n_zero_load: u64,
    /// A line for the parameter file, below `ros__parameters`; empty where the default finds it.
    pub(super) parameters: String,
}

/// What topics can be.
#[derive(Debug, Default, Serialize)]
pub(super) struct Candidates {
    pub(super) tactile: Vec<TactileCandidate>,
    pub(super) joints: Vec<JointCandidate>,
    pub(super) force: Vec<ForceCandidate>,
    pub(super) stages: Vec<StageTopic>,
}

/// What these topics can be, the likeliest first, topics in order of name where they are alike.
pub(super) fn candidates(views: &[View<'_>], skins: &[Skin]) -> Candidates {
    let contacts = views.iter().filter(|view| view.topic.type_name == "tactile_pose_fusion/msg/ContactArray");
    let estimates_of: Vec<&str> = contacts.filter_map(|view| view.topic.name.strip_suffix("contacts")).collect();
    let mut found = Candidates::default();
    for view in views {
        for array in view.look.arrays.iter().filter(|array| array.n_seen > 0) {
            found.tactile.extend(tactile::candidate(view, array));
            found.joints.extend(joints::candidate(view, array));
        }
        if view.stats.is_some() {
            found.force.extend(force::candidate(view, &estimates_of, skins));
        }
        if let (Some(n_zero_load), Some(stats)) = (view.look.n_zero_load, view.stats) {
            let topic = view.topic.name.clone();
            let parameters = match topic.as_str() {
                DEFAULT_STAGE_TOPIC => String::new(),
                topic => format!("stage_topic: {}\n", text(topic)),
            };
            found.stages.push(StageTopic { topic, n_messages: stats.n_messages, n_zero_load, parameters });
        }
    }
    // Stable: topics come in order of name, fields in the order of the message.
    found.tactile.sort_by_key(|candidate| candidate.likelihood);
    found.joints.sort_by_key(|candidate| candidate.likelihood);
    found.force.sort_by_key(|candidate| candidate.likelihood);
    found
}
