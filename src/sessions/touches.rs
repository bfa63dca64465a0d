//! Fits the force gains of a donning to touches of known force.

use std::path::PathBuf;
use std::time::Duration;

use super::SessionError;
use crate::bag::{BagReader, InputTopics, Inputs, shown};
use crate::config::Config;
use crate::eval::ZeroLoad;
use crate::fusion::{Event, ForceGain, Fusion, FusionError};
use crate::msg::binding::ForceReading;
use crate::observer::{Observer, check};
use crate::recording::{
    EstimateTrack, Labels, Listener, TimedTouch, ToldTouch, aligned, input_topics, known_touches, read, told_touch,
    zero_load,
};
use crate::units::{NANOS_PER_SEC, Stamp};
use crate::zero::{Donning, Zero, ZeroFrom};

/// Source of the known forces of touches.
#[derive(Debug, Clone, PartialEq)]
pub enum KnownForces {
    /// The force sensor of each region in the recording.
    Sensor,
    /// A person, by region name.
    Told(Vec<(String, ToldTouch)>),
}

impl KnownForces {
    /// Refuses what no recording can mend: a sensor or a region that the parameters don't have.
    ///
    /// # Errors
    /// What is missing, on one line.
    pub fn check(&self, cfg: &Config) -> Result<(), String> {
        match self {
            KnownForces::Sensor if cfg.truth().is_empty() => Err("known touches need the true force: set truth_sources and truth.*.topic in the parameters, or tell the forces by --touch".to_owned()),
            KnownForces::Sensor => Ok(()),
            KnownForces::Told(told) => told.iter().try_for_each(|(name, _)| region_of(cfg, name).map(|_| ())),
        }
    }
}

/// Index of the region of a touch that a person told.
fn region_of(cfg: &Config, name: &str) -> Result<usize, String> {
    let names: Vec<&str> = cfg.fusion().regions().iter().map(|region| region.name.as_str()).collect();
    let found = names.iter().position(|region| *region == name);
    found.ok_or_else(|| format!("--touch names region {name}, the parameters have {}", names.join(", ")))
}

/// A reading of a force sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthReading {
    /// Index of the sensor, in the order of the parameters.
    pub sensor: usize,
    /// Stamp of the message.
    pub stamp: Stamp,
    /// As sent.
    pub force: ForceReading,
}

/// Known touches of one region, and the gain from them.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionTouches {
    /// Index of the region.
    pub region: usize,
    /// The touches, in order of time.
    pub touches: Vec<TimedTouch>,
    /// The fitted gain.
    pub gain: ForceGain,
}

impl RegionTouches {
    /// The gain in words, on one line.
    pub fn text(&self, cfg: &Config) -> String {
        let ForceGain { gain, low, high, touches } = self.gain;
        let name = &cfg.fusion().regions()[self.region].name;
        format!("region {name}: forces times {gain:.3} ({low:.3} to {high:.3}), from {touches} known touches")
    }
}

/// Fits the force gain of each region that was touched with known force.
///
/// `core` must have the zero of the recording and no force gains. It is consumed.
///
/// # Errors
/// [`SessionError`] if the recording can't be read, lacks the forces, or if its touches give no gain.
pub fn force_gains(
    bags: &[PathBuf],
    cfg: &Config,
    zero: &Zero,
    core: Fusion,
    known: &KnownForces,
    observer: &dyn Observer,
) -> Result<Vec<RegionTouches>, SessionError> {
    let bag = bags.first().map(PathBuf::as_path).unwrap_or_else(|| std::path::Path::new(""));
    let refuse = |reason: String| SessionError::At { path: shown(bag), reason };
    known.check(cfg).map_err(refuse)?;
    let mut reader = BagReader::open(bags)?;
    let truth = if *known == KnownForces::Sensor { cfg.truth().to_vec() } else { Vec::new() };
    let mut inputs = Inputs::new(InputTopics { truth, ..input_topics(cfg) }, &mut reader)?;
    inputs.read_only_these(&mut reader);
    let mut labels = Labels::new(cfg.truth_sources());
    let mut tracks = vec![EstimateTrack::default(); cfg.fusion().regions().len()];
    let listener = Listener::<SessionError> {
        on_tick: &mut |_, tick| {
            for estimate in &tick.estimates {
                tracks[estimate.region.position()].handle_estimate(tick.stamp, estimate);
            }
        },
        on_other: &mut |_| Ok(()),
        is_wanted: &|_| true,
        pose: &mut [],
        between: &mut |_| Ok(check(observer)?),
    };
    read(&mut reader, &mut inputs, &mut labels, &mut [core], listener).map_err(|error| error.of_bag(bag))?;
    fit(cfg, zero, &labels, &tracks, known).map_err(refuse)
}

