//! The gradient of a batch.

use burn::tensor::Device;

use super::super::dataset::{Batch, Dataset};
use super::super::light_touch;
use super::super::loss::{self, LossTerms, Measure};
use super::super::network::{BatchNormStatistics, Network, Normalize, values};
use super::config::TrainConfig;
use crate::eval::Part;

/// Weight of a new batch in the running statistics; PyTorch's default.
const MOMENTUM: f32 = 0.1;

/// Results of a batch, or of a shard.
pub(in crate::train) struct Given {
    pub(in crate::train) loss: LossTerms,
    /// In the order of [`Network::values`].
    pub(in crate::train) gradient: Vec<f32>,
    /// Statistics of each shard, in order.
    pub(in crate::train) statistics: Vec<BatchNormStatistics>,
}

/// Runs the shards of a batch and sums their results, in order.
pub(super) fn run(
    network: &Network,
    dataset: &Dataset,
    windows: &[usize],
    step: u64,
    cfg: &TrainConfig,
    threads: usize,
    device: &Device,
) -> Given {
    let smoothing = (cfg.loss.lambda > 0.0).then_some(cfg.smoothing_frames);
    let mut shards: Vec<Batch> = windows
        .chunks(windows.len().div_ceil(cfg.shards))
        .map(|windows| dataset.batch(Part::Train, windows, smoothing))
        .collect();
    for (idx, shard) in (0..).zip(&mut shards) {
        let stream = step * cfg.shards as u64 + idx;
        light_touch::add(shard, cfg.light_touches, dataset.spec().outputs, cfg.seed, stream);
    }
    let measure = Measure {
        truths: windows.len() * dataset.spec().outputs,
        zero_load: shards.iter().flat_map(|shard| &shard.zero_load).filter(|zero_load| **zero_load).count(),
        tactile_scale: network.architecture.tactile_scale,
    };
    let results = on_threads(&shards, threads, |shard| run_shard(network, shard, cfg, measure, device));
    let mut sum =
        Given { loss: LossTerms::default(), gradient: vec![0.0; network.values.len()], statistics: Vec::new() };
    for given in results {
        sum.loss.add(given.loss);
        sum.gradient.iter_mut().zip(&given.gradient).for_each(|(sum, part)| *sum += part);
        sum.statistics.extend(given.statistics);
    }
    sum
}

/// Maps items on at most `threads` threads; the results come in the order of the items.
pub(in crate::train) fn on_threads<T: Sync, R: Send>(
    items: &[T],
    threads: usize,
    map: impl Fn(&T) -> R + Sync,
) -> Vec<R> {
    let threads = threads.min(items.len()).max(1);
    if threads == 1 {
        return items.iter().map(map).collect();
    }
    let mut results: Vec<(usize, R)> = std::thread::scope(|scope| {
        let map = &map;
        let work = |first: usize| {
            let mine = items.iter().enumerate().skip(first).step_by(threads);
            mine.map(|(idx, item)| (idx, map(item))).collect::<Vec<_>>()
        };
        let workers: Vec<_> = (1..threads).map(|first| scope.spawn(move || work(first))).collect();
        let mut results = work(0);
        for worker in workers {
            results.extend(worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        }
        results
    });
    results.sort_by_key(|(idx, _)| *idx);
    results.into_iter().map(|(_, result)| result).collect()
}

/// Forward and backward of one shard.
pub(in crate::train) fn run_shard(
    network: &Network,
    shard: &Batch,
    cfg: &TrainConfig,
    measure: Measure,
    device: &Device,
) -> Given {
    let weights = network.on(device);
    let input = weights.input(shard.n, shard.tactile.clone(), shard.pose.clone());
    let mut output = weights.forward(input, Normalize::ByBatch);
    let statistics = output.statistics.take().into_iter().collect();
    let (total, loss) = loss::share(&cfg.loss, output, shard, measure, device);
    let mut gradients = total.backward();
    let mut gradient = vec![0.0; network.values.len()];
    for (tensor, range) in weights.tensors.iter().zip(weights.ranges()) {
        // A parameter that does not affect any term of the loss has no gradient: it stays unchanged.
        if let Some(grad) = tensor.grad_remove(&mut gradients) {
            gradient[range].copy_from_slice(&values(grad));
        }
    }
    Given { loss, gradient, statistics }
}

/// Euclidean norm, summed in f64.
pub(super) fn norm(gradient: &[f32]) -> f64 {
    gradient.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>().sqrt()
}

/// Clips a gradient to the maximum norm.
pub(super) fn clip(gradient: &mut [f32], norm: f64, longest: f64) {
    if norm > longest {
        let factor = (longest / norm) as f32;
        gradient.iter_mut().for_each(|value| *value *= factor);
    }
}

/// Moves the running statistics towards the mean over the shards.
pub(in crate::train) fn track(running: &mut BatchNormStatistics, shards: &[BatchNormStatistics]) {
    let share = MOMENTUM / shards.len().max(1) as f32;
    let move_to = |running: &mut Vec<f32>, of: fn(&BatchNormStatistics) -> &Vec<f32>| {
        for (idx, value) in running.iter_mut().enumerate() {
            let seen: f32 = shards.iter().map(|shard| of(shard)[idx]).sum();
            *value = (1.0 - MOMENTUM) * *value + share * seen;
        }
    };
    move_to(&mut running.mean, |shard| &shard.mean);
    move_to(&mut running.variance, |shard| &shard.variance);
}
