//! Degrades joint angles on purpose, to see how good a hand tracker must be for the pose correction to help.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::fusion::{JointSample, JointSource};
use crate::random::Noise;
use crate::units::{NANOS_PER_SEC, Stamp};

/// Degradation of joint angles. The default changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PoseQuality {
    /// Standard deviation of white Gaussian noise that is added to every angle, degrees.
    pub noise_deg: f64,
    /// Standard deviation of an error that is constant for each joint over the whole session, degrees. It models the
    /// calibration of a tracker.
    pub bias_deg: f64,
    /// Delay of the angles relative to their stamps, ms.
    pub delay_ms: f64,
    /// Share of the joint messages that are lost at random.
    pub dropout: f64,
    /// Joint messages per second that are kept, at times as uneven as a camera's. `None` keeps all.
    pub rate_hz: Option<f64>,
}

/// Maximum distance of a kept message from its regular time, in periods: 15 ms at 30 Hz.
const UNEVEN: f64 = 0.45;

/// A pose quality that is out of range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{what} is {got}, expected {expected}")]
pub struct PoseQualityError {
    what: &'static str,
    got: f64,
    expected: &'static str,
}

/// Degrades joint samples, always in the same way for the same name.
#[derive(Debug)]
pub struct PoseDegrader {
    quality: PoseQuality,
    /// `[joint sources]`: radians per unit of the source.
    scales: Vec<f64>,
    name: String,
    noise: Noise,
    /// By joint, degrees. Drawn at the joint's first sample.
    biases: BTreeMap<String, f64>,
    /// `[joint sources]`, if a rate is given: index of the period of the next kept message, and its earliest stamp.
    next: Vec<Option<(i64, Stamp)>>,
    positions: Vec<f64>,
}

impl PoseQuality {
    /// Refuses values that are out of range.
    ///
    /// # Errors
    /// [`PoseQualityError`].
    pub fn check(&self) -> Result<(), PoseQualityError> {
        let amounts = [
            ("pose noise, in degrees,", self.noise_deg),
            ("pose bias, in degrees,", self.bias_deg),
            ("pose delay, in ms,", self.delay_ms.abs()),
        ];
        for (what, got) in amounts {
            if !(0.0..=1e6).contains(&got) {
                return Err(PoseQualityError { what, got, expected: "0 or more, and finite" });
            }
        }
        if !(0.0..=1.0).contains(&self.dropout) {
            return Err(PoseQualityError { what: "pose dropout", got: self.dropout, expected: "a share from 0 to 1" });
        }
        if let Some(got) = self.rate_hz.filter(|rate| !(0.01..=1e6).contains(rate)) {
            return Err(PoseQualityError { what: "pose rate, in Hz,", got, expected: "0.01 or more, and finite" });
        }
        Ok(())
    }
}

impl PoseDegrader {
    /// A degrader for the joints of these sources. Sessions with different names get different noise.
    pub fn new(quality: PoseQuality, sources: &[JointSource], name: &str) -> Self {
        PoseDegrader {
            quality,
            scales: sources.iter().map(|source| source.scale).collect(),
            name: name.to_owned(),
            noise: Noise::named(&format!("pose of {name}")),
            biases: BTreeMap::new(),
            next: vec![None; sources.len()],
            positions: Vec::new(),
        }
    }

    /// True if a message is kept at this rate.
    fn is_kept(&mut self, source: usize, stamp: Stamp, rate_hz: f64) -> bool {
        let period_ns = NANOS_PER_SEC as f64 / rate_hz;
        let Some(next) = self.next.get_mut(source) else { return true };
        if next.is_some_and(|(_, earliest)| stamp < earliest) {
            return false;
        }
        let period = (stamp.0 as f64 / period_ns).floor() as i64 + 1;
        let period = next.map_or(period, |(last, _)| period.max(last + 1));
        let time = (period as f64 + 0.5 + self.noise.uniform(-UNEVEN, UNEVEN)) * period_ns;
        *next = Some((period, Stamp(time as i64)));
        true
    }

