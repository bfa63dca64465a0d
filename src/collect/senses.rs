//! Sensor data: current values, rates, and the range of values in a time window.

use std::collections::{BTreeMap, VecDeque};

use crate::units::{NANOS_PER_SEC, Newton, Stamp};

/// Window over which rates are counted, ns.
const RATE_NS: i64 = 2 * NANOS_PER_SEC;

/// The expected sensor data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// Tactile sources: name, and number of taxels.
    pub taxels: Vec<(String, usize)>,
    /// Joint sources.
    pub joint_sources: Vec<String>,
    /// Joints that regions need.
    pub joints: Vec<String>,
    /// Force sensors.
    pub force: Vec<String>,
}

/// One of the streams of a [`Layout`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stream {
    /// A tactile source.
    Taxels(usize),
    /// A joint source.
    Joints(usize),
    /// A force sensor.
    Force(usize),
}

/// Spread of a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Number of values.
    pub n: u64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    mean: f64,
    squares: f64,
}

impl Default for Spread {
    fn default() -> Self {
        Spread { n: 0, min: f64::INFINITY, max: f64::NEG_INFINITY, mean: 0.0, squares: 0.0 }
    }
}

impl Spread {
    /// Adds a value. Values that are not finite are ignored.
    pub fn handle(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        self.n += 1;
        (self.min, self.max) = (self.min.min(value), self.max.max(value));
        // Welford's recurrence.
        let from_mean = value - self.mean;
        self.mean += from_mean / self.n as f64;
        self.squares += from_mean * (value - self.mean);
    }

    /// Adds the values of another spread.
    pub fn merge(&mut self, other: &Spread) {
        if other.n == 0 {
            return;
        }
        let (n, m) = (self.n as f64, other.n as f64);
        let apart = other.mean - self.mean;
        self.squares += other.squares + apart * apart * n * m / (n + m);
        self.mean += apart * m / (n + m);
        self.n += other.n;
        (self.min, self.max) = (self.min.min(other.min), self.max.max(other.max));
    }

    /// Its mean; `None` without a value.
    pub fn mean(&self) -> Option<f64> {
        (self.n > 0).then_some(self.mean)
    }

    /// Its standard deviation; `None` without two values.
    pub fn sd(&self) -> Option<f64> {
        (self.n > 1).then(|| (self.squares / (self.n - 1) as f64).sqrt())
    }

    /// Range from the smallest to the largest value; 0 without a value.
    pub fn span(&self) -> f64 {
        if self.n == 0 { 0.0 } else { self.max - self.min }
    }
}

/// Data received in a time window.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Window {
    /// Samples (rows) of each stream, and the longest time without one, s.
    pub streams: BTreeMap<Stream, (u64, f64)>,
    /// `[source][taxel]`: readings as sent.
    pub taxels: Vec<Vec<Spread>>,
    /// Joints by name, rad.
    pub joints: BTreeMap<String, Spread>,
    /// `[force sensor]`, N.
    pub force: Vec<Spread>,
    /// Duration, s.
    pub seconds: f64,
}

/// The state of the sensors, from their messages.
#[derive(Debug, Clone)]
pub struct Senses {
    layout: Layout,
    arrivals: BTreeMap<Stream, VecDeque<(Stamp, usize)>>,
    taxels: Vec<Vec<f64>>,
    joints: BTreeMap<String, f64>,
    force: Vec<Option<Newton>>,
    window: Window,
    ever: Window,
    began: Option<Stamp>,
    last: BTreeMap<Stream, Stamp>,
}

impl Senses {
    /// Sensors before their first message.
    pub fn new(layout: Layout) -> Self {
        let force = vec![None; layout.force.len()];
        let mut senses = Senses {
            layout,
            arrivals: BTreeMap::new(),
            taxels: Vec::new(),
            joints: BTreeMap::new(),
            force,
            window: Window::default(),
            ever: Window::default(),
            began: None,
            last: BTreeMap::new(),
        };
        senses.taxels = senses.layout.taxels.iter().map(|(_, n_taxels)| vec![f64::NAN; *n_taxels]).collect();
        (senses.window, senses.ever) = (senses.empty(), senses.empty());
        senses
    }

