//! Made-up taxels with a known artifact: what is followed, and what must not be.

use std::sync::Arc;

use super::*;

const TAXELS: usize = 6;
const JOINTS: usize = 4;
const HZ: f64 = 100.0;

/// Numbers between -1 and 1 that look random.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }
}

fn model() -> Arc<ArtifactModel> {
    let mut noise = Noise(5);
    let model = ArtifactModel {
        n_taxels: TAXELS,
        n_joints: JOINTS,
        shapes: (0..TAXELS * JOINTS)
            .flat_map(|_| [60.0, 25.0, -20.0, -8.0].map(|size| size * (1.0 + 0.8 * noise.next())))
            .collect(),
        gain_variance: vec![0.1; TAXELS * JOINTS],
        slip: 0.35,
        slip_common: 0.5,
        slip_time_s: 90.0,
        touch: (0..TAXELS).map(|taxel| 6.0 + taxel as f64).collect(),
        residual: vec![60.0; TAXELS],
        drift: Vec::new(),
        noise: Vec::new(),
        misfit: Vec::new(),
        uncertain_offsets: false,
        trust_inputs: false,
    };
    model.check().unwrap();
    Arc::new(model)
}

/// Fingers by a seed: with steady offsets, and with offsets that drift and a model that knows it.
const MAKES: [fn(u64) -> Finger; 2] = [Finger::new, |seed| Finger::drifting(seed, true)];

/// A finger that moves, with gains that slip, noise, and a touch of so many gF.
struct Finger {
    model: Arc<ArtifactModel>,
    history: JointHistory,
    gains: Vec<f64>,
    /// How far its joints turn to both sides of their middle, rad.
    reach: f64,
    /// How far gains slip, in the usual slip.
    slip: f64,
    /// How far each offset drifts to both sides of its mean.
    drift: f64,
    phase: f64,
    noise: Noise,
    frame: usize,
}

impl Finger {
    fn new(seed: u64) -> Self {
        let mut noise = Noise(seed);
        let gains = (0..TAXELS * JOINTS).map(|_| 1.0 + 0.4 * noise.next()).collect();
        Finger {
            model: model(),
            history: JointHistory::new(JOINTS, HZ),
            gains,
            reach: 0.6,
            slip: 1.0,
            drift: 0.0,
            phase: 0.0,
            noise,
            frame: 0,
        }
    }

    /// One whose offsets drift, and whose model knows that or does not.
    fn drifting(seed: u64, is_known: bool) -> Self {
        let mut finger = Finger { drift: 50.0, phase: std::f64::consts::FRAC_PI_4 * seed as f64, ..Finger::new(seed) };
        if is_known {
            finger.model = Arc::new(ArtifactModel { drift: vec![45.0; TAXELS], ..ArtifactModel::clone(&finger.model) });
        }
        finger
    }

    /// A frame, its angles, and the artifact in it.
    fn frame(&mut self, touch_gf: f64) -> ([f32; TAXELS], [f32; JOINTS], [f64; TAXELS]) {
        let at_s = self.frame as f64 / HZ;
        self.frame += 1;
        let pose: [f32; JOINTS] = std::array::from_fn(|joint| {
            let period_s = 3.1 + 1.7 * joint as f64;
            (0.6 + self.reach * (std::f64::consts::TAU * at_s / period_s + joint as f64).sin()) as f32
        });
        self.history.advance(&pose, 1);
        let mut shapes = [0.0; TAXELS * JOINTS];
        self.model.write_shapes(self.history.basis(), JOINTS, &mut shapes);
        // Slip: all gains of a joint wander together, and each by itself.
        let slow = |period_s: f64, phase: f64| (std::f64::consts::TAU * at_s / period_s + phase).sin();
        let artifact: [f64; TAXELS] = std::array::from_fn(|taxel| {
            let of_joint = |joint: usize| {
                let gain = taxel * JOINTS + joint;
                let slip = 0.3 * slow(210.0, joint as f64) + 0.2 * slow(160.0, gain as f64);
                self.gains[gain] * (1.0 + self.slip * slip) * shapes[gain]
            };
            let drifted = self.drift * slow(900.0 + 80.0 * taxel as f64, self.phase + 0.7 * taxel as f64);
            (0..JOINTS).map(of_joint).sum::<f64>() - 40.0 + drifted
        });
        let tactile = std::array::from_fn(|taxel| {
            (artifact[taxel] + self.model.touch[taxel] * touch_gf + 5.0 * self.noise.next()) as f32
        });
        (tactile, pose, artifact)
    }

    /// A calibration of ten seconds.
    fn calibration(&mut self) -> ArtifactFit {
        let mut fitter = ArtifactFitter::new(self.model.clone(), HZ, None);
        for _ in 0..1000 {
            let (tactile, pose, _) = self.frame(0.0);
            fitter.handle_frame(&tactile, &pose, 1, true);
        }
        fitter.finish().unwrap()
    }

