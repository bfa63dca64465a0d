//! A session in the air on a synthetic glove, on whose taxels touches of any course are laid. SYNTHETIC.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tactile_pose_fusion::config::{self, Config, DEFAULT_NODE};
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::glove::{Models, replace_model};
use tactile_pose_fusion::sim::manipulation::{Episode, Start};
use tactile_pose_fusion::sim::{Activity, Conditions, Record, SessionSpec, Tracking, simulate};
use tactile_pose_fusion::units::{GramForce, Newton, Stamp};
use tactile_pose_fusion::zero::{ArtifactCollector, ArtifactTimes, Donning, Rest};

/// The hand is in the air at least until then, s: its calibration.
pub const CALIBRATED_S: f64 = 12.0;

/// A frame with an estimate.
pub struct Felt {
    pub at_s: f64,
    pub force_gf: f64,
    pub contact: bool,
    pub adaptation: Adaptation,
}

/// A session in the air on a glove.
pub struct Worn {
    cfg: Config,
    records: Vec<Record>,
    /// `[taxels]`, counts for each gF, as the sensor sends them.
    pattern: Vec<f64>,
    donning: Donning,
}

/// The adaptive model of a synthetic glove that ships.
pub fn shipped(glove: u8) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("models/glove{glove}_adaptive.onnx"))
}

/// The parameters of a synthetic glove, with this model, and the model.
pub fn setup(glove: u8, model: &Path) -> Result<(Config, Models), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut cfg = config::load(&root.join(format!("params/glove{glove}.yaml")), DEFAULT_NODE)?;
    replace_model(&mut cfg, model.to_path_buf())?;
    let models = Models::load(&cfg)?;
    cfg.set_batch(models.batch_hint());
    Ok((cfg, models))
}

impl Worn {
    /// So many minutes of a user that no model knows, with its calibration. Of the conditions, start and episodes are replaced.
    pub fn new(
        (glove, conditions): (u8, &Conditions),
        model: &Path,
        tracking: Tracking,
        user: u32,
        minutes: f64,
    ) -> Self {
        let (cfg, models) = setup(glove, model).unwrap();
        let conditions = Conditions { start: Start::InAir, episodes: vec![Episode::Air], ..conditions.clone() };
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
    pub fn feel(&self, from_s: f64, touch_gf: impl Fn(f64) -> f64) -> Vec<Felt> {
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

/// Touch from 40 to 100 s.
pub fn for_a_minute(force_gf: f64) -> impl Fn(f64) -> f64 {
    move |at_s| if (40.0..100.0).contains(&at_s) { force_gf } else { 0.0 }
}

/// A force that rises by 0.5 gF a second from 40 s on, to 30 gF.
pub fn slow_ramp(at_s: f64) -> f64 {
    (0.5 * (at_s - 40.0)).clamp(0.0, 30.0)
}

/// A grasp of ten minutes, from 40 s on.
pub fn long_grasp(at_s: f64) -> f64 {
    if (40.0..640.0).contains(&at_s) { 120.0 + 60.0 * (at_s / 2.0).sin() } else { 0.0 }
}

/// Share of the frames in a span of time, s, with contact, and their mean force, gF.
pub fn in_span(felt: &[Felt], from_s: f64, to_s: f64) -> (f64, f64) {
    let within: Vec<&Felt> = felt.iter().filter(|felt| (from_s..to_s).contains(&felt.at_s)).collect();
    assert!(within.len() > 50, "{} frames from {from_s} to {to_s} s", within.len());
    let n = within.len() as f64;
    let found = within.iter().filter(|felt| felt.contact).count() as f64;
    (found / n, within.iter().map(|felt| felt.force_gf).sum::<f64>() / n)
}
