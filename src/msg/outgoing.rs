//! Estimates as messages: the one way in which live node and replay tell forces and contacts.

mod gathering;

use self::gathering::Gathering;
use super::{ContactArray, ContactState, Header, Time, Vector3, Wrench, WrenchStamped, to_cdr_into};
use crate::fusion::{
    Adaptation, ContactEvent, Contract, Estimate, FusionConfig, RegionConfig, RegionIdx, TactileSourceIdx, Tick,
};
use crate::units::{NANOS_PER_SEC, Newton, Stamp};

/// Which of a node's topics a message is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slot {
    /// The wrench of a region.
    Wrench(RegionIdx),
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
            wrenches: cfg.regions().iter().map(|region| format!("{node}/{}/wrench", region.name)).collect(),
            contacts: format!("{node}/contacts"),
        }
    }

    /// All of them.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.wrenches.iter().chain([&self.contacts]).map(String::as_str)
    }
}

/// The messages of ticks, in buffers that are filled anew for each one.
#[derive(Debug, Clone)]
pub struct Outgoing {
    regions: Vec<RegionConfig>,
    contacts: ContactArray,
    gathering: Gathering,
    /// Receipt of the last tick.
    received: Stamp,
    wrenches: Vec<WrenchStamped>,
}

impl Outgoing {
    /// Messages for the regions of a configuration.
    ///
    /// # Shapes
    /// `contracts`: `[regions]`, that of each one's model.
    pub fn new(cfg: &FusionConfig, contracts: &[&Contract]) -> Self {
        let level = |level: Option<f64>| level.unwrap_or(f64::NAN);
        let touch = |region: &RegionConfig, contract: &Contract| region.contact.touch_levels(contract.touch.as_ref());
        let contact = |(region, contract): (&RegionConfig, &&Contract)| ContactState {
            region: region.name.clone(),
            frame_id: region.patch.frame_id.clone(),
            on_threshold: region.contact.force_on.0,
            off_threshold: region.contact.force_off.0,
            mdf: or_nan(contract.mdf),
            touch_on: level(touch(region, contract).map(|levels| levels.on)),
            touch_off: level(touch(region, contract).map(|levels| levels.off)),
            ..ContactState::default()
        };
        let wrench = |region: &RegionConfig| {
            let header = Header { stamp: Time::default(), frame_id: region.patch.frame_id.clone() };
            WrenchStamped { header, wrench: Wrench::default() }
        };
        let period_ns = |source: TactileSourceIdx| {
            let region = cfg.regions().iter().position(|region| region.source == source)?;
            Some((NANOS_PER_SEC as f64 / contracts.get(region)?.rate_hz) as i64)
        };
        let periods_ns: Vec<Option<i64>> = cfg.tactile_source_idxs().map(period_ns).collect();
        let contacts = cfg.regions().iter().zip(contracts).map(contact).collect();
        let mut outgoing = Outgoing {
            contacts: ContactArray { header: Header::default(), contacts },
            gathering: Gathering::new(&periods_ns),
            received: Stamp(0),
            wrenches: cfg.regions().iter().map(wrench).collect(),
            regions: cfg.regions().to_vec(),
        };
        outgoing.contacts.contacts.iter_mut().for_each(silence);
        outgoing
    }

