//! Calibrates the touch output to a probability, and finds its contact thresholds. Both use only the validation part.

use std::num::NonZeroU32;

use serde::Serialize;

use super::dataset::{Dataset, TOUCH_GF};
use super::error::TrainError;
use super::network::Network;
use super::trainer::on_threads;
use crate::eval::{Part, Tally};
use crate::fusion::{
    ContactBy, ContactDetector, ContactEvent, ContactThresholds, TOUCH_EVIDENCE, TouchLevels, TouchOutput, Windows,
    log_odds,
};
use crate::units::{Newton, Stamp};

/// Number of windows assembled at once.
const BATCH: usize = 256;

/// Thresholds tried, in percent.
const LEVELS: std::ops::Range<u32> = 1..100;

/// Maximum number of steps of Newton's method; it converges in about five.
const STEPS: usize = 50;

/// Frames before contact begins, as the node has them by default.
const ON_FRAMES: NonZeroU32 = NonZeroU32::new(2).expect("it is above 0");

/// Frames before contact ends, as the node has them by default.
const OFF_FRAMES: NonZeroU32 = NonZeroU32::new(3).expect("it is above 0");

/// A balanced accuracy that is lower by no more than this is as good. Chosen on validation data (docs/validation).
const AS_GOOD: f64 = 0.0005;

/// A frame of the validation part.
struct Judged {
    session: usize,
    frame: usize,
    touch: f64,
    truth_gf: f64,
    is_touch: bool,
    zero_load: bool,
}

/// Calibrated touch output of a network.
#[derive(Debug, Clone, PartialEq)]
pub struct TouchCalibration {
    /// The chosen thresholds.
    pub output: TouchOutput,
    /// Every threshold that was tried, in increasing order.
    pub tried: Vec<TriedLevel>,
}

/// Scores of one contact threshold on the validation part.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TriedLevel {
    /// Probability from which there is contact.
    pub on: f64,
    /// Balanced accuracy, 0 to 1.
    pub ba: f64,
    /// Minimal detectable force, gF; `None` if the curve does not cross 90 %.
    pub mdf_gf: Option<f64>,
    /// Contacts per minute that begin while nothing touches; `None` without a frame at rest.
    pub false_per_min: Option<f64>,
}

/// Calibrates the touch output of a network to a probability on the validation part, and finds its contact thresholds:
/// the lowest ones of those whose balanced accuracy is within 0.05 points of the best.
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
) -> Result<Option<TouchCalibration>, TrainError> {
    let mut frames = judge(network, dataset, threads)?;
    let n_touch = frames.iter().filter(|frame| frame.is_touch).count();
    if n_touch == 0 || n_touch == frames.len() {
        return Ok(None);
    }
    if let Some((gain, shift)) = fit(&frames) {
        network.move_touch(gain as f32, shift as f32)?;
        frames.iter_mut().for_each(|frame| frame.touch = probability(gain * log_odds(frame.touch) + shift));
    }
    let tried: Vec<TriedLevel> =
        LEVELS.map(|percent| try_level(&frames, f64::from(percent) / 100.0, rate_hz)).collect();
    Ok(best(&tried).map(|best| {
        let output = TouchOutput { levels: TouchLevels::from_on(best.on), false_per_min: best.false_per_min };
        TouchCalibration { output, tried }
    }))
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
            let (truth_gf, zero_load) = (of.truth_gf[frame], of.zero_load[frame]);
            frames.push(Judged {
                session,
                frame,
                touch: f64::from(touch),
                truth_gf: f64::from(truth_gf),
                is_touch: truth_gf >= TOUCH_GF,
                zero_load,
            });
        }
    }
    Ok(frames)
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
            let x = log_odds(frame.touch);
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

/// The lowest threshold whose balanced accuracy is as good as the best one's: on users whom the network does not know, lower ones are
/// better than on those of the training sessions.
fn best(tried: &[TriedLevel]) -> Option<TriedLevel> {
    let best = tried.iter().map(|level| level.ba).max_by(f64::total_cmp)?;
    tried.iter().find(|level| level.ba >= best - AS_GOOD).copied()
}

