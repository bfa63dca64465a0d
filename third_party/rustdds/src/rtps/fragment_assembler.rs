use std::{
  cmp::min,
  collections::BTreeMap,
  fmt, iter,
  sync::atomic::{AtomicUsize, Ordering},
};

use bit_vec::BitVec;
use enumflags2::BitFlags;
use bytes::{Bytes, BytesMut};
#[allow(unused_imports)]
use log::{debug, error, info, trace, warn};

use crate::{
  dds::ddsdata::DDSData,
  messages::submessages::{
    elements::serialized_payload::SerializedPayload,
    submessages::{DATAFRAG_Flags, DataFrag},
  },
  rtps::constant::{
    ASSEMBLY_BYTES_ALWAYS_LEFT, MAX_ASSEMBLY_BYTES, MAX_ASSEMBLY_BYTES_PER_WRITER,
    MAX_FRAGMENTS_PER_SAMPLE, MAX_SAMPLE_SIZE,
  },
  structure::{
    cache_change::ChangeKind,
    sequence_number::{FragmentNumber, SequenceNumber},
    time::Timestamp,
  },
};

// Bytes of one chunk of an assembly buffer. Only chunks that something was
// received for are allocated, so a DATAFRAG can't make us allocate the sample
// size that it claims.
const CHUNK_SIZE: usize = 4096;

/// How many bytes all assembly buffers of this process may hold together, and
/// how many they do.
#[derive(Debug)]
pub(crate) struct AssemblyBudget {
  limit: usize,
  used: AtomicUsize,
}

impl AssemblyBudget {
  pub const fn new(limit: usize) -> Self {
    Self {
      limit,
      used: AtomicUsize::new(0),
    }
  }

  fn is_exhausted(&self) -> bool {
    self.used.load(Ordering::Relaxed) >= self.limit
  }
}

pub(crate) static ASSEMBLY_BUDGET: AssemblyBudget = AssemblyBudget::new(MAX_ASSEMBLY_BYTES);

// This is for the assembly of a single object
struct AssemblyBuffer {
  data_size: usize,
  fragment_size: u16, // must be constant for one sample
  chunks: Vec<Option<Box<[u8]>>>,
  allocated_bytes: usize,
  budget: &'static AssemblyBudget,
  fragment_count: usize,
  received_bitmap: BitVec,
  missing_count: usize,
  first_missing: usize, // all fragments before this are received

  modified_time: Timestamp,
}

impl Drop for AssemblyBuffer {
  fn drop(&mut self) {
    self
      .budget
      .used
      .fetch_sub(self.allocated_bytes, Ordering::Relaxed);
  }
}

impl AssemblyBuffer {
  pub fn new(datafrag: &DataFrag, budget: &'static AssemblyBudget) -> Option<Self> {
    let data_size: usize = datafrag.data_size.try_into().ok()?;
    let fragment_size: u16 = datafrag.fragment_size;
    debug!("new AssemblyBuffer data_size={data_size} frag_size={fragment_size}");

    if fragment_size == 0 || fragment_size as usize > data_size {
      error!("Cannot create AssemblyBuffer: fragment_size={fragment_size} data_size={data_size}");
      return None;
    }
    if data_size > MAX_SAMPLE_SIZE {
      error!("Cannot create AssemblyBuffer: data_size={data_size} limit={MAX_SAMPLE_SIZE}");
      return None;
    }

    let fragment_count = usize::from(datafrag.total_number_of_fragments());
    if fragment_count == 0 || fragment_count > MAX_FRAGMENTS_PER_SAMPLE {
      error!(
        "Cannot create AssemblyBuffer: fragment count {fragment_count} \
         limit={MAX_FRAGMENTS_PER_SAMPLE}"
      );
      return None;
    }

    let mut chunks = Vec::new();
    chunks.resize_with(data_size.div_ceil(CHUNK_SIZE), || None);

    // The tables count too: they are allocated by what the first DATAFRAG claims.
    let allocated_bytes =
      chunks.len() * std::mem::size_of::<Option<Box<[u8]>>>() + fragment_count.div_ceil(8);
    budget.used.fetch_add(allocated_bytes, Ordering::Relaxed);

    Some(Self {
      data_size,
      fragment_size,
      chunks,
      allocated_bytes,
      budget,
      fragment_count,
      received_bitmap: BitVec::from_elem(fragment_count, false),
      missing_count: fragment_count,
      first_missing: 0,
      modified_time: Timestamp::now(),
    })
  }