    /// A filter that was calibrated in the first ten seconds.
    fn calibrated(&mut self, following: Following) -> ArtifactFilter {
        let fit = self.calibration();
        let mut filter = ArtifactFilter::new(self.model.clone(), HZ, following);
        filter.handle_fit(fit).unwrap();
        filter
    }

    /// Touch that corrected taxels show, gF, over so many seconds: its mean and its deviation.
    fn feel(&mut self, filter: &mut ArtifactFilter, seconds: f64, touch_gf: impl Fn(f64) -> f64) -> (f64, f64) {
        let n = (seconds * HZ) as usize;
        let (mut sum, mut squares) = (0.0, 0.0);
        let square: f64 = self.model.touch.iter().map(|touch| touch * touch).sum();
        for k in 0..n {
            let (mut tactile, pose, _) = self.frame(touch_gf(k as f64 / HZ));
            filter.correct(&mut tactile, Some(&pose), 1, true);
            let along = tactile.iter().zip(&self.model.touch).map(|(value, touch)| f64::from(*value) * touch);
            let felt = along.sum::<f64>() / square;
            sum += felt;
            squares += felt * felt;
        }
        let mean = sum / n as f64;
        (mean, (squares / n as f64 - mean * mean).max(0.0).sqrt())
    }
}

#[test]
fn slipping_gains_are_followed_and_frozen_ones_are_not() {
    for seed in 0..5 {
        let [followed, frozen] = [Following::On, Following::Frozen].map(|following| {
            let mut finger = Finger::new(seed);
            let mut filter = finger.calibrated(following);
            finger.feel(&mut filter, 60.0, |_| 0.0);
            finger.feel(&mut filter, 60.0, |_| 0.0).1
        });
        assert!(followed < 0.8 && frozen > 3.0 * followed, "seed {seed}: {followed} gF followed, {frozen} gF frozen");
    }
}

#[test]
fn drifting_offsets_are_followed_by_a_model_that_knows_of_drift() {
    let mut left = [0.0; 2];
    for seed in 0..6 {
        for (left, is_known) in left.iter_mut().zip([true, false]) {
            let mut finger = Finger::drifting(seed, is_known);
            let mut filter = finger.calibrated(Following::On);
            let calibrated = filter.fit().unwrap();
            finger.feel(&mut filter, 120.0, |_| 0.0);
            for _ in 0..6 {
                *left += finger.feel(&mut filter, 10.0, |_| 0.0).0.powi(2);
            }
            // What was followed is kept with the calibration.
            assert_eq!(filter.fit().unwrap().offset != calibrated.offset, is_known);
        }
    }
    let [known, unknown] = left.map(|squares| (squares / 36.0_f64).sqrt());
    assert!(
        known < 0.6 * unknown,
        "{known} gF on average in the air where drift is known, {unknown} gF where it is not"
    );
}

/// A model whose calibration says how uncertain its offsets are.
fn uncertain(model: &ArtifactModel) -> Arc<ArtifactModel> {
    Arc::new(ArtifactModel { uncertain_offsets: true, ..model.clone() })
}

#[test]
fn a_calibration_in_few_poses_says_how_far_its_offsets_are_off() {
    let (mut errors, mut shares, mut n) = (0.0, 0.0, 0.0);
    for seed in 0..12 {
        let mut finger = Finger { reach: 0.1, drift: 0.0, ..Finger::drifting(seed, true) };
        finger.model = uncertain(&finger.model);
        let fit = finger.calibration();
        for (offset, covariance) in fit.offset.iter().zip(fit.offset_covariance.chunks_exact(JOINTS + 1)) {
            let error = offset + 40.0;
            errors += error * error;
            shares += error * error / covariance[JOINTS];
            n += 1.0;
            // Shapes are positive at these poses: an offset that is too high goes with gains that are too low.
            assert!(covariance[..JOINTS].iter().sum::<f64>() < 0.0, "{covariance:?}");
        }
    }
    let (error, share) = ((errors / n).sqrt(), (shares / n).sqrt());
    assert!(error > 2.0 && (0.2..2.0).contains(&share), "off by {error}, {share} of what it says");
}

#[test]
fn a_calibration_knows_that_gains_slip_meanwhile() {
    let covariance = |slip: f64| {
        let mut finger = Finger::drifting(1, true);
        finger.model = Arc::new(ArtifactModel { slip, ..ArtifactModel::clone(&uncertain(&finger.model)) });
        finger.calibrated(Following::On).fit().unwrap().covariance
    };
    let (steady, slipping) = (covariance(0.0), covariance(0.35));
    let variances = |of: &[f64]| (0..TAXELS * JOINTS).map(|gain| of[gain * JOINTS + gain % JOINTS]).sum::<f64>();
    assert!(variances(&slipping) > 2.0 * variances(&steady), "{} and {}", variances(&slipping), variances(&steady));
}

