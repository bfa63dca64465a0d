use std::{
  cmp::{max, min},
  time::Instant,
};

#[allow(unused_imports)]
use log::{debug, error, info, trace, warn};

use crate::{
  discovery::sedp_messages::DiscoveredWriterData,
  rtps::{
    constant::{
      ANNOUNCEMENTS_PER_SECOND, MAX_ACKNACK_SPAN, MAX_ANSWERS_PER_SECOND, MAX_SAMPLES_AHEAD_OF_HEARTBEAT,
      MAX_TRACKED_CHANGES_PER_WRITER, MIN_FAR_CONTRADICTIONS, MIN_TIME_AHEAD,
    },
    rate_limit::RateLimit,
  },
  structure::{
    guid::{EntityId, GUID},
    locator::Locator,
    sequence_number::{SequenceNumber, SequenceNumberRanges},
    time::Timestamp,
  },
};

#[derive(Debug)] // these are not cloneable, because contained data may be large
pub(crate) struct RtpsWriterProxy {
  /// Identifies the remote matched Writer
  pub remote_writer_guid: GUID,

  /// List of unicast (address, port) combinations that can be used to send
  /// messages to the matched Writer or Writers. The list may be empty.
  pub unicast_locator_list: Vec<Locator>,

  /// List of multicast (address, port) combinations that can be used to send
  /// messages to the matched Writer or Writers. The list may be empty.
  pub multicast_locator_list: Vec<Locator>,

  /// How often we may answer this writer's HEARTBEATs.
  pub answers: RateLimit,

  /// How often we hear this writer announce its participant.
  pub announcements: RateLimit,

  /// Identifies the group to which the matched Reader belongs
  pub remote_group_entity_id: EntityId,

  // See RTPS Spec v2.5 Section 8.4.10.4 on how the WriterProxy is supposed to
  // operate.
  // And 8.4.10.5 on statuses of the (cache) changes received from a writer.
  // The changes are identified by sequence numbers.
  // Any sequence number is at any moment in one of the following states:
  // unknown, missing, received, not_available.
  //
  // Unknown means that we have no information of that change. This is the initial state for
  // everyone. Missing means that writer claims to have it and reader may request it with
  // ACKNACK. Received means that the reader has received the change via DATA (or DATAFRAGs).
  // Not_available means that writer has informed via GAP message that change is not available.

  // Unknown can transition to Missing (via HEARTBEAT), Received (DATA), or not_available (GAP).
  // Missing can transition to Received or Not_available.
  // Received cannot transition to anything.
  // Not_available cannot transition to anything.

  // We keep a set "known" and a sequence number counter "ack_base", to keep track
  // of these.

  // All changes below ack_base are either received or not_available.
  // All changes in "known" are either received or not_available.
  // All changes above hb_last are unknown (if they are not in "known")
  // All others between ack_base and hb_last (inclusive) are missing.

  // Kept as ranges, because a GAP may tell of any number of changes.
  known: SequenceNumberRanges,

  // Count of the last HEARTBEAT from this writer. A HEARTBEAT may come by several
  // ways; the copies carry the same count.
  pub last_heartbeat_count: Option<i32>,

  // How many HEARTBEATs in a row said that the writer is far behind of what other
  // messages said, and since when they say that it is behind of ack_base while
  // nothing is received. See heartbeat_contradiction.
  far_contradictions: u32,
  ahead_since: Option<Instant>,

  pub sent_ack_nack_count: i32,

  ack_base: SequenceNumber, // We can ACK everything before this number.
  // ack_base can be increased from N-1 to N, if we receive DATA with SequenceNumber N-1
  // heartbeat(first,last) => ack_base can be increased to first.
  // GAP is treated like receiving a message.

  // These are used for quick tracking of
  last_received_sequence_number: SequenceNumber,
  last_received_timestamp: Timestamp,
}

