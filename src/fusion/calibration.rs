//! The zero-load baseline: the median of each taxel while nothing touches the glove, and the reasons not to believe it.

use serde::{Deserialize, Serialize};

use crate::units::{Newton, Stamp};

/// Rows kept for the medians. When they are full every second one is dropped and from then on every second one taken.
const MAX_ROWS: usize = 1 << 15; // 330 s at 100 Hz before the first thinning

/// A source's taxels at rest.
///
/// # Shapes
/// All fields: `[taxels of the source]`, raw units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Baseline {
    /// Median reading.
    pub median: Vec<f32>,
    /// Standard deviation of the reading-to-reading noise, from the median absolute step.
    pub noise: Vec<f32>,
    /// Taxels that never moved while others did.
    pub faulty: Vec<bool>,
}

impl Baseline {
    /// A baseline of known rest readings, with nothing known of noise or faults.
    pub fn from_median(median: Vec<f32>) -> Self {
        let n_taxels = median.len();
        Baseline { median, noise: vec![0.0; n_taxels], faulty: vec![false; n_taxels] }
    }
}

/// When a calibration is refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationLimits {
    /// Zero-load time that is needed, s.
    pub min_s: f64,
    /// Force that a hand in the air may read.
    pub max_force: Newton,
    /// Share of frames that may read more than that, 0 to 1.
    pub max_loaded_fraction: f64,
}

/// Why a calibration was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum CalibrationError {
    #[error(
        "no sample came at zero load, at least {need_s} s needed (calibration.min_s); look at the source's driver and topic, and calibrate again"
    )]
    NothingCame { need_s: f64 },
    #[error(
        "calibration is too short: {got_s:.2} s at zero load, at least {need_s} s needed (calibration.min_s); record longer in the air"
    )]
    TooShort { got_s: f64, need_s: f64 },
    #[error(
        "calibration saw no finite reading of taxel {taxel_idx}; check its wiring or leave it out of the region's taxels"
    )]
    NoReading { taxel_idx: usize },
    #[error(
        "calibration looks loaded: {percent:.0} % of its frames read more than {limit}, at most {limit_percent:.0} % may (calibration.max_force, calibration.max_loaded_fraction); keep the hand in the air and calibrate again",
        percent = 100.0 * fraction, limit_percent = 100.0 * limit_fraction
    )]
    Loaded { fraction: f64, limit: Newton, limit_fraction: f64 },
}

/// Collects zero-load samples of one source in bounded memory.
#[derive(Debug, Clone)]
pub struct BaselineBuilder {
    n_taxels: usize,
    max_step_ns: i64,
    rows: Vec<f32>,
    stride: u64,
    n_seen: u64,
    newest: Option<Stamp>,
    span_ns: i64,
    /// Taxels that may have no reading; empty where none may.
    spare: Vec<bool>,
}

impl BaselineBuilder {
    /// An empty collection. Steps in time longer than `max_step_ns` are holes, not zero-load time.
    pub fn new(n_taxels: usize, max_step_ns: i64) -> Self {
        let (rows, spare) = (Vec::new(), Vec::new());
        BaselineBuilder { n_taxels, max_step_ns, rows, stride: 1, n_seen: 0, newest: None, span_ns: 0, spare }
    }

    /// Refuses no taxel without a reading but these: those of regions. Grids send NaN where they have no taxel.
    pub fn needing(mut self, taxels: impl IntoIterator<Item = usize>) -> Self {
        self.spare = vec![true; self.n_taxels];
        taxels
            .into_iter()
            .filter(|taxel_idx| *taxel_idx < self.n_taxels)
            .for_each(|taxel_idx| self.spare[taxel_idx] = false);
        self
    }

