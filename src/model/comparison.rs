//! Compares the forces of the built-in code with those of a runtime, on windows of every scale.

use super::session::InferenceSession;
use super::trial::{Frames, SCALES, Scale};
use crate::fusion::{Contract, Forces, Regressor};

/// Windows of a trial. Each starts one frame after the one before.
const N_WINDOWS: usize = 16;

/// Absolute tolerance: a hundredth of a gram-force.
const TOLERANCE_N: f64 = 1e-4;

/// Relative tolerance, as a share of the largest force at a scale: sums in another order, through 64 steps of an LSTM.
const ROUNDING: f64 = 2e-5;

/// Compares the built-in code with a runtime.
///
/// # Errors
/// The place and the size of the difference.
pub(super) fn compare(own: &mut dyn Regressor, runtime: &mut InferenceSession) -> Result<(), String> {
    let contract = runtime.contract().clone();
    let starts: Vec<usize> = (0..N_WINDOWS).collect();
    let (mut expected, mut got) = (Forces::default(), Forces::default());
    for scale in &SCALES {
        let frames = Frames::new(&contract, scale, N_WINDOWS + contract.window.get() - 1);
        let ran = runtime.run(frames.windows(&starts), &mut expected);
        ran.and_then(|()| own.run(frames.windows(&starts), &mut got)).map_err(|error| error.to_string())?;
        differ(&contract, scale, &expected, &got)?;
    }
    Ok(())
}

fn differ(contract: &Contract, scale: &Scale, runtime: &Forces, own: &Forces) -> Result<(), String> {
    let newtons = |raw: &f32| contract.unit.to_newton(*raw).0;
    let all = |forces: &Forces| forces.force.iter().chain(&forces.base).map(newtons).collect::<Vec<f64>>();
    let touch = |forces: &Forces| forces.touch.iter().map(|touch| f64::from(*touch)).collect::<Vec<f64>>();
    same(scale, "N", &all(runtime), &all(own))?;
    // For probabilities of touch, the tolerance counts 1 as one newton.
    same(scale, "of a touch", &touch(runtime), &touch(own))
}

fn same(scale: &Scale, unit: &str, runtime: &[f64], own: &[f64]) -> Result<(), String> {
    let largest = runtime.iter().filter(|force| force.is_finite()).fold(0.0_f64, |largest, f| largest.max(f.abs()));
    let tolerance = TOLERANCE_N.max(ROUNDING * largest);
    if runtime.len() != own.len() {
        return Err(format!("the built-in code gives {} forces where the runtime gives {}", own.len(), runtime.len()));
    }
    for (expected, got) in runtime.iter().zip(own) {
        let is_same = match (expected.is_finite(), got.is_finite()) {
            (true, true) => (expected - got).abs() <= tolerance,
            (expected, got) => expected == got,
        };
        if !is_same {
            return Err(format!(
                "on {} readings the built-in code gives {got:.6} {unit} where the runtime gives {expected:.6} {unit}",
                scale.name
            ));
        }
    }
    Ok(())
}