impl RtpsWriterProxy {
  pub fn new(
    remote_writer_guid: GUID,
    unicast_locator_list: Vec<Locator>,
    multicast_locator_list: Vec<Locator>,
    remote_group_entity_id: EntityId,
  ) -> Self {
    Self {
      remote_writer_guid,
      unicast_locator_list,
      multicast_locator_list,
      remote_group_entity_id,
      known: SequenceNumberRanges::default(),
      last_heartbeat_count: None,
      far_contradictions: 0,
      ahead_since: None,
      answers: RateLimit::new(MAX_ANSWERS_PER_SECOND),
      announcements: RateLimit::new(ANNOUNCEMENTS_PER_SECOND),
      sent_ack_nack_count: 0,
      // Sequence numbering must start at 1.
      // Therefore, we can ACK all sequence numbers below 1 even before receiving anything.
      ack_base: SequenceNumber::new(1),
      last_received_sequence_number: SequenceNumber::new(0),
      last_received_timestamp: Timestamp::INVALID,
    }
  }

  pub fn next_ack_nack_sequence_number(&mut self) -> i32 {
    let c = self.sent_ack_nack_count;
    self.sent_ack_nack_count += 1;
    c
  }

  // Returns a bound, below which everything can be acknowledged, i.e.
  // is received either as DATA or GAP
  pub fn all_ackable_before(&self) -> SequenceNumber {
    self.ack_base
  }

  pub fn update_contents(&mut self, other: Self) {
    self.unicast_locator_list = other.unicast_locator_list;
    self.multicast_locator_list = other.multicast_locator_list;
    self.remote_group_entity_id = other.remote_group_entity_id;
  }

  // This is used to check for DEADLINE policy
  pub fn last_change_timestamp(&self) -> Option<Timestamp> {
    if self.last_received_sequence_number > SequenceNumber::new(0) {
      Some(self.last_received_timestamp)
    } else {
      None
    }
  }

  // Check if we no samples in the received state.
  pub fn no_changes_received(&self) -> bool {
    self.ack_base == SequenceNumber::new(0) && self.known.is_empty()
  }

  // Given an availability range from a HEARTBEAT, find out what we are missing:
  // the lowest missing number, and those after it that one ACKNACK can ask for.
  //
  // Note: Heartbeat gives bounds only. Some samples within that range may
  // have been received already, or not really available, i.e. there may be GAPs
  // in the range.
  pub fn missing_seqnums(
    &self,
    hb_first_sn: SequenceNumber,
    hb_last_sn: SequenceNumber,
  ) -> Vec<SequenceNumber> {
    // ignore those that we already have
    let first = max(hb_first_sn, self.ack_base);
    let Some(first_missing) = self.known.missing(first, hb_last_sn).next() else {
      return vec![];
    };
    let last = min(
      hb_last_sn,
      first_missing + SequenceNumber::new(MAX_ACKNACK_SPAN - 1),
    );
    self.known.missing(first_missing, last).collect()
  }

  // Check if we have already received this sequence number
  // or it has been marked as not_available
  pub fn should_ignore_change(&self, seqnum: SequenceNumber) -> bool {
    seqnum < self.ack_base || self.known.contains(seqnum)
  }

  // This is used to mark DATA as received.
  pub fn received_changes_add(&mut self, seq_num: SequenceNumber, receive_timestamp: Timestamp) {
    self.ahead_since = None;
    if seq_num >= self.ack_base {
      self.known.insert(seq_num);
    }

    // Update deadline tracker
    if seq_num > self.last_received_sequence_number {
      self.last_received_sequence_number = seq_num;
      self.last_received_timestamp = receive_timestamp;
    }

    // We get to advance ack_base if it was equal to seq_num
    // If ack_base < seq_num, we are still missing seq_num-1 or others below
    // If ack_base > seq_num, this is either a duplicate or ack_base was wrong.
    // Remember, ack_base is the SN one past the last received/irrelevant SN.
    if seq_num == self.ack_base {
      self.advance_ack_base();
    }

    // Bound the map even when ack_base cannot advance (best-effort loss leaves a
    // permanent gap below the newly received sample).
    self.enforce_range_cap();
  }

  // Used to add individual irrelevant changes from GAP message
  pub fn set_irrelevant_change(&mut self, seq_num: SequenceNumber) {
    self.irrelevant_changes_range(seq_num, seq_num.plus_1());
  }

