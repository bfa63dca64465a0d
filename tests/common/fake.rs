//! A regressor whose answer can be worked out by hand, and a fusion setup around it.

use std::num::{NonZeroU32, NonZeroUsize};
use std::time::Duration;

use nalgebra::{Isometry3, Vector3};
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::units::{Newton, Stamp};

pub const MS: i64 = 1_000_000;

/// base = sum of the newest tactile frame plus a thousandth of the oldest one; force = base - sum of the newest pose.
#[derive(Debug)]
pub struct Sum {
    pub contract: Contract,
}

impl Sum {
    pub fn boxed(window: usize, n_taxels: usize, n_joints: usize) -> Box<dyn Regressor> {
        Box::new(Sum { contract: contract(window, n_taxels, n_joints) })
    }
}

pub fn contract(window: usize, n_taxels: usize, n_joints: usize) -> Contract {
    Contract {
        window: NonZeroUsize::new(window).unwrap(),
        n_taxels,
        n_joints,
        rate_hz: 100.0,
        unit: ForceUnit::Newton,
        axes: ForceAxes::Normal,
        touch: None,
        has_base: true,
        joints: None,
        artifact: None,
        pose_range: None,
        mdf: None,
        regions: Default::default(),
    }
}

impl Regressor for Sum {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        out.force.clear();
        out.base.clear();
        let (t, p, l) = (self.contract.n_columns(), self.contract.n_joints, self.contract.window.get());
        for &start in windows.starts {
            let tactile = &windows.tactile[start * t..(start + l) * t];
            let pose = &windows.pose[start * p..(start + l) * p];
            let base = tactile[(l - 1) * t..].iter().sum::<f32>() + 1e-3 * tactile[..t].iter().sum::<f32>();
            out.force.push(base - pose[(l - 1) * p..].iter().sum::<f32>());
            if self.contract.has_base {
                out.base.push(base);
            }
        }
        Ok(())
    }
}

pub fn region(name: &str, taxels: &[usize], joints: &[&str]) -> RegionConfig {
    RegionConfig {
        name: name.into(),
        source: TactileSourceIdx::at(0),
        taxels: taxels.to_vec(),
        joints: joints.iter().map(|joint| joint.to_string()).collect(),
        model_joints: Vec::new(),
        model: ModelIdx::at(0),
        patch: Patch {
            frame_id: format!("{name}_tip"),
            normal_in_patch: Vector3::z_axis(),
            frame_from_patch: Isometry3::identity(),
        },
        contact: ContactThresholds {
            by: ContactBy::Model,
            touch: None,
            touch_evidence: 0.0,
            force_on: Newton(0.5),
            force_off: Newton(0.25),
            on_frames: NonZeroU32::MIN,
            off_frames: NonZeroU32::MIN,
        },
    }
}

pub fn timing() -> Timing {
    Timing {
        max_gap: Duration::from_millis(50),
        joint_slack: Duration::from_millis(10),
        max_pose_age: Some(Duration::from_millis(50)),
        time_jump: Duration::from_millis(200),
        max_age: Some(Duration::from_millis(100)),
    }
}

/// One tactile source `glove`, one joint source `hand`.
pub fn config(n_taxels: usize, regions: Vec<RegionConfig>) -> FusionConfig {
    config_of(glove(n_taxels), regions)
}

/// A tactile source of frames at their own stamps.
pub fn glove(n_taxels: usize) -> TactileSource {
    let (name, frame_clock) = ("glove".into(), FrameClock::Tactile);
    TactileSource { name, n_taxels, stamp_offset_ns: 0, inverted: false, frame_clock }
}

/// The same for another tactile source.
pub fn config_of(source: TactileSource, regions: Vec<RegionConfig>) -> FusionConfig {
    let hand = JointSource { name: "hand".into(), stamp_offset_ns: 0, scale: 1.0 };
    FusionConfig::new(vec![source], vec![hand], regions, timing()).unwrap()
}

/// A number of frames in one inference call.
pub fn batch_of(n_frames: usize) -> NonZeroUsize {
    NonZeroUsize::new(n_frames).unwrap()
}

/// A calibrated core with a zero baseline.
pub fn fusion(cfg: FusionConfig, regressors: Vec<Box<dyn Regressor>>) -> Fusion {
    let mut fusion = Fusion::new(cfg.clone(), regressors).unwrap();
    for (source_idx, source) in cfg.tactile_source_idxs().zip(cfg.tactile_sources()) {
        fusion.handle_baseline(source_idx, Baseline::from_median(vec![0.0; source.n_taxels])).unwrap();
    }
    fusion
}

/// A sample that owns its data, so that orders of arrival can be shuffled.
#[derive(Debug, Clone)]
pub enum Sample {
    Tactile { at_ns: i64, values: Vec<f32> },
    Joints { at_ns: i64, names: Vec<String>, positions: Vec<f64> },
}

impl Sample {
    pub fn tactile(at_ms: f64, values: &[f32]) -> Sample {
        Sample::Tactile { at_ns: (at_ms * 1e6) as i64, values: values.to_vec() }
    }

    pub fn joints(at_ms: f64, angles: &[(&str, f64)]) -> Sample {
        let (names, positions) = angles.iter().map(|(name, angle)| (name.to_string(), *angle)).unzip();
        Sample::Joints { at_ns: (at_ms * 1e6) as i64, names, positions }
    }

    pub fn at_ns(&self) -> i64 {
        match self {
            Sample::Tactile { at_ns, .. } | Sample::Joints { at_ns, .. } => *at_ns,
        }
    }

    pub fn event(&self) -> Event<'_> {
        match self {
            Sample::Tactile { at_ns, values } => tactile(Stamp(*at_ns), values),
            Sample::Joints { at_ns, names, positions } => joints(Stamp(*at_ns), names, positions),
        }
    }
}

/// One frame of the glove, which comes at once.
pub fn tactile(stamp: Stamp, values: &[f32]) -> Event<'_> {
    Event::Tactile(TactileBlock {
        source: TactileSourceIdx::at(0),
        stamp,
        rows: 1,
        row_period_ns: 0,
        sequence: None,
        values,
        received: stamp,
    })
}

/// One joint state of the hand, which comes at once.
pub fn joints<'a>(stamp: Stamp, names: &'a [String], positions: &'a [f64]) -> Event<'a> {
    Event::Joints(JointSample { source: JointSourceIdx::at(0), stamp, names, positions, received: stamp })
}

/// Every estimate of a run, each with the stamp of its frame.
pub fn run(fusion: &mut Fusion, samples: &[Sample]) -> Vec<(Stamp, Estimate)> {
    let mut estimates = Vec::new();
    let mut drain = |fusion: &mut Fusion| {
        while let Some(tick) = fusion.poll().unwrap() {
            estimates.extend(tick.estimates.iter().map(|estimate| (tick.stamp, *estimate)));
        }
    };
    for sample in samples {
        fusion.handle(sample.event()).unwrap();
        drain(fusion);
    }
    fusion.handle_end();
    drain(fusion);
    estimates
}
