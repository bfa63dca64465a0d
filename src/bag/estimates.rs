//! Estimates into a bag: one wrench topic a region, one contacts topic, and a fingerprint of all that was written.

use sha2::{Digest, Sha256};

use super::{BagError, BagWriter, OutChannel};
use crate::fusion::{Contract, FusionConfig, Tick};
use crate::msg::{ContactArray, EstimateTopics, Outgoing, Slot, WireType, WrenchStamped};
use crate::units::Stamp;

/// Writes ticks.
#[derive(Debug)]
pub struct EstimateWriter {
    outgoing: Outgoing,
    wrenches: Vec<Channel>,
    contacts: Channel,
    cdr: Vec<u8>,
    fingerprint: Sha256,
}

#[derive(Debug)]
struct Channel {
    topic: String,
    handle: OutChannel,
    sequence: u32,
}

impl EstimateWriter {
    /// Adds the channels of these topics to a bag.
    ///
    /// # Shapes
    /// `contracts`: `[regions]`, that of each one's model.
    /// # Errors
    /// [`BagError`] when the bag can't be written.
    pub fn new(
        bag: &mut BagWriter,
        topics: &EstimateTopics,
        cfg: &FusionConfig,
        contracts: &[&Contract],
    ) -> Result<Self, BagError> {
        let wrenches =
            topics.wrenches.iter().map(|topic| channel::<WrenchStamped>(bag, topic)).collect::<Result<_, _>>()?;
        Ok(EstimateWriter {
            outgoing: Outgoing::new(cfg, contracts),
            wrenches,
            contacts: channel::<ContactArray>(bag, &topics.contacts)?,
            cdr: Vec::new(),
            fingerprint: Sha256::new(),
        })
    }

    /// Writes the messages of a tick, received when the event came that completed its frame.
    ///
    /// # Errors
    /// [`BagError`] when the bag can't be written.
    pub fn write(&mut self, bag: &mut BagWriter, tick: &Tick) -> Result<(), BagError> {
        let EstimateWriter { outgoing, wrenches, contacts, cdr, fingerprint } = self;
        outgoing.encode(tick, cdr, |slot, cdr| match slot {
            Slot::Wrench(region) => wrenches[region.position()].write(bag, tick.received, cdr, fingerprint),
            Slot::Contacts => contacts.write(bag, tick.received, cdr, fingerprint),
        })
    }

    /// Writes what still waits for a frame of another source, after the last tick.
    ///
    /// # Errors
    /// [`BagError`] when the bag can't be written.
    pub fn finish(&mut self, bag: &mut BagWriter) -> Result<(), BagError> {
        let EstimateWriter { outgoing, contacts, cdr, fingerprint, .. } = self;
        let received = outgoing.received();
        outgoing.finish(cdr, |_, cdr| contacts.write(bag, received, cdr, fingerprint))
    }

    /// SHA-256 over topic and bytes of every message so far: equal for equal estimates, whatever else the bag holds.
    pub fn sha256(&self) -> String {
        self.fingerprint.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

impl Channel {
    fn write(
        &mut self,
        bag: &mut BagWriter,
        received: Stamp,
        cdr: &[u8],
        fingerprint: &mut Sha256,
    ) -> Result<(), BagError> {
        fingerprint.update(self.topic.as_bytes());
        fingerprint.update(cdr);
        bag.write(self.handle, self.sequence, received, received, cdr)?;
        self.sequence = self.sequence.wrapping_add(1);
        Ok(())
    }
}

fn channel<T: WireType>(bag: &mut BagWriter, topic: &str) -> Result<Channel, BagError> {
    Ok(Channel { topic: topic.to_owned(), handle: bag.add_topic::<T>(topic)?, sequence: 0 })
}
