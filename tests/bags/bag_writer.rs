//! A written bag holds what it was given, the same bytes each time, and comes to its name only when it is complete.

use std::fs;
use std::path::Path;

use tactile_pose_fusion::bag::{
    BEST_EFFORT_QOS, BagError, BagReader, BagRecord, BagWriter, Compression, NewChannel, WriteOptions,
};
use tactile_pose_fusion::units::Stamp;

const WRENCH: NewChannel<'static> = NewChannel {
    topic: "/glove/index/wrench",
    type_name: "geometry_msgs/msg/WrenchStamped",
    schema_text: "float64 x",
    qos_yaml: BEST_EFFORT_QOS,
    type_hash: "RIHS01_00",
};

fn start(out: &Path, options: WriteOptions) -> BagWriter {
    let mut writer = BagWriter::create(out, options).unwrap();
    let channel = writer.add_channel(WRENCH).unwrap();
    for n in 0..1000u32 {
        let time = Stamp(1_000_000_000 + i64::from(n) * 10_000_000);
        writer.write(channel, n, time, time.offset(-5), &n.to_le_bytes().repeat(100)).unwrap();
    }
    writer
}

fn write(out: &Path) {
    start(out, WriteOptions::default()).finish().unwrap();
}

fn refusal(out: &Path, options: WriteOptions) -> BagError {
    let error = BagWriter::create(out, options).err().unwrap();
    assert_eq!(error.to_string().lines().count(), 1, "{error}");
    error
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn what_is_written_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        for name in [format!("{compression:?}"), format!("{compression:?}.mcap")] {
            let out = folder.path().join(&name);
            let finished = start(&out, WriteOptions { compression, ..WriteOptions::default() }).finish().unwrap();
            assert_eq!((finished.path.as_path(), finished.n_messages), (out.as_path(), 1000));
            let mut reader = BagReader::open(&[out]).unwrap();
            let channel = reader.required(WRENCH.topic).unwrap()[0].clone();
            assert_eq!(channel.schema.as_ref().unwrap().data, WRENCH.schema_text.as_bytes());
            assert_eq!(channel.metadata["offered_qos_profiles"], BEST_EFFORT_QOS);
            assert_eq!(channel.metadata["topic_type_hash"], "RIHS01_00");
            let mut n = 0u32;
            while let Some(message) = reader.next_message().unwrap() {
                assert_eq!(message.sequence, n);
                assert_eq!(message.log_time.nanos_since(message.publish_time), 5);
                assert_eq!(message.data, n.to_le_bytes().repeat(100));
                n += 1;
            }
            assert_eq!((n, reader.losses().len()), (1000, 0));
        }
    }
}

#[test]
fn same_calls_write_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("1"), folder.path().join("2"));
    fs::create_dir(&one).unwrap();
    fs::create_dir(&two).unwrap();
    for parent in [&one, &two] {
        write(&parent.join("bag"));
        write(&parent.join("bag.mcap"));
    }
    for name in ["bag/bag_0.mcap", "bag/metadata.yaml", "bag.mcap"] {
        assert_eq!(fs::read(one.join(name)).unwrap(), fs::read(two.join(name)).unwrap(), "{name}");
    }
}

#[test]
fn dropped_writer_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    drop(start(&folder.path().join("bag"), WriteOptions::default()));
    drop(start(&folder.path().join("bag.mcap"), WriteOptions::default()));
    assert!(names(folder.path()).is_empty());
}

#[test]
fn recording_that_is_to_be_kept_stays_when_it_is_not_finished() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["bag", "bag.mcap"] {
        let mut writer = start(&folder.path().join(name), WriteOptions::default());
        let unfinished = writer.keep_unfinished();
        writer.flush().unwrap();
        drop(writer);
        assert!(!folder.path().join(name).exists(), "it is not complete");
        // What the book tells to do with it.
        let renamed = folder.path().join("renamed.mcap");
        fs::rename(unfinished, &renamed).unwrap();
        let mut reader = BagReader::open(&[renamed]).unwrap();
        let n = std::iter::from_fn(|| reader.next_message().unwrap().map(|_| ())).count();
        assert_eq!(n, 1000, "{name}");
    }
}

#[test]
fn existing_output_is_refused_and_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let (file, bag) = (folder.path().join("a.mcap"), folder.path().join("bag"));
    fs::write(&file, "mine").unwrap();
    fs::create_dir(&bag).unwrap();
    for out in [&file, &bag] {
        assert!(matches!(refusal(out, WriteOptions::default()), BagError::Exists { .. }));
    }
    assert_eq!(fs::read(&file).unwrap(), b"mine");
}

#[test]
fn output_that_appears_meanwhile_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let (file, bag) = (folder.path().join("a.mcap"), folder.path().join("bag"));
    let writers = [start(&file, WriteOptions::default()), start(&bag, WriteOptions::default())];
    fs::write(&file, "mine").unwrap();
    fs::create_dir(&bag).unwrap();
    for writer in writers {
        assert!(matches!(writer.finish(), Err(BagError::Exists { .. })));
    }
    assert_eq!(names(folder.path()), ["a.mcap", "bag"]);
    assert_eq!(fs::read(&file).unwrap(), b"mine");
}

#[test]
fn allowed_overwriting_replaces_a_bag_when_the_new_one_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let overwrite = || WriteOptions { overwrite: true, ..WriteOptions::default() };
    for name in ["bag", "bag.mcap"] {
        let out = folder.path().join(name);
        BagWriter::create(&out, overwrite()).unwrap().finish().unwrap();
        let empty = BagReader::open(std::slice::from_ref(&out)).unwrap().summary().n_messages;
        let writer = start(&out, overwrite());
        assert_eq!(BagReader::open(std::slice::from_ref(&out)).unwrap().summary().n_messages, empty);
        writer.finish().unwrap();
        assert_eq!(BagReader::open(&[out]).unwrap().summary().n_messages, Some(1000));
    }
    assert_eq!(names(folder.path()), ["bag", "bag.mcap"]);
}

