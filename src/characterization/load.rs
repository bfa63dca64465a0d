//! From a bag to the frames of every region: by the core that also runs live, with all joints that the bag has.

use std::collections::BTreeSet;
use std::path::Path;
use std::str::FromStr;
use std::time::Duration;

use super::scan::Scan;
use super::{CharacterizeError, Request};
use crate::bag::{BagReader, Inputs};
use crate::characterize::SessionFrames;
use crate::config::Config;
use crate::eval::{TareCurve, ZeroLoad};
use crate::fusion::{FrameClock, FusionConfig, RegionConfig};
use crate::glove::known;
use crate::observer::{Observer, check};
use crate::recording::{self, Labels, Listener, Notes, RowCollector, Rows, TruthTrack, aligned, input_topics, read};
use crate::sessions::session_name;
use crate::units::{NANOS_PER_SEC, Stamp};
use crate::zero;

/// Frames a second where neither parameters nor stamps say it; the paper's.
const DEFAULT_RATE_HZ: f64 = 100.0;
/// How far the frames of a source may be from the rate in the parameters before their own is taken.
const RATE_TOLERANCE: f64 = 0.05;
/// How long a frame waits for its joints. Nothing is published here, so that even a clock that is far off can be seen.
const JOINT_SLACK: Duration = Duration::from_secs(1);

/// When nothing touches the glove.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InAir {
    /// All of it.
    All,
    /// From and up to, s from the first taxels.
    Span(f64, f64),
}

impl FromStr for InAir {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(InAir::All);
        }
        let expected = || format!("expected FROM..TO in seconds, such as 5..35, or all; got {text:?}");
        let (from, to) = text.split_once("..").ok_or_else(expected)?;
        let seconds =
            |text: &str| text.trim().parse::<f64>().ok().filter(|s| (0.0..1e6).contains(s)).ok_or_else(expected);
        let (from, to) = (seconds(from)?, seconds(to)?);
        if from < to { Ok(InAir::Span(from, to)) } else { Err(format!("{from} s must be before {to} s")) }
    }
}

impl InAir {
    /// What to say of a recording that ends within the stretch.
    ///
    /// # Errors
    /// One line where it ends before the stretch begins.
    pub(super) fn check(self, scan: &Scan) -> Result<Option<String>, CharacterizeError> {
        let InAir::Span(from, to) = self else { return Ok(None) };
        let length = scan.end.nanos_since(scan.start) as f64 / NANOS_PER_SEC as f64;
        let bag = &scan.bag;
        if from >= length {
            let reason = format!(
                "--in-air {from}..{to} lies behind the end of the recording, which is {length:.1} s long; name a stretch of it in which nothing touches the glove"
            );
            return Err(CharacterizeError::InBag { bag: bag.clone(), reason });
        }
        Ok((to > length + 0.1)
            .then(|| format!("{bag}: is {length:.1} s long, so --in-air {from}..{to} counts up to its end")))
    }
}

impl std::fmt::Display for InAir {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            InAir::All => f.write_str("all of it"),
            InAir::Span(from, to) => write!(f, "{from} to {to} s"),
        }
    }
}

/// Reads bags with the same joints.
pub(super) struct Loader<'c> {
    pub(super) cfg: &'c Config,
    pub(super) joints: &'c [String],
    pub(super) request: &'c Request<'c>,
    pub(super) observer: &'c dyn Observer,
}

/// What a bag gave.
pub(super) struct Loaded {
    /// `[regions]`
    pub(super) regions: Vec<SessionFrames>,
    pub(super) notes: Notes,
    pub(super) in_air: String,
    pub(super) zero: String,
    pub(super) missing: Vec<String>,
    pub(super) losses: Vec<String>,
}

/// The time without load in a recording.
struct AirTime {
    stretches: Vec<ZeroLoad>,
}

impl AirTime {
    fn holds(&self, stamp: Stamp) -> bool {
        let after = self.stretches.partition_point(|stretch| stretch.from <= stamp);
        after.checked_sub(1).is_some_and(|idx| stamp < self.stretches[idx].to)
    }
}

