//! Statistics of a bag, topic by topic: how many, how often, how evenly, and what is missing.

mod intervals;

use std::collections::BTreeMap;

use serde::Serialize;

use super::read::BagMessage;
use crate::units::{NANOS_PER_SEC, Stamp};
use intervals::Intervals;

/// An interval of more than this many medians is a gap: five lost samples of a regular topic.
pub const GAP_FACTOR: f64 = 5.0;

/// Statistics of one topic. Times are log times, which is when the recorder received a message.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicStats {
    /// Topic name.
    pub topic: String,
    /// Type name; empty where the recorder wrote none.
    #[serde(rename = "type")]
    pub type_name: String,
    /// How messages are serialized.
    pub message_encoding: String,
    /// Number of messages.
    pub n_messages: u64,
    /// Bytes of all messages, as they are serialized.
    pub bytes: u64,
    /// Earliest log time, ns.
    pub first_ns: Option<i64>,
    /// Latest log time, ns.
    pub last_ns: Option<i64>,
    /// Messages a second between first and last.
    pub rate_hz: Option<f64>,
    /// Interval that half of all intervals stay within, ms; within 1.6 %, as p99 is.
    pub interval_p50_ms: Option<f64>,
    /// Interval that 99 % of all intervals stay within, ms.
    pub interval_p99_ms: Option<f64>,
    /// Longest interval, ms; exact.
    pub interval_max_ms: Option<f64>,
    /// Standard deviation of the intervals, ms.
    pub jitter_ms: Option<f64>,
    /// Intervals of more than [`GAP_FACTOR`] medians.
    pub n_gaps: u64,
    /// Messages whose log time lies before that of an earlier one. They begin and end no interval.
    pub n_out_of_order: u64,
    /// Messages that the recorder counted and that are not in the bag. `None` where its count is of no use: always the
    /// same, or not one up a message of this topic.
    pub n_lost_by_sequence: Option<u64>,
}

/// Gathers [`TopicStats`] in one pass. Memory grows with the number of topics alone.
#[derive(Debug, Default)]
pub struct BagStats {
    topics: Vec<Topic>,
    /// Place in `topics`, by name, type and encoding.
    by_key: BTreeMap<(String, String, String), usize>,
    /// The topic of each [`BagChannel`](super::BagChannel), by its id.
    by_channel: BTreeMap<usize, Sequence>,
}

#[derive(Debug, Default)]
struct Topic {
    n_messages: u64,
    bytes: u64,
    span: Option<(Stamp, Stamp)>,
    intervals: Intervals,
    n_out_of_order: u64,
}

/// Sequence numbers of one channel, as the recorder counted.
#[derive(Debug)]
struct Sequence {
    topic: usize,
    last: u32,
    n_steps: u64,
    n_steps_of_one: u64,
    n_lost: u64,
}

impl BagStats {
    /// Take in one message.
    pub fn handle_message(&mut self, message: &BagMessage<'_>) {
        let channel = message.channel;
        let BagStats { topics, by_key, by_channel } = self;
        let sequence = by_channel.entry(channel.id).or_insert_with(|| {
            let key = (channel.topic.clone(), channel.type_name().to_owned(), channel.message_encoding.clone());
            let topic = *by_key.entry(key).or_insert_with(|| {
                topics.push(Topic::default());
                topics.len() - 1
            });
            // The first message loses nothing.
            Sequence { topic, last: message.sequence.wrapping_sub(1), n_steps: 0, n_steps_of_one: 0, n_lost: 0 }
        });
        sequence.handle(message.sequence);
        topics[sequence.topic].handle(message);
    }

    /// Statistics of every topic that had a message, in order of name.
    pub fn topics(&self) -> Vec<TopicStats> {
        let mut lost = vec![Some(0); self.topics.len()];
        for sequence in self.by_channel.values() {
            let of_topic = &mut lost[sequence.topic];
            *of_topic = of_topic.zip(sequence.n_lost()).map(|(sum, n)| sum + n);
        }
        self.by_key.iter().map(|(key, &idx)| self.topics[idx].stats(key, lost[idx])).collect()
    }
}

impl Topic {
    fn handle(&mut self, message: &BagMessage<'_>) {
        self.n_messages += 1;
        self.bytes += message.data.len() as u64;
        let time = message.log_time;
        self.span = Some(match self.span {
            None => (time, time),
            Some((first, last)) if time < last => {
                self.n_out_of_order += 1;
                (first.min(time), last)
            }
            Some((first, last)) => {
                self.intervals.handle(time.nanos_since(last).unsigned_abs());
                (first, time)
            }
        });
    }

