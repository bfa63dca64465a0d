//! Of a bag that isn't here, only the chunks with wanted topics are read: what comes is what a local read gives of these topics.

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;

use tactile_pose_fusion::bag::{BagReader, BagRecord};

use crate::common;
use crate::web::serve;

type Writer = mcap::Writer<Cursor<Vec<u8>>>;

/// A message, named notes or an attachment: topic or name, log time and bytes.
type Seen = (String, i64, Vec<u8>);

/// What is wanted: messages of some topics, and all notes. Also the losses that were said.
fn wanted(mut reader: BagReader, topics: &BTreeSet<String>) -> (Vec<Seen>, Vec<String>) {
    let mut seen = Vec::new();
    while let Some(record) = reader.next_record().unwrap() {
        match record {
            BagRecord::Message(message) if topics.contains(&message.channel.topic) => {
                seen.push((message.channel.topic.clone(), message.log_time.0, message.data.to_vec()));
            }
            BagRecord::Metadata(notes) => seen.push((notes.name.to_owned(), 0, Vec::new())),
            BagRecord::Message(_) | BagRecord::Attachment(_) => {}
        }
    }
    let losses = reader.losses().iter().map(|loss| loss.what.clone()).collect();
    (seen, losses)
}

/// A bag of a test, as its writer is told what to write.
struct Sketch {
    writer: Writer,
    n: u32,
}

impl Sketch {
    fn new(options: mcap::WriteOptions) -> Sketch {
        let writer = options.chunk_size(None).compression_threads(0).create(Cursor::new(Vec::new())).unwrap();
        Sketch { writer, n: 0 }
    }

    /// Messages of a topic, one a nanosecond from a time on. Each is different.
    fn send(&mut self, topic: &str, from: u64, count: u64) {
        let channel_id = self.writer.add_channel(0, topic, "cdr", &Default::default()).unwrap();
        for log_time in from..from + count {
            self.n += 1;
            let header =
                mcap::records::MessageHeader { channel_id, sequence: self.n, log_time, publish_time: log_time };
            let data = [&[0, 1, 0, 0][..], &self.n.to_le_bytes(), &[7; 3000]].concat();
            self.writer.write_to_known_channel(&header, &data).unwrap();
        }
    }

    fn end_chunk(&mut self) {
        self.writer.flush().unwrap();
    }

    fn notes(&mut self, name: &str) {
        let metadata = [("key".to_owned(), "x".repeat(5000))].into();
        self.writer.write_metadata(&mcap::records::Metadata { name: name.to_owned(), metadata }).unwrap();
    }

    fn attach(&mut self) {
        let (name, media_type) = ("photo".to_owned(), "image/png".to_owned());
        let data = vec![9; 300_000].into();
        self.writer.attach(&mcap::Attachment { log_time: 1, create_time: 1, name, media_type, data }).unwrap();
    }

    fn bytes(mut self) -> Vec<u8> {
        self.writer.finish().unwrap();
        self.writer.into_inner().into_inner()
    }
}

/// Topics in chunks of their own and mixed, with notes before, between and behind them.
fn varied(options: mcap::WriteOptions) -> Vec<u8> {
    let mut bag = Sketch::new(options);
    bag.notes("before");
    bag.attach();
    for round in 0..4 {
        let at = 1000 * round;
        bag.send("/a", at + 1, 40);
        bag.end_chunk();
        bag.send("/b", at + 100, 40);
        if round == 1 {
            bag.send("/late", at + 150, 3);
        }
        bag.end_chunk();
        if round == 2 {
            bag.notes("between");
            bag.attach();
        }
        bag.send("/big", at + 200, 200);
        bag.end_chunk();
        bag.send("/a", at + 500, 10);
        bag.send("/b", at + 510, 10);
        bag.end_chunk();
    }
    bag.send("/last", 9000, 5);
    bag.end_chunk();
    bag.notes("behind");
    bag.bytes()
}

/// Chunks of two topics that overlap in time, as some recorders write them, between others.
fn overlapping() -> Vec<u8> {
    let mut bag = Sketch::new(mcap::WriteOptions::new());
    bag.notes("before");
    bag.send("/big", 1, 200);
    bag.end_chunk();
    for round in 1..4 {
        let at = 1000 * round;
        bag.send("/b", at + 20, 60);
        bag.end_chunk();
        bag.send("/a", at, 60);
        bag.end_chunk();
        bag.send("/big", at + 30, 200);
        bag.end_chunk();
        bag.notes("between");
    }
    bag.send("/last", 9000, 5);
    bag.bytes()
}

#[test]
fn messages_of_wanted_topics_are_those_of_a_local_read_however_a_bag_is_laid_out() {
    if !common::skip::isolated() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let plain = mcap::WriteOptions::new;
    let whole = varied(plain());
    let cut = |n: usize| whole[..whole.len() - n].to_vec();
    let layouts = [
        ("zstd", whole.clone()),
        ("lz4", varied(plain().compression(Some(mcap::Compression::Lz4)))),
        ("not compressed", varied(plain().compression(None))),
        ("no chunks", varied(plain().use_chunks(false))),
        ("no indexes of messages", varied(plain().emit_message_indexes(false))),
        ("no indexes of chunks", varied(plain().emit_chunk_indexes(false))),
        ("no indexes of notes", varied(plain().emit_metadata_indexes(false))),
        ("no indexes of attachments", varied(plain().emit_attachment_indexes(false))),
        ("no statistics", varied(plain().emit_statistics(false))),
        ("channels in chunks only", varied(plain().repeat_channels(false).repeat_schemas(false))),
        ("no summary", varied(plain().emit_summary_records(false))),
        ("overlapping", overlapping()),
        ("without its last byte", cut(1)),
        ("a summary that is cut off", cut(60)),
        ("cut off in a chunk", cut(whole.len() / 3)),
    ];
    let choices: [&[&str]; 8] = [
        &[],
        &["/a"],
        &["/b"],
        &["/last"],
        &["/late"],
        &["/a", "/late"],
        &["/a", "/b", "/last"],
        &["/a", "/b", "/big"],
    ];
    for (layout, bytes) in layouts {
        let here = folder.path().join("bag.mcap");
        std::fs::write(&here, &bytes).unwrap();
        let there = format!("http://127.0.0.1:{}/bag.mcap", serve(bytes, true));
        for topics in choices {
            let topics: BTreeSet<String> = topics.iter().map(|topic| (*topic).to_owned()).collect();
            let local = wanted(BagReader::open(std::slice::from_ref(&here)).unwrap(), &topics);
            let mut reader = BagReader::open(&[Path::new(&there).to_path_buf()]).unwrap();
            let spares = reader.read_only(&topics);
            let remote = wanted(reader, &topics);
            assert!(local == remote, "{layout}, {topics:?}: {} and {} records", local.0.len(), remote.0.len());
            if ["zstd", "lz4", "not compressed", "overlapping"].contains(&layout) {
                assert!(spares && local.1.is_empty(), "{layout}, {topics:?}: the index is used");
            }
        }
    }
}
