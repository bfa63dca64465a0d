//! Resamples a session to the rate of a dataset. A frame has the newest values at its time, and never values from
//! later.

use super::{ExportError, Feature, SessionToExport};
use crate::columns::Cells;
use crate::fusion::FusionConfig;
use crate::recording::{EstimateTrack, Samples, newest_at, rate_hz};
use crate::units::{NANOS_PER_SEC, Stamp, nanos};

/// Allowed difference between the rates of a bag and of the first bag: enough for a sensor's clock, not for another
/// setting.
const RATE_TOLERANCE: f64 = 0.1;

/// Number of steps of a stream after which its newest value is too old, if this is more than `max_gap_ms`.
const HELD_STEPS: f64 = 1.5;

/// Maximum number of samples in a window: more than a second of a fast sensor. It limits the effect of stamps that are
/// a nanosecond apart.
const MAX_WINDOW: usize = 4096;

/// Number of frames per estimate above which the stamps are taken as wrong. Without gaps it is less than 1.
const MAX_FRAMES_PER_ESTIMATE: usize = 100;

/// The features of a dataset's frames, defined by its first session.
#[derive(Debug, Clone)]
pub struct Layout {
    fps: u32,
    regions: Vec<Region>,
    /// `[tactile sources]`.
    sources: Vec<Source>,
    joints: Vec<String>,
    max_gap_ns: i64,
    max_pose_age_ns: i64,
}

#[derive(Debug, Clone)]
struct Region {
    name: String,
    source: usize,
    taxels: Vec<usize>,
    /// Whether its estimates have tangential forces.
    tangential: bool,
}

#[derive(Debug, Clone)]
struct Source {
    name: String,
    n_taxels: usize,
    rate_hz: f64,
    /// Number of samples in a window.
    window: usize,
}

/// A session as frames of a dataset.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// Number of frames.
    pub n_frames: usize,
    /// True if the data are simulated, not recorded.
    pub synthetic: bool,
    /// Time before the first frame, s, when some stream had not started.
    pub skipped_s: f64,
    /// `[regions]`: share of the frames with a known force.
    pub known: Vec<f64>,
    /// One per column.
    pub features: Vec<Feature>,
}

impl Layout {
    /// The layout of a dataset whose first session is this one.
    ///
    /// # Errors
    /// [`ExportError`] when a tactile source is slower than the dataset, or a window holds none of its samples.
    pub fn new(cfg: &FusionConfig, fps: u32, window_ms: u32, first: &SessionToExport<'_>) -> Result<Self, ExportError> {
        let (tracks, first) = (first.estimates, first.samples);
        let mut sources = Vec::new();
        for (source, track) in cfg.tactile_sources().iter().zip(&first.tactile) {
            let what = format!("tactile source {}", source.name);
            let rate_hz = track.rate_hz().ok_or(ExportError::TooFew { what: what.clone(), n: track.stamp.len() })?;
            let window = (f64::from(window_ms) * 1e-3 * rate_hz).round() as usize;
            refuse_faster(fps, rate_hz, &what)?;
            if !(1..=MAX_WINDOW).contains(&window) {
                let source_name = source.name.clone();
                return Err(ExportError::Window { window_ms, source_name, rate_hz, n: window, most: MAX_WINDOW });
            }
            sources.push(Source { name: source.name.clone(), n_taxels: source.n_taxels, rate_hz, window });
        }
        let regions = cfg.regions().iter().zip(tracks).map(|(region, track)| Region {
            name: region.name.clone(),
            source: region.source.position(),
            taxels: region.taxels.clone(),
            tangential: track.has_tangential(),
        });
        Ok(Layout {
            fps,
            regions: regions.collect(),
            sources,
            joints: first.joint_names.clone(),
            max_gap_ns: nanos(cfg.timing().max_gap),
            max_pose_age_ns: nanos(cfg.timing().usual_pose_age()),
        })
    }

