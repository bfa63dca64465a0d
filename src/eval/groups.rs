//! Scores by session, user, glove and substage, and the paired test between two models.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use super::metric::Metric;
use super::metrics::{Measure, MetricError, Score, Tally};
use super::scoring::Scoring;
use super::statistics::{Wilcoxon, cohens_dz, wilcoxon_greater};

/// Where frames come from.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub struct Origin {
    /// Glove design.
    pub glove: String,
    /// The wearer.
    pub user: String,
    /// Session of that user: one donning.
    pub session: String,
    /// Stage of the protocol.
    pub stage: String,
    /// Substage of the stage.
    pub substage: String,
}

/// By what scores are put together. Users are told apart within a glove, sessions within a user.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroupBy {
    /// All frames in one.
    All,
    /// By glove.
    Glove,
    /// By glove and user.
    User,
    /// By glove, user and session.
    Session,
    /// By glove and stage, all users in one.
    Stage,
    /// By glove, stage and substage, all users in one.
    Substage,
}

impl GroupBy {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            GroupBy::All => "all",
            GroupBy::Glove => "glove",
            GroupBy::User => "user",
            GroupBy::Session => "session",
            GroupBy::Stage => "stage",
            GroupBy::Substage => "substage",
        }
    }
}

/// Frames that are scored together: what they have in common.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Group {
    /// Glove design.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub glove: Option<String>,
    /// The wearer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub user: Option<String>,
    /// Session of that user.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub session: Option<String>,
    /// Stage of the protocol.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage: Option<String>,
    /// Substage of the stage.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substage: Option<String>,
}

impl fmt::Display for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = [&self.glove, &self.user, &self.session, &self.stage, &self.substage];
        let mut separator = "";
        for name in names.into_iter().flatten() {
            write!(f, "{separator}{name}")?;
            separator = " / ";
        }
        if separator.is_empty() { f.write_str("all") } else { Ok(()) }
    }
}

impl Origin {
    fn group(&self, by: GroupBy) -> Group {
        let keep = |name: &String, levels: &[GroupBy]| levels.contains(&by).then(|| name.clone());
        Group {
            glove: (by != GroupBy::All).then(|| self.glove.clone()),
            user: keep(&self.user, &[GroupBy::User, GroupBy::Session]),
            session: keep(&self.session, &[GroupBy::Session]),
            stage: keep(&self.stage, &[GroupBy::Stage, GroupBy::Substage]),
            substage: keep(&self.substage, &[GroupBy::Substage]),
        }
    }
}

/// The tallies of one model's estimates, by where the frames come from.
///
/// A group's score is that of its frames pooled, as in the paper's Table I, not a mean of scores.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tallies {
    scoring: Scoring,
    by_origin: BTreeMap<Origin, Tally>,
}

impl Tallies {
    /// No frames yet.
    pub fn new(scoring: Scoring) -> Self {
        Tallies { scoring, by_origin: BTreeMap::new() }
    }

    /// The tally that frames of this origin are added to.
    pub fn at(&mut self, origin: Origin) -> &mut Tally {
        let scoring = self.scoring;
        self.by_origin.entry(origin).or_insert_with(|| Tally::new(scoring))
    }

    /// The tallies by where their frames come from.
    pub(super) fn by_origin(&self) -> &BTreeMap<Origin, Tally> {
        &self.by_origin
    }

    /// Adds the frames of other tallies, as if they had been added here.
    ///
    /// # Errors
    /// [`MetricError::Scoring`] when they were scored by other rules.
    pub fn merge(&mut self, other: &Tallies) -> Result<(), MetricError> {
        other.by_origin.iter().try_for_each(|(origin, tally)| self.at(origin.clone()).merge(tally))
    }

    /// The tallies put together.
    ///
    /// # Errors
    /// [`MetricError::Scoring`] when a tally was replaced by one of other rules.
    pub fn grouped(&self, by: GroupBy) -> Result<BTreeMap<Group, Tally>, MetricError> {
        let mut groups = BTreeMap::new();
        for (origin, tally) in &self.by_origin {
            groups.entry(origin.group(by)).or_insert_with(|| Tally::new(self.scoring)).merge(tally)?;
        }
        Ok(groups)
    }

    /// The scores of the groups.
    ///
    /// # Errors
    /// As [`Tallies::grouped`].
    pub fn scores(&self, by: GroupBy) -> Result<BTreeMap<Group, Score>, MetricError> {
        Ok(self.grouped(by)?.into_iter().map(|(group, tally)| (group, tally.score())).collect())
    }
}

/// One user's measure under two models.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UserPair {
    /// The user.
    pub user: String,
    /// Without the change that is tested.
    pub base: f64,
    /// With it.
    pub changed: f64,
}

/// Whether a change improves a measure, paired by user, on one glove.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairedTest {
    /// The glove.
    pub glove: String,
    /// The measure.
    pub measure: Measure,
    /// The pairs, in the order of the users' names.
    pub pairs: Vec<UserPair>,
    /// Users left out, because one of the two has no value: no data, or a measure that is undefined.
    pub left_out: Vec<String>,
    /// Users whose measure improved.
    pub n_improved: usize,
    /// One-sided exact test that the measure improves; absent when there is no pair that differs, or too many.
    pub wilcoxon: Option<Wilcoxon>,
    /// Cohen's d_z of the improvements, positive for better.
    pub d_z: Metric,
}

/// Tests a change on every glove and measure, paired by user.
///
/// # Errors
/// As [`Tallies::grouped`].
/// # Source
/// Pose-aware tactile gloves, Sec. VI-B, "Statistical Analysis". The paper leaves MDF out for want of data per user;
/// here a user whose curve doesn't cross 90 % is left out and named.
pub fn paired_by_user(base: &Tallies, changed: &Tallies) -> Result<Vec<PairedTest>, MetricError> {
    let (base, changed) = (base.scores(GroupBy::User)?, changed.scores(GroupBy::User)?);
    let mut users: BTreeMap<String, BTreeMap<String, [Option<&Score>; 2]>> = BTreeMap::new();
    for (side, scores) in [&base, &changed].into_iter().enumerate() {
        for (group, score) in scores {
            let (glove, user) = (group.glove.clone().unwrap_or_default(), group.user.clone().unwrap_or_default());
            users.entry(glove).or_default().entry(user).or_default()[side] = Some(score);
        }
    }
    let tests = users.iter().flat_map(|(glove, users)| Measure::ALL.map(|measure| paired_test(glove, measure, users)));
    Ok(tests.collect())
}

fn paired_test(glove: &str, measure: Measure, users: &BTreeMap<String, [Option<&Score>; 2]>) -> PairedTest {
    let (mut pairs, mut left_out, mut improvements) = (Vec::new(), Vec::new(), Vec::new());
    for (user, scores) in users {
        match scores.map(|score| score.and_then(|score| measure.value(score))) {
            [Some(base), Some(changed)] => {
                let difference = changed - base;
                improvements.push(if measure.higher_is_better() { difference } else { -difference });
                pairs.push(UserPair { user: user.clone(), base, changed });
            }
            _ => left_out.push(user.clone()),
        }
    }
    PairedTest {
        glove: glove.to_owned(),
        measure,
        pairs,
        left_out,
        n_improved: improvements.iter().filter(|&&improvement| improvement > 0.0).count(),
        wilcoxon: wilcoxon_greater(&improvements).ok(),
        d_z: cohens_dz(&improvements),
    }
}
