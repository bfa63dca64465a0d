//! Packets of the network, and what discovery says in them, as RustDDS reads them.

use ros2_client::dds::rustdds::fuzzing;

use super::driver::{Answer, Target};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "rtps", seeds, mutate: other, run, min_understood: 0.2 };

/// What an input is, by its first byte.
const MESSAGE: u8 = 0;
const DISCOVERY: u8 = 1;

fn seeds() -> Vec<Vec<u8>> {
    let writer = [0, 0, 1, 3];
    let ids = [[0; 4], writer].concat();
    let number = |n: u32| [0u32.to_le_bytes(), n.to_le_bytes()].concat();
    let set = |base: Vec<u8>| [base, 40u32.to_le_bytes().to_vec(), vec![0xff; 8]].concat();
    let count = 7u32.to_le_bytes().to_vec();
    let data_head = [&[0, 0, 16, 0], &ids[..], &number(3)].concat();
    let frag_head = [&[0, 0, 28, 0], &ids[..], &number(4), &[2, 0, 0, 0, 1, 0, 16, 0, 40, 0, 0, 0]].concat();
    let inline_qos = [0x70, 0, 16, 0].into_iter().chain([1; 16]).chain([1, 0, 0, 0]).collect::<Vec<u8>>();
    let locator = [1i32.to_le_bytes(), 7410i32.to_le_bytes(), [0; 4], [0; 4], [0; 4], [127, 0, 0, 1]].concat();
    let submessages = [
        submessage(0x15, 0x05, &[&data_head[..], &[0, 1, 0, 0, 1, 2, 3, 4]].concat()),
        submessage(0x15, 0x0b, &[&data_head[..], &inline_qos, &[0, 1, 0, 0, 1, 2, 3, 4]].concat()),
        submessage(0x16, 0x01, &[&frag_head[..], &[5; 16]].concat()),
        submessage(0x07, 0x01, &[&ids[..], &number(1), &number(9), &count].concat()),
        submessage(0x13, 0x01, &[&ids[..], &number(1), &count, &count].concat()),
        submessage(0x08, 0x01, &[&ids[..], &number(2), &set(number(5))].concat()),
        submessage(0x06, 0x01, &[&ids[..], &set(number(5)), &count].concat()),
        submessage(0x12, 0x01, &[&ids[..], &number(5), &set(count.clone()), &count].concat()),
        submessage(0x09, 0x01, &[1; 8]),
        submessage(0x0c, 0x01, &[2; 20]),
        submessage(0x0e, 0x01, &[3; 12]),
        submessage(0x0f, 0x01, &[&1u32.to_le_bytes()[..], &locator].concat()),
        submessage(0x01, 0x01, &[0; 4]),
        submessage(0x31, 0x01, &[4; 20]),
    ];
    let header = [&b"RTPS\x02\x03\x01\x12"[..], &[9; 12]].concat();
    let message = |parts: &[Vec<u8>]| [vec![MESSAGE], header.clone(), parts.concat()].concat();
    let mut seeds: Vec<Vec<u8>> = submessages.iter().map(|part| message(std::slice::from_ref(part))).collect();
    seeds.push(message(&submessages));

    let guid = [&[9; 12][..], &[0, 0, 1, 0xc1]].concat();
    let parameter = |pid: u16, value: &[u8]| {
        let length = u16::try_from(value.len()).unwrap();
        [&pid.to_le_bytes()[..], &length.to_le_bytes(), value].concat()
    };
    let text = |text: &str| [&(text.len() as u32 + 1).to_le_bytes()[..], text.as_bytes(), &[0]].concat();
    let participant = [
        parameter(0x15, &[2, 3, 0, 0]),
        parameter(0x16, &[1, 0x12, 0, 0]),
        parameter(0x50, &guid),
        parameter(0x32, &locator),
        parameter(0x31, &locator),
        parameter(0x02, &[20, 0, 0, 0, 0, 0, 0, 0]),
        parameter(0x58, &[0xff, 0x0f, 0, 0]),
        parameter(0x62, &text("abc")),
    ];
    let endpoint = [
        parameter(0x5a, &[&[9; 12][..], &[0, 0, 1, 3]].concat()),
        parameter(0x50, &guid),
        parameter(0x05, &text("topic42")),
        parameter(0x07, &text("type123")),
        parameter(0x1a, &[2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
        parameter(0x1d, &[1, 0, 0, 0]),
        parameter(0x2f, &locator),
        parameter(0x2c, &[4, 0, 0, 0, 1, 2, 3, 4]),
    ];
    let list = |parts: &[Vec<u8>]| [vec![DISCOVERY, 1], parts.concat(), vec![1, 0, 0, 0]].concat();
    seeds.extend([list(&participant), list(&endpoint)]);
    seeds
}

fn submessage(kind: u8, flags: u8, body: &[u8]) -> Vec<u8> {
    [&[kind, flags], &(body.len() as u16).to_le_bytes()[..], body].concat()
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut input = seed.to_vec();
    let first = input.first().copied().unwrap_or_default();
    mutate::bytes(random, &mut input, other);
    // Most often of the same kind, so that its bytes fit.
    if let (true, Some(kind)) = (random.percent(95), input.first_mut()) {
        *kind = first;
    }
    input
}

fn run(input: &[u8]) -> Answer {
    match input.split_first() {
        Some((&MESSAGE, message)) => match fuzzing::rtps_message(message) {
            Ok(n_submessages) => Answer::understood(&(MESSAGE, n_submessages.min(64))),
            Err(error) => Answer::refused(&error),
        },
        Some((_, [order, list @ ..])) => match fuzzing::discovery(list, order & 1 == 1) {
            Ok(as_what) => Answer::understood(&(DISCOVERY, as_what)),
            Err(error) => Answer::refused(&error),
        },
        _ => Answer::refused("empty"),
    }
}