impl Loader<'_> {
    /// Reads one bag.
    pub(super) fn load(&self, bag: &Path, scan: &Scan) -> Result<Loaded, CharacterizeError> {
        let in_bag = |error: &dyn std::fmt::Display| CharacterizeError::in_bag(bag, error);
        if self.request.in_air.is_none() && !scan.has_annotations {
            return Err(in_bag(&self.without_annotations()));
        }
        let (bags, mut missing) = ([bag.to_path_buf()], Vec::new());
        let mut reader = BagReader::open(&bags)?;
        let truths = self.truths(&mut reader, bag, &mut missing)?;
        let mut topics = input_topics(self.cfg);
        topics.truth = truths.iter().map(|truth| self.cfg.truth[*truth].clone()).collect();
        let mut inputs = Inputs::new(topics, &mut reader).map_err(|error| in_bag(&error))?;
        let zero = zero::find(self.request.zero, self.cfg, &bags, &known(self.cfg, &[]));
        let zero = zero.map_err(|error| in_bag(&error))?;
        zero.notes.iter().for_each(|note| self.observer.note(note));
        let (mut collectors, mut cores) = (Vec::new(), Vec::new());
        for region in &self.cfg.fusion.regions {
            let rate_hz = self.rate_hz(region, scan);
            let (rows, mut fusion) = RowCollector::new(self.core_of(region), window(self.cfg, rate_hz), rate_hz, None)?;
            zero.install(&mut fusion)?;
            collectors.push(rows);
            cores.push(fusion);
        }
        let sources: Vec<_> = truths.iter().map(|truth| self.cfg.truth_sources[*truth].clone()).collect();
        let mut labels = Labels::new(&sources);
        let total = reader.bytes_total();
        let listener = Listener::<CharacterizeError> {
            on_tick: &mut |core_idx, tick| collectors[core_idx].handle_tick(tick),
            on_other: &mut |_| Ok(()),
            is_wanted: &|_| true,
            pose: &mut [],
            between: &mut |bytes| {
                self.observer.progress(bytes, total);
                Ok(check(self.observer)?)
            },
        };
        read(&mut reader, &mut inputs, &mut labels, &mut cores, listener).map_err(|error| match error {
            CharacterizeError::Recording(error) => in_bag(&error),
            error => error,
        })?;
        if self.request.in_air.is_none() && labels.annotations.is_empty() {
            return Err(in_bag(&self.without_annotations()));
        }
        let mut regions = Vec::new();
        let mut doubts: BTreeSet<String> = inputs.angle_doubts().into_iter().collect();
        for (region_idx, rows) in collectors.into_iter().enumerate() {
            let rows = rows.finish();
            let (Some(first), Some(last)) = (rows.stamp.first(), rows.stamp.last()) else {
                let region = &self.cfg.fusion.regions[region_idx].name;
                return Err(in_bag(&format!(
                    "region {region}: no frame has both taxels and joints; check with tpf inspect that their stamps are of one clock"
                )));
            };
            let air = self.air_time(&labels, scan.start.min(*first), last.offset(1));
            let of_region = self.cfg.truth_of_region[region_idx];
            let track = truths.iter().position(|truth| Some(*truth) == of_region).map(|idx| &labels.truth[idx]);
            let tared = track.and_then(|track| match track.tare(&air.stretches) {
                Ok(tare) => {
                    doubts.extend(track.doubts(&tare));
                    Some((track, tare))
                }
                Err(error) => {
                    missing.push(format!("{}: truth {}: {error}, so no forces are told", bag.display(), track.name()));
                    None
                }
            });
            regions.push(self.frames(session_name(bag), &labels, &air, tared, rows));
        }
        doubts.iter().for_each(|doubt| self.observer.note(&format!("{}: {doubt}", bag.display())));
        Ok(Loaded {
            regions,
            notes: labels.notes,
            in_air: self.request.in_air.map_or("annotations".to_owned(), |in_air| in_air.to_string()),
            zero: zero.from.to_string(),
            missing,
            losses: reader.losses().iter().map(|loss| format!("{}: {loss}", bag.display())).collect(),
        })
    }

    fn without_annotations(&self) -> String {
        format!(
            "no stage annotations on {}, so that nothing says when the hand is in the air; give --in-air FROM..TO or --in-air all, or record that topic",
            self.cfg.stage_topic
        )
    }

    /// The force sensors that a bag has; says which it lacks.
    fn truths(
        &self,
        reader: &mut BagReader,
        bag: &Path,
        missing: &mut Vec<String>,
    ) -> Result<Vec<usize>, CharacterizeError> {
        let topics: Vec<&str> = self.cfg.truth.iter().map(|topic| topic.name.as_str()).collect();
        reader.scan(&topics)?;
        let is_there = |topic: &str| reader.channels().iter().any(|channel| channel.topic == topic);
        let mut there = Vec::new();
        for (truth, topic) in topics.into_iter().enumerate() {
            if self.request.needs_truth || is_there(topic) {
                there.push(truth);
            } else {
                missing.push(format!("{}: no topic {topic}, so no forces are told", bag.display()));
            }
        }
        Ok(there)
    }

    /// The core's configuration for one region, with every joint that is looked at.
    fn core_of(&self, region: &RegionConfig) -> FusionConfig {
        let mut fusion = self.cfg.fusion.clone();
        fusion.timing.joint_slack = JOINT_SLACK;
        fusion.regions =
            vec![RegionConfig { joints: self.joints.to_vec(), model_joints: Vec::new(), ..region.clone() }];
        fusion
    }

    fn rate_hz(&self, region: &RegionConfig, scan: &Scan) -> f64 {
        let expected = self.cfg.models[region.model].spec.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        let follows_source = self.cfg.fusion.tactile_sources[region.source.0].frame_clock == FrameClock::Tactile;
        let measured = scan.tactile[region.source.0].timing.map(|timing| timing.rate_hz).filter(|_| follows_source);
        measured.filter(|hz| (hz / expected - 1.0).abs() > RATE_TOLERANCE).unwrap_or(expected)
    }

    /// When nothing touches the glove, from `start` up to `end`.
    fn air_time(&self, labels: &Labels, start: Stamp, end: Stamp) -> AirTime {
        let at = |seconds: f64| start.offset((seconds * NANOS_PER_SEC as f64) as i64);
        AirTime {
            stretches: match self.request.in_air {
                None => recording::zero_load(&labels.annotations, end),
                Some(InAir::All) => vec![ZeroLoad { from: start, to: end }],
                Some(InAir::Span(from, to)) => vec![ZeroLoad { from: at(from), to: at(to) }],
            },
        }
    }

    /// Puts rows and labels together.
    fn frames(
        &self,
        name: String,
        labels: &Labels,
        air: &AirTime,
        tared: Option<(&TruthTrack, TareCurve)>,
        rows: Rows,
    ) -> SessionFrames {
        let first = rows.stamp.first().copied().unwrap_or_default();
        let seconds = |stamp: &Stamp| stamp.nanos_since(first) as f64 / NANOS_PER_SEC as f64;
        let (mut truth_gf, mut tare) = (Vec::new(), Vec::new());
        if let Some((track, curve)) = tared {
            let forces = aligned(track, &curve, &rows.stamp, self.cfg.fusion.timing.max_gap);
            truth_gf = forces.into_iter().map(|force| force.map_or(f64::NAN, |force| force.0)).collect();
            tare = curve.knots().iter().map(|knot| (seconds(&knot.at), knot.tare.0)).collect();
        }
        let (instructed, poses) = instructed(labels, &rows.stamp);
        SessionFrames {
            name,
            time_s: rows.stamp.iter().map(seconds).collect(),
            in_air: rows.stamp.iter().map(|stamp| air.holds(*stamp)).collect(),
            stretch: rows.stretch,
            tactile: rows.tactile,
            pose: rows.pose,
            truth_gf,
            instructed,
            poses,
            tare,
        }
    }
}

