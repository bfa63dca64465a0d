//! Labels of a session: the tared true force, and the annotations.

use std::path::Path;
use std::sync::Arc;

use super::SessionError;
use crate::bag::{BagReader, InputTopics, Inputs};
use crate::config::Config;
use crate::eval::{Asked, Cuts, Origin, Part, ScoredFrames, Scoring, Split, TOUCH, TareCurve, ZeroLoadCheck};
use crate::fusion::{ContactThresholds, ForceGain, GainError};
use crate::msg::Stage;
use crate::observer::{Observer, check};
use crate::protocol::Annotations;
use crate::recording::{
    self, AxisTares, EstimateTrack, Labels, Listener, Notes, TruthTrack, aligned, end_of_touches, input_topics,
    known_touches, read,
};
use crate::units::{GramForce, Stamp};

/// Time of taxels that is read before a scored span: a window, and time for contact to settle.
const LEAD_NS: i64 = 2_000_000_000;

/// Force sensors that a bag must have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NeedsTruth {
    /// All force sensors of the parameters: the user asked for one by its topic.
    All,
    /// None. Without a force sensor there are no scores, only the other results.
    None,
    /// None. A sensor that can't be tared, because annotations are missing, counts as missing.
    Tared,
}

/// Readings of a force sensor, and their tare.
#[derive(Debug, Clone)]
struct Truth {
    track: TruthTrack,
    tare: TareCurve,
    /// Of a sensor with three axes.
    axes: Option<AxisTares>,
}

/// Labels of a session, and its division into training and test parts.
#[derive(Debug)]
pub struct Labelled {
    notes: Notes,
    annotations: Annotations,
    /// Annotations from outside of the bag.
    told: Option<Arc<[Stage]>>,
    cuts: Option<Cuts>,
    /// `[force sensors]`; `None` if the bag lacks its topic.
    truth: Vec<Option<Truth>>,
    missing: Vec<String>,
    /// True if the bag has force sensors that can't be tared, because annotations are missing.
    is_untared: bool,
    /// `[force sensors]`: end of its known touches. Frames before it are not scored.
    heads: Vec<Option<Stamp>>,
}

