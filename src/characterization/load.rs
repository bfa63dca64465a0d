//! Reads the frames of every region from a bag, with the same core as the live node and with all joints in the bag.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::Path;
use std::time::Duration;

use super::scan::Scan;
use super::{CharacterizeError, Request};
use crate::bag::{BagReader, Inputs};
use crate::characterize::SessionFrames;
use crate::config::Config;
use crate::eval::{TareCurve, ZeroLoad};
use crate::fusion::{FrameClock, FusionConfig, RegionConfig, Timing};
use crate::glove::known;
use crate::observer::{Observer, check};
use crate::recording::{self, Labels, Listener, Notes, RowCollector, Rows, TruthTrack, aligned, input_topics, read};
use crate::sessions::{annotated, session_name, without_annotations};
use crate::units::{NANOS_PER_SEC, Stamp};
use crate::zero;

/// Frame rate if neither the parameters nor the stamps give it, Hz; the paper's.
const DEFAULT_RATE_HZ: f64 = 100.0;
/// If the rate of a source differs from the parameters by more than this share, its own rate is used.
const RATE_TOLERANCE: f64 = 0.05;
/// Time for which a frame waits for its joints. It is long, because nothing is published here, so that a large clock
/// offset is found, too.
const JOINT_SLACK: Duration = Duration::from_secs(1);

/// Reads bags with the same joints.
pub(super) struct GloveLoader<'c> {
    pub(super) cfg: &'c Config,
    pub(super) joints: &'c [String],
    pub(super) request: &'c Request<'c>,
    pub(super) observer: &'c dyn Observer,
}

/// Contents of a bag.
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

impl GloveLoader<'_> {
    /// Reads one bag.
    pub(super) fn load(&self, bag: &Path, scan: &Scan) -> Result<Loaded, CharacterizeError> {
        let in_bag = |error: &dyn std::fmt::Display| CharacterizeError::in_bag(bag, error);
        let (bags, mut missing) = ([bag.to_path_buf()], Vec::new());
        let cfg = annotated(self.cfg, &bags, self.request.in_air, self.observer)?;
        if self.request.in_air.is_none() && !scan.has_annotations {
            return Err(in_bag(&without_annotations(&cfg.stage_topic)));
        }
        let mut reader = BagReader::open(&bags)?;
        let truths = self.truths(&mut reader, bag, &mut missing)?;
        let mut topics = input_topics(&cfg);
        topics.truth = truths.iter().map(|truth| self.cfg.truth()[*truth].clone()).collect();
        let mut inputs = Inputs::new(topics, &mut reader).map_err(|error| in_bag(&error))?;
        inputs.read_only_these(&mut reader);
        let zero = zero::find(self.request.zero, &cfg, &bags, &known(&cfg, &[]));
        let zero = zero.map_err(|error| in_bag(&error))?;
        zero.notes.iter().for_each(|note| self.observer.note(note));
        let (mut collectors, mut cores) = (Vec::new(), Vec::new());
        let core_cfg = self.core_cfg();
        for (region_idx, region) in core_cfg.region_idxs().zip(core_cfg.regions()) {
            let rate_hz = self.rate_hz(region, scan);
            let Some(only) = core_cfg.clone().only(region_idx) else { continue };
            let (rows, mut fusion) = RowCollector::new(only, window(self.cfg, rate_hz), rate_hz, None)?;
            zero.install(&mut fusion)?;
            collectors.push(rows);
            cores.push(fusion);
        }
        let sources: Vec<_> = truths.iter().map(|truth| self.cfg.truth_sources()[*truth].clone()).collect();
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
        if labels.annotations.is_empty() {
            return Err(in_bag(&without_annotations(&cfg.stage_topic)));
        }
        let mut regions = Vec::new();
        let mut doubts: BTreeSet<String> = inputs.angle_doubts().into_iter().collect();
        for (region_idx, rows) in collectors.into_iter().enumerate() {
            let rows = rows.finish();
            let Some(last) = rows.stamp.last() else {
                let region = &self.cfg.fusion().regions()[region_idx].name;
                return Err(in_bag(&format!(
                    "region {region}: no frame has both taxels and joints; check with tpf inspect that their stamps are of one clock"
                )));
            };
            let air = AirTime { stretches: recording::zero_load(&labels.annotations, last.offset(1)) };
            let of_region = self.cfg.truth_of_region()[region_idx];
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
        doubts.iter().for_each(|doubt| self.observer.warn(&format!("{}: {doubt}", bag.display())));
        Ok(Loaded {
            regions,
            notes: labels.notes,
            in_air: self.request.in_air.map_or("annotations".to_owned(), ToString::to_string),
            zero: zero.from.to_string(),
            missing,
            losses: reader.losses().iter().map(|loss| format!("{}: {loss}", bag.display())).collect(),
        })
    }

    /// The force sensors that a bag has. Missing ones are reported.
    fn truths(
        &self,
        reader: &mut BagReader,
        bag: &Path,
        missing: &mut Vec<String>,
    ) -> Result<Vec<usize>, CharacterizeError> {
        let topics: Vec<&str> = self.cfg.truth().iter().map(|topic| topic.name.as_str()).collect();
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

    /// The core's configuration for every region, with every joint that is examined.
    fn core_cfg(&self) -> FusionConfig {
        let fusion = self.cfg.fusion().clone().with_joints(self.joints);
        let timing = Timing { joint_slack: JOINT_SLACK, ..*fusion.timing() };
        fusion.with_timing(timing)
    }

    fn rate_hz(&self, region: &RegionConfig, scan: &Scan) -> f64 {
        let expected = self.cfg.models()[region.model.position()].spec.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        let follows_source =
            self.cfg.fusion().tactile_sources()[region.source.position()].frame_clock == FrameClock::Tactile;
        let measured =
            scan.tactile[region.source.position()].timing.map(|timing| timing.rate_hz).filter(|_| follows_source);
        measured.filter(|hz| (hz / expected - 1.0).abs() > RATE_TOLERANCE).unwrap_or(expected)
    }

    /// Combines rows and labels.
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
            let forces = aligned(track, &curve, &rows.stamp, self.cfg.fusion().timing().max_gap);
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

/// The instructed pose of each frame, in the second half of an annotation only, because the hand needs time to reach
/// the pose.
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

/// Number of frames in a window: just enough to contain every gap that the core fills.
fn window(cfg: &Config, rate_hz: f64) -> NonZeroUsize {
    let n_missing = (cfg.fusion().timing().max_gap.as_secs_f64() * rate_hz).ceil() as usize;
    NonZeroUsize::MIN.saturating_add(n_missing.saturating_add(1))
}