    /// Adds rows of taxels as sent.
    ///
    /// # Shapes
    /// `values`: `[rows, taxels]`. Blocks of another length are ignored here, because the decoder counts them.
    pub fn handle_taxels(&mut self, source: usize, values: &[f32], now: Stamp) {
        let n_taxels = self.layout.taxels[source].1;
        if n_taxels == 0 || values.is_empty() || !values.len().is_multiple_of(n_taxels) {
            return;
        }
        self.arrived(Stream::Taxels(source), values.len() / n_taxels, now);
        for row in values.chunks_exact(n_taxels) {
            for (taxel_idx, value) in row.iter().map(|value| f64::from(*value)).enumerate() {
                self.taxels[source][taxel_idx] = value;
                self.window.taxels[source][taxel_idx].handle(value);
                self.ever.taxels[source][taxel_idx].handle(value);
            }
        }
    }

    /// Adds joint angles, rad.
    pub fn handle_joints(&mut self, source: usize, names: &[String], angles: &[f64], now: Stamp) {
        self.arrived(Stream::Joints(source), 1, now);
        for (name, angle) in names.iter().zip(angles) {
            self.joints.insert(name.clone(), *angle);
            self.window.joints.entry(name.clone()).or_default().handle(*angle);
            self.ever.joints.entry(name.clone()).or_default().handle(*angle);
        }
    }

    /// Adds a force sensor reading, positive under pressure.
    pub fn handle_force(&mut self, sensor: usize, force: Newton, now: Stamp) {
        self.arrived(Stream::Force(sensor), 1, now);
        self.force[sensor] = Some(force);
        self.window.force[sensor].handle(force.0);
        self.ever.force[sensor].handle(force.0);
    }

    /// The data received since the last call.
    pub fn take_window(&mut self, now: Stamp) -> Window {
        let empty = self.empty();
        let mut window = std::mem::replace(&mut self.window, empty);
        let began = self.began.replace(now).unwrap_or(now);
        window.seconds = seconds(now.nanos_since(began));
        // If a stream has stopped, no message ends its gap.
        for stream in self.layout.streams() {
            let (_, gap_s) = window.streams.entry(stream).or_default();
            let since = self.last.get(&stream).copied().unwrap_or(began).max(began);
            *gap_s = gap_s.max(seconds(now.nanos_since(since)));
        }
        window
    }

    /// Range of all values since the beginning, without counts of the streams.
    pub fn ever(&self) -> &Window {
        &self.ever
    }

    /// The expected sensor data.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Samples per second of a stream over the last two seconds.
    pub fn rate_hz(&self, stream: Stream, now: Stamp) -> f64 {
        let Some(arrivals) = self.arrivals.get(&stream) else { return 0.0 };
        let recent = arrivals.iter().filter(|(at, _)| now.nanos_since(*at) <= RATE_NS);
        recent.map(|(_, rows)| *rows).sum::<usize>() as f64 / seconds(RATE_NS)
    }

    /// Time since the last message of a stream, s; `None` if there was none.
    pub fn age_s(&self, stream: Stream, now: Stamp) -> Option<f64> {
        self.last.get(&stream).map(|last| seconds(now.nanos_since(*last)))
    }

    /// True if every stream has sent a message.
    pub fn all_heard(&self) -> bool {
        self.layout.streams().iter().all(|stream| self.last.contains_key(stream))
    }

    /// The last readings of a tactile source; NaN if there is none yet.
    pub fn taxels(&self, source: usize) -> &[f64] {
        &self.taxels[source]
    }

    /// The last angle of a joint, rad.
    pub fn joint(&self, name: &str) -> Option<f64> {
        self.joints.get(name).copied()
    }

    /// Names of all joints received.
    pub fn joint_names(&self) -> impl Iterator<Item = &str> {
        self.joints.keys().map(String::as_str)
    }

    /// The last force of a sensor.
    pub fn force(&self, sensor: usize) -> Option<Newton> {
        self.force[sensor]
    }

