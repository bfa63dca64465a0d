//! Touches through the core with the adaptive models that ship: a synthetic user's hand moves in the air, tracked by markers or
//! by a camera, and touches of any course are added to its taxels along the pattern that the model knows. SYNTHETIC data.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use tactile_pose_fusion::config::{self, Config, DEFAULT_NODE};
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::glove::{Models, replace_model};
use tactile_pose_fusion::sim::manipulation::{Episode, Start};
use tactile_pose_fusion::sim::{Activity, Conditions, Record, SessionSpec, Tracking, simulate};
use tactile_pose_fusion::units::{GramForce, Newton, Stamp};
use tactile_pose_fusion::zero::{ArtifactCollector, ArtifactTimes, Donning, Rest};

/// The hand is in the air at least until then, s: its calibration.
const CALIBRATED_S: f64 = 12.0;

/// Users that no model knows.
const USERS: std::ops::RangeInclusive<u32> = 1..=2;

/// A frame with an estimate.
struct Felt {
    at_s: f64,
    force_gf: f64,
    contact: bool,
    adaptation: Adaptation,
}

/// A session in the air on a glove.
struct Worn {
    cfg: Config,
    records: Vec<Record>,
    /// `[taxels]`, counts for each gF, as the sensor sends them.
    pattern: Vec<f64>,
    donning: Donning,
}

fn setup(glove: u8) -> (Config, Models) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut cfg = config::load(&root.join(format!("params/glove{glove}.yaml")), DEFAULT_NODE).unwrap();
    replace_model(&mut cfg, root.join(format!("models/glove{glove}_adaptive.onnx"))).unwrap();
    let models = Models::load(&cfg).unwrap();
    cfg.set_batch(models.batch_hint());
    (cfg, models)
}

impl Worn {
    fn new(glove: u8, tracking: Tracking, user: u32, minutes: f64) -> Self {
        let (cfg, models) = setup(glove);
        let conditions = Conditions { start: Start::InAir, episodes: vec![Episode::Air], ..Conditions::default() };
        let activity = Activity::Manipulation;
        let spec = SessionSpec { glove, user, session: 1, seed: 11, minutes, activity, tracking, conditions };
        let records: Vec<Record> = simulate(&spec).unwrap().collect();
        let artifact = models.infos[0].contract.artifact.clone().unwrap();
        let sign = if cfg.fusion().tactile_sources()[0].inverted { -1.0 } else { 1.0 };
        let pattern = artifact.touch.iter().map(|touch| sign * touch).collect();
        let mut worn = Worn { cfg, records, pattern, donning: Donning::default() };
        worn.calibrate((artifact, models.infos[0].contract.rate_hz));
        worn
    }

    fn calibrate(&mut self, artifact: (std::sync::Arc<ArtifactModel>, f64)) {
        let until = self.start().offset((CALIBRATED_S * 1e9) as i64);
        let mut baseline = BaselineBuilder::new(self.pattern.len(), 50_000_000);
        self.feed(
            (0.0, CALIBRATED_S),
            |_| 0.0,
            |event| {
                if let Event::Tactile(block) = event {
                    baseline.handle_sample(block.stamp, block.values);
                }
            },
        );
        let limits = CalibrationLimits { min_s: 1.0, max_force: Newton(1.0), max_loaded_fraction: 1.0 };
        let baselines = vec![baseline.finish(&limits).unwrap()];
        let rest = vec![vec![Rest { from: self.start(), to: until }]];
        let times = ArtifactTimes { most: Duration::from_secs(10), least_s: 3.0 };
        let mut collector =
            ArtifactCollector::new(self.cfg.fusion(), &[Some(artifact)], &baselines, &rest, times).unwrap();
        self.feed((0.0, CALIBRATED_S), |_| 0.0, |event| collector.handle(event).unwrap());
        let artifacts = collector.finish(&[]).unwrap();
        self.donning = Donning { baselines, artifacts, ..Donning::default() };
    }

    fn start(&self) -> Stamp {
        self.records[0].received()
    }