/// The artifact model of so many donnings of so many minutes, with a touch of 20 gF every ten seconds.
fn learned_from(n_donnings: u64, minutes: usize, finger: impl Fn(u64) -> Finger) -> ArtifactModel {
    let n = minutes * 60 * HZ as usize;
    let recorded: Vec<(Vec<f32>, Vec<f32>, Vec<f32>)> = (0..n_donnings)
        .map(|seed| {
            let mut finger = finger(seed);
            let mut donning = (Vec::new(), Vec::new(), Vec::new());
            for frame in 0..n {
                let force = if frame % 1000 < 100 { 20.0 } else { 0.0 };
                let (tactile, pose, _) = finger.frame(force);
                donning.0.extend(tactile);
                donning.1.extend(pose);
                donning.2.push(force as f32);
            }
            donning
        })
        .collect();
    let (epoch, is_learned) = (vec![0; n], vec![true; n]);
    let donnings = recorded.iter().map(|(tactile, pose, truth_gf)| DonningFrames {
        tactile,
        pose,
        truth_gf,
        epoch: &epoch,
        learned: &is_learned,
    });
    learn_artifact(&donnings.collect::<Vec<_>>(), (TAXELS, JOINTS), HZ).unwrap()
}

/// A finger whose artifact has friction: each shape has both play operators.
fn with_friction(seed: u64) -> Finger {
    let mut finger = Finger::new(seed);
    let of_joints = finger.model.shapes.chunks_exact(FRICTIONLESS_BASIS);
    let shapes = of_joints.flat_map(|shape| shape.iter().copied().chain([0.8 * shape[0], 0.5 * shape[0]])).collect();
    finger.model = Arc::new(ArtifactModel { shapes, ..ArtifactModel::clone(&finger.model) });
    finger.model.check().unwrap();
    finger
}

#[test]
fn friction_is_learned_from_several_donnings() {
    let model = learned_from(3, 3, with_friction);
    let truth = &with_friction(0).model;
    assert_eq!(model.shapes.len(), TAXELS * JOINTS * ARTIFACT_BASIS);
    let frictions = |model: &ArtifactModel| -> f64 {
        let shapes = model.shapes.chunks_exact(ARTIFACT_BASIS);
        shapes.map(|shape| shape[4] + shape[5]).sum::<f64>() / (TAXELS * JOINTS) as f64
    };
    let (learned, truth) = (frictions(&model), frictions(truth));
    let without = frictions(&learned_from(3, 3, Finger::new));
    // Weights are drawn to 0, most of all those of functions that change little.
    assert!((0.3..1.5).contains(&(learned / truth)), "{learned}, {truth} in truth");
    assert!(without.abs() < 0.3 * learned, "{without} without friction, {learned} with it");
    // One donning does not tell friction from slip.
    let model = learned_from(1, 3, with_friction);
    assert_eq!(model.shapes.len(), TAXELS * JOINTS * FRICTIONLESS_BASIS);
    assert!(model.noise.is_empty() && model.misfit.is_empty());
}

#[test]
fn training_learns_the_noise_of_a_frame_and_what_shapes_have_wrong() {
    let with = learned_from(3, 3, with_friction);
    // Even numbers of -5 to 5 have a variance of 25 / 3.
    assert!(with.noise.iter().all(|noise| (noise - 25.0 / 3.0).abs() < 0.8), "{:?}", with.noise);
    let worst = with.misfit.iter().zip(&with.residual).map(|(misfit, residual)| misfit / residual).fold(0.0, f64::max);
    assert!(worst < 0.5, "{worst} of the residual, which is mostly slip");
}

#[test]
fn taxels_that_shapes_describe_better_count_more() {
    // What is left of a touch that is hardly there tells how fast the filter learns.
    let left = |noise: f64, misfit: f64| {
        let mut finger = Finger::new(2);
        let known = ArtifactModel {
            noise: vec![noise; TAXELS],
            misfit: vec![misfit; TAXELS],
            ..ArtifactModel::clone(&finger.model)
        };
        finger.model = Arc::new(known);
        let mut filter = finger.calibrated(Following::On);
        finger.feel(&mut filter, 60.0, |_| 0.0);
        finger.feel(&mut filter, 60.0, |_| 0.0).1
    };
    let (exact, rough, noisy) = (left(8.0, 1.0), left(8.0, 1e5), left(1e6, 1.0));
    assert!(exact < 0.8 * rough && exact < 0.8 * noisy, "{exact}, {rough} with a misfit, {noisy} with noise");
}

#[test]
fn training_learns_how_far_offsets_drift() {
    const MINUTES: usize = 6;
    let learned = |drift: f64| -> f64 {
        let model = learned_from(3, MINUTES, |seed| Finger { drift, ..Finger::drifting(seed, false) });
        model.drift.iter().sum::<f64>() / TAXELS as f64
    };
    // A sine of 100 has a deviation of 71.
    let (drifting, steady) = (learned(100.0), learned(0.0));
    assert!((35.0..140.0).contains(&drifting) && steady < 0.3 * drifting, "{drifting} of 71, {steady} of 0");
}

