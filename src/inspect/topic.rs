//! One topic of a bag, looked into by its own schema.

use super::arrays::{self, ArrayWatch};
use super::elements::{self, ElementWatch};
use super::force_run::{self, ForceWatch};
use super::frame_watch::{self, FrameWatch};
use super::grid::{self, Grid};
use super::hand_points::{self, HandWatch};
use super::hints;
use super::sides::{self, SideWatch};
use super::stamps::StampRun;
use super::taxel_means::{MAX_SKINS, Skin};
use crate::bag::{BagChannel, BagMessage};
use crate::msg::definition::{Arity, BaseType, Definitions, TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, NumericPath, ReadAs, ReadError, numeric_paths};
use crate::msg::{Stage, WireType, from_cdr};
use crate::units::Stamp;

/// Longest message whose arrays are looked at, in bytes: an image beyond it is no tactile array.
const LOOK_LIMIT: usize = 1 << 20;

/// A topic, without its timing by log time.
#[derive(Debug)]
pub(super) struct Topic {
    pub(super) name: String,
    pub(super) type_name: String,
    pub(super) encoding: String,
    /// The parts of its messages that can be read, or why none can.
    pub(super) look: Result<Look, String>,
}

/// A topic whose messages can be read.
#[derive(Debug)]
pub(super) struct Look {
    stamp: Option<FieldPlan>,
    pub(super) stamps: StampRun,
    pub(super) grids: Vec<Grid>,
    pub(super) arrays: Vec<ArrayWatch>,
    /// Arrays that are not looked at because there are too many.
    pub(super) n_more_arrays: usize,
    /// Path of the time between samples of one message.
    pub(super) row_period: Option<String>,
    /// Numbers that can be forces.
    pub(super) forces: Vec<ForceWatch>,
    /// Fields that can hold the points of a hand.
    pub(super) hands: Vec<HandWatch>,
    /// Frames that can be the points of a hand.
    pub(super) frames: Option<FrameWatch>,
    /// Arrays of messages that hold arrays of numbers.
    pub(super) elements: Vec<ElementWatch>,
    /// Which hand messages are of.
    pub(super) side: Option<SideWatch>,
    /// Path of a count of messages.
    pub(super) sequence: Option<String>,
    /// A number that may be the device's own clock: its path, and its unit.
    pub(super) clock: Option<(String, &'static str)>,
    /// All fields with numbers.
    pub(super) numeric: Vec<NumericPath>,
    /// Stage annotations, and how many of them say that nothing is touched.
    pub(super) n_zero_load: Option<u64>,
    /// Messages whose arrays were not looked at for their size.
    pub(super) n_too_long: u64,
    pub(super) n_unreadable: u64,
    pub(super) first_error: Option<String>,
    buffers: Buffers,
}

/// Reused from message to message.
#[derive(Debug, Default)]
struct Buffers {
    values: Vec<f32>,
    names: Vec<String>,
    counts: Vec<Option<(u64, Option<u64>)>>,
    numbers: Vec<f64>,
}

impl Topic {
    /// The topic of a channel, before its first message; a type that the bag doesn't define is looked for among `definitions`.
    pub(super) fn new(channel: &BagChannel, definitions: &Definitions) -> Self {
        let look = tree_of(channel, definitions).map(|tree| Look::new(&tree, &channel.topic));
        Topic { look, ..Topic::unseen(channel, "") }
    }

    /// A topic that isn't looked into, and why.
    pub(super) fn unseen(channel: &BagChannel, why: &str) -> Self {
        let type_name = channel.type_name();
        Topic {
            name: channel.topic.clone(),
            type_name: if type_name.is_empty() { String::new() } else { canonical_type_name(type_name) },
            encoding: channel.message_encoding.clone(),
            look: Err(why.to_owned()),
        }
    }

    /// Takes the newest taxels of a message out to `skins`, and holds its forces against those that are there.
    pub(super) fn follow(&mut self, topic_idx: usize, cdr: &[u8], skins: &mut Vec<Skin>) {
        let Ok(look) = &mut self.look else { return };
        for (array_idx, array) in look.arrays.iter().enumerate().filter(|(_, array)| array.is_skin) {
            let key = (topic_idx, array_idx);
            match skins.iter().position(|skin| skin.key == key) {
                Some(known) => skins[known].mean = array.mean,
                None if skins.len() < MAX_SKINS => {
                    skins.push(Skin { key, name: format!("{} ({})", self.name, array.path), mean: array.mean });
                }
                None => {}
            }
        }
        if cdr.len() <= LOOK_LIMIT {
            let numbers = &mut look.buffers.numbers;
            look.forces.iter_mut().for_each(|force| force.handle(cdr, skins, numbers));
            look.hands.iter_mut().for_each(|hand| hand.handle(cdr, numbers));
            look.elements.iter_mut().for_each(|elements| elements.handle(cdr, numbers));
            if let Some(frames) = &mut look.frames {
                frames.handle(cdr, &mut look.buffers.names);
            }
            if let Some(side) = &mut look.side {
                side.handle(cdr, numbers, &mut look.buffers.names);
            }
        }
    }

