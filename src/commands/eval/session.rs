//! One session: read once for its labels, once for the estimates of its test part.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::super::progress::Progress;
use super::super::sessions::{Stopped, session_name};
use super::super::setup::input_topics;
use super::super::zero::ZeroArgs;
use super::super::{Failure, interrupt};
use crate::bag::{BagReader, InputTopics, Inputs};
use crate::config::Config;
use crate::eval::{Cuts, Origin, Part, ScoredFrames, Scoring, Split, TareCurve, ZeroLoadCheck};
use crate::fusion::{ContactDetector, ContactThresholds, Fusion, Regressor};
use crate::model::ModelInfo;
use crate::msg::{ContactArray, ContactState, EstimateTopics, WireType, from_cdr};
use crate::recording::{Labels, Listener, PoseDegrader, PoseQuality, TruthTrack, aligned, read};
use crate::units::{GramForce, Newton, Stamp};

/// Taxels that are read before a stretch that is scored: a window, and time for contact to settle.
const LEAD_NS: i64 = 2_000_000_000;

/// The estimates of one region by one series, frame by frame.
#[derive(Debug, Default, Clone)]
pub(super) struct Column {
    pub(super) stamp: Vec<Stamp>,
    pub(super) force: Vec<Option<Newton>>,
    pub(super) base: Vec<Option<Newton>>,
    pub(super) contact: Vec<bool>,
    pub(super) pose_age_ns: Vec<Option<i64>>,
}

/// What results say of a session.
#[derive(Debug, Clone, Serialize)]
pub(super) struct SessionSummary {
    pub(super) name: String,
    pub(super) bag: String,
    pub(super) glove: String,
    pub(super) user: String,
    pub(super) synthetic: bool,
    pub(super) frames_scored: usize,
    pub(super) frames_without_truth: usize,
    /// How well the tared truth keeps below the touch threshold where nothing touches.
    pub(super) zero_load: ZeroLoadCheck,
    pub(super) losses: Vec<String>,
    #[serde(skip)]
    pub(super) warnings: Vec<String>,
}

/// Labels of a session, and where it is cut.
pub(super) struct Labelled {
    pub(super) labels: Labels,
    pub(super) cuts: Option<Cuts>,
    /// `[force sensors]`: their tare over time.
    tares: Vec<TareCurve>,
}

impl Labelled {
    /// Reads truth and annotations.
    pub(super) fn read(bag: &Path, cfg: &Config, split: Option<Split>) -> Result<Self, Failure> {
        let topics = InputTopics { taxels: Vec::new(), joints: Vec::new(), ..with_truth(cfg) };
        let mut reader = BagReader::open(&[bag.to_path_buf()])?;
        let in_bag = |error: &dyn std::fmt::Display| Failure(format!("{}: {error}", bag.display()));
        let mut inputs = Inputs::new(topics, &mut reader).map_err(|error| in_bag(&error))?;
        let mut labels = Labels::new(&cfg.truth_sources);
        let listener = Listener::<Stopped> {
            on_tick: &mut |_, _| {},
            on_other: &mut |_| Ok(()),
            is_wanted: &|_| false,
            pose: &mut [],
            between: &mut |_| Ok(interrupt::check()?),
        };
        read(&mut reader, &mut inputs, &mut labels, &mut [], listener).map_err(|stopped| stopped.of_bag(bag))?;
        inputs.check_end(std::iter::empty()).map_err(|error| in_bag(&error))?;
        if labels.annotations.is_empty() {
            return Err(in_bag(&format!(
                "no stage annotations on {}; the true force is tared on stretches that they mark as free of load: record that topic, or set stage_topic",
                cfg.stage_topic
            )));
        }
        let ends = labels.truth.iter().filter_map(|track| Some(track.span()?.1));
        let end = ends.max().unwrap_or(Stamp(i64::MIN));
        let cuts = split.map(|split| split.cuts(&labels.annotations.stage_spans(end.offset(1))));
        let zero_load = labels.annotations.zero_load(end);
        let tare = |track: &TruthTrack| {
            track.tare(&zero_load).map_err(|error| in_bag(&format!("truth {}: {error}", track.name())))
        };
        let tares = labels.truth.iter().map(tare).collect::<Result<_, _>>()?;
        Ok(Labelled { labels, cuts, tares })
    }