    /// Takes a sample.
    ///
    /// # Shapes
    /// `values`: `[taxels of the source]`, raw.
    pub fn handle_sample(&mut self, stamp: Stamp, values: &[f32]) {
        debug_assert_eq!(values.len(), self.n_taxels);
        let step_ns = self.newest.map_or(0, |newest| stamp.nanos_since(newest));
        if (0..=self.max_step_ns).contains(&step_ns) {
            self.span_ns += step_ns;
        }
        // Blocks of a burst overlap in time: what lies a little behind adds nothing. Far behind is a loop.
        if self.newest.is_none() || step_ns > 0 || step_ns < -self.max_step_ns {
            self.newest = Some(stamp);
        }
        if self.n_seen.is_multiple_of(self.stride) {
            if self.rows.len() == MAX_ROWS * self.n_taxels {
                self.thin();
            }
            if self.n_seen.is_multiple_of(self.stride) {
                self.rows.extend_from_slice(values);
            }
        }
        self.n_seen += 1;
    }

    /// Zero-load time collected so far, s.
    pub fn span_s(&self) -> f64 {
        self.span_ns as f64 * 1e-9
    }

    /// The baseline of what was collected.
    ///
    /// # Errors
    /// [`CalibrationError::NothingCame`], [`CalibrationError::TooShort`], [`CalibrationError::NoReading`].
    pub fn finish(&self, limits: &CalibrationLimits) -> Result<Baseline, CalibrationError> {
        if self.rows.is_empty() {
            return Err(CalibrationError::NothingCame { need_s: limits.min_s });
        }
        if self.span_s() < limits.min_s {
            return Err(CalibrationError::TooShort { got_s: self.span_s(), need_s: limits.min_s });
        }
        let mut baseline = Baseline::from_median(vec![0.0; self.n_taxels]);
        let mut moved = vec![false; self.n_taxels];
        for (taxel_idx, moved) in moved.iter_mut().enumerate() {
            let readings = self.rows.iter().skip(taxel_idx).step_by(self.n_taxels).copied();
            let mut finite: Vec<f32> = readings.filter(|reading| reading.is_finite()).collect();
            let mut steps: Vec<f32> = finite.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
            *moved = finite.windows(2).any(|pair| pair[0] != pair[1]);
            baseline.median[taxel_idx] = match median(&mut finite) {
                Some(median) => median,
                None if self.spare.get(taxel_idx) == Some(&true) => 0.0, // never read
                None => return Err(CalibrationError::NoReading { taxel_idx }),
            };
            // The median of |a - b| of two normal readings is 0.6745 * sqrt(2) of one's deviation.
            baseline.noise[taxel_idx] = median(&mut steps).unwrap_or(0.0) / (0.674_49 * std::f32::consts::SQRT_2);
        }
        if moved.contains(&true) {
            baseline.faulty = moved.iter().map(|moved| !moved).collect();
        }
        Ok(baseline)
    }

    fn thin(&mut self) {
        let n = self.n_taxels;
        let kept = self.rows.len() / n / 2;
        for row in 0..kept {
            self.rows.copy_within(2 * row * n..(2 * row + 1) * n, row * n);
        }
        self.rows.truncate(kept * n);
        self.stride *= 2;
    }
}

/// Median of the readings, the mean of the middle two for an even count; `None` of nothing.
fn median(readings: &mut [f32]) -> Option<f32> {
    let middle = readings.len() / 2;
    let even = readings.len().is_multiple_of(2);
    let (below, &mut upper, _) =
        readings.get(middle).is_some().then(|| readings.select_nth_unstable_by(middle, f32::total_cmp))?;
    if !even {
        return Some(upper);
    }
    let lower = below.iter().copied().max_by(f32::total_cmp).unwrap_or(upper);
    Some((f64::midpoint(f64::from(lower), f64::from(upper))) as f32)
}

