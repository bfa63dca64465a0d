//! Estimates as messages: the one way in which live node and replay tell forces and contacts.

use super::{ContactArray, ContactState, Header, Time, Vector3, Wrench, WrenchStamped, to_cdr_into};
use crate::fusion::{ContactEvent, Estimate, FusionConfig, RegionConfig, Tick};
use crate::units::{Newton, Stamp};

/// Which of a node's topics a message is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slot {
    /// The wrench of a region, by its index.
    Wrench(usize),
    /// The contacts of all regions.
    Contacts,
}

/// Names of the topics that estimates go to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EstimateTopics {
    /// `[regions]`.
    pub wrenches: Vec<String>,
    /// One for all.
    pub contacts: String,
}

impl EstimateTopics {
    /// The topics of a node: `~/REGION/wrench` and `~/contacts`.
    ///
    /// `node`: fully qualified, as in `/left/tactile_pose_fusion`.
    pub fn of_node(node: &str, cfg: &FusionConfig) -> Self {
        EstimateTopics {
            wrenches: cfg.regions.iter().map(|region| format!("{node}/{}/wrench", region.name)).collect(),
            contacts: format!("{node}/contacts"),
        }
    }

    /// All of them.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.wrenches.iter().chain([&self.contacts]).map(String::as_str)
    }
}

/// The messages of a tick, in buffers that are filled anew for each one.
#[derive(Debug, Clone)]
pub struct Outgoing {
    regions: Vec<RegionConfig>,
    contacts: Vec<ContactArray>,
    wrenches: Vec<WrenchStamped>,
}

impl Outgoing {
    /// Messages for the regions of a configuration.
    ///
    /// # Shapes
    /// `mdf`: `[regions]`, the minimum detectable force of each one's model, where it is known.
    pub fn new(cfg: &FusionConfig, mdf: &[Option<Newton>]) -> Self {
        let contact = |region: &RegionConfig, mdf: Option<Newton>| ContactState {
            region: region.name.clone(),
            frame_id: region.patch.frame_id.clone(),
            on_threshold: region.contact.force_on.0,
            off_threshold: region.contact.force_off.0,
            mdf: or_nan(mdf),
            ..ContactState::default()
        };
        let of_source = |source_idx: usize| {
            let regions = cfg.regions.iter().zip(mdf).filter(move |(region, _)| region.source.0 == source_idx);
            let contacts = regions.map(|(region, &mdf)| contact(region, mdf)).collect();
            ContactArray { header: Header::default(), contacts }
        };
        let wrench = |region: &RegionConfig| {
            let header = Header { stamp: Time::default(), frame_id: region.patch.frame_id.clone() };
            WrenchStamped { header, wrench: Wrench::default() }
        };
        Outgoing {
            contacts: (0..cfg.tactile_sources.len()).map(of_source).collect(),
            wrenches: cfg.regions.iter().map(wrench).collect(),
            regions: cfg.regions.clone(),
        }
    }

    /// Hands over the messages of a tick as CDR: the wrench of each region that has a force, then the contacts.
    ///
    /// # Errors
    /// Those of `write`, at once.
    pub fn encode<E>(
        &mut self,
        tick: &Tick,
        cdr: &mut Vec<u8>,
        mut write: impl FnMut(Slot, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        for estimate in &tick.estimates {
            if let Some(wrench) = self.wrench(tick.stamp, estimate) {
                to_cdr_into(wrench, cdr);
                write(Slot::Wrench(estimate.region), cdr)?;
            }
        }
        to_cdr_into(self.contact_array(tick), cdr);
        write(Slot::Contacts, cdr)
    }

    /// The contacts of a tick: every region of its source, touching or not.
    pub fn contact_array(&mut self, tick: &Tick) -> &ContactArray {
        let array = &mut self.contacts[tick.source.0];
        array.header.stamp = time(tick.stamp);
        for (state, estimate) in array.contacts.iter_mut().zip(&tick.estimates) {
            state.contact_raw = estimate.contact.raw;
            state.contact = estimate.contact.state;
            state.event = match estimate.contact.event {
                ContactEvent::None => ContactState::NONE,
                ContactEvent::Onset => ContactState::ONSET,
                ContactEvent::Offset => ContactState::OFFSET,
            };
            state.since = time(estimate.contact.since);
            state.force = or_nan(estimate.force);
            state.force_base = or_nan(estimate.force_base);
            state.artifact = or_nan(estimate.artifact());
            state.pose_age = estimate.pose_age_ns.map_or(f64::NAN, |age_ns| age_ns as f64 * 1e-9);
            state.flags = estimate.flags.bits();
        }
        array
    }

    /// The wrench of an estimate at `stamp`; `None` where there is no force, because a wrench has no way to say so.
    pub fn wrench(&mut self, stamp: Stamp, estimate: &Estimate) -> Option<&WrenchStamped> {
        let wrench = self.regions[estimate.region].patch.wrench(estimate.force?);
        let message = &mut self.wrenches[estimate.region];
        message.header.stamp = time(stamp);
        let vector = |v: nalgebra::Vector3<f64>| Vector3 { x: v.x, y: v.y, z: v.z };
        message.wrench = Wrench { force: vector(wrench.force), torque: vector(wrench.torque) };
        Some(message)
    }
}

fn or_nan(force: Option<Newton>) -> f64 {
    force.map_or(f64::NAN, |force| force.0)
}

fn time(stamp: Stamp) -> Time {
    let (sec, nanosec) = stamp.to_sec_nanosec();
    Time { sec, nanosec }
}