impl Labelled {
    /// Reads true force and annotations. Doubts about the true force are noted.
    ///
    /// # Errors
    /// [`SessionError`] if the bag can't be read, or lacks required data.
    pub fn read(
        bag: &Path,
        cfg: &Config,
        split: Option<Split>,
        needs: NeedsTruth,
        observer: &dyn Observer,
    ) -> Result<Self, SessionError> {
        let in_bag = |error: &dyn std::fmt::Display| SessionError::at(bag, error);
        let mut reader = BagReader::open(&[bag.to_path_buf()])?;
        let names: Vec<&str> = cfg.truth().iter().map(|topic| topic.name.as_str()).collect();
        let taxels = cfg.tactile().iter().map(|topic| topic.name.as_str());
        let inputs: Vec<&str> = names.iter().copied().chain(taxels).collect();
        reader.scan(&inputs)?;
        let has = |name: &str| reader.channels().iter().any(|channel| channel.topic == name);
        let is_estimates_alone = !inputs.iter().any(|name| has(name));
        let there: Vec<usize> = (0..names.len()).filter(|idx| needs == NeedsTruth::All || has(names[*idx])).collect();
        let absent: Vec<&str> = (0..names.len()).filter(|idx| !there.contains(idx)).map(|idx| names[idx]).collect();
        let topics = InputTopics {
            taxels: Vec::new(),
            joints: Vec::new(),
            joint_sources: Vec::new(),
            truth: there.iter().map(|idx| cfg.truth()[*idx].clone()).collect(),
            ..input_topics(cfg)
        };
        let mut inputs = Inputs::new(topics, &mut reader).map_err(|error| in_bag(&error))?;
        let sources: Vec<_> = there.iter().map(|idx| cfg.truth_sources()[*idx].clone()).collect();
        let mut labels = Labels::new(&sources);
        let is_whole = !inputs.read_only_these(&mut reader);
        let span = reader.summary().span.filter(|_| !is_whole);
        let mut last = span.map_or(Stamp(i64::MIN), |(_, last)| last);
        let listener = Listener::<SessionError> {
            on_tick: &mut |_, _| {},
            on_other: &mut |message| {
                last = last.max(message.log_time);
                Ok(())
            },
            is_wanted: &|_| false,
            pose: &mut [],
            between: &mut |_| Ok(check(observer)?),
        };
        read(&mut reader, &mut inputs, &mut labels, &mut [], listener).map_err(|stopped| stopped.of_bag(bag))?;
        inputs.check_end(std::iter::empty()).map_err(|error| in_bag(&error))?;
        let Labels { notes, annotations, truth: mut tracks } = labels;
        let mut missing = Vec::new();
        match (names.is_empty(), absent.as_slice()) {
            (true, _) => missing.push(
                "no region has a true force, so there are no scores; set truth_sources and truth.*.topic in the parameters, or give --truth TOPIC"
                    .to_owned(),
            ),
            (false, []) => {}
            (false, absent) if absent.len() < names.len() => {
                missing.push(format!("no true force of some regions: the bag has no topic {}", absent.join(", ")));
            }
            (false, _) if is_estimates_alone => missing.push(
                "no true force, so no scores: the bag holds estimates without their inputs; score the bag that was replayed (with --model), or replay it with --merge"
                    .to_owned(),
            ),
            (false, absent) => {
                missing.push(format!("no true force, so no scores: the bag has no topic {}", absent.join(", ")));
            }
        }
        let mut is_untared = false;
        if annotations.is_empty() && !is_estimates_alone {
            let lack = format!("no stage annotations on {}", cfg.stage_topic);
            if needs == NeedsTruth::Tared {
                is_untared = !tracks.is_empty();
                tracks.clear();
            } else if !tracks.is_empty() {
                return Err(in_bag(&format!(
                    "{lack}; the true force is tared on stretches that they mark as free of load: give --in-air FROM..TO or --zero-load-below FORCE, record that topic, or set stage_topic"
                )));
            }
            missing.push(format!("{lack}, so what was estimated in the air isn't known: give --in-air FROM..TO or --zero-load-below FORCE"));
        }
        let end = tracks.iter().filter_map(|track| Some(track.span()?.1)).max().unwrap_or(last);
        let cuts = split.filter(|_| !annotations.is_empty());
        let cuts = cuts.map(|split| split.cuts(&recording::stage_spans(&annotations, end.offset(1))));
        let zero_load = recording::zero_load(&annotations, end);
        let mut truth = vec![None; names.len()];
        for (idx, track) in there.into_iter().zip(tracks) {
            let tare = track.tare(&zero_load);
            let tare = tare.map_err(|error| in_bag(&format!("truth {}: {error}", track.name())))?;
            track.doubts(&tare).iter().for_each(|doubt| observer.warn(&format!("{}: {doubt}", bag.display())));
            let axes = track.axis_tares(&zero_load);
            let axes = axes.map_err(|error| in_bag(&format!("truth {}: {error}", track.name())))?;
            truth[idx] = Some(Truth { track, tare, axes });
        }
        let heads = vec![None; truth.len()];
        Ok(Labelled { notes, annotations, told: cfg.told_stages.clone(), cuts, truth, missing, is_untared, heads })
    }

    /// True if the bag has force sensors that are left out, because no annotations tell where to tare them.
    pub fn is_untared(&self) -> bool {
        self.is_untared
    }

    /// The labels if the first `n` touches of each force sensor are used to fit force gains. Only the frames after them
    /// are scored.
    ///
    /// # Errors
    /// [`SessionError`] if a sensor has fewer touches that are strong and long enough for a gain.
    pub fn with_known_touches(mut self, bag: &Path, n: usize) -> Result<Self, SessionError> {
        for (head, truth) in self.heads.iter_mut().zip(&self.truth) {
            let Some(Truth { track, tare, .. }) = truth else { continue };
            let tared = track.readings().map(|(stamp, force)| (stamp, tare.tared(stamp, force)));
            *head = Some(end_of_touches(tared, n).ok_or_else(|| {
                let name = track.name();
                SessionError::at(
                    bag,
                    &format!("truth {name} has fewer than {n} touches of 30 gF or more that are held for 0.1 s"),
                )
            })?);
        }
        Ok(self)
    }

