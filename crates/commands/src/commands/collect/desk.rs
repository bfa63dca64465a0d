//! Where a collection's data comes together: what is received, published and recorded.

use std::collections::BTreeMap;
use std::time::Duration;

use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, BagMetadata, BagWriter, NewChannel, OutChannel};
use tactile_pose_fusion::collect::{Layout, Senses};
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::fusion::Event;
use tactile_pose_fusion::msg::binding::{SampleBinding, TruthBinding};
use tactile_pose_fusion::msg::definition::Definitions;
use tactile_pose_fusion::msg::{Stage, Text, WireType, to_cdr, type_hash};
use tactile_pose_fusion::protocol::Annotation;
use tactile_pose_fusion::recording::SESSION_NOTES;
use tactile_pose_fusion::ros::{
    Delivery, Incoming, InputName, Listener, Names, PublishedTopic, TopicType, input_bindings,
};
use tactile_pose_fusion::sim::SYNTHETIC_TOPIC;
use tactile_pose_fusion::units::{Newton, Stamp};

use super::super::Failure;
use super::super::live::Place;

/// How messages become samples.
enum Reading {
    Samples(SampleBinding),
    Truth(usize, Box<TruthBinding>),
    /// A synthetic glove says that it is one.
    Synthetic,
}

/// A topic that is received and recorded.
struct RecordedTopic {
    topic: String,
    type_name: String,
    schema: String,
    hash: String,
    /// Each takes a part of its messages.
    readings: Vec<Reading>,
}

/// The part of the bag that is being written.
struct SessionRecording {
    bag: BagWriter,
    inputs: Vec<OutChannel>,
    stage: OutChannel,
    last: Stamp,
}

pub(super) struct Desk {
    cfg: Config,
    inputs: Vec<RecordedTopic>,
    listener: Listener,
    stage: PublishedTopic,
    pub(super) senses: Senses,
    recording: Option<SessionRecording>,
    /// Messages that could not be read, by topic, and what was wrong with the first.
    pub(super) unreadable: BTreeMap<String, (u64, String)>,
    pub(super) synthetic: bool,
}

impl Desk {
    /// Joins the graph and listens to what the parameters name.
    pub(super) fn open(cfg: &Config, place: &Place) -> Result<Self, Failure> {
        let definitions = Definitions::new(cfg.live.message_definitions.as_deref(), &place.environment.prefixes);
        let names = Names::new(cfg, &[])?; // the graph remaps
        let mut listening = place.join()?;
        let mut inputs = Vec::new();
        for (input, (tree, bindings)) in names.inputs.iter().zip(input_bindings(cfg, &names, &definitions)?) {
            let InputName { topic, type_name, .. } = input.clone();
            listening.subscribe(&topic, TopicType::Defined(&tree), Delivery::of(input))?;
            let (schema, hash) = (definitions.schema_text(&type_name)?, type_hash(&tree));
            let readings = bindings.into_iter().map(Reading::Samples).collect();
            inputs.push(RecordedTopic { topic, type_name, schema, hash, readings });
        }
        for (idx, topic) in cfg.truth().iter().enumerate() {
            let tree = definitions.tree(&topic.type_name)?;
            let binding = TruthBinding::compile(&topic.fields, &tree)
                .map_err(|error| Failure(format!("topic {}: {error}", topic.name)))?;
            let reading = Reading::Truth(idx, Box::new(binding));
            let is_it = |input: &&mut RecordedTopic| input.topic == topic.name && input.type_name == topic.type_name;
            if let Some(input) = inputs.iter_mut().find(is_it) {
                input.readings.push(reading);
                continue;
            }
            listening.subscribe(&topic.name, TopicType::Defined(&tree), Delivery::Data)?;
            let (schema, hash) = (definitions.schema_text(&topic.type_name)?, type_hash(&tree));
            let (topic, type_name) = (topic.name.clone(), topic.type_name.clone());
            inputs.push(RecordedTopic { topic, type_name, schema, hash, readings: vec![reading] });
        }
        let type_name = Text::TYPE_NAME.to_owned();
        listening.subscribe(SYNTHETIC_TOPIC, TopicType::Known(&type_name), Delivery::Reliable)?;
        let (schema, hash) = (definitions.schema_text(&type_name)?, type_hash(&definitions.tree(&type_name)?));
        let (topic, readings) = (SYNTHETIC_TOPIC.to_owned(), vec![Reading::Synthetic]);
        inputs.push(RecordedTopic { topic, type_name, schema, hash, readings });
        let stage = listening.add_publisher(&cfg.stage_topic, TopicType::Known(Stage::TYPE_NAME), Delivery::Latched)?;
        Ok(Desk {
            senses: Senses::new(layout(cfg)),
            cfg: cfg.clone(),
            inputs,
            listener: listening.start()?,
            stage,
            recording: None,
            unreadable: BTreeMap::new(),
            synthetic: false,
        })
    }

