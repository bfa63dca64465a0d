//! Inspection of bags: topics, their timing and stamps, and which of them can feed the fusion as taxels, joint angles
//! or a measured force, each with its reasons and the lines that a parameter file needs for it.
//!
//! A bag is read once, from its first message to its last, in memory that grows with the number of topics alone.

mod angles;
mod arrays;
mod candidates;
mod elements;
mod force;
mod force_run;
mod found;
mod frame_watch;
mod gather;
mod grid;
mod hand;
mod hand_frames;
mod hand_points;
mod hints;
mod joints;
mod likelihood;
mod moments;
mod numbers;
mod parameters;
mod report;
mod sides;
mod stamps;
mod tactile;
mod taxel_means;
mod topic;
mod view;

pub use angles::Angle;
pub use candidates::{Candidates, StageTopic};
pub use elements::Elements;
pub use force::ForceCandidate;
pub use force_run::ForceRange;
pub use found::{Inspected, all_recordings, inspect, recordings};
pub use hand::HandCandidate;
pub use joints::JointCandidate;
pub use likelihood::Likelihood;
pub use numbers::{count, number, range};
pub use parameters::{SourceLine, SourceLines, source_name, yaml_text};
pub use report::{BagReport, InspectError, TopicReport};
pub use sides::Sides;
pub use stamps::StampStats;
pub use tactile::{Count, TactileCandidate, TaxelStats};