    /// Takes in a message; its stamp where it has one that is set.
    pub(super) fn handle(&mut self, message: &BagMessage<'_>) -> Option<Stamp> {
        let look = self.look.as_mut().ok()?;
        match look.handle(message) {
            Ok(stamp) => stamp,
            Err(error) => {
                look.n_unreadable += 1;
                look.first_error.get_or_insert_with(|| error.to_string());
                None
            }
        }
    }
}

fn tree_of(channel: &BagChannel, definitions: &Definitions) -> Result<TypeTree, String> {
    if channel.message_encoding != "cdr" {
        return Err(format!("its message encoding is {:?}, only \"cdr\" is read", channel.message_encoding));
    }
    let Some(schema) = &channel.schema else { return Err("the recorder wrote no schema for it".to_owned()) };
    schema.tree(definitions).map_err(|error| error.to_string())
}

impl Look {
    fn new(tree: &TypeTree, topic: &str) -> Self {
        let grids = grid::grids(tree);
        let (arrays, n_more_arrays) = arrays::arrays(tree, topic, grids.len());
        Look {
            stamp: stamp_plan(tree),
            stamps: StampRun::default(),
            arrays,
            n_more_arrays,
            grids,
            row_period: row_period(tree),
            forces: force_run::watches(tree, topic),
            hands: hand_points::watches(tree, topic),
            frames: frame_watch::watch(tree),
            elements: elements::watches(tree),
            side: sides::watch(tree),
            sequence: sequence(tree),
            clock: clock(tree),
            numeric: numeric_paths(tree),
            n_zero_load: (tree.type_name() == Stage::TYPE_NAME).then_some(0),
            n_too_long: 0,
            n_unreadable: 0,
            first_error: None,
            buffers: Buffers::default(),
        }
    }

    /// Path of the stamp; none where messages leave it unset, or never advance it.
    pub(super) fn stamp_path(&self) -> Option<&str> {
        self.stamp.as_ref().filter(|_| !self.stamps.is_useless()).map(FieldPlan::path)
    }

    /// Why the time of receipt has to count.
    pub(super) fn why_receipt(&self) -> &'static str {
        match self.stamp {
            Some(_) => "the stamps in the messages are not set, so the time of receipt counts",
            None => "the type has none, so the time of receipt counts",
        }
    }

    fn handle(&mut self, message: &BagMessage<'_>) -> Result<Option<Stamp>, ReadError> {
        let cdr = message.data;
        let stamp = self.stamp.as_ref().map(|plan| plan.read_stamp(cdr)).transpose()?;
        if let (Some(n_zero_load), Ok(stage)) = (&mut self.n_zero_load, from_cdr::<Stage>(cdr)) {
            *n_zero_load += u64::from(stage.zero_load);
        }
        if cdr.len() > LOOK_LIMIT {
            self.n_too_long += u64::from(!self.arrays.is_empty());
        } else if !self.arrays.is_empty() {
            let Buffers { values, names, counts, .. } = &mut self.buffers;
            counts.clear();
            for grid in &self.grids {
                counts.push(grid.read(cdr, values).unwrap_or(None)); // a negative count counts nothing
            }
            for array in &mut self.arrays {
                array.handle(cdr, counts, names, values)?;
            }
        }
        Ok(stamp.filter(|stamp| self.stamps.handle(*stamp, message.log_time)))
    }
}

/// `header.stamp`, else a stamp or header that the type has by another name.
fn stamp_plan(tree: &TypeTree) -> Option<FieldPlan> {
    let by_type =
        tree.root().fields.iter().filter(|field| field.ty.arity == Arity::One).filter_map(|field| {
            match &field.ty.base {
                BaseType::Message(name) if name == "builtin_interfaces/msg/Time" => Some(field.name.clone()),
                BaseType::Message(name) if name == "std_msgs/msg/Header" => Some(format!("{}.stamp", field.name)),
                _ => None,
            }
        });
    std::iter::once("header.stamp".to_owned())
        .chain(by_type)
        .find_map(|path| FieldPlan::compile(tree, &path, ReadAs::Stamp).ok())
}

/// A whole number of the message that is called a sequence.
fn sequence(tree: &TypeTree) -> Option<String> {
    let is_called = |name: &str| matches!(name, "sequence" | "seq" | "sequence_number");
    let found = tree.root().fields.iter().find(|field| is_called(&field.name))?;
    FieldPlan::compile(tree, &found.name, ReadAs::Count).ok().map(|_| found.name.clone())
}

/// A number of the message that is called a time and says its unit.
fn clock(tree: &TypeTree) -> Option<(String, &'static str)> {
    let of_field = |field: &crate::msg::definition::FieldDefinition| {
        let name = field.name.to_ascii_lowercase();
        let unit = ["ns", "us", "ms"].into_iter().find(|unit| name.ends_with(&format!("_{unit}")))?;
        let is_time = name.contains("time") && FieldPlan::compile(tree, &field.name, ReadAs::Nanos).is_ok();
        is_time.then(|| (field.name.clone(), unit))
    };
    tree.root().fields.iter().find_map(of_field)
}

fn row_period(tree: &TypeTree) -> Option<String> {
    let mut periods = tree.root().fields.iter().filter(|field| hints::found(&field.name, &["period"]).is_some());
    periods.find(|field| FieldPlan::compile(tree, &field.name, ReadAs::Period).is_ok()).map(|field| field.name.clone())
}
