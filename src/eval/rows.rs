//! The statistics of an [`Evaluation`] as rows of sufficient statistics, and back: bit by bit the same.

use super::class::Class;
use super::density::N_BINS;
use super::evaluation::{ContactTallies, Evaluation, FREE_MOVEMENT};
use super::groups::Origin;
use super::held;
use super::in_air::{MAX_SUM, Sizes};
use super::metrics::Tally;
use super::scoring::{MAX_BINS, Scoring};
use super::tangential::TangentialTally;
use crate::histogram::Histogram;

/// Counts beyond this are no counts of frames: at 1 kHz it is 35 years. Sums of many of them still fit.
const MAX_COUNT: i64 = 1 << 40;

/// Nanoseconds beyond this are no length of a recording: it is three months.
const MAX_NANOS: i64 = 1 << 53;

/// One row of statistics. What its kind has no use for is `None` or empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StatRow {
    /// Its kind: `frames`, `touch_by`, `pose_age`, `held`, `density`, `in_air`, `detection` or `preservation`.
    pub of: String,
    /// Which of its statistics: `touch`, `bin` or `tangential` of frames, `n_missed` of detection.
    pub name: String,
    /// Where its frames come from; of contacts the glove alone.
    pub origin: Origin,
    /// The pose that was asked for, in the air.
    pub pose: String,
    /// Which bin: of true force, pose age, or the force of held touches.
    pub bin: Option<i64>,
    /// Frames, touches, or nanoseconds.
    pub n: Option<i64>,
    /// Of these, those in which touch was detected; of tangential forces, those that have an angle.
    pub n_detected: Option<i64>,
    /// Besides these, those without an estimate.
    pub n_missing: Option<i64>,
    /// Sum of the sizes of the errors, gF.
    pub abs_error_gf: Option<f64>,
    /// Sum of the errors, gF.
    pub error_gf: Option<f64>,
    /// Sum of the true forces, gF.
    pub truth_gf: Option<f64>,
    /// Sum of the estimated forces, gF.
    pub estimate_gf: Option<f64>,
    /// Mean of the true forces, gF.
    pub truth_mean_gf: Option<f64>,
    /// Sum of the squares of the true forces around their mean, gF^2.
    pub truth_m2: Option<f64>,
    /// Sum of the squares of the errors, gF^2.
    pub squared_error: Option<f64>,
    /// Every value, where quantiles are taken of few: latencies and delays in ms. Of `density` the frames in each bin of the
    /// estimated force. Of sizes of forces in the air, in steps of 1/1024 gF, their sum, the smallest and the largest, or bins of
    /// the histogram, each with the frames in it. Of tangential forces the sums of their errors along x, y and z, gF, and of the
    /// angles, degrees.
    pub samples: Option<Vec<f64>>,
}

/// A row that no evaluation has.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum RowError {
    #[error("a row of {of:?} is named {name:?}, which this version does not know")]
    Unknown { of: String, name: String },
    #[error("a row of {of}, {name} has {what} {got}, expected {expected}")]
    Value { of: String, name: String, what: &'static str, got: String, expected: String },
    #[error("forces in the air have a sum without a histogram, or a histogram without a sum")]
    HalfOfSizes,
}

impl Evaluation {
    /// Its statistics. From them [`Evaluation::from_rows`] makes the same evaluation.
    pub fn rows(&self) -> Vec<StatRow> {
        let mut rows = vec![count("touch_by", "touch_output", "", i64::from(self.by_touch))];
        self.all.by_origin().iter().for_each(|(origin, tally)| rows_of_frames(&mut rows, origin, tally));
        self.by_glove.iter().for_each(|(glove, tallies)| rows_of_contacts(&mut rows, glove, tallies));
        rows
    }

    /// The evaluation that gave these rows, scored by the same rules.
    ///
    /// # Errors
    /// [`RowError`] for rows that no evaluation gives.
    pub fn from_rows(scoring: Scoring, rows: &[StatRow]) -> Result<Self, RowError> {
        let mut evaluation = Evaluation::new(scoring);
        for row in rows {
            match row.of.as_str() {
                "touch_by" => evaluation.by_touch |= row.count()? > 0,
                "frames" => {
                    read_frames(evaluation.all.at(row.origin.clone()), row)?;
                    if row.origin.substage.contains(FREE_MOVEMENT) {
                        read_frames(evaluation.free_movement.at(row.origin.clone()), row)?;
                    }
                }
                _ => read_contacts(evaluation.contacts_of(&row.origin.glove), row)?,
            }
        }
        // Sizes have ends where there are any.
        let in_air = |glove: &ContactTallies| glove.in_air.by_pose.values().all(|sums| sums.sizes.is_whole());
        if !evaluation.by_glove.values().all(in_air) {
            return Err(RowError::HalfOfSizes);
        }
        Ok(evaluation)
    }
}

