//! Memory stays bounded however large a chunk is. Alone in its file: the peak is that of the whole process.

#[path = "common/skip.rs"]
mod skip;

use std::fs;
use std::io::BufWriter;

use tactile_pose_fusion::bag::BagReader;

const MESSAGE_LEN: usize = 1 << 20;
const N_MESSAGES: u32 = 300;

/// Most memory that this process ever had, in bytes; `None` where the system doesn't say.
fn peak_memory() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? << 10)
}

#[test]
fn chunk_larger_than_memory_should_be_is_streamed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one_chunk.mcap");
    let file = BufWriter::new(fs::File::create(&path).unwrap());
    let options = mcap::WriteOptions::new().profile("ros2").chunk_size(None).compression(Some(mcap::Compression::Zstd));
    let mut writer = options.create(file).unwrap();
    let channel = writer.add_channel(0, "/a", "cdr", &Default::default()).unwrap();
    let data = vec![7; MESSAGE_LEN];
    for sequence in 0..N_MESSAGES {
        let header = mcap::records::MessageHeader { channel_id: channel, sequence, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);

    let Some(before) = peak_memory() else {
        skip::skipped("/proc/self/status is not here");
        return;
    };
    let mut reader = BagReader::open(&[path]).unwrap();
    let mut n_messages = 0;
    while let Some(message) = reader.next_message().unwrap() {
        assert_eq!(message.data.len(), MESSAGE_LEN);
        n_messages += 1;
    }
    assert_eq!((n_messages, reader.losses().len()), (N_MESSAGES, 0));
    let grown = peak_memory().unwrap_or(before) - before;
    // A message twice, the compressor's window and buffers: 300 MB would show that the chunk was held.
    assert!(grown < 30 << 20, "grew by {grown} bytes");
}
