//! `tpf diff`: the estimates of two bags, region by region and field by field.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use comfy_table::{Table, presets};

use super::checks::CheckArgs;
use super::{Failure, Outcome, print, say};
use crate::bag::{BagReader, ContactReader};
use crate::eval::{
    Check, Diff, DiffConfig, Difference, EstimateRecord, FieldValue, Moment, OnlyIn, RegionDiff, Verdict, diff,
};
use crate::fusion::{Adaptation, ContactEvent, Flags};
use crate::msg::{ContactArray, ContactState, Time, WireType, WrenchStamped, from_cdr};
use crate::units::{Newton, Stamp};

/// Compares the estimates of two bags; leaves with 1 where they differ.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Bag with estimates: the golden run
    a: PathBuf,
    /// Bag with estimates: the run to judge
    b: PathBuf,
    /// Largest difference of a force, in N, that is none; 0 compares bit by bit
    #[arg(long, value_name = "N", default_value_t = 0.0)]
    tolerance_n: f64,
    #[command(flatten)]
    checks: CheckArgs,
    /// Print the comparison as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let default = DiffConfig::default();
    let cfg = default.with_tolerance(Newton(args.tolerance_n))?;
    let (mut a, mut b) = (Records::open(&args.a)?, Records::open(&args.b)?);
    let found = diff(&mut a, &mut b, cfg)?;
    for records in [&a, &b] {
        records.check()?;
    }
    let losses: Vec<String> =
        [&a, &b].iter().flat_map(|records| records.reader.losses()).map(ToString::to_string).collect();
    losses.iter().for_each(|loss| say(&format!("input lost: {loss}")));
    if args.checks.are_wanted() {
        args.checks.write("tpf diff", &checks_of(&found, args))?;
    }
    let text = match args.json {
        true => serde_json::to_string_pretty(&found)? + "\n",
        false => rendered(&found, args),
    };
    print(&text)?;
    Ok(match (found.is_same(), losses.is_empty()) {
        (false, _) => Outcome::NotMet,
        (true, true) => Outcome::Done,
        (true, false) => Outcome::InputLost,
    })
}

/// The estimates of a bag, one a region and frame: what `ContactArray` says, with the wrench of the same stamp.
struct Records {
    path: PathBuf,
    reader: BagReader,
    contacts: ContactReader,
    wrenches: BTreeMap<String, (Time, [f64; 6])>,
    waiting: std::vec::IntoIter<EstimateRecord>,
    n_arrays: u64,
}

impl Records {
    fn open(path: &Path) -> Result<Self, Failure> {
        let reader = super::sessions::open(&[path.to_path_buf()])?;
        let (wrenches, waiting) = (BTreeMap::new(), Vec::new().into_iter());
        let contacts = ContactReader::default();
        Ok(Records { path: path.to_path_buf(), reader, contacts, wrenches, waiting, n_arrays: 0 })
    }

    fn check(&self) -> Result<(), Failure> {
        if self.n_arrays > 0 {
            return Ok(());
        }
        let there: Vec<&str> = self.reader.channels().iter().map(|channel| channel.topic.as_str()).collect();
        Err(Failure(format!(
            "{}: holds no {}; `tpf replay` writes them; its topics are {}",
            self.path.display(),
            ContactArray::TYPE_NAME,
            there.join(", ")
        )))
    }

    fn advance(&mut self) -> Result<Option<EstimateRecord>, Failure> {
        loop {
            if let Some(record) = self.waiting.next() {
                return Ok(Some(record));
            }
            let Some(message) = self.reader.next_message()? else { return Ok(None) };
            let malformed =
                |error: String| Failure(format!("{}: {}: {error}", self.path.display(), message.channel.topic));
            match message.channel.type_name() {
                WrenchStamped::TYPE_NAME => {
                    // `~/REGION/wrench` comes before the contacts of its frame.
                    let Some(region) = message.channel.topic.strip_suffix("/wrench") else { continue };
                    let region = region.rsplit('/').next().unwrap_or_default().to_owned();
                    let stamped: WrenchStamped =
                        from_cdr(message.data).map_err(|error| malformed(error.to_string()))?;
                    let (f, t) = (&stamped.wrench.force, &stamped.wrench.torque);
                    self.wrenches.insert(region, (stamped.header.stamp, [f.x, f.y, f.z, t.x, t.y, t.z]));
                }
                ContactArray::TYPE_NAME => {
                    let array = self.contacts.read(&message).map_err(malformed)?;
                    self.n_arrays += 1;
                    let wrenches = &self.wrenches;
                    let record = |state: &ContactState| {
                        let wrench = wrenches.get(&state.region).filter(|(stamp, _)| *stamp == array.header.stamp);
                        record_of(array.header.stamp, state, wrench.map(|(_, wrench)| *wrench))
                    };
                    self.waiting = array.contacts.iter().map(record).collect::<Vec<_>>().into_iter();
                }
                _ => {}
            }
        }
    }
}

impl Iterator for &mut Records {
    type Item = Result<EstimateRecord, Failure>;

    fn next(&mut self) -> Option<Self::Item> {
        self.advance().transpose()
    }
}

