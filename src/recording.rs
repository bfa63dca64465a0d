//! Reads a recorded session for training and evaluation: the annotations, the true force at every frame, and the model
//! input as the fusion core builds it.
//!
//! Frames come from the same [`Fusion`] as in the live node and in replay. This module doesn't cut, align or subtract
//! anything.

mod annotations;
mod estimates;
mod known;
mod notes;
mod pose_quality;
mod rows;
mod samples;
mod truth;

use crate::bag::{BagError, BagMessage, BagReader, BagRecord, Input, InputError, InputTopics, Inputs};
use crate::config::{Config, TruthSource};
use crate::eval::TruthError;
use crate::fusion::{Event, Fusion, FusionError, Tick};
use crate::protocol::Annotations;
use crate::units::Stamp;

pub use annotations::{stage_spans, zero_load};
pub use estimates::EstimateTrack;
pub use known::{TimedTouch, ToldTouch, end_of_touches, known_touches, told_touch};
pub use notes::{Notes, SESSION_NOTES};
pub use pose_quality::{PoseDegrader, PoseQuality, PoseQualityError};
pub use rows::{RowCollector, Rows};
pub use samples::{JointTrack, SampleError, Samples, TactileTrack, newest_at, rate_hz};
pub use truth::{AxisTares, TruthCounters, TruthTrack, aligned};

/// Topics that are inputs of this configuration, without those of the true force.
pub fn input_topics(cfg: &Config) -> InputTopics {
    InputTopics {
        taxels: cfg.tactile().to_vec(),
        joints: cfg.joints().to_vec(),
        truth: Vec::new(),
        joint_sources: cfg.fusion().joint_sources().to_vec(),
        needed: cfg.needed_joints(),
        stage: cfg.stage_topic.clone(),
        told: cfg.told_stages.clone(),
        message_definitions: cfg.live.message_definitions.clone(),
    }
}

/// A recording that can't be read to its end.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum RecordingError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Fusion(#[from] FusionError),
    #[error(transparent)]
    Truth(#[from] TruthError),
}

/// Data of a recording other than taxels and joint angles.
#[derive(Debug, Clone, Default)]
pub struct Labels {
    /// Notes of the recorder.
    pub notes: Notes,
    /// Annotations of the protocol.
    pub annotations: Annotations,
    /// `[force sensors]`: their readings as sent.
    pub truth: Vec<TruthTrack>,
}

impl Labels {
    /// No data yet, for these force sensors.
    pub fn new(sources: &[TruthSource]) -> Self {
        let truth = sources.iter().map(|source| TruthTrack::new(source.clone())).collect();
        Labels { truth, ..Labels::default() }
    }
}

/// Callbacks while a recording is read.
pub struct Listener<'a, E> {
    /// Receives each frame of each core.
    pub on_tick: &'a mut dyn FnMut(usize, &Tick),
    /// Receives each message that is not an input and not a label.
    pub on_other: &'a mut dyn FnMut(&BagMessage<'_>) -> Result<(), E>,
    /// True if taxels with this stamp go to the cores. For the cores, the other spans are gaps.
    pub is_wanted: &'a dyn Fn(Stamp) -> bool,
    /// `[cores]`: degrades the joint angles of each core. Empty if they stay as recorded.
    pub pose: &'a mut [PoseDegrader],
    /// Receives the number of bytes read, before every message. Its error stops the reading.
    pub between: &'a mut dyn FnMut(u64) -> Result<(), E>,
}

/// Reads a recording from the reader's position to its end. Events go through every core, labels are stored.
///
/// # Errors
/// [`RecordingError`] of the bag, a topic or a model, or the error of a callback.
pub fn read<E: From<RecordingError>>(
    reader: &mut BagReader,
    inputs: &mut Inputs,
    labels: &mut Labels,
    cores: &mut [Fusion],
    listener: Listener<'_, E>,
) -> Result<(), E> {
    let Listener { on_tick, on_other, is_wanted, pose, between } = listener;
    for stage in inputs.told().unwrap_or_default() {
        labels.annotations.handle(stage.clone().into());
    }
    loop {
        between(reader.bytes_read())?;
        let Some(record) = reader.next_record().map_err(RecordingError::from)? else { break };
        let message = match record {
            BagRecord::Message(message) => message,
            BagRecord::Metadata(metadata) => {
                labels.notes.handle(&metadata);
                continue;
            }
            BagRecord::Attachment(_) => continue,
        };
        let parts = inputs.parts(message.channel).map_err(RecordingError::from)?;
        if parts.is_empty() {
            on_other(&message)?;
        }
        for part in parts {
            match inputs.decode(&message, part) {
                Input::Event(event) => {
                    if let Event::Tactile(block) = &event
                        && !is_wanted(block.stamp)
                    {
                        continue;
                    }
                    for (core_idx, core) in cores.iter_mut().enumerate() {
                        let event = match (event, pose.get_mut(core_idx)) {
                            (Event::Joints(sample), Some(degrader)) => degrader.handle(sample).map(Event::Joints),
                            (event, _) => Some(event),
                        };
                        if let Some(event) = event {
                            core.handle(event).map_err(RecordingError::from)?;
                        }
                        drain(core_idx, core, on_tick).map_err(RecordingError::from)?;
                    }
                }
                Input::Truth { source, stamp, force } => labels.truth[source].handle_reading(stamp, force),
                Input::Stage(stage) => labels.annotations.handle(stage.into()),
                Input::None => {}
            }
        }
    }
    for (core_idx, core) in cores.iter_mut().enumerate() {
        core.handle_end();
        drain(core_idx, core, on_tick).map_err(RecordingError::from)?;
    }
    Ok(())
}

fn drain(core_idx: usize, core: &mut Fusion, on_tick: &mut dyn FnMut(usize, &Tick)) -> Result<(), FusionError> {
    while let Some(tick) = core.poll()? {
        on_tick(core_idx, tick);
    }
    Ok(())
}
