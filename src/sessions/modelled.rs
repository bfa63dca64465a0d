//! Estimates of a session, computed by models or read from the bag.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::{Labelled, NeedsTruth, SessionError, session_name};
use crate::bag::{BagReader, ContactReader, InputTopics, Inputs};
use crate::config::Config;
use crate::eval::{Origin, ScoredFrames};
use crate::fusion::{Following, Fusion, Regressor};
use crate::glove::known;
use crate::model::ModelInfo;
use crate::msg::{ContactArray, EstimateTopics, WireType, WrenchStamped, from_cdr};
use crate::observer::{Observer, check};
use crate::recording::{EstimateTrack, Labels, Listener, PoseDegrader, PoseQuality, input_topics, read};
use crate::units::Stamp;
use crate::zero::{self, Wanted, ZeroError, ZeroFrom};

/// A model that runs over sessions, with its configuration.
#[derive(Debug)]
pub struct ModelRun {
    /// The configuration with this model.
    pub cfg: Config,
    /// Information about the models.
    pub infos: Vec<ModelInfo>,
    /// Degradation of the joint angles.
    pub quality: PoseQuality,
    /// The models, ready to run.
    pub regressors: Vec<Box<dyn Regressor>>,
}

/// Estimates of a session by models.
#[derive(Debug)]
pub struct Modelled {
    /// `[models][regions]`
    pub columns: Vec<Vec<EstimateTrack>>,
    /// The models, for use with the next session.
    pub cores: Vec<ModelRun>,
    /// `[models]`: counters of the core.
    pub counters: Vec<serde_json::Value>,
    /// Source of the zero.
    pub zero: Option<ZeroFrom>,
    /// Result of the check of the zero. A note if the zero fails but the parameters insist on it.
    pub verdict: Result<Option<String>, ZeroError>,
    /// Data of the bag that were lost.
    pub losses: Vec<String>,
}