fn named(of: &str, name: &str, glove: &str) -> StatRow {
    let origin = Origin { glove: glove.to_owned(), ..Origin::default() };
    StatRow { of: of.to_owned(), name: name.to_owned(), origin, ..StatRow::default() }
}

fn count(of: &str, name: &str, glove: &str, n: i64) -> StatRow {
    StatRow { n: Some(n), ..named(of, name, glove) }
}

fn samples(of: &str, name: &str, glove: &str, samples: &[f64]) -> StatRow {
    StatRow { samples: Some(samples.to_vec()), ..named(of, name, glove) }
}

/// A whole number that was written as a double; `None` where it is none, or above `most`.
fn number_to(n: f64, most: u64) -> Option<u64> {
    (n.fract() == 0.0 && (0.0..=most as f64).contains(&n)).then_some(n as u64)
}

/// A count as it is written.
fn whole(n: u64) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}

fn rows_of_frames(rows: &mut Vec<StatRow>, origin: &Origin, tally: &Tally) {
    let row = |name: &str| StatRow { origin: origin.clone(), ..named("frames", name, "") };
    let class = |name: &str, bin: Option<u32>, class: &Class| StatRow {
        bin: bin.map(i64::from),
        n: Some(whole(class.n)),
        n_detected: Some(whole(class.n_detected)),
        n_missing: Some(whole(class.n_missing)),
        abs_error_gf: Some(class.abs_error),
        truth_gf: Some(class.truth),
        estimate_gf: Some(class.estimate),
        ..row(name)
    };
    rows.push(StatRow {
        truth_mean_gf: Some(tally.truth_mean),
        truth_m2: Some(tally.truth_m2),
        squared_error: Some(tally.squared_error),
        ..row("all")
    });
    rows.push(StatRow { n: Some(whole(tally.n_without_truth)), ..row("without_truth") });
    rows.push(StatRow { n: Some(whole(tally.beyond_bins)), ..row("beyond_bins") });
    rows.push(class("no_touch", None, &tally.no_touch));
    rows.push(class("touch", None, &tally.touch));
    rows.extend(tally.bins.iter().map(|(bin, of_bin)| class("bin", Some(*bin), of_bin)));
    let TangentialTally { n, abs_error, error: [x, y, z], n_angles, angle_deg } = tally.tangential;
    if n > 0 {
        rows.push(StatRow {
            n: Some(whole(n)),
            n_detected: Some(whole(n_angles)),
            abs_error_gf: Some(abs_error),
            samples: Some(vec![x, y, z, angle_deg]),
            ..row("tangential")
        });
    }
}

fn read_frames(tally: &mut Tally, row: &StatRow) -> Result<(), RowError> {
    match row.name.as_str() {
        "all" => {
            tally.truth_mean = row.number("truth_mean_gf", row.truth_mean_gf)?;
            tally.truth_m2 = row.number("truth_m2", row.truth_m2)?;
            tally.squared_error = row.number("squared_error", row.squared_error)?;
        }
        "without_truth" => tally.n_without_truth = row.count()?,
        "beyond_bins" => tally.beyond_bins = row.count()?,
        "no_touch" => tally.no_touch = row.class()?,
        "touch" => tally.touch = row.class()?,
        "bin" => {
            let bin = row.bin_below(MAX_BINS as usize)?;
            tally.bins.insert(bin as u32, row.class()?);
        }
        "tangential" => {
            let n = row.within("n", row.n, MAX_COUNT)?;
            let &[x, y, z, angle_deg] = row.samples()? else {
                return Err(row.wrong("samples", row.samples.as_ref().map(Vec::len), "4 sums"));
            };
            tally.tangential = TangentialTally {
                n: n.unsigned_abs(),
                abs_error: row.number("abs_error_gf", row.abs_error_gf)?,
                error: [x, y, z],
                n_angles: row.within("n_detected", row.n_detected, n)?.unsigned_abs(),
                angle_deg,
            };
        }
        _ => return Err(row.unknown()),
    }
    Ok(())
}

