//! Makes annotations for recordings without any. The times at which nothing touches the glove come from a person or
//! from the true force.

mod force;

use std::path::PathBuf;
use std::str::FromStr;

use super::SessionError;
use crate::bag::{BagReader, Input, InputTopics, Inputs, shown};
use crate::config::{Config, TruthSource};
use crate::eval::ZeroLoad;
use crate::fusion::Event;
use crate::msg::{Header, Stage};
use crate::observer::{Observer, check};
use crate::protocol::{Annotation, Annotations};
use crate::recording::{TruthTrack, input_topics};
use crate::units::{NANOS_PER_SEC, Newton, Stamp, nanos};

pub use force::MARGIN;

/// A longer span without load becomes several annotations, so that the tare follows a drift of the force sensor within
/// it. The protocol's annotations last a few seconds each.
const LONGEST_NS: i64 = 10 * NANOS_PER_SEC;

/// Source for the times at which nothing touches the glove, instead of the annotations of a recording.
#[derive(Debug, Clone, PartialEq)]
pub enum InAir {
    /// A person: the whole recording.
    All,
    /// A person: start and end, s from the first taxels of the recording, in order of time and not overlapping.
    Spans(Vec<(f64, f64)>),
    /// The true force: nothing touches while all force sensors of the recording are below this, and for [`MARGIN`]
    /// before and after.
    Below(Newton),
}

impl InAir {
    /// From spans in any order, which may touch and overlap.
    pub fn of_spans(mut spans: Vec<(f64, f64)>) -> Self {
        spans.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut apart: Vec<(f64, f64)> = Vec::new();
        for (from, to) in spans {
            match apart.last_mut() {
                Some(last) if from <= last.1 => last.1 = last.1.max(to),
                _ => apart.push((from, to)),
            }
        }
        InAir::Spans(apart)
    }
}

impl FromStr for InAir {
    type Err = String;

    /// Parses `all`, or spans in seconds such as `5..35` or `0..10,60..75`.
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(InAir::All);
        }
        let expected = || format!("expected FROM..TO in seconds, such as 5..35, or all; got {text:?}");
        let seconds =
            |text: &str| text.trim().parse::<f64>().ok().filter(|s| (0.0..1e6).contains(s)).ok_or_else(expected);
        let span = |text: &str| {
            let (from, to) = text.split_once("..").ok_or_else(expected)?;
            let (from, to) = (seconds(from)?, seconds(to)?);
            if from < to { Ok((from, to)) } else { Err(format!("{from} s must be before {to} s")) }
        };
        Ok(InAir::of_spans(text.split(',').map(span).collect::<Result<_, _>>()?))
    }
}

impl std::fmt::Display for InAir {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            InAir::All => f.write_str("all of it"),
            InAir::Spans(spans) => {
                let spans: Vec<String> = spans.iter().map(|(from, to)| format!("{from} to {to} s")).collect();
                f.write_str(&spans.join(", "))
            }
            InAir::Below(force) => write!(f, "true force below {force}"),
        }
    }
}

/// The error for a recording without annotations, which names the alternatives.
pub fn without_annotations(stage_topic: &str) -> String {
    format!(
        "no stage annotations on {stage_topic}, so that nothing says when the hand is in the air; give --in-air FROM..TO or --zero-load-below FORCE, or record that topic"
    )
}

/// The configuration for one recording. With `in_air`, it contains annotations made from it, which replace those on the
/// stage topic. Existing annotations keep their stages and poses.
///
/// # Errors
/// [`SessionError`] if the recording can't be read, is shorter than the given spans, or lacks the true force.
pub fn annotated(
    cfg: &Config,
    bags: &[PathBuf],
    in_air: Option<&InAir>,
    observer: &dyn Observer,
) -> Result<Config, SessionError> {
    let Some(in_air) = in_air else { return Ok(cfg.clone()) };
    let bag = bags.first().map(|bag| shown(bag)).unwrap_or_default();
    let refuse = |reason: String| SessionError::At { path: bag.clone(), reason };
    let seen = Seen::read(cfg, bags, in_air, observer)?;
    let free = match in_air {
        InAir::All => vec![ZeroLoad { from: seen.start, to: seen.end.offset(1) }],
        InAir::Spans(spans) => {
            seen.check(spans, &bag).map_err(&refuse)?.iter().for_each(|note| observer.note(note));
            let at = |seconds: f64| seen.start.offset((seconds * NANOS_PER_SEC as f64) as i64);
            spans.iter().map(|(from, to)| ZeroLoad { from: at(*from), to: at(*to) }).collect()
        }
        InAir::Below(limit) => {
            let max_gap_ns = nanos(cfg.fusion().timing().max_gap);
            let free = force::below(&seen.truth, *limit, max_gap_ns).map_err(&refuse)?;
            let seconds: f64 = free.iter().map(|free| free.to.nanos_since(free.from) as f64 * 1e-9).sum();
            observer.note(&format!(
                "{bag}: the true force is below {limit} for {seconds:.1} s, in {} stretches",
                free.len()
            ));
            free
        }
    };
    let begin = seen.truth.iter().filter_map(|track| Some(track.span()?.0)).chain([seen.start]).min();
    let told = stages(&seen.annotations, &free, begin.unwrap_or_default());
    let mut cfg = cfg.clone();
    cfg.told_stages = Some(told.into());
    Ok(cfg)
}

