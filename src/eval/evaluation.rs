//! Everything that is measured of one series of estimates, session by session.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Serialize;

use super::contact::{ContactError, Detection, DetectionTally, Touches, Touching};
use super::curve::ForceCurve;
use super::density::{DensityTally, ForceDensity};
use super::groups::{GroupBy, Tallies};
use super::held::{HeldTally, HeldTouches};
use super::in_air::{InAirReport, InAirTally};
use super::metrics::{MetricError, Score, Tally};
use super::pose_age::{PoseAgeBin, PoseAgeTally};
use super::preservation::{Preservation, PreservationTally};
use super::scored_frames::ScoredFrames;
use super::scoring::Scoring;
use crate::eval::Group;
use crate::units::Stamp;

/// The name of a substage of pseudo-unseen poses contains this.
///
/// # Source
/// Pose-aware tactile gloves, Sec. VI-B, "Generalizability against unseen poses".
pub const FREE_MOVEMENT: &str = "free_movement";

/// How far a detected touch may lie from a true one and still be the same: debounce, and half a window of blur.
const CONTACT_SLACK: Duration = Duration::from_millis(150);

/// Truth that chatters around the threshold is one touch; shorter than a light tap is none.
const TRUE_TOUCHES: Touching = Touching {
    max_gap: Duration::from_millis(50),
    join_within: Duration::from_millis(100),
    at_least: Duration::from_millis(50),
};

/// A kept touch that the correction detects later than this is a delayed one.
const TOLERATED_DELAY: Duration = Duration::from_millis(50);

/// Frames that can't be scored.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum EvaluationError {
    #[error(transparent)]
    Contact(#[from] ContactError),
    #[error(transparent)]
    Metric(#[from] MetricError),
}

/// Statistics of one series of estimates, gathered session by session.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// All scored frames.
    pub all: Tallies,
    /// Those of free movement.
    pub free_movement: Tallies,
    /// Whether the touch of some frame was judged by its probability.
    pub(super) by_touch: bool,
    pub(super) scoring: Scoring,
    pub(super) by_glove: BTreeMap<String, ContactTallies>,
}

#[derive(Debug, Clone)]
pub(super) struct ContactTallies {
    pub(super) detection: DetectionTally,
    pub(super) preservation: PreservationTally,
    pub(super) pose_age: PoseAgeTally,
    pub(super) in_air: InAirTally,
    pub(super) held: HeldTally,
    pub(super) density: DensityTally,
}

/// Contacts of one glove: how they were detected, and what the correction did to them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ContactReport {
    /// Touches found, missed and invented, and how late.
    pub detection: Detection,
    /// Effect of the pose correction on true contacts; absent for estimates without a base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preservation: Option<Preservation>,
    /// Force error by the age of the pose.
    pub by_pose_age: Vec<PoseAgeBin>,
    /// Estimates while nothing touches the glove; absent where annotations name no such time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub in_air: Option<InAirReport>,
    /// Touches that are held, by their force.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub held: Vec<HeldTouches>,
}

/// Scores of one kind of group.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroupScore {
    /// The group.
    #[serde(flatten)]
    pub group: Group,
    /// Its score.
    #[serde(flatten)]
    pub score: Score,
}

impl ScoredFrames {
    /// Whether an [`Evaluation`] can take them: asked before the first of several does.
    ///
    /// # Errors
    /// [`EvaluationError`] when columns differ in length or stamps don't rise.
    pub fn check(&self) -> Result<(), EvaluationError> {
        Ok(Touches::of(&self.stamp, &self.contact, Touching::default()).map(|_| ())?)
    }
}

impl Evaluation {
    /// Nothing yet.
    pub fn new(scoring: Scoring) -> Self {
        Evaluation {
            all: Tallies::new(scoring),
            free_movement: Tallies::new(scoring),
            by_touch: false,
            scoring,
            by_glove: BTreeMap::new(),
        }
    }

    /// Takes the frames of a session.
    ///
    /// # Errors
    /// [`EvaluationError`] when columns differ in length or stamps don't rise.
    pub fn handle_session(&mut self, frames: &ScoredFrames) -> Result<(), EvaluationError> {
        self.by_touch |= !frames.touched.is_empty();
        // A session without a true force is in no group; its contacts in the air are counted below.
        let has_truth = frames.truth_gf.iter().any(|truth| truth.is_finite());
        let mut start = 0;
        for stretch in frames.origin.chunk_by(|a, b| a == b) {
            let range = start..start + stretch.len();
            start = range.end;
            let origin = stretch.first().and_then(|idx| frames.origins.get(*idx)).filter(|_| has_truth);
            let Some(origin) = origin else { continue };
            let is_free = origin.substage.contains(FREE_MOVEMENT);
            let add = |tally: &mut Tally| {
                for idx in range.clone() {
                    let touched = frames.touched.get(idx).copied();
                    let (truth, estimate) = (frames.truth_gf[idx], frames.estimate_gf[idx]);
                    tally.add_judged(truth, estimate, touched);
                    let of = |column: &[Option<[f64; 3]>]| column.get(idx).copied().flatten();
                    tally
                        .add_tangential((truth, of(&frames.true_tangential_gf)), (estimate, of(&frames.tangential_gf)));
                }
            };
            add(self.all.at(origin.clone()));
            if is_free {
                add(self.free_movement.at(origin.clone()));
            }
        }
        let Some(origin) = frames.origins.first() else { return Ok(()) };
        let scoring = self.scoring;
        self.contacts_of(&origin.glove).handle_session(frames, &scoring)
    }