  // A Writer must not change sizes within a sample.
  // RTPS spec v2.5 Section 8.4.14.1.1 "How to select the fragment size"
  fn agrees_with(&self, datafrag: &DataFrag) -> bool {
    self.fragment_size == datafrag.fragment_size && self.data_size == datafrag.data_size as usize
  }

  /// Returns `false` if the fragment run is invalid or out of bounds.
  pub fn insert_frags(&mut self, datafrag: &DataFrag) -> bool {
    let frag_size = usize::from(self.fragment_size);
    let frags_in_submessage = usize::from(datafrag.fragments_in_submessage);
    if frags_in_submessage == 0 {
      error!("insert_frags: fragments_in_submessage is zero");
      return false;
    }
    let fragment_starting_num = usize::from(datafrag.fragment_starting_num);
    if fragment_starting_num < 1 {
      error!("insert_frags: fragment_starting_num is zero");
      return false;
    }
    let start_frag_from_0 = fragment_starting_num - 1;
    if start_frag_from_0 + frags_in_submessage > self.fragment_count {
      error!(
        "insert_frags: fragment span out of bounds: start={fragment_starting_num} \
         count={frags_in_submessage} total={}",
        self.fragment_count
      );
      return false;
    }

    // fragment_count is bounded, so this does not overflow
    let from_byte = start_frag_from_0 * frag_size;
    // Last fragment might be smaller than fragment size
    let to_before_byte = min(
      from_byte + frags_in_submessage * frag_size,
      self.data_size,
    );
    // The payload may be longer by padding, but never shorter: bytes that were
    // not sent must not be taken for received.
    let Some(payload) = datafrag
      .serialized_payload
      .get(..to_before_byte - from_byte)
    else {
      error!(
        "Received DATAFRAG too small. fragment_starting_num={} out of fragment_count={}, \
         frags_in_submessage={}, frag_size={} but payload length = {}. Original data_size={}",
        fragment_starting_num,
        self.fragment_count,
        frags_in_submessage,
        frag_size,
        datafrag.serialized_payload.len(),
        datafrag.data_size,
      );
      return false;
    };

    self.write(from_byte, payload);

    for f in start_frag_from_0..start_frag_from_0 + frags_in_submessage {
      if !self.received_bitmap.get(f).unwrap_or(true) {
        self.received_bitmap.set(f, true);
        self.missing_count -= 1;
      }
    }
    while self.received_bitmap.get(self.first_missing) == Some(true) {
      self.first_missing += 1;
    }
    self.modified_time = Timestamp::now();
    true
  }

  fn write(&mut self, mut at: usize, mut payload: &[u8]) {
    while !payload.is_empty() {
      let (chunk_idx, offset) = (at / CHUNK_SIZE, at % CHUNK_SIZE);
      let chunk_len = min(CHUNK_SIZE, self.data_size - chunk_idx * CHUNK_SIZE);
      let chunk = self.chunks[chunk_idx].get_or_insert_with(|| {
        self.allocated_bytes += chunk_len;
        self.budget.used.fetch_add(chunk_len, Ordering::Relaxed);
        vec![0; chunk_len].into_boxed_slice()
      });
      let len = min(payload.len(), chunk_len - offset);
      chunk[offset..offset + len].copy_from_slice(&payload[..len]);
      (at, payload) = (at + len, &payload[len..]);
    }
  }

  pub fn is_complete(&self) -> bool {
    self.missing_count == 0
  }

  // To be called only when complete, i.e. all chunks are there.
  fn into_bytes(mut self) -> Bytes {
    let mut bytes = BytesMut::with_capacity(self.data_size);
    for chunk in std::mem::take(&mut self.chunks).into_iter().flatten() {
      bytes.extend_from_slice(&chunk);
    }
    bytes.freeze()
  }
}