  // Used to add range of irrelevant changes from GAP submessage or unavailable
  // changes from HEARTBEAT submessage
  pub fn irrelevant_changes_range(
    &mut self,
    remove_from: SequenceNumber,
    remove_until_before: SequenceNumber,
  ) {
    // check sanity
    if remove_from > remove_until_before {
      error!(
        "irrelevant_changes_range: negative range: remove_from={remove_from:?} \
         remove_until_before={remove_until_before:?}"
      );
      return;
    }
    // now remove_from <= remove_until_before, i.e. at least zero to remove
    //
    // Numbers below ack_base are known already.
    self
      .known
      .insert_range(max(remove_from, self.ack_base), remove_until_before);
    self.advance_ack_base();
    self.enforce_range_cap();

    debug!(
      "ack_base is {:?} after irrelevant_changes_range {:?} to {:?}. writer={:?}",
      self.ack_base, remove_from, remove_until_before, self.remote_writer_guid
    );
  }

  // Used to mark messages irrelevant because of a HEARTBEAT message.
  //
  // smallest_seqnum is the lowest key to be retained
  pub fn irrelevant_changes_up_to(&mut self, smallest_seqnum: SequenceNumber) {
    self.irrelevant_changes_range(SequenceNumber::new(0), smallest_seqnum);
  }

  fn discovered_or_default(drd: &[Locator], default: &[Locator]) -> Vec<Locator> {
    if drd.is_empty() {
      default.to_vec()
    } else {
      drd.to_vec()
    }
  }

  pub fn from_discovered_writer_data(
    discovered_writer_data: &DiscoveredWriterData,
    default_unicast_locators: &[Locator],
    default_multicast_locators: &[Locator],
  ) -> RtpsWriterProxy {
    let unicast_locator_list = Self::discovered_or_default(
      &discovered_writer_data.writer_proxy.unicast_locator_list,
      default_unicast_locators,
    );
    let multicast_locator_list = Self::discovered_or_default(
      &discovered_writer_data.writer_proxy.multicast_locator_list,
      default_multicast_locators,
    );

    RtpsWriterProxy {
      remote_writer_guid: discovered_writer_data.writer_proxy.remote_writer_guid,
      remote_group_entity_id: EntityId::UNKNOWN,
      unicast_locator_list,
      multicast_locator_list,
      known: SequenceNumberRanges::default(),
      last_heartbeat_count: None,
      far_contradictions: 0,
      ahead_since: None,
      answers: RateLimit::new(MAX_ANSWERS_PER_SECOND),
      announcements: RateLimit::new(ANNOUNCEMENTS_PER_SECOND),
      sent_ack_nack_count: 0,
      ack_base: SequenceNumber::default(),
      last_received_sequence_number: SequenceNumber::new(0),
      last_received_timestamp: Timestamp::INVALID,
    }
  } // fn

  // Advance ack_base as far as possible
  // This function should be called after the writer proxy has modified its
  // known changes (for instance added a new received change) such that ack_base
  // could be advanced
  fn advance_ack_base(&mut self) {
    if let Some((start, end)) = self.known.first_range() {
      if start <= self.ack_base {
        self.ack_base = max(self.ack_base, end);
        // What is below ack_base is known anyway.
        self.known.remove_before(self.ack_base);
      }
    }
  }

  // Memory-safety backstop: samples that are lost for good, or a writer that says
  // it has only every other sample, leave any number of gaps between what is
  // known. When there are more than the cap, force ack_base past the oldest
  // gap (giving up on it as lost) so the set cannot grow without bound.
  fn enforce_range_cap(&mut self) {
    while self.known.range_count() > MAX_TRACKED_CHANGES_PER_WRITER {
      if let Some((_, end)) = self.known.remove_first_range() {
        self.ack_base = max(self.ack_base, end);
      }
    }
  }

