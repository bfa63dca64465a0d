//! Bags, from bytes of a file to estimates.

use std::io::{Read as _, Write as _};
use std::sync::OnceLock;

use tactile_pose_fusion::bag::{
    BagAttachment, BagMetadata, BagReader, BagRecord, BagStats, BagWriter, Compression, Input, InputTopics, Inputs,
    PassThrough, WriteOptions,
};
use tactile_pose_fusion::config::{Config, DEFAULT_NODE, parse_param_file};
use tactile_pose_fusion::msg::*;

use super::common::bags::{Bag, at};
use super::common::fake::{self, Sum};
use super::driver::{Answer, Target, file_of};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "bag", seeds, mutate: other, run, min_understood: 0.3 };

const PARAMS: &str = "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    truth_sources: [load_cell]
    tactile.glove: {topic: /taxels, n_taxels: 2}
    joint.hand: {topic: /joints}
    truth.load_cell: {topic: /truth}
    model.tip: {path: model.onnx}
    region.index: {model: tip, joints: [dip], frame_id: index_tip}
";

fn topics() -> InputTopics {
    static CONFIG: OnceLock<Config> = OnceLock::new();
    let cfg = CONFIG
        .get_or_init(|| Config::from_tree(&parse_param_file(PARAMS, "params.yaml", DEFAULT_NODE).unwrap()).unwrap());
    InputTopics {
        taxels: cfg.tactile().to_vec(),
        joints: cfg.joints().to_vec(),
        truth: cfg.truth().to_vec(),
        joint_sources: cfg.fusion().joint_sources().to_vec(),
        needed: cfg.needed_joints(),
        stage: cfg.stage_topic.clone(),
        told: None,
        message_definitions: None,
    }
}

pub fn seeds() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let whole = [Compression::None, Compression::Lz4, Compression::Zstd].map(|compression| {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        let options = WriteOptions { compression, overwrite: true, ..WriteOptions::default() };
        let mut bag = Bag::of(BagWriter::create(&path, options).unwrap());
        for k in 0..12 {
            bag.taxels(at(10 * k), &[k as f32, 1.0]);
            bag.joints(at(10 * k + 3), &["dip", "pip"], &[0.1, 0.2]);
            let header = Header { stamp: at(10 * k).into(), frame_id: String::new() };
            bag.send("/truth", at(10 * k), &WrenchStamped { header: header.clone(), ..Default::default() });
            bag.send("/stage", at(10 * k), &Stage { header, zero_load: k < 6, ..Stage::default() });
        }
        let data = b"png".as_slice();
        let photo = BagAttachment { log_time: 1, create_time: 2, name: "photo", media_type: "image/png", data };
        bag.writer.copy_attachment(&photo).unwrap();
        let metadata = [("user".to_owned(), "anna".to_owned())].into();
        bag.writer.copy_metadata(&BagMetadata { name: "rig", metadata: &metadata }).unwrap();
        bag.finish();
        std::fs::read(&path).unwrap()
    });
    // As a recorder leaves it that was killed.
    let cut = whole[0][..whole[0].len() * 2 / 3].to_vec();
    whole.into_iter().chain([cut]).collect()
}

pub fn run(input: &[u8]) -> Answer {
    let path = file_of("fuzzed.mcap", input);
    let mut reader = match BagReader::open(std::slice::from_ref(&path)) {
        Ok(reader) => reader,
        Err(error) => return super::one_line(&error),
    };
    let (mut n_messages, mut n_others, mut stats) = (0u64, 0u64, BagStats::default());
    let ended = loop {
        match reader.next_record() {
            Ok(Some(BagRecord::Message(message))) => {
                n_messages += 1;
                assert!(message.data.len() <= 64 << 20, "a message of {} bytes", message.data.len());
                stats.handle_message(&message);
            }
            Ok(Some(_)) => n_others += 1,
            Ok(None) => break None,
            Err(error) => break Some(error.to_string()),
        }
    };
    assert_eq!(stats.topics().iter().map(|topic| topic.n_messages).sum::<u64>(), n_messages);
    let losses: Vec<String> = reader.losses().iter().map(ToString::to_string).collect();
    assert!(losses.len() < 1000);
    for loss in &losses {
        super::one_line(loss);
    }
    copy(&path, n_messages);
    let estimated = estimate(&path);
    if n_messages == 0 {
        return Answer::refused(&ended.unwrap_or_else(|| losses.first().cloned().unwrap_or_default()));
    }
    let kinds: Vec<String> =
        losses.iter().map(|loss| loss.chars().filter(char::is_ascii_alphabetic).collect()).collect();
    Answer::understood(&(n_messages.min(8), n_others.min(4), kinds, ended, estimated))
}

