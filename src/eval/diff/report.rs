//! Result of a comparison.

use std::collections::BTreeMap;

use serde::Serialize;

use super::EstimateRecord;
use crate::fusion::{Adaptation, ContactEvent};
use crate::units::Newton;

/// A point of a series: stamps repeat where time jumps back, so it takes the epoch too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Moment {
    /// How often time had jumped back before.
    pub epoch: u64,
    /// Stamp, ns.
    pub stamp_ns: i64,
}

/// A field of an estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)] // the fields of `EstimateRecord`
pub enum Field {
    Force,
    ForceBase,
    Artifact,
    Wrench,
    ContactRaw,
    Contact,
    Event,
    Since,
    Flags,
    PoseAge,
    Age,
    OnThreshold,
    OffThreshold,
    Mdf,
    Adaptation,
    ArtifactChange,
    Touch,
    TouchOn,
    TouchOff,
}

impl Field {
    /// All, in the order of `EstimateRecord`.
    pub const ALL: [Field; 19] = [
        Field::Force,
        Field::ForceBase,
        Field::Artifact,
        Field::Wrench,
        Field::ContactRaw,
        Field::Contact,
        Field::Event,
        Field::Since,
        Field::Flags,
        Field::PoseAge,
        Field::Age,
        Field::OnThreshold,
        Field::OffThreshold,
        Field::Mdf,
        Field::Adaptation,
        Field::ArtifactChange,
        Field::Touch,
        Field::TouchOn,
        Field::TouchOff,
    ];

    /// Its name, as in `EstimateRecord`.
    pub fn name(self) -> &'static str {
        match self {
            Field::Force => "force",
            Field::ForceBase => "force_base",
            Field::Artifact => "artifact",
            Field::Wrench => "wrench",
            Field::ContactRaw => "contact_raw",
            Field::Contact => "contact",
            Field::Event => "event",
            Field::Since => "since",
            Field::Flags => "flags",
            Field::PoseAge => "pose_age",
            Field::Age => "age",
            Field::OnThreshold => "on_threshold",
            Field::OffThreshold => "off_threshold",
            Field::Mdf => "mdf",
            Field::Adaptation => "adaptation",
            Field::ArtifactChange => "artifact_change",
            Field::Touch => "touch",
            Field::TouchOn => "touch_on",
            Field::TouchOff => "touch_off",
        }
    }

    fn of(self, record: &EstimateRecord) -> FieldValue {
        match self {
            Field::Force => FieldValue::force(record.force),
            Field::ForceBase => FieldValue::force(record.force_base),
            Field::Artifact => FieldValue::force(record.artifact),
            Field::Wrench => record.wrench.map_or(FieldValue::Missing, FieldValue::Wrench),
            Field::ContactRaw => FieldValue::State(record.contact_raw),
            Field::Contact => FieldValue::State(record.contact),
            Field::Event => FieldValue::Text(match record.event {
                ContactEvent::None => "none",
                ContactEvent::Onset => "onset",
                ContactEvent::Offset => "offset",
            }),
            Field::Since => FieldValue::Nanos(record.since.0),
            Field::Flags => FieldValue::Bits(record.flags.bits()),
            Field::PoseAge => record.pose_age_ns.map_or(FieldValue::Missing, FieldValue::Nanos),
            Field::Age => record.age_ns.map_or(FieldValue::Missing, FieldValue::Nanos),
            Field::OnThreshold => FieldValue::force(record.on_threshold),
            Field::OffThreshold => FieldValue::force(record.off_threshold),
            Field::Mdf => FieldValue::force(record.mdf),
            Field::Adaptation => FieldValue::Text(match record.adaptation {
                Adaptation::Off => "off",
                Adaptation::Frozen => "frozen",
                Adaptation::Learning => "learning",
                Adaptation::Waiting => "waiting",
                Adaptation::Capped => "capped",
                Adaptation::Noisy => "noisy",
            }),
            Field::ArtifactChange => record.artifact_change.map_or(FieldValue::Missing, FieldValue::Share),
            Field::Touch => record.touch.map_or(FieldValue::Missing, FieldValue::Share),
            Field::TouchOn => record.touch_on.map_or(FieldValue::Missing, FieldValue::Share),
            Field::TouchOff => record.touch_off.map_or(FieldValue::Missing, FieldValue::Share),
        }
    }
}