    /// Whether a frame is scored whose window begins at `from`.
    fn is_scored(&self, from: Stamp, stamp: Stamp) -> bool {
        let in_test = |at| self.cuts.as_ref().is_none_or(|cuts| cuts.part_at(at) == Some(Part::Test));
        in_test(stamp) && in_test(from)
    }

    /// Whether taxels at a stamp are needed for what is scored.
    fn is_wanted(&self, stamp: Stamp, offset_ns: i64) -> bool {
        let Some(cuts) = &self.cuts else { return true };
        let reach = LEAD_NS + offset_ns.abs();
        // Test parts are longer than the lead, or they hold no frame worth the name.
        [0, reach / 2, reach, -offset_ns.abs()]
            .iter()
            .any(|ahead| cuts.part_at(stamp.offset(*ahead)) == Some(Part::Test))
    }

    /// Puts a region's estimates beside its truth.
    pub(super) fn frames(
        &self,
        column: &Column,
        truth_idx: usize,
        window_ns: i64,
        max_gap: std::time::Duration,
        thresholds: ContactThresholds,
        origin: &Origin,
    ) -> ScoredFrames {
        let truth = aligned(&self.labels.truth[truth_idx], &self.tares[truth_idx], &column.stamp, max_gap);
        let annotations = &self.labels.annotations;
        let mut frames = ScoredFrames {
            origins: annotations
                .all()
                .iter()
                .map(|annotation| Origin {
                    stage: annotation.stage.to_string(),
                    substage: annotation.substage.clone(),
                    ..origin.clone()
                })
                .collect(),
            ..ScoredFrames::default()
        };
        let has_base = column.base.iter().any(Option::is_some);
        let base = column.base_alone(thresholds);
        for (idx, stamp) in column.stamp.iter().enumerate() {
            let Some(annotation) = annotations.idx_at(*stamp) else { continue };
            if !self.is_scored(stamp.offset(-window_ns), *stamp) {
                continue;
            }
            frames.stamp.push(*stamp);
            frames.truth_gf.push(truth[idx].map_or(f64::NAN, |force| force.0));
            frames.estimate_gf.push(column.force[idx].map(|force| GramForce::from(force).0));
            frames.contact.push(column.contact[idx]);
            if has_base {
                frames.base_contact.push(base.contact[idx]);
            }
            frames.pose_age_ns.push(column.pose_age_ns[idx]);
            frames.origin.push(annotation);
        }
        frames
    }