    fn arrived(&mut self, stream: Stream, rows: usize, now: Stamp) {
        self.began.get_or_insert(now);
        let arrivals = self.arrivals.entry(stream).or_default();
        arrivals.push_back((now, rows));
        while arrivals.front().is_some_and(|(at, _)| now.nanos_since(*at) > RATE_NS) {
            arrivals.pop_front();
        }
        let (n, gap_s) = self.window.streams.entry(stream).or_default();
        *n += rows as u64;
        if let Some(last) = self.last.insert(stream, now) {
            *gap_s = gap_s.max(seconds(now.nanos_since(last)));
        }
    }

    fn empty(&self) -> Window {
        Window {
            taxels: self.layout.taxels.iter().map(|(_, n_taxels)| vec![Spread::default(); *n_taxels]).collect(),
            force: vec![Spread::default(); self.layout.force.len()],
            ..Window::default()
        }
    }
}

impl Layout {
    /// All streams, in the order shown to users.
    pub fn streams(&self) -> Vec<Stream> {
        let taxels = (0..self.taxels.len()).map(Stream::Taxels);
        let joints = (0..self.joint_sources.len()).map(Stream::Joints);
        taxels.chain(joints).chain((0..self.force.len()).map(Stream::Force)).collect()
    }

    /// The name of a stream.
    pub fn name(&self, stream: Stream) -> &str {
        match stream {
            Stream::Taxels(idx) => &self.taxels[idx].0,
            Stream::Joints(idx) => &self.joint_sources[idx],
            Stream::Force(idx) => &self.force[idx],
        }
    }
}

impl Window {
    /// Adds the data of another window.
    pub fn merge(&mut self, other: &Window) {
        for (stream, (n, gap_s)) in &other.streams {
            let mine = self.streams.entry(*stream).or_default();
            *mine = (mine.0 + n, mine.1.max(*gap_s));
        }
        self.taxels.resize_with(other.taxels.len(), Vec::new);
        for (mine, theirs) in self.taxels.iter_mut().zip(&other.taxels) {
            mine.resize_with(theirs.len(), Spread::default);
            mine.iter_mut().zip(theirs).for_each(|(mine, theirs)| mine.merge(theirs));
        }
        for (name, spread) in &other.joints {
            self.joints.entry(name.clone()).or_default().merge(spread);
        }
        self.force.resize_with(other.force.len(), Spread::default);
        self.force.iter_mut().zip(&other.force).for_each(|(mine, theirs)| mine.merge(theirs));
        self.seconds += other.seconds;
    }
}

fn seconds(nanos: i64) -> f64 {
    nanos as f64 / NANOS_PER_SEC as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreads_of_two_halves_are_that_of_the_whole() {
        let values = [3.0, -1.0, 4.0, 1.0, -5.0, 9.0, f64::NAN];
        let of = |values: &[f64]| {
            let mut spread = Spread::default();
            values.iter().for_each(|value| spread.handle(*value));
            spread
        };
        let (whole, mut half) = (of(&values), of(&values[..3]));
        half.merge(&of(&values[3..]));
        assert_eq!((half.n, half.min, half.max), (6, -5.0, 9.0));
        assert!((half.mean().unwrap() - whole.mean().unwrap()).abs() < 1e-12); // rounding
        assert!((half.sd().unwrap() - whole.sd().unwrap()).abs() < 1e-12);
    }

    #[test]
    fn a_stream_that_stops_has_a_gap_and_no_rate() {
        let layout = Layout {
            taxels: vec![("glove".to_owned(), 2)],
            joint_sources: vec![],
            joints: vec![],
            force: vec!["cell".to_owned()],
        };
        let mut senses = Senses::new(layout);
        let at = |millis: i64| Stamp(millis * 1_000_000);
        for k in 0..200 {
            senses.handle_taxels(0, &[1.0, 2.0], at(k * 10));
            if k < 100 {
                senses.handle_force(0, Newton(0.1), at(k * 10));
            }
        }
        assert!((senses.rate_hz(Stream::Taxels(0), at(1990)) - 100.0).abs() < 1.0);
        assert_eq!(senses.age_s(Stream::Force(0), at(1990)), Some(1.0));
        let window = senses.take_window(at(2000));
        assert_eq!(window.streams[&Stream::Taxels(0)].0, 200);
        assert!(window.streams[&Stream::Taxels(0)].1 < 0.02);
        assert!((window.streams[&Stream::Force(0)].1 - 1.01).abs() < 1e-9);
    }
}