    /// Events that arrive in this span of time, s, with a touch of so many gF at each time.
    fn feed(&self, (from_s, to_s): (f64, f64), touch_gf: impl Fn(f64) -> f64, mut handle: impl FnMut(Event<'_>)) {
        let at_s = |stamp: Stamp| stamp.nanos_since(self.start()) as f64 * 1e-9;
        let mut touched = Vec::new();
        for record in self.records.iter().filter(|record| (from_s..to_s).contains(&at_s(record.received()))) {
            match record {
                Record::Taxels { stamp, received, sequence, values } => {
                    let touch = touch_gf(at_s(*stamp));
                    touched.clear();
                    touched.extend(values.iter().zip(&self.pattern).map(|(value, k)| value + (k * touch) as f32));
                    handle(Event::Tactile(TactileBlock {
                        source: TactileSourceIdx::at(0),
                        stamp: *stamp,
                        rows: 1,
                        row_period_ns: 0,
                        sequence: Some(*sequence),
                        values: &touched,
                        received: *received,
                    }));
                }
                Record::Joints { stamp, received, names, positions } => handle(Event::Joints(JointSample {
                    source: JointSourceIdx::at(0),
                    stamp: *stamp,
                    names,
                    positions,
                    received: *received,
                })),
                Record::Truth { .. } | Record::Stage { .. } => {}
            }
        }
    }

    /// What the core says from `from_s` on.
    fn feel(&self, from_s: f64, touch_gf: impl Fn(f64) -> f64) -> Vec<Felt> {
        let (cfg, models) = (&self.cfg, Models::load(&self.cfg).unwrap());
        let mut core = Fusion::new(cfg.fusion().clone(), models.regressors).unwrap();
        self.donning.install(&mut core).unwrap();
        let mut felt = Vec::new();
        let mut poll = |core: &mut Fusion| {
            while let Some(tick) = core.poll().unwrap() {
                let Estimate { force: Some(force), contact, adaptation, .. } = tick.estimates[0] else { continue };
                let at_s = tick.stamp.nanos_since(self.start()) as f64 * 1e-9;
                let force_gf = GramForce::from(force).0;
                felt.push(Felt { at_s, force_gf, contact: contact.state, adaptation });
            }
        };
        self.feed((from_s, f64::INFINITY), touch_gf, |event| {
            core.handle(event).unwrap();
            poll(&mut core);
        });
        core.handle_end();
        poll(&mut core);
        felt
    }
}

/// Sessions of two minutes: glove, whether a camera tracks the hand, user. Each is made once for all tests.
type Sessions = BTreeMap<(u8, bool, u32), Arc<OnceLock<Worn>>>;

/// Two minutes in the air.
fn two_minutes<R>(glove: u8, tracking: Tracking, user: u32, of: impl FnOnce(&Worn) -> R) -> R {
    static SESSIONS: Mutex<Sessions> = Mutex::new(BTreeMap::new());
    let key = (glove, tracking == Tracking::Camera, user);
    let session = Arc::clone(SESSIONS.lock().unwrap().entry(key).or_default());
    of(session.get_or_init(|| Worn::new(glove, tracking, user, 2.0)))
}

/// Share of the frames in a span of time, s, with contact, and their mean force, gF.
fn in_span(felt: &[Felt], from_s: f64, to_s: f64) -> (f64, f64) {
    let within: Vec<&Felt> = felt.iter().filter(|felt| (from_s..to_s).contains(&felt.at_s)).collect();
    assert!(within.len() > 50, "{} frames from {from_s} to {to_s} s", within.len());
    let n = within.len() as f64;
    let found = within.iter().filter(|felt| felt.contact).count() as f64;
    (found / n, within.iter().map(|felt| felt.force_gf).sum::<f64>() / n)
}

fn share_of(felt: &[Felt], from_s: f64, to_s: f64, states: &[Adaptation]) -> f64 {
    let within: Vec<&Felt> = felt.iter().filter(|felt| (from_s..to_s).contains(&felt.at_s)).collect();
    within.iter().filter(|felt| states.contains(&felt.adaptation)).count() as f64 / within.len() as f64
}

/// Touch from 40 to 100 s.
fn for_a_minute(force_gf: f64) -> impl Fn(f64) -> f64 {
    move |at_s| if (40.0..100.0).contains(&at_s) { force_gf } else { 0.0 }
}

#[test]
fn a_touch_that_is_held_for_a_minute_in_a_moving_hand_is_kept() {
    for (glove, tracking, force_gf) in [
        (1, Tracking::Markers, 10.0),
        (1, Tracking::Markers, 40.0),
        (1, Tracking::Camera, 40.0),
        (2, Tracking::Markers, 20.0),
        (3, Tracking::Markers, 40.0),
        (3, Tracking::Camera, 60.0),
    ] {
        for user in USERS {
            let felt = two_minutes(glove, tracking, user, |worn| worn.feel(CALIBRATED_S, for_a_minute(force_gf)));
            let (early, late, over) =
                (in_span(&felt, 40.5, 44.5), in_span(&felt, 96.0, 100.0), in_span(&felt, 101.0, 106.0));
            let told = format!(
                "glove {glove}, {tracking:?}, user {user}, {force_gf} gF: {early:?} at first, {late:?} at last, {over:?} after"
            );
            assert!(early.0 > 0.95 && late.0 > 0.95 && late.1 > 0.7 * early.1, "{told}");
            assert!(over.0 < 0.1 && over.1.abs() < 3.0, "{told}");
        }
    }
}

#[test]
fn a_slow_ramp_is_found() {
    for (tracking, found_at) in [(Tracking::Markers, 12.0), (Tracking::Camera, 25.0)] {
        for user in USERS {
            let ramp = |at_s: f64| if at_s < 40.0 { 0.0 } else { (0.5 * (at_s - 40.0)).min(30.0) };
            let felt = two_minutes(1, tracking, user, |worn| worn.feel(CALIBRATED_S, ramp));
            let loaded: Vec<&Felt> = felt.iter().filter(|felt| felt.at_s > 40.0).collect();
            let is_found = |second: &&[&Felt]| second.iter().filter(|felt| felt.contact).count() > 80;
            let found = loaded.windows(100).find(is_found).map(|second| ramp(second[0].at_s));
            assert!(found.is_some_and(|force| force < found_at), "{tracking:?}, user {user}: found at {found:?} gF");
        }
    }
}

#[test]
fn ten_minutes_of_grasp_without_air_leave_no_false_touches() {
    for (glove, tracking) in
        [(1, Tracking::Markers), (1, Tracking::Camera), (3, Tracking::Markers), (3, Tracking::Camera)]
    {
        let grasp = |at_s: f64| if (40.0..640.0).contains(&at_s) { 120.0 + 60.0 * (at_s / 2.0).sin() } else { 0.0 };
        let felt = Worn::new(glove, tracking, 1, 12.0).feel(CALIBRATED_S, grasp);
        let (before, within) = (in_span(&felt, 14.0, 40.0), in_span(&felt, 41.0, 640.0));
        let (after, later) = (in_span(&felt, 640.3, 645.0), in_span(&felt, 645.0, 700.0));
        let told =
            format!("glove {glove}, {tracking:?}: {before:?}, {within:?} in the grasp, then {after:?}, {later:?}");
        assert!(within.0 > 0.99, "{told}");
        assert!(after.0 < 0.05 && later.0 < before.0 + 0.02 && after.1 < 3.0, "{told}");
        let learned = share_of(&felt, 41.0, 640.0, &[Adaptation::Learning, Adaptation::Noisy, Adaptation::Capped]);
        assert!(learned < 0.01, "{told}: {learned} of its frames teach gains");
    }
}

#[test]
fn a_start_in_contact_is_said_and_not_learned() {
    for (tracking, force_gf) in [(Tracking::Markers, 15.0), (Tracking::Camera, 60.0)] {
        for user in USERS {
            // The calibration is older than the recording, as from a file.
            let felt =
                two_minutes(1, tracking, user, |worn| worn.feel(15.0, |at_s| if at_s < 42.0 { force_gf } else { 0.0 }));
            let (first, over) = (in_span(&felt, 15.0, 20.0), in_span(&felt, 43.0, 60.0));
            let told = format!("{tracking:?}, user {user}: {first:?} at first, {over:?} when it is over");
            assert!(first.0 > 0.95 && over.0 < 0.15, "{told}");
            let waiting = share_of(&felt, 17.0, 20.0, &[Adaptation::Waiting]);
            assert!(waiting > 0.95, "{told}: waits in {waiting} of the frames");
        }
    }
}

#[test]
fn a_noisy_tracker_is_said_and_a_good_one_is_not() {
    for glove in 1..=3 {
        for user in USERS {
            let noisy = |tracking| {
                let felt = two_minutes(glove, tracking, user, |worn| worn.feel(CALIBRATED_S, |_| 0.0));
                share_of(&felt, 25.0, 120.0, &[Adaptation::Noisy])
            };
            let (markers, camera) = (noisy(Tracking::Markers), noisy(Tracking::Camera));
            assert!(markers < 0.01 && camera > 0.3, "glove {glove}, user {user}: {markers} and {camera}");
        }
    }
}