fn rows_of_contacts(rows: &mut Vec<StatRow>, glove: &str, tallies: &ContactTallies) {
    let ContactTallies { detection, preservation, pose_age, in_air, held, density } = tallies;
    let counts = &detection.counts;
    rows.extend(
        [
            ("n_true", counts.n_true),
            ("n_true_too_short", counts.n_true_too_short),
            ("n_detected", counts.n_detected),
            ("n_missed", counts.n_missed),
            ("n_merged", counts.n_merged),
            ("n_split", counts.n_split),
            ("n_onset_unseen", counts.n_onset_unseen),
            ("n_offset_unseen", counts.n_offset_unseen),
            ("n_false", counts.air.n),
        ]
        .map(|(name, n)| count("detection", name, glove, whole(n))),
    );
    rows.push(count("detection", "air_ns", glove, detection.air_ns));
    rows.push(samples("detection", "onset_ms", glove, &detection.onset_ms));
    rows.push(samples("detection", "offset_ms", glove, &detection.offset_ms));
    let counts = &preservation.counts;
    rows.extend(
        [
            ("n_true", counts.n_true),
            ("n_kept", counts.n_kept),
            ("n_delayed", counts.n_delayed),
            ("n_delay_unseen", counts.n_delay_unseen),
            ("n_removed", counts.n_removed),
            ("n_gained", counts.n_gained),
            ("n_in_neither", counts.n_in_neither),
        ]
        .map(|(name, n)| count("preservation", name, glove, whole(n))),
    );
    rows.push(count("preservation", "base_ns", glove, preservation.base_ns));
    rows.push(count("preservation", "lost_ns", glove, preservation.lost_ns));
    rows.push(samples("preservation", "delay_ms", glove, &preservation.delay_ms));
    rows.extend(pose_age.sums.iter().enumerate().map(|(bin, sums)| StatRow {
        bin: i64::try_from(bin).ok(),
        abs_error_gf: Some(sums.abs_error),
        error_gf: Some(sums.error),
        ..count("pose_age", "frames", glove, whole(sums.n))
    }));
    for (bin, sums) in held.bins.iter().enumerate() {
        let bin = i64::try_from(bin).ok();
        rows.push(StatRow { bin, ..count("held", "touches", glove, whole(sums.n)) });
        rows.extend([("at_1_s", &sums.at_1_s), ("later", &sums.later)].map(|(name, part)| StatRow {
            bin,
            n_detected: Some(whole(part.n_found)),
            truth_gf: Some(part.truth_gf),
            estimate_gf: Some(part.estimate_gf),
            ..count("held", name, glove, whole(part.n))
        }));
    }
    for (bin, frames) in density.frames.iter().enumerate().filter(|(_, frames)| frames.iter().any(|n| *n > 0)) {
        let frames: Vec<f64> = frames.iter().map(|n| *n as f64).collect();
        rows.push(StatRow { bin: i64::try_from(bin).ok(), ..samples("density", "frames", glove, &frames) });
    }
    for (pose, sums) in &in_air.by_pose {
        let Sizes { histogram, sum, ends } = &sums.sizes;
        let of_pose = |row: StatRow| StatRow { pose: pose.clone(), ..row };
        rows.push(of_pose(count("in_air", "air_ns", glove, sums.air_ns)));
        rows.push(of_pose(count("in_air", "without_estimate", glove, whole(sums.n_without_estimate))));
        rows.push(of_pose(count("in_air", "false_touches", glove, whole(sums.n_false_touches))));
        if let Some((least, most)) = ends {
            let totals = [*sum, *least, *most].map(|steps| steps as f64);
            rows.push(of_pose(samples("in_air", "abs_force_sum_min_max", glove, &totals)));
        }
        let bins: Vec<f64> = histogram.bins().flat_map(|(bin, n)| [f64::from(bin), n as f64]).collect();
        rows.push(of_pose(samples("in_air", "abs_force_bins", glove, &bins)));
    }
}

