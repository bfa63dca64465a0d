//! A few figures of a network's performance on a part of the data. The report's metrics are computed elsewhere.

use serde::{Deserialize, Serialize};

use super::super::dataset::{Batch, Dataset, TOUCH_GF};
use super::super::error::TrainError;
use super::super::loss::LossConfig;
use super::super::network::Network;
use super::step::on_threads;
use crate::eval::Part;
use crate::fusion::{Forces, Windows};

/// Number of windows assembled at once.
const BATCH: usize = 256;

/// Performance of a network on a part of the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Number of windows.
    pub n: usize,
    /// Modified MAPE of the final force; with three axes, the weighted relative error of the tangential force is added.
    pub loss: f64,
    /// Mean length of the error of the tangential force, gF; only of a force of three axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tangential_mae_gf: Option<f64>,
    /// Mean absolute error of the final force, gF.
    pub mae_gf: f64,
    /// Balanced accuracy of touch from the final force; `None` if the part has one class only.
    pub balanced_accuracy: Option<f64>,
    /// Mean absolute error of the base force, gF: compared with that of the final force, it shows the residual's
    /// effect.
    pub base_mae_gf: Option<f64>,
    /// Balanced accuracy of touch from the base force.
    pub base_balanced_accuracy: Option<f64>,
}

/// Evaluates a network on a part.
///
/// # Errors
/// [`TrainError::Architecture`] when the network was made for other data.
pub fn validate(
    network: &Network,
    dataset: &Dataset,
    part: Part,
    loss: &LossConfig,
    threads: usize,
) -> Result<Validation, TrainError> {
    let windows: Vec<usize> = (0..dataset.n_windows(part)).collect();
    let batches: Vec<&[usize]> = windows.chunks(BATCH).collect();
    let results = on_threads(&batches, threads, |windows| -> Result<(Forces, Batch), TrainError> {
        let batch = dataset.batch(part, windows, None);
        let forces = network.predict_in_contact(Windows { n: batch.n, tactile: &batch.tactile, pose: &batch.pose })?;
        Ok((forces, batch))
    });
    let n_axes = network.architecture.n_axes();
    let normal = |forces: Vec<f32>| forces.into_iter().step_by(n_axes);
    let (mut force, mut base, mut truth) = (Vec::new(), Vec::new(), Vec::new());
    let (mut tangential_error, mut tangential_loss) = (0.0, 0.0);
    for result in results {
        let (forces, batch) = result?;
        if n_axes == 3 {
            for (force, truth) in forces.force.as_chunks::<3>().0.iter().zip(batch.tangential_gf.as_chunks::<2>().0) {
                let error = f64::from((force[1] - truth[0]).hypot(force[2] - truth[1]));
                tangential_error += error;
                tangential_loss += error / f64::from(loss.offset_gf + truth[0].hypot(truth[1]));
            }
        }
        force.extend(normal(forces.force));
        base.extend(normal(forces.base));
        truth.extend(batch.truth_gf);
    }
    let n = truth.len().max(1) as f64;
    let tangential_loss = f64::from(loss.tangential_weight) * tangential_loss / n; // 0 of one axis
    let has_base = !base.is_empty();
    let relative = |(f, t): (&f32, &f32)| f64::from((f - t).abs() / (loss.offset_gf + t.max(0.0)));
    Ok(Validation {
        n: truth.len(),
        loss: force.iter().zip(&truth).map(relative).sum::<f64>() / truth.len().max(1) as f64 + tangential_loss,
        tangential_mae_gf: (n_axes == 3).then_some(tangential_error / n),
        mae_gf: mean_error(&force, &truth),
        balanced_accuracy: balanced_accuracy(&force, &truth),
        base_mae_gf: has_base.then(|| mean_error(&base, &truth)),
        base_balanced_accuracy: if has_base { balanced_accuracy(&base, &truth) } else { None },
    })
}

fn mean_error(force: &[f32], truth: &[f32]) -> f64 {
    let sum: f64 = force.iter().zip(truth).map(|(f, t)| f64::from((f - t).abs())).sum();
    sum / truth.len().max(1) as f64
}

fn balanced_accuracy(force: &[f32], truth: &[f32]) -> Option<f64> {
    let rate = |touch: bool| {
        let of_class = force.iter().zip(truth).filter(|(_, t)| (**t >= TOUCH_GF) == touch);
        let (mut n, mut right) = (0u64, 0u64);
        for (f, _) in of_class {
            n += 1;
            right += u64::from((*f >= TOUCH_GF) == touch);
        }
        (n > 0).then(|| right as f64 / n as f64)
    };
    Some((rate(true)? + rate(false)?) / 2.0)
}