// Upper bound on the number of concurrent (incomplete) reassembly buffers kept
// per writer. Fragments belonging to one sample normally arrive back-to-back,
// so only a handful of samples are ever mid-reassembly at once; this cap is far
// above that. Its purpose is to bound memory when samples never complete, e.g.
// under best-effort overload where fragments are dropped: without it, one
// incomplete `AssemblyBuffer` (up to a sample-sized allocation) accrues per lost
// sample and is only reclaimed by a 10 s idle timeout, growing to gigabytes.
// When exceeded we evict the oldest (lowest sequence number) buffer, which
// under best effort is lost anyway and under reliable will be re-requested.
const MAX_ASSEMBLY_BUFFERS: usize = 128;

// Assembles fragments from a single (remote) Writer
// So there is only one sequence of SNs
pub(crate) struct FragmentAssembler {
  assembly_buffers: BTreeMap<SequenceNumber, AssemblyBuffer>,
  // Whether the owning reader is Reliable. This decides which buffer to drop
  // when a limit is exceeded (see `evict_over_limits`).
  reliable: bool,
  budget: &'static AssemblyBudget,
}

impl fmt::Debug for FragmentAssembler {
  fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    f.debug_struct("FragmentAssembler - fields omitted")
      // insert field printing here, if you really need it.
      .finish()
  }
}

impl FragmentAssembler {
  pub fn new(reliable: bool, budget: &'static AssemblyBudget) -> Self {
    debug!("new FragmentAssembler. reliable = {reliable}");
    Self {
      assembly_buffers: BTreeMap::new(),
      reliable,
      budget,
    }
  }

  // Returns completed DDSData, when complete, and disposes the assembly buffer.
  pub fn new_datafrag(
    &mut self,
    datafrag: &DataFrag,
    flags: BitFlags<DATAFRAG_Flags>,
  ) -> Option<DDSData> {
    let sn = datafrag.writer_sn;

    // Sizes that changed within a sample: what we had can't be completed any
    // more, so begin anew with what came last.
    if self
      .assembly_buffers
      .get(&sn)
      .is_some_and(|buffer| !buffer.agrees_with(datafrag))
    {
      warn!("new_datafrag: sizes of {sn:?} changed, beginning anew");
      self.assembly_buffers.remove(&sn);
    }

    let is_new = !self.assembly_buffers.contains_key(&sn);
    if is_new {
      let Some(mut buffer) = AssemblyBuffer::new(datafrag, self.budget) else {
        error!("new_datafrag: failed to create AssemblyBuffer for {sn:?}");
        return None;
      };
      if !buffer.insert_frags(datafrag) {
        error!("new_datafrag: rejected invalid DATAFRAG for {sn:?}");
        return None;
      }
      self.assembly_buffers.insert(sn, buffer);
    } else if let Some(buffer) = self.assembly_buffers.get_mut(&sn) {
      if !buffer.insert_frags(datafrag) {
        error!("new_datafrag: rejected invalid DATAFRAG for {sn:?}");
        return None;
      }
    }

    let complete = self
      .assembly_buffers
      .get(&sn)
      .is_some_and(AssemblyBuffer::is_complete);
    if !complete {
      debug!("new_dataFrag: FRAGMENT NOT COMPLETED YET");
      self.evict_over_limits();
      return None;
    }

    debug!("new_datafrag: COMPLETED FRAGMENT");
    let assembly_buffer = self.assembly_buffers.remove(&sn)?;
    // Return what we have assembled.
    let serialized_data_or_key = SerializedPayload::from_bytes(&assembly_buffer.into_bytes())
      .map_err(|e| error!("Deserializing SerializedPayload from DATAFRAG: {:?}", e))
      .ok()?;
    Some(if flags.contains(DATAFRAG_Flags::Key) {
      DDSData::new_disposed_by_key(ChangeKind::NotAliveDisposed, serialized_data_or_key)
    } else {
      // it is data
      DDSData::new(serialized_data_or_key)
    })
  }