/// Data of a recording that show when nothing touches the glove.
struct Seen {
    /// Stamps of the first and the last taxels.
    start: Stamp,
    end: Stamp,
    annotations: Annotations,
    /// Force sensors in the recording. Empty if the force is not used.
    truth: Vec<TruthTrack>,
}

impl Seen {
    fn read(cfg: &Config, bags: &[PathBuf], in_air: &InAir, observer: &dyn Observer) -> Result<Self, SessionError> {
        let bag = bags.first().map(|bag| shown(bag)).unwrap_or_default();
        let at = |reason: String| SessionError::At { path: bag.clone(), reason };
        let mut reader = BagReader::open(bags)?;
        let mut sources: Vec<TruthSource> = Vec::new();
        let mut truth = Vec::new();
        if let InAir::Below(_) = in_air {
            let names: Vec<&str> = cfg.truth().iter().map(|topic| topic.name.as_str()).collect();
            if names.is_empty() {
                return Err(at("--zero-load-below needs the true force: set truth_sources and truth.*.topic in the parameters, or give --truth TOPIC, or --in-air FROM..TO".to_owned()));
            }
            reader.scan(&names)?;
            let has = |name: &str| reader.channels().iter().any(|channel| channel.topic == name);
            let there = (0..names.len()).filter(|idx| has(names[*idx]));
            (sources, truth) = there.map(|idx| (cfg.truth_sources()[idx].clone(), cfg.truth()[idx].clone())).unzip();
            if truth.is_empty() {
                let names = names.join(", ");
                return Err(at(format!(
                    "--zero-load-below needs the true force: the recording has no topic {names}; give --in-air FROM..TO"
                )));
            }
        }
        let (joints, joint_sources) = (Vec::new(), Vec::new());
        let topics = InputTopics { joints, joint_sources, truth, told: None, ..input_topics(cfg) };
        let mut inputs = Inputs::new(topics, &mut reader).map_err(|error| at(error.to_string()))?;
        inputs.read_only_these(&mut reader);
        let mut tracks: Vec<TruthTrack> = sources.into_iter().map(TruthTrack::new).collect();
        let (mut start, mut end) = (Stamp(i64::MAX), Stamp(i64::MIN));
        let mut annotations = Annotations::default();
        while let Some(message) = reader.next_message()? {
            check(observer)?;
            for part in inputs.parts(message.channel)? {
                match inputs.decode(&message, part) {
                    Input::Event(Event::Tactile(block)) => {
                        let source = &cfg.fusion().tactile_sources()[block.source.position()];
                        if block.is_of(source.n_taxels) {
                            let last = block.stamp.offset(source.stamp_offset_ns);
                            let rows = block.rows.saturating_sub(1) as i64;
                            start = start.min(last.offset(-block.row_period_ns.saturating_mul(rows)));
                            end = end.max(last);
                        }
                    }
                    Input::Truth { source, stamp, force } => tracks[source].handle_reading(stamp, force),
                    Input::Stage(stage) => annotations.handle(stage.into()),
                    Input::Event(Event::Joints(_)) | Input::None => {}
                }
            }
        }
        inputs.check_end(std::iter::empty()).map_err(|error| at(error.to_string()))?;
        if start > end {
            return Err(at("holds no taxels of the length that the parameters give".to_owned()));
        }
        Ok(Seen { start, end, annotations, truth: tracks })
    }