fn record_of(stamp: Time, state: &ContactState, wrench: Option<[f64; 6]>) -> EstimateRecord {
    let value = |value: f64| Some(value).filter(|value| !value.is_nan());
    EstimateRecord {
        stamp: stamp_of(stamp),
        region: state.region.clone(),
        force: value(state.force),
        force_base: value(state.force_base),
        artifact: value(state.artifact),
        wrench,
        contact_raw: state.contact_raw,
        contact: state.contact,
        event: match state.event {
            ContactState::ONSET => ContactEvent::Onset,
            ContactState::OFFSET => ContactEvent::Offset,
            _ => ContactEvent::None,
        },
        since: stamp_of(state.since),
        flags: Flags::from_bits(state.flags),
        pose_age_ns: value(state.pose_age).map(|age_s| (age_s * 1e9).round() as i64),
        age_ns: value(state.age).map(|age_s| (age_s * 1e9).round() as i64),
        on_threshold: value(state.on_threshold),
        off_threshold: value(state.off_threshold),
        mdf: value(state.mdf),
        adaptation: match state.adaptation {
            ContactState::ADAPTATION_FROZEN => Adaptation::Frozen,
            ContactState::ADAPTATION_LEARNING => Adaptation::Learning,
            ContactState::ADAPTATION_WAITING => Adaptation::Waiting,
            ContactState::ADAPTATION_CAPPED => Adaptation::Capped,
            _ => Adaptation::Off,
        },
        artifact_change: value(state.artifact_change),
        touch: value(state.touch),
        touch_on: value(state.touch_on),
        touch_off: value(state.touch_off),
    }
}

fn stamp_of(time: Time) -> Stamp {
    Stamp::from_sec_nanosec(time.sec, time.nanosec)
}

/// Frames and fields of each region, a check each.
fn checks_of(found: &Diff, args: &Args) -> Vec<Check> {
    let mut checks = Vec::new();
    for (region, diff) in &found.regions {
        let mut push = |what: &str, n_different: u64, expected: String, reason: String| {
            let verdict = if n_different == 0 { Verdict::Passed } else { Verdict::Failed(reason) };
            checks.push(Check {
                name: format!("{region}: {what}"),
                value: Some(n_different as f64),
                expected,
                verdict,
            });
        };
        for (only, bag) in [(&diff.only_in_a, &args.a), (&diff.only_in_b, &args.b)] {
            let reason = format!("{} frames are in {} only", only.n, bag.display());
            push(&format!("frames only in {}", if bag == &args.a { "a" } else { "b" }), only.n, "0".to_owned(), reason);
        }
        for field in &diff.fields {
            let first = field.first.as_ref().map_or(String::new(), |first| {
                format!(", first at {}: {} and {}", at(&first.at), value(&first.a), value(&first.b))
            });
            let reason = format!("{} of {} differ{first}", field.n_different, field.n_compared);
            push(field.field.name(), field.n_different, agreement_wanted(args.tolerance_n), reason);
        }
    }
    checks
}

fn agreement_wanted(tolerance_n: f64) -> String {
    if tolerance_n == 0.0 { "equal bit by bit".to_owned() } else { format!("equal within {tolerance_n} N") }
}

fn rendered(found: &Diff, args: &Args) -> String {
    let mut text = String::new();
    for (region, diff) in &found.regions {
        // Writing to a string can't fail.
        let _ = writeln!(text, "region {region}: {} frames in both", diff.n_matched);
        only(&mut text, &args.a, &diff.only_in_a);
        only(&mut text, &args.b, &diff.only_in_b);
        let differing: Vec<_> = diff.fields.iter().filter(|field| field.n_different > 0).collect();
        if differing.is_empty() {
            let _ = writeln!(text, "  {}", agreement(diff, args.tolerance_n));
            continue;
        }
        let mut table = Table::new();
        table.load_style(presets::NOTHING).set_header([
            "  field",
            "differ",
            "first at",
            "a",
            "b",
            "largest at",
            "a",
            "b",
            "apart",
        ]);
        for field in differing {
            let mut row =
                vec![format!("  {}", field.field.name()), format!("{} of {}", field.n_different, field.n_compared)];
            for difference in [&field.first, &field.largest] {
                row.extend(cells(difference.as_ref()));
            }
            row.push(
                field.largest.as_ref().and_then(|largest| largest.distance).map_or("-".into(), |d| format!("{d:.3e}")),
            );
            table.add_row(row);
        }
        let _ = writeln!(text, "{table}");
    }
    let _ = writeln!(text, "{}", if found.is_same() { "same" } else { "different" });
    text
}

fn agreement(diff: &RegionDiff, tolerance_n: f64) -> String {
    let largest = diff.fields.iter().filter_map(|field| field.largest.as_ref()?.distance).fold(0.0, f64::max);
    match tolerance_n {
        0.0 => "every field equal, bit by bit".to_owned(),
        _ => format!("every field equal within {tolerance_n} N, the largest difference {largest:.3e} N"),
    }
}

fn only(text: &mut String, bag: &Path, only: &OnlyIn) {
    if let (Some(first), Some(last)) = (&only.first, &only.last) {
        let _ = writeln!(text, "  only in {}: {} frames, from {} to {}", bag.display(), only.n, at(first), at(last));
    }
}

fn cells(difference: Option<&Difference>) -> [String; 3] {
    difference.map_or(["-".into(), "-".into(), "-".into()], |d| [at(&d.at), value(&d.a), value(&d.b)])
}

fn at(moment: &Moment) -> String {
    let epoch = if moment.epoch > 0 { format!(" (lap {})", moment.epoch + 1) } else { String::new() };
    format!("{}{epoch}", Stamp(moment.stamp_ns))
}

fn value(value: &FieldValue) -> String {
    match value {
        FieldValue::Force(force) => format!("{force:.6} N"),
        FieldValue::Wrench(wrench) => wrench.map(|part| format!("{part:.6}")).join(" "),
        FieldValue::Nanos(nanos) => Stamp(*nanos).to_string(),
        FieldValue::State(state) => state.to_string(),
        FieldValue::Bits(bits) => Flags::from_bits(*bits).to_string(),
        FieldValue::Share(share) => format!("{:.3} %", 100.0 * share),
        FieldValue::Text(text) => (*text).to_owned(),
        FieldValue::Missing => "none".to_owned(),
    }
}