    fn stats(&self, (topic, type_name, encoding): &(String, String, String), n_lost: Option<u64>) -> TopicStats {
        let ms = |ns: f64| ns / 1e6;
        let p50 = self.intervals.quantile(0.5);
        let seconds = self.span.map(|(first, last)| last.nanos_since(first) as f64 / NANOS_PER_SEC as f64);
        TopicStats {
            topic: topic.clone(),
            type_name: type_name.clone(),
            message_encoding: encoding.clone(),
            n_messages: self.n_messages,
            bytes: self.bytes,
            first_ns: self.span.map(|(first, _)| first.0),
            last_ns: self.span.map(|(_, last)| last.0),
            rate_hz: seconds.filter(|&s| s > 0.0).map(|s| (self.n_messages - 1) as f64 / s),
            interval_p50_ms: p50.map(ms),
            interval_p99_ms: self.intervals.quantile(0.99).map(ms),
            interval_max_ms: self.intervals.max().map(|ns| ms(ns as f64)),
            jitter_ms: self.intervals.standard_deviation().map(ms),
            n_gaps: p50.map_or(0, |p50| self.intervals.n_above(GAP_FACTOR * p50)),
            n_out_of_order: self.n_out_of_order,
            n_lost_by_sequence: n_lost,
        }
    }
}

impl Sequence {
    fn handle(&mut self, sequence: u32) {
        let step = sequence.wrapping_sub(self.last);
        self.last = sequence;
        self.n_steps += 1;
        self.n_steps_of_one += u64::from(step == 1);
        // A step beyond half the range is one back: a repeated or late message.
        if (2..=u32::MAX / 2).contains(&step) {
            self.n_lost += u64::from(step - 1);
        }
    }

    /// A recorder that counts over all topics, or not at all, seldom steps by one.
    fn n_lost(&self) -> Option<u64> {
        let (n_steps, n_steps_of_one) = (self.n_steps - 1, self.n_steps_of_one - 1);
        (n_steps > 0 && n_steps_of_one * 2 > n_steps).then_some(self.n_lost)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::bag::BagChannel;

    fn stats_of(messages: &[(i64, u32)]) -> TopicStats {
        let channel = Arc::new(BagChannel {
            id: 3,
            input: 0,
            topic: "/taxels".to_owned(),
            message_encoding: "cdr".to_owned(),
            schema: None,
            metadata: BTreeMap::new(),
        });
        let mut stats = BagStats::default();
        for &(log_time_ns, sequence) in messages {
            let log_time = Stamp(log_time_ns);
            stats.handle_message(&BagMessage {
                channel: &channel,
                log_time,
                publish_time: log_time,
                sequence,
                data: &[0; 10],
            });
        }
        stats.topics().remove(0)
    }

    const MS: i64 = 1_000_000;

    #[test]
    fn regular_topic_has_its_rate_and_no_gap() {
        let messages: Vec<_> = (0..1001).map(|n| (n * 10 * MS, n as u32)).collect();
        let stats = stats_of(&messages);
        assert_eq!((stats.n_messages, stats.bytes, stats.n_gaps, stats.n_out_of_order), (1001, 10_010, 0, 0));
        assert_eq!(stats.rate_hz, Some(100.0));
        assert_eq!(stats.jitter_ms, Some(0.0));
        assert_eq!(stats.n_lost_by_sequence, Some(0));
        // The histogram's bins are this wide.
        assert!((stats.interval_p50_ms.unwrap() / 10.0 - 1.0).abs() < 1.0 / 64.0);
    }

    #[test]
    fn gap_and_lost_messages_are_counted() {
        let messages: Vec<_> = (0..200).filter(|n| !(100..110).contains(n)).map(|n| (n * 10 * MS, n as u32)).collect();
        let stats = stats_of(&messages);
        assert_eq!(stats.n_gaps, 1);
        assert_eq!(stats.interval_max_ms, Some(110.0));
        assert_eq!(stats.n_lost_by_sequence, Some(10));
    }

    #[test]
    fn message_out_of_order_begins_no_interval() {
        let stats = stats_of(&[(10 * MS, 0), (20 * MS, 0), (15 * MS, 0), (30 * MS, 0)]);
        assert_eq!(stats.n_out_of_order, 1);
        assert_eq!(stats.interval_max_ms, Some(10.0));
        assert_eq!(stats.n_lost_by_sequence, None);
    }

    #[test]
    fn one_message_has_no_rate() {
        let stats = stats_of(&[(5, 7)]);
        assert_eq!((stats.rate_hz, stats.interval_p50_ms, stats.jitter_ms), (None, None, None));
        assert_eq!(stats.n_lost_by_sequence, None);
    }

    #[test]
    fn count_over_all_topics_is_no_loss() {
        let messages: Vec<_> = (0..100).map(|n| (n * MS, 3 * n as u32)).collect();
        assert_eq!(stats_of(&messages).n_lost_by_sequence, None);
    }
}