    /// From now on what comes is recorded.
    pub(super) fn record(&mut self, mut bag: BagWriter, notes: &BTreeMap<String, String>) -> Result<(), Failure> {
        let mut notes = notes.clone();
        notes.insert("synthetic".to_owned(), self.synthetic.to_string());
        bag.copy_metadata(&BagMetadata { name: SESSION_NOTES, metadata: &notes })?;
        let mut inputs = Vec::new();
        for input in &self.inputs {
            inputs.push(bag.add_channel(NewChannel {
                topic: &input.topic,
                type_name: &input.type_name,
                schema_text: &input.schema,
                qos_yaml: BEST_EFFORT_QOS,
                type_hash: &input.hash,
            })?);
        }
        let stage = bag.add_topic::<Stage>(&self.cfg.stage_topic)?;
        bag.keep_unfinished(); // --resume finds it
        self.recording = Some(SessionRecording { bag, inputs, stage, last: Stamp(0) });
        Ok(())
    }

    /// Sees what was recorded so far onto the disk.
    pub(super) fn flush(&mut self) -> Result<(), Failure> {
        match &mut self.recording {
            Some(recording) => Ok(recording.bag.flush()?),
            None => Ok(()),
        }
    }

    /// Tells the graph what is asked for from now on, and records it.
    pub(super) fn tell(&mut self, annotation: Annotation, now: Stamp) -> Result<(), Failure> {
        let from = annotation.from;
        let message = Stage::from(annotation);
        self.listener.publish(self.stage, &message);
        let Some(recording) = &mut self.recording else { return Ok(()) };
        let at = now.max(recording.last);
        recording.last = at;
        Ok(recording.bag.write(recording.stage, 0, at, from, &to_cdr(&message))?)
    }

    /// Takes what comes until there is nothing left, and waits for it at most so long. Force sensors count from 0.
    pub(super) fn listen(
        &mut self,
        wait: Duration,
        on_force: &mut dyn FnMut(usize, Newton, Stamp),
    ) -> Result<(), Failure> {
        let mut next = self.listener.next(wait);
        while let Some(incoming) = next {
            self.handle(incoming, on_force)?;
            next = self.listener.poll();
        }
        Ok(())
    }

    /// Messages that came while the recording was too far behind to take them.
    pub(super) fn missed(&self) -> u64 {
        self.listener.missed()
    }

    /// Ends the recording, and leaves the graph.
    pub(super) fn close(self) -> Result<(), Failure> {
        let finished = match self.recording {
            Some(recording) => recording.bag.finish().map(|_| ()),
            None => Ok(()),
        };
        self.listener.leave();
        Ok(finished?)
    }

    fn handle(&mut self, incoming: Incoming, on_force: &mut dyn FnMut(usize, Newton, Stamp)) -> Result<(), Failure> {
        let Incoming { topic, cdr, received, .. } = incoming;
        let input = &mut self.inputs[topic.0];
        let mut unreadable = |text: String| {
            self.unreadable.entry(input.topic.clone()).or_insert_with(|| (0, text)).0 += 1;
        };
        let cdr = match cdr {
            Ok(cdr) => cdr,
            Err(text) => {
                unreadable(text);
                return Ok(());
            }
        };
        if let Some(recording) = &mut self.recording {
            let at = received.max(recording.last);
            recording.last = at;
            recording.bag.write(recording.inputs[topic.0], 0, at, at, &cdr)?;
        }
        for reading in &mut input.readings {
            match reading {
                Reading::Synthetic => self.synthetic = true,
                Reading::Samples(binding) => match binding.decode(&cdr, received) {
                    Ok(Event::Tactile(block)) => {
                        self.senses.handle_taxels(block.source.position(), block.values, received)
                    }
                    Ok(Event::Joints(sample)) => {
                        let scale = self.cfg.fusion().joint_sources()[sample.source.position()].scale;
                        let angles: Vec<f64> = sample.positions.iter().map(|position| position * scale).collect();
                        self.senses.handle_joints(sample.source.position(), sample.names, &angles, received);
                    }
                    Err(error) if error.is_for_another() => {}
                    Err(error) => unreadable(error.to_string()),
                },
                Reading::Truth(sensor, binding) => match binding.decode(&cdr, received) {
                    Ok((_, reading)) => {
                        let force = Newton::from(self.cfg.truth_sources()[*sensor].force(reading).0);
                        self.senses.handle_force(*sensor, force, received);
                        on_force(*sensor, force, received);
                    }
                    Err(error) if error.is_for_another() => {}
                    Err(error) => unreadable(error.to_string()),
                },
            }
        }
        Ok(())
    }
}

/// The sensors that the parameters name.
fn layout(cfg: &Config) -> Layout {
    let mut joints: Vec<String> = Vec::new();
    for joint in cfg.fusion().regions().iter().flat_map(|region| &region.joints) {
        if !joints.contains(joint) {
            joints.push(joint.clone());
        }
    }
    Layout {
        taxels: cfg.fusion().tactile_sources().iter().map(|source| (source.name.clone(), source.n_taxels)).collect(),
        joint_sources: cfg.fusion().joint_sources().iter().map(|source| source.name.clone()).collect(),
        joints,
        force: cfg.truth_sources().iter().map(|source| source.name.clone()).collect(),
    }
}