    /// Hands over the messages that a tick completes as CDR: the wrench of each region that has a force, at once, and the
    /// contacts of all regions once each source that comes has a frame for them. Sources and regions that the configuration
    /// of these messages doesn't have are left out.
    ///
    /// # Errors
    /// Those of `write`, at once.
    pub fn encode<E>(
        &mut self,
        tick: &Tick,
        cdr: &mut Vec<u8>,
        mut write: impl FnMut(Slot, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        self.received = tick.received;
        for estimate in &tick.estimates {
            if let Some(wrench) = self.wrench(tick.stamp, estimate) {
                to_cdr_into(wrench, cdr);
                write(Slot::Wrench(estimate.region), cdr)?;
            }
        }
        if tick.estimates.is_empty() {
            return Ok(()); // a source that no region uses
        }
        for estimate in &tick.estimates {
            let is_told = !self.gathering.is_fresh(tick.source.position());
            self.handle_estimate(tick, estimate, is_told);
        }
        if self.gathering.handle_frame(tick.source.position(), tick.stamp) { self.tell(cdr, write) } else { Ok(()) }
    }

    /// Hands over, at the end, the contacts that still wait for a frame of another source.
    ///
    /// # Errors
    /// Those of `write`.
    pub fn finish<E>(&mut self, cdr: &mut Vec<u8>, write: impl FnMut(Slot, &[u8]) -> Result<(), E>) -> Result<(), E> {
        if self.gathering.stamp().is_some() { self.tell(cdr, write) } else { Ok(()) }
    }

    /// Receipt of the last tick.
    pub fn received(&self) -> Stamp {
        self.received
    }

    /// The contacts at a time at which no source comes: every region without an estimate.
    pub fn silent(&self, stamp: Stamp) -> ContactArray {
        let mut contacts = self.contacts.clone(); // frames that wait to be told are told all the same
        contacts.header.stamp = time(stamp);
        contacts.contacts.iter_mut().for_each(silence);
        contacts
    }

    fn tell<E>(&mut self, cdr: &mut Vec<u8>, mut write: impl FnMut(Slot, &[u8]) -> Result<(), E>) -> Result<(), E> {
        self.contacts.header.stamp = time(self.gathering.stamp().unwrap_or_default());
        for (region, state) in self.regions.iter().zip(&mut self.contacts.contacts) {
            if !self.gathering.is_fresh(region.source.position()) {
                silence(state);
            }
        }
        self.gathering.handle_told();
        to_cdr_into(&self.contacts, cdr);
        write(Slot::Contacts, cdr)
    }

    /// Puts an estimate into the contacts that are told next. What began or ended in a frame that is told in no message of
    /// its own (`is_told` says whether the last one was) is told in the next.
    fn handle_estimate(&mut self, tick: &Tick, estimate: &Estimate, is_told: bool) {
        let Some(state) = self.contacts.contacts.get_mut(estimate.region.position()) else { return };
        let event = match estimate.contact.event {
            ContactEvent::None => ContactState::NONE,
            ContactEvent::Onset => ContactState::ONSET,
            ContactEvent::Offset => ContactState::OFFSET,
        };
        if is_told || event != ContactState::NONE {
            state.event = event;
        }
        state.contact_raw = estimate.contact.raw;
        state.contact = estimate.contact.state;
        state.since = time(estimate.contact.since);
        state.force = or_nan(estimate.force);
        state.force_base = or_nan(estimate.force_base);
        state.artifact = or_nan(estimate.artifact());
        state.pose_age = estimate.pose_age_ns.map_or(f64::NAN, |age_ns| age_ns as f64 * 1e-9);
        state.age = tick.age_ns.map_or(f64::NAN, |age_ns| age_ns as f64 * 1e-9);
        state.flags = estimate.flags.bits();
        state.adaptation = adaptation_code(estimate.adaptation);
        state.artifact_change = estimate.artifact_change.unwrap_or(f64::NAN);
        state.touch = estimate.touch.unwrap_or(f64::NAN);
    }

    /// The wrench of an estimate at `stamp`; `None` where there is no force, because a wrench has no way to say so.
    pub fn wrench(&mut self, stamp: Stamp, estimate: &Estimate) -> Option<&WrenchStamped> {
        let wrench = self.regions.get(estimate.region.position())?.patch.wrench(estimate.force?, estimate.tangential);
        let message = self.wrenches.get_mut(estimate.region.position())?;
        message.header.stamp = time(stamp);
        let vector = |v: nalgebra::Vector3<f64>| Vector3 { x: v.x, y: v.y, z: v.z };
        message.wrench = Wrench { force: vector(wrench.force), torque: vector(wrench.torque) };
        Some(message)
    }
}

/// Takes the force out of the state of a region whose taxels did not come in time. Its contact stays as it was last known.
fn silence(state: &mut ContactState) {
    (state.contact_raw, state.event) = (false, ContactState::NONE);
    (state.force, state.force_base, state.artifact) = (f64::NAN, f64::NAN, f64::NAN);
    state.touch = f64::NAN;
    state.pose_age = f64::NAN;
    state.age = f64::NAN;
    state.flags = ContactState::STALE_TACTILE;
    (state.adaptation, state.artifact_change) = (ContactState::ADAPTATION_OFF, f64::NAN);
}

/// The value of a message for what became of an artifact.
pub fn adaptation_code(adaptation: Adaptation) -> u8 {
    match adaptation {
        Adaptation::Off => ContactState::ADAPTATION_OFF,
        Adaptation::Frozen => ContactState::ADAPTATION_FROZEN,
        Adaptation::Learning => ContactState::ADAPTATION_LEARNING,
        Adaptation::Waiting => ContactState::ADAPTATION_WAITING,
        Adaptation::Capped => ContactState::ADAPTATION_CAPPED,
        Adaptation::Noisy => ContactState::ADAPTATION_NOISY,
    }
}

fn or_nan(force: Option<Newton>) -> f64 {
    force.map_or(f64::NAN, |force| force.0)
}

fn time(stamp: Stamp) -> Time {
    let (sec, nanosec) = stamp.to_sec_nanosec();
    Time { sec, nanosec }
}