    /// Converts a session to frames of this layout.
    ///
    /// # Errors
    /// [`ExportError`] if its rates or joints differ from the layout, or if it has nothing to export.
    pub fn episode(&self, session: &SessionToExport<'_>) -> Result<Episode, ExportError> {
        self.refuse_other(session.samples)?;
        for (region, track) in self.regions.iter().zip(session.estimates) {
            if let Some(pair) = track.stamp.windows(2).find(|pair| pair[1] <= pair[0]) {
                return Err(ExportError::Order { region: region.name.clone(), at: pair[1] });
            }
            if let Some(rate_hz) = rate_hz(&track.stamp) {
                refuse_faster(self.fps, rate_hz, &format!("the estimate of region {}", region.name))?;
            }
        }
        let stamps = self.stamps(session)?;
        let opened = session.estimates.iter().filter_map(|track| track.stamp.first()).min();
        let skipped_ns = opened.zip(stamps.first()).map_or(0, |(opened, first)| first.nanos_since(*opened));
        let (mut features, mut known) = (Vec::new(), Vec::new());
        let stamp_feature = |name: String, stamps: Vec<i64>| Feature::plain(name, whole(stamps));
        features.push(stamp_feature("stamp_ns".to_owned(), stamps.iter().map(|stamp| stamp.0).collect()));
        for (region, track) in self.regions.iter().zip(session.estimates) {
            let newest = self.newest_estimates(&stamps, track);
            let is_known: Vec<bool> =
                newest.iter().map(|idx| idx.is_some_and(|idx| track.force[idx].is_some())).collect();
            known.push(is_known.iter().filter(|known| **known).count() as f64 / stamps.len().max(1) as f64);
            let single = |of: &dyn Fn(usize) -> Option<f64>| {
                let value = |(idx, known): (&Option<usize>, &bool)| idx.filter(|_| *known).and_then(of);
                Cells::Single(newest.iter().zip(&is_known).map(value).map(or_nan).collect())
            };
            let name = |feature: &str| format!("{feature}.{}", region.name);
            if !region.tangential && track.has_tangential() {
                return Err(ExportError::OtherAxes { region: region.name.clone() });
            }
            features.extend([
                Feature::plain(name("observation.force"), single(&|idx| track.force[idx].map(|force| force.0))),
                Feature::plain(name("observation.contact"), single(&|idx| Some(f64::from(track.contact[idx])))),
                Feature::plain(name("observation.artifact"), single(&|idx| track.artifact(idx).map(|force| force.0))),
            ]);
            if region.tangential {
                let value = |(idx, known): (&Option<usize>, &bool)| {
                    idx.filter(|_| *known).and_then(|idx| track.tangential[idx])
                };
                let values = newest.iter().zip(&is_known).map(value);
                let values = values.flat_map(|force| (0..3).map(move |axis| or_nan(force.map(|force| force[axis].0))));
                features.push(Feature {
                    name: name("observation.force_tangential"),
                    names: Some(["x", "y", "z"].map(str::to_owned).to_vec()),
                    cells: Cells::Vector { len: 3, values: values.collect() },
                });
            }
            let (tactile, tactile_stamps) = self.windows(region, &stamps, session.samples);
            features.push(Feature { name: name("observation.tactile"), names: None, cells: tactile });
            let flags = newest.iter().map(|idx| idx.map_or(NO_FRAME, |idx| i64::from(track.flags[idx].bits())));
            let of_frames = newest.iter().map(|idx| idx.map_or(NO_FRAME, |idx| track.stamp[idx].0));
            features.extend([
                Feature::plain(name("valid"), Cells::Flag(is_known.into_iter().map(Some).collect())),
                Feature::plain(name("flags"), whole(flags.collect())),
                stamp_feature(name("stamp_ns"), of_frames.collect()),
                stamp_feature(name("tactile_stamp_ns"), tactile_stamps),
            ]);
        }
        features.extend(self.state(&stamps, session.samples));
        let (n_frames, skipped_s) = (stamps.len(), skipped_ns as f64 * 1e-9);
        Ok(Episode { n_frames, synthetic: session.synthetic, skipped_s, known, features })
    }

    fn refuse_other(&self, samples: &Samples) -> Result<(), ExportError> {
        for (source, track) in self.sources.iter().zip(&samples.tactile) {
            let what = || format!("tactile source {}", source.name);
            let got = track.rate_hz().ok_or_else(|| ExportError::TooFew { what: what(), n: track.stamp.len() })?;
            if (got / source.rate_hz - 1.0).abs() > RATE_TOLERANCE {
                let (source_name, expected) = (source.name.clone(), source.rate_hz);
                return Err(ExportError::OtherRate { source_name, expected, got });
            }
        }
        let sorted = |names: &[String]| {
            let mut names = names.to_vec();
            names.sort();
            if names.is_empty() { "none".to_owned() } else { names.join(", ") }
        };
        let (expected, got) = (sorted(&self.joints), sorted(&samples.joint_names));
        if expected == got { Ok(()) } else { Err(ExportError::OtherJoints { expected, got }) }
    }