#[test]
fn training_learns_how_far_gains_slip() {
    const MINUTES: usize = 6;
    let learned = |slip: f64| learned_from(3, MINUTES, |seed| Finger { slip, ..Finger::new(seed) }).slip;
    // Two sines of 0.3 and 0.2 have a deviation of 0.25. One and a half times that is assumed.
    let (slipping, steady) = (learned(1.0), learned(0.0));
    assert!((0.27..0.53).contains(&slipping) && steady < 0.13, "{slipping} of 0.38, {steady} of 0");
    // The shapes of one donning have taken a part of its slip, so that it is not learned.
    let of_one = learned_from(1, MINUTES, |seed| Finger { slip: 0.0, ..Finger::new(seed) }).slip;
    assert!((of_one - 0.3).abs() < 1e-9, "{of_one}");
}

#[test]
fn a_held_touch_is_not_learned_away() {
    for make in MAKES {
        held_touches_are_kept(make);
    }
}

fn held_touches_are_kept(make: fn(u64) -> Finger) {
    const SEEDS: u64 = 8;
    for (touch_gf, on_average, at_least) in
        [(5.0, 0.8, 0.6), (10.0, 0.95, 0.85), (20.0, 0.95, 0.9), (100.0, 0.95, 0.95)]
    {
        let mut kept = 0.0;
        for seed in 0..SEEDS {
            let mut finger = make(seed);
            let mut filter = finger.calibrated(Following::On);
            finger.feel(&mut filter, 30.0, |_| 0.0);
            let early = finger.feel(&mut filter, 2.0, |_| touch_gf).0;
            finger.feel(&mut filter, 56.0, |_| touch_gf);
            let late = finger.feel(&mut filter, 2.0, |_| touch_gf).0;
            assert!(late > at_least * early, "seed {seed}, {touch_gf} gF: {early} after 1 s, {late} after a minute");
            kept += late / early / SEEDS as f64;
            let released = finger.feel(&mut filter, 2.0, |_| 0.0);
            // A drift of up to 1 gF came meanwhile, and the touch hid it.
            let most = if finger.drift > 0.0 { 2.5 } else { 1.5 };
            assert!(released.0.abs() < most, "seed {seed}, {touch_gf} gF: {released:?} when it is over");
        }
        assert!(kept > on_average, "{touch_gf} gF: {kept} kept on average");
    }
}

#[test]
fn a_slow_ramp_is_touch() {
    for make in MAKES {
        for seed in 0..5 {
            let mut finger = make(seed);
            let mut filter = finger.calibrated(Following::On);
            finger.feel(&mut filter, 20.0, |_| 0.0);
            finger.feel(&mut filter, 20.0, |at_s| at_s * 0.5); // half a gF a second
            let felt = finger.feel(&mut filter, 2.0, |_| 10.0).0;
            assert!(felt > 7.0, "seed {seed}: {felt} of 10 gF");
        }
    }
}

#[test]
fn minutes_of_grasp_teach_nothing_wrong() {
    for (make, seeds) in MAKES.into_iter().zip([3, 1]) {
        for seed in 0..seeds {
            let mut finger = make(seed);
            let mut filter = finger.calibrated(Following::On);
            finger.feel(&mut filter, 600.0, |at_s| 120.0 + 60.0 * (at_s / 2.0).sin());
            finger.feel(&mut filter, 5.0, |_| 0.0);
            let air = finger.feel(&mut filter, 5.0, |_| 0.0);
            assert!(air.0.abs() < 3.0 && air.1 < 3.0, "seed {seed}: {air:?} gF in the air");
        }
    }
}

#[test]
fn what_is_left_of_a_grasp_that_is_let_go_in_part_stays_touch() {
    for make in MAKES {
        for seed in 0..5 {
            let mut finger = make(seed);
            let mut filter = finger.calibrated(Following::On);
            finger.feel(&mut filter, 60.0, |at_s| 120.0 + 60.0 * (at_s / 2.0).sin());
            finger.feel(&mut filter, 1.0, |_| 30.0);
            let (at_first, _) = finger.feel(&mut filter, 2.0, |_| 30.0);
            finger.feel(&mut filter, 26.0, |_| 30.0);
            let (at_last, _) = finger.feel(&mut filter, 2.0, |_| 30.0);
            assert!(at_first > 25.0 && at_last > 25.0, "seed {seed}: {at_first}, then {at_last} of 30 gF");
            finger.feel(&mut filter, 1.0, |_| 0.0);
            let air = finger.feel(&mut filter, 5.0, |_| 0.0);
            assert!(air.0.abs() < 3.0 && air.1 < 3.0, "seed {seed}: {air:?} gF in the air");
        }
    }
}

