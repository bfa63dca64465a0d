//! What is read from the network, as functions of bytes. For fuzzing, here and in
//! packages that carry this one; no part of the API.

use bytes::Bytes;
use enumflags2::BitFlags;

use crate::{
  discovery::{
    sedp_messages::{DiscoveredReaderData, DiscoveredTopicData, DiscoveredWriterData},
    spdp_participant_data::SpdpDiscoveredParticipantData,
  },
  messages::submessages::submessages::{ReaderSubmessage, WriterSubmessage},
  rtps::{
    fragment_assembler::{FragmentAssembler, ASSEMBLY_BUDGET},
    rtps_writer_proxy::RtpsWriterProxy,
    Message, SubmessageBody,
  },
  serialization::pl_cdr_adapters::PlCdrDeserialize,
  structure::{
    guid::{EntityId, GuidPrefix, GUID},
    sequence_number::SequenceNumber,
    time::Timestamp,
  },
  RepresentationIdentifier,
};

/// Reads an RTPS message, and does with its numbers what a reliable reader does
/// that has matched the writers of all its submessages.
///
/// Returns the number of its submessages.
///
/// # Errors
/// What is wrong with the message.
pub fn rtps_message(bytes: &[u8]) -> Result<usize, String> {
  let message =
    Message::read_from_buffer(&Bytes::copy_from_slice(bytes)).map_err(|e| e.to_string())?;
  let mut assembler = FragmentAssembler::new(true, &ASSEMBLY_BUDGET);
  let mut writer = RtpsWriterProxy::new(
    GUID::new(GuidPrefix::UNKNOWN, EntityId::UNKNOWN),
    vec![],
    vec![],
    EntityId::UNKNOWN,
  );
  for submessage in &message.submessages {
    match &submessage.body {
      SubmessageBody::Writer(submessage) if submessage.has_plausible_numbers() => {
        hear(submessage, &mut writer, &mut assembler);
      }
      SubmessageBody::Reader(ReaderSubmessage::AckNack(acknack, _)) => {
        assert!(acknack.reader_sn_state.iter().count() <= 256);
      }
      SubmessageBody::Reader(ReaderSubmessage::NackFrag(nackfrag, _)) => {
        assert!(nackfrag.fragment_number_state.iter().count() <= 256);
      }
      _ => {}
    }
  }
  Ok(message.submessages.len())
}

fn hear(
  submessage: &WriterSubmessage,
  writer: &mut RtpsWriterProxy,
  assembler: &mut FragmentAssembler,
) {
  match submessage {
    WriterSubmessage::Data(data, _) => {
      writer.received_changes_add(data.writer_sn, Timestamp::INVALID);
    }
    WriterSubmessage::DataFrag(datafrag, _) => {
      assembler.new_datafrag(datafrag, BitFlags::empty());
      assembler.missing_frags_for(datafrag.writer_sn).next();
    }
    WriterSubmessage::Gap(gap, _) => {
      writer.irrelevant_changes_range(gap.gap_start, gap.gap_list.base());
      for sn in gap.gap_list.iter() {
        writer.set_irrelevant_change(sn);
      }
    }
    WriterSubmessage::Heartbeat(heartbeat, _) => {
      writer.irrelevant_changes_up_to(heartbeat.first_sn);
      writer.heartbeat_contradiction(heartbeat.last_sn, std::time::Instant::now());
      let missing = writer.missing_seqnums(heartbeat.first_sn, heartbeat.last_sn);
      assert!(missing.len() <= 256);
    }
    WriterSubmessage::HeartbeatFrag(..) => {}
  }
  assert!(writer.all_ackable_before() >= SequenceNumber::new(1));
}

/// Reads a parameter list as each of the things that Discovery says.
///
/// Returns as what it was understood, a bit for each.
///
/// # Errors
/// What is wrong with it, as a participant, where it was understood as nothing.
pub fn discovery(bytes: &[u8], little_endian: bool) -> Result<u8, String> {
  let encoding = if little_endian {
    RepresentationIdentifier::PL_CDR_LE
  } else {
    RepresentationIdentifier::PL_CDR_BE
  };
  let participant = SpdpDiscoveredParticipantData::from_pl_cdr_bytes(bytes, encoding);
  let reader = DiscoveredReaderData::from_pl_cdr_bytes(bytes, encoding);
  let writer = DiscoveredWriterData::from_pl_cdr_bytes(bytes, encoding);
  let topic = DiscoveredTopicData::from_pl_cdr_bytes(bytes, encoding);
  let understood = u8::from(participant.is_ok())
    | u8::from(reader.is_ok_and(|reader| reader.kept_bytes() > 0)) << 1
    | u8::from(writer.is_ok_and(|writer| writer.kept_bytes() > 0)) << 2
    | u8::from(topic.is_ok()) << 3;
  match participant {
    Err(error) if understood == 0 => Err(format!("{error:?}")),
    _ => Ok(understood),
  }
}