  // A HEARTBEAT says how far the writer has come. Numbers beyond that came from
  // messages that were malformed, or not from this writer. Believing in them
  // would mean ignoring the writer until it gets there, maybe never.
  //
  // As HEARTBEATs and samples come by different ways, a HEARTBEAT may be older
  // than samples that came before it. So it is believed only if it is far behind,
  // or if nothing at all of the writer was taken for a while.
  //
  // Returns from which number on samples must be forgotten, if so.
  pub fn heartbeat_contradiction(
    &mut self,
    hb_last_sn: SequenceNumber,
    now: Instant,
  ) -> Option<SequenceNumber> {
    let next = hb_last_sn.plus_1();
    let plausible_end = next + SequenceNumber::new(MAX_SAMPLES_AHEAD_OF_HEARTBEAT);
    let is_far = max(self.known.end().unwrap_or(next), self.ack_base) > plausible_end;
    if !is_far {
      self.far_contradictions = 0;
    }
    if self.ack_base <= next {
      self.ahead_since = None;
    }
    if is_far {
      self.far_contradictions += 1;
      if self.far_contradictions < MIN_FAR_CONTRADICTIONS {
        return None;
      }
    } else if self.ack_base > next {
      let ahead_since = *self.ahead_since.get_or_insert(now);
      if now.duration_since(ahead_since) < MIN_TIME_AHEAD {
        return None;
      }
    } else {
      return None;
    }
    (self.far_contradictions, self.ahead_since) = (0, None);
    let forget_from = if self.ack_base > next {
      self.ack_base = next;
      next
    } else {
      plausible_end
    };
    warn!(
      "Writer {:?} has come to {hb_last_sn:?} only. Forgetting {forget_from:?} and later.",
      self.remote_writer_guid
    );
    self.known.remove_from(forget_from);
    self.last_received_sequence_number = min(self.last_received_sequence_number, hb_last_sn);
    Some(forget_from)
  }

  #[cfg(test)]
  pub fn tracked_changes_count(&self) -> usize {
    self.known.range_count()
  }
} // impl

#[cfg(test)]
mod bounded_map_tests {
  use super::*;
  use crate::structure::guid::GuidPrefix;

  fn test_proxy() -> RtpsWriterProxy {
    RtpsWriterProxy::new(
      GUID::new(GuidPrefix::UNKNOWN, EntityId::UNKNOWN),
      vec![],
      vec![],
      EntityId::UNKNOWN,
    )
  }

  // Regression: a best-effort writer sends no HEARTBEAT/GAP, so the changes map
  // used to accumulate one entry per received sample forever. With eager pruning
  // below ack_base, contiguous delivery must keep the map ~empty.
  #[test]
  fn changes_map_does_not_grow_on_contiguous_delivery() {
    let mut wp = test_proxy();
    let n: i64 = 50_000;
    for i in 1..=n {
      wp.received_changes_add(SequenceNumber::new(i), Timestamp::INVALID);
    }
    // Everything received in order: ack_base advanced past the last sample.
    assert_eq!(wp.all_ackable_before(), SequenceNumber::new(n + 1));
    assert!(
      wp.tracked_changes_count() <= 1,
      "changes map grew unbounded on contiguous delivery: {} entries",
      wp.tracked_changes_count()
    );
  }

  // Regression: with a permanently missing sample (best-effort loss) ack_base
  // stalls, so pruning below it is not enough. The hard cap must still bound the
  // map by giving up on the stalled gap.
  #[test]
  fn changes_map_bounded_with_permanent_gap() {
    let mut wp = test_proxy();
    // Sample 1 is never delivered; deliver a long run above it.
    let n: i64 = MAX_TRACKED_CHANGES_PER_WRITER as i64 * 4;
    for i in 2..=n {
      wp.received_changes_add(SequenceNumber::new(i), Timestamp::INVALID);
    }
    assert!(
      wp.tracked_changes_count() <= MAX_TRACKED_CHANGES_PER_WRITER,
      "changes map exceeded cap {} under a permanent gap: {} entries",
      MAX_TRACKED_CHANGES_PER_WRITER,
      wp.tracked_changes_count()
    );
  }

  fn huge() -> SequenceNumber {
    SequenceNumber::new(1 << 59)
  }

  fn sn(n: i64) -> SequenceNumber {
    SequenceNumber::new(n)
  }