/// Runs models over the scored spans of a session. `done` is increased by the number of bytes read.
///
/// # Errors
/// [`SessionError`] if the bag or its zero can't be used.
pub fn run_models(
    bag: &Path,
    labelled: &Labelled,
    mut cores: Vec<ModelRun>,
    zero: Wanted<'_>,
    done: &AtomicU64,
    observer: &dyn Observer,
) -> Result<Modelled, SessionError> {
    // The times at which nothing touches the glove belong to the session, not to the models.
    cores.iter_mut().for_each(|core| core.cfg.told_stages = labelled.told());
    let Some(first) = cores.first() else {
        let (columns, counters, losses) = (Vec::new(), Vec::new(), Vec::new());
        return Ok(Modelled { columns, cores, counters, zero: None, verdict: Ok(None), losses });
    };
    let bags = [bag.to_path_buf()];
    let in_bag = |error: &dyn std::fmt::Display| SessionError::at(bag, error);
    // All models have the same sources.
    let ModelRun { cfg, infos, .. } = first;
    let degrader =
        |core: &ModelRun| PoseDegrader::new(core.quality, core.cfg.fusion().joint_sources(), &session_name(bag));
    let mut pose: Vec<PoseDegrader> = cores.iter().map(degrader).collect();
    let mut reader = BagReader::open(&bags)?;
    let mut inputs = Inputs::new(input_topics(cfg), &mut reader).map_err(|error| in_bag(&error))?;
    inputs.read_only_these(&mut reader);
    let wanted = zero;
    let zero = zero::find(wanted, cfg, &bags, &known(cfg, infos)).map_err(|error| in_bag(&error))?;
    zero.notes.iter().for_each(|note| observer.note(note));
    let offset_ns = cfg.fusion().tactile_sources().iter().map(|source| source.stamp_offset_ns.abs()).max().unwrap_or(0);
    let mut columns: Vec<Vec<EstimateTrack>> =
        cores.iter().map(|core| vec![EstimateTrack::default(); core.cfg.fusion().regions().len()]).collect();
    let (mut fusions, mut kept) = (Vec::new(), Vec::new());
    let mut follows = false;
    for (idx, core) in cores.into_iter().enumerate() {
        let mut fusion = Fusion::new(core.cfg.fusion().clone(), core.regressors)?;
        // The baseline belongs to the glove, the artifact to the model.
        let tells_artifact = core.infos.iter().any(|info| info.contract.has_artifact());
        match tells_artifact && idx > 0 {
            true => {
                let degrader =
                    Some(PoseDegrader::new(core.quality, core.cfg.fusion().joint_sources(), &session_name(bag)));
                let found = zero::find_with(wanted, &core.cfg, &bags, &known(&core.cfg, &core.infos), degrader);
                found.map_err(|error| in_bag(&error))?.install(&mut fusion)?;
            }
            false => zero.install(&mut fusion)?,
        }
        follows |= tells_artifact && core.cfg.fusion().following() == Following::On;
        fusions.push(fusion);
        kept.push((core.cfg, core.infos, core.quality));
    }
    let mut told = 0;
    // Every model with unchanged joint angles checks the zero, on the scored frames.
    let is_judge = |idx: &usize| kept[*idx].2 == PoseQuality::default();
    let judges = (0..kept.len()).filter(is_judge);
    let mut checks: Vec<_> = judges.filter_map(|idx| Some((idx, zero.check.clone()?))).collect();
    let listener = Listener::<SessionError> {
        on_tick: &mut |core_idx, tick| {
            if let Some((_, check)) = checks.iter_mut().find(|(judge, _)| *judge == core_idx) {
                check.takes(tick);
            }
            for estimate in &tick.estimates {
                columns[core_idx][estimate.region.position()].handle_estimate(tick.stamp, estimate);
            }
        },
        on_other: &mut |_| Ok(()),
        // Following the artifact needs all frames from the beginning.
        is_wanted: &|stamp| follows || labelled.is_wanted(stamp, offset_ns),
        pose: &mut pose,
        between: &mut |bytes| {
            done.fetch_add(bytes.saturating_sub(told), Ordering::Relaxed);
            told = bytes;
            Ok(check(observer)?)
        },
    };
    let mut unused = Labels::new(&[]);
    read(&mut reader, &mut inputs, &mut unused, &mut fusions, listener).map_err(|stopped| stopped.of_bag(bag))?;
    // All models would see a load. If only one does, the model is at fault, and its scores show it.
    let verdicts: Vec<_> = checks.iter().map(|(judge, check)| check.judge(&kept[*judge].0)).collect();
    let is_at_rest = verdicts.iter().any(|verdict| matches!(verdict, Ok(None)));
    let verdict = verdicts.into_iter().next_back().filter(|_| !is_at_rest).unwrap_or(Ok(None));
    for doubt in inputs.angle_doubts() {
        observer.warn(&format!("{}: {doubt}", bag.display()));
    }
    let as_recorded = fusions.iter().zip(&kept).filter(|(_, (.., quality))| *quality == PoseQuality::default());
    for (fusion, _) in as_recorded {
        inputs.check_end(fusion.missing_joints()).map_err(|error| in_bag(&error))?;
    }
    let counters = fusions.iter().map(|fusion| serde_json::to_value(fusion.counters())).collect::<Result<_, _>>();
    let counters = counters.map_err(|error| in_bag(&error))?;
    let cores = fusions.into_iter().zip(kept).map(|(fusion, (cfg, infos, quality))| ModelRun {
        cfg,
        infos,
        quality,
        regressors: fusion.into_regressors(),
    });
    let cores = cores.collect();
    let losses = reader.losses().iter().map(ToString::to_string).collect();
    Ok(Modelled { columns, cores, counters, zero: Some(zero.from), verdict, losses })
}

