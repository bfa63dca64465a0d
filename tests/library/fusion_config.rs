//! A configuration of the core that exists is whole, and an index of another core is refused.

use std::sync::Arc;

use crate::common::fake::{Sum, config, config_of, contract, fusion, glove, joints, region, tactile, timing};
use tactile_pose_fusion::fusion::*;
use tactile_pose_fusion::units::{Newton, Stamp};

/// A configuration with one region, after a change of that region.
fn changed(change: &dyn Fn(&mut RegionConfig)) -> Result<FusionConfig, SetupError> {
    let mut one = region("index", &[0, 1], &["dip"]);
    change(&mut one);
    let hand = JointSource { name: "hand".into(), stamp_offset_ns: 0, scale: 1.0 };
    FusionConfig::new(vec![glove(2)], vec![hand], vec![one], timing())
}

fn index() -> String {
    "index".to_owned()
}

#[test]
fn a_config_that_is_not_whole_is_refused() {
    let refused = |change: &dyn Fn(&mut RegionConfig)| changed(change).unwrap_err();
    let no_source = SetupError::NoTactileSource { region: index(), got: 3, n_sources: 1 };
    assert_eq!(refused(&|region| region.source = TactileSourceIdx::at(3)), no_source);
    let no_taxel = SetupError::NoTaxel { region: index(), got: 2, n_taxels: 2 };
    assert_eq!(refused(&|region| region.taxels = vec![0, 2]), no_taxel);
    let forces = SetupError::ForceThresholds { region: index(), on: 0.5, off: 0.5 };
    assert_eq!(refused(&|region| region.contact.force_off = Newton(0.5)), forces);
    let never = |region: &mut RegionConfig| region.contact.force_on = Newton(f64::NAN);
    assert!(matches!(refused(&never), SetupError::ForceThresholds { .. }), "NaN is above nothing");
    let touches = SetupError::TouchThresholds { region: index(), on: 0.2, off: 0.4 };
    assert_eq!(refused(&|region| region.contact.touch = Some(TouchLevels { on: 0.2, off: 0.4 })), touches);
    let empty = FusionConfig::new(vec![glove(0)], vec![], vec![], timing()).unwrap_err();
    assert_eq!(empty, SetupError::EmptySource { source_name: "glove".to_owned() });
}

#[test]
fn a_config_that_does_not_fit_its_models_is_refused() {
    let refused =
        |cfg: FusionConfig, contract: Contract| Fusion::new(cfg, vec![Box::new(Sum { contract })]).unwrap_err();
    let no_model = SetupError::NoModel { region: index(), got: 1, n_models: 1 };
    let of_second = changed(&|region| region.model = ModelIdx::at(1)).unwrap();
    assert_eq!(refused(of_second, contract(4, 2, 1)), no_model);
    let one = || changed(&|_| {}).unwrap();
    for rate_hz in [0.0, -1.0, f64::INFINITY] {
        let no_rate = SetupError::NoRate { region: index(), got: rate_hz };
        assert_eq!(refused(one(), Contract { rate_hz, ..contract(4, 2, 1) }), no_rate);
    }
    let artifact = |n_taxels: usize, n_joints: usize| ArtifactModel {
        n_taxels,
        n_joints,
        shapes: vec![1.0; n_taxels * n_joints * ARTIFACT_BASIS],
        gain_variance: vec![0.1; n_taxels * n_joints],
        slip: 0.1,
        slip_common: 0.5,
        slip_time_s: 60.0,
        touch: vec![1.0; n_taxels],
        residual: vec![1.0; n_taxels],
        drift: Vec::new(),
        noise: Vec::new(),
        misfit: Vec::new(),
        uncertain_offsets: false,
        trust_inputs: false,
    };
    let with = |artifact: ArtifactModel, n_joints: usize| Contract {
        artifact: Some(Arc::new(artifact)),
        ..contract(4, 2, n_joints)
    };
    assert!(Fusion::new(one(), vec![Box::new(Sum { contract: with(artifact(2, 1), 0) })]).is_ok());
    let torn = ArtifactModel { residual: vec![1.0], ..artifact(2, 1) };
    for contract in [with(artifact(3, 1), 0), with(artifact(2, 1), 2), with(torn, 0)] {
        assert!(matches!(refused(one(), contract), SetupError::ArtifactModel { .. }));
    }
}