/// The value of a field. In JSON a bare value, `null` where there is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum FieldValue {
    /// A force, N; not NaN.
    Force(f64),
    /// Force and torque, N and N m.
    Wrench([f64; 6]),
    /// A stamp or a duration, ns.
    Nanos(i64),
    /// A yes or no.
    State(bool),
    /// Flags as on the wire.
    Bits(u32),
    /// A share; not NaN.
    Share(f64),
    /// A word.
    Text(&'static str),
    /// No value.
    Missing,
}

impl FieldValue {
    fn force(force: Option<f64>) -> Self {
        force.filter(|force| !force.is_nan()).map_or(FieldValue::Missing, FieldValue::Force)
    }

    /// Whether two values are the same: forces within the tolerance, bit by bit where it is 0; the rest exactly.
    fn is_same(&self, other: &FieldValue, tolerance: Newton) -> bool {
        match (self, other) {
            (FieldValue::Force(a), FieldValue::Force(b)) if tolerance.0 == 0.0 => a.to_bits() == b.to_bits(),
            // Equal infinities have no difference.
            (FieldValue::Force(a), FieldValue::Force(b)) => a == b || (a - b).abs() <= tolerance.0,
            (FieldValue::Wrench(a), FieldValue::Wrench(b)) => {
                let same = |a, b| FieldValue::force(Some(a)).is_same(&FieldValue::force(Some(b)), tolerance);
                a.iter().zip(b).all(|(&a, &b)| same(a, b))
            }
            (a, b) => a == b,
        }
    }

    /// How far apart two values are, where that can be said: N for forces, ns for times.
    fn distance(&self, other: &FieldValue) -> Option<f64> {
        let distance = match (self, other) {
            (FieldValue::Force(a), FieldValue::Force(b)) if a == b => 0.0,
            (FieldValue::Force(a), FieldValue::Force(b)) => (a - b).abs(),
            (FieldValue::Wrench(a), FieldValue::Wrench(b)) => {
                a.iter().zip(b).map(|(a, b)| if a == b { 0.0 } else { (a - b).abs() }).fold(0.0, f64::max)
            }
            (FieldValue::Nanos(a), FieldValue::Nanos(b)) => a.abs_diff(*b) as f64,
            _ => return None,
        };
        Some(distance)
    }
}

/// Two values of a field that belong together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Where.
    #[serde(flatten)]
    pub at: Moment,
    /// Value in A.
    pub a: FieldValue,
    /// Value in B.
    pub b: FieldValue,
    /// How far apart: N for forces, the farthest component for wrenches, ns for times; absent for the rest, and where
    /// one has no value.
    pub distance: Option<f64>,
}

/// How one field of one region differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldDiff {
    /// The field.
    pub field: Field,
    /// Pairs compared.
    pub n_compared: u64,
    /// Pairs that differ, forces by more than the tolerance.
    pub n_different: u64,
    /// Of these, pairs of which one has no value.
    pub n_one_missing: u64,
    /// The first of these in time.
    pub first: Option<Difference>,
    /// The pair farthest apart, be it within the tolerance; absent when all distances are zero or there is none.
    pub largest: Option<Difference>,
}

/// Records that one side has alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct OnlyIn {
    /// How many.
    pub n: u64,
    /// The first in time.
    pub first: Option<Moment>,
    /// The last in time.
    pub last: Option<Moment>,
}

