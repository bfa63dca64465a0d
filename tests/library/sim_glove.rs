//! What the paper observed of real gloves, checked on the synthetic ones.

use tactile_pose_fusion::sim::glove::{GLOVES, GloveDesign, WornGlove};
use tactile_pose_fusion::sim::hand::{Finger, HandPose, INDEX_BASE, JOINTS, MOVEMENTS};
use tactile_pose_fusion::sim::performance::{Contact, HandState};
use tactile_pose_fusion::sim::{Record, SessionSpec, simulate};
use tactile_pose_fusion::units::{GramForce, Newton};

const DT_S: f64 = 0.01;

fn spec(design: &GloveDesign, user: u32, session: u32) -> SessionSpec {
    let (activity, tracking, conditions) = Default::default();
    SessionSpec { glove: design.number, user, session, seed: 5, minutes: 5.0, activity, tracking, conditions }
}

/// A glove on a test bench: holds a pose and a force, and says how much the mean of all taxels reads, in counts.
struct Bench {
    design: &'static GloveDesign,
    glove: WornGlove,
    touch: usize,
}

impl Bench {
    fn new(design: &'static GloveDesign, user: u32, session: u32) -> Self {
        Bench { design, glove: WornGlove::new(design, &spec(design, user, session)), touch: 0 }
    }

    fn hold(&mut self, pose: HandPose, force: Option<GramForce>) -> f64 {
        self.touch += 1;
        let contact = force.map(|force| Contact { touch: self.touch, force, tangential: None });
        let state = HandState { pose, contact };
        let mut sum = 0.0;
        for k in 0..40 {
            let counts = self.glove.sample(DT_S, &state);
            if k >= 20 {
                sum += counts.iter().map(|&count| f64::from(count)).sum::<f64>() / counts.len() as f64;
            }
        }
        sum / 20.0 * self.design.span_counts.signum()
    }

    /// Mean over many touches of what a force adds.
    fn touches(&mut self, pose: HandPose, force: GramForce) -> f64 {
        let n = 24;
        let added = |bench: &mut Bench| {
            let rest = bench.hold(pose, None);
            bench.hold(pose, Some(force)) - rest
        };
        (0..n).map(|_| added(self)).sum::<f64>() / f64::from(n)
    }
}

fn bent() -> HandPose {
    INDEX_BASE.with_index(MOVEMENTS[0].end)
}

#[test]
fn a_bent_finger_reads_like_a_tap_of_about_one_newton() {
    // Sec. I: bending a finger in the air changes the signal like a tap of 1.1 N.
    // A user's fit is log-normal and the response saturates, so that the median stands for the users.
    for design in &GLOVES {
        let mut equivalents = Vec::new();
        for user in 0..15 {
            let mut bench = Bench::new(design, user, 0);
            let artifact = bench.hold(bent(), None) - bench.hold(INDEX_BASE, None);
            let forces = [25.0, 50.0, 75.0, 100.0, 130.0, 170.0, 220.0, 300.0, 450.0, 700.0];
            let readings = forces.map(|force| bench.touches(INDEX_BASE, GramForce(force)));
            let above = readings.iter().position(|&reading| reading > artifact).unwrap_or(forces.len() - 1).max(1);
            let part = (artifact - readings[above - 1]) / (readings[above] - readings[above - 1]);
            let equal_gf = forces[above - 1] + part * (forces[above] - forces[above - 1]);
            equivalents.push(Newton::from(GramForce(equal_gf)).0);
        }
        equivalents.sort_by(f64::total_cmp);
        let median = equivalents[equivalents.len() / 2];
        assert!((0.7..1.6).contains(&median), "glove {}: {median:.2} N of {equivalents:.2?}", design.number);
    }
}

#[test]
fn the_same_force_reads_otherwise_when_the_finger_is_bent() {
    // Observation 2.
    for design in &GLOVES {
        let ratios: Vec<f64> = (0..4)
            .map(|user| {
                let mut bench = Bench::new(design, user, 0);
                let straight = bench.touches(INDEX_BASE, GramForce(300.0));
                bench.touches(bent(), GramForce(300.0)) / straight
            })
            .collect();
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        assert!((mean - 1.0).abs() > 0.1, "glove {}: {ratios:.2?}", design.number);
    }
}