    /// A note if the recording ends within the given spans. An error, on one line, if it ends before a span begins.
    fn check(&self, spans: &[(f64, f64)], bag: &str) -> Result<Vec<String>, String> {
        let length = self.end.nanos_since(self.start) as f64 / NANOS_PER_SEC as f64;
        if let Some((from, to)) = spans.iter().find(|(from, _)| *from >= length) {
            return Err(format!(
                "--in-air {from}..{to} lies behind the end of the recording, which is {length:.1} s long; name a stretch of it in which nothing touches the glove"
            ));
        }
        let beyond = spans.iter().filter(|(_, to)| *to > length + 0.1);
        let note = |(from, to): &(f64, f64)| {
            format!("{bag}: is {length:.1} s long, so --in-air {from}..{to} counts up to its end")
        };
        Ok(beyond.map(note).collect())
    }
}

/// Annotations of a recording that is without load in the spans `free`, from `begin` on.
///
/// A recording without annotations gets two stages of the protocol: the time in the air becomes stage 1, the rest
/// becomes stage 2. Each stage is divided into training and test separately.
fn stages(known: &Annotations, free: &[ZeroLoad], begin: Stamp) -> Vec<Stage> {
    let mut bounds: Vec<Stamp> = known.all().iter().map(|annotation| annotation.from).chain([begin]).collect();
    for stretch in free {
        let span = stretch.to.nanos_since(stretch.from);
        let n = (span / LONGEST_NS + i64::from(span % LONGEST_NS > 0)).max(1);
        bounds.extend((0..n).map(|k| stretch.from.offset(k * (span / n))));
        bounds.push(stretch.to);
    }
    bounds.sort();
    bounds.dedup();
    let of_bound = |from: Stamp| {
        let after = free.partition_point(|stretch| stretch.from <= from);
        let zero_load = after.checked_sub(1).is_some_and(|idx| from < free[idx].to);
        let (stage, substage) = match zero_load {
            true => (Stage::ZERO_LOAD_POSES, "in_air"),
            false => (Stage::LOAD_UNLOAD_POSES, "other"),
        };
        let made = || Annotation { stage, substage: substage.to_owned(), ..Annotation::outside(from) };
        let outside = || Annotation::outside(from);
        let annotation = if known.is_empty() { made() } else { known.at(from).cloned().unwrap_or_else(outside) };
        let header = Header { stamp: from.into(), frame_id: String::new() };
        Stage { header, zero_load, ..Stage::from(annotation) }
    };
    bounds.into_iter().map(of_bound).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_in_the_air_are_seconds_or_all() {
        assert_eq!("all".parse(), Ok(InAir::All));
        assert_eq!("5..35.5".parse(), Ok(InAir::Spans(vec![(5.0, 35.5)])));
        assert_eq!("60..70,0..5, 4..10,10..12".parse(), Ok(InAir::Spans(vec![(0.0, 12.0), (60.0, 70.0)])));
        for wrong in ["", "5", "5..", "35..5", "-1..5", "a..b", "0..nan", "0..5,", "0..5,all"] {
            assert!(wrong.parse::<InAir>().is_err(), "{wrong}");
        }
    }

    const S: i64 = NANOS_PER_SEC;

    #[test]
    fn what_is_told_becomes_annotations_and_a_long_stretch_several() {
        let free = [ZeroLoad { from: Stamp(5 * S), to: Stamp(30 * S) }];
        let told = stages(&Annotations::default(), &free, Stamp(0));
        let seen: Vec<_> =
            told.iter().map(|stage| (Stamp::from(stage.header.stamp).0 / S, stage.stage, stage.zero_load)).collect();
        assert_eq!(seen, [(0, 2, false), (5, 1, true), (13, 1, true), (21, 1, true), (30, 2, false)]);
    }

    #[test]
    fn annotations_that_are_there_keep_their_stages_and_poses() {
        let mut known = Annotations::default();
        let fist = Annotation { stage: 3, pose: "fist".into(), zero_load: true, ..Annotation::outside(Stamp(2 * S)) };
        known.handle(fist);
        let told = stages(&known, &[ZeroLoad { from: Stamp(S), to: Stamp(3 * S) }], Stamp(0));
        let seen: Vec<_> = told.iter().map(|stage| (stage.stage, stage.pose.as_str(), stage.zero_load)).collect();
        assert_eq!(seen, [(0, "", false), (0, "", true), (3, "fist", true), (3, "fist", false)]);
    }
}