#[test]
fn what_can_not_teach_is_not_learned_and_said() {
    let mut finger = Finger::new(1);
    let mut filter = finger.calibrated(Following::On);
    let start = filter.clone();
    let (tactile, pose, _) = finger.frame(0.0);
    let mut corrected = tactile;
    for _ in 0..100 {
        corrected = tactile;
        assert_eq!(filter.correct(&mut corrected, Some(&pose), 1, false), Adaptation::Waiting);
    }
    assert_eq!(filter.fit(), start.fit());
    let mut without_pose = tactile;
    assert_eq!(filter.correct(&mut without_pose, None, 1, true), Adaptation::Waiting);
    assert_eq!(without_pose, corrected, "the artifact of the last angles is taken out");
    assert_eq!(filter.fit(), start.fit());
    let mut new = ArtifactFilter::new(finger.model.clone(), HZ, Following::On);
    let mut values = tactile;
    assert_eq!(new.correct(&mut values, None, 1, true), Adaptation::Frozen);
    assert_eq!(values, tactile, "nobody knows any angle");
    assert_eq!(new.correct(&mut values, Some(&pose), 1, true), Adaptation::Frozen, "there is no calibration");
    let mut off = ArtifactFilter::new(finger.model.clone(), HZ, Following::Off);
    let mut values = tactile;
    assert_eq!(off.correct(&mut values, Some(&pose), 1, true), Adaptation::Off);
    assert_eq!(values, tactile);
}

#[test]
fn a_state_that_was_kept_is_taken_up_again() {
    let mut finger = Finger::new(2);
    let mut filter = finger.calibrated(Following::On);
    finger.feel(&mut filter, 100.0, |_| 0.0);
    let kept = filter.fit().unwrap();
    let mut again = ArtifactFilter::new(finger.model.clone(), HZ, Following::On);
    again.handle_fit(kept).unwrap();
    let felt = finger.feel(&mut again, 3.0, |_| 0.0);
    assert!(felt.0.abs() < 1.0 && felt.1 < 1.5, "{felt:?}");
}

#[test]
fn a_start_in_contact_is_touch() {
    for make in MAKES {
        for seed in 0..5 {
            let mut finger = make(seed);
            let mut filter = finger.calibrated(Following::On);
            filter.restart();
            let felt = finger.feel(&mut filter, 10.0, |_| 15.0).0;
            assert!(felt > 13.0, "seed {seed}: {felt} of 15 gF");
        }
    }
}

#[test]
fn what_does_not_fit_is_refused_with_the_reason() {
    let good = model();
    type Change = fn(&mut ArtifactModel);
    let changes: [(Change, &str); 13] = [
        (|model| model.n_joints = 0, "0 joints"),
        (|model| model.n_taxels = 4000, "expected 1 to 400"),
        (|model| model.shapes.truncate(95), "95 numbers in shapes, expected 96 or 144"),
        (|model| model.residual[2] = 0.0, "a variance in residual that is not positive"),
        (|model| model.touch.fill(0.0), "touch is 0 for every taxel"),
        (|model| model.drift = vec![1.0], "1 numbers in drift, expected 6 or none"),
        (|model| model.drift = vec![f64::NAN; TAXELS], "a number in drift that is not 0 to 1000000"),
        (|model| model.uncertain_offsets = true, "uncertain_offsets without drift"),
        (|model| model.noise = vec![1.0; TAXELS], "0 numbers in misfit, expected 6, or none in both noise and misfit"),
        (|model| model.misfit = vec![1.0; TAXELS], "0 numbers in noise, expected 6"),
        (
            |model| (model.noise, model.misfit) = (vec![1.0; TAXELS], vec![-1.0; TAXELS]),
            "a variance in misfit that is not 0 to 1e12",
        ),
        (|model| (model.noise, model.misfit) = (vec![0.0; TAXELS], vec![1.0; TAXELS]), "a variance in noise that is 0"),
        (|model| model.slip_time_s = f64::NAN, "slip_time_s NaN"),
    ];
    for (change, expected) in changes {
        let mut model = (*good).clone();
        change(&mut model);
        let refused = model.check().unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }
    let fit =
        ArtifactFit { gains: vec![1.0; 3], offset: vec![0.0; TAXELS], covariance: vec![], offset_covariance: vec![] };
    let refused = ArtifactFilter::new(good, HZ, Following::On).handle_fit(fit).unwrap_err();
    assert_eq!(refused.to_string(), "3 numbers in gains, expected 24");
    let mut finger = Finger::drifting(0, true);
    finger.model = uncertain(&finger.model);
    let good = finger.calibrated(Following::On).fit().unwrap();
    type Break = fn(&mut ArtifactFit);
    let breaks: [(Break, &str); 5] = [
        (|fit| fit.offset[1] = f64::NAN, "a number in offset that is not finite"),
        (|fit| fit.gains[1] = 1e13, "a number in gains that is not finite, or beyond 1e12"),
        (|fit| fit.covariance[5] = -1.0, "a variance in covariance that is not positive"),
        (|fit| fit.offset_covariance[4] = -1.0, "a variance in offset_covariance that is negative"),
        (|fit| fit.offset_covariance.truncate(7), "7 numbers in offset_covariance, expected 30"),
    ];
    for (change, expected) in breaks {
        let mut fit = good.clone();
        change(&mut fit);
        let refused = fit.check(&finger.model).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }
}