/// Judges a calibration by the forces that the model reads in it once its own baseline is subtracted: by how many of them
/// are above `max_force`, either way.
///
/// A load that came or went shows as force in one part of it. A load that was there throughout can't be told from rest.
///
/// # Errors
/// [`CalibrationError::Loaded`].
pub fn judge_loaded(n_loaded: u64, n_estimates: u64, limits: &CalibrationLimits) -> Result<(), CalibrationError> {
    let fraction = n_loaded as f64 / n_estimates.max(1) as f64;
    if fraction > limits.max_loaded_fraction {
        let (limit, limit_fraction) = (limits.max_force, limits.max_loaded_fraction);
        return Err(CalibrationError::Loaded { fraction, limit, limit_fraction });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: CalibrationLimits =
        CalibrationLimits { min_s: 2.0, max_force: Newton(0.5), max_loaded_fraction: 0.1 };

    fn collect(n: usize, reading: impl Fn(usize) -> [f32; 2]) -> BaselineBuilder {
        let mut builder = BaselineBuilder::new(2, 50_000_000);
        (0..n).for_each(|k| builder.handle_sample(Stamp(k as i64 * 10_000_000), &reading(k)));
        builder
    }

    #[test]
    fn the_baseline_is_the_median_of_each_taxel() {
        let builder = collect(1001, |k| [k as f32, if k < 400 { 1000.0 } else { 5.0 }]);
        let baseline = builder.finish(&LIMITS).unwrap();
        assert_eq!(baseline.median, [500.0, 5.0]);
        assert_eq!(baseline.faulty, [false, false]);
    }

    #[test]
    fn the_median_outlives_thinning() {
        let builder = collect(5 * MAX_ROWS, |k| [(k % 1000) as f32, 1.0]);
        let baseline = builder.finish(&LIMITS).unwrap();
        assert!((baseline.median[0] - 499.5).abs() < 10.0); // every 8th of a sawtooth
        assert!(builder.rows.len() <= 2 * MAX_ROWS);
        assert_eq!(baseline.faulty, [false, true], "a taxel that never moves while another does");
    }

    #[test]
    fn too_short_holes_and_dead_taxels_are_refused_with_the_reason() {
        let short = collect(150, |_| [0.0; 2]).finish(&LIMITS).unwrap_err();
        assert_eq!(short, CalibrationError::TooShort { got_s: 1.49, need_s: 2.0 });
        let nothing = BaselineBuilder::new(2, 50_000_000).finish(&LIMITS).unwrap_err();
        assert_eq!(nothing, CalibrationError::NothingCame { need_s: 2.0 });
        let dead = collect(500, |_| [0.0, f32::NAN]).finish(&LIMITS).unwrap_err();
        assert_eq!(dead, CalibrationError::NoReading { taxel_idx: 1 });
        let needed = collect(500, |_| [0.0, f32::NAN]).needing([1]).finish(&LIMITS).unwrap_err();
        assert_eq!(needed, CalibrationError::NoReading { taxel_idx: 1 });
        let unused = collect(500, |_| [3.0, f32::NAN]).needing([0]).finish(&LIMITS).unwrap();
        assert_eq!(unused.median, [3.0, 0.0]);
        let mut holes = BaselineBuilder::new(1, 50_000_000);
        (0..10).for_each(|k| holes.handle_sample(Stamp(k * 1_000_000_000), &[0.0]));
        assert!(matches!(holes.finish(&LIMITS), Err(CalibrationError::TooShort { .. })));
    }

    #[test]
    fn time_that_overlaps_is_counted_once() {
        let mut builder = BaselineBuilder::new(1, 50_000_000);
        for k in 0..100 {
            for row in 0..5 {
                builder.handle_sample(Stamp((k * 2 + row) * 10_000_000), &[0.0]);
            }
        }
        assert!((builder.span_s() - 2.02).abs() < 1e-9);
    }

    #[test]
    fn a_calibration_with_touches_looks_loaded() {
        assert!(judge_loaded(10, 100, &LIMITS).is_ok());
        let text = judge_loaded(40, 100, &LIMITS).unwrap_err().to_string();
        assert!(text.contains("40 % of its frames read more than 0.5 N, at most 10 % may"), "{text}");
    }
}
