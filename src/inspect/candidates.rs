//! Candidates: the topics of a bag that can feed the fusion, the likeliest first.

use serde::Serialize;

use super::force::{self, ForceCandidate};
use super::hand::{self, HandCandidate};
use super::hand_frames;
use super::joints::{self, JointCandidate};
use super::likelihood::Likelihood;
use super::parameters::yaml_text;
use super::tactile::{self, TactileCandidate};
use super::taxel_means::Skin;
use super::view::View;

/// The topic on which annotations are looked for unless the parameters say otherwise.
const DEFAULT_STAGE_TOPIC: &str = "/stage";

/// Stage annotations of a recording.
#[derive(Debug, Serialize)]
pub struct StageTopic {
    /// Its topic.
    pub topic: String,
    /// Messages on the topic.
    pub n_messages: u64,
    /// How many of them say that nothing is touched.
    pub n_zero_load: u64,
    /// A line for the parameter file, below `ros__parameters`; empty where the default finds it.
    pub parameters: String,
}

/// The topics that can feed the fusion, by kind.
#[derive(Debug, Default, Serialize)]
pub struct Candidates {
    /// Arrays that can be taxels.
    pub tactile: Vec<TactileCandidate>,
    /// Arrays that can be joint angles.
    pub joints: Vec<JointCandidate>,
    /// Topics that can be the points of a hand.
    #[serde(skip)]
    pub hands: Vec<HandCandidate>,
    /// Topics that can be a measured force.
    pub force: Vec<ForceCandidate>,
    /// Stage annotations.
    pub stages: Vec<StageTopic>,
}

impl Candidates {
    /// Whether a topic speaks for a force sensor more than for taxels.
    pub fn is_rather_a_force(&self, one: &TactileCandidate) -> bool {
        let mut here = self.force.iter().filter(|force| force.topic == one.topic);
        one.likelihood != Likelihood::Likely && here.any(|force| force.likelihood == Likelihood::Likely)
    }
}

/// The candidates among these topics, the likeliest first, topics in order of name where they are alike.
pub(super) fn candidates(views: &[View<'_>], skins: &[Skin]) -> Candidates {
    let contacts = views.iter().filter(|view| view.topic.type_name == "tactile_pose_fusion/msg/ContactArray");
    let estimates_of: Vec<&str> = contacts.filter_map(|view| view.topic.name.strip_suffix("contacts")).collect();
    let mut found = Candidates::default();
    for view in views {
        for array in view.look.arrays.iter().filter(|array| array.n_seen > 0) {
            found.tactile.extend(tactile::candidate(view, array));
            found.joints.extend(joints::candidate(view, array));
        }
        found.hands.extend(view.look.hands.iter().filter_map(|watch| hand::candidate(view, watch)));
        found.hands.extend(hand_frames::candidates(view, views));
        if view.stats.is_some() {
            found.force.extend(force::candidate(view, &estimates_of, skins));
        }
        if let (Some(n_zero_load), Some(stats)) = (view.look.n_zero_load, view.stats) {
            let topic = view.topic.name.clone();
            let parameters = match topic.as_str() {
                DEFAULT_STAGE_TOPIC => String::new(),
                topic => format!("stage_topic: {}\n", yaml_text(topic)),
            };
            found.stages.push(StageTopic { topic, n_messages: stats.n_messages, n_zero_load, parameters });
        }
    }
    // Stable: topics come in order of name, fields in the order of the message.
    found.tactile.sort_by_key(|candidate| candidate.likelihood);
    found.joints.sort_by_key(|candidate| candidate.likelihood);
    found.hands.sort_by_key(|candidate| candidate.likelihood);
    found.force.sort_by_key(|candidate| candidate.likelihood);
    found
}