/// What could be read is copied whole, as `--merge` does, and reads back without a loss.
fn copy(path: &std::path::Path, n_messages: u64) {
    let Ok(mut reader) = BagReader::open(&[path.to_owned()]) else { return };
    let out = file_of("copy.mcap", b"");
    let options = WriteOptions { overwrite: true, compression: Compression::None, ..WriteOptions::default() };
    let mut writer = BagWriter::create(&out, options).unwrap();
    let mut pass_through = PassThrough::default();
    while let Ok(Some(record)) = reader.next_record() {
        if let Err(error) = pass_through.copy(&record, &mut writer) {
            super::one_line(&error);
            return;
        }
    }
    writer.finish().unwrap();
    let mut copied = BagReader::open(&[out]).unwrap();
    let mut n_copied = 0;
    while copied.next_message().unwrap().is_some() {
        n_copied += 1;
    }
    assert_eq!((n_copied, copied.losses()), (n_messages, &[][..]));
}

/// The way of a replay, with a model whose sums can't fail; what stopped it.
fn estimate(path: &std::path::Path) -> Option<String> {
    let stopped = |error: &dyn std::fmt::Display| {
        super::one_line(error);
        Some(error.to_string().chars().filter(char::is_ascii_alphabetic).take(40).collect())
    };
    let mut reader = match BagReader::open(&[path.to_owned()]) {
        Ok(reader) => reader,
        Err(error) => return stopped(&error),
    };
    let mut inputs = match Inputs::new(topics(), &mut reader) {
        Ok(inputs) => inputs,
        Err(error) => return stopped(&error),
    };
    let mut core =
        fake::fusion(fake::config(2, vec![fake::region("index", &[0, 1], &["dip"])]), vec![Sum::boxed(3, 2, 1)]);
    let mut n_estimates = 0;
    loop {
        let message = match reader.next_message() {
            Ok(Some(message)) => message,
            Ok(None) => break,
            Err(error) => return stopped(&error),
        };
        let parts = match inputs.parts(message.channel) {
            Ok(parts) => parts,
            Err(error) => return stopped(&error),
        };
        for part in parts {
            if let Input::Event(event) = inputs.decode(&message, part) {
                core.handle(event).unwrap();
            }
        }
        n_estimates += super::core::drain(&mut core);
    }
    core.handle_end();
    n_estimates += super::core::drain(&mut core);
    super::core::check_counters(&core, n_estimates);
    if let Err(error) = inputs.check_end(core.missing_joints()) {
        return stopped(&error);
    }
    None
}

/// A piece of a bag: a record, or a chunk with the records in it.
#[derive(Clone)]
enum Piece {
    Record(u8, Vec<u8>),
    Chunk(Vec<(u8, Vec<u8>)>),
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut pieces = pieces(seed);
    if pieces.is_empty() || random.percent(8) {
        let mut input = seed.to_vec();
        mutate::bytes(random, &mut input, other);
        return input;
    }
    for _ in 0..1 + random.below(3) {
        change(random, &mut pieces, other);
    }
    pack(random, &pieces)
}

fn change(random: &mut Random, pieces: &mut Vec<Piece>, other: &[u8]) {
    if pieces.is_empty() {
        return;
    }
    let at = random.below(pieces.len());
    match random.below(8) {
        0 => drop(pieces.remove(at)),
        1 => pieces.insert(at, pieces[at].clone()),
        2 => {
            let with = random.below(pieces.len());
            pieces.swap(at, with);
        }
        _ => match &mut pieces[at] {
            Piece::Record(opcode, body) => change_record(random, opcode, body, other),
            Piece::Chunk(records) if !records.is_empty() => {
                let inner = random.below(records.len());
                match random.below(8) {
                    0 => drop(records.remove(inner)),
                    1 => records.insert(inner, records[inner].clone()),
                    2 => {
                        let with = random.below(records.len());
                        records.swap(inner, with);
                    }
                    _ => {
                        let (opcode, body) = &mut records[inner];
                        change_record(random, opcode, body, other);
                    }
                }
            }
            Piece::Chunk(records) => records.push((random.byte(), random.bytes(20))),
        },
    }
}