    /// The degraded sample. `None` if it is lost.
    pub fn handle<'a>(&'a mut self, sample: JointSample<'a>) -> Option<JointSample<'a>> {
        let PoseQuality { noise_deg, bias_deg, delay_ms, dropout, rate_hz } = self.quality;
        if rate_hz.is_some_and(|rate_hz| !self.is_kept(sample.source.position(), sample.stamp, rate_hz)) {
            return None;
        }
        if dropout > 0.0 && self.noise.uniform(0.0, 1.0) < dropout {
            return None;
        }
        let delay_ns = (delay_ms * 1e6).round() as i64;
        let sample = JointSample { stamp: sample.stamp.offset(delay_ns), ..sample };
        if noise_deg == 0.0 && bias_deg == 0.0 {
            return Some(sample);
        }
        let per_degree = 1f64.to_radians() / self.scales.get(sample.source.position()).copied().unwrap_or(1.0);
        self.positions.clear();
        for (joint, position) in sample.names.iter().zip(sample.positions) {
            let white = if noise_deg > 0.0 { self.noise.normal(noise_deg) } else { 0.0 };
            let kept = match self.biases.get(joint) {
                Some(kept) => *kept,
                None => {
                    let kept = Noise::named(&format!("bias of {joint} of {}", self.name)).normal(bias_deg);
                    self.biases.insert(joint.clone(), kept);
                    kept
                }
            };
            self.positions.push(position + (white + kept) * per_degree);
        }
        // A message with fewer positions than names stays malformed.
        Some(JointSample { positions: &self.positions, ..sample })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fusion::JointSourceIdx;

    fn sources() -> [JointSource; 1] {
        [JointSource { name: "hand".into(), stamp_offset_ns: 0, scale: 1f64.to_radians() }]
    }

    fn through(quality: PoseQuality, n: i64) -> Vec<(Stamp, Vec<f64>)> {
        let names = ["dip".to_owned(), "pip".to_owned()];
        let mut degrader = PoseDegrader::new(quality, &sources(), "session");
        let sample = |k| JointSample {
            source: JointSourceIdx::at(0),
            stamp: Stamp(k),
            names: &names,
            positions: &[10.0, 20.0],
            received: Stamp(k),
        };
        let out = (0..n).filter_map(|k| degrader.handle(sample(k)).map(|s| (s.stamp, s.positions.to_vec())));
        out.collect()
    }

    #[test]
    fn nothing_asked_for_changes_nothing() {
        let out = through(PoseQuality::default(), 3);
        assert_eq!(out, (0..3).map(|k| (Stamp(k), vec![10.0, 20.0])).collect::<Vec<_>>());
    }

    #[test]
    fn noise_is_in_degrees_whatever_the_unit_and_repeats() {
        let quality = PoseQuality { noise_deg: 3.0, ..PoseQuality::default() };
        let out = through(quality, 4000);
        let squares: f64 = out.iter().map(|(_, p)| (p[0] - 10.0).powi(2)).sum();
        assert!(((squares / 4000.0).sqrt() - 3.0).abs() < 0.15, "{squares}");
        assert_eq!(out, through(quality, 4000));
    }

    #[test]
    fn bias_is_kept_and_differs_by_joint_and_delay_and_loss_are_what_they_say() {
        let out = through(PoseQuality { bias_deg: 5.0, delay_ms: 20.0, ..PoseQuality::default() }, 5);
        assert!(out.iter().all(|(_, p)| p == &out[0].1) && out[0].1[0] - 10.0 != out[0].1[1] - 20.0);
        assert_eq!(out[2].0, Stamp(20_000_002));
        let kept = through(PoseQuality { dropout: 0.25, ..PoseQuality::default() }, 4000).len();
        assert!((kept as f64 / 4000.0 - 0.75).abs() < 0.03, "{kept}");
        assert!(through(PoseQuality { dropout: 1.0, ..PoseQuality::default() }, 10).is_empty());
    }

    #[test]
    fn a_rate_keeps_messages_as_unevenly_as_a_camera_gives_them() {
        let names = ["dip".to_owned()];
        let mut degrader =
            PoseDegrader::new(PoseQuality { rate_hz: Some(30.0), ..PoseQuality::default() }, &sources(), "session");
        let mut sample = |k: i64| {
            let stamp = Stamp(1_000_000_000_000 + k * 1_000_000);
            let sample = JointSample {
                source: JointSourceIdx::at(0),
                stamp,
                names: &names,
                positions: &[10.0],
                received: stamp,
            };
            degrader.handle(sample).is_some()
        };
        let kept: Vec<i64> = (0..60_000).filter(|k| sample(*k)).collect();
        assert!(kept.len().abs_diff(1800) <= 2, "{}", kept.len());
        let steps: Vec<i64> = kept.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let (least, most) = (*steps.iter().min().unwrap(), *steps.iter().max().unwrap());
        assert!((2..12).contains(&least) && (54..65).contains(&most), "{least} to {most} ms");
        assert!(PoseQuality { rate_hz: Some(0.0), ..PoseQuality::default() }.check().is_err());
    }

    #[test]
    fn what_can_not_be_meant_is_refused() {
        let noise = PoseQuality { noise_deg: f64::NAN, ..PoseQuality::default() };
        assert_eq!(
            noise.check().unwrap_err().to_string(),
            "pose noise, in degrees, is NaN, expected 0 or more, and finite"
        );
        assert!(PoseQuality { dropout: 1.5, ..PoseQuality::default() }.check().is_err());
    }
}