  // Bound memory: never keep more than MAX_ASSEMBLY_BUFFERS incomplete
  // reassemblies, nor more than MAX_ASSEMBLY_BYTES_PER_WRITER in them. While all
  // Writers together hold more than the budget, each is left
  // ASSEMBLY_BYTES_ALWAYS_LEFT, so that no Writer can starve the small samples
  // of others.
  //
  // Which one to evict depends on reliability:
  //  * Reliable: the reader delivers strictly in order, so it must complete the
  //    LOWEST sequence number first; that buffer is exactly the one blocking
  //    progress. Dropping it would livelock, because a writer that bursts many
  //    large samples ahead (e.g. Connext) would make the reader perpetually evict
  //    the very sample it is waiting for. So evict the HIGHEST (newest) sequence
  //    number instead; the writer keeps unacked samples in its history and
  //    re-sends them once we catch up.
  //  * Best effort: there is no retransmission, so a low incomplete buffer is
  //    lost anyway. Evict the OLDEST (lowest SN) to free room for newer samples
  //    that may still complete.
  fn evict_over_limits(&mut self) {
    loop {
      let byte_limit = if self.budget.is_exhausted() {
        ASSEMBLY_BYTES_ALWAYS_LEFT
      } else {
        MAX_ASSEMBLY_BYTES_PER_WRITER
      };
      if self.assembly_buffers.len() <= MAX_ASSEMBLY_BUFFERS
        && self.allocated_bytes() <= byte_limit
      {
        return;
      }
      let evicted = if self.reliable {
        self.assembly_buffers.pop_last()
      } else {
        self.assembly_buffers.pop_first()
      };
      if evicted.is_none() {
        return;
      }
    }
  }

  fn allocated_bytes(&self) -> usize {
    self
      .assembly_buffers
      .values()
      .map(|buffer| buffer.allocated_bytes)
      .sum()
  }

  pub fn is_empty(&self) -> bool {
    self.assembly_buffers.is_empty()
  }

  pub fn garbage_collect_before(&mut self, expire_before: Timestamp) {
    self.assembly_buffers.retain(|sn, ab| {
      let retain = ab.modified_time >= expire_before;
      if !retain {
        info!("AssemblyBuffer dropping {sn:?}");
      }
      retain
    });
  }

  // pub fn partially_received_sequence_numbers_iterator(&self) -> Box<dyn
  // Iterator<Item=SequenceNumber>> {   // Since we should only know about SNs
  // via DATAFRAG messages   // and AssemblyBuffers are removed immediately on
  // completion,   // the list should be just the list of current
  // AssemblyBuffers   self.assembly_buffers.keys()
  // }

  pub fn is_partially_received(&self, sn: SequenceNumber) -> bool {
    self.assembly_buffers.contains_key(&sn)
    // assembly buffers map contains a key (SN) if and only if we have some
    // frags but not all
  }

  pub fn missing_frags_for(
    &self,
    seq: SequenceNumber,
  ) -> Box<dyn '_ + Iterator<Item = FragmentNumber>> {
    match self.assembly_buffers.get(&seq) {
      None => Box::new(iter::empty()),
      Some(ab) => {
        let iter = (ab.first_missing..ab.fragment_count)
          .filter(move |f| !ab.received_bitmap.get(*f).unwrap_or(true))
          .map(|f| FragmentNumber::new((f + 1).try_into().unwrap()));
        Box::new(iter)
      }
    }
  }
}

#[cfg(test)]
mod tests {
  use bytes::Bytes;

  use super::*;

  // Build a DATAFRAG submessage carrying the contiguous run of `k` fragments
  // starting at 1-based `start`, with the given payload bytes.
  fn datafrag(start: u32, k: u16, frag_size: u16, data_size: u32, payload: Vec<u8>) -> DataFrag {
    DataFrag {
      fragment_starting_num: FragmentNumber::new(start),
      fragments_in_submessage: k,
      fragment_size: frag_size,
      data_size,
      serialized_payload: Bytes::from(payload),
      ..Default::default()
    }
  }

