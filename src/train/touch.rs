//! Calibrates the touch output to a probability, and finds its contact thresholds. Both use only the validation part.

use super::dataset::{Dataset, TOUCH_GF};
use super::error::TrainError;
use super::network::Network;
use super::trainer::on_threads;
use crate::eval::Part;
use crate::fusion::{ContactBy, ContactDetector, ContactEvent, ContactThresholds, TouchLevels, TouchOutput, Windows};
use crate::units::{Newton, Stamp};

/// Number of windows assembled at once.
const BATCH: usize = 256;

/// Thresholds tried, in percent.
const LEVELS: std::ops::Range<u32> = 1..100;

/// A higher threshold is taken, for fewer false touches, as long as the balanced accuracy is within this of the best.
const AS_GOOD: f64 = 0.001;

/// Maximum number of steps of Newton's method; it converges in about five.
const STEPS: usize = 50;

/// A frame of the validation part.
struct Judged {
    session: usize,
    frame: usize,
    touch: f64,
    is_touch: bool,
    zero_load: bool,
}

/// Calibrates the touch output of a network to a probability on the validation part, and finds its contact thresholds:
/// the highest with a balanced accuracy within 0.1 % of the best.
///
/// `None` for a network without such an output, and if the validation part lacks touch or air.
///
/// # Errors
/// [`TrainError::Architecture`] when the network was made for other data.
/// # Source
/// Platt, Probabilistic outputs for support vector machines, 1999.
pub fn calibrate_touch(
    network: &mut Network,
    dataset: &Dataset,
    rate_hz: f64,
    threads: usize,
) -> Result<Option<TouchOutput>, TrainError> {
    let mut frames = judge(network, dataset, threads)?;
    let n_touch = frames.iter().filter(|frame| frame.is_touch).count();
    if n_touch == 0 || n_touch == frames.len() {
        return Ok(None);
    }
    if let Some((gain, shift)) = fit(&frames) {
        network.move_touch(gain as f32, shift as f32)?;
        frames.iter_mut().for_each(|frame| frame.touch = probability(gain * odds(frame.touch) + shift));
    }
    let levels = levels(&frames, n_touch);
    Ok(Some(TouchOutput { levels, false_per_min: false_per_min(&frames, levels, rate_hz) }))
}

/// Every frame of the validation part, in the order of sessions and time.
fn judge(network: &Network, dataset: &Dataset, threads: usize) -> Result<Vec<Judged>, TrainError> {
    if dataset.n_windows(Part::Validation) == 0 {
        return Ok(Vec::new());
    }
    let dataset = dataset.with_every_frame()?;
    let windows: Vec<usize> = (0..dataset.n_windows(Part::Validation)).collect();
    let batches: Vec<&[usize]> = windows.chunks(BATCH).collect();
    let touches = on_threads(&batches, threads, |windows| {
        let batch = dataset.batch(Part::Validation, windows, None);
        network.predict(Windows { n: batch.n, tactile: &batch.tactile, pose: &batch.pose }).map(|forces| forces.touch)
    });
    let mut frames = Vec::new();
    for (windows, touches) in batches.into_iter().zip(touches) {
        for (window, touch) in windows.iter().zip(touches?) {
            let Some((session, frame)) = dataset.window_end(Part::Validation, *window) else { continue };
            let of = dataset.sessions()[session].frames();
            let (is_touch, zero_load) = (of.truth_gf[frame] >= TOUCH_GF, of.zero_load[frame]);
            frames.push(Judged { session, frame, touch: f64::from(touch), is_touch, zero_load });
        }
    }
    Ok(frames)
}

fn odds(probability: f64) -> f64 {
    let probability = probability.clamp(1e-7, 1.0 - 1e-7);
    (probability / (1.0 - probability)).ln()
}

fn probability(odds: f64) -> f64 {
    1.0 / (1.0 + (-odds).exp())
}

/// Gain and shift of the log odds with the maximum likelihood; `None` if they can't be found, or would invert the
/// output.
fn fit(frames: &[Judged]) -> Option<(f64, f64)> {
    // As in Platt: targets slightly inside of 0 and 1, so that separable classes don't lead to an infinite gain.
    let n_touch = frames.iter().filter(|frame| frame.is_touch).count() as f64;
    let n_air = frames.len() as f64 - n_touch;
    let (high, low) = ((n_touch + 1.0) / (n_touch + 2.0), 1.0 / (n_air + 2.0));
    let (mut gain, mut shift) = (1.0, 0.0);
    for _ in 0..STEPS {
        let (mut gradient, mut hessian) = ([0.0; 2], [1e-9, 0.0, 1e-9]);
        for frame in frames {
            let x = odds(frame.touch);
            let p = probability(gain * x + shift);
            let error = p - if frame.is_touch { high } else { low };
            let weight = p * (1.0 - p);
            gradient = [gradient[0] + error * x, gradient[1] + error];
            hessian = [hessian[0] + weight * x * x, hessian[1] + weight * x, hessian[2] + weight];
        }
        let determinant = hessian[0] * hessian[2] - hessian[1] * hessian[1];
        let step = [
            (hessian[2] * gradient[0] - hessian[1] * gradient[1]) / determinant,
            (hessian[0] * gradient[1] - hessian[1] * gradient[0]) / determinant,
        ];
        (gain, shift) = (gain - step[0], shift - step[1]);
        if !gain.is_finite() || !shift.is_finite() {
            return None;
        }
        if step[0].abs() + step[1].abs() < 1e-9 {
            break;
        }
    }
    (gain > 0.0).then_some((gain, shift))
}