    /// Times of the frames: from the time when every stream of the session has started, to its last estimate.
    fn stamps(&self, session: &SessionToExport<'_>) -> Result<Vec<Stamp>, ExportError> {
        let first_force =
            |track: &EstimateTrack| track.force.iter().position(Option::is_some).map(|idx| track.stamp[idx]);
        let first_artifact = |track: &EstimateTrack| {
            (0..track.stamp.len()).find(|idx| track.artifact(*idx).is_some()).map(|idx| track.stamp[idx])
        };
        let forces: Vec<Stamp> = session.estimates.iter().filter_map(first_force).collect();
        if forces.is_empty() {
            return Err(ExportError::NoEstimate);
        }
        let used = self.sources.iter().zip(&session.samples.tactile);
        let windows = used.filter_map(|(source, track)| track.stamp.get(source.window - 1).copied());
        let joints = session.samples.joints.values().filter_map(|track| track.stamp.first().copied());
        let artifacts = session.estimates.iter().filter_map(first_artifact);
        let first = forces.into_iter().chain(artifacts).chain(windows).chain(joints).max().unwrap_or_default();
        let last = session.estimates.iter().filter_map(|track| track.stamp.last()).max().copied().unwrap_or_default();
        let span_ns = last.nanos_since(first);
        let n_estimates = session.estimates.iter().map(|track| track.stamp.len()).sum::<usize>();
        if span_ns < 0 {
            return Err(ExportError::NoEstimate);
        }
        let n_frames = (span_ns as i128 * i128::from(self.fps) / i128::from(NANOS_PER_SEC) + 1) as u128;
        if n_frames > (n_estimates * MAX_FRAMES_PER_ESTIMATE) as u128 {
            return Err(ExportError::Sparse { seconds: span_ns as f64 * 1e-9, n: n_estimates });
        }
        // Each is computed from the first one, so that rounding errors don't add up.
        let stamp = |frame: i128| (frame * i128::from(NANOS_PER_SEC) / i128::from(self.fps)) as i64;
        Ok((0..n_frames as i128).map(|frame| first.offset(stamp(frame))).collect())
    }

    /// `[frames]`: index of the newest estimate at each frame.
    fn newest_estimates(&self, stamps: &[Stamp], track: &EstimateTrack) -> Vec<Option<usize>> {
        let held_ns = self.held_ns(rate_hz(&track.stamp));
        stamps.iter().map(|stamp| newest_at(&track.stamp, *stamp, held_ns)).collect()
    }

    /// Time for which the newest value of a stream is used, ns.
    fn held_ns(&self, rate_hz: Option<f64>) -> i64 {
        let steps_ns = rate_hz.map_or(0.0, |rate_hz| HELD_STEPS * NANOS_PER_SEC as f64 / rate_hz);
        self.max_gap_ns.max(steps_ns as i64)
    }

    /// `[frames]`: the newest samples of a region's taxels, and the stamp of the newest sample.
    ///
    /// A window doesn't extend across a gap: samples before a gap, or before the first sample, are NaN.
    fn windows(&self, region: &Region, stamps: &[Stamp], samples: &Samples) -> (Cells, Vec<i64>) {
        let (source, track) = (&self.sources[region.source], &samples.tactile[region.source]);
        let (n_rows, n_columns) = (source.window, region.taxels.len());
        let held_ns = self.held_ns(Some(source.rate_hz));
        let mut values = vec![f32::NAN; stamps.len() * n_rows * n_columns];
        let mut newest = Vec::with_capacity(stamps.len());
        for (stamp, window) in stamps.iter().zip(values.chunks_exact_mut(n_rows * n_columns)) {
            let mut at = newest_at(&track.stamp, *stamp, held_ns);
            newest.push(at.map_or(NO_FRAME, |idx| track.stamp[idx].0));
            for row in window.chunks_exact_mut(n_columns).rev() {
                let Some(idx) = at else { break };
                let sample = &track.values[idx * source.n_taxels..(idx + 1) * source.n_taxels];
                for (value, taxel) in row.iter_mut().zip(&region.taxels) {
                    *value = sample[*taxel];
                }
                let before = idx.checked_sub(1);
                at = before.filter(|before| track.stamp[idx].nanos_since(track.stamp[*before]) <= held_ns);
            }
        }
        (Cells::Matrix { n_rows, n_columns, values }, newest)
    }

    /// Joint angles, if there are joints.
    fn state(&self, stamps: &[Stamp], samples: &Samples) -> Option<Feature> {
        let tracks: Vec<_> = self.joints.iter().filter_map(|name| samples.joints.get(name)).collect();
        let values =
            stamps.iter().flat_map(|stamp| tracks.iter().map(|track| or_nan(track.at(*stamp, self.max_pose_age_ns))));
        // LeRobot reads a list with one element as a scalar.
        let cells = match tracks.len() {
            1 => Cells::Single(values.collect()),
            len => Cells::Vector { len, values: values.collect() },
        };
        let feature = Feature { name: "observation.state".to_owned(), names: Some(self.joints.clone()), cells };
        (!tracks.is_empty()).then_some(feature)
    }
}

/// Marks a missing value in an integer column. Stamps and flags of a recording are never negative.
const NO_FRAME: i64 = -1;

impl Feature {
    pub(super) fn plain(name: String, cells: Cells) -> Self {
        Feature { name, names: None, cells }
    }
}

fn refuse_faster(fps: u32, rate_hz: f64, what: &str) -> Result<(), ExportError> {
    if f64::from(fps) > rate_hz * (1.0 + RATE_TOLERANCE) {
        return Err(ExportError::Rate { what: what.to_owned(), rate_hz, fps });
    }
    Ok(())
}

fn whole(values: Vec<i64>) -> Cells {
    Cells::Whole(values.into_iter().map(Some).collect())
}

fn or_nan(value: Option<f64>) -> f32 {
    value.map_or(f32::NAN, |value| value as f32)
}