  fn budget() -> &'static AssemblyBudget {
    Box::leak(Box::new(AssemblyBudget::new(MAX_ASSEMBLY_BYTES)))
  }

  fn no_flags() -> BitFlags<DATAFRAG_Flags> {
    BitFlags::empty()
  }

  // A DATAFRAG that packs K > 1 fragments in one submessage must reassemble the
  // same bytes as one-fragment-per-submessage would. This exercises the
  // adaptive-packing writer path against the (unchanged) receiver.
  #[test]
  fn reassemble_multi_fragment_datafrag() {
    let frag_size = 1024u16;
    let data_size = 2600u32; // 3 fragments: 1024, 1024, 552
    let whole: Vec<u8> = (0..data_size as usize).map(|i| (i % 251) as u8).collect();

    // First submessage packs fragments 1 and 2 (K = 2, 2048 payload bytes).
    let first = datafrag(1, 2, frag_size, data_size, whole[0..2048].to_vec());
    let mut ab = AssemblyBuffer::new(&first, budget()).expect("valid first fragment");
    assert!(!ab.is_complete());
    ab.insert_frags(&first);
    assert!(!ab.is_complete(), "still missing the tail fragment");

    // Trailing submessage carries the shorter final fragment 3 (552 bytes).
    let tail = datafrag(3, 1, frag_size, data_size, whole[2048..2600].to_vec());
    ab.insert_frags(&tail);
    assert!(ab.is_complete(), "all fragments received");
    assert_eq!(
      &ab.into_bytes()[..],
      &whole[..],
      "reassembled bytes must match the original sample"
    );
  }

  // A single DATAFRAG carrying the whole sample in one multi-fragment run.
  #[test]
  fn reassemble_single_submessage_all_fragments() {
    let frag_size = 512u16;
    let data_size = 1500u32; // 3 fragments: 512, 512, 476
    let whole: Vec<u8> = (0..data_size as usize).map(|i| (i % 97) as u8).collect();

    let all = datafrag(1, 3, frag_size, data_size, whole.clone());
    let mut ab = AssemblyBuffer::new(&all, budget()).expect("valid fragment set");
    ab.insert_frags(&all);
    assert!(ab.is_complete());
    assert_eq!(&ab.into_bytes()[..], &whole[..]);
  }

  // Malformed span (starting at last fragment but claiming multiple fragments)
  // must not panic and must not falsely complete reassembly.
  #[test]
  fn reject_fragment_span_beyond_total() {
    let frag_size = 256u16;
    let data_size = 512u32; // 2 fragments total
    let bad = datafrag(2, 2, frag_size, data_size, vec![0u8; 256]);
    let mut ab = AssemblyBuffer::new(&bad, budget()).expect("buffer for valid data_size");
    assert!(!ab.insert_frags(&bad));
    assert!(!ab.is_complete());
  }

  #[test]
  fn fragment_assembler_rejects_span_beyond_total() {
    let frag_size = 256u16;
    let data_size = 512u32;
    let bad = datafrag(2, 2, frag_size, data_size, vec![0u8; 256]);
    let mut fa = FragmentAssembler::new(true, budget());
    assert!(fa
      .new_datafrag(&bad, BitFlags::<DATAFRAG_Flags>::empty())
      .is_none());
  }

  // One small datagram claims 4 GB, or as much as is allowed: neither is
  // allocated.
  #[test]
  fn claimed_sample_size_is_not_allocated() {
    let budget = budget();
    let mut fa = FragmentAssembler::new(true, budget);
    let too_large = datafrag(1, 1, 900, u32::MAX, vec![0; 900]);
    assert!(fa.new_datafrag(&too_large, no_flags()).is_none());
    assert!(fa.is_empty());

    let largest = datafrag(1, 1, 900, MAX_SAMPLE_SIZE as u32, vec![0; 900]);
    assert!(fa.new_datafrag(&largest, no_flags()).is_none());
    assert!(fa.allocated_bytes() < 1024 * 1024);
    assert_eq!(budget.used.load(Ordering::Relaxed), fa.allocated_bytes());

    let last = datafrag(
      (MAX_SAMPLE_SIZE as u32).div_ceil(900),
      1,
      900,
      MAX_SAMPLE_SIZE as u32,
      vec![0; 900],
    );
    assert!(fa.new_datafrag(&last, no_flags()).is_none());
    assert!(fa.allocated_bytes() < 1024 * 1024);
    drop(fa);
    assert_eq!(budget.used.load(Ordering::Relaxed), 0);
  }

  #[test]
  fn too_many_fragments_are_refused() {
    let mut fa = FragmentAssembler::new(true, budget());
    let bytes = datafrag(1, 1, 1, MAX_FRAGMENTS_PER_SAMPLE as u32 + 1, vec![0; 1]);
    assert!(fa.new_datafrag(&bytes, no_flags()).is_none());
    assert!(fa.is_empty());
  }

  // An image of 64 MB, as RustDDS itself sends it.
  #[test]
  fn large_sample_is_assembled() {
    let frag_size = crate::rtps::constant::FRAGMENT_SIZE as u16;
    let data_size = 64 * 1024 * 1024u32;
    let per_submessage = 128u16;
    let mut fa = FragmentAssembler::new(true, budget());
    let total = data_size / u32::from(frag_size);
    let mut done = None;
    for start in (1..=total).step_by(per_submessage.into()) {
      assert!(done.is_none());
      let payload = vec![(start % 251) as u8; usize::from(per_submessage) * usize::from(frag_size)];
      let part = datafrag(start, per_submessage, frag_size, data_size, payload);
      done = fa.new_datafrag(&part, no_flags());
    }
    assert_eq!(done.unwrap().payload_size(), data_size as usize);
    assert!(fa.is_empty());
  }

  // A fragment that is shorter than it must be leaves no zeros in the sample.
  #[test]
  fn short_fragment_does_not_count_as_received() {
    let (frag_size, data_size) = (256u16, 700u32);
    let whole: Vec<u8> = (0..data_size).map(|i| (i % 97) as u8).collect();
    let mut fa = FragmentAssembler::new(false, budget());
    for short in [
      datafrag(1, 1, frag_size, data_size, whole[..255].to_vec()),
      datafrag(3, 1, frag_size, data_size, whole[512..600].to_vec()),
      datafrag(0, 1, frag_size, data_size, whole[..256].to_vec()),
      datafrag(1, 0, frag_size, data_size, whole[..256].to_vec()),
      datafrag(u32::MAX, 1, frag_size, data_size, whole[..256].to_vec()),
    ] {
      assert!(fa.new_datafrag(&short, no_flags()).is_none());
    }
    for (start, range) in [(1, 0..256), (2, 256..512)] {
      let part = datafrag(start, 1, frag_size, data_size, whole[range].to_vec());
      assert!(fa.new_datafrag(&part, no_flags()).is_none());
    }
    let padded = [&whole[512..], &[0xCC; 3]].concat();
    let done = fa.new_datafrag(&datafrag(3, 1, frag_size, data_size, padded), no_flags());
    assert_eq!(done.unwrap().bytes_slice(4, 700), whole[4..]);
  }

  // Sizes that change within a sample neither mix samples nor block the number.
  #[test]
  fn changed_sizes_begin_anew() {
    let mut fa = FragmentAssembler::new(true, budget());
    let strange = datafrag(1, 1, 100, 100_000, vec![9; 100]);
    assert!(fa.new_datafrag(&strange, no_flags()).is_none());
    let whole = vec![1u8; 500];
    let first = datafrag(1, 1, 256, 500, whole[..256].to_vec());
    let second = datafrag(2, 1, 256, 500, whole[256..].to_vec());
    assert!(fa.new_datafrag(&first, no_flags()).is_none());
    let done = fa.new_datafrag(&second, no_flags());
    assert_eq!(done.unwrap().bytes_slice(4, 500), whole[4..]);
  }

  // A Writer that never completes its samples stays within its limit, and when
  // all is used up, small samples of others still get through.
  #[test]
  fn assembling_bytes_are_bounded() {
    let budget: &'static AssemblyBudget =
      Box::leak(Box::new(AssemblyBudget::new(4 * 1024 * 1024)));
    let payload = vec![0u8; 60_000];
    let fill = |fa: &mut FragmentAssembler| {
      for sn in 1..200 {
        let mut part = datafrag(1, 1, 60_000, 120_000, payload.clone());
        part.writer_sn = SequenceNumber::new(sn);
        assert!(fa.new_datafrag(&part, no_flags()).is_none());
      }
    };
    let mut hostile = [
      FragmentAssembler::new(true, budget),
      FragmentAssembler::new(false, budget),
    ];
    hostile.iter_mut().for_each(fill);
    let used = budget.used.load(Ordering::Relaxed);
    let allowed = 4 * 1024 * 1024 + 2 * ASSEMBLY_BYTES_ALWAYS_LEFT;
    assert!(used <= allowed, "{used} bytes");

    let mut other = FragmentAssembler::new(true, budget);
    let first = datafrag(1, 1, 60_000, 120_000, payload.clone());
    let second = datafrag(2, 1, 60_000, 120_000, payload.clone());
    assert!(other.new_datafrag(&first, no_flags()).is_none());
    assert!(other.new_datafrag(&second, no_flags()).is_some());
  }
}