fn read_contacts(tallies: &mut ContactTallies, row: &StatRow) -> Result<(), RowError> {
    let ContactTallies { detection, preservation, pose_age, in_air, held, density } = tallies;
    let found = &mut detection.counts;
    let kept = &mut preservation.counts;
    match (row.of.as_str(), row.name.as_str()) {
        ("detection", "n_true") => found.n_true = row.count()?,
        ("detection", "n_true_too_short") => found.n_true_too_short = row.count()?,
        ("detection", "n_detected") => found.n_detected = row.count()?,
        ("detection", "n_missed") => found.n_missed = row.count()?,
        ("detection", "n_merged") => found.n_merged = row.count()?,
        ("detection", "n_split") => found.n_split = row.count()?,
        ("detection", "n_onset_unseen") => found.n_onset_unseen = row.count()?,
        ("detection", "n_offset_unseen") => found.n_offset_unseen = row.count()?,
        ("detection", "n_false") => found.air.n = row.count()?,
        ("detection", "air_ns") => detection.air_ns = row.nanos()?,
        ("detection", "onset_ms") => detection.onset_ms = row.samples()?.to_vec(),
        ("detection", "offset_ms") => detection.offset_ms = row.samples()?.to_vec(),
        ("preservation", "n_true") => kept.n_true = row.count()?,
        ("preservation", "n_kept") => kept.n_kept = row.count()?,
        ("preservation", "n_delayed") => kept.n_delayed = row.count()?,
        ("preservation", "n_delay_unseen") => kept.n_delay_unseen = row.count()?,
        ("preservation", "n_removed") => kept.n_removed = row.count()?,
        ("preservation", "n_gained") => kept.n_gained = row.count()?,
        ("preservation", "n_in_neither") => kept.n_in_neither = row.count()?,
        ("preservation", "base_ns") => preservation.base_ns = row.nanos()?,
        ("preservation", "lost_ns") => preservation.lost_ns = row.nanos()?,
        ("preservation", "delay_ms") => preservation.delay_ms = row.samples()?.to_vec(),
        ("pose_age", "frames") => {
            let bin = row.bin_below(pose_age.sums.len())?;
            let sums = &mut pose_age.sums[bin];
            sums.n = row.count()?;
            sums.abs_error = row.number("abs_error_gf", row.abs_error_gf)?;
            sums.error = row.number("error_gf", row.error_gf)?;
        }
        ("held", "touches") => held.bins[row.bin_below(held.bins.len())?].n = row.count()?,
        ("held", "at_1_s") => held.bins[row.bin_below(held.bins.len())?].at_1_s = row.held_part()?,
        ("held", "later") => held.bins[row.bin_below(held.bins.len())?].later = row.held_part()?,
        ("density", "frames") => density.frames[row.bin_below(N_BINS)?] = row.counts()?,
        ("in_air", name) => {
            let sums = in_air.by_pose.entry(row.pose.clone()).or_default();
            match name {
                "air_ns" => sums.air_ns = row.nanos()?,
                "without_estimate" => sums.n_without_estimate = row.count()?,
                "false_touches" => sums.n_false_touches = row.count()?,
                "abs_force_sum_min_max" => {
                    let [sum, least, most] = row.whole_numbers(MAX_SUM)?;
                    if least > most || sums.sizes.ends.is_some() {
                        return Err(row.wrong(
                            "samples",
                            Some(format!("{least} to {most}")),
                            "the smallest and the largest, once",
                        ));
                    }
                    (sums.sizes.sum, sums.sizes.ends) = (sum, Some((least, most)));
                }
                "abs_force_bins" => {
                    if sums.sizes.histogram.n() > 0 {
                        return Err(row.wrong("samples", Some("a second histogram"), "one for each pose"));
                    }
                    for pair in row.samples()?.chunks(2) {
                        let bin = pair.first().and_then(|bin| number_to(*bin, u64::from(Histogram::<8>::N_BINS) - 1));
                        let n = pair.get(1).and_then(|n| number_to(*n, MAX_COUNT.unsigned_abs()));
                        let Some((bin, n)) = bin.zip(n) else {
                            return Err(row.wrong("samples", Some(format!("{pair:?}")), "bins and their counts"));
                        };
                        sums.sizes.histogram.add(bin as u32, n);
                    }
                }
                _ => return Err(row.unknown()),
            }
        }
        _ => return Err(row.unknown()),
    }
    Ok(())
}

impl StatRow {
    fn unknown(&self) -> RowError {
        RowError::Unknown { of: self.of.clone(), name: self.name.clone() }
    }

    fn wrong(&self, what: &'static str, got: Option<impl ToString>, expected: impl ToString) -> RowError {
        let got = got.map_or("nothing".to_owned(), |got| got.to_string());
        RowError::Value { of: self.of.clone(), name: self.name.clone(), what, got, expected: expected.to_string() }
    }