/// How far DIP, PIP, MCP flexion and abduction go in the protocol, rad.
const RANGE_RAD: [f64; 4] = [1.1, 1.5, 1.3, 0.35];

#[test]
fn nearby_joints_strain_the_fingertip_most() {
    // Observation 3: what each joint does alone, over its range, on average over users, donnings and taxels.
    for design in &GLOVES {
        let mut effects = [[0.0; 4]; 5];
        for (finger, effects) in effects.iter_mut().enumerate() {
            for (joint, effect) in effects.iter_mut().enumerate() {
                for user in 0..6 {
                    let mut bench = Bench::new(design, user, 0);
                    let rest = bench.hold(INDEX_BASE, None);
                    let mut pose = INDEX_BASE;
                    pose.0[finger][joint] += RANGE_RAD[joint];
                    *effect += (bench.hold(pose, None) - rest) / 6.0;
                }
            }
        }
        let [dip, pip, mcp, abduction] = effects[Finger::Index as usize];
        let others = effects[1..].iter().flatten().copied().fold(0.0, f64::max);
        assert!(dip > pip && pip > mcp && mcp > abduction, "glove {}: {effects:.0?}", design.number);
        assert!(abduction > 0.0 && mcp > others, "glove {}: {effects:.0?}", design.number);
    }
}

#[test]
fn taxels_correlate_with_dip_and_pip_over_mcp_over_other_fingers() {
    // Observation 3, as the paper shows it: correlation of joints and taxels over in-air free movement.
    for design in &GLOVES {
        let mut correlations = [0.0; JOINTS.len()];
        let users = 4;
        for user in 0..users {
            let spec = SessionSpec { minutes: 14.0, ..spec(design, user, 0) };
            for (sum, own) in correlations.iter_mut().zip(in_air_correlations(&spec)) {
                *sum += own / f64::from(users);
            }
        }
        let [dip, pip, mcp, abduction] = [0, 1, 2, 3].map(|joint| correlations[joint]);
        let others = correlations[4..].iter().copied().fold(0.0, f64::max);
        assert!(dip.min(pip) > mcp + 0.1, "glove {}: {correlations:.2?}", design.number);
        assert!(mcp > abduction && mcp > others, "glove {}: {correlations:.2?}", design.number);
    }
}

/// Absolute correlation of each joint with the taxels, their mean, over in-air free movement.
fn in_air_correlations(spec: &SessionSpec) -> Vec<f64> {
    let (mut rows, mut angles, mut in_air) = (Vec::new(), Vec::new(), false);
    for record in simulate(spec).unwrap() {
        match record {
            Record::Stage { .. } if in_air => break, // that it is once a session
            Record::Stage { substage, .. } => in_air = &*substage == "in_air_free_movement",
            Record::Joints { positions, .. } => angles = positions,
            Record::Taxels { values, .. } if in_air && !angles.is_empty() => {
                rows.push((angles.clone(), values.iter().map(|&count| f64::from(count)).collect::<Vec<_>>()));
            }
            _ => {}
        }
    }
    let column = |taxel_idx: usize| rows.iter().map(|row| row.1[taxel_idx]).collect::<Vec<_>>();
    let taxels: Vec<Vec<f64>> = (0..rows[0].1.len()).map(column).collect();
    (0..JOINTS.len())
        .map(|joint| {
            let angles: Vec<f64> = rows.iter().map(|row| row.0[joint]).collect();
            taxels.iter().map(|taxel| correlation(&angles, taxel).abs()).sum::<f64>() / taxels.len() as f64
        })
        .collect()
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let product = |x: &[f64], mean_x: f64, y: &[f64], mean_y: f64| {
        x.iter().zip(y).map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>()
    };
    product(a, mean_a, b, mean_b) / (product(a, mean_a, a, mean_a) * product(b, mean_b, b, mean_b)).sqrt()
}

#[test]
fn release_at_a_bent_pose_lingers_by_creep_and_hysteresis() {
    let design = &GLOVES[2];
    let mut bench = Bench::new(design, 0, 0);
    let before = bench.hold(INDEX_BASE, None);
    for _ in 0..10 {
        bench.hold(bent(), None);
    }
    let after = bench.hold(INDEX_BASE, None);
    assert!(after - before > 0.01 * design.span_counts, "{before} to {after}");
}