/// How one region differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegionDiff {
    /// Records in A.
    pub n_a: u64,
    /// Records in B.
    pub n_b: u64,
    /// How often time jumped back in A.
    pub jumps_a: u64,
    /// How often time jumped back in B.
    pub jumps_b: u64,
    /// Pairs of records.
    pub n_matched: u64,
    /// Records without a partner in B.
    pub only_in_a: OnlyIn,
    /// Records without a partner in A.
    pub only_in_b: OnlyIn,
    /// Of the records without a partner, those that stopped waiting because too many did: were the series less apart,
    /// they might have found one.
    pub n_gave_up: u64,
    /// One a field, in the order of [`Field::ALL`].
    pub fields: Vec<FieldDiff>,
}

impl Default for RegionDiff {
    fn default() -> Self {
        let nothing =
            |field| FieldDiff { field, n_compared: 0, n_different: 0, n_one_missing: 0, first: None, largest: None };
        RegionDiff {
            n_a: 0,
            n_b: 0,
            jumps_a: 0,
            jumps_b: 0,
            n_matched: 0,
            only_in_a: OnlyIn::default(),
            only_in_b: OnlyIn::default(),
            n_gave_up: 0,
            fields: Field::ALL.map(nothing).to_vec(),
        }
    }
}

impl RegionDiff {
    /// Whether every record has its partner and no field differs.
    pub fn is_same(&self) -> bool {
        self.only_in_a.n == 0 && self.only_in_b.n == 0 && self.fields.iter().all(|field| field.n_different == 0)
    }

    pub(super) fn count_record(&mut self, side_idx: usize, epoch: u64) {
        let (n, jumps) =
            if side_idx == 0 { (&mut self.n_a, &mut self.jumps_a) } else { (&mut self.n_b, &mut self.jumps_b) };
        *n += 1;
        *jumps = epoch;
    }

    pub(super) fn count_alone(&mut self, side_idx: usize, moment: Moment) {
        let only = if side_idx == 0 { &mut self.only_in_a } else { &mut self.only_in_b };
        only.n += 1;
        only.first = Some(only.first.map_or(moment, |first| first.min(moment)));
        only.last = only.last.max(Some(moment));
    }

    pub(super) fn compare(&mut self, at: Moment, a: &EstimateRecord, b: &EstimateRecord, tolerance: Newton) {
        self.n_matched += 1;
        for diff in &mut self.fields {
            let (a, b) = (diff.field.of(a), diff.field.of(b));
            let same = a.is_same(&b, tolerance);
            let distance = a.distance(&b);
            diff.n_compared += 1;
            diff.n_different += u64::from(!same);
            diff.n_one_missing += u64::from((a == FieldValue::Missing) != (b == FieldValue::Missing));

            let is_first = !same && diff.first.as_ref().is_none_or(|first| at < first.at);
            let is_largest = distance.is_some_and(|distance| {
                let largest = diff.largest.as_ref();
                let so_far = largest.and_then(|largest| largest.distance).unwrap_or(0.0);
                distance > so_far || distance == so_far && largest.is_some_and(|largest| at < largest.at)
            });
            if is_first || is_largest {
                let difference = Difference { at, a, b, distance };
                if is_first {
                    diff.first = Some(difference.clone());
                }
                if is_largest {
                    diff.largest = Some(difference);
                }
            }
        }
    }
}

/// How two series differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diff {
    /// By how much forces may differ, N; 0 for bit by bit.
    pub tolerance_n: f64,
    /// By region.
    pub regions: BTreeMap<String, RegionDiff>,
}

impl Diff {
    /// Whether the series are the same. Two empty ones are; who gates on this asks for `n_matched` too.
    pub fn is_same(&self) -> bool {
        self.regions.values().all(RegionDiff::is_same)
    }

    /// Pairs of records in all regions.
    pub fn n_matched(&self) -> u64 {
        self.regions.values().map(|region| region.n_matched).sum()
    }
}