fn levels(frames: &[Judged], n_touch: usize) -> TouchLevels {
    let level = |step: u32| f64::from(step) / 100.0;
    let n_air = frames.len() - n_touch;
    let accuracy = |on: f64| {
        let right = |touch: bool| {
            frames.iter().filter(|frame| frame.is_touch == touch && (frame.touch >= on) == touch).count() as f64
        };
        (right(true) / n_touch as f64 + right(false) / n_air as f64) / 2.0
    };
    let tried: Vec<(f64, f64)> = LEVELS.map(|step| (level(step), accuracy(level(step)))).collect();
    let best = tried.iter().fold(0.0_f64, |best, (_, accuracy)| best.max(*accuracy));
    let on = tried.iter().rev().find(|(_, accuracy)| *accuracy >= best - AS_GOOD).map_or(0.5, |(level, _)| *level);
    TouchLevels::from_on(on)
}

/// Number of contacts that begin while nothing touches, as the node would report them; `None` without a frame at rest.
fn false_per_min(frames: &[Judged], levels: TouchLevels, rate_hz: f64) -> Option<f64> {
    let thresholds = ContactThresholds {
        by: ContactBy::Model,
        touch: Some(levels),
        force_on: Newton(f64::INFINITY),
        force_off: Newton(f64::INFINITY),
        on_frames: 2,
        off_frames: 3,
    };
    let detector = || ContactDetector::new(thresholds, Some(TouchOutput::default()));
    let (mut contact, mut n_false, mut n_rest) = (detector(), 0u64, 0u64);
    let mut before: Option<&Judged> = None;
    for frame in frames {
        let follows = before.is_some_and(|before| before.session == frame.session && before.frame + 1 == frame.frame);
        if !follows {
            contact = detector();
        }
        let event = contact.handle_estimate(Stamp(frame.frame as i64), None, Some(frame.touch)).event;
        n_rest += u64::from(frame.zero_load);
        n_false += u64::from(frame.zero_load && event == ContactEvent::Onset);
        before = Some(frame);
    }
    (n_rest > 0).then(|| n_false as f64 / (n_rest as f64 / rate_hz / 60.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Log odds that are half of the true ones and 1 too high, for 20,000 frames.
    fn frames() -> Vec<Judged> {
        let mut random = crate::train::random::Random::new(7, crate::train::random::Stream::Weights);
        let frame = |frame: usize| {
            let truth = 4.0 * f64::from(random.symmetric(1.0));
            let is_touch = f64::from(random.symmetric(0.5)) + 0.5 < probability(truth);
            Judged { session: 0, frame, touch: probability(truth / 2.0 + 1.0), is_touch, zero_load: !is_touch }
        };
        (0..20_000).map(frame).collect()
    }

    #[test]
    fn odds_are_made_the_likeliest() {
        let (gain, shift) = fit(&frames()).unwrap();
        assert!((gain - 2.0).abs() < 0.1 && (shift + 2.0).abs() < 0.1, "{gain}, {shift}");
    }

    #[test]
    fn the_highest_of_the_best_levels_is_taken() {
        let of = |touch: f64, is_touch: bool, frame: usize| Judged {
            session: 0,
            frame,
            touch,
            is_touch,
            zero_load: !is_touch,
        };
        // Every threshold from 0.31 to 0.89 separates them equally well.
        let frames: Vec<Judged> =
            (0..600).map(|frame| if frame < 300 { of(0.305, false, frame) } else { of(0.895, true, frame) }).collect();
        let found = levels(&frames, 300);
        assert_eq!(found.on, 0.89);
        assert!((found.off - 0.623).abs() < 1e-12);
        assert_eq!(false_per_min(&frames, found, 100.0), Some(0.0));
        let low = TouchLevels { on: 0.3, off: 0.2 };
        // One false touch in 3 s.
        assert!((false_per_min(&frames, low, 100.0).unwrap() - 20.0).abs() < 1e-9);
    }
}