    /// The force gain of a region, from the known touches of a force sensor.
    ///
    /// # Errors
    /// [`GainError`] if the touches give no gain.
    pub fn known_gain(
        &self,
        column: &EstimateTrack,
        truth_idx: Option<usize>,
        max_gap: std::time::Duration,
    ) -> Result<Option<ForceGain>, GainError> {
        let head = truth_idx.and_then(|idx| self.heads[idx]);
        let (Some(head), Some(truth)) = (head, self.truth_at(truth_idx, &column.stamp, max_gap)) else {
            return Ok(None);
        };
        let touches = known_touches(column, &truth).into_iter().filter(|touch| touch.to <= head);
        ForceGain::fit(&touches.map(|touch| touch.touch).collect::<Vec<_>>()).map(Some)
    }

    /// True if the frame at `stamp` is scored. Its window begins at `from`.
    fn is_scored(&self, from: Stamp, stamp: Stamp) -> bool {
        if self.heads.iter().flatten().any(|head| from <= *head) {
            return false;
        }
        let in_test = |at| self.cuts.as_ref().is_none_or(|cuts| cuts.part_at(at) == Some(Part::Test));
        in_test(stamp) && in_test(from)
    }

    /// True if taxels at a stamp are needed for the scored spans.
    pub fn is_wanted(&self, stamp: Stamp, offset_ns: i64) -> bool {
        let Some(cuts) = &self.cuts else { return true };
        if self.heads.iter().flatten().any(|head| stamp.offset(-offset_ns.abs()) <= *head) {
            return true;
        }
        let reach = LEAD_NS + offset_ns.abs();
        // Test parts are longer than the lead, or too short for a frame.
        [0, reach / 2, reach, -offset_ns.abs()]
            .iter()
            .any(|ahead| cuts.part_at(stamp.offset(*ahead)) == Some(Part::Test))
    }

    /// Pairs a region's estimates with its true force, if there is one. A frame is left out if its window (`window_ns`)
    /// extends beyond the scored spans.
    pub fn frames(
        &self,
        column: &EstimateTrack,
        truth_idx: Option<usize>,
        window_ns: i64,
        max_gap: std::time::Duration,
        thresholds: ContactThresholds,
        origin: &Origin,
    ) -> ScoredFrames {
        let truth = self.truth_at(truth_idx, &column.stamp, max_gap);
        let mut frames = ScoredFrames::default();
        for annotation in self.annotations.all() {
            let (stage, substage) = (annotation.stage.to_string(), annotation.substage.clone());
            let pose = if annotation.pose.is_empty() { &annotation.substage } else { &annotation.pose };
            frames.asked.push(Asked { pose: pose.clone(), zero_load: annotation.zero_load });
            frames.origins.push(Origin { stage, substage, ..origin.clone() });
        }
        if self.annotations.is_empty() {
            frames.asked.push(Asked::default());
            frames.origins.push(origin.clone());
        }
        let has_base = column.base.iter().any(Option::is_some);
        let base = column.base_alone(thresholds);
        let in_gf = |force: crate::units::Newton| GramForce::from(force).0;
        let true_tangential = self.tangential_truth_at(truth_idx, &column.stamp, max_gap);
        let has_tangential = column.has_tangential();
        let mut left_out = true;
        for (idx, stamp) in column.stamp.iter().enumerate() {
            let annotation = match self.annotations.is_empty() {
                true => Some(0),
                false => self.annotations.idx_at(*stamp),
            };
            let Some(annotation) = annotation.filter(|_| self.is_scored(stamp.offset(-window_ns), *stamp)) else {
                left_out = true;
                continue;
            };
            if std::mem::take(&mut left_out) {
                frames.resumes.push(frames.stamp.len());
            }
            frames.stamp.push(*stamp);
            frames.truth_gf.push(truth.as_ref().and_then(|truth| truth[idx]).map_or(f64::NAN, |force| force.0));
            frames.estimate_gf.push(column.force[idx].map(in_gf));
            if let Some(truth) = &true_tangential {
                frames.true_tangential_gf.push(truth[idx].map(|force| force.map(|force| force.0)));
            }
            if has_tangential {
                frames.tangential_gf.push(column.tangential[idx].map(|force| force.map(in_gf)));
            }
            if column.by_touch {
                frames.touch.push(column.touch[idx]);
                frames.touched.push(column.contact_raw[idx]);
            }
            frames.contact.push(column.contact[idx]);
            if has_base {
                frames.base_contact.push(base.contact[idx]);
                frames.base_gf.push(column.base[idx].map(in_gf));
            }
            frames.pose_age_ns.push(column.pose_age_ns[idx]);
            frames.origin.push(annotation);
        }
        frames
    }