    /// What results say of it, but for the counts of frames.
    pub(super) fn summary(&self, bag: &Path, cfg: &Config) -> SessionSummary {
        let notes = &self.labels.notes;
        let named = |noted: &Option<String>, set: &Option<String>| {
            noted.clone().or_else(|| set.clone()).unwrap_or_else(|| "?".to_owned())
        };
        let mut zero_load = ZeroLoadCheck::default();
        let at_rest = |stamp| self.labels.annotations.at(stamp).is_some_and(|annotation| annotation.zero_load);
        let mut warnings = Vec::new();
        for (track, tare) in self.labels.truth.iter().zip(&self.tares) {
            let resting = track.readings().filter(|(stamp, _)| at_rest(*stamp));
            resting.for_each(|(stamp, force)| zero_load.handle_force(&Scoring::default(), tare.tared(stamp, force)));
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
        if zero_load.n_touch > zero_load.n_samples / 100 {
            warnings.push(format!(
                "{}: {} of {} readings at zero load are above the touch threshold after taring, up to {:.1} gF: look at annotations and force sensor",
                bag.display(),
                zero_load.n_touch,
                zero_load.n_samples,
                zero_load.largest_gf
            ));
        }
        SessionSummary {
            name: session_name(bag),
            bag: bag.display().to_string(),
            glove: named(&notes.glove, &cfg.glove),
            user: named(&notes.user, &cfg.user),
            synthetic: notes.synthetic,
            frames_scored: 0,
            frames_without_truth: 0,
            zero_load,
            losses: Vec::new(),
            warnings,
        }
    }
}

fn with_truth(cfg: &Config) -> InputTopics {
    InputTopics { truth: cfg.truth.clone(), ..input_topics(cfg) }
}

/// A model on its way through a session: its configuration, and what it made of each region.
pub(super) struct Core {
    pub(super) cfg: Config,
    pub(super) infos: Vec<ModelInfo>,
    /// What becomes of the joint angles before they reach it.
    pub(super) quality: PoseQuality,
    pub(super) regressors: Vec<Box<dyn Regressor>>,
}

/// What models made of a session.
pub(super) struct Modelled {
    /// `[models][regions]`
    pub(super) columns: Vec<Vec<Column>>,
    /// The models, for the next session.
    pub(super) cores: Vec<Core>,
    /// What was lost of the bag.
    pub(super) losses: Vec<String>,
}

/// Runs models over the stretches of a session that are scored.
pub(super) fn run_models(
    bag: &Path,
    labelled: &Labelled,
    cores: Vec<Core>,
    zero: &ZeroArgs,
) -> Result<Modelled, Failure> {
    let Some(first) = cores.first() else {
        return Ok(Modelled { columns: Vec::new(), cores, losses: Vec::new() });
    };
    let bags = [bag.to_path_buf()];
    let in_bag = |error: &dyn std::fmt::Display| Failure(format!("{}: {error}", bag.display()));
    // The sources are the same for all.
    let Core { cfg, infos, .. } = first;
    let degrader = |core: &Core| PoseDegrader::new(core.quality, &core.cfg.fusion.joint_sources, &session_name(bag));
    let mut pose: Vec<PoseDegrader> = cores.iter().map(degrader).collect();
    let mut reader = BagReader::open(&bags)?;
    let mut inputs = Inputs::new(input_topics(cfg), &mut reader).map_err(|error| in_bag(&error))?;
    let zero = zero.find(cfg, &bags, infos).map_err(|failure| in_bag(&failure))?;
    let offset_ns = cfg.fusion.tactile_sources.iter().map(|source| source.stamp_offset_ns.abs()).max().unwrap_or(0);
    let mut columns: Vec<Vec<Column>> =
        cores.iter().map(|core| vec![Column::default(); core.cfg.fusion.regions.len()]).collect();
    let (mut fusions, mut kept) = (Vec::new(), Vec::new());
    for core in cores {
        let mut fusion = Fusion::new(core.cfg.fusion.clone(), core.regressors)?;
        zero.install(&mut fusion)?;
        fusions.push(fusion);
        kept.push((core.cfg, core.infos, core.quality));
    }
    let mut progress = Progress::bytes("eval", reader.bytes_total());
    let listener = Listener::<Stopped> {
        on_tick: &mut |core_idx, tick| {
            for estimate in &tick.estimates {
                let column = &mut columns[core_idx][estimate.region];
                column.stamp.push(tick.stamp);
                column.force.push(estimate.force);
                column.base.push(estimate.force_base);
                column.contact.push(estimate.contact.state);
                column.pose_age_ns.push(estimate.pose_age_ns);
            }
        },
        on_other: &mut |_| Ok(()),
        is_wanted: &|stamp| labelled.is_wanted(stamp, offset_ns),
        pose: &mut pose,
        between: &mut |bytes| {
            progress.set(bytes);
            Ok(interrupt::check()?)
        },
    };
    let mut unused = Labels::new(&[]);
    read(&mut reader, &mut inputs, &mut unused, &mut fusions, listener).map_err(|stopped| stopped.of_bag(bag))?;
    drop(progress);
    let as_recorded = fusions.iter().zip(&kept).filter(|(_, (.., quality))| *quality == PoseQuality::default());
    for (fusion, _) in as_recorded {
        inputs.check_end(fusion.missing_joints()).map_err(|error| in_bag(&error))?;
    }
    let losses = reader.losses().iter().map(ToString::to_string).collect();
    let cores = fusions.into_iter().zip(kept).map(|(fusion, (cfg, infos, quality))| Core {
        cfg,
        infos,
        quality,
        regressors: fusion.into_regressors(),
    });
    Ok(Modelled { columns, cores: cores.collect(), losses })
}

/// Reads the estimates that a bag holds. `[regions]`
pub(super) fn read_estimates(bag: &Path, cfg: &Config, topic: &str) -> Result<(Vec<Column>, Vec<String>), Failure> {
    let mut reader = BagReader::open(&[bag.to_path_buf()])?;
    let topics = InputTopics { taxels: Vec::new(), joints: Vec::new(), ..input_topics(cfg) };
    let mut inputs = Inputs::new(topics, &mut reader)?;
    let columns = RefCell::new(vec![Column::default(); cfg.fusion.regions.len()]);
    let listener = Listener::<Stopped> {
        on_tick: &mut |_, _| {},
        on_other: &mut |message| {
            if message.channel.topic != topic || message.channel.type_name() != ContactArray::TYPE_NAME {
                return Ok(());
            }
            let array: ContactArray =
                from_cdr(message.data).map_err(|error| Failure(format!("{}: {topic}: {error}", bag.display())))?;
            let stamp = Stamp::from(array.header.stamp);
            for state in &array.contacts {
                let region = cfg.fusion.regions.iter().position(|region| region.name == state.region);
                if let Some(region) = region {
                    columns.borrow_mut()[region].push_state(stamp, state);
                }
            }
            Ok(())
        },
        is_wanted: &|_| false,
        pose: &mut [],
        between: &mut |_| Ok(interrupt::check()?),
    };
    let mut unused = Labels::new(&[]);
    read(&mut reader, &mut inputs, &mut unused, &mut [], listener).map_err(|stopped| stopped.of_bag(bag))?;
    let losses = reader.losses().iter().map(ToString::to_string).collect();
    Ok((columns.into_inner(), losses))
}

/// All frames of a bag's first region by the estimates in it.
pub(in crate::commands) fn recorded(bag: &Path, cfg: &Config) -> Result<ScoredFrames, Failure> {
    let labelled = Labelled::read(bag, cfg, None)?;
    let topic = EstimateTopics::of_node(&cfg.node.to_string(), &cfg.fusion).contacts;
    let (columns, _) = read_estimates(bag, cfg, &topic)?;
    let region = &cfg.fusion.regions[0];
    let truth_idx = cfg.truth_of_region[0].unwrap_or_default();
    let max_gap = cfg.fusion.timing.max_gap;
    Ok(labelled.frames(&columns[0], truth_idx, 0, max_gap, region.contact, &Origin::default()))
}

/// Whether bags hold estimates of a node.
pub(super) fn hold_estimates(bags: &[PathBuf], topic: &str) -> Result<bool, Failure> {
    for bag in bags {
        let mut reader = BagReader::open(std::slice::from_ref(bag))?;
        reader.scan(&[topic])?;
        if !reader.channels().iter().any(|channel| channel.topic == topic) {
            return Ok(false);
        }
    }
    Ok(true)
}

impl Column {
    /// The base force as if it were all there is, with the contact that it alone would tell.
    pub(super) fn base_alone(&self, thresholds: ContactThresholds) -> Column {
        let mut detector = ContactDetector::new(thresholds);
        let contacts =
            self.stamp.iter().zip(&self.base).map(|(stamp, base)| detector.handle_force(*stamp, *base).state);
        Column {
            stamp: self.stamp.clone(),
            contact: contacts.collect(),
            force: self.base.clone(),
            base: vec![None; self.base.len()],
            pose_age_ns: self.pose_age_ns.clone(),
        }
    }

    fn push_state(&mut self, stamp: Stamp, state: &ContactState) {
        let force = |value: f64| Some(Newton(value)).filter(|force| force.0.is_finite());
        self.stamp.push(stamp);
        self.force.push(force(state.force));
        self.base.push(force(state.force_base));
        self.contact.push(state.contact);
        self.pose_age_ns.push(state.pose_age.is_finite().then(|| (state.pose_age * 1e9).round() as i64));
    }
}