fn try_level(frames: &[Judged], on: f64, rate_hz: f64) -> TriedLevel {
    let mut tally = Tally::default();
    for frame in frames {
        tally.add_judged(frame.truth_gf, Some(frame.truth_gf), Some(frame.touch >= on));
    }
    let score = tally.score();
    TriedLevel {
        on,
        ba: score.ba.value().unwrap_or_default(),
        mdf_gf: score.mdf.value(),
        false_per_min: false_per_min(frames, TouchLevels::from_on(on), rate_hz),
    }
}

/// Number of contacts that begin while nothing touches, as the node would report them; `None` without a frame at rest.
fn false_per_min(frames: &[Judged], levels: TouchLevels, rate_hz: f64) -> Option<f64> {
    let thresholds = ContactThresholds {
        by: ContactBy::Model,
        touch: Some(levels),
        touch_evidence: TOUCH_EVIDENCE,
        force_on: Newton(f64::INFINITY),
        force_off: Newton(f64::INFINITY),
        on_frames: ON_FRAMES,
        off_frames: OFF_FRAMES,
    };
    let detector = || ContactDetector::new(thresholds, Some(TouchOutput::default()));
    let (mut contact, mut n_false, mut n_rest) = (detector(), 0u64, 0u64);
    let mut before: Option<&Judged> = None;
    for frame in frames {
        let follows = before.is_some_and(|before| before.session == frame.session && before.frame + 1 == frame.frame);
        if !follows {
            contact = detector();
        }
        let event = contact.handle_estimate(Stamp(frame.frame as i64), None, Some(frame.touch), 0.0).event;
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
            Judged {
                session: 0,
                frame,
                touch: probability(truth / 2.0 + 1.0),
                truth_gf: 0.0,
                is_touch,
                zero_load: !is_touch,
            }
        };
        (0..20_000).map(frame).collect()
    }

    #[test]
    fn odds_are_made_the_likeliest() {
        let (gain, shift) = fit(&frames()).unwrap();
        assert!((gain - 2.0).abs() < 0.1 && (shift + 2.0).abs() < 0.1, "{gain}, {shift}");
    }

    #[test]
    fn the_lowest_of_the_best_levels_is_taken() {
        let of = |touch: f64, is_touch: bool, frame: usize| Judged {
            session: 0,
            frame,
            touch,
            truth_gf: if is_touch { 10.0 } else { 0.0 },
            is_touch,
            zero_load: !is_touch,
        };
        // Every threshold from 0.31 to 0.89 separates them equally well.
        let frames: Vec<Judged> =
            (0..600).map(|frame| if frame < 300 { of(0.305, false, frame) } else { of(0.895, true, frame) }).collect();
        let tried: Vec<TriedLevel> = [0.3, 0.31, 0.55, 0.89, 0.9].map(|on| try_level(&frames, on, 100.0)).into();
        assert_eq!(tried.iter().map(|level| level.ba).collect::<Vec<_>>(), [0.5, 1.0, 1.0, 1.0, 0.5]);
        assert_eq!(best(&tried).map(|level| level.on), Some(0.31));
        let level = |on: f64, ba: f64| TriedLevel { on, ba, mdf_gf: None, false_per_min: None };
        let nearly = [level(0.3, 0.9818), level(0.4, 0.982), level(0.5, 0.9824), level(0.6, 0.9823), level(0.7, 0.982)];
        assert_eq!(best(&nearly).map(|level| level.on), Some(0.4), "of those within 0.05 points of the best");
        assert_eq!(best(&nearly[..1]).map(|level| level.on), Some(0.3));
        assert_eq!(best(&[]), None);
        assert_eq!(tried[2].false_per_min, Some(0.0));
        // One false touch in 3 s.
        assert!((tried[0].false_per_min.unwrap() - 20.0).abs() < 1e-9);
    }
}