#[test]
fn readings_beyond_all_reason_break_nothing_that_comes_after() {
    for size in [1e3_f32, 1e9, 1e20, 1e38] {
        let mut finger = Finger::new(3);
        let mut filter = finger.calibrated(Following::On);
        finger.feel(&mut filter, 20.0, |_| 0.0);
        for k in 0..500 {
            let (mut tactile, mut pose, _) = finger.frame(0.0);
            tactile
                .iter_mut()
                .enumerate()
                .for_each(|(idx, value)| *value = if (k + idx) % 3 == 0 { size } else { -size });
            pose[k % JOINTS] = if k % 7 == 0 { size } else { pose[k % JOINTS] };
            filter.correct(&mut tactile, Some(&pose), 1, true);
        }
        finger.feel(&mut filter, 120.0, |_| 0.0);
        let felt = finger.feel(&mut filter, 20.0, |_| 0.0);
        assert!(felt.0.abs() < 3.0 && felt.1 < 3.0, "{size}: {felt:?}");
        assert!(filter.fit().unwrap().gains.iter().all(|gain| gain.is_finite()));
    }
}

/// Frames of a finger whose angles have errors of 5 degrees that stay for three frames, as a camera's.
fn seen_by_a_camera(finger: &mut Finger, held: &mut [f32; JOINTS], touch_gf: f64) -> ([f32; TAXELS], [f32; JOINTS]) {
    let (tactile, pose, _) = finger.frame(touch_gf);
    if finger.frame.is_multiple_of(3) {
        let mut error = || (0..6).map(|_| finger.noise.next()).sum::<f64>() * 5f64.to_radians() / 2f64.sqrt();
        *held = pose.map(|angle| angle + error() as f32);
    }
    (tactile, *held)
}

#[test]
fn noise_of_the_angles_is_noise_of_the_taxels_and_a_touch_must_be_clearer() {
    for seed in 0..4 {
        let mut finger = Finger::new(seed);
        let mut filter = finger.calibrated(Following::On);
        finger.feel(&mut filter, 30.0, |_| 0.0);
        assert_eq!(filter.touch_margin(), 0.0);
        let (mut held, mut states) = ([0.0; JOINTS], Vec::new());
        for _ in 0..3000 {
            let (mut tactile, pose) = seen_by_a_camera(&mut finger, &mut held, 0.0);
            states.push(filter.correct(&mut tactile, Some(&pose), 1, true));
        }
        assert!(filter.touch_margin() > 0.5, "seed {seed}: {}", filter.touch_margin());
        assert!(states[1500..].contains(&Adaptation::Noisy) && !states[1500..].contains(&Adaptation::Learning));
        finger.feel(&mut filter, 30.0, |_| 0.0);
        assert_eq!(filter.touch_margin(), 0.0, "seed {seed}: a good tracker again");
    }
}

#[test]
fn with_noisy_angles_a_network_that_is_told_of_them_must_show_a_touch_for_longer() {
    let evidence = |trust_inputs: bool, is_noisy: bool| {
        let mut finger = Finger::new(1);
        finger.model = Arc::new(ArtifactModel { trust_inputs, ..ArtifactModel::clone(&finger.model) });
        let mut filter = finger.calibrated(Following::On);
        finger.feel(&mut filter, 30.0, |_| 0.0);
        let mut held = [0.0; JOINTS];
        for _ in 0..if is_noisy { 3000 } else { 0 } {
            let (mut tactile, pose) = seen_by_a_camera(&mut finger, &mut held, 0.0);
            filter.correct(&mut tactile, Some(&pose), 1, true);
        }
        (filter.evidence_margin(), filter.touch_margin())
    };
    assert_eq!(evidence(true, false), (0.0, 0.0));
    let told = evidence(true, true);
    assert!((0.5..=1.0).contains(&told.0) && told.1 == 0.0, "{told:?}");
    let not_told = evidence(false, true);
    assert!(not_told.0 == 0.0 && not_told.1 > 0.5, "{not_told:?}");
}

#[test]
fn noise_of_the_angles_is_not_learned_as_a_change_of_gains() {
    for seed in 0..4 {
        let mut finger = Finger::new(seed);
        let mut filter = finger.calibrated(Following::On);
        let mut held = [0.0; JOINTS];
        for _ in 0..6000 {
            let (mut tactile, pose) = seen_by_a_camera(&mut finger, &mut held, 0.0);
            filter.correct(&mut tactile, Some(&pose), 1, true);
        }
        let change = filter.change();
        let felt = finger.feel(&mut filter, 1.0, |_| 0.0);
        assert!(
            change < 0.4 && felt.0.abs() < 2.0,
            "seed {seed}: gains changed by {change}, and good angles leave {felt:?}"
        );
    }
}

