//! Scans a bag before the core is set up for it: joints, sampling, annotations.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::CharacterizeError;
use crate::bag::{BagReader, Input, Inputs};
use crate::characterize::StreamTiming;
use crate::config::Config;
use crate::fusion::Event;
use crate::observer::{Observer, check};
use crate::recording::input_topics;
use crate::units::Stamp;

/// Minimum share of the messages that must have a joint. A joint with fewer would cause gaps in the data of all joints.
const MIN_SHARE: f64 = 0.9;

/// Contents of a bag.
pub(super) struct Scan {
    /// Path of the bag, as given.
    pub(super) bag: String,
    /// By joint name: share of its source's messages with a finite angle, and index of the source.
    shares: BTreeMap<String, (f64, usize)>,
    pub(super) tactile: Vec<NamedTiming>,
    pub(super) joints: Vec<NamedTiming>,
    pub(super) has_annotations: bool,
}

/// Timing of a source, with its name.
#[derive(Debug, Clone, Serialize)]
pub struct NamedTiming {
    /// Name of the source.
    pub source: String,
    /// `None` if there are too few data.
    #[serde(flatten)]
    pub timing: Option<StreamTiming>,
}

impl Scan {
    /// Reads a bag to its end.
    pub(super) fn of(bag: &Path, cfg: &Config, observer: &dyn Observer) -> Result<Self, CharacterizeError> {
        let in_bag = |error: &dyn std::fmt::Display| CharacterizeError::in_bag(bag, error);
        let mut reader = BagReader::open(&[bag.to_path_buf()])?;
        let mut inputs = Inputs::new(input_topics(cfg), &mut reader).map_err(|error| in_bag(&error))?;
        let mut tactile: Vec<Vec<Stamp>> = vec![Vec::new(); cfg.fusion().tactile_sources().len()];
        let mut joints: Vec<Vec<Stamp>> = vec![Vec::new(); cfg.fusion().joint_sources().len()];
        let mut seen: BTreeMap<String, (u64, usize)> = BTreeMap::new();
        while let Some(message) = reader.next_message().map_err(|error| in_bag(&error))? {
            check(observer)?;
            for part in inputs.parts(message.channel).map_err(|error| in_bag(&error))? {
                match inputs.decode(&message, part) {
                    Input::Event(Event::Tactile(block))
                        if block.is_of(cfg.fusion().tactile_sources()[block.source.position()].n_taxels) =>
                    {
                        let offset_ns = cfg.fusion().tactile_sources()[block.source.position()].stamp_offset_ns;
                        let before = |row: usize| block.row_period_ns.saturating_mul((block.rows - 1 - row) as i64);
                        tactile[block.source.position()]
                            .extend((0..block.rows).map(|row| block.stamp.offset(offset_ns - before(row))));
                    }
                    Input::Event(Event::Joints(sample)) => {
                        joints[sample.source.position()].push(sample.stamp);
                        let angles = sample.names.iter().zip(sample.positions);
                        for (name, _) in angles.filter(|(_, angle)| angle.is_finite()) {
                            if let Some((n, _)) = seen.get_mut(name) {
                                *n += 1;
                            } else {
                                seen.insert(name.clone(), (1, sample.source.position()));
                            }
                        }
                    }
                    _ => {}
                }
            }
        }
        inputs.check_end(std::iter::empty()).map_err(|error| in_bag(&error))?;
        let share =
            |(name, (n, source)): (String, (u64, usize))| (name, (n as f64 / joints[source].len() as f64, source));
        let named = |source: &String, stamps: &Vec<Stamp>| NamedTiming {
            source: source.clone(),
            timing: StreamTiming::of(stamps),
        };
        Ok(Scan {
            bag: bag.display().to_string(),
            tactile: cfg
                .fusion()
                .tactile_sources()
                .iter()
                .zip(&tactile)
                .map(|(source, stamps)| named(&source.name, stamps))
                .collect(),
            shares: seen.into_iter().map(share).collect(),
            joints: cfg
                .fusion()
                .joint_sources()
                .iter()
                .zip(&joints)
                .map(|(source, stamps)| named(&source.name, stamps))
                .collect(),
            has_annotations: inputs.has_annotations(),
        })
    }
}

/// The joints that every bag has in most messages, each with the index of its source, and notes on the others.
pub(super) fn common_joints(cfg: &Config, scans: &[Scan]) -> (Vec<(String, usize)>, Vec<String>) {
    let mut left_out = Vec::new();
    let mut common: BTreeMap<&str, usize> = BTreeMap::new();
    for scan in scans {
        common.extend(scan.shares.iter().map(|(joint, (_, source))| (joint.as_str(), *source)));
    }
    let configured =
        cfg.fusion().regions().iter().flat_map(|region| region.joints.iter().map(move |joint| (region, joint)));
    for (region, joint) in configured.filter(|(_, joint)| !common.contains_key(joint.as_str())) {
        left_out.push(format!("{joint}: in region.{}.joints, and in no joint message of any bag", region.name));
    }
    common.retain(|joint, _| {
        let share = |scan: &Scan| scan.shares.get(*joint).map_or(0.0, |(share, _)| *share);
        let Some(scan) = scans.iter().find(|scan| share(scan) < MIN_SHARE) else { return true };
        let percent = 100.0 * share(scan);
        left_out.push(format!("{joint}: has an angle in only {percent:.0} % of the joint messages of {}", scan.bag));
        false
    });
    (common.into_iter().map(|(joint, source)| (joint.to_owned(), source)).collect(), left_out)
}