#[test]
fn what_is_made_of_a_config_is_whole() {
    let thumb = || RegionConfig { model: ModelIdx::at(1), ..region("thumb", &[1], &["pip"]) };
    let both = config(2, vec![region("index", &[0, 1], &["dip"]), thumb()]);
    let thumb_idx = both.region_named("thumb").unwrap();
    let only = both.clone().only(thumb_idx).unwrap();
    assert_eq!(only.regions(), [thumb()]);
    assert_eq!((only.region(thumb_idx), only.clone().only(thumb_idx)), (None, None), "it has no second region");

    let dip_alone = both.clone().with_joints_of(|region| (region.name == "thumb").then(Vec::new));
    let joints: Vec<_> = dip_alone.regions().iter().map(|region| region.joints.len()).collect();
    assert_eq!((joints, dip_alone.joint_sources().len()), (vec![1, 0], 1));
    let no_pose = both.clone().without_pose();
    assert!(no_pose.regions().iter().all(|region| region.joints.is_empty()) && no_pose.joint_sources().is_empty());

    let usual = both.regions()[0].contact;
    let got = both.clone().with_thresholds(&[usual]).unwrap_err();
    assert_eq!(got, SetupError::NThresholds { expected: 2, got: 1 });
    let upside_down = ContactThresholds { force_on: usual.force_off, force_off: usual.force_on, ..usual };
    let got = both.clone().with_thresholds(&[usual, upside_down]).unwrap_err();
    assert_eq!(got, SetupError::ForceThresholds { region: "thumb".to_owned(), on: 0.25, off: 0.5 });

    let mut core = fusion(both.clone(), vec![Sum::boxed(4, 2, 1), Sum::boxed(4, 1, 1)]);
    assert!(core.handle_thresholds(&[usual, upside_down]).is_err());
    assert_eq!(core.config(), &both, "nothing has changed");
    let firm = ContactThresholds { force_on: Newton(2.0), ..usual };
    core.handle_thresholds(&[usual, firm]).unwrap();
    assert_eq!(core.config().region(thumb_idx).unwrap().contact, firm);
}

#[test]
fn an_index_of_another_core_is_refused_and_changes_nothing() {
    let mut core = fusion(config_of(glove(2), vec![region("index", &[0, 1], &["dip"])]), vec![Sum::boxed(4, 2, 1)]);
    let before = format!("{core:?}");
    let (source, hand, other) = (TactileSourceIdx::at(1), JointSourceIdx::at(1), RegionIdx::at(1));

    let Event::Tactile(block) = tactile(Stamp(7), &[1.0, 2.0]) else { panic!() };
    let refused = core.handle(Event::Tactile(TactileBlock { source, ..block }));
    assert_eq!(refused, Err(FusionError::NoTactileSource { got: source, n_sources: 1 }));
    let Event::Joints(sample) = joints(Stamp(7), &[], &[]) else { panic!() };
    let refused = core.handle(Event::Joints(JointSample { source: hand, ..sample }));
    assert_eq!(refused, Err(FusionError::NoJointSource { got: hand, n_sources: 1 }));

    let no_source = Err(SetupError::UnknownTactileSource { got: source, n_sources: 1 });
    assert_eq!(core.handle_baseline(source, Baseline::from_median(vec![0.0; 2])), no_source);
    let no_region = Err(SetupError::UnknownRegion { got: other, n_regions: 1 });
    let fit = ArtifactFit { gains: vec![], offset: vec![], covariance: vec![], offset_covariance: vec![] };
    assert_eq!(core.handle_artifact(other, fit), no_region);
    assert_eq!(core.handle_force_gain(other, &ForceGain { gain: 1.0, low: 0.9, high: 1.1, touches: 3 }), no_region);

    assert!(core.baseline(source).is_none() && core.rate_fault(source).is_none());
    assert!(core.contract(other).is_none() && core.artifact(other).is_none() && core.force_gain(other).is_none());
    let cfg = core.config();
    assert!(cfg.tactile_source(source).is_none() && cfg.joint_source(hand).is_none() && cfg.region(other).is_none());
    assert_eq!((cfg.tactile_source_named("hand"), cfg.joint_source_named("glove")), (None, None));
    assert_eq!(format!("{core:?}"), before);
}