#[test]
fn a_light_touch_is_told_from_errors_of_the_angles() {
    for seed in 0..5 {
        let mut finger = Finger::new(seed);
        let mut filter = finger.calibrated(Following::On);
        finger.feel(&mut filter, 30.0, |_| 0.0);
        let mut held = [0.0; JOINTS];
        let mut seen = |touch_gf: f64| {
            let mut readings = Vec::new();
            for frame in 0..2000 {
                let (mut tactile, pose) = seen_by_a_camera(&mut finger, &mut held, touch_gf);
                filter.correct(&mut tactile, Some(&pose), 1, true);
                readings.extend((frame >= 200).then(|| filter.touch_gf()));
            }
            readings.sort_by(f64::total_cmp);
            (readings[0], readings[readings.len() / 2])
        };
        let (air, touched) = (seen(0.0), seen(8.0));
        assert!(air.1.abs() < 0.6, "seed {seed}: {air:?} in the air");
        assert!(touched.0 > 2.5 && touched.1 > 6.0, "seed {seed}: {touched:?} of 8 gF");
    }
}

#[test]
fn a_touch_beyond_doubt_is_told_for_as_long_as_it_is_measured() {
    for seed in 0..5 {
        let mut finger = Finger::new(seed);
        let mut filter = finger.calibrated(Following::On);
        finger.feel(&mut filter, 30.0, |_| 0.0);
        assert_eq!(filter.held_touch_gf(), None, "seed {seed}: in the air");
        finger.feel(&mut filter, 10.0, |_| 15.0);
        let held = filter.held_touch_gf();
        assert!(held.is_some_and(|held| (10.0..20.0).contains(&held)), "seed {seed}: {held:?} of 15 gF");
        let mut lost = filter.clone();
        let without_angles = |filter: &mut ArtifactFilter, finger: &mut Finger, n: usize| {
            for _ in 0..n {
                let mut tactile = finger.frame(15.0).0;
                filter.correct(&mut tactile, None, 1, true);
            }
        };
        without_angles(&mut lost, &mut finger, 15);
        assert!(lost.held_touch_gf().is_some(), "seed {seed}: for a moment without angles");
        without_angles(&mut lost, &mut finger, 30);
        assert_eq!(lost.held_touch_gf(), None, "seed {seed}: 0.45 s without angles");
        filter.restart();
        assert_eq!(filter.held_touch_gf(), None, "seed {seed}: after a gap");
        let mut frozen = Finger::new(seed);
        let mut filter = frozen.calibrated(Following::Frozen);
        frozen.feel(&mut filter, 10.0, |_| 15.0);
        assert_eq!(filter.held_touch_gf(), None, "seed {seed}: gains that are not followed");
    }
}

#[test]
fn a_touch_beyond_doubt_stays_so_while_it_is_fainter_until_it_ends() {
    for seed in 0..5 {
        let mut finger = Finger::new(seed);
        let mut filter = finger.calibrated(Following::On);
        finger.feel(&mut filter, 30.0, |_| 0.0);
        // How many of 200 measurements of a touch are beyond doubt, ten seconds after it began.
        let mut told = |filter: &mut ArtifactFilter, before: &dyn Fn(f64) -> f64, touch_gf: f64| {
            finger.feel(filter, 10.0, before);
            let of_measurement = |_: &usize| {
                finger.feel(filter, 0.05, |_| touch_gf);
                filter.held_touch_gf().is_some()
            };
            (0..200).filter(of_measurement).count()
        };
        assert_eq!(told(&mut filter.clone(), &|_| 4.0, 4.0), 0, "seed {seed}: 4 gF that were no more before");
        told(&mut filter, &|_| 15.0, 15.0);
        let after = told(&mut filter, &|at_s| 15.0 - 1.1 * at_s, 4.0);
        assert!(after > 50, "seed {seed}: {after} of 200 measurements of 4 gF that were 15 gF");
        assert_eq!(told(&mut filter, &|_| 0.0, 0.0), 0, "seed {seed}: in the air");
    }
}

/// A finger whose network is told how far taxels can be trusted.
fn trusting(seed: u64) -> Finger {
    let mut finger = Finger::new(seed);
    finger.model = Arc::new(ArtifactModel { trust_inputs: true, ..ArtifactModel::clone(&finger.model) });
    finger
}

/// What a network is told, gF.
fn told(filter: &ArtifactFilter) -> [f64; TRUST_INPUTS] {
    let reading = model().touch.iter().sum::<f64>() / TAXELS as f64;
    let mut columns = [f32::NAN; TRUST_INPUTS];
    filter.write_trust(&mut columns);
    columns.map(|column| f64::from(column) / reading)
}