#[test]
fn folder_that_holds_more_than_a_bag_is_never_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("thesis");
    fs::create_dir(&out).unwrap();
    fs::write(out.join("chapter1.tex"), "").unwrap();
    let error = refusal(&out, WriteOptions { overwrite: true, ..WriteOptions::default() });
    assert!(matches!(error, BagError::NotReplaceable { .. }));
}

#[test]
fn input_is_never_an_output() {
    let folder = tempfile::tempdir().unwrap();
    let (file, bag) = (folder.path().join("a.mcap"), folder.path().join("bag"));
    write(&file);
    write(&bag);
    let same_file = folder.path().join("bag/../a.mcap");
    let options =
        || WriteOptions { overwrite: true, inputs: vec![file.clone(), bag.clone()], ..WriteOptions::default() };
    for out in [&same_file, &bag, &bag.join("bag_0.mcap"), &bag.join("new.mcap")] {
        assert!(matches!(refusal(out, options()), BagError::OutputIsInput { .. }), "{}", out.display());
    }
    #[cfg(unix)]
    {
        let link = folder.path().join("link.mcap");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        assert!(matches!(refusal(&link, options()), BagError::OutputIsInput { .. }));
    }
}

#[test]
fn missing_parent_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let error = refusal(&folder.path().join("no/such/out.mcap"), WriteOptions::default());
    assert!(matches!(error, BagError::NoParent { .. }));
}

#[test]
fn a_file_gets_no_metadata_beside_it_that_would_hide_the_other_bags_of_its_folder() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.mcap", "b.mcap"] {
        assert!(start(&folder.path().join(name), WriteOptions::default()).finish().unwrap().notes.is_empty());
    }
    assert_eq!(names(folder.path()), ["a.mcap", "b.mcap"]);
}

#[test]
fn metadata_beside_a_file_is_kept_true_where_it_is_of_that_file_and_left_where_it_is_of_another() {
    let folder = tempfile::tempdir().unwrap();
    let metadata = folder.path().join("metadata.yaml");
    let out = folder.path().join("a.mcap");
    let own = || WriteOptions { overwrite: true, owns_folder: true, ..WriteOptions::default() };
    let finished = BagWriter::create(&out, own()).unwrap().finish().unwrap();
    assert!(finished.notes.is_empty());
    assert!(fs::read_to_string(&metadata).unwrap().contains("message_count: 0"));
    start(&out, WriteOptions { overwrite: true, ..WriteOptions::default() }).finish().unwrap();
    let ours = fs::read_to_string(&metadata).unwrap();
    assert!(ours.contains("message_count: 1000"));

    for options in [own(), WriteOptions { overwrite: true, ..WriteOptions::default() }] {
        let finished = start(&folder.path().join("b.mcap"), options).finish().unwrap();
        assert_eq!(finished.notes.len(), 1);
        assert!(finished.notes[0].contains("left as it is"), "{:?}", finished.notes);
        assert_eq!(fs::read_to_string(&metadata).unwrap(), ours);
    }
}

#[test]
fn time_before_1970_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = BagWriter::create(&folder.path().join("a.mcap"), WriteOptions::default()).unwrap();
    let channel = writer.add_channel(WRENCH).unwrap();
    let error = writer.write(channel, 0, Stamp(-1), Stamp(0), b"").unwrap_err();
    assert!(matches!(error, BagError::NegativeTime { .. }));
    assert!(error.to_string().contains("/glove/index/wrench"));
}

#[test]
fn attachments_and_foreign_notes_are_copied_and_those_of_rosbag2_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source.mcap");
    let mut raw = mcap::Writer::new(fs::File::create(&source).unwrap()).unwrap();
    for name in ["rosbag2", "rig"] {
        let metadata = [("key".to_owned(), "value".to_owned())].into();
        raw.write_metadata(&mcap::records::Metadata { name: name.to_owned(), metadata }).unwrap();
    }
    let photo = mcap::Attachment {
        log_time: 1,
        create_time: 2,
        name: "photo".to_owned(),
        media_type: "image/png".to_owned(),
        data: b"png".as_slice().into(),
    };
    raw.attach(&photo).unwrap();
    raw.finish().unwrap();

    let mut reader = BagReader::open(&[source]).unwrap();
    let out = folder.path().join("out.mcap");
    let mut writer = BagWriter::create(&out, WriteOptions::default()).unwrap();
    while let Some(record) = reader.next_record().unwrap() {
        match record {
            BagRecord::Message(_) => {}
            BagRecord::Attachment(file) => writer.copy_attachment(&file).unwrap(),
            BagRecord::Metadata(notes) => writer.copy_metadata(&notes).unwrap(),
        }
    }
    writer.finish().unwrap();

    let mut copy = BagReader::open(&[out]).unwrap();
    let (mut files, mut notes) = (Vec::new(), Vec::new());
    while let Some(record) = copy.next_record().unwrap() {
        match record {
            BagRecord::Message(_) => {}
            BagRecord::Attachment(file) => files.push((file.name.to_owned(), file.data.to_vec())),
            BagRecord::Metadata(note) => notes.push((note.name.to_owned(), note.metadata.contains_key("key"))),
        }
    }
    assert_eq!(files, [("photo".to_owned(), b"png".to_vec())]);
    assert_eq!(notes, [("rig".to_owned(), true), ("rosbag2".to_owned(), false)]);
}
