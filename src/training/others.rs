//! Sessions whose artifact is taken out by what the sessions of other users taught, as for a user whom the model will not know.
//!
//! A network that is trained on sessions whose own artifact the model has learned meets less of it than users do
//! later, and takes what is left for touch (docs/validation/2026-11-28-other-users.md).

use std::path::Path;
use std::sync::Arc;

use super::TrainingError;
use super::load::{LoadedSession, TrainingLoader};
use crate::eval::Part;
use crate::fusion::ArtifactModel;
use crate::observer::Observer;
use crate::train::{Session, fit_artifact};

/// Of each session, the artifact model of those that other users wore; of unknown users, each counts as another. Where these
/// are too few to learn from, it is the model of all.
///
/// # Shapes
/// `raw`, `users`: `[sessions]`.
pub(super) fn artifacts_of_others(
    raw: &[Session],
    users: &[Option<String>],
    all: &Arc<ArtifactModel>,
    rate_hz: f64,
) -> Vec<Arc<ArtifactModel>> {
    let mut found: Vec<Arc<ArtifactModel>> = Vec::new();
    for (of, user) in users.iter().enumerate() {
        if let Some(before) = users[..of].iter().position(|before| user.is_some() && before == user) {
            found.push(Arc::clone(&found[before]));
            continue;
        }
        let is_other = |idx: usize| idx != of && (user.is_none() || users[idx] != *user);
        let others = raw.iter().enumerate().filter(|(idx, _)| is_other(*idx)).map(|(_, session)| session);
        found.push(match fit_artifact(&others.collect::<Vec<_>>(), rate_hz) {
            Ok(model) => Arc::new(ArtifactModel { trust_inputs: all.trust_inputs, ..model }),
            Err(_) => Arc::clone(all),
        });
    }
    found
}

/// The session with the artifact of `others` taken out of what is learned from and chosen by. Its test part stays as it is in `loaded`,
/// for there the model is scored as it ships.
///
/// # Errors
/// Those of reading the bag.
pub(super) fn by_others(
    loader: &mut TrainingLoader<'_>,
    bag: &Path,
    loaded: LoadedSession,
    others: &Arc<ArtifactModel>,
    observer: &dyn Observer,
) -> Result<LoadedSession, TrainingError> {
    let own = loader.take_out(Arc::clone(others));
    if own.as_ref().is_some_and(|own| Arc::ptr_eq(own, others)) {
        return Ok(loaded); // nobody else taught it
    }
    let by_others = loader.load(bag, &Again(observer));
    if let Some(own) = own {
        loader.take_out(own);
    }
    let by_others = by_others?;
    let tested = loaded.session.frames();
    let mut frames = by_others.session.frames().clone();
    if frames.part != tested.part {
        return Err(TrainingError::at(bag, &"its frames differ from one reading to the next"));
    }
    let width = frames.n_taxels;
    for frame in (0..tested.part.len()).filter(|frame| tested.part[*frame] == Part::Test) {
        let of_frame = frame * width..(frame + 1) * width;
        frames.tactile[of_frame.clone()].copy_from_slice(&tested.tactile[of_frame]);
    }
    Ok(LoadedSession { session: Session::new(frames)?, ..by_others })
}

/// Of a bag that was read before: its notes are told already.
struct Again<'o>(&'o dyn Observer);

impl Observer for Again<'_> {
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::SessionFrames;

    const RATE_HZ: f64 = 100.0;

    /// A minute of one taxel and one joint, whose taxel reads `gain` units for each radian, and 2 for each gF of a press now and then.
    fn session(gain: f32) -> Session {
        let n = 6000;
        let angle = |frame: usize| 0.6 + 0.5 * (frame as f32 / 80.0).sin();
        let truth = |frame: usize| if frame % 1000 < 900 { 0.0 } else { 20.0 };
        let taxel = |frame: usize| gain * angle(frame) + 2.0 * truth(frame) + (frame % 7) as f32 * 0.01;
        Session::new(SessionFrames {
            name: format!("gain {gain}"),
            n_taxels: 1,
            n_joints: 1,
            tactile: (0..n).map(taxel).collect(),
            pose: (0..n).map(angle).collect(),
            truth_gf: (0..n).map(truth).collect(),
            zero_load: (0..n).map(|frame| truth(frame) == 0.0).collect(),
            part: vec![Part::Train; n],
            epoch: vec![0; n],
            ..SessionFrames::default()
        })
        .unwrap()
    }

    /// What the model says that the taxel reads at a constant angle of 1 rad.
    fn reading(model: &ArtifactModel) -> f64 {
        model.shapes[0] + model.shapes[1]
    }

    #[test]
    fn each_session_is_met_as_one_of_a_user_whom_the_model_does_not_know() {
        let raw = [10.0, 12.0, 40.0, 44.0].map(session);
        let all = fit_artifact(&raw.iter().collect::<Vec<_>>(), RATE_HZ).unwrap();
        let all = Arc::new(ArtifactModel { trust_inputs: true, ..all });
        let named = |users: [&str; 4]| users.map(|user| Some(user.to_owned()));
        let found = artifacts_of_others(&raw, &named(["ann", "ann", "ben", "ben"]), &all, RATE_HZ);
        assert!(found.iter().all(|model| model.trust_inputs), "the network gets what it will get");
        assert!(Arc::ptr_eq(&found[0], &found[1]) && Arc::ptr_eq(&found[2], &found[3]), "both sessions of a user");
        // What is learned is drawn to 0, by the same share in each model.
        let mean_gain = |model: &ArtifactModel| 26.5 * reading(model) / reading(&all);
        let gains: Vec<f64> = found.iter().map(|model| mean_gain(model)).collect();
        assert!((gains[0] / 42.0 - 1.0).abs() < 0.05 && (gains[2] / 11.0 - 1.0).abs() < 0.05, "{gains:?}");
        // Of users that are not named, each session is of another.
        let found = artifacts_of_others(&raw, &[const { None }; 4], &all, RATE_HZ);
        for (model, mean) in found.iter().zip([32.0, 94.0 / 3.0, 22.0, 62.0 / 3.0]) {
            assert!((mean_gain(model) / mean - 1.0).abs() < 0.05, "{} {mean}", mean_gain(model));
        }
        // Nobody else is there to learn from.
        let found = artifacts_of_others(&raw, &named(["ann"; 4]), &all, RATE_HZ);
        assert!(found.iter().all(|model| Arc::ptr_eq(model, &all)));
    }
}