#[test]
fn a_network_is_told_how_far_the_taxels_can_be_trusted() {
    let mut finger = trusting(3);
    let new = ArtifactFilter::new(finger.model.clone(), HZ, Following::On);
    assert_eq!(told(&new).map(f64::round), [0.0, 10.0], "without a calibration gains are not followed");
    let mut filter = finger.calibrated(Following::On);
    assert_eq!(told(&filter).map(f64::round)[1], 10.0, "nor before the first measurement");
    finger.feel(&mut filter, 30.0, |_| 0.0);
    let [noise, left] = told(&filter);
    assert!(noise < 1.0 && (0.05..3.0).contains(&left), "{noise} {left}");
    // A touch is no reason to trust less: what is told is what was least uncertain since it began.
    finger.feel(&mut filter, 5.0, |_| 20.0);
    let touched = told(&filter);
    assert!(touched[0] < 1.0 && (0.05..=1.2 * left).contains(&touched[1]), "{touched:?} after {left}");
    finger.feel(&mut filter, 60.0, |_| 20.0);
    let held = told(&filter)[1];
    assert!(held <= touched[1], "{held} after a minute, {} before: a held touch does not become doubtful", touched[1]);
    finger.feel(&mut filter, 0.06, |_| 0.0);
    let ended = told(&filter)[1];
    assert!(ended > 1.1 * held, "{ended} right after it, {held} before: gains slipped meanwhile");
    finger.feel(&mut filter, 30.0, |_| 0.0);
    let over = told(&filter)[1];
    assert!((0.5 * left..2.0 * left).contains(&over), "{over} when it is over, {left} before");
    // Without angles for a quarter of a second, gains are not followed.
    let mut blind = filter.clone();
    let (mut tactile, ..) = finger.frame(20.0);
    (0..20).for_each(|_| _ = blind.correct(&mut tactile, None, 1, true));
    assert!(told(&blind)[1] < 3.0);
    (0..20).for_each(|_| _ = blind.correct(&mut tactile, None, 1, true));
    assert_eq!(told(&blind).map(f64::round)[1], 10.0);
    // Gains that are kept are those of the calibration, give or take what slips later.
    let mut frozen = finger.calibrated(Following::Frozen);
    assert_eq!(told(&frozen).map(f64::round)[1], 10.0, "before the first measurement");
    finger.feel(&mut frozen, 5.0, |_| 20.0);
    let kept = told(&frozen)[1];
    assert!(kept > 1.5 * left && kept < 9.0, "{kept} gF frozen, {left} gF followed");
    (0..30).for_each(|_| _ = frozen.correct(&mut tactile, None, 1, true));
    assert_eq!(told(&frozen).map(f64::round)[1], 10.0, "without angles");
    // Angles that are noisy say so.
    let mut shaken = finger.calibrated(Following::On);
    let mut noise = Noise(9);
    for _ in 0..1000 {
        let (mut tactile, pose, _) = finger.frame(0.0);
        let pose = pose.map(|angle| angle + 0.2 * noise.next() as f32);
        shaken.correct(&mut tactile, Some(&pose), 1, true);
    }
    assert!(told(&shaken)[0] > 5.0, "{:?}", told(&shaken));
}

#[test]
fn a_network_is_told_for_a_moment_that_a_large_touch_was_let_go() {
    for following in [Following::On, Following::Frozen] {
        let mut finger = trusting(3);
        let mut filter = finger.calibrated(following);
        finger.feel(&mut filter, 10.0, |_| 0.0);
        let before = told(&filter)[1];
        finger.feel(&mut filter, 3.0, |_| 300.0);
        let held = told(&filter)[1];
        assert!(held < before + 1.0, "{following:?}: {held} while it is held, {before} before");
        let mut missed = filter.clone();
        missed.restart();
        finger.feel(&mut filter, 0.06, |_| 60.0);
        let in_part = told(&filter)[1];
        assert!(in_part > 4.0, "{following:?}: {in_part} when it is let go in part, {before} before");
        finger.feel(&mut missed, 0.06, |_| 0.0);
        let missed = told(&missed)[1];
        assert!(missed < in_part - 1.0, "{following:?}: {missed} when nobody knows what was touched before");
        finger.feel(&mut filter, 5.0, |_| 0.0);
        let over = told(&filter)[1];
        assert!(over < 1.5 * before + 0.5, "{following:?}: {over} when it is over, {before} before");
    }
    // A reading beyond all reason counts for seconds, not for minutes.
    let mut finger = trusting(3);
    let mut filter = finger.calibrated(Following::Frozen);
    finger.feel(&mut filter, 10.0, |_| 0.0);
    let before = told(&filter)[1];
    let (_, pose, _) = finger.frame(0.0);
    filter.correct(&mut [1e30; TAXELS], Some(&pose), 1, false);
    finger.feel(&mut filter, 10.0, |_| 0.0);
    let after = told(&filter)[1];
    assert!(after < 1.5 * before, "{after} ten seconds after it, {before} before");
}