/// Reads the estimates that a bag holds on the contacts topic of a node and on its wrenches, and what was lost of it.
/// `[regions]`
///
/// # Errors
/// [`SessionError`] if the bag can't be read.
pub fn read_estimates(
    bag: &Path,
    cfg: &Config,
    topic: &str,
    observer: &dyn Observer,
) -> Result<(Vec<EstimateTrack>, Vec<String>), SessionError> {
    let mut reader = BagReader::open(&[bag.to_path_buf()])?;
    let topics = InputTopics { taxels: Vec::new(), joints: Vec::new(), joint_sources: Vec::new(), ..input_topics(cfg) };
    let mut inputs = Inputs::new(topics, &mut reader)?;
    reader.read_only(&inputs.topics().into_iter().chain([topic.to_owned()]).collect());
    let columns = RefCell::new(vec![EstimateTrack::default(); cfg.fusion().regions().len()]);
    let mut contacts = ContactReader::default();
    // `NODE/contacts` and `NODE/REGION/wrench` are of the same node.
    let node = topic.rsplit_once('/').map_or("", |(node, _)| node);
    let wrench_topics = EstimateTopics::of_node(node, cfg.fusion()).wrenches;
    let wrenches = RefCell::new(vec![BTreeMap::new(); cfg.fusion().regions().len()]);
    let listener = Listener::<SessionError> {
        on_tick: &mut |_, _| {},
        on_other: &mut |message| {
            let type_name = message.channel.type_name();
            if type_name == WrenchStamped::TYPE_NAME
                && let Some(region) = wrench_topics.iter().position(|name| *name == message.channel.topic)
            {
                let WrenchStamped { header, wrench } = from_cdr(message.data)
                    .map_err(|error| SessionError::at(bag, &format!("{}: {error}", message.channel.topic)))?;
                let force = [wrench.force.x, wrench.force.y, wrench.force.z];
                let patch = &cfg.fusion().regions()[region].patch;
                wrenches.borrow_mut()[region].insert(Stamp::from(header.stamp), patch.force_in_patch(force));
                return Ok(());
            }
            if message.channel.topic != topic || type_name != ContactArray::TYPE_NAME {
                return Ok(());
            }
            let array = contacts.read(message).map_err(|error| SessionError::at(bag, &format!("{topic}: {error}")))?;
            let stamp = Stamp::from(array.header.stamp);
            for state in &array.contacts {
                let region = cfg.fusion().regions().iter().position(|region| region.name == state.region);
                if let Some(region) = region {
                    columns.borrow_mut()[region].handle_state(stamp, state);
                }
            }
            Ok(())
        },
        is_wanted: &|_| false,
        pose: &mut [],
        between: &mut |_| Ok(check(observer)?),
    };
    let mut unused = Labels::new(&[]);
    read(&mut reader, &mut inputs, &mut unused, &mut [], listener).map_err(|stopped| stopped.of_bag(bag))?;
    let losses = reader.losses().iter().map(ToString::to_string).collect();
    let mut columns = columns.into_inner();
    for ((column, region), wrenches) in columns.iter_mut().zip(cfg.fusion().regions()).zip(wrenches.into_inner()) {
        column.handle_wrenches(&region.patch, &wrenches);
    }
    Ok((columns, losses))
}

/// All frames of each region of a bag, with the estimates in the bag. A region whose force sensor the bag lacks has NaN as true
/// force.
///
/// # Shapes
/// `[regions]`
/// # Errors
/// [`SessionError`] if the bag can't be read, or lacks annotations.
pub fn recorded(bag: &Path, cfg: &Config, observer: &dyn Observer) -> Result<Vec<ScoredFrames>, SessionError> {
    let labelled = Labelled::read(bag, cfg, None, NeedsTruth::None, observer)?;
    let topic = EstimateTopics::of_node(&cfg.node.to_string(), cfg.fusion()).contacts;
    let (columns, _) = read_estimates(bag, cfg, &topic, observer)?;
    let max_gap = cfg.fusion().timing().max_gap;
    let regions = cfg.fusion().regions().iter().zip(cfg.truth_of_region()).zip(&columns);
    let frames = regions.map(|((region, truth_idx), column)| {
        labelled.frames(column, *truth_idx, 0, max_gap, region.contact, &Origin::default())
    });
    Ok(frames.collect())
}

/// True if bags have estimates of a node.
pub fn hold_estimates(bags: &[PathBuf], topic: &str) -> bool {
    let holds = |bag: &PathBuf| {
        let mut reader = BagReader::open(std::slice::from_ref(bag)).ok()?;
        reader.scan(&[topic]).ok()?;
        Some(reader.channels().iter().any(|channel| channel.topic == topic))
    };
    // Errors of bags that can't be read are reported later, when the bag is processed.
    let mut known = bags.iter().filter_map(holds).peekable();
    known.peek().is_some() && known.all(|holds| holds)
}