/// The same while the glove is worn: `events` and the readings of the force sensors as they came, from the begin of the
/// calibration on. Nothing was touched in the first `rest`. `core` has no zero yet.
///
/// # Errors
/// Why there is no gain, on one line.
pub fn live_force_gains<'a>(
    cfg: &Config,
    mut core: Fusion,
    (donning, rest): (&Donning, Duration),
    events: impl Iterator<Item = Event<'a>>,
    readings: &[TruthReading],
    known: &KnownForces,
) -> Result<Vec<RegionTouches>, String> {
    let seconds = vec![rest.as_secs_f64(); cfg.fusion().tactile_sources().len()];
    let zero = Zero::new(ZeroFrom::First { seconds }, donning.clone());
    zero.install(&mut core).map_err(|error| error.to_string())?;
    let mut labels = Labels::new(cfg.truth_sources());
    for TruthReading { sensor, stamp, force } in readings {
        if let Some(track) = labels.truth.get_mut(*sensor) {
            track.handle_reading(*stamp, *force);
        }
    }
    let mut tracks = vec![EstimateTrack::default(); cfg.fusion().regions().len()];
    let mut drain = |core: &mut Fusion| -> Result<(), FusionError> {
        while let Some(tick) = core.poll()? {
            for estimate in &tick.estimates {
                tracks[estimate.region.position()].handle_estimate(tick.stamp, estimate);
            }
        }
        Ok(())
    };
    for event in events {
        core.handle(event).map_err(|error| error.to_string())?;
        drain(&mut core).map_err(|error| error.to_string())?;
    }
    core.handle_end();
    drain(&mut core).map_err(|error| error.to_string())?;
    fit(cfg, &zero, &labels, &tracks, known)
}

/// The gain of each region that was touched.
fn fit(
    cfg: &Config,
    zero: &Zero,
    labels: &Labels,
    tracks: &[EstimateTrack],
    known: &KnownForces,
) -> Result<Vec<RegionTouches>, String> {
    let touches = match known {
        KnownForces::Sensor => of_sensor(cfg, zero, labels, tracks)?,
        KnownForces::Told(told) => of_told(cfg, told, tracks)?,
    };
    let fitted = touches.into_iter().enumerate().filter(|(_, touches)| !touches.is_empty()).map(|(region, touches)| {
        let known: Vec<_> = touches.iter().map(|touch| touch.touch).collect();
        let gain = ForceGain::fit(&known);
        let gain = gain.map_err(|error| format!("region {}: {error}", cfg.fusion().regions()[region].name))?;
        Ok(RegionTouches { region, touches, gain })
    });
    let fitted: Vec<RegionTouches> = fitted.collect::<Result<_, String>>()?;
    match fitted.is_empty() {
        true => {
            Err("no touch of a known force: at least three of 30 gF or more, each held for 0.1 s, are needed"
                .to_owned())
        }
        false => Ok(fitted),
    }
}

/// `[regions]`: touches measured by force sensors.
fn of_sensor(
    cfg: &Config,
    zero: &Zero,
    labels: &Labels,
    tracks: &[EstimateTrack],
) -> Result<Vec<Vec<TimedTouch>>, String> {
    let end = labels.truth.iter().filter_map(|track| Some(track.span()?.1)).max().unwrap_or_default();
    let mut rest = zero_load(&labels.annotations, end);
    if let (true, ZeroFrom::First { seconds }) = (rest.is_empty(), &zero.from) {
        let begin: Option<Stamp> = tracks.iter().filter_map(|track| track.stamp.first()).min().copied();
        let seconds = seconds.iter().copied().fold(f64::INFINITY, f64::min);
        rest.extend(begin.map(|from| ZeroLoad { from, to: from.offset((seconds * NANOS_PER_SEC as f64) as i64) }));
    }
    if rest.is_empty() {
        return Err(format!(
            "nothing says when its force sensor was free of load: no stage annotations on {}; give --in-air FROM..TO, --zero-load-below FORCE or --calibrate-first SECONDS",
            cfg.stage_topic
        ));
    }
    let max_gap = cfg.fusion().timing().max_gap;
    let of_region = |(track, truth_idx): (&EstimateTrack, &Option<usize>)| {
        let Some(truth) = truth_idx.and_then(|idx| labels.truth.get(idx)) else { return Ok(Vec::new()) };
        let tare = truth.tare(&rest).map_err(|error| format!("truth {}: {error}", truth.name()))?;
        Ok(known_touches(track, &aligned(truth, &tare, &track.stamp, max_gap)))
    };
    tracks.iter().zip(cfg.truth_of_region()).map(of_region).collect()
}

/// `[regions]`: touches given by a person.
fn of_told(
    cfg: &Config,
    told: &[(String, ToldTouch)],
    tracks: &[EstimateTrack],
) -> Result<Vec<Vec<TimedTouch>>, String> {
    let mut touches = vec![Vec::new(); tracks.len()];
    for (name, told) in told {
        let region = region_of(cfg, name)?;
        let found = told_touch(&tracks[region], told).ok_or_else(|| {
            let (from, to) = (told.from_s, told.to_s);
            format!("region {name} has fewer than ten estimates from {from} to {to} s; give times in seconds from the begin of the recording")
        })?;
        touches[region].push(found);
    }
    Ok(touches)
}