    /// The contact tallies of a glove.
    pub(super) fn contacts_of(&mut self, glove: &str) -> &mut ContactTallies {
        self.by_glove.entry(glove.to_owned()).or_insert_with(|| ContactTallies {
            detection: DetectionTally::new(CONTACT_SLACK),
            preservation: PreservationTally::new(CONTACT_SLACK, TOLERATED_DELAY),
            pose_age: PoseAgeTally::default(),
            in_air: InAirTally::new(CONTACT_SLACK, Touching::default().max_gap),
            held: HeldTally::default(),
            density: DensityTally::default(),
        })
    }

    /// Adds what another evaluation gathered. Sums are added in the order of these calls: the same order gives the same
    /// bits.
    ///
    /// # Errors
    /// [`MetricError::Scoring`] when it was scored by other rules.
    pub fn merge(&mut self, other: &Evaluation) -> Result<(), MetricError> {
        self.all.merge(&other.all)?;
        self.free_movement.merge(&other.free_movement)?;
        self.by_touch |= other.by_touch;
        for (glove, theirs) in &other.by_glove {
            let ours = self.contacts_of(glove);
            ours.detection.merge(&theirs.detection);
            ours.preservation.merge(&theirs.preservation);
            ours.pose_age.merge(&theirs.pose_age);
            ours.in_air.merge(&theirs.in_air);
            ours.held.merge(&theirs.held);
            ours.density.merge(&theirs.density);
        }
        Ok(())
    }

    /// Whether touch was judged by the probability that the model gives, and not by its force.
    pub fn is_by_touch(&self) -> bool {
        self.by_touch
    }

    /// Scores by a kind of group, in the order of their names.
    ///
    /// # Errors
    /// As [`Tallies::grouped`].
    pub fn scores(&self, by: GroupBy) -> Result<Vec<GroupScore>, MetricError> {
        group_scores(&self.all, by)
    }

    /// Error and detection over true force, by glove.
    ///
    /// # Errors
    /// As [`Tallies::grouped`].
    pub fn curves(&self) -> Result<BTreeMap<String, ForceCurve>, MetricError> {
        let by_glove = self.all.grouped(GroupBy::Glove)?;
        Ok(by_glove.into_iter().map(|(glove, tally)| (glove.to_string(), tally.curve())).collect())
    }

    /// Frames by true and by estimated force, by glove.
    pub fn densities(&self) -> BTreeMap<String, ForceDensity> {
        let of_glove = |(glove, tallies): (&String, &ContactTallies)| Some((glove.clone(), tallies.density.density()?));
        self.by_glove.iter().filter_map(of_glove).collect()
    }

    /// How touches were detected, by glove.
    pub fn detections(&self) -> impl Iterator<Item = (&str, &DetectionTally)> {
        self.by_glove.iter().map(|(glove, tallies)| (glove.as_str(), &tallies.detection))
    }

    /// Contacts by glove.
    pub fn contacts(&self) -> BTreeMap<String, ContactReport> {
        let report = |tallies: &ContactTallies| {
            let preservation = tallies.preservation.preservation();
            ContactReport {
                detection: tallies.detection.detection(),
                preservation: (preservation.n_true > 0).then_some(preservation),
                by_pose_age: tallies.pose_age.bins(),
                in_air: tallies.in_air.report(),
                held: tallies.held.report(),
            }
        };
        self.by_glove.iter().map(|(glove, tallies)| (glove.clone(), report(tallies))).collect()
    }
}

/// Scores by a kind of group, in the order of their names.
///
/// # Errors
/// As [`Tallies::grouped`].
pub fn group_scores(tallies: &Tallies, by: GroupBy) -> Result<Vec<GroupScore>, MetricError> {
    Ok(tallies.scores(by)?.into_iter().map(|(group, score)| GroupScore { group, score }).collect())
}

impl ContactTallies {
    fn handle_session(&mut self, frames: &ScoredFrames, scoring: &Scoring) -> Result<(), EvaluationError> {
        let estimate: Vec<f64> = frames.estimate_gf.iter().map(|estimate| estimate.unwrap_or(f64::NAN)).collect();
        self.in_air.handle_session(frames);
        self.density.add(&frames.truth_gf, &estimate);
        self.pose_age.add(&frames.truth_gf, &estimate, &frames.pose_age_ns)?;

        // Frames without truth or estimate say nothing about touch: they leave a gap.
        let known: Vec<usize> = (0..frames.stamp.len())
            .filter(|&idx| frames.truth_gf[idx].is_finite() && estimate[idx].is_finite())
            .collect();
        let stamps: Vec<Stamp> = known.iter().map(|&idx| frames.stamp[idx]).collect();
        let states = |column: &[bool]| known.iter().map(|&idx| column[idx]).collect::<Vec<bool>>();
        let is_touch: Vec<bool> = known.iter().map(|&idx| scoring.is_touch(frames.truth_gf[idx])).collect();
        let truth = Touches::of(&stamps, &is_touch, TRUE_TOUCHES)?;
        let detected = Touches::of(&stamps, &states(&frames.contact), Touching::default())?;
        self.detection.handle_session(&truth, &detected);
        let forces = |column: &[f64]| known.iter().map(|&idx| column[idx]).collect::<Vec<f64>>();
        let contact = states(&frames.contact);
        self.held.handle_session(&truth, &stamps, &forces(&frames.truth_gf), &forces(&estimate), &contact);
        if !frames.base_contact.is_empty() {
            let base = Touches::of(&stamps, &states(&frames.base_contact), Touching::default())?;
            self.preservation.handle_session(&truth, &base, &detected);
        }
        Ok(())
    }
}