fn change_record(random: &mut Random, opcode: &mut u8, body: &mut Vec<u8>, other: &[u8]) {
    if random.percent(5) {
        *opcode = random.byte() % 20;
    }
    if *opcode == 5 && body.len() > 22 && random.percent(70) {
        // Of a message, its stamp and data, so that it still belongs to a channel.
        let mut data = body.split_off(22);
        mutate::bytes(random, &mut data, other);
        body.extend(data);
        return;
    }
    mutate::bytes(random, body, other);
}

fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?) as usize)
}

/// Records as far as they are whole.
fn records(mut bytes: &[u8]) -> Vec<(u8, Vec<u8>)> {
    let mut records = Vec::new();
    while let (Some(opcode), Some(len)) = (bytes.first(), bytes.get(1..9)) {
        let len = u64::from_le_bytes(len.try_into().unwrap()) as usize;
        let Some(body) = len.checked_add(9).and_then(|end| bytes.get(9..end)) else { break };
        records.push((*opcode, body.to_vec()));
        bytes = &bytes[9 + len..];
    }
    records
}

fn pieces(bytes: &[u8]) -> Vec<Piece> {
    let records = records(bytes.strip_prefix(mcap::MAGIC).unwrap_or_default());
    records.into_iter().map(|(opcode, body)| chunk_of(opcode, &body).unwrap_or(Piece::Record(opcode, body))).collect()
}

fn chunk_of(opcode: u8, body: &[u8]) -> Option<Piece> {
    if opcode != 6 {
        return None;
    }
    let name_len = u32_at(body, 28)?;
    let name = body.get(32..name_len.checked_add(32)?)?;
    let packed = body.get(32 + name_len + 8..)?;
    let limit = 1 << 20;
    let mut unpacked = Vec::new();
    match name {
        b"" => unpacked = packed.to_vec(),
        b"zstd" => drop(zstd::stream::read::Decoder::new(packed).ok()?.take(limit).read_to_end(&mut unpacked).ok()?),
        b"lz4" => drop(lz4::Decoder::new(packed).ok()?.take(limit).read_to_end(&mut unpacked).ok()?),
        _ => return None,
    }
    Some(Piece::Chunk(records(&unpacked)))
}

/// Puts pieces together again, chunks packed anew with lengths and checksums that fit; a few lie.
fn pack(random: &mut Random, pieces: &[Piece]) -> Vec<u8> {
    let mut bytes = mcap::MAGIC.to_vec();
    for piece in pieces {
        match piece {
            Piece::Record(opcode, body) => put_record(random, &mut bytes, *opcode, body),
            Piece::Chunk(records) => {
                let mut inner = Vec::new();
                records.iter().for_each(|(opcode, body)| put_record(random, &mut inner, *opcode, body));
                let body = packed_chunk(random, &inner);
                put_record(random, &mut bytes, 6, &body);
            }
        }
    }
    bytes.extend(mcap::MAGIC);
    if random.percent(10) {
        bytes.truncate(random.below(bytes.len()));
    }
    bytes
}

fn put_record(random: &mut Random, out: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    let len = if random.below(400) == 0 { random.number() } else { body.len() as u64 };
    out.push(opcode);
    out.extend(len.to_le_bytes());
    out.extend(body);
}

fn packed_chunk(random: &mut Random, inner: &[u8]) -> Vec<u8> {
    let (name, packed) = match random.below(3) {
        0 => ("", inner.to_vec()),
        1 => {
            let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
            encoder.write_all(inner).unwrap();
            ("lz4", encoder.finish().0)
        }
        _ => ("zstd", zstd::stream::encode_all(inner, 1).unwrap()),
    };
    let crc = if random.percent(3) { random.number() as u32 } else { crc32fast::hash(inner) };
    let unpacked = if random.percent(2) { random.number() } else { inner.len() as u64 };
    let mut body = vec![0; 16];
    body.extend(unpacked.to_le_bytes());
    body.extend(crc.to_le_bytes());
    body.extend((name.len() as u32).to_le_bytes());
    body.extend(name.as_bytes());
    let mut packed = packed;
    if random.percent(4) {
        mutate::bytes(random, &mut packed, inner);
    }
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    body
}