  // Whatever range a GAP or HEARTBEAT names, we keep a few numbers and ask for
  // what fits into an ACKNACK.
  #[test]
  fn huge_ranges_cost_nothing() {
    let mut wp = test_proxy();
    assert_eq!(wp.missing_seqnums(sn(1), huge()).len(), MAX_ACKNACK_SPAN as usize);
    wp.irrelevant_changes_range(sn(1000), huge());
    assert_eq!(wp.tracked_changes_count(), 1);
    assert_eq!(
      wp.missing_seqnums(sn(1), huge()),
      (1..257).map(sn).collect::<Vec<_>>()
    );
    wp.irrelevant_changes_up_to(sn(900));
    assert_eq!(
      wp.missing_seqnums(sn(1), huge()),
      (900..1000).map(sn).chain([huge()]).take_while(|n| *n < sn(1156)).collect::<Vec<_>>()
    );
    for n in 0..3 * MAX_TRACKED_CHANGES_PER_WRITER as i64 {
      wp.set_irrelevant_change(sn(2_000_000 + 2 * n) + huge());
    }
    assert!(wp.tracked_changes_count() <= MAX_TRACKED_CHANGES_PER_WRITER);
  }

  #[test]
  fn only_what_is_missing_is_asked_for() {
    let mut wp = test_proxy();
    for n in [1, 2, 4, 7] {
      wp.received_changes_add(sn(n), Timestamp::INVALID);
    }
    wp.set_irrelevant_change(sn(5));
    assert_eq!(wp.all_ackable_before(), sn(3));
    assert_eq!(wp.missing_seqnums(sn(1), sn(8)), [3, 6, 8].map(sn));
    wp.received_changes_add(sn(3), Timestamp::INVALID);
    assert_eq!(wp.all_ackable_before(), sn(6));
    assert!(wp.missing_seqnums(sn(1), sn(5)).is_empty());
    assert!(wp.missing_seqnums(sn(9), sn(8)).is_empty());
  }

  // A message that says that everything up to a huge number is gone does not make
  // us ignore the writer for good: its HEARTBEATs put it right.
  #[test]
  fn heartbeats_put_right_what_a_forged_gap_did() {
    let mut wp = test_proxy();
    wp.received_changes_add(sn(1), Timestamp::INVALID);
    let start = Instant::now();

    // far ahead: the second HEARTBEAT is believed
    wp.irrelevant_changes_range(sn(1), huge());
    assert!(wp.should_ignore_change(sn(2)));
    assert_eq!(wp.heartbeat_contradiction(sn(2), start), None);
    assert_eq!(wp.heartbeat_contradiction(sn(3), start), Some(sn(4)));
    assert!(wp.should_ignore_change(sn(3)) && !wp.should_ignore_change(sn(4)));

    // a little ahead: when nothing came through for a while
    wp.irrelevant_changes_range(sn(1), sn(1000));
    assert_eq!(wp.heartbeat_contradiction(sn(4), start), None);
    assert_eq!(wp.heartbeat_contradiction(sn(5), start + MIN_TIME_AHEAD / 2), None);
    assert_eq!(
      wp.heartbeat_contradiction(sn(6), start + MIN_TIME_AHEAD),
      Some(sn(7))
    );
    assert!(!wp.should_ignore_change(sn(7)));

    // samples far ahead, while the writer's own are received
    wp.received_changes_add(huge(), Timestamp::INVALID);
    wp.received_changes_add(sn(7), Timestamp::INVALID);
    assert_eq!(wp.heartbeat_contradiction(sn(7), start), None);
    wp.received_changes_add(sn(8), Timestamp::INVALID);
    let forgotten = wp.heartbeat_contradiction(sn(8), start).unwrap();
    assert!(sn(8) < forgotten && forgotten <= huge());
    assert_eq!(wp.all_ackable_before(), sn(9));
    assert_eq!(wp.tracked_changes_count(), 0);
  }

  // HEARTBEATs that are older than samples, again and again, are no contradiction.
  #[test]
  fn late_heartbeats_put_nothing_right() {
    let mut wp = test_proxy();
    let start = Instant::now();
    for n in 1..2000 {
      wp.received_changes_add(sn(n), Timestamp::INVALID);
      let now = start + MIN_TIME_AHEAD * n as u32;
      assert_eq!(wp.heartbeat_contradiction(sn(max(0, n - 100)), now), None);
    }
    assert_eq!(wp.all_ackable_before(), sn(2000));
  }
}