    /// `[stamps]`: the true force of a force sensor, if there is one.
    pub fn truth_at(
        &self,
        truth_idx: Option<usize>,
        stamps: &[Stamp],
        max_gap: std::time::Duration,
    ) -> Option<Vec<Option<GramForce>>> {
        let Truth { track, tare, .. } = truth_idx.and_then(|idx| self.truth[idx].as_ref())?;
        Some(aligned(track, tare, stamps, max_gap))
    }

    /// `[stamps]`: the true tangential force of a force sensor, x y z in the frame of the patch, if there is one with three
    /// axes.
    pub fn tangential_truth_at(
        &self,
        truth_idx: Option<usize>,
        stamps: &[Stamp],
        max_gap: std::time::Duration,
    ) -> Option<Vec<Option<[GramForce; 3]>>> {
        let Truth { track, axes, .. } = truth_idx.and_then(|idx| self.truth[idx].as_ref())?;
        let tares = axes.as_ref()?;
        Some(stamps.iter().map(|stamp| track.tangential_at(tares, *stamp, max_gap)).collect())
    }

    /// The recorder's notes.
    pub fn notes(&self) -> &Notes {
        &self.notes
    }

    /// Annotations of the protocol.
    pub fn annotations(&self) -> &Annotations {
        &self.annotations
    }

    /// Annotations from outside of the bag.
    pub(super) fn told(&self) -> Option<Arc<[Stage]>> {
        self.told.clone()
    }

    /// Missing data, and the results that are missing because of them.
    pub fn missing(&self) -> &[String] {
        &self.missing
    }

    /// How well the tared true force stays below the touch threshold where nothing touches, with warnings. `None`
    /// without true force.
    pub fn zero_load_check(&self, bag: &Path, warnings: &mut Vec<String>) -> Option<ZeroLoadCheck> {
        let mut check = ZeroLoadCheck::default();
        let at_rest = |stamp| self.annotations.at(stamp).is_some_and(|annotation| annotation.zero_load);
        for Truth { track, tare, .. } in self.truth.iter().flatten() {
            let resting = track.readings().filter(|(stamp, _)| at_rest(*stamp));
            resting.for_each(|(stamp, force)| check.handle_force(&Scoring::default(), tare.tared(stamp, force)));
            let counters = track.counters();
            if counters.late + counters.non_finite > 0 {
                warnings.push(format!(
                    "{}: truth {}: {} readings out of order were dropped, {} were not finite",
                    bag.display(),
                    track.name(),
                    counters.late,
                    counters.non_finite
                ));
            }
        }
        if check.n_touch > check.n_samples / 100 {
            warnings.push(format!(
                "{}: {} of {} readings of the force sensor at zero load are {} or more after taring, up to {:.1} gF, and count as touch: touches, BA, F1 and MDF are wrong where that is its noise; filter it, or correct when nothing touches the glove",
                bag.display(),
                check.n_touch,
                check.n_samples,
                TOUCH,
                check.largest_gf
            ));
        }
        self.truth.iter().any(Option::is_some).then_some(check)
    }
}
