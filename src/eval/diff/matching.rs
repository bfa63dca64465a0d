//! Brings the records of two series together.

use std::collections::{BTreeMap, VecDeque};

use super::report::{Diff, Moment, RegionDiff};
use super::{DiffConfig, EstimateRecord};
use crate::units::{Stamp, nanos};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    A,
    B,
}

impl Side {
    fn idx(self) -> usize {
        match self {
            Side::A => 0,
            Side::B => 1,
        }
    }

    fn other(self) -> Side {
        match self {
            Side::A => Side::B,
            Side::B => Side::A,
        }
    }
}

/// One region of one side.
#[derive(Debug, Default)]
struct Stream {
    epoch: u64,
    newest: Option<Stamp>,
    pending: BTreeMap<Moment, VecDeque<EstimateRecord>>,
    n_pending: usize,
}

impl Stream {
    fn moment_of(&mut self, stamp: Stamp, time_jump_ns: i64) -> Moment {
        match self.newest {
            Some(newest) if newest.nanos_since(stamp) > time_jump_ns => {
                self.epoch += 1;
                self.newest = Some(stamp);
            }
            newest => self.newest = newest.max(Some(stamp)),
        }
        Moment { epoch: self.epoch, stamp_ns: stamp.0 }
    }

    fn push(&mut self, moment: Moment, record: EstimateRecord) {
        self.pending.entry(moment).or_default().push_back(record);
        self.n_pending += 1;
    }

    fn take(&mut self, moment: Moment) -> Option<EstimateRecord> {
        let queue = self.pending.get_mut(&moment)?;
        let record = queue.pop_front();
        if queue.is_empty() {
            self.pending.remove(&moment);
        }
        self.n_pending -= usize::from(record.is_some());
        record
    }

    /// Takes the oldest record if `gone` says that its partner can't come any more.
    fn take_oldest_if(&mut self, gone: impl Fn(&Moment) -> bool) -> Option<Moment> {
        let moment = *self.pending.first_key_value()?.0;
        gone(&moment).then_some(())?;
        self.take(moment).map(|_| moment)
    }
}

#[derive(Debug, Default)]
struct RegionMatcher {
    streams: [Stream; 2],
    diff: RegionDiff,
}

/// Matches two series that are fed record by record, each in its own order.
#[derive(Debug)]
pub(super) struct Matcher {
    cfg: DiffConfig,
    regions: BTreeMap<String, RegionMatcher>,
    reached: [Option<Moment>; 2],
}

impl Matcher {
    pub fn new(cfg: DiffConfig) -> Self {
        Matcher { cfg, regions: BTreeMap::new(), reached: [None, None] }
    }

    /// Where the last record of a side was; the side that is behind is to be read next.
    pub fn reached(&self, side: Side) -> Option<Moment> {
        self.reached[side.idx()]
    }

    pub fn handle_record(&mut self, side: Side, record: EstimateRecord) {
        let (time_jump_ns, max_pending) = (nanos(self.cfg.time_jump), self.cfg.max_pending);
        let region = match self.regions.get_mut(&record.region) {
            Some(region) => region,
            None => self.regions.entry(record.region.clone()).or_default(),
        };
        let (ours, theirs) = {
            let [a, b] = &mut region.streams;
            if side == Side::A { (a, b) } else { (b, a) }
        };
        let moment = ours.moment_of(record.stamp, time_jump_ns);
        self.reached[side.idx()] = Some(moment);
        region.diff.count_record(side.idx(), moment.epoch);

        match theirs.take(moment) {
            Some(partner) if side == Side::A => region.diff.compare(moment, &record, &partner, self.cfg.tolerance),
            Some(partner) => region.diff.compare(moment, &partner, &record, self.cfg.tolerance),
            None => ours.push(moment, record),
        }
        // What is later than time_jump behind this side would begin a new epoch, so their older records stay alone.
        let newest = ours.newest.unwrap_or_default();
        let gone = |theirs: &Moment| {
            theirs.epoch < ours.epoch
                || theirs.epoch == ours.epoch && newest.nanos_since(Stamp(theirs.stamp_ns)) > time_jump_ns
        };
        while let Some(moment) = theirs.take_oldest_if(gone) {
            region.diff.count_alone(side.other().idx(), moment);
        }
        while ours.n_pending > max_pending {
            let Some(moment) = ours.take_oldest_if(|_| true) else { break };
            region.diff.count_alone(side.idx(), moment);
            region.diff.n_gave_up += 1;
        }
    }

    pub fn finish(self) -> Diff {
        let close = |(name, mut region): (String, RegionMatcher)| {
            for (idx, stream) in region.streams.iter_mut().enumerate() {
                while let Some(moment) = stream.take_oldest_if(|_| true) {
                    region.diff.count_alone(idx, moment);
                }
            }
            (name, region.diff)
        };
        Diff { tolerance_n: self.cfg.tolerance.0, regions: self.regions.into_iter().map(close).collect() }
    }
}