/// The instructed pose of each frame: within the second half of an annotation, because taking it up needs time.
fn instructed(labels: &Labels, stamps: &[Stamp]) -> (Vec<Option<usize>>, Vec<String>) {
    let all = labels.annotations.all();
    let mut poses: Vec<String> = all.iter().map(|annotation| annotation.pose.clone()).collect();
    poses.sort();
    poses.dedup();
    poses.retain(|pose| !pose.is_empty());
    let end = stamps.last().copied().unwrap_or_default();
    let of_frame = |stamp: &Stamp| {
        let idx = labels.annotations.idx_at(*stamp)?;
        let from = all[idx].from;
        let to = all.get(idx + 1).map_or(end, |next| next.from);
        let is_taken_up = 2 * stamp.nanos_since(from) >= to.nanos_since(from);
        poses.binary_search(&all[idx].pose).ok().filter(|_| is_taken_up)
    };
    (stamps.iter().map(of_frame).collect(), poses)
}

/// Frames of a window: so many that every gap that the core fills lies within one, and no more.
fn window(cfg: &Config, rate_hz: f64) -> usize {
    (cfg.fusion.timing.max_gap.as_secs_f64() * rate_hz).ceil() as usize + 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretch_in_the_air_is_seconds_or_all() {
        assert_eq!("all".parse(), Ok(InAir::All));
        assert_eq!("5..35.5".parse(), Ok(InAir::Span(5.0, 35.5)));
        for wrong in ["", "5", "5..", "35..5", "-1..5", "a..b", "0..nan"] {
            assert!(wrong.parse::<InAir>().is_err(), "{wrong}");
        }
    }
}
