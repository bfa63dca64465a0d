//! Bags written message by message, as a recorder would.

use std::collections::HashMap;
use std::path::Path;

use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, BagReader, BagWriter, NewChannel, OutChannel, WriteOptions};
use tactile_pose_fusion::msg::*;
use tactile_pose_fusion::units::Stamp;

const MS: i64 = 1_000_000;
const T0: i64 = 1_700_000_000_000_000_000;

/// A stamp this many milliseconds after the start of a test's recording.
pub fn at(ms: i64) -> Stamp {
    Stamp(T0 + ms * MS)
}

/// A bag with `/taxels`, `/joints` and, where they are written, other topics.
pub struct Bag {
    pub writer: BagWriter,
    pub n_taxel_messages: u32,
    /// By topic and type: a definition is parsed and hashed once, not with every message.
    channels: HashMap<(String, String), OutChannel>,
}

impl Bag {
    pub fn create(path: &Path) -> Bag {
        Bag::of(BagWriter::create(path, WriteOptions::default()).unwrap())
    }

    /// A bag that is written as its writer says.
    pub fn of(writer: BagWriter) -> Bag {
        Bag { writer, n_taxel_messages: 0, channels: HashMap::new() }
    }

    /// A message of any written type, received at `at`.
    pub fn send<T: WireType>(&mut self, topic: &str, at: Stamp, message: &T) {
        self.send_bytes::<T>(topic, at, &to_cdr(message));
    }

    /// Bytes that claim to be a message of a type.
    pub fn send_bytes<T: WireType>(&mut self, topic: &str, at: Stamp, cdr: &[u8]) {
        let channel = self.channel(topic, T::TYPE_NAME);
        self.writer.write(channel, 0, at, at, cdr).unwrap();
    }

    /// A message of another bag, of a type that is compiled in.
    pub fn send_recorded(&mut self, message: &Recorded) {
        let Recorded { topic, type_name, log_time, data } = message;
        let channel = self.channel(topic, type_name);
        self.writer.write(channel, 0, *log_time, *log_time, data).unwrap();
    }

    /// The channel of a topic of a type that is compiled in.
    fn channel(&mut self, topic: &str, type_name: &str) -> OutChannel {
        let key = (topic.to_owned(), type_name.to_owned());
        *self.channels.entry(key).or_insert_with(|| {
            let (schema_text, type_hash) = (definition_text(type_name).unwrap(), rihs01(type_name).unwrap());
            let (schema_text, type_hash) = (schema_text.as_str(), type_hash.as_str());
            let channel = NewChannel { topic, type_name, schema_text, qos_yaml: BEST_EFFORT_QOS, type_hash };
            self.writer.add_channel(channel).unwrap()
        })
    }

    /// One row of `/taxels`.
    pub fn taxels(&mut self, at: Stamp, values: &[f32]) {
        let sequence = self.n_taxel_messages;
        self.n_taxel_messages += 1;
        let message = TaxelArray {
            header: Header { stamp: at.into(), frame_id: "index_tip".into() },
            sequence,
            rows: 1,
            row_period: Duration::default(),
            values: values.to_vec(),
        };
        self.send("/taxels", at, &message);
    }

    /// A state of `/joints`.
    pub fn joints(&mut self, at: Stamp, names: &[&str], position: &[f64]) {
        let message = JointState {
            header: Header { stamp: at.into(), frame_id: String::new() },
            name: names.iter().map(|name| name.to_string()).collect(),
            position: position.to_vec(),
            velocity: vec![],
            effort: vec![],
        };
        self.send("/joints", at, &message);
    }

    pub fn finish(self) {
        self.writer.finish().unwrap();
    }
}

/// One message of a topic as it stands in a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct Recorded {
    pub topic: String,
    pub type_name: String,
    pub log_time: Stamp,
    pub data: Vec<u8>,
}

/// Every message of a bag, in its order.
pub fn messages(path: &Path) -> Vec<Recorded> {
    let mut reader = BagReader::open(&[path.to_path_buf()]).unwrap();
    let mut messages = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        messages.push(Recorded {
            topic: message.channel.topic.clone(),
            type_name: message.channel.type_name().to_owned(),
            log_time: message.log_time,
            data: message.data.to_vec(),
        });
    }
    assert!(reader.losses().is_empty(), "{:?}", reader.losses());
    messages
}

/// Every message of a topic, decoded.
pub fn decoded<T: WireType>(path: &Path, topic: &str) -> Vec<T> {
    let on_topic = messages(path).into_iter().filter(|message| message.topic == topic);
    on_topic.map(|message| from_cdr(&message.data).unwrap()).collect()
}

pub fn stamp_of(header: &Header) -> Stamp {
    Stamp::from_sec_nanosec(header.stamp.sec, header.stamp.nanosec)
}

/// 100 Hz taxels and joints with touches: at rest 10 + noise, 400 units under load from 4 s to 5 s, 6 s to 7 s, ...
pub fn write_session(path: &Path, seconds: i64) {
    let mut bag = Bag::create(path);
    for k in 0..seconds * 100 {
        let bend = (k as f64 * 0.02).sin();
        let touch = if k >= 400 && (k / 100) % 2 == 0 { 100.0 } else { 0.0 };
        let wiggle = (k * 7919 % 13) as f32 * 0.01;
        let artifact = 20.0 * bend as f32;
        bag.joints(at(k * 10 + 3), &["pip", "dip"], &[2.0 * bend, bend]);
        bag.taxels(at(k * 10 + 10), &[10.0 + artifact + touch + wiggle, 5.0 + touch - wiggle]);
    }
    bag.finish();
}