    fn within(&self, what: &'static str, value: Option<i64>, most: i64) -> Result<i64, RowError> {
        let found = value.filter(|value| (0..=most).contains(value));
        found.ok_or_else(|| self.wrong(what, value, format!("0 to {most}")))
    }

    fn count(&self) -> Result<u64, RowError> {
        Ok(self.within("n", self.n, MAX_COUNT)?.unsigned_abs())
    }

    fn nanos(&self) -> Result<i64, RowError> {
        self.within("n", self.n, MAX_NANOS)
    }

    fn bin_below(&self, n_bins: usize) -> Result<usize, RowError> {
        let found = self.bin.and_then(|bin| usize::try_from(bin).ok()).filter(|bin| *bin < n_bins);
        found.ok_or_else(|| self.wrong("bin", self.bin, format!("0 to {}", n_bins.saturating_sub(1))))
    }

    fn number(&self, what: &'static str, value: Option<f64>) -> Result<f64, RowError> {
        value.ok_or_else(|| self.wrong(what, value, "a number"))
    }

    fn samples(&self) -> Result<&[f64], RowError> {
        self.samples.as_deref().ok_or_else(|| self.wrong("samples", None::<i64>, "a list of numbers"))
    }

    /// Counts in so many bins.
    fn counts<const N: usize>(&self) -> Result<[u64; N], RowError> {
        self.whole_numbers(MAX_COUNT.unsigned_abs())
    }

    /// So many whole numbers.
    fn whole_numbers<const N: usize>(&self, most: u64) -> Result<[u64; N], RowError> {
        let samples = self.samples()?;
        let numbers: Vec<u64> = samples.iter().filter_map(|n| number_to(*n, most)).collect();
        numbers.try_into().map_err(|_| {
            self.wrong("samples", Some(format!("{samples:?}")), format!("{N} whole numbers, at most {most}"))
        })
    }

    fn class(&self) -> Result<Class, RowError> {
        let n = self.within("n", self.n, MAX_COUNT)?;
        Ok(Class {
            n: n.unsigned_abs(),
            n_detected: self.within("n_detected", self.n_detected, n)?.unsigned_abs(),
            n_missing: self.within("n_missing", self.n_missing, MAX_COUNT)?.unsigned_abs(),
            abs_error: self.number("abs_error_gf", self.abs_error_gf)?,
            truth: self.number("truth_gf", self.truth_gf)?,
            estimate: self.number("estimate_gf", self.estimate_gf)?,
        })
    }

    fn held_part(&self) -> Result<held::Part, RowError> {
        let n = self.within("n", self.n, MAX_COUNT)?;
        Ok(held::Part {
            n: n.unsigned_abs(),
            n_found: self.within("n_detected", self.n_detected, n)?.unsigned_abs(),
            truth_gf: self.number("truth_gf", self.truth_gf)?,
            estimate_gf: self.number("estimate_gf", self.estimate_gf)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_that_no_evaluation_gives_are_refused() {
        let row = |name: &str, numbers: &[f64]| samples("in_air", name, "1", numbers);
        let (ends, bins) = ("abs_force_sum_min_max", "abs_force_bins");
        let read = |rows: &[StatRow]| Evaluation::from_rows(Scoring::default(), rows);
        let good = [row(ends, &[12.0, 3.0, 5.0]), row(bins, &[3.0, 2.0, 5.0, 1.0])];
        let read_back = read(&good).unwrap().rows();
        assert!(good.iter().all(|row| read_back.contains(row)), "{read_back:?}");
        let forged: [&[StatRow]; 9] = [
            &[row(ends, &[12.0, 5.0, 3.0]), good[1].clone()],
            &[row(ends, &[12.5, 3.0, 5.0]), good[1].clone()],
            &[row(ends, &[12.0, 3.0]), good[1].clone()],
            &[good[0].clone()],
            &[good[1].clone()],
            &[good[0].clone(), good[0].clone(), good[1].clone()],
            &[good[0].clone(), good[1].clone(), good[1].clone()],
            &[good[0].clone(), row(bins, &[3.0])],
            &[good[0].clone(), row(bins, &[1e9, 1.0])],
        ];
        for rows in forged {
            assert!(read(rows).is_err(), "{rows:?}");
        }
    }
}
