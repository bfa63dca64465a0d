//! Informs Fast DDS that a participant is gone.
//!
//! RustDDS disposes of its participant with the key in the payload. Fast DDS reads keys of builtin topics from the inline
//! QoS only (`PID_KEY_HASH`), so there the participant and all its entities would stay until the lease expires, a
//! minute or more. This sends the same message again in the form that Fast DDS reads.
//!
//! # Source
//! RTPS 2.5: 8.3.5 header, 9.4.5.4 Data, 9.6.2.3 ports, 9.6.4.3 status info, 9.6.4.8 key hash.

use std::net::{Ipv4Addr, UdpSocket};

/// The address where every participant of a domain receives discovery messages.
const MULTICAST: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

/// Number of processes on this host that are informed one by one, as discovery does without multicast.
const LOCAL_PARTICIPANTS: u16 = 32;

/// Higher than any sequence number a participant has sent: a reader accepts only numbers above the last it received.
const SEQUENCE_NUMBERS: [u32; 2] = [0x4000_0000, 0x4000_0001];

/// Announces that the participant of this GUID has left a domain. If the network refuses, its lease expires as before.
pub(super) fn send(guid: [u8; 16], domain_id: u16) {
    let first_port = 7400 + 250 * domain_id;
    for (sequence_number, from) in
        SEQUENCE_NUMBERS.iter().flat_map(|n| [(n, Ipv4Addr::UNSPECIFIED), (n, Ipv4Addr::LOCALHOST)])
    {
        let message = disposal(guid, *sequence_number);
        let Ok(socket) = UdpSocket::bind((from, 0)) else { continue };
        let _ = socket.send_to(&message, (MULTICAST, first_port));
        if from == Ipv4Addr::LOCALHOST {
            for participant in 0..LOCAL_PARTICIPANTS {
                let _ = socket.send_to(&message, (Ipv4Addr::LOCALHOST, first_port + 10 + 2 * participant));
            }
        }
    }
}

/// An RTPS message in which the builtin participant writer disposes of its participant.
fn disposal(guid: [u8; 16], sequence_number: u32) -> Vec<u8> {
    let mut message = b"RTPS\x02\x03\x01\x12".to_vec(); // version 2.3, vendor RustDDS
    message.extend_from_slice(&guid[..12]);
    let mut body = Vec::new();
    body.extend_from_slice(&[0, 0, 16, 0]); // no extra flags; inline QoS begins 16 bytes on
    body.extend_from_slice(&[0, 0, 0, 0]); // to whichever reader it concerns
    body.extend_from_slice(&[0, 1, 0, 0xc2]); // from the builtin participant writer
    body.extend_from_slice(&0_i32.to_le_bytes());
    body.extend_from_slice(&sequence_number.to_le_bytes());
    body.extend_from_slice(&[0x71, 0, 4, 0, 0, 0, 0, 3]); // status info: disposed and unregistered
    body.extend_from_slice(&[0x70, 0, 16, 0]); // key hash
    body.extend_from_slice(&guid);
    body.extend_from_slice(&[1, 0, 0, 0]); // end of the inline QoS
    message.extend_from_slice(&[0x15, 0b011]); // Data: little-endian, with inline QoS, without payload
    message.extend_from_slice(&(body.len() as u16).to_le_bytes());
    message.extend_from_slice(&body);
    message
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_names_the_participant_in_its_header_and_in_its_key() {
        let guid: [u8; 16] = std::array::from_fn(|idx| idx as u8);
        let message = disposal(guid, 7);
        assert_eq!(message[8..20], guid[..12]);
        assert_eq!(usize::from(message[22]) + 24, message.len(), "the length of the one submessage");
        assert_eq!(message[message.len() - 20..message.len() - 4], guid);
        assert_eq!(message.len() % 4, 0);
    }
}
